//! What can be wrong with a dataset, and where.

use super::annotation::MAX_COORDINATE;
use super::decode::{ImageError, Remark, image_formats};
use crate::files::Refused;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// A fault of a dataset: where it is, what is wrong and what to do. Displays as `path:line: what; remedy`.
#[derive(Debug, thiserror::Error)]
pub struct DatasetError {
    /// File or folder with the fault.
    pub path: PathBuf,
    /// Line of the file, from 1, when the fault has one.
    pub line: Option<usize>,
    /// What is wrong.
    pub kind: DatasetErrorKind,
}

impl DatasetError {
    /// A fault of a whole file or folder.
    pub fn new(path: impl AsRef<Path>, kind: DatasetErrorKind) -> Self {
        DatasetError {
            path: path.as_ref().to_path_buf(),
            line: None,
            kind,
        }
    }

    /// A fault in a line (from 1) of a text file.
    pub fn at_line(path: impl AsRef<Path>, line: usize, kind: DatasetErrorKind) -> Self {
        DatasetError {
            path: path.as_ref().to_path_buf(),
            line: Some(line),
            kind,
        }
    }
}

impl std::fmt::Display for DatasetError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:", self.path.display())?;
        if let Some(line) = self.line {
            write!(f, "{line}:")?;
        }
        write!(f, " {}", self.kind)
    }
}

/// A search for sequences that found none.
#[derive(Debug)]
pub struct Searched {
    /// Levels of folders that were searched.
    pub depth: usize,
    /// A folder that lies deeper.
    pub deeper: Option<PathBuf>,
    /// Names of the formats that are known.
    pub formats: String,
    /// What is there.
    pub found: String,
    /// Which format it is nearest to, and what that has.
    pub nearest: Option<String>,
}

