//! ALOV300++: frames in `imagedata++/CATEGORY/SEQ`, boxes in `alov300++_rectangleAnnotation_full/CATEGORY/SEQ.ann`, of
//! every fifth frame and the last.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::annotation::{Annotations, Region};
use crate::dataset::reading::BoxForm;
use crate::dataset::rows::{self, BOX, RowKind, Shape};
use crate::dataset::{DatasetError, DatasetErrorKind, text};
use std::collections::HashMap;

/// See the module.
pub(super) struct Alov;

const FRAMES: &str = "imagedata++";
const ANNOTATIONS: &str = "alov300++_rectangleAnnotation_full";

/// Columns of a row: frame, four points.
const COLUMNS: usize = 9;

const CORNERS_OF_BOX: RowKind = RowKind {
    shape: Shape::Box(BoxForm::Xyxy),
    ..BOX
};

/// The box around the four points of `words`, in any order.
fn around(words: &[&str], kind: &RowKind) -> Result<Region, DatasetErrorKind> {
    let numbers = rows::numbers(table::columns(words, 1..COLUMNS, COLUMNS)?, COLUMNS - 1)?;
    let side = |from: usize| {
        let values = || numbers.iter().skip(from).step_by(2).copied();
        (
            values().fold(f64::INFINITY, f64::min),
            values().fold(f64::NEG_INFINITY, f64::max),
        )
    };
    let ((left, right), (top, bottom)) = (side(0), side(1));
    Ok(Region::Corners(kind.corners(&[left, top, right, bottom])))
}

impl Format for Alov {
    fn describe(&self) -> Description {
        Description {
            name: "alov",
            summary: "ALOV300++",
            layout: "frames in `imagedata++/CATEGORY/SEQ` and `alov300++_rectangleAnnotation_full/CATEGORY/SEQ.ann`",
            conventions: "the box around four points, origin 0.5 (at the corner of the first pixel), after the number of the \
                          frame, from 1; frames without a row: not annotated",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let frames = place.images();
        if frames.is_empty() {
            return Ok(vec![]);
        }
        let [category, outer] = place.names_around();
        let truth = match outer == FRAMES {
            true => {
                let folder = format!("{ANNOTATIONS}/{category}");
                place.file_around(3, &[&folder], &[format!("{}.ann", place.name())])
            }
            false => place.file("annotations.ann").cloned(),
        };
        let found = truth.map(|truth| place.sequence(frames, vec![truth]));
        Ok(found.into_iter().collect())
    }

    fn levels_below(&self, place: &Place) -> usize {
        if place.has_folders(&[FRAMES]) { 3 } else { 0 }
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let file = &truth[0];
        let kind = RowKind {
            // The form of boxes that is asked for is not that of four points.
            shape: CORNERS_OF_BOX.shape,
            ..rows::as_asked(&CORNERS_OF_BOX, annotations)
        };
        annotations.boxes = None;
        let text = file.text()?;
        let frames: HashMap<u64, usize> = table::numbers(&sequence.frames).into_iter().zip(0..).collect();
        let mut any = false;
        for (line, row) in table::lines(&text) {
            any = true;
            let words: Vec<&str> = text::words(row).collect();
            let location = file.at_line(line);
            let frame = words[0].to_owned();
            let Some(&i) = frame.parse().ok().and_then(|n: u64| frames.get(&n)) else {
                annotations.fault(location.fault(DatasetErrorKind::UnknownFrame { frame }));
                continue;
            };
            if annotations.is_set(i) {
                annotations.fault(location.fault(DatasetErrorKind::DuplicateRow { frame }));
                continue;
            }
            annotations.set(i, location, around(&words, &kind));
        }
        match any {
            true => Ok(()),
            false => Err(file.fault(DatasetErrorKind::NoRows)),
        }
    }
}
