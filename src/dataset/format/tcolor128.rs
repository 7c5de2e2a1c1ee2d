//! Temple Color 128: `SEQ/img`, boxes in `SEQ/*_gt.txt`, the frames that they are for in `SEQ/*_frames.txt`.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::annotation::Annotations;
use crate::dataset::storage::File;
use crate::dataset::{DatasetError, DatasetErrorKind, rows, text};

/// See the module.
pub(super) struct TColor128;

/// The numbers of the first and the last frame, which the text says.
fn range(file: &TruthFile) -> Result<(u64, u64), DatasetError> {
    let text = file.text()?;
    let numbers: Vec<Option<u64>> = text::words(&text).map(|word| word.parse().ok()).collect();
    match numbers[..] {
        [Some(first), Some(last)] if first <= last => Ok((first, last)),
        _ => Err(file.fault(DatasetErrorKind::Format {
            fault: "not the numbers of two frames".into(),
            remedy: "write `first,last`: the frames that the rows of ground truth are for".into(),
        })),
    }
}

impl Format for TColor128 {
    fn describe(&self) -> Description {
        Description {
            name: "tcolor128",
            summary: "Temple Color 128",
            layout: "`*_gt.txt`, `*_frames.txt` and frames in `img/`",
            conventions: "boxes as x y w h, origin 0.5 (at the corner of the first pixel; `--origin 1.5` for boxes that count \
                          pixels from 1), a row per frame of the range that `*_frames.txt` names; other frames are left out",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let ends = |end: &str| place.files().iter().find(|file| file.name().ends_with(end));
        let (Some(truth), Some(range_file)) = (ends("_gt.txt"), ends("_frames.txt")) else {
            return Ok(vec![]);
        };
        let (frames, _) = place.images_here_or_in(&["img"])?;
        let named = TruthFile::read(range_file).and_then(|file| range(&file));
        let frames = match named {
            Ok((first, last)) => table::between(&frames, first, last),
            // What is wrong with it shows when it is read.
            Err(_) => frames,
        };
        let mut found = place.sequence(frames, vec![truth.clone()]);
        found.about = vec![range_file.clone()];
        Ok(vec![found])
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let readable = |file: &File| TruthFile::read(file).and_then(|file| range(&file));
        sequence
            .about
            .iter()
            .try_for_each(|file| readable(file).map(|_| ()))?;
        rows::read(
            &truth[0],
            rows::ANY,
            sequence.frames.iter().enumerate(),
            annotations,
        )
    }
}
