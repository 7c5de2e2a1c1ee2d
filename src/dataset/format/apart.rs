//! Frames and ground truth in folders of their own, as PlanarTrack, POIC, UAV123 and TrackingNet have them, of sets that are
//! none of these.

use super::{Description, Format, Found, Place};
use crate::dataset::DatasetError;

/// See the module.
pub(super) struct Apart;

/// Folders that hold the ground truth of other folders.
const FOLDERS: [&str; 8] = [
    "annos",
    "anno",
    "annotations",
    "annotation",
    "Annotations",
    "gt",
    "groundtruth",
    "GT",
];

/// What follows the name of the sequence.
const ENDS: [&str; 6] = [
    ".txt",
    "_gt.txt",
    "_gt_points.txt",
    "_groundtruth.txt",
    "/groundtruth.txt",
    "/groundtruth_rect.txt",
];

/// Folders around the sequence's that may hold one of [`FOLDERS`]: `root/images/train/SEQ` has its truth in
/// `root/annotations/train/SEQ.txt`.
const LEVELS: usize = 3;

impl Format for Apart {
    fn describe(&self) -> Description {
        Description {
            name: "apart",
            summary: "ground truth in a folder of its own, in no form of a known set",
            layout: "frames in a folder `SEQ`, and `SEQ.txt` in a folder `annos`, `anno`, `annotations` or `gt` near it",
            conventions: "corners as UL UR LR LL, pixel centres at integers, in order or after the name of the frame; \
                          or boxes as x y w h, origin at the corner of the first pixel",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let (frames, _) = place.images_here_or_in(&["img"])?;
        if frames.is_empty() {
            return Ok(vec![]);
        }
        let sequence = place.name().to_owned();
        let group = place
            .folder()
            .parent()
            .map(|around| format!("{}/{sequence}", around.name()));
        let sequences = group.into_iter().chain([sequence]);
        let names: Vec<String> = sequences
            .flat_map(|s| ENDS.map(|end| format!("{s}{end}")))
            .collect();
        let truth = place.file_around(LEVELS, &FOLDERS, &names);
        let found = truth.map(|truth| place.sequence(frames, vec![truth]));
        Ok(found.into_iter().collect())
    }
}