/// The kinds of fault. Their messages are fragments `what is wrong; remedy`.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetErrorKind {
    /// The path does not exist.
    #[error("no such file or folder; check the spelling, or give the folder that holds the sequences")]
    Missing,
    /// The path is a file with one picture, or something else.
    #[error(
        "not a folder, nor a file with several pictures (pages or an animation); give the folder that holds the frames or the sequences"
    )]
    NotAFolder,
    /// Reading failed.
    #[error("cannot be read ({0}); check its permissions")]
    Io(std::io::Error),
    /// It is no regular file, or larger than one of its kind can be.
    #[error("{0}")]
    Refused(Refused),
    /// A link that leads to nothing.
    #[error("the link leads nowhere; make it lead to what is meant, or remove it")]
    DeadLink,
    /// Two names that are not UTF-8 and have the same text.
    #[error("the names {first} and {second} are not UTF-8 and read as the same text; rename one of them")]
    SameText {
        /// One, its bytes escaped.
        first: String,
        /// The other.
        second: String,
    },
    /// The folder has no entries.
    #[error("the folder is empty; put a sequence (frames and `groundtruth.txt`) into it")]
    EmptyFolder,
    /// The folder holds nothing that looks like a sequence.
    #[error(
        "no sequence found in the folder and {} levels of folders below it{}; looked for the formats {}; found {}; {}",
        .0.depth,
        not_searched(.0.deeper.as_deref()),
        .0.formats,
        .0.found,
        .0.nearest.as_deref().unwrap_or("nothing is there of any of them: `mtf-eval list formats` shows what each has")
    )]
    NoSequences(Box<Searched>),
    /// Frames lie too deep to be found.
    #[error(
        "the images in this folder lie more than {depth} levels below the one that was given and are not used; give a folder nearer to them"
    )]
    TooDeep {
        /// Levels of folders that were searched.
        depth: usize,
    },
    /// The folder is where a sequence has its frames.
    #[error("the frames of a sequence without its ground truth, which lies around them; give `{}`", whole.display())]
    FramesOfSequence {
        /// Folder of the sequence.
        whole: PathBuf,
    },
    /// The built-in dataset is not part of this build.
    #[error("this build has no embedded sequences; give the path of a dataset")]
    NothingEmbedded,
    /// Frames without ground truth.
    #[error(
        "frames without ground truth{}; add `groundtruth.txt` to the folder, or a text file named like the folder beside it or in a folder `annos` there{}",
        in_brackets(found.as_deref()), in_brackets(nearest.as_deref())
    )]
    NoGroundTruth {
        /// What lies beside the frames, if anything.
        found: Option<String>,
        /// Which format it is nearest to, and what that has.
        nearest: Option<String>,
    },
    /// The frames are in a video or an archive.
    #[error("the frames are in `{}`, which is not read; unpack it: `{unpack}`", packed.display())]
    PackedFrames {
        /// The video or archive.
        packed: PathBuf,
        /// The command that does it.
        unpack: String,
    },
    /// The object is given as pixels or many points.
    #[error(
        "the object is {what}, where four corners are tracked; `--fit-masks` takes the smallest rectangle around it"
    )]
    Masks {
        /// What it is.
        what: &'static str,
    },
    /// Ground truth without frames.
    #[error("no frames ({} files) for the ground truth; add them", image_formats())]
    NoFrames,
    /// Nothing that was given as results belongs to a sequence.
    #[error(
        "no results: none of the {files} files here is called after a sequence of the data (such as `{example}`); expected \
         {expected}, each with .txt, .csv or .bin"
    )]
    NoResults {
        /// Files that may be results.
        files: usize,
        /// Name of a sequence.
        example: String,
        /// The layouts.
        expected: String,
    },
    /// Two files of the same results.
    #[error("results of {tracker} on {sequence}, as `{}` has; give one of them", other.display())]
    TwoResults {
        /// The other file.
        other: PathBuf,
        /// Name of the tracker.
        tracker: String,
        /// Name of the sequence.
        sequence: String,
    },
    /// A tracker's results have two forms.
    #[error(
        "boxes, while `{}`, by {tracker} as well, has corners; boxes are scored by fewer metrics, so give them apart, or \
         another name",
        other.display()
    )]
    BoxesAndCorners {
        /// A file with corners.
        other: PathBuf,
        /// Name of the tracker.
        tracker: String,
    },
    /// Fewer rows of results than frames, and it is not known which.
    #[error(
        "{rows} rows for {frames} frames, and the first is not the region that the tracker was started on; \
         --first-frame-included no if rows begin with the second frame, yes if the last frames are missing"
    )]
    FirstFrame {
        /// Rows.
        rows: usize,
        /// Frames.
        frames: usize,
    },
    /// More rows of results than frames.
    #[error(
        "{rows} rows for {frames} frames; give results of this data, with the --frame-gap and --max-frames that they were \
         made with"
    )]
    MoreResults {
        /// Rows.
        rows: usize,
        /// Frames.
        frames: usize,
    },
    /// Rows of nine numbers, or of three.
    #[error(
        "looks like homographies; say which way they go: --homographies from-first (points of the first frame to this one) or \
         to-first"
    )]
    Homographies,
    /// Rows that name other frames.
    #[error(
        "none of its rows is for one of the {frames} frames of the sequence ({rows} name others); give results of this data"
    )]
    OtherFrames {
        /// Rows with other names.
        rows: usize,
        /// Frames.
        frames: usize,
    },
    /// Results of a protocol that starts trackers anew.
    #[error(
        "results of an experiment that starts the tracker anew after failures, which is not one pass; give those of an \
         unsupervised or long-term experiment"
    )]
    Restarted,
    /// A frame log that cannot be read.
    #[error("a damaged frame log ({reason}); give the run's own copy, or run it again")]
    FrameLog {
        /// What is wrong.
        reason: String,
    },
    /// Compressed bytes that are damaged.
    #[error("damaged compressed bytes ({reason}); give the file as it was written")]
    Packed {
        /// What is wrong.
        reason: String,
    },
    /// A binary trajectory that ends early.
    #[error("the binary trajectory ends in region {row}; give the whole file")]
    ShortTrajectory {
        /// Region, from 1.
        row: usize,
    },
    /// A mask.
    #[error("region {row} is a mask, which has no corners; give polygons or boxes")]
    MaskResult {
        /// Region, from 1.
        row: usize,
    },
    /// A point, or what is not known.
    #[error("region {row} is neither a box nor a polygon; give polygons of four corners or boxes")]
    OtherRegion {
        /// Region, from 1.
        row: usize,
    },
    /// The ground truth is no text.
    #[error("not a text file; ground truth is a line of numbers per frame")]
    NotText,
    /// The ground truth has no rows.
    #[error("no rows of ground truth; write a line of 8 corner coordinates per frame")]
    NoRows,
    /// The format has no rows of this many numbers.
    #[error("rows of {numbers} numbers; expected {expected}")]
    UnknownRows {
        /// Numbers in most rows.
        numbers: usize,
        /// What rows of the format hold.
        expected: String,
    },
    /// A row has another number of numbers than its kind asks for.
    #[error("{found} numbers instead of {expected}; complete the row")]
    WrongCount {
        /// Numbers in the row.
        found: usize,
        /// Numbers that it should have.
        expected: usize,
    },
    /// A word where a number should be.
    #[error(
        "`{word}` is not a number; correct the row, or write `nan` for all of its numbers (the object is absent)"
    )]
    NotANumber {
        /// The word.
        word: String,
    },
    /// A coordinate is NaN or infinite.
    #[error(
        "a coordinate is not finite; correct the row, or write `nan` for all of its numbers (the object is absent)"
    )]
    NotFinite,
    /// A coordinate is farther away than any image is large.
    #[error("a coordinate is beyond {MAX_COORDINATE} px; correct the row")]
    TooFar,
    /// All corners lie on one line or point.
    #[error(
        "the quadrilateral has zero area; correct the row, or write 0 for all of its numbers (the object is absent)"
    )]
    ZeroArea,
    /// The corners do not make a convex quadrilateral.
    #[error("the quadrilateral is not convex; give the corners in the order UL UR LR LL")]
    NotConvex,
    /// A corner of the first frame lies outside the image.
    #[error(
        "a corner of the initial quadrilateral lies outside the {width}x{height} image; the part inside is tracked without `--strict`"
    )]
    InitialOutside {
        /// Width of the image in pixels.
        width: usize,
        /// Height of the image in pixels.
        height: usize,
    },
    /// All of the first frame's quadrilateral lies outside the image.
    #[error(
        "the initial quadrilateral lies outside the {width}x{height} image; correct the row, or remove the frames before the object shows"
    )]
    InitialAway {
        /// Width of the image in pixels.
        width: usize,
        /// Height of the image in pixels.
        height: usize,
    },
    /// The frame where tracking starts has no corners.
    #[error(
        "the first frame `{frame}` is not annotated; annotate it, or remove the frames before the first with corners"
    )]
    NoInitialTruth {
        /// Name of the frame.
        frame: String,
    },
    /// A frame has no row.
    #[error(
        "no row for frame `{frame}`; add it (a frame without annotation needs a row with a word such as `unannotated`)"
    )]
    MissingRow {
        /// Name of the frame.
        frame: String,
    },
    /// Fewer rows than frames.
    #[error(
        "{rows} rows of ground truth for {frames} frames; add the missing rows, or say in the command or in `meta.json` which frames they are for: {hints}"
    )]
    FewerRows {
        /// Rows in the file.
        rows: usize,
        /// Frames in the folder.
        frames: usize,
        /// Which options would say so.
        hints: String,
    },
    /// More rows than frames.
    #[error(
        "{rows} rows of ground truth for {frames} frames; add the missing frames, or remove rows, or say which frame the first row is for: --truth-start, or `meta.json`"
    )]
    MoreRows {
        /// Rows in the file.
        rows: usize,
        /// Frames in the folder.
        frames: usize,
    },
    /// More frames than rows, and some are there twice.
    #[error("{rows} rows of ground truth for {frames} frames, and {shared}")]
    TwiceTheFrames {
        /// Rows in the file.
        rows: usize,
        /// Frames in the folder.
        frames: usize,
        /// Which two.
        shared: String,
    },
    /// A row is for a frame that is not there.
    #[error(
        "this row is for frame {number}, which is not there{}; add the frame, or leave its row out with --on-bad-data skip", likewise(*.others, "row")
    )]
    LostFrame {
        /// The number that it would have.
        number: u64,
        /// Further rows of which the same is true.
        others: usize,
    },
    /// Rows are for frames after the last.
    #[error(
        "from here on {rows} rows are for frames after the last, {last}; remove them, or leave them out with --on-bad-data skip"
    )]
    SurplusRows {
        /// How many.
        rows: usize,
        /// Number of the last frame.
        last: u64,
    },
    /// Where the rows are said to begin there is no frame.
    #[error(
        "the first row cannot be for frame {start}: the frames are numbered from {first} to {last}; correct --truth-start or `truth_start` in `meta.json`"
    )]
    NoFrameOfNumber {
        /// Number of the frame that the first row should be for.
        start: u64,
        /// Number of the first frame.
        first: u64,
        /// Number of the last frame.
        last: u64,
    },
    /// Blank lines are taken as rows.
    #[error(
        "{blank} blank lines are taken as frames without annotation; write `nan` for each number if they are"
    )]
    BlankRows {
        /// How many.
        blank: usize,
    },
    /// Frames may be missing.
    #[error(
        "the numbers of frames jump from `{before}` to `{after}` ({others} more jumps); check that no frame is missing"
    )]
    NumberGap {
        /// The frame before the first gap.
        before: String,
        /// The frame after it.
        after: String,
        /// Further gaps.
        others: usize,
    },
    /// Two frames have the same number.
    #[error("the frames `{first}` and `{second}` have the same number; keep one of them")]
    SharedNumber {
        /// One.
        first: String,
        /// The other.
        second: String,
    },
    /// Names could be ordered in two ways.
    #[error(
        "frames are ordered by decimal numbers, so that `{first}` comes before `{second}`; give names that leave no doubt, such as 00001"
    )]
    DecimalNames {
        /// A frame.
        first: String,
        /// One that comes after it, though its digits say otherwise.
        second: String,
    },
    /// Tracking starts on a later frame than the first.
    #[error(
        "no ground truth before frame `{frame}`: tracking starts there; annotate the frames before it to start earlier"
    )]
    LateStart {
        /// Name of the first frame with ground truth.
        frame: String,
    },
    /// A row may mean several frames.
    #[error("`{frame}` may be `{first}` or `{second}`; write the whole name")]
    AmbiguousFrame {
        /// Name in the row.
        frame: String,
        /// A frame.
        first: String,
        /// Another.
        second: String,
    },
    /// A row names a frame that is not there.
    #[error("there is no frame `{frame}`; add it or remove the row")]
    UnknownFrame {
        /// Name in the row.
        frame: String,
    },
    /// Two rows name the same frame.
    #[error("a second row for frame `{frame}`; remove one")]
    DuplicateRow {
        /// Name in the row.
        frame: String,
    },
    /// A frame cannot be decoded.
    #[error("{0}")]
    Image(ImageError),
    /// A frame has another size than the first.
    #[error(
        "the frame is {width}x{height} pixels but the first is {first_width}x{first_height}; make all frames of one size"
    )]
    SizeMismatch {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Width of the first frame in pixels.
        first_width: usize,
        /// Height of the first frame in pixels.
        first_height: usize,
    },
    /// A frame was replaced while it was in use.
    #[error("the file has changed since the run began; run again")]
    Changed,
    /// Frames that are read all the same, the first of which it is.
    #[error("{remark}{}", likewise(.frames.saturating_sub(1), "frame"))]
    Remark {
        /// What is out of the ordinary.
        remark: Remark,
        /// Number of such frames in the sequence.
        frames: usize,
    },
    /// `meta.json` cannot be understood.
    #[error(
        "bad metadata ({detail}); expected {{\"tags\": [\"word\", ...], \"origin\": 0, 0.5, 1 or 1.5, \"box\": \"xywh\", \"xyxy\" or \"cxcywh\", \"truth_start\": number of a frame, \"truth_step\": 1 or more}}"
    )]
    BadMeta {
        /// What the parser met.
        detail: String,
    },
    /// Something that is well formed and yet looks wrong.
    #[error("{fault}; {remedy}")]
    Doubtful {
        /// What looks wrong, and in which frame.
        fault: String,
        /// What to do about it.
        remedy: String,
    },
    /// Something else that breaks the rules of the format.
    #[error("{fault}; {remedy}")]
    Format {
        /// What is wrong.
        fault: String,
        /// What to do about it.
        remedy: String,
    },
    /// The selection of frames leaves none.
    #[error(
        "no frame left: the selection starts at frame {start} and the sequence has {frames}; start earlier"
    )]
    NothingSelected {
        /// First selected frame, from 0.
        start: usize,
        /// Frames in the sequence.
        frames: usize,
    },
}

