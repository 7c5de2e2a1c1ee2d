//! What formats share: frames by number, rows whose columns are known, attributes and splits beside the data.

use super::{Found, Place, TruthFile};
use crate::dataset::annotation::{Annotations, Region};
use crate::dataset::names::FrameNames;
use crate::dataset::order::natural;
use crate::dataset::rows::{self, RowKind};
use crate::dataset::storage::File;
use crate::dataset::text;
use crate::dataset::{DatasetError, DatasetErrorKind};
use std::collections::{BTreeMap, HashMap};

/// Lines of a text that say something, each with its number (from 1). Lines that begin with `#` or `%` are skipped.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let says = |line: &str| text::words(line).next().is_some() && !line.trim_start().starts_with(['#', '%']);
    (1..).zip(text::lines(text)).filter(move |(_, line)| says(line))
}

/// The number of each frame: the one in its name, else its place from 1.
pub(super) fn numbers(frames: &[File]) -> Vec<u64> {
    let named = FrameNames::new(frames.iter().map(File::name)).numbers();
    named.unwrap_or_else(|| (1..=frames.len() as u64).collect())
}

/// Those of `frames` whose numbers are from `first` to `last`.
pub(super) fn between(frames: &[File], first: u64, last: u64) -> Vec<File> {
    let numbers = numbers(frames);
    let within = frames
        .iter()
        .zip(numbers)
        .filter(|(_, n)| (first..=last).contains(n));
    within.map(|(frame, _)| frame.clone()).collect()
}

/// The words of a row in `columns`, of which it has `all`.
///
/// # Errors
/// It has fewer.
pub(super) fn columns<'a>(
    words: &'a [&'a str],
    columns: std::ops::Range<usize>,
    all: usize,
) -> Result<&'a [&'a str], DatasetErrorKind> {
    let wrong = DatasetErrorKind::WrongCount {
        found: words.len(),
        expected: all,
    };
    words.get(columns).filter(|_| words.len() >= all).ok_or(wrong)
}

/// Reads rows as those of all frames in order or, where there is one row, as that of the first frame alone.
///
/// # Errors
/// Those of [`rows::read`].
pub(super) fn read_all_or_first(
    file: &TruthFile,
    kinds: &[RowKind],
    sequence: &Found,
    annotations: &mut Annotations,
) -> Result<(), DatasetError> {
    let frames = sequence.frames.iter().enumerate();
    if frames.len() < 2 || lines(&file.text()?).nth(1).is_some() {
        return rows::read(file, kinds, frames, annotations);
    }
    rows::read(file, kinds, frames.take(1), annotations)?;
    annotations.warn(file.fault(DatasetErrorKind::Doubtful {
        fault: "ground truth of the first frame alone, as test sets have it: no error can be measured".into(),
        remedy:
            "use it to record corners (`--frame-logs`), or take a set with ground truth of all frames".into(),
    }));
    Ok(())
}

/// Rows of zeros or NaN say that the frame has no label, not that the object cannot be seen.
pub(super) fn unlabelled(annotations: &mut Annotations) {
    let frames = annotations.frames.iter_mut();
    frames
        .filter(|frame| frame.region == Region::Absent)
        .for_each(|frame| frame.region = Region::Unknown);
}

/// Tags for the columns of `file` that are not 0, called `names` in order.
pub(super) fn attributes(file: &File, names: &[&str], annotations: &mut Annotations) {
    let read = || -> Result<Vec<bool>, DatasetError> {
        let file = TruthFile::read(file)?;
        let text = file.text()?;
        let words: Vec<&str> = text::words(&text).collect();
        let numbers = rows::numbers(&words, names.len()).map_err(|kind| file.fault(kind))?;
        Ok(numbers.iter().map(|v| *v != 0.0).collect())
    };
    match read() {
        Ok(set) => {
            let tags = names.iter().zip(set).filter(|(_, set)| *set);
            tags.for_each(|(name, _)| annotations.tag(name));
        }
        Err(e) => annotations.warn(e),
    }
}

/// The tag `tag` when `name` is in the list `file`.
pub(super) fn tag_if_listed(file: &File, name: &str, tag: &str, annotations: &mut Annotations) {
    match TruthFile::read(file).and_then(|file| Ok(file.text()?.into_owned())) {
        Ok(text) if text::words(&text).any(|word| word == name) => annotations.tag(tag),
        Ok(_) => {}
        Err(e) => annotations.warn(e),
    }
}

