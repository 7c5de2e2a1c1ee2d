//! From a found sequence to an opened one, collecting every fault on the way.

use super::annotation::{Annotations, Location};
use super::decode::{Depth16, dimensions};
use super::find::Unread;
use super::format::{Formats, Found, Place, TruthFile};
use super::movie::Movie;
use super::nearest::Inventory;
use super::reading::Reading;
use super::sequence::{Sequence, Whole};
use super::storage::{File, Folder};
use super::suspect::Truth;
use super::{
    DatasetError, DatasetErrorKind, Fault, Label, LoadOptions, Severity, absence, dense, order, tags,
};
use mtf::geom::{Corners, polygon};
use sha2::{Digest, Sha256};
use std::path::Path;

/// Least part of the initial quadrilateral that lies in the image, px²: a pixel.
const LEAST_INSIDE: f64 = 1.0;

/// Whether all corners lie in an image of `size`.
fn is_inside(corners: &Corners, (width, height): (usize, usize)) -> bool {
    let inside = |v: f64, n: usize| (-0.5..=n as f64 - 0.5).contains(&v);
    corners
        .0
        .iter()
        .all(|&[x, y]| inside(x, width) && inside(y, height))
}

/// Area of the part of a quadrilateral in an image of `size`, px².
fn area_inside(corners: &Corners, (width, height): (usize, usize)) -> f64 {
    let image = Corners::rect(-0.5, -0.5, width as f64, height as f64);
    let mut corners = corners.0;
    if polygon::signed_area(&corners) < 0.0 {
        corners.reverse();
    }
    polygon::signed_area(&polygon::clip_convex(&corners, &image.0))
}

/// That the frames in `folder` have no ground truth, what lies there, and what it is nearest to.
fn no_ground_truth(folder: &Folder, formats: &Formats) -> DatasetError {
    let around = Place::new(folder).ok().map(|place| Inventory::around(&place));
    let kind = DatasetErrorKind::NoGroundTruth {
        found: around
            .as_ref()
            .map(|around| format!("there are {}", around.found())),
        nearest: around.and_then(|around| around.nearest(formats)),
    };
    DatasetError::new(folder.path(), kind)
}

/// That the frames are in a video or an archive, and how to get them out.
fn still_packed(parts: &Found) -> Option<DatasetError> {
    let (packed, truth) = (parts.packed.as_ref()?, parts.truth.first()?);
    let (path, name) = (packed.path(), &parts.name);
    let around = path.parent().unwrap_or(Path::new(""));
    let unpack = if packed.name().ends_with(".zip") {
        let frames = around.with_file_name("frames").join(name);
        format!("unzip -d {} {}", frames.display(), path.display())
    } else {
        let frames = around.join(name);
        format!(
            "mkdir {0} && ffmpeg -i {1} -fps_mode passthrough {0}/%05d.png",
            frames.display(),
            path.display()
        )
    };
    let kind = DatasetErrorKind::PackedFrames {
        packed: path.to_path_buf(),
        unpack,
    };
    Some(DatasetError::new(truth.path(), kind))
}

/// A sequence whose annotations are read; no image has been decoded.
pub(super) struct Draft {
    pub unread: Unread,
    /// The file whose pictures are the frames; `None` when each is a file.
    pub movie: Option<Movie>,
    pub annotations: Annotations,
    truth_digest: [u8; 32],
    /// Faults that no use of the sequence can get round.
    pub fatal: Vec<DatasetError>,
    /// Faults that do not keep it from being used as it stands.
    pub warnings: Vec<DatasetError>,
}

