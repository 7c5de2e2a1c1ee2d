//! OTB's sequences: boxes in `groundtruth_rect.txt`, frames in `img/` or beside it.

use super::{Description, Format, Found, Place};
use crate::dataset::DatasetError;

/// See the module.
pub(super) struct Otb;

impl Format for Otb {
    fn describe(&self) -> Description {
        Description {
            name: "otb",
            summary: "sequences of the Object Tracking Benchmark",
            layout: "`groundtruth_rect.txt` and frames in `img/`",
            conventions: "boxes as x y w h, origin 0.5 (at the corner of the first pixel; `--origin 1.5` for boxes that \
                          count pixels from 1), a row per frame in order",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let Some(truth) = place.file("groundtruth_rect.txt") else {
            return Ok(vec![]);
        };
        let (frames, _) = place.images_here_or_in(&["img"])?;
        Ok(vec![place.sequence(frames, vec![truth.clone()])])
    }
}
