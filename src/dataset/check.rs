//! Finds every fault of a dataset.

use super::decode::{Depth16, Remark, Standing, remarks};
use super::find::find;
use super::movie::Movie;
use super::open::Draft;
use super::sequence::{Remarks, check_size, decode_frame, read_frame};
use super::storage::File;
use super::suspect::flat;
use super::{DatasetError, LoadOptions, resolve};
use mtf::image::Pixels;
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// How bad a fault is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The data can be used as it stands.
    Warning,
    /// Loading fails or leaves something out.
    Error,
}

/// A fault of a dataset. Displays as `path:line: message`.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// File or folder.
    pub path: PathBuf,
    /// Line of the file, from 1, when the fault has one.
    pub line: Option<usize>,
    /// What is wrong; what to do.
    pub message: String,
    /// How bad it is.
    pub severity: Severity,
}

impl Fault {
    fn new(error: &DatasetError, severity: Severity) -> Self {
        Fault {
            message: error.kind.to_string(),
            path: error.path.clone(),
            line: error.line,
            severity,
        }
    }

    /// What is to know about data that can be used as it stands.
    pub(super) fn warning(error: &DatasetError) -> Self {
        Fault::new(error, Severity::Warning)
    }

    /// `errors` in their order. Of more than [`ALIKE`] of one kind in one file, the first, which says how many there are.
    pub(super) fn all(errors: &[DatasetError], severity: Severity) -> Vec<Fault> {
        let key = |e: &DatasetError| (e.path.clone(), std::mem::discriminant(&e.kind));
        let mut alike: HashMap<_, (usize, Option<usize>)> = HashMap::new();
        for error in errors {
            let (count, last) = alike.entry(key(error)).or_default();
            *count += 1;
            *last = error.line;
        }
        let mut faults = Vec::new();
        for error in errors {
            // Whose count is taken has been told.
            let entry = alike.entry(key(error)).or_default();
            match *entry {
                (0, _) => {}
                (count, last) if count > ALIKE => {
                    let mut fault = Fault::new(error, severity);
                    let until = last.map_or(String::new(), |line| format!(", the last in line {line}"));
                    fault.message += &format!(" ({} more of this kind{until})", count - 1);
                    faults.push(fault);
                    *entry = (0, None);
                }
                _ => faults.push(Fault::new(error, severity)),
            }
        }
        faults
    }
}

/// So many faults of one kind in one file are told one by one.
const ALIKE: usize = 3;

impl From<&DatasetError> for Fault {
    fn from(error: &DatasetError) -> Self {
        Fault::new(error, Severity::Error)
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:", self.path.display())?;
        if let Some(line) = self.line {
            write!(f, "{line}:")?;
        }
        let warning = if self.severity == Severity::Warning {
            "warning: "
        } else {
            ""
        };
        write!(f, " {warning}{}", self.message)
    }
}

/// What [`check`] looked at and found.
#[derive(Clone, Debug, Default)]
pub struct Checked {
    /// Sequences found.
    pub sequences: usize,
    /// Frames decoded.
    pub frames: usize,
    /// Every fault: links that lead nowhere, folders too deep, then in order of sequences; within one: structure, ground truth, frames.
    pub faults: Vec<Fault>,
}

/// Every fault of the dataset at `path` (a folder, or `builtin`), read as `options` say; all frames count. Decodes every
/// frame, on all threads.
pub fn check(path: &Path, options: &LoadOptions) -> Checked {
    let found = match resolve(path).and_then(|root| find(&root, &options.formats)) {
        Ok(found) => found,
        Err(e) => {
            return Checked {
                faults: vec![Fault::from(&e)],
                ..Checked::default()
            };
        }
    };
    let dead = found.dead.iter().map(|link| Fault::from(&link.fault));
    let mut checked = Checked {
        sequences: found.sequences.len(),
        faults: dead.chain(found.too_deep().iter().map(Fault::warning)).collect(),
        ..Checked::default()
    };
    for unread in found.sequences {
        let draft = Draft::new(unread, options.reading, &options.formats);
        checked.frames += draft.unread.parts.frames.len();
        checked.faults.extend(check_sequence(draft, options));
    }
    checked
}

/// A frame's size, and what is out of the ordinary about it.
type Looked = (Result<(usize, usize), DatasetError>, Vec<Remark>);

