//! MTF's and TMT's sequences: frames in `<root>/<seq>/`, ground truth in `<root>/<seq>.txt`, with or without a level of
//! actors.

use super::{Description, Format, Found, Place};
use crate::dataset::DatasetError;

/// See the module.
pub(super) struct MtfText;

impl Format for MtfText {
    fn describe(&self) -> Description {
        Description {
            name: "mtf",
            summary: "sequences in the form of MTF: TMT, UCSB, LinTrack, PAMI, CMT",
            layout: "frames in a folder `SEQ` and `SEQ.txt` beside it",
            conventions: "corners as UL UR LR LL, origin 0 (pixel centres at integers), after the name of the frame; a \
                          word in place of the numbers (`tracker_failed`) leaves the frame without annotation",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let frames = place.images();
        if frames.is_empty() {
            return Ok(vec![]);
        }
        let truth = place.file_beside_with(".txt");
        let found = truth.map(|truth| place.sequence(frames, vec![truth]));
        Ok(found.into_iter().collect())
    }
}
