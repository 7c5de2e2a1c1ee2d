//! From a found sequence to an opened one, collecting every fault on the way.

use super::decode::dimensions;
use super::grid::{self, GRID_FILE, Grid};
use super::layout::Found;
use super::sequence::{Sequence, Whole};
use super::truth::{self, Truth};
use super::{DatasetError, DatasetErrorKind, Label};
use sha2::{Digest, Sha256};

/// A sequence whose text files are read; no image has been looked at.
pub(super) struct Draft {
    pub found: Found,
    pub truth: Truth,
    truth_digest: [u8; 32],
    grid: Grid,
    tags: Vec<String>,
    /// Faults that no use of the sequence can get round.
    pub fatal: Vec<DatasetError>,
    /// Faults that do not keep it from being used as it stands.
    pub warnings: Vec<DatasetError>,
}

impl Draft {
    /// Reads ground truth and tags.
    pub fn new(found: Found) -> Draft {
        let (mut fatal, mut warnings) = (Vec::new(), Vec::new());
        let mut truth_digest = [0; 32];
        let mut truth = Truth::default();
        match &found.truth {
            None => fatal.push(DatasetError::new(
                found.folder.path(),
                DatasetErrorKind::NoGroundTruth,
            )),
            Some(file) if found.frames.is_empty() => {
                fatal.push(DatasetError::new(file.path(), DatasetErrorKind::NoFrames));
            }
            Some(file) => match file.read() {
                Err(e) => fatal.push(e),
                Ok(bytes) => {
                    truth_digest = Sha256::digest(&bytes).into();
                    let names: Vec<&str> = found.frames.iter().map(|(name, _)| name.as_str()).collect();
                    truth = truth::parse(&bytes, file.path(), &names, found.form);
                }
            },
        }
        let grid = read_grid(&found, &mut truth.faults).unwrap_or_else(|e| {
            fatal.push(e);
            Grid::new()
        });
        let tags = read_tags(&found).unwrap_or_else(|e| {
            warnings.push(e);
            Vec::new()
        });
        Draft {
            found,
            truth,
            truth_digest,
            grid,
            tags,
            fatal,
            warnings,
        }
    }

    /// What it is called.
    pub fn label(&self) -> Label<'_> {
        Label {
            dataset: &self.found.dataset,
            name: &self.found.name,
            tags: &self.tags,
        }
    }

    /// Why tracking cannot start at frame `start` of a sequence of `size`: no annotation there, or one outside the image.
    pub fn start_fault(&self, start: usize, size: (usize, usize)) -> Option<DatasetError> {
        let path = self.found.truth.as_ref()?.path();
        let (width, height) = size;
        let inside = |v: f64, n: usize| (-0.5..=n as f64 - 0.5).contains(&v);
        let kind = match self.truth.corners.get(start)? {
            None => DatasetErrorKind::NoInitialTruth {
                frame: self.found.frames[start].0.clone(),
            },
            Some(c) if c.0.iter().all(|&[x, y]| inside(x, width) && inside(y, height)) => return None,
            Some(_) => DatasetErrorKind::InitialOutside { width, height },
        };
        Some(DatasetError {
            path: path.to_path_buf(),
            line: self.truth.lines[start],
            kind,
        })
    }

    /// Size of the first frame, from its header.
    pub fn first_size(&self) -> Result<(usize, usize), DatasetError> {
        let Some((_, file)) = self.found.frames.first() else {
            return Err(DatasetError::new(
                self.found.folder.path(),
                DatasetErrorKind::NoFrames,
            ));
        };
        dimensions(&file.read()?).map_err(|e| DatasetError::new(file.path(), e.into()))
    }

    /// The sequence, with what is valid of its ground truth.
    pub fn into_sequence(self, (width, height): (usize, usize)) -> Sequence {
        Sequence::new(Whole {
            dataset: self.found.dataset,
            name: self.found.name,
            folder: self.found.folder,
            frames: self.found.frames,
            truth: self.truth.corners,
            truth_digest: self.truth_digest,
            grid: self.grid,
            tags: self.tags,
            width,
            height,
            sizes: Default::default(),
            decoded: Default::default(),
        })
    }
}

/// Dense ground truth, when the folder has any; what is wrong with its rows goes to `faults`.
fn read_grid(found: &Found, faults: &mut Vec<DatasetError>) -> Result<Grid, DatasetError> {
    let listing = found.folder.list()?;
    let Some(file) = listing.file(GRID_FILE) else {
        return Ok(Grid::new());
    };
    let names: Vec<&str> = found.frames.iter().map(|(name, _)| name.as_str()).collect();
    Ok(grid::parse(&file.read()?, file.path(), &names, faults))
}

/// Words of `tags.txt` and of `tags` in `meta.json`, in order, each once.
fn read_tags(found: &Found) -> Result<Vec<String>, DatasetError> {
    let listing = found.folder.list()?;
    let mut tags: Vec<String> = Vec::new();
    if let Some(file) = listing.file("tags.txt") {
        let bytes = file.read()?;
        let text = String::from_utf8_lossy(&bytes);
        let words = text
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|w| !w.is_empty());
        tags.extend(words.map(String::from));
    }
    if let Some(file) = listing.file("meta.json") {
        #[derive(serde::Deserialize)]
        struct Meta {
            #[serde(default)]
            tags: Vec<String>,
        }
        let meta: Meta = serde_json::from_slice(&file.read()?).map_err(|e| {
            DatasetError::new(
                file.path(),
                DatasetErrorKind::BadMeta {
                    detail: e.to_string(),
                },
            )
        })?;
        tags.extend(meta.tags);
    }
    let mut seen = std::collections::BTreeSet::new();
    tags.retain(|tag| seen.insert(tag.clone()));
    Ok(tags)
}
