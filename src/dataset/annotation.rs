//! What the data says about each frame of a sequence: the region of the object, and words about the frame.
//!
//! Depends on `geom` and the errors.

use super::reading::{BoxForm, Origin, Reading};
use super::{DatasetError, DatasetErrorKind};
use mtf::geom::Corners;
use std::path::{Path, PathBuf};

/// Quadrilaterals of which every three corners span less than this are lines (px²).
const MIN_AREA: f64 = 1e-6;

/// Largest coordinate, px, on either side of 0. The widest image that can be read has 65,536 pixels; an object 15 times as
/// far away is a slip of the pen. Products of coordinates below it are far from what numbers can hold.
pub(super) const MAX_COORDINATE: f64 = 1e6;

/// Where the object is in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Region {
    /// The frame is not annotated.
    #[default]
    Unknown,
    /// The annotation says that the object cannot be seen.
    Absent,
    /// Four corners in px, pixel centres at integers: finite, convex, with an area.
    Corners(Corners),
}

/// Place of a piece of data: a file, and a line of it when it is text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Location {
    /// The file.
    pub path: PathBuf,
    /// Line of the file, from 1.
    pub line: Option<usize>,
}

impl Location {
    /// A whole file.
    pub fn file(path: &Path) -> Self {
        Location {
            path: path.to_path_buf(),
            line: None,
        }
    }

    /// A line (from 1) of a text file.
    pub fn line(path: &Path, line: usize) -> Self {
        Location {
            path: path.to_path_buf(),
            line: Some(line),
        }
    }

    /// The fault `kind` of what is said here.
    pub fn fault(&self, kind: DatasetErrorKind) -> DatasetError {
        DatasetError {
            path: self.path.clone(),
            line: self.line,
            kind,
        }
    }
}

/// What the data says about one frame.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Annotation {
    /// Where the object is.
    pub region: Region,
    /// Where points of a grid on the object are, px, row by row; the same number of points in every frame that has
    /// any.
    pub dense: Option<Box<[[f64; 2]]>>,
    /// Words about this frame, such as `occluded`.
    pub flags: Vec<String>,
    /// Where the region is written down.
    pub location: Option<Location>,
}

impl Annotation {
    /// The object's corners, px; `None` when it is absent or not annotated.
    pub fn corners(&self) -> Option<Corners> {
        match self.region {
            Region::Corners(corners) => Some(corners),
            Region::Unknown | Region::Absent => None,
        }
    }
}

/// What the data says about a sequence, as far as it is valid, and everything that is wrong with it. Formats fill it.
#[derive(Debug, Default)]
pub struct Annotations {
    pub(super) frames: Vec<Annotation>,
    pub(super) tags: Vec<String>,
    pub(super) faults: Vec<DatasetError>,
    /// How the truth is to be read, as far as that is asked for.
    pub(super) asked: Reading,
    /// Where its first pixel is.
    pub(super) origin: Origin,
    /// What its boxes are, when it has any.
    pub(super) boxes: Option<BoxForm>,
    /// What is to know about data that can be used as it stands.
    pub(super) warnings: Vec<DatasetError>,
    /// The frame of each row that names none, `None` where it is not there.
    pub(super) rows: Vec<Option<usize>>,
    /// What a tracker said, which may be any four corners.
    results: bool,
}

impl Annotations {
    /// Those of a sequence of `frames` frames of which nothing is known.
    pub fn new(frames: usize) -> Self {
        Annotations {
            frames: vec![Annotation::default(); frames],
            ..Annotations::default()
        }
    }

    /// Those of results of a tracker, which may have any finite corners, of `frames` frames of which nothing is known.
    pub(super) fn of_results(frames: usize) -> Self {
        Annotations {
            results: true,
            ..Annotations::new(frames)
        }
    }

    /// Asks for a reading.
    pub(super) fn ask(&mut self, reading: Reading) {
        self.asked = reading;
    }

    /// Where the first pixel is.
    pub(super) fn origin(&self) -> Origin {
        self.origin
    }

    /// What its boxes are, when it has any.
    pub(super) fn boxes(&self) -> Option<BoxForm> {
        self.boxes
    }

