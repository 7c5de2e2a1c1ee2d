//! From a found sequence to an opened one, collecting every fault on the way.

use super::annotation::Annotations;
use super::decode::dimensions;
use super::find::Unread;
use super::format::TruthFile;
use super::sequence::{Sequence, Whole};
use super::{DatasetError, DatasetErrorKind, Fault, Label, LoadOptions, dense, tags};
use sha2::{Digest, Sha256};

/// A sequence whose annotations are read; no image has been decoded.
pub(super) struct Draft {
    pub unread: Unread,
    pub annotations: Annotations,
    truth_digest: [u8; 32],
    /// Faults that no use of the sequence can get round.
    pub fatal: Vec<DatasetError>,
    /// Faults that do not keep it from being used as it stands.
    pub warnings: Vec<DatasetError>,
}

impl Draft {
    /// Reads ground truth and tags.
    pub fn new(unread: Unread) -> Draft {
        let (mut fatal, mut warnings) = (Vec::new(), Vec::new());
        let (parts, folder) = (&unread.parts, &unread.folder);
        let mut truth_digest = [0; 32];
        let mut annotations = Annotations::new(parts.frames.len());
        match (&unread.format, &parts.truth[..]) {
            (None, _) | (_, []) => {
                fatal.push(DatasetError::new(folder.path(), DatasetErrorKind::NoGroundTruth));
            }
            (_, [file, ..]) if parts.frames.is_empty() => {
                fatal.push(DatasetError::new(file.path(), DatasetErrorKind::NoFrames));
            }
            (Some(format), files) => match files.iter().map(TruthFile::read).collect::<Result<Vec<_>, _>>() {
                Err(e) => fatal.push(e),
                Ok(truth) => {
                    let mut hasher = Sha256::new();
                    truth.iter().for_each(|file| hasher.update(file.bytes()));
                    truth_digest = hasher.finalize().into();
                    let read = format.read(parts, &truth, &mut annotations);
                    annotations.faults.extend(read.err());
                }
            },
        }
        fatal.extend(dense::read(folder, &parts.frames, &mut annotations).err());
        warnings.extend(tags::read(folder, &mut annotations).err());
        Draft {
            unread,
            annotations,
            truth_digest,
            fatal,
            warnings,
        }
    }

    /// What it is called.
    pub fn label(&self) -> Label<'_> {
        Label {
            dataset: &self.unread.dataset,
            name: &self.unread.parts.name,
            tags: &self.annotations.tags,
        }
    }

    /// Why tracking cannot start at frame `start` of a sequence of `size`: no corners there, or some outside the image.
    pub fn start_fault(&self, start: usize, size: (usize, usize)) -> Option<DatasetError> {
        let annotation = self.annotations.frames.get(start)?;
        let (width, height) = size;
        let inside = |v: f64, n: usize| (-0.5..=n as f64 - 0.5).contains(&v);
        let kind = match annotation.corners() {
            None => DatasetErrorKind::NoInitialTruth {
                frame: self.unread.parts.frames[start].name().into(),
            },
            Some(c) if c.0.iter().all(|&[x, y]| inside(x, width) && inside(y, height)) => return None,
            Some(_) => DatasetErrorKind::InitialOutside { width, height },
        };
        Some(match &annotation.location {
            Some(location) => location.fault(kind),
            None => DatasetError::new(self.unread.parts.truth.first()?.path(), kind),
        })
    }

    /// Size of the first frame, from its header.
    pub fn first_size(&self) -> Result<(usize, usize), DatasetError> {
        let Some(file) = self.unread.parts.frames.first() else {
            return Err(DatasetError::new(
                self.unread.folder.path(),
                DatasetErrorKind::NoFrames,
            ));
        };
        dimensions(&file.read()?).map_err(|e| DatasetError::new(file.path(), e.into()))
    }

    /// Why the selection leaves no frame.
    pub fn selection_fault(&self, options: &LoadOptions) -> Option<DatasetError> {
        let (start, frames) = (options.start, self.unread.parts.frames.len());
        let nothing = start >= frames || options.max_frames == Some(0);
        let kind = DatasetErrorKind::NothingSelected { start, frames };
        nothing.then(|| DatasetError::new(self.unread.folder.path(), kind))
    }

    /// The sequence, with what is valid of its ground truth; it notes the warnings and what is `left_out` of it.
    pub fn into_sequence(self, (width, height): (usize, usize), left_out: &[DatasetError]) -> Sequence {
        let parts = self.unread.parts;
        let warnings = self.warnings.iter().map(Fault::warning);
        let contents = vec![Default::default(); parts.frames.len()];
        Sequence::new(Whole {
            dataset: self.unread.dataset,
            name: parts.name,
            format: self.unread.format.map_or("", |format| format.describe().name),
            folder: self.unread.folder,
            frames: parts.frames,
            annotations: self.annotations.frames,
            truth_digest: self.truth_digest,
            tags: self.annotations.tags,
            width,
            height,
            contents,
            notes: left_out.iter().map(Fault::from).chain(warnings).collect(),
            decoded: Default::default(),
        })
    }
}