/// Truth of several objects in one file: a row for an object in a frame.
pub(super) struct Objects {
    /// Column of the object's name; that of the frame's number is 0.
    pub object: usize,
    /// Columns of the region.
    pub region: std::ops::Range<usize>,
    /// Columns of a row, at least.
    pub all: usize,
    /// What the region is.
    pub kind: RowKind,
    /// Whether a row counts, of which the words are given.
    pub counts: fn(&[&str]) -> bool,
}

impl Objects {
    /// A sequence for each object in `truth`, of the frames from its first row to its last. Without objects, one sequence,
    /// which [`read`](Self::read) finds the fault of.
    pub fn find(&self, place: &Place, frames: &[File], truth: &File) -> Vec<Found> {
        let spans = TruthFile::read(truth).and_then(|file| Ok(self.spans(&file.text()?)));
        let mut spans: Vec<(String, (u64, u64))> = spans.unwrap_or_default().into_iter().collect();
        spans.sort_by(|a, b| natural(&a.0, &b.0));
        let numbers = numbers(frames);
        let found = spans.into_iter().map(|(object, (first, last))| {
            let within = frames
                .iter()
                .zip(&numbers)
                .filter(|(_, n)| (first..=last).contains(n));
            Found {
                name: format!("{}-{object}", place.name()),
                frames: within.map(|(frame, _)| frame.clone()).collect(),
                truth: vec![truth.clone()],
                object: Some(object),
                ..Found::default()
            }
        });
        let found: Vec<Found> = found.collect();
        match found.is_empty() {
            true => vec![place.sequence(frames.to_vec(), vec![truth.clone()])],
            false => found,
        }
    }

    /// The first and the last frame of each object.
    fn spans(&self, text: &str) -> BTreeMap<String, (u64, u64)> {
        let mut spans: BTreeMap<String, (u64, u64)> = BTreeMap::new();
        for (_, line) in lines(text) {
            let words: Vec<&str> = text::words(line).collect();
            let number = words[0].parse::<f64>().ok().filter(|n| *n >= 0.0);
            let (Some(number), Some(object)) = (number, words.get(self.object)) else {
                continue;
            };
            if (self.counts)(&words) {
                let number = number as u64;
                let span = spans.entry((*object).to_owned()).or_insert((number, number));
                *span = (span.0.min(number), span.1.max(number));
            }
        }
        spans
    }

    /// The rows of `sequence`'s object. Frames without a row are not annotated.
    ///
    /// # Errors
    /// No text, or no row of an object.
    pub fn read(
        &self,
        sequence: &Found,
        file: &TruthFile,
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let kind = rows::as_asked(&self.kind, annotations);
        let text = file.text()?;
        let frames: HashMap<u64, usize> = numbers(&sequence.frames).into_iter().zip(0..).collect();
        let Some(object) = &sequence.object else {
            let (line, found) = match lines(&text).next() {
                Some((line, first)) => (line, text::words(first).count()),
                None => return Err(file.fault(DatasetErrorKind::NoRows)),
            };
            let expected = self.all;
            return Err(file
                .at_line(line)
                .fault(DatasetErrorKind::WrongCount { found, expected }));
        };
        for (line, row) in lines(&text) {
            if text::words(row).nth(self.object) != Some(object) {
                continue;
            }
            let words: Vec<&str> = text::words(row).collect();
            if !(self.counts)(&words) {
                continue;
            }
            let location = file.at_line(line);
            let frame = words[0].to_owned();
            let number = frame.parse::<f64>().ok().map(|n| n as u64);
            let Some(&i) = number.and_then(|n| frames.get(&n)) else {
                annotations.fault(location.fault(DatasetErrorKind::UnknownFrame { frame }));
                continue;
            };
            if annotations.is_set(i) {
                annotations.fault(location.fault(DatasetErrorKind::DuplicateRow { frame }));
                continue;
            }
            let said = columns(&words, self.region.clone(), self.all).and_then(|w| rows::region(w, &kind));
            annotations.set(i, location, said);
        }
        Ok(())
    }
}