    /// Keeps the frames of these indices alone.
    pub(super) fn select(&mut self, frames: impl Iterator<Item = usize>) {
        self.frames = frames.map(|i| std::mem::take(&mut self.frames[i])).collect();
    }

    /// What is known of each frame.
    pub(super) fn into_frames(self) -> Vec<Annotation> {
        self.frames
    }

    /// Everything that is wrong, which is forgotten.
    pub(super) fn take_faults(&mut self) -> Vec<DatasetError> {
        std::mem::take(&mut self.faults)
    }

    /// How the truth is to be read, as far as that is asked for in place of what the format usually has.
    pub fn asked(&self) -> Reading {
        self.asked
    }

    /// Notes the coordinate that the truth gives to the centre of its first pixel. Corners are without it.
    pub fn set_origin(&mut self, origin: Origin) {
        self.origin = origin;
    }

    /// What is known of each frame.
    pub fn frames(&self) -> &[Annotation] {
        &self.frames
    }

    /// Everything that is wrong, in the order in which it was found.
    pub fn faults(&self) -> &[DatasetError] {
        &self.faults
    }

    /// What `location` says about frame `frame`: a region, or why there is none. Corners that cannot be those of an
    /// object (not finite, beyond a million px, not convex, without area) count as such a reason. A reason becomes a fault, and the frame
    /// is not annotated. Panics when there is no such frame.
    pub fn set(&mut self, frame: usize, location: Location, region: Result<Region, DatasetErrorKind>) {
        let checked = region.and_then(|region| match region {
            Region::Corners(corners) if self.results => Ok(match corners.is_finite() {
                true => region,
                false => Region::Absent,
            }),
            Region::Corners(corners) => check_corners(&corners).map(|()| region),
            Region::Unknown | Region::Absent => Ok(region),
        });
        let region = checked.unwrap_or_else(|kind| {
            self.faults.push(location.fault(kind));
            Region::Unknown
        });
        self.frames[frame].region = region;
        self.frames[frame].location = Some(location);
    }

    /// Whether [`set`](Self::set) was called for frame `frame`.
    pub fn is_set(&self, frame: usize) -> bool {
        self.frames[frame].location.is_some()
    }

    /// Where points of a grid on the object are in frame `frame`, px.
    pub fn set_dense(&mut self, frame: usize, points: Box<[[f64; 2]]>) {
        self.frames[frame].dense = Some(points);
    }

    /// Puts a word on frame `frame`.
    pub fn flag(&mut self, frame: usize, word: &str) {
        self.frames[frame].flags.push(word.into());
    }

    /// Puts a word on the whole sequence, once.
    pub fn tag(&mut self, word: &str) {
        if !self.tags.iter().any(|tag| tag == word) {
            self.tags.push(word.into());
        }
    }

    /// Something to know about data that can be used as it stands.
    pub fn warn(&mut self, warning: DatasetError) {
        self.warnings.push(warning);
    }

    /// Something else that is wrong.
    pub fn fault(&mut self, fault: DatasetError) {
        self.faults.push(fault);
    }
}

/// Whether a point is where an object can be.
pub(super) fn is_near(point: &[f64; 2]) -> bool {
    point.iter().all(|v| v.abs() <= MAX_COORDINATE)
}

fn check_corners(corners: &Corners) -> Result<(), DatasetErrorKind> {
    if !corners.is_finite() {
        return Err(DatasetErrorKind::NotFinite);
    }
    let c = &corners.0;
    if !c.iter().all(is_near) {
        return Err(DatasetErrorKind::TooFar);
    }
    let twice_area = |i: usize, j: usize, k: usize| {
        ((c[j][0] - c[i][0]) * (c[k][1] - c[i][1]) - (c[j][1] - c[i][1]) * (c[k][0] - c[i][0])).abs()
    };
    let triangles = [
        twice_area(0, 1, 2),
        twice_area(1, 2, 3),
        twice_area(2, 3, 0),
        twice_area(3, 0, 1),
    ];
    if triangles.iter().all(|&t| t < 2.0 * MIN_AREA) {
        return Err(DatasetErrorKind::ZeroArea);
    }
    if !corners.is_convex() {
        return Err(DatasetErrorKind::NotConvex);
    }
    Ok(())
}
