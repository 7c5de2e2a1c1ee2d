//! Datasets: finding sequences on disk or inside the program, their frames and ground truth, and what is wrong with
//! them.
//!
//! A new layout is one file in `layout/` and one line in its table; a new form of ground truth is one file in `truth/`
//! and one line in its table. Depends on `geom` and `image`.

mod check;
mod decode;
mod error;
mod grid;
mod layout;
mod open;
mod order;
mod sequence;
mod source;
mod truth;

#[cfg(test)]
mod tests;

pub use check::{Checked, Fault, Severity, check};
pub use decode::{ImageError, MAX_PIXELS, decode, decode_file, dimensions};
pub use error::{DatasetError, DatasetErrorKind};
pub use grid::GRID_FILE;
pub use order::natural;
pub use sequence::Sequence;

use include_dir::{Dir, include_dir};
use open::Draft;
use source::Folder;
use std::path::Path;

/// Name that stands for the embedded dataset wherever a path is expected. A folder of that name is `./builtin`.
pub const BUILTIN: &str = "builtin";

static EMBEDDED: Dir<'static> = include_dir!("$CARGO_MANIFEST_DIR/datasets/builtin");

/// Sequences that were loaded together.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Name of the folder, or `builtin`.
    pub name: String,
    /// In natural order of their places.
    pub sequences: Vec<Sequence>,
    /// Sequences that [`load_where`] was not to open.
    pub unwanted: usize,
    /// What [`OnBadData::Skip`] left out; empty under [`OnBadData::Fail`].
    pub skipped: Vec<Fault>,
}

/// What is known of a sequence before it is opened.
#[derive(Clone, Copy, Debug)]
pub struct Label<'a> {
    /// Name of the dataset that the sequence belongs to.
    pub dataset: &'a str,
    /// Name, unique within the dataset.
    pub name: &'a str,
    /// Words that say what is hard about it.
    pub tags: &'a [String],
}

/// What to do about faulty data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnBadData {
    /// The first fault is an error.
    #[default]
    Fail,
    /// A faulty row leaves its frame without annotation; a sequence that cannot start is left out. An error only when
    /// nothing is left.
    Skip,
}

/// Which frames to load, and what to do about faulty ones.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoadOptions {
    /// What to do about faulty data.
    pub on_bad_data: OnBadData,
    /// First frame, from 0.
    pub start: usize,
    /// Keep every `frame_gap`-th frame from `start` on, with its truth.
    pub frame_gap: usize,
    /// Keep at most so many of these.
    pub max_frames: Option<usize>,
}

impl Default for LoadOptions {
    /// All frames; faults are errors.
    fn default() -> Self {
        LoadOptions {
            on_bad_data: OnBadData::Fail,
            start: 0,
            frame_gap: 1,
            max_frames: None,
        }
    }
}

/// Loads the dataset at `path`: a sequence, a folder of sequences, or [`BUILTIN`]. Layout and form of the ground truth
/// are detected. Reads ground truth and the header of each first frame; other frames are only read on demand.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Dataset, DatasetError> {
    load_where(path, options, &|_| true)
}

/// As [`load`], but only sequences that are `wanted`: what is wrong with the others does not matter.
pub fn load_where(
    path: &Path,
    options: &LoadOptions,
    wanted: &dyn Fn(&Label<'_>) -> bool,
) -> Result<Dataset, DatasetError> {
    let root = resolve(path)?;
    let found = layout::find(&root)?;
    let name = match &found[..] {
        [one] if one.folder.path() == root.path() => one.dataset.clone(),
        _ => root.name(),
    };
    let mut dataset = Dataset {
        name,
        sequences: Vec::new(),
        unwanted: 0,
        skipped: Vec::new(),
    };
    let mut last = None;
    for found in found {
        let draft = Draft::new(found);
        if !wanted(&draft.label()) {
            dataset.unwanted += 1;
            continue;
        }
        let mut faults = Vec::new();
        let sequence = open(draft, options, &mut faults);
        if options.on_bad_data == OnBadData::Fail && !faults.is_empty() {
            return Err(faults.swap_remove(0));
        }
        dataset.skipped.extend(faults.iter().map(Fault::from));
        last = faults.pop().or(last);
        dataset.sequences.extend(sequence);
    }
    match last {
        Some(fault) if dataset.sequences.is_empty() => Err(fault),
        _ => Ok(dataset),
    }
}

/// The sequences embedded in the program.
pub fn builtin() -> Result<Dataset, DatasetError> {
    load(Path::new(BUILTIN), &LoadOptions::default())
}

/// The selected frames of a sequence, if tracking can start on them; everything wrong goes to `faults`.
fn open(mut draft: Draft, options: &LoadOptions, faults: &mut Vec<DatasetError>) -> Option<Sequence> {
    faults.append(&mut draft.fatal);
    if !faults.is_empty() {
        return None;
    }
    let size = match draft.first_size() {
        Ok(size) => size,
        Err(e) => {
            faults.push(e);
            return None;
        }
    };
    faults.append(&mut draft.truth.faults);
    let frames = draft.found.frames.len();
    if options.start >= frames || options.max_frames == Some(0) {
        let kind = DatasetErrorKind::NothingSelected {
            start: options.start,
            frames,
        };
        faults.push(DatasetError::new(draft.found.folder.path(), kind));
        return None;
    }
    if let Some(fault) = draft.start_fault(options.start, size) {
        faults.push(fault);
        return None;
    }
    let selected = draft
        .into_sequence(size)
        .from_frame(options.start)
        .with_gap(options.frame_gap);
    Some(selected.truncated(options.max_frames.unwrap_or(usize::MAX)))
}

/// The folder that `path` stands for.
fn resolve(path: &Path) -> Result<Folder, DatasetError> {
    if path == Path::new(BUILTIN) {
        if EMBEDDED.dirs().next().is_none() {
            return Err(DatasetError::new(path, DatasetErrorKind::NothingEmbedded));
        }
        return Ok(Folder::Embedded {
            dir: &EMBEDDED,
            path: BUILTIN.into(),
        });
    }
    match std::fs::metadata(path) {
        Ok(meta) if meta.is_dir() => Ok(Folder::Disk(path.to_path_buf())),
        Ok(_) => Err(DatasetError::new(path, DatasetErrorKind::NotAFolder)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            Err(DatasetError::new(path, DatasetErrorKind::Missing))
        }
        Err(e) => Err(DatasetError::new(path, e.into())),
    }
}
