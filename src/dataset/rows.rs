//! Ground truth in rows of numbers: a row per frame, in the order of frames or after the frame's name.
//!
//! What the numbers of a row mean is a [`RowKind`]; a format names those that its files may have. Numbers are separated by
//! blanks, tabs, commas, semicolons, brackets or marks of quotation; lines that begin with `#`, `%` or `//` are
//! skipped, and so is a header. A row of separators alone leaves its frame without annotation; so does a blank line, where
//! frames and rows are as many only with it. All numbers NaN, 0 or -1, or a word such as `absent`, say that the object cannot
//! be seen.

use super::annotation::{Annotations, Region};
use super::format::TruthFile;
use super::matching::{self, Line};
use super::names::FrameNames;
use super::reading::{BoxForm, Origin};
use super::storage::File;
use super::text::{self, is_number};
use super::{DatasetError, DatasetErrorKind};
use mtf::geom::Corners;
use std::collections::BTreeMap;

pub use super::text::words;

/// What a row of numbers holds and means.
#[derive(Clone, Copy, Debug)]
pub struct RowKind {
    /// What it holds, for messages: `a box of 4 (x y w h)`.
    pub about: &'static str,
    /// The first column names the frame; otherwise rows follow the order of frames.
    pub named: bool,
    /// What the numbers are.
    pub shape: Shape,
    /// Where the first pixel is, unless something else is asked for.
    pub origin: Origin,
}

/// What the numbers of a row are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Four corners: `ulx uly urx ury lrx lry llx lly`.
    Quad,
    /// A box.
    Box(BoxForm),
}

impl RowKind {
    /// Numbers in a row.
    fn numbers(&self) -> usize {
        match self.shape {
            Shape::Quad => 8,
            Shape::Box(_) => 4,
        }
    }

    /// Corners in px, pixel centres at integers, of that many numbers.
    pub(super) fn corners(&self, numbers: &[f64]) -> Corners {
        match self.shape {
            Shape::Quad => self.origin.corners(numbers),
            Shape::Box(form) => form.corners(numbers, self.origin),
        }
    }
}

/// `ulx uly urx ury lrx lry llx lly`, pixel centres at integers.
pub const CORNERS: RowKind = RowKind {
    about: "8 corner coordinates (UL UR LR LL)",
    named: false,
    shape: Shape::Quad,
    origin: Origin::CENTRE,
};

/// `x y width height`, the origin at the corner of the first pixel.
pub const BOX: RowKind = RowKind {
    about: "a box of 4 (x y w h)",
    named: false,
    shape: Shape::Box(BoxForm::Xywh),
    origin: Origin::CORNER,
};

/// The name of the frame, then its corners as in [`CORNERS`]. A word in place of the numbers (`tracker_failed`) leaves the
/// frame without annotation.
pub const NAMED_CORNERS: RowKind = RowKind {
    about: "a frame name and 8 coordinates",
    named: true,
    ..CORNERS
};

/// The name of the frame, then its box as in [`BOX`].
pub const NAMED_BOX: RowKind = RowKind {
    about: "a frame name and a box",
    named: true,
    ..BOX
};

/// The kinds that can be told apart by how many numbers they have and whether a name comes first.
pub const ANY: &[RowKind] = &[CORNERS, BOX, NAMED_CORNERS, NAMED_BOX];

/// Words in place of numbers that say that the object cannot be seen.
const ABSENT: [&str; 14] = [
    "absent",
    "none",
    "null",
    "na",
    "n/a",
    "-",
    "invisible",
    "occluded",
    "full_occlusion",
    "fully_occluded",
    "out_of_view",
    "out-of-view",
    "outofview",
    "disappeared",
];

/// Words in place of numbers, where no name comes first, that say that nothing is known of the frame.
const UNANNOTATED: [&str; 4] = ["unannotated", "unknown", "tracker_failed", "not_annotated"];

fn is_one_of(word: &str, words: &[&str]) -> bool {
    words.iter().any(|w| w.eq_ignore_ascii_case(word))
}

