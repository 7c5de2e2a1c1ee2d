//! POIC: frames in `sequences/SEQ`, corners in `gt/SEQ.txt` after the name of the frame.

use super::{Description, Format, Found, Place};
use crate::dataset::DatasetError;

/// See the module.
pub(super) struct Poic;

impl Format for Poic {
    fn describe(&self) -> Description {
        Description {
            name: "poic",
            summary: "POIC, planar objects under changes of illumination",
            layout: "frames in `sequences/SEQ` and `gt/SEQ.txt`",
            conventions: "corners as UL UR LR LL, origin 0 (pixel centres at integers), after the name of the frame",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let [around, _] = place.names_around();
        let frames = place.images();
        if around != "sequences" || frames.is_empty() {
            return Ok(vec![]);
        }
        let outer = place.folder().parent().and_then(|around| around.parent());
        let truth = outer.and_then(|outer| outer.file(&format!("gt/{}.txt", place.name())));
        let found = truth.map(|truth| place.sequence(frames, vec![truth]));
        Ok(found.into_iter().collect())
    }

    /// The templates of all sequences.
    fn holds_no_sequence(&self, place: &Place) -> bool {
        let around = || Place::new(&place.folder().parent()?).ok();
        place.name() == "Templates" && around().is_some_and(|around| around.has_folders(&["sequences", "gt"]))
    }
}