/// Decodes each frame.
fn look_at_all(draft: &Draft, depth16: Depth16) -> Vec<Looked> {
    let frames = &draft.unread.parts.frames;
    match &draft.movie {
        None => frames.par_iter().map(|file| look(file, depth16)).collect(),
        // One after the other.
        Some(movie) => (0..frames.len()).map(|i| look_into(movie, i, depth16)).collect(),
    }
}

fn look(file: &File, depth16: Depth16) -> Looked {
    looked(|| {
        let bytes = file.read()?;
        Ok((decode_frame(file, &bytes, false, depth16)?, remarks(&bytes)))
    })
}

fn look_into(movie: &Movie, picture: usize, depth16: Depth16) -> Looked {
    looked(|| {
        Ok((
            movie.read(picture, false, depth16, true)?,
            movie.remarks().to_vec(),
        ))
    })
}

fn looked(read: impl FnOnce() -> Result<(Pixels, Vec<Remark>), DatasetError>) -> Looked {
    let look = || {
        let (pixels, mut found) = read()?;
        if found.contains(&Remark::SixteenBits) {
            found.extend(Remark::sliver(&pixels));
        }
        Ok(((pixels.width(), pixels.height()), found))
    };
    match look() {
        Ok((size, found)) => (Ok(size), found),
        Err(e) => (Err(e), Vec::new()),
    }
}

fn check_sequence(mut draft: Draft, options: &LoadOptions) -> Vec<Fault> {
    let mut errors = std::mem::take(&mut draft.fatal);
    let annotations = &mut draft.annotations;
    let truth_faults = std::mem::take(&mut annotations.faults);
    let truth_is_usable = errors.is_empty() && annotations.frames.iter().any(|a| a.corners().is_some());

    let (sizes, remarked): (Vec<_>, Vec<_>) = look_at_all(&draft, options.depth16).into_iter().unzip();
    let frames = &draft.unread.parts.frames;
    let mut remarks = Remarks::default();
    for (file, remarked) in frames.iter().zip(remarked) {
        remarked.into_iter().for_each(|remark| remarks.add(remark, file));
    }
    let first = sizes.iter().find_map(|size| size.as_ref().ok()).copied();

    // The start is only looked at when what is said of it had no fault of its own.
    let start = draft.start(0, &truth_faults);
    let at = draft.annotations.frames.get(start);
    let start_reported = at.and_then(|a| a.location.as_ref()).is_some_and(|at| {
        let here = |f: &DatasetError| f.path == at.path && f.line == at.line;
        truth_faults.iter().any(here)
    });
    errors.extend(truth_faults);
    if let (Some(size), true, false) = (first, truth_is_usable, start_reported) {
        let fault = draft.start_fault(start, size);
        let outside = draft.start_outside(start, size).filter(|_| fault.is_none());
        match options.strict {
            true => errors.extend(fault.into_iter().chain(outside)),
            false => {
                errors.extend(fault);
                draft.warnings.extend(outside);
            }
        }
        draft.late_start(0, start);
    }
    if let (Some(size), true) = (first, truth_is_usable) {
        draft.warnings.extend(draft.suspects(size));
        draft.warnings.extend(flat_start(&draft, start, options.depth16));
    }
    let frames = &draft.unread.parts.frames;
    for (file, size) in frames.iter().zip(sizes) {
        match size {
            Err(e) => errors.push(e),
            Ok(size) => errors.extend(first.and_then(|first| check_size(file, size, first).err())),
        }
    }
    let doubtful = remarks
        .faults()
        .into_iter()
        .filter(|(remark, _)| remark.standing() != Standing::AsItSays);
    draft.warnings.extend(doubtful.map(|(_, fault)| fault));
    let mut faults = Fault::all(&errors, Severity::Error);
    faults.extend(Fault::all(&draft.warnings, Severity::Warning));
    faults
}

/// That frame `start` shows nothing to track at its corners.
fn flat_start(draft: &Draft, start: usize, depth16: Depth16) -> Option<DatasetError> {
    let annotation = draft.annotations.frames.get(start)?;
    let (corners, at) = (annotation.corners()?, annotation.location.as_ref()?);
    let image = match &draft.movie {
        Some(movie) => movie.read(start, false, depth16, false),
        None => read_frame(draft.unread.parts.frames.get(start)?, false, depth16),
    };
    let image = image.ok()?;
    Some(at.fault(flat(&image, &corners)?))
}