/// A line that is no comment.
struct Row<'a> {
    line: usize,
    text: &'a str,
    words: Vec<&'a str>,
    /// The first number counts frames.
    indexed: bool,
    /// The first word is the name of a frame that is there.
    known: bool,
}

impl<'a> Row<'a> {
    fn new(text: &'a str, line: usize, names: &FrameNames<'_>) -> Self {
        let mut row = Row {
            line,
            text,
            words: text::row(text),
            indexed: false,
            known: false,
        };
        if row.words.first().is_some_and(|word| !is_number(word)) {
            // A name may have blanks in it, and parts that look like numbers.
            let is_name = |words: &usize| names.find(row.first(*words)).is_ok();
            if let Some(count) = (1..=row.words.len()).rev().find(is_name) {
                let name = row.first(count);
                row.words.splice(..count, [name]);
                row.known = true;
            }
        }
        row
    }

    /// The text of the first `words` words.
    fn first(&self, words: usize) -> &'a str {
        let begin = self.text.as_ptr() as usize;
        let word = |k: usize| (self.words[k].as_ptr() as usize - begin, self.words[k].len());
        let (from, (to, length)) = (word(0).0, word(words - 1));
        &self.text[from..to + length]
    }
    fn is_comment(&self) -> bool {
        let text = self.text.trim_start();
        text.starts_with(['#', '%']) || text.starts_with("//")
    }
    fn has_digit(&self) -> bool {
        self.words
            .iter()
            .any(|w| w.contains(|c: char| c.is_ascii_digit()))
    }
    fn has_number(&self) -> bool {
        self.words.iter().any(|w| is_number(w))
    }
    fn starts_with_name(&self) -> bool {
        self.indexed || !is_number(self.words[0])
    }
    /// A word that is known to stand in place of numbers.
    fn speaks(&self) -> bool {
        let known = |w: &&str| is_one_of(w, &ABSENT) || is_one_of(w, &UNANNOTATED);
        self.words.iter().all(known)
    }
    /// Separators stand where numbers should.
    fn ends_empty(&self) -> bool {
        self.text.trim_end().ends_with([',', ';'])
    }
}

impl Line for &Row<'_> {
    fn number(&self) -> usize {
        self.line
    }
    fn is_empty(&self) -> bool {
        self.words.is_empty()
    }
    fn is_blank(&self) -> bool {
        self.text.trim().is_empty()
    }
}

/// The numbers that `words` spell.
///
/// # Errors
/// A word that is no number, or not `expected` of them.
pub fn numbers(words: &[&str], expected: usize) -> Result<Vec<f64>, DatasetErrorKind> {
    let mut numbers = Vec::with_capacity(words.len());
    for word in words {
        let number = word.parse::<f64>();
        numbers.push(number.map_err(|_| DatasetErrorKind::NotANumber {
            word: word.to_string(),
        })?);
    }
    if numbers.len() != expected {
        return Err(DatasetErrorKind::WrongCount {
            found: numbers.len(),
            expected,
        });
    }
    Ok(numbers)
}

/// The names of the frames that the rows of `text` are for; places from 1 where they name none.
pub(super) fn frame_names(text: &str) -> Vec<String> {
    let nothing = FrameNames::new([]);
    let rows = text::lines(text)
        .zip(1..)
        .map(|(text, line)| Row::new(text, line, &nothing));
    let rows: Vec<Row<'_>> = rows
        .filter(|row| !row.is_comment() && !row.words.is_empty())
        .collect();
    let header = usize::from(rows.first().is_some_and(|row| !row.has_digit()));
    let named = |row: &Row<'_>| matches!(row.words.len(), 5 | 9) || !is_number(row.words[0]);
    let name = |(k, row): (usize, &Row<'_>)| match named(row) {
        true => row.words[0].to_owned(),
        false => (k + 1).to_string(),
    };
    rows[header..].iter().enumerate().map(name).collect()
}

