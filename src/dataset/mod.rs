//! Datasets: finding sequences on disk or inside the program, their frames and ground truth, and what is wrong with
//! them.
//!
//! A new format is one file in `format/` and one line in [`Formats::builtin`]; programs add their own. Depends on `geom`
//! and `image` of the tracking library.

mod absence;
mod annotation;
mod borrowed;
mod check;
pub mod convert;
mod decode;
mod dense;
mod error;
mod find;
mod format;
mod mask;
mod matching;
mod movie;
mod names;
mod nearest;
mod open;
mod order;
mod reading;
pub mod recorded;
pub mod rows;
mod sequence;
mod storage;
mod suspect;
mod tags;
mod text;

#[cfg(test)]
mod tests;

pub use annotation::{Annotation, Annotations, Location, Region};
pub use check::{Checked, Fault, Severity, check};
pub use decode::{Depth16, ImageError, MAX_PIXELS, Remark, Standing, decode, decode_file, dimensions};
pub use dense::DENSE_FILE;
pub use error::{DatasetError, DatasetErrorKind, Searched};
pub use format::{Description, Format, Formats, Found, Place, TruthFile};
pub use order::natural;
pub use reading::{BoxForm, Origin, Reading, TruthRows};
pub use sequence::Sequence;
pub use storage::{File, Folder};

use include_dir::{Dir, include_dir};
use movie::Movie;
use open::Draft;
use sha2::{Digest, Sha256};
use std::path::Path;
use std::sync::Arc;
use storage::{Alone, Disk, Embedded};

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
    /// Sequences that [`OnBadData::Skip`] left out, each with its reasons; empty under [`OnBadData::Fail`].
    pub left_out: Vec<LeftOut>,
    /// What is to know about the folder as a whole. About a sequence see [`Sequence::notes`].
    pub notes: Vec<Fault>,
}

/// A sequence that is not part of the dataset because its data is faulty.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// Name of the dataset that it belongs to.
    pub dataset: String,
    /// Its name.
    pub sequence: String,
    /// Why: at least one error.
    pub reasons: Vec<Fault>,
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
    /// A faulty row leaves its frame without annotation, which [`Sequence::notes`] say. Left out is a sequence that cannot
    /// start, whose rows cannot be matched with its frames, or with a selected frame that cannot be read or has another
    /// size; all selected frames are decoded to find out. An error only when nothing is left.
    Skip,
}

/// What to look for, which frames to load, and what to do about faulty ones.
#[derive(Clone, Debug)]
pub struct LoadOptions {
    /// Formats that are recognised.
    pub formats: Formats,
    /// What to do about faulty data.
    pub on_bad_data: OnBadData,
    /// How 16 bits per channel become 8.
    pub depth16: Depth16,
    /// How ground truth is read, in place of what its format usually has.
    pub reading: Reading,
    /// Refuse a start that lies partly outside the image.
    pub strict: bool,
    /// First frame, from 0; where it and those after it have no ground truth, the first that has.
    pub start: usize,
    /// Keep every `frame_gap`-th frame from `start` on, with its truth.
    pub frame_gap: usize,
    /// Keep at most so many of these.
    pub max_frames: Option<usize>,
}

impl Default for LoadOptions {
    /// The formats of this library; all frames; faults are errors.
    fn default() -> Self {
        LoadOptions {
            formats: Formats::builtin(),
            on_bad_data: OnBadData::Fail,
            depth16: Depth16::default(),
            reading: Reading::default(),
            strict: false,
            start: 0,
            frame_gap: 1,
            max_frames: None,
        }
    }
}

