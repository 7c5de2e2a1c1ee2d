//! OTB's sequences and those in its form (TLP, DTB70): boxes in `groundtruth_rect.txt`, or in `groundtruth_rect.1.txt` and so
//! on for several objects, frames in `img/` or beside it.

use super::{Description, Format, Found, Place, TruthFile, otb_attributes, table};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::storage::File;
use crate::dataset::{rows, text};

/// See the module.
pub(super) struct Otb;

const TRUTH: &str = "groundtruth_rect.txt";

/// The first and the last frame of sequences whose ground truth is not for all frames, as OTB lists them.
const RANGES: [(&str, u64, u64); 9] = [
    ("BlurCar1", 247, 988),
    ("BlurCar3", 3, 359),
    ("BlurCar4", 18, 397),
    ("David", 300, 770),
    ("Diving", 1, 215),
    ("Football1", 1, 74),
    ("Freeman3", 1, 460),
    ("Freeman4", 1, 283),
    ("Tiger1", 6, 354),
];

/// Columns of a row of TLP: frame, box, lost.
const TLP_COLUMNS: usize = 6;

/// The number of the object that a file of ground truth is of.
fn object(file: &File) -> Option<&str> {
    let number = file
        .name()
        .strip_prefix("groundtruth_rect.")?
        .strip_suffix(".txt")?;
    (!number.is_empty() && number.bytes().all(|b| b.is_ascii_digit())).then_some(number)
}

/// Those of `frames` that the rows of `truth` are for, when OTB lists them for the sequence `name` and they are as many.
fn listed(name: &str, frames: &[File], truth: &File) -> Option<Vec<File>> {
    let (_, first, last) = RANGES.iter().find(|(listed, ..)| *listed == name)?;
    let within = table::between(frames, *first, *last);
    let file = TruthFile::read(truth).ok()?;
    let rows = table::lines(&file.text().ok()?).count();
    (rows != frames.len() && rows == within.len()).then_some(within)
}

impl Format for Otb {
    fn describe(&self) -> Description {
        Description {
            name: "otb",
            summary: "sequences of the Object Tracking Benchmark, and in its form: TLP, DTB70",
            layout: "`groundtruth_rect.txt` (`groundtruth_rect.1.txt` and so on for several objects) and frames in `img/`",
            conventions: "boxes as x y w h, origin 0.5 (at the corner of the first pixel; `--origin 1.5` for boxes that \
                          count pixels from 1), a row per frame in order; with 6 columns (TLP) the first is the frame, the \
                          last 1 where the object is lost: absent",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let truth: Vec<&File> = match place.file(TRUTH) {
            Some(truth) => vec![truth],
            None => place
                .files()
                .iter()
                .filter(|file| object(file).is_some())
                .collect(),
        };
        if truth.is_empty() {
            return Ok(vec![]);
        }
        let (frames, _) = place.images_here_or_in(&["img"])?;
        let found = truth.into_iter().map(|truth| {
            let frames = listed(place.name(), &frames, truth).unwrap_or_else(|| frames.clone());
            let mut found = place.sequence(frames, vec![truth.clone()]);
            let first = found.frames.first().map_or("", |frame| frame.name());
            found.tags = otb_attributes::of(place.name(), first);
            if let Some(number) = object(truth) {
                found.name = format!("{}-{number}", place.name());
            }
            found
        });
        Ok(found.collect())
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let file = &truth[0];
        let frames = sequence.frames.iter().enumerate();
        let text = file.text()?;
        let first = table::lines(&text).next();
        if first.is_none_or(|(_, row)| text::words(row).count() != TLP_COLUMNS) {
            return rows::read(file, rows::ANY, frames, annotations);
        }
        let boxes = file.with_lines(|_, row| {
            let words: Vec<&str> = text::words(row).collect();
            Ok(match words[..] {
                [_, _, _, _, _, lost] if lost.parse::<f64>().is_ok_and(|lost| lost != 0.0) => {
                    Some("absent".into())
                }
                [_, x, y, w, h, _] => Some(format!("{x} {y} {w} {h}")),
                _ => None,
            })
        })?;
        rows::read(&boxes, rows::ANY, frames, annotations)
    }
}