/// Reads the rows of `file` as annotations of `frames`, each with its index: `enumerate()` of all frames, or `.step_by(2)`
/// of that when every second frame has a row. Most rows tell which of `kinds` they are; of several that fit, the first is
/// taken. Faulty rows, and rows and frames that lack their counterpart, are faults.
///
/// # Errors
/// No text, no rows, rows of no kind, or rows that cannot be matched with frames.
pub fn read<'a>(
    file: &TruthFile,
    kinds: &[RowKind],
    frames: impl IntoIterator<Item = (usize, &'a File)>,
    annotations: &mut Annotations,
) -> Result<(), DatasetError> {
    let (indices, frames): (Vec<usize>, Vec<&str>) = frames.into_iter().map(|(i, f)| (i, f.name())).unzip();
    let names = FrameNames::new(frames.iter().copied());
    let text = file.text()?;
    let mut rows: Vec<Row<'_>> = text::lines(&text)
        .zip(1..)
        .map(|(text, line)| Row::new(text, line, &names))
        .filter(|row| !row.is_comment())
        .collect();
    find_index(&mut rows, kinds);
    let kind = choose(&rows, kinds).map_err(|(line, kind)| match line {
        Some(line) => file.at_line(line).fault(kind),
        None => file.fault(kind),
    })?;
    if let Some(first) = rows.iter().position(|row| !row.words.is_empty())
        && is_header(&rows[first], kind)
    {
        rows.drain(..=first);
    }
    let kind = &as_asked(kind, annotations);
    if kind.named {
        match_by_name(&rows, kind, file, &indices, &names, annotations);
        return Ok(());
    }
    let rows: Vec<&Row<'_>> = rows.iter().collect();
    let placed = matching::in_order(&rows, file, &frames, annotations)?;
    for (row, frame) in &placed {
        let Some(frame) = frame else { continue };
        let said = match row.words.is_empty() {
            true => Ok(Region::Unknown),
            false => region(&row.words, kind),
        };
        annotations.set(indices[*frame], file.at_line(row.line), said);
    }
    annotations.rows = placed
        .iter()
        .map(|(_, frame)| frame.map(|i| indices[i]))
        .collect();
    Ok(())
}

/// `kind` with what is asked for in place of the usual; notes in `annotations` how the rows are read.
pub(super) fn as_asked(kind: &RowKind, annotations: &mut Annotations) -> RowKind {
    let (asked, mut kind) = (annotations.asked, *kind);
    kind.origin = asked.origin.unwrap_or(kind.origin);
    if let Shape::Box(form) = &mut kind.shape {
        *form = asked.boxes.unwrap_or(*form);
        annotations.boxes = Some(*form);
    }
    annotations.origin = kind.origin;
    kind
}