/// Loads the dataset at `path`: a sequence, a folder of sequences, a file with several pictures (pages of TIFF, animated
/// GIF or PNG) that has ground truth in its folder, or [`BUILTIN`]. Formats are detected.
/// Reads ground truth and the header of each first frame; other frames are only read on demand.
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
    let found = find::find(&root, &options.formats)?;
    let name = match found.sequences.first() {
        Some(first) if first.folder.path() == root.path() => first.dataset.clone(),
        _ => root.name().into(),
    };
    let mut dataset = Dataset {
        name,
        sequences: Vec::new(),
        unwanted: 0,
        left_out: Vec::new(),
        notes: found.too_deep().iter().map(Fault::warning).collect(),
    };
    for link in found.dead {
        let label = Label {
            dataset: &link.dataset,
            name: &link.name,
            tags: &[],
        };
        if !wanted(&label) {
            continue;
        }
        if options.on_bad_data == OnBadData::Fail {
            return Err(link.fault);
        }
        let fault = Fault::from(&link.fault);
        if link.in_sequence {
            dataset.notes.push(fault);
        } else {
            dataset.left_out.push(LeftOut {
                dataset: link.dataset,
                sequence: link.name,
                reasons: vec![fault],
            });
        }
    }
    let mut last = None;
    for unread in found.sequences {
        let draft = Draft::new(unread, options.reading, &options.formats);
        if !wanted(&draft.label()) {
            dataset.unwanted += 1;
            continue;
        }
        let (of, sequence) = (draft.unread.dataset.clone(), draft.unread.parts.name.clone());
        match (open(draft, options), options.on_bad_data) {
            (Ok(sequence), _) => dataset.sequences.push(sequence),
            (Err(mut faults), OnBadData::Fail) => return Err(faults.swap_remove(0)),
            (Err(mut faults), OnBadData::Skip) => {
                dataset.left_out.push(LeftOut {
                    dataset: of,
                    sequence,
                    reasons: Fault::all(&faults, Severity::Error),
                });
                last = faults.pop();
            }
        }
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

/// A sequence of which there is nothing but the file of ground truth `path`: frames have the names in its rows, or count from
/// 1, and cannot be read. It is called like the file, without `_groundtruth`, or like the folder around `groundtruth.txt`.
///
/// # Errors
/// The file cannot be read, or a row of it is faulty.
pub fn truth_alone(path: &Path, reading: Reading) -> Result<Sequence, DatasetError> {
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let folder = Folder::new(Arc::new(Disk), folder.to_path_buf());
    let file = path
        .file_name()
        .and_then(|name| folder.file(&name.to_string_lossy()));
    let file = file.ok_or_else(|| DatasetError::new(path, DatasetErrorKind::Missing))?;
    let truth = TruthFile::read(&file)?;
    let names = rows::frame_names(&truth.text()?);
    let frames: Vec<File> = names.into_iter().map(|name| folder.unread(name)).collect();
    let mut annotations = Annotations::new(frames.len());
    annotations.ask(reading);
    rows::read(&truth, rows::ANY, frames.iter().enumerate(), &mut annotations)?;
    if let Some(fault) = annotations.take_faults().into_iter().next() {
        return Err(fault);
    }
    let stem = file.name().rsplit_once('.').map_or(file.name(), |(stem, _)| stem);
    let name = stem
        .strip_suffix("groundtruth")
        .map_or(stem, |name| name.trim_end_matches(['_', '-', '.']));
    let around = folder.parent().unwrap_or_else(|| folder.clone());
    let (dataset, name) = match name {
        "" => (around.name(), folder.name()),
        name => (folder.name(), name),
    };
    let truth_digest = Sha256::digest(truth.bytes()).into();
    Ok(Sequence::of_truth(
        dataset,
        name,
        &folder,
        frames,
        annotations,
        truth_digest,
    ))
}

/// The selected frames of a sequence; else why it cannot be used: one fault or more.
fn open(mut draft: Draft, options: &LoadOptions) -> Result<Sequence, Vec<DatasetError>> {
    if !draft.fatal.is_empty() {
        return Err(draft.fatal);
    }
    let mut faults = std::mem::take(&mut draft.annotations.faults);
    // Known from the folder alone; all else about frames shows when they are read.
    faults.extend(draft.unread.parts.frames.iter().filter_map(File::fault));
    let fail = |faults: Vec<DatasetError>, fault| Err(faults.into_iter().chain([fault]).collect());
    let size = match draft.first_size() {
        Ok(size) => size,
        Err(fault) => return fail(faults, fault),
    };
    if let Some(fault) = draft.selection_fault(options) {
        return fail(faults, fault);
    }
    let start = draft.start(options.start, &faults);
    if let Some(fault) = draft.start_fault(start, size) {
        return fail(faults, fault);
    }
    draft.late_start(options.start, start);
    let skip = options.on_bad_data == OnBadData::Skip;
    if !(skip || faults.is_empty()) {
        return Err(faults);
    }
    let outside = draft.start_outside(start, size);
    match outside {
        Some(fault) if options.strict => return fail(faults, fault),
        outside => draft.warnings.extend(outside),
    }
    draft.warnings.extend(draft.suspects(size));
    let selected = draft
        .into_sequence(size, options.depth16, &faults)
        .from_frame(start)
        .with_gap(options.frame_gap)
        .truncated(options.max_frames.unwrap_or(usize::MAX));
    match skip.then(|| selected.unreadable()).flatten() {
        Some(fault) => Err(vec![fault]),
        None => Ok(selected),
    }
}

/// The folder that `path` stands for: itself, or the one around a file with several pictures.
fn resolve(path: &Path) -> Result<Folder, DatasetError> {
    if path == Path::new(BUILTIN) {
        if EMBEDDED.dirs().next().is_none() {
            return Err(DatasetError::new(path, DatasetErrorKind::NothingEmbedded));
        }
        let storage = Embedded {
            name: BUILTIN,
            top: &EMBEDDED,
        };
        return Ok(Folder::new(Arc::new(storage), BUILTIN.into()));
    }
    match std::fs::metadata(path) {
        Ok(meta) if meta.is_dir() => Ok(Folder::new(Arc::new(Disk), path.to_path_buf())),
        Ok(_) => film(path)?.ok_or_else(|| DatasetError::new(path, DatasetErrorKind::NotAFolder)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            Err(DatasetError::new(path, DatasetErrorKind::Missing))
        }
        Err(e) => Err(DatasetError::new(path, e.into())),
    }
}

/// The folder around the file `path` with no other picture in it; `None` when the file does not hold several.
fn film(path: &Path) -> Result<Option<Folder>, DatasetError> {
    let (Some(around), Some(name)) = (path.parent(), path.file_name()) else {
        return Ok(None);
    };
    let around = match around == Path::new("") {
        true => Path::new("."),
        false => around,
    };
    let storage = Alone { image: name.into() };
    let folder = Folder::new(Arc::new(storage), around.to_path_buf());
    match folder.file(&name.to_string_lossy()) {
        Some(file) => Ok(Movie::of(&file)?.map(|_| folder)),
        None => Ok(None),
    }
}
