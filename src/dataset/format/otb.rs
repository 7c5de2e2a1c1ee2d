//! OTB's sequences: boxes in `groundtruth_rect.txt`, frames in `img/` or beside it.

use super::{Description, Format, Found, Place, TruthFile};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::rows::{self, ANY};

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

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        rows::read(&truth[0], ANY, sequence.frames.iter().enumerate(), annotations)
    }
}
