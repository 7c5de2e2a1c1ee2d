//! One sequence: frames, ground truth, tags; decoded frame by frame on demand.

use super::annotation::{Annotation, Annotations, Region};
use super::decode::{Depth16, Remark, decode_by, remarks};
use super::dense::DENSE_FILE;
use super::movie::Movie;
use super::reading::{BoxForm, Origin};
use super::storage::{File, Folder};
use super::{DatasetError, DatasetErrorKind, Fault};
use mtf::geom::Corners;
use mtf::image::Pixels;
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use twox_hash::XxHash64;

/// Image sequence with ground-truth corners, or a selection of its frames. Cloning and selecting share everything.
#[derive(Clone, Debug)]
pub struct Sequence {
    whole: Arc<Whole>,
    start: usize,
    step: usize,
    len: usize,
    /// What stands in place of the whole's ground truth.
    fitted: Option<Arc<Fitted>>,
}

/// `fit(start, corners)`: what a warp of a region at `start` can follow of a region that went to `corners`.
type Fit = dyn Fn(&Corners, &Corners) -> Option<Corners> + Send + Sync;

/// Ground truth that was fitted with a warp.
struct Fitted {
    fit: Box<Fit>,
    /// Frame of the whole that `truth` was fitted from: the first with ground truth.
    from: Option<usize>,
    /// Per frame of the whole.
    truth: Vec<Option<Corners>>,
}

impl std::fmt::Debug for Fitted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Fitted(from {:?})", self.from)
    }
}

/// What all selections of a sequence share.
#[derive(Debug)]
pub(super) struct Whole {
    pub dataset: String,
    pub name: String,
    pub format: &'static str,
    pub folder: Folder,
    /// The file whose pictures are the frames; `None` when each is a file.
    pub movie: Option<Movie>,
    /// Folder of the frames and their truth: `folder`, or that of the sequence whose frames these are.
    pub data: Folder,
    pub frames: Vec<File>,
    pub annotations: Vec<Annotation>,
    pub truth_digest: [u8; 32],
    pub tags: Vec<String>,
    pub origin: Origin,
    pub boxes: Option<BoxForm>,
    pub width: usize,
    pub height: usize,
    pub depth16: Depth16,
    /// What each frame's file holds, or the one of all frames, looked at once.
    pub contents: Vec<OnceLock<Content>>,
    pub notes: Vec<Fault>,
    pub decoded: AtomicUsize,
}

/// What a frame's file holds.
#[derive(Clone, Debug)]
pub(super) struct Content {
    /// Of its bytes; the largest number where it cannot be read.
    checksum: u64,
    remarks: Vec<Remark>,
}

impl Whole {
    /// What the file of a frame holds.
    fn content(&self, frame: usize) -> &Content {
        let look = || {
            let of = |bytes: Cow<'_, [u8]>| Content {
                checksum: checksum(&bytes),
                remarks: remarks(&bytes),
            };
            match &self.movie {
                Some(movie) => movie.checksum().map(|checksum| Content {
                    checksum,
                    remarks: movie.remarks().to_vec(),
                }),
                None => self.frames[frame].read().map(of),
            }
        };
        let unreadable = || Content {
            checksum: u64::MAX,
            remarks: Vec::new(),
        };
        self.place(frame)
            .get_or_init(|| look().unwrap_or_else(|_| unreadable()))
    }

    /// Where the content of a frame's file is kept.
    fn place(&self, frame: usize) -> &OnceLock<Content> {
        &self.contents[if self.movie.is_some() { 0 } else { frame }]
    }

    /// The picture of a frame. Of a film, the reader is kept for the next one that is `wanted`.
    fn picture(&self, frame: usize, colour: bool, wanted: bool) -> Result<Pixels, DatasetError> {
        match &self.movie {
            Some(movie) => movie.read(frame, colour, self.depth16, wanted),
            None => read_frame(&self.frames[frame], colour, self.depth16),
        }
    }
}

fn checksum(bytes: &[u8]) -> u64 {
    XxHash64::oneshot(0, bytes)
}

impl Sequence {
    pub(super) fn new(whole: Whole) -> Self {
        let len = whole.frames.len();
        Sequence {
            whole: Arc::new(whole),
            start: 0,
            step: 1,
            len,
            fitted: None,
        }
    }

