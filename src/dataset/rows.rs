//! Ground truth in rows of numbers: a row per frame, in the order of frames or after the frame's name.
//!
//! What the numbers of a row mean is a [`RowKind`]; a format names those that its files may have. Numbers are separated by
//! blanks, tabs, commas or semicolons; empty lines and lines that begin with `#` are skipped, and so is a header.

use super::annotation::{Annotations, Region};
use super::format::TruthFile;
use super::storage::File;
use super::{DatasetError, DatasetErrorKind};
use mtf::geom::Corners;
use std::collections::BTreeMap;

/// What a row of numbers holds and means.
#[derive(Clone, Copy, Debug)]
pub struct RowKind {
    /// What it holds, for messages: `a box of 4 (x y w h)`.
    pub about: &'static str,
    /// The first column names the frame; otherwise rows follow the order of frames.
    pub named: bool,
    /// Numbers in a row.
    pub numbers: usize,
    /// Corners in px, pixel centres at integers, from that many numbers.
    pub corners: fn(&[f64]) -> Corners,
}

/// From the corner of a pixel, where some formats have their origin, to its centre, px.
pub const PIXEL_CORNER: f64 = -0.5;

/// `ulx uly urx ury lrx lry llx lly`, pixel centres at integers.
pub const CORNERS: RowKind = RowKind {
    about: "8 corner coordinates (UL UR LR LL)",
    named: false,
    numbers: 8,
    corners: |v| Corners([[v[0], v[1]], [v[2], v[3]], [v[4], v[5]], [v[6], v[7]]]),
};

/// `x y width height`, the origin at the corner of the first pixel.
pub const BOX: RowKind = RowKind {
    about: "a box of 4 (x y w h)",
    named: false,
    numbers: 4,
    // A negative extent is no extent: such a box has zero area. NaN stays NaN.
    corners: |v| {
        let extent = |e: f64| if e < 0.0 { 0.0 } else { e };
        Corners::rect(
            v[0] + PIXEL_CORNER,
            v[1] + PIXEL_CORNER,
            extent(v[2]),
            extent(v[3]),
        )
    },
};

/// The name of the frame, then its corners as in [`CORNERS`]. A word in place of the numbers (`tracker_failed`) leaves the
/// frame without annotation.
pub const NAMED_CORNERS: RowKind = RowKind {
    about: "a frame name and 8 coordinates",
    named: true,
    ..CORNERS
};

/// The kinds that can be told apart by how many numbers they have and whether a name comes first.
pub const ANY: &[RowKind] = &[CORNERS, BOX, NAMED_CORNERS];

struct Row<'a> {
    line: usize,
    words: Vec<&'a str>,
}

impl Row<'_> {
    fn has_number(&self) -> bool {
        self.words.iter().any(|w| w.parse::<f64>().is_ok())
    }
    fn starts_with_name(&self) -> bool {
        self.words[0].parse::<f64>().is_err()
    }
}

/// The words of a text between blanks, tabs, commas, semicolons and ends of lines.
pub fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split([' ', '\t', ',', ';', '\r', '\n'])
        .filter(|word| !word.is_empty())
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

/// Reads the rows of `file` as annotations of `frames`, each with its index: `enumerate()` of all frames, or `.step_by(2)`
/// of that when every second frame has a row. Most rows tell which of `kinds` they are; of several that fit, the first is
/// taken. Rows and frames that do not match are faults.
///
/// # Errors
/// No text, no rows, or rows of no kind.
pub fn read<'a>(
    file: &TruthFile,
    kinds: &[RowKind],
    frames: impl IntoIterator<Item = (usize, &'a File)>,
    annotations: &mut Annotations,
) -> Result<(), DatasetError> {
    let mut rows: Vec<Row<'_>> = file
        .text()?
        .lines()
        .zip(1..)
        .map(|(text, line)| Row {
            line,
            words: words(text).collect(),
        })
        .filter(|row| !row.words.is_empty() && !row.words[0].starts_with('#'))
        .collect();
    let kind = choose(&rows, kinds).map_err(|(line, kind)| match line {
        Some(line) => file.at_line(line).fault(kind),
        None => file.fault(kind),
    })?;
    if is_header(&rows[0], kind) {
        rows.remove(0);
    }
    let frames: Vec<(usize, &str)> = frames.into_iter().map(|(i, f)| (i, f.name())).collect();
    if kind.named {
        match_by_name(&rows, kind, file, &frames, annotations);
    } else {
        match_by_order(&rows, kind, file, &frames, annotations);
    }
    Ok(())
}