/// Notes a first column that counts frames: whole numbers that grow from row to row, in front of as many numbers as one of
/// the named `kinds` has.
fn find_index(rows: &mut [Row<'_>], kinds: &[RowKind]) {
    let is_named = |count: usize| kinds.iter().any(|k| k.named && k.numbers() + 1 == count);
    let is_plain = |count: usize| kinds.iter().any(|k| !k.named && k.numbers() == count);
    let index = |row: &&mut Row<'_>| row.words[0].parse::<u64>().ok();
    let mut rows: Vec<&mut Row<'_>> = rows.iter_mut().filter(|row| !row.words.is_empty()).collect();
    let header = usize::from(rows.first().is_some_and(|row| !row.has_number()));
    let Some(rows) = rows.get_mut(header..).filter(|rows| !rows.is_empty()) else {
        return;
    };
    let numbers = rows
        .iter()
        .filter(|row| row.has_number())
        .map(|row| row.words.len());
    let fits = |count| is_named(count) && !is_plain(count);
    let (all, fitting) = numbers.fold((0, 0), |(all, n), count| (all + 1, n + usize::from(fits(count))));
    let grows = rows.is_sorted_by(|a, b| index(a).is_some() && index(a) < index(b));
    if 2 * fitting > all && grows && index(&rows[0]).is_some() {
        rows.iter_mut().for_each(|row| row.indexed = true);
    }
}

/// The first row is a header: it has no numbers, names no frame and is no word that stands in place of numbers.
fn is_header(row: &Row<'_>, kind: &RowKind) -> bool {
    let names_frame = row.known || row.words[0].contains(|c: char| c.is_ascii_digit());
    !(row.has_number() || row.speaks() || kind.named && names_frame)
}

/// The first kind that most rows fit; else why there is none, and the line that shows it.
fn choose<'a>(
    rows: &[Row<'_>],
    kinds: &'a [RowKind],
) -> Result<&'a RowKind, (Option<usize>, DatasetErrorKind)> {
    let mut shapes = BTreeMap::new(); // (named, numbers) -> rows, first line
    for row in rows.iter().filter(|row| row.has_number()) {
        let named = row.starts_with_name();
        let shape = shapes
            .entry((named, row.words.len() - usize::from(named)))
            .or_insert((0, row.line));
        shape.0 += 1;
    }
    let most = shapes
        .iter()
        .max_by_key(|(shape, (count, _))| (*count, std::cmp::Reverse(**shape)));
    let Some((&(named, numbers), &(_, line))) = most else {
        return Err((None, DatasetErrorKind::NoRows));
    };
    let fits = |kind: &&RowKind| kind.named == named && kind.numbers() == numbers;
    kinds.iter().find(fits).ok_or_else(|| {
        let about: Vec<&str> = kinds.iter().map(|kind| kind.about).collect();
        let expected = match &about[..] {
            [several @ .., last] if !several.is_empty() => format!("{}, or {last}", several.join(", ")),
            few => few.concat(),
        };
        (Some(line), DatasetErrorKind::UnknownRows { numbers, expected })
    })
}

/// What the words of a row, without a name, say.
pub(super) fn region(words: &[&str], kind: &RowKind) -> Result<Region, DatasetErrorKind> {
    let all = |holds: &dyn Fn(&str) -> bool| !words.is_empty() && words.iter().all(|word| holds(word));
    if all(&|word| is_one_of(word, &ABSENT)) {
        return Ok(Region::Absent);
    }
    // After a name, any word says that it is not known: `tracker_failed`.
    if all(&|word| is_one_of(word, &UNANNOTATED)) || kind.named && all(&|word| !is_number(word)) {
        return Ok(Region::Unknown);
    }
    let numbers = numbers(words, kind.numbers())?;
    let nowhere = |n: &f64| n.is_nan() || [0.0, -1.0].contains(n);
    let same = |n: &f64| *n == numbers[0] || n.is_nan() && numbers[0].is_nan();
    if numbers.iter().all(|n| nowhere(n) && same(n)) {
        return Ok(Region::Absent);
    }
    Ok(Region::Corners(kind.corners(&numbers)))
}