    /// One whose frames cannot be read.
    pub(super) fn of_truth(
        dataset: &str,
        name: &str,
        folder: &Folder,
        frames: Vec<File>,
        annotations: Annotations,
        truth_digest: [u8; 32],
    ) -> Self {
        Sequence::new(Whole {
            dataset: dataset.to_owned(),
            name: name.to_owned(),
            format: "",
            folder: folder.clone(),
            data: folder.clone(),
            movie: None,
            contents: vec![Default::default(); frames.len()],
            frames,
            truth_digest,
            tags: Vec::new(),
            origin: annotations.origin(),
            boxes: annotations.boxes(),
            annotations: annotations.into_frames(),
            width: 0,
            height: 0,
            depth16: Depth16::default(),
            notes: Vec::new(),
            decoded: Default::default(),
        })
    }

    /// Every `gap`-th frame, beginning with the first; names and truth of the kept frames are unchanged. 0 counts as 1.
    pub fn with_gap(&self, gap: usize) -> Self {
        let gap = gap.max(1);
        Sequence {
            step: self.step * gap,
            len: self.len.div_ceil(gap),
            ..self.clone()
        }
    }

    /// The first `frames` frames.
    pub fn truncated(&self, frames: usize) -> Self {
        Sequence {
            len: self.len.min(frames),
            ..self.clone()
        }
    }

    /// The frames from `start` on (none when there are not as many).
    pub fn from_frame(&self, start: usize) -> Self {
        let skipped = start.min(self.len);
        Sequence {
            start: self.start + skipped * self.step,
            len: self.len - skipped,
            ..self.clone()
        }
    }

    /// The same frames with ground truth that is within reach of a warp: `fit(start, corners)` of each annotated frame, with
    /// `start` the annotation of the frame that a tracker was started on ([`truth_from`](Self::truth_from)). What it is
    /// from the first annotation counts towards the [`fingerprint`](Self::fingerprint).
    ///
    /// # Errors
    /// The frame for which `fit` failed from the first annotation, and its error.
    pub fn with_fitted_truth<E>(
        &self,
        fit: impl Fn(&Corners, &Corners) -> Result<Corners, E> + Send + Sync + 'static,
    ) -> Result<Self, (String, E)> {
        let mut truth = vec![None; self.whole.annotations.len()];
        let mut first = None;
        for i in 0..self.len {
            if let Some(corners) = self.annotation(i).corners() {
                let (_, first) = *first.get_or_insert((self.index(i), corners));
                let moved = fit(&first, &corners).map_err(|e| (self.frame_name(i).to_owned(), e))?;
                truth[self.index(i)] = Some(moved);
            }
        }
        let fitted = Fitted {
            fit: Box::new(move |start, corners| fit(start, corners).ok()),
            from: first.map(|(index, _)| index),
            truth,
        };
        Ok(Sequence {
            fitted: Some(Arc::new(fitted)),
            ..self.clone()
        })
    }