impl Draft {
    /// Reads ground truth and tags. `asked` goes before what the sequence's metadata say.
    pub fn new(mut unread: Unread, asked: Reading, formats: &Formats) -> Draft {
        let (mut fatal, mut warnings) = (Vec::new(), Vec::new());
        let movie = match &unread.parts.frames[..] {
            [one] => Movie::of(one),
            _ => Ok(None),
        };
        let movie = movie.unwrap_or_else(|e| {
            fatal.push(e);
            // How many they are is not known.
            unread.parts.frames.clear();
            None
        });
        if let Some(movie) = &movie {
            unread.parts.frames = movie.frames();
        }
        fatal.extend(unread.borrowed.as_mut().and_then(|b| b.fault.take()));
        if movie.is_some() && unread.borrowed.is_some() {
            let detail = "frames_of: the frames of a film cannot be borrowed".to_owned();
            let kind = DatasetErrorKind::BadMeta { detail };
            fatal.push(DatasetError::new(unread.folder.path(), kind));
        }
        let (parts, folder) = (&unread.parts, unread.data());
        let name = unread.borrowed.as_ref().map_or(&parts.name, |b| &b.name);
        let mut truth_digest = [0; 32];
        let mut annotations = Annotations::new(parts.frames.len());
        parts.tags.iter().for_each(|tag| annotations.tag(tag));
        match tags::reading(folder) {
            Ok(meta) => annotations.asked = asked.or(meta),
            Err(e) => fatal.push(e),
        }
        match (&unread.format, &parts.truth[..]) {
            // What rows belong to is not known.
            _ if !fatal.is_empty() && parts.frames.is_empty() => {}
            (None, _) | (_, []) => fatal.push(no_ground_truth(folder, formats)),
            _ if parts.frames.is_empty() && parts.packed.is_some() => fatal.extend(still_packed(parts)),
            (_, [file, ..]) if parts.frames.is_empty() => {
                fatal.push(DatasetError::new(file.path(), DatasetErrorKind::NoFrames));
            }
            (Some(format), files) => match files.iter().map(TruthFile::read).collect::<Result<Vec<_>, _>>() {
                Err(e) => fatal.push(e),
                Ok(truth) => {
                    let mut hasher = Sha256::new();
                    truth.iter().for_each(|file| hasher.update(file.bytes()));
                    truth_digest = hasher.finalize().into();
                    fatal.extend(format.read(parts, &truth, &mut annotations).err());
                    let before = annotations.faults.len();
                    match Place::new(folder) {
                        Ok(place) => {
                            absence::read(place.files(), name, &mut annotations);
                            warnings.extend(format.doubt(&place, parts, &annotations));
                        }
                        Err(e) => fatal.push(e),
                    }
                    // Beside the ground truth, where that is not in the folder.
                    let flags = format!("{name}_flag.txt");
                    let apart = parts
                        .truth
                        .first()
                        .filter(|t| t.path().parent() != Some(folder.path()));
                    let flags = apart.and_then(|truth| truth.beside(&flags));
                    let flags = flags.or_else(|| folder.file_beside("_flag.txt"));
                    absence::read(&flags, name, &mut annotations);
                    // Without them frames would count in which the object cannot be seen.
                    fatal.extend(annotations.faults.drain(before..));
                }
            },
        }
        fatal.extend(dense::read(folder, &parts.frames, &mut annotations).err());
        warnings.extend(tags::read(&unread.folder, &mut annotations).err());
        let names: Vec<&str> = parts.frames.iter().map(File::name).collect();
        warnings.extend(order::doubtful(&names).map(|(first, second)| {
            let (first, second) = (first.to_owned(), second.to_owned());
            DatasetError::new(folder.path(), DatasetErrorKind::DecimalNames { first, second })
        }));
        warnings.append(&mut annotations.warnings);
        if let Some(borrowed) = &unread.borrowed {
            borrowed.thin(&mut unread.parts.frames);
            borrowed.thin(&mut annotations.frames);
        }
        Draft {
            unread,
            movie,
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

    /// Where tracking starts at the earliest: the first frame from `from` on with corners, unless a frame before it lacks
    /// them for a fault.
    pub fn start(&self, from: usize, faults: &[DatasetError]) -> usize {
        let frames = &self.annotations.frames;
        let is_faulty = |at: &Location| {
            let here = |f: &DatasetError| f.line.is_some() && f.path == at.path && f.line == at.line;
            faults.iter().any(here)
        };
        let is_start = |i: &usize| {
            let annotation = &frames[*i];
            annotation.corners().is_some() || annotation.location.as_ref().is_some_and(is_faulty)
        };
        (from..frames.len()).find(is_start).unwrap_or(from)
    }

    /// A warning that the frames from `from` to before `start` have no ground truth.
    pub fn late_start(&mut self, from: usize, start: usize) {
        if start > from {
            let parts = &self.unread.parts;
            let frame = parts.frames[start].name().to_owned();
            let path = parts.truth.first().map_or(self.unread.folder.path(), File::path);
            let kind = DatasetErrorKind::LateStart { frame };
            self.warnings.push(DatasetError::new(path, kind));
        }
    }

    /// Why tracking cannot start at frame `start` of a sequence of `size`: no corners there, or none of it in the image.
    pub fn start_fault(&self, start: usize, size: (usize, usize)) -> Option<DatasetError> {
        let annotation = self.annotations.frames.get(start)?;
        let (width, height) = size;
        let kind = match annotation.corners() {
            None => DatasetErrorKind::NoInitialTruth {
                frame: self.unread.parts.frames[start].name().into(),
            },
            Some(corners) if !is_inside(&corners, size) && area_inside(&corners, size) < LEAST_INSIDE => {
                DatasetErrorKind::InitialAway { width, height }
            }
            Some(_) => return None,
        };
        self.about_start(start, kind)
    }

    /// That a part of frame `start`'s quadrilateral lies outside an image of `size`.
    pub fn start_outside(&self, start: usize, size: (usize, usize)) -> Option<DatasetError> {
        let corners = self.annotations.frames.get(start)?.corners()?;
        let (width, height) = size;
        match is_inside(&corners, size) {
            true => None,
            false => self.about_start(start, DatasetErrorKind::InitialOutside { width, height }),
        }
    }

    fn about_start(&self, start: usize, kind: DatasetErrorKind) -> Option<DatasetError> {
        Some(match &self.annotations.frames[start].location {
            Some(location) => location.fault(kind),
            None => DatasetError::new(self.unread.parts.truth.first()?.path(), kind),
        })
    }

    /// What looks wrong about the ground truth of images of `size`.
    pub fn suspects(&self, size: (usize, usize)) -> Vec<DatasetError> {
        let annotations = &self.annotations;
        let truth = Truth {
            frames: &annotations.frames,
            names: self.unread.parts.frames.iter().map(|f| f.name()).collect(),
            size,
            origin: annotations.origin,
            usual_boxes: annotations.boxes.is_some() && annotations.asked.boxes.is_none(),
        };
        truth.warnings()
    }

    /// Size of the first frame, from its header.
    pub fn first_size(&self) -> Result<(usize, usize), DatasetError> {
        let Some(file) = self.unread.parts.frames.first() else {
            return Err(DatasetError::new(
                self.unread.folder.path(),
                DatasetErrorKind::NoFrames,
            ));
        };
        if let Some(movie) = &self.movie {
            return Ok(movie.size());
        }
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
    pub fn into_sequence(
        self,
        (width, height): (usize, usize),
        depth16: Depth16,
        left_out: &[DatasetError],
    ) -> Sequence {
        let parts = self.unread.parts;
        let mut notes = Fault::all(left_out, Severity::Error);
        notes.extend(Fault::all(&self.warnings, Severity::Warning));
        let files = self.movie.as_ref().map_or(parts.frames.len(), |_| 1);
        let contents = vec![Default::default(); files];
        let data = self.unread.borrowed.map(|b| b.from);
        Sequence::new(Whole {
            dataset: self.unread.dataset,
            name: parts.name,
            format: self.unread.format.map_or("", |format| format.describe().name),
            data: data.unwrap_or_else(|| self.unread.folder.clone()),
            folder: self.unread.folder,
            movie: self.movie,
            frames: parts.frames,
            annotations: self.annotations.frames,
            truth_digest: self.truth_digest,
            tags: self.annotations.tags,
            origin: self.annotations.origin,
            boxes: self.annotations.boxes,
            width,
            height,
            depth16,
            contents,
            notes,
            decoded: Default::default(),
        })
    }
}