fn not_searched(deeper: Option<&Path>) -> String {
    deeper.map_or(String::new(), |path| {
        format!(
            " (deeper ones such as `{}` were not searched: give one of them)",
            path.display()
        )
    })
}

fn in_brackets(text: Option<&str>) -> String {
    text.map_or(String::new(), |text| format!(" ({text})"))
}

// Messages hold those of their causes, so causes are not chained: a report would say everything twice.

impl From<std::io::Error> for DatasetErrorKind {
    fn from(error: std::io::Error) -> Self {
        Refused::of(&error).map_or_else(|| DatasetErrorKind::Io(error), DatasetErrorKind::Refused)
    }
}

impl DatasetErrorKind {
    /// [`SameText`](Self::SameText) of a name in a folder and the path of another.
    pub(super) fn same_text(name: &OsStr, path: &Path) -> Self {
        // Bytes that are not UTF-8 show as escapes.
        DatasetErrorKind::SameText {
            first: format!("{name:?}"),
            second: format!("{:?}", path.file_name().unwrap_or_default()),
        }
    }
}

/// How many others there are besides the one that is named.
fn likewise(others: usize, what: &str) -> String {
    match others {
        0 => String::new(),
        1 => format!(" (1 more {what} likewise)"),
        n => format!(" ({n} more {what}s likewise)"),
    }
}

impl From<ImageError> for DatasetErrorKind {
    fn from(error: ImageError) -> Self {
        DatasetErrorKind::Image(error)
    }
}