    /// Name of the dataset that the sequence belongs to.
    pub fn dataset(&self) -> &str {
        &self.whole.dataset
    }
    /// Name, unique within the dataset.
    pub fn name(&self) -> &str {
        &self.whole.name
    }
    /// Name of the format it has.
    pub fn format(&self) -> &'static str {
        self.whole.format
    }
    /// The folder it was found in.
    pub fn path(&self) -> &Path {
        self.whole.folder.path()
    }
    /// Number of frames.
    pub fn len(&self) -> usize {
        self.len
    }
    /// No frames.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
    /// Width of every frame in pixels.
    pub fn width(&self) -> usize {
        self.whole.width
    }
    /// Height of every frame in pixels.
    pub fn height(&self) -> usize {
        self.whole.height
    }
    /// Words that say what is hard about it.
    pub fn tags(&self) -> &[String] {
        &self.whole.tags
    }

    /// What is to know about its data: warnings; and as errors, what [`OnBadData::Skip`](super::OnBadData::Skip) left out of
    /// it, such as faulty rows.
    pub fn notes(&self) -> &[Fault] {
        &self.whole.notes
    }
    /// The coordinate that its ground truth gives to the centre of the first pixel. [`truth`](Self::truth) is without it.
    pub fn origin(&self) -> Origin {
        self.whole.origin
    }
    /// How the boxes of its ground truth were read, when it has boxes.
    pub fn boxes(&self) -> Option<BoxForm> {
        self.whole.boxes
    }
    /// Number of frames where the object is said not to be seen.
    pub fn absent(&self) -> usize {
        let absent = |&i: &usize| self.annotation(i).region == Region::Absent;
        (0..self.len).filter(absent).count()
    }

    /// Position of frame `i` in the whole sequence; panics when `i >= len()`.
    pub fn index(&self, i: usize) -> usize {
        assert!(i < self.len, "frame {i} of {}", self.len);
        self.start + i * self.step
    }
    /// File of frame `i`; panics when `i >= len()`.
    pub(super) fn frame(&self, i: usize) -> &File {
        &self.whole.frames[self.index(i)]
    }
    /// Whether its frames are pictures in one file.
    pub(super) fn is_film(&self) -> bool {
        self.whole.movie.is_some()
    }
    /// Files of all frames of the whole sequence.
    pub(super) fn all_frames(&self) -> Vec<&File> {
        self.whole.frames.iter().collect()
    }
    /// File name of frame `i`; panics when `i >= len()`.
    pub fn frame_name(&self, i: usize) -> &str {
        self.whole.frames[self.index(i)].name()
    }
    /// Ground truth of frame `i` in image pixels, `None` when it has no corners; panics when `i >= len()`. Where it is
    /// [fitted](Self::with_fitted_truth), that of a tracker that starts on the first annotated frame.
    pub fn truth(&self, i: usize) -> Option<Corners> {
        let i = self.index(i);
        match &self.fitted {
            Some(fitted) => fitted.truth[i],
            None => self.whole.annotations[i].corners(),
        }
    }
    /// Ground truth of frame `i` for a tracker that was started on frame `start`, px: another for each start only where it
    /// is [fitted](Self::with_fitted_truth). On the start itself it is the annotation, which every warp reaches by not
    /// moving. `None` as for [`truth`](Self::truth), and where nothing fits. Panics when `start` or `i >= len()`.
    pub fn truth_from(&self, start: usize, i: usize) -> Option<Corners> {
        match &self.fitted {
            Some(fitted) if fitted.from != Some(self.index(start)) => {
                let (start, corners) = (self.annotation(start).corners()?, self.annotation(i).corners()?);
                (fitted.fit)(&start, &corners)
            }
            _ => self.truth(i),
        }
    }
    /// What the data says about frame `i`; panics when `i >= len()`.
    pub fn annotation(&self, i: usize) -> &Annotation {
        &self.whole.annotations[self.index(i)]
    }
    /// Dense ground truth of frame `i`: where the points of a grid on the object are, px; `None` when it has none. The same
    /// number of points in every frame. Panics when `i >= len()`.
    pub fn dense_truth(&self, i: usize) -> Option<&[[f64; 2]]> {
        self.annotation(i).dense.as_deref()
    }
    /// Number of annotated frames.
    pub fn annotated(&self) -> usize {
        (0..self.len).filter(|&i| self.truth(i).is_some()).count()
    }

    /// Decodes frame `i` (with R, G, B when `colour`); panics when `i >= len()`.
    ///
    /// Errors: the file cannot be read or decoded, has another size than the first frame, or is no longer the one that the
    /// [fingerprint](Self::fingerprint) was taken of.
    pub fn read(&self, i: usize, colour: bool) -> Result<Pixels, DatasetError> {
        let index = self.index(i);
        let file = &self.whole.frames[index];
        self.whole.decoded.fetch_add(1, Ordering::Relaxed);
        let known = self.whole.place(index).get();
        let verify = |found: u64| match known.is_some_and(|known| known.checksum != found) {
            true => Err(DatasetError::new(file.path(), DatasetErrorKind::Changed)),
            false => Ok(()),
        };
        let decoded = match &self.whole.movie {
            None => {
                let bytes = file.read()?;
                verify(checksum(&bytes))?;
                decode_frame(file, &bytes, colour, self.whole.depth16)?
            }
            Some(movie) => {
                let last = i + 1 == self.len;
                let decoded = self.whole.picture(index, colour, !last)?;
                // Once for all of its frames: whoever tracks them comes to the last.
                if last && known.is_some() {
                    verify(movie.checksum()?)?;
                }
                decoded
            }
        };
        let size = (decoded.width(), decoded.height());
        check_size(file, size, (self.whole.width, self.whole.height))?;
        Ok(decoded)
    }

    /// Frames are best [read](Self::read) one after the other: they are pictures of one file.
    pub fn in_order(&self) -> bool {
        self.whole.movie.is_some()
    }

    /// Why the first frame that cannot be [read](Self::read) cannot. Decodes frames, on all threads.
    pub(super) fn unreadable(&self) -> Option<DatasetError> {
        if self.in_order() {
            return (0..self.len).find_map(|i| self.read(i, false).err());
        }
        let frames = (0..self.len).into_par_iter();
        frames.find_map_first(|i| self.read(i, false).err())
    }

    /// How many times a frame was decoded by [`read`](Self::read), over all clones and selections of the sequence.
    pub fn decoded_count(&self) -> usize {
        self.whole.decoded.load(Ordering::Relaxed)
    }

    /// What is out of the ordinary about the frames, a fault for each kind that names the first such frame. Levels are
    /// looked at in the first frame. Reads the files, once for all selections of the sequence.
    pub fn remarks(&self) -> Vec<(Remark, DatasetError)> {
        let mut remarks = Remarks::default();
        let mut deep = None;
        for i in 0..self.len {
            let index = self.index(i);
            for &remark in &self.whole.content(index).remarks {
                remarks.add(remark, &self.whole.frames[index]);
                if remark == Remark::SixteenBits {
                    deep.get_or_insert(index);
                }
            }
        }
        if let Some(first) = deep
            && let Ok(pixels) = self.whole.picture(first, false, false)
            && let Some(sliver) = Remark::sliver(&pixels)
        {
            remarks.add(sliver, &self.whole.frames[first]);
        }
        remarks.faults()
    }

    /// Content of another file in the folder of the frames, such as dense ground truth; `None` when there is none.
    pub fn file(&self, name: &str) -> Result<Option<Cow<'static, [u8]>>, DatasetError> {
        self.whole.data.file(name).map(|file| file.read()).transpose()
    }

    /// Identity of the data in 64 hex digits: SHA-256 over the bytes of the ground truth's files (and of the dense
    /// one), the image size, and for each frame its name, corners and the checksum (XXH64) of its file's bytes. The place on
    /// disk does not count; the rule for 16 bits per channel does where there are any and it is not the usual one. Reads the files, once for all selections of the sequence.
    pub fn fingerprint(&self) -> String {
        format!("{:x}", self.hasher().finalize())
    }

    /// [`fingerprint`](Self::fingerprint) that also covers the decoded pixels of every frame. Decodes the sequence.
    pub fn fingerprint_of_pixels(&self) -> Result<String, DatasetError> {
        let mut hasher = self.hasher();
        for i in 0..self.len {
            let decoded = self.whole.picture(self.index(i), true, i + 1 < self.len)?;
            hasher.update(decoded.gray());
            hasher.update(decoded.rgb().unwrap_or_default());
        }
        Ok(format!("{:x}", hasher.finalize()))
    }

    fn hasher(&self) -> Sha256 {
        let whole = &*self.whole;
        let mut hasher = Sha256::new();
        let mut put = |bytes: &[u8]| {
            // The length goes first, so that no two lists of fields run together.
            hasher.update((bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        put(b"sequence 2");
        put(&whole.truth_digest);
        put(&self.file(DENSE_FILE).ok().flatten().unwrap_or_default());
        put(&[whole.width as u64, whole.height as u64, self.len as u64]
            .map(u64::to_le_bytes)
            .concat());
        for i in 0..self.len {
            put(self.frame_name(i).as_bytes());
            let content = whole.content(self.index(i));
            put(&content.checksum.to_le_bytes());
            // The pixels of other frames do not depend on the rule.
            if whole.depth16 != Depth16::default() && content.remarks.contains(&Remark::SixteenBits) {
                put(whole.depth16.to_string().as_bytes());
            }
            let corners = self.truth(i).map(Corners::to_array);
            put(&corners
                .map(|c| c.map(f64::to_le_bytes).concat())
                .unwrap_or_default());
        }
        hasher
    }
}

/// The remarks about frames of a sequence, with the first file of each kind and their number.
#[derive(Default)]
pub(super) struct Remarks(BTreeMap<Remark, (File, usize)>);

impl Remarks {
    /// About one more file.
    pub fn add(&mut self, remark: Remark, file: &File) {
        self.0.entry(remark).or_insert_with(|| (file.clone(), 0)).1 += 1;
    }

    /// A fault for each kind.
    pub fn faults(self) -> Vec<(Remark, DatasetError)> {
        let fault = |(remark, (file, frames)): (Remark, (File, usize))| {
            (
                remark,
                DatasetError::new(file.path(), DatasetErrorKind::Remark { remark, frames }),
            )
        };
        self.0.into_iter().map(fault).collect()
    }
}

/// Reads and decodes a file.
pub(super) fn read_frame(file: &File, colour: bool, depth16: Depth16) -> Result<Pixels, DatasetError> {
    decode_frame(file, &file.read()?, colour, depth16)
}

/// Decodes the content of a file.
pub(super) fn decode_frame(
    file: &File,
    bytes: &[u8],
    colour: bool,
    depth16: Depth16,
) -> Result<Pixels, DatasetError> {
    decode_by(bytes, colour, depth16).map_err(|e| DatasetError::new(file.path(), e.into()))
}

/// A frame must have the size of the first.
pub(super) fn check_size(
    file: &File,
    size: (usize, usize),
    first: (usize, usize),
) -> Result<(), DatasetError> {
    let (width, height) = size;
    if size == first {
        return Ok(());
    }
    let kind = DatasetErrorKind::SizeMismatch {
        width,
        height,
        first_width: first.0,
        first_height: first.1,
    };
    Err(DatasetError::new(file.path(), kind))
}
