//! The plainest format: a folder with frames (or with frames in `img/`) and `groundtruth.txt`.

use super::{Description, Format, Found, Place};
use crate::dataset::DatasetError;

/// See the module.
pub(super) struct FrameFolder;

impl Format for FrameFolder {
    fn describe(&self) -> Description {
        Description {
            name: "folder",
            summary: "a folder of frames with one text of ground truth",
            layout: "frames and `groundtruth.txt` in a folder",
            conventions: "corners as UL UR LR LL, origin 0 (pixel centres at integers), in order or after the name of the \
                          frame; or boxes as x y w h, origin 0.5 (at the corner of the first pixel); a word after the name \
                          in place of the numbers leaves the frame without annotation",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let Some(truth) = place.file("groundtruth.txt") else {
            return Ok(vec![]);
        };
        let (frames, _) = place.images_here_or_in(&["img"])?;
        Ok(vec![place.sequence(frames, vec![truth.clone()])])
    }
}