/// The first row is a header: it has no numbers and names no frame.
fn is_header(row: &Row<'_>, kind: &RowKind) -> bool {
    let names_frame = row.words[0].contains(|c: char| c.is_ascii_digit());
    !(row.has_number() || kind.named && names_frame)
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
    let fits = |kind: &&RowKind| kind.named == named && kind.numbers == numbers;
    kinds.iter().find(fits).ok_or_else(|| {
        let about: Vec<&str> = kinds.iter().map(|kind| kind.about).collect();
        let expected = match &about[..] {
            [several @ .., last] if !several.is_empty() => format!("{}, or {last}", several.join(", ")),
            few => few.concat(),
        };
        (Some(line), DatasetErrorKind::UnknownRows { numbers, expected })
    })
}

fn region(words: &[&str], kind: &RowKind) -> Result<Region, DatasetErrorKind> {
    let numbers = numbers(words, kind.numbers)?;
    Ok(Region::Corners((kind.corners)(&numbers)))
}

fn match_by_order(
    rows: &[Row<'_>],
    kind: &RowKind,
    file: &TruthFile,
    frames: &[(usize, &str)],
    annotations: &mut Annotations,
) {
    for (row, &(i, _)) in rows.iter().zip(frames) {
        annotations.set(i, file.at_line(row.line), region(&row.words, kind));
    }
    let counts = (rows.len(), frames.len());
    if let Some(row) = rows.get(frames.len()) {
        annotations.fault(file.at_line(row.line).fault(DatasetErrorKind::MoreRows {
            rows: counts.0,
            frames: counts.1,
        }));
    } else if let (Some((_, frame)), Some(last)) = (frames.get(rows.len()), rows.last()) {
        annotations.fault(file.at_line(last.line).fault(DatasetErrorKind::FewerRows {
            rows: counts.0,
            frames: counts.1,
            frame: frame.to_string(),
        }));
    }
}

fn match_by_name(
    rows: &[Row<'_>],
    kind: &RowKind,
    file: &TruthFile,
    frames: &[(usize, &str)],
    annotations: &mut Annotations,
) {
    let stem = |name: &str| name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_string();
    let by_name: BTreeMap<&str, usize> = frames.iter().map(|&(i, name)| (name, i)).collect();
    let by_stem: BTreeMap<String, usize> = frames.iter().map(|&(i, name)| (stem(name), i)).collect();
    for row in rows {
        let (name, words) = (row.words[0], &row.words[1..]);
        let location = file.at_line(row.line);
        // The extension may differ: ground truth outlives a conversion of the frames.
        let Some(&i) = by_name.get(name).or_else(|| by_stem.get(&stem(name))) else {
            annotations.fault(location.fault(DatasetErrorKind::UnknownFrame {
                frame: name.to_string(),
            }));
            continue;
        };
        if annotations.is_set(i) {
            annotations.fault(location.fault(DatasetErrorKind::DuplicateRow {
                frame: name.to_string(),
            }));
            continue;
        }
        // A word such as `tracker_failed`: not annotated.
        let only_words = !words.is_empty() && words.iter().all(|w| w.parse::<f64>().is_err());
        let said = if only_words {
            Ok(Region::Unknown)
        } else {
            region(words, kind)
        };
        annotations.set(i, location, said);
    }
    for &(i, frame) in frames {
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
            corners: |v| (CORNERS.corners)(v).translated(PIXEL_CORNER, PIXEL_CORNER),
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
            ("1 2 3 inf 5 6 7 8\n", "gt:2: a coordinate is not finite"),
            ("5 5 5 5 5 5 5 5\n", "gt:2: the quadrilateral has zero area"),
            ("0 0 5 5 9 9 7 7\n", "gt:2: the quadrilateral has zero area"),
            ("0 0 9 0 0 9 9 9\n", "gt:2: the quadrilateral is not convex"),
            ("", "gt:2: 2 rows of ground truth for 3 frames, `c.png` and later"),
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
