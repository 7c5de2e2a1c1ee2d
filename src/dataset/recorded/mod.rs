//! Results that other programs have recorded: where they lie, and what they say about each frame of a sequence.
//!
//! [`layout`] finds the files by their names, [`read`] reads them, with the readers of ground truth. Depends on the
//! reading of ground truth and on sequences.

mod layout;
mod log;
mod read;
mod trajectory;

use super::storage::{Disk, File, Folder, Listing};
use super::{DatasetError, DatasetErrorKind, Reading, Sequence};
use layout::{Claim, Names};
use mtf::geom::Corners;
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use layout::layouts;
pub use log::{LogFault, LoggedFrame, logged_frames};

/// Deepest level of folders below the given one that may hold results: `results/tracker/experiment/sequence` and two more.
const DEPTH: usize = 6;

/// What a tracker said of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// The object is here, px, pixel centres at integers.
    Corners(Corners),
    /// It cannot be seen; where it is supposed to be, if that is said.
    Absent(Option<Corners>),
    /// Nothing: there is no row, or one that says so.
    Missing,
}

/// What a tracker said of a sequence, frame by frame.
#[derive(Clone, Debug)]
pub struct Track {
    /// Where it is recorded; `None` where nothing is.
    pub path: Option<PathBuf>,
    /// Of each frame of the sequence.
    pub answers: Vec<Answer>,
    /// How sure it was of each, by its own measure; empty where that is not recorded.
    pub confidence: Vec<f64>,
    /// How long each update took, s; empty where that is not recorded.
    pub seconds: Vec<f64>,
    /// Its answers are upright boxes.
    pub boxes: bool,
    /// How it was read, and what is to know about it.
    pub notes: Vec<String>,
}

impl Track {
    /// Of a sequence of which nothing is recorded.
    fn nothing(frames: usize) -> Track {
        Track {
            path: None,
            answers: vec![Answer::Missing; frames],
            confidence: Vec::new(),
            seconds: Vec::new(),
            boxes: false,
            notes: Vec::new(),
        }
    }

    /// Frames of which nothing is recorded.
    pub fn missing(&self) -> usize {
        let missing = |answer: &&Answer| **answer == Answer::Missing;
        self.answers.iter().filter(missing).count()
    }
}

/// The recorded results of a tracker.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// What its files call the tracker.
    pub tracker: String,
    /// For each of the sequences, in their order.
    pub tracks: Vec<Track>,
}

impl Recorded {
    /// Whether its answers are upright boxes, in all sequences of which there are any.
    pub fn boxes(&self) -> bool {
        self.tracks.iter().any(|track| track.boxes)
    }
}

/// Which way the homographies of a file go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the first frame to that of the row.
    FromFirst,
    /// From the frame of the row to the first.
    ToFirst,
}

/// How results are read, as far as it is asked for.
#[derive(Clone, Copy, Debug, Default)]
pub struct RecordedOptions {
    /// Where the first pixel is and what boxes are, in place of what the ground truth has.
    pub reading: Reading,
    /// Whether rows begin with the frame that the tracker was started on; `None`: found out by the number of rows.
    pub first_included: Option<bool>,
    /// Which way homographies go; files of homographies are refused without.
    pub homographies: Option<Direction>,
}

/// What was found.
#[derive(Clone, Debug, Default)]
pub struct Results {
    /// By the trackers' names.
    pub trackers: Vec<Recorded>,
    /// How the files lay, each layout with the number of its files.
    pub layouts: BTreeMap<&'static str, usize>,
    /// Files that look like results and belong to none of the sequences.
    pub strangers: Vec<PathBuf>,
}

/// The results in `paths` (files, or folders with all below them) of `sequences`.
///
/// # Errors
/// A path that is not there; files of which none belongs to a sequence, or two to the same tracker and sequence; a file that
/// cannot be read or not be matched with the frames.
pub fn load(
    paths: &[PathBuf],
    sequences: &[Sequence],
    options: &RecordedOptions,
) -> Result<Results, DatasetError> {
    let names = Names::new(sequences);
    let mut results = Results::default();
    let mut claimed: BTreeMap<String, BTreeMap<usize, File>> = BTreeMap::new();
    for path in paths {
        let files = files(path)?;
        let before = results.layouts.values().sum::<usize>();
        for file in &files {
            let Some((layout, claim)) = layout::claim(file.path(), &names) else {
                // Tables of a run are no results of a sequence.
                if file.beside("run.json").is_none() {
                    results.strangers.push(file.path().to_path_buf());
                }
                continue;
            };
            let Claim { tracker, sequence } = claim;
            *results.layouts.entry(layout).or_default() += 1;
            if let Some(other) = claimed
                .entry(tracker.clone())
                .or_default()
                .insert(sequence, file.clone())
            {
                let kind = DatasetErrorKind::TwoResults {
                    other: other.path().to_path_buf(),
                    tracker,
                    sequence: sequences[sequence].name().to_owned(),
                };
                return Err(DatasetError::new(file.path(), kind));
            }
        }
        if before == results.layouts.values().sum::<usize>() {
            let kind = DatasetErrorKind::NoResults {
                files: files.len(),
                example: sequences.first().map_or(String::new(), |s| s.name().to_owned()),
                expected: layouts().collect::<Vec<_>>().join(", "),
            };
            return Err(DatasetError::new(path, kind));
        }
    }
    for (tracker, files) in claimed {
        let track = |(k, sequence): (usize, &Sequence)| match files.get(&k) {
            Some(file) => read::track(file, sequence, options),
            None => Ok(Track::nothing(sequence.len())),
        };
        let tracks: Vec<Track> = sequences
            .iter()
            .enumerate()
            .map(track)
            .collect::<Result<_, _>>()?;
        let shape = |boxes: bool| tracks.iter().find(|t| t.path.is_some() && t.boxes == boxes);
        if let (Some(boxes), Some(corners)) = (shape(true), shape(false)) {
            let path = |track: &Track| track.path.clone().unwrap_or_default();
            let kind = DatasetErrorKind::BoxesAndCorners {
                other: path(corners),
                tracker,
            };
            return Err(DatasetError::new(path(boxes), kind));
        }
        results.trackers.push(Recorded { tracker, tracks });
    }
    Ok(results)
}

/// The files at `path` that may be results: itself, or those below it.
fn files(path: &Path) -> Result<Vec<File>, DatasetError> {
    let around = |path: &Path| Folder::new(Arc::new(Disk), path.to_path_buf());
    match std::fs::metadata(path) {
        Ok(meta) if meta.is_dir() => {
            let mut files = Vec::new();
            let mut seen = HashSet::new();
            walk(&around(path), 0, &mut seen, &mut files)?;
            Ok(files)
        }
        Ok(_) => {
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let file = around(folder.unwrap_or(Path::new("."))).file(&name);
            file.map(|file| vec![file])
                .ok_or_else(|| DatasetError::new(path, DatasetErrorKind::Missing))
        }
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            Err(DatasetError::new(path, DatasetErrorKind::Missing))
        }
        Err(e) => Err(DatasetError::new(path, e.into())),
    }
}

fn walk(
    folder: &Folder,
    depth: usize,
    seen: &mut HashSet<PathBuf>,
    files: &mut Vec<File>,
) -> Result<(), DatasetError> {
    if depth > DEPTH || !seen.insert(folder.identity()) {
        return Ok(());
    }
    let Listing {
        files: here, folders, ..
    } = folder.list()?;
    files.extend(
        here.into_iter()
            .filter(|file| layout::may_be_results(file.name())),
    );
    folders
        .iter()
        .try_for_each(|folder| walk(folder, depth + 1, seen, files))
}