fn match_by_name(
    rows: &[Row<'_>],
    kind: &RowKind,
    file: &TruthFile,
    indices: &[usize],
    names: &FrameNames<'_>,
    annotations: &mut Annotations,
) {
    let rows: Vec<&Row<'_>> = rows.iter().filter(|row| !row.words.is_empty()).collect();
    let counts: Option<Vec<u64>> = rows
        .iter()
        .map(|row| row.words[0].parse().ok().filter(|_| row.indexed))
        .collect();
    let counted = counts.map(|counts| matching::by_count(&counts, names));
    for (k, row) in rows.iter().enumerate() {
        let (name, words) = (row.words[0], &row.words[1..]);
        let location = file.at_line(row.line);
        let found = match &counted {
            Some(frames) => frames[k].ok_or_else(|| DatasetErrorKind::UnknownFrame {
                frame: name.to_string(),
            }),
            None => names.find(name),
        };
        let i = match found {
            Ok(frame) => indices[frame],
            Err(kind) => {
                annotations.fault(location.fault(kind));
                continue;
            }
        };
        if annotations.is_set(i) {
            annotations.fault(location.fault(DatasetErrorKind::DuplicateRow {
                frame: name.to_string(),
            }));
            continue;
        }
        let said = match words.is_empty() && row.ends_empty() {
            true => Ok(Region::Unknown),
            false => region(words, kind),
        };
        annotations.set(i, location, said);
    }
    for (&i, frame) in indices.iter().zip(names.names()) {
        if !annotations.is_set(i) {
            annotations.fault(file.fault(DatasetErrorKind::MissingRow {
                frame: frame.to_string(),
            }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::annotation::Annotation;
    use super::*;

    const QUAD: &str = "10 20 30 21 31 40 9 39";

    fn quad() -> Corners {
        Corners::from_array([10.0, 20.0, 30.0, 21.0, 31.0, 40.0, 9.0, 39.0])
    }

    fn read_as(text: &[u8], frames: &[&str], kinds: &[RowKind]) -> Annotations {
        let frames: Vec<File> = frames.iter().map(|name| File::of(name, vec![])).collect();
        let mut annotations = Annotations::new(frames.len());
        let file = TruthFile::of("gt", text.to_vec());
        if let Err(fault) = read(&file, kinds, frames.iter().enumerate(), &mut annotations) {
            annotations.fault(fault);
        }
        annotations
    }

    fn read_any(text: &str, frames: &[&str]) -> Annotations {
        read_as(text.as_bytes(), frames, ANY)
    }

    fn corners(annotations: &Annotations) -> Vec<Option<Corners>> {
        annotations.frames().iter().map(Annotation::corners).collect()
    }

    fn lines(annotations: &Annotations) -> Vec<Option<usize>> {
        let frames = annotations.frames().iter();
        frames.map(|a| a.location.as_ref()?.line).collect()
    }

    #[test]
    fn mtf_text_matches_rows_by_name() {
        let text = format!(
            "frame\tulx\tuly\turx\tury\tlrx\tlry\tllx\tlly\r\nframe7.jpg\t{}\r\nframe2.jpg tracker_failed\n\nframe1.png {QUAD}",
            QUAD.replace(' ', "\t")
        );
        let truth = read_any(&text, &["frame1.jpg", "frame2.jpg", "frame7.jpg"]);
        assert!(truth.faults.is_empty(), "{:?}", truth.faults);
        assert_eq!(corners(&truth), [Some(quad()), None, Some(quad())]);
        assert_eq!(lines(&truth), [Some(5), Some(3), Some(2)]);
    }

    #[test]
    fn plain_rows_follow_the_frames() {
        for separator in [" ", ",", "\t", ", ", ";"] {
            let row = QUAD.replace(' ', separator);
            let truth = read_any(&format!("{row}\n{row}\n"), &["a.png", "b.png"]);
            assert_eq!((corners(&truth), truth.faults.len()), (vec![Some(quad()); 2], 0));
        }
        let truth = read_any(&format!("x1,y1,x2,y2,x3,y3,x4,y4\n{QUAD}\n"), &["a.png"]);
        assert_eq!(
            (corners(&truth), lines(&truth)),
            (vec![Some(quad())], vec![Some(2)])
        );
    }

    #[test]
    fn kinds_with_the_origin_at_the_corner_are_shifted() {
        let truth = read_any("10.5,20.5,30,40\n", &["a.png"]);
        assert_eq!(corners(&truth), [Some(Corners::rect(10.0, 20.0, 30.0, 40.0))]);
        // Of two kinds that fit, the first is taken.
        let shifted = RowKind {
            origin: Origin::CORNER,
            ..CORNERS
        };
        let truth = read_as(QUAD.as_bytes(), &["a.png"], &[BOX, shifted, CORNERS]);
        assert_eq!(corners(&truth), [Some(quad().translated(-0.5, -0.5))]);
    }

    #[test]
    fn rows_may_be_those_of_some_frames() {
        let frames: Vec<File> = ["1.png", "2.png", "3.png"]
            .map(|name| File::of(name, vec![]))
            .into();
        for text in [
            format!("{QUAD}\n{QUAD}\n"),
            format!("3.jpg {QUAD}\n1.jpg {QUAD}\n"),
        ] {
            let mut annotations = Annotations::new(3);
            let file = TruthFile::of("gt", text.into_bytes());
            let every_second = frames.iter().enumerate().step_by(2);
            read(&file, ANY, every_second, &mut annotations).unwrap();
            assert!(annotations.faults().is_empty(), "{:?}", annotations.faults());
            assert_eq!(corners(&annotations), [Some(quad()), None, Some(quad())]);
        }
    }

    #[test]
    fn each_fault_is_found_once_with_its_line() {
        let good = format!("{QUAD}\n");
        let frames = ["a.png", "b.png", "c.png"];
        for (bad, message) in [
            ("1 2 3 4 5 6 7\n", "gt:2: 7 numbers instead of 8"),
            ("1 2 3 x 5 6 7 8\n", "gt:2: `x` is not a number"),
            ("1 2 3 nan 5 6 7 8\n", "gt:2: a coordinate is not finite"),
            ("nan nan nan nan\n", "gt:2: 4 numbers instead of 8"),
            ("gone\n", "gt:2: `gone` is not a number"),
            ("1 2 3 inf 5 6 7 8\n", "gt:2: a coordinate is not finite"),
            ("5 5 5 5 5 5 5 5\n", "gt:2: the quadrilateral has zero area"),
            ("0 0 5 5 9 9 7 7\n", "gt:2: the quadrilateral has zero area"),
            ("0 0 9 0 0 9 9 9\n", "gt:2: the quadrilateral is not convex"),
            ("", "gt:2: 2 rows of ground truth for 3 frames; add"),
            (&good.repeat(2), "gt:4: 4 rows of ground truth for 3 frames"),
        ] {
            let truth = read_any(&format!("{good}{bad}{good}"), &frames);
            let messages: Vec<String> = truth.faults.iter().map(|f| f.to_string()).collect();
            assert_eq!(messages.len(), 1, "{messages:?}");
            assert!(
                messages[0].starts_with(message) && messages[0].contains("; "),
                "{messages:?}"
            );
        }
        for (text, message) in [
            (&b""[..], "gt: no rows"),
            (b"\n\n", "gt: no rows"),
            (b"\xff\xfe\x00", "gt: not a text file"),
            (b"1 2 3 4 5 6 7\n1 2 3 4 5 6 7\n", "gt:1: rows of 7 numbers"),
        ] {
            let truth = read_as(text, &frames, ANY);
            assert_eq!(truth.faults.len(), 1);
            assert!(
                truth.faults[0].to_string().starts_with(message),
                "{}",
                truth.faults[0]
            );
        }
    }

    #[test]
    fn faults_of_named_rows() {
        let text =
            format!("f1.jpg {QUAD}\nf1.jpg {QUAD}\nf9.jpg {QUAD}\nf2.jpg 1 2 3 4 5 6 7 oops\nf3.jpg\n");
        let truth = read_any(&text, &["f1.jpg", "f2.jpg", "f3.jpg", "f4.jpg"]);
        let messages: Vec<String> = truth.faults.iter().map(|f| f.to_string()).collect();
        let starts = [
            "gt:2: a second row for frame `f1.jpg`",
            "gt:3: there is no frame `f9.jpg`",
            "gt:4: `oops` is not a number",
            "gt:5: 0 numbers instead of 8",
            "gt: no row for frame `f4.jpg`",
        ];
        assert_eq!(messages.len(), starts.len(), "{messages:?}");
        for (message, start) in messages.iter().zip(starts) {
            assert!(message.starts_with(start), "{message}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_without_panic(text in "[f0-9a. ,\n-]{0,200}", n in 0usize..5) {
            let names: Vec<String> = (0..n).map(|i| format!("f{i}.png")).collect();
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let truth = read_any(&text, &names);
            proptest::prop_assert_eq!(truth.frames().len(), n);
        }
    }
}
