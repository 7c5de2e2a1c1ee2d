//! Need for Speed: `SEQ/240/SEQ` and `SEQ/30/SEQ` with frames, each with `SEQ.txt` beside it.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::annotation::{Annotations, Region};
use crate::dataset::reading::BoxForm;
use crate::dataset::rows::{self, BOX, RowKind, Shape};
use crate::dataset::{DatasetError, DatasetErrorKind, text};

/// See the module.
pub(super) struct Nfs;

/// Frames per second, as folders are called.
const RATES: [&str; 2] = ["30", "240"];

/// Frames of the fast video for one of the slow.
const RATIO: usize = 8;

/// Columns of a row: object, box, frame, lost, occluded, generated, label.
const LEAST: usize = 5;
const LOST: usize = 6;
const OCCLUDED: usize = 7;

const CORNERS_OF_BOX: RowKind = RowKind {
    shape: Shape::Box(BoxForm::Xyxy),
    ..BOX
};

impl Format for Nfs {
    fn describe(&self) -> Description {
        Description {
            name: "nfs",
            summary: "Need for Speed at 30 and 240 frames per second",
            layout: "frames in `240/SEQ` or `30/SEQ` of a folder `SEQ`, and `SEQ.txt` beside them",
            conventions: "boxes as x1 y1 x2 y2 after the number of the object, origin 0.5 (at the corner of the first pixel), a \
                          row per frame in order, of 30 frames per second also every eighth row; lost: absent",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let [rate, outer] = place.names_around();
        if !RATES.contains(&rate.as_str()) || outer != place.name() {
            return Ok(vec![]);
        }
        let frames = place.images();
        let Some(truth) = place.file_beside_with(".txt").filter(|_| !frames.is_empty()) else {
            return Ok(vec![]);
        };
        let mut found = place.sequence(frames, vec![truth]);
        found.dataset = Some(format!("NfS-{rate}"));
        Ok(vec![found])
    }

    fn levels_below(&self, place: &Place) -> usize {
        let rates = place.folders().iter().any(|f| RATES.contains(&f.name()));
        if rates { 2 } else { 0 }
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let file = &truth[0];
        let text = file.text()?;
        let mut rows: Vec<(usize, Vec<&str>)> = table::lines(&text)
            .map(|(line, row)| (line, text::words(row).collect()))
            .collect();
        let frames = sequence.frames.len();
        if rows.first().is_none_or(|(_, words)| words.len() < LEAST) {
            return rows::read(file, rows::ANY, sequence.frames.iter().enumerate(), annotations);
        }
        if rows.len() > frames + 1 && rows.len().div_ceil(RATIO).abs_diff(frames) <= 1 {
            rows = rows.into_iter().step_by(RATIO).collect();
        }
        if rows.len().abs_diff(frames) > 1 {
            return Err(file.fault(DatasetErrorKind::Format {
                fault: format!("{} rows of ground truth for {frames} frames", rows.len()),
                remedy: format!("expected as many, or {RATIO} times as many; complete the sequence"),
            }));
        }
        if rows.len() != frames {
            annotations.warn(file.fault(DatasetErrorKind::Doubtful {
                fault: format!(
                    "{} rows of ground truth for {frames} frames, taken from the first on",
                    rows.len()
                ),
                remedy: "check that none is missing".into(),
            }));
        }
        let kind = rows::as_asked(&CORNERS_OF_BOX, annotations);
        let is_set = |words: &[&str], column: usize| words.get(column).is_some_and(|word| *word != "0");
        for (i, (line, words)) in rows.iter().enumerate().take(frames) {
            let said = match is_set(words, LOST) {
                true => Ok(Region::Absent),
                false => table::columns(words, 1..5, LEAST).and_then(|words| rows::region(words, &kind)),
            };
            annotations.set(i, file.at_line(*line), said);
            if is_set(words, OCCLUDED) {
                annotations.flag(i, "occluded");
            }
        }
        Ok(())
    }
}
