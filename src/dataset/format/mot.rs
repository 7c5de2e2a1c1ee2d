//! The MOT Challenge's sequences: frames in `img1/`, boxes of all objects in `gt/gt.txt`.

use super::table::Objects;
use super::{Description, Format, Found, Place, TruthFile};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::reading::Origin;
use crate::dataset::rows::{BOX, RowKind};

/// See the module.
pub(super) struct Mot;

/// Frame, object, box, confidence (0: to be ignored), and what else a set says.
const ROWS: Objects = Objects {
    object: 1,
    region: 2..6,
    all: 6,
    kind: RowKind {
        origin: Origin::CORNER,
        ..BOX
    },
    counts: |words| words.get(6).and_then(|word| word.parse().ok()) != Some(0.0),
};

impl Format for Mot {
    fn describe(&self) -> Description {
        Description {
            name: "mot",
            summary: "sequences of the MOT Challenge and sets in its form, a sequence for each object",
            layout: "`gt/gt.txt` and frames in `img1/`",
            conventions: "boxes as x y w h, origin 0.5 (at the corner of the first pixel; `--origin 1.5` for boxes that count \
                          pixels from 1), after the numbers of frame and object; a row of confidence 0: ignored; a frame \
                          without a row for the object: not annotated",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        if !place.has_folders(&["gt"]) {
            return Ok(vec![]);
        }
        let Some(truth) = place.folder().file("gt/gt.txt") else {
            return Ok(vec![]);
        };
        let (frames, inner) = place.images_here_or_in(&["img1", "img"])?;
        match inner {
            Some(_) => Ok(ROWS.find(place, &frames, &truth)),
            None => Ok(vec![]),
        }
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        ROWS.read(sequence, &truth[0], annotations)
    }
}
