//! Reading ground truth text in any of its forms.
//!
//! A form is one file here and one line in [`FORMS`].

mod box4;
mod corners8;
mod mtf_text;
mod vot_polygon;

use super::{DatasetError, DatasetErrorKind};
use mtf::geom::Corners;
use std::collections::BTreeMap;
use std::path::Path;

/// A form of ground truth text: what a row holds and what it means.
struct Form {
    name: &'static str,
    /// The first column names the frame; otherwise rows follow the order of frames.
    named: bool,
    /// Numbers in a row.
    numbers: usize,
    /// Corners in pixels, pixel centres at integers.
    corners: fn(&[f64]) -> Corners,
}

/// Every form; the first one whose rows look like the file's is taken.
const FORMS: &[Form] = &[mtf_text::FORM, corners8::FORM, box4::FORM, vot_polygon::FORM];

/// From a pixel's corner, where some formats have their origin, to its centre.
const CORNER_TO_CENTRE: f64 = -0.5;

/// Quadrilaterals of which every three corners span less than this are lines (px²).
const MIN_AREA: f64 = 1e-6;

/// Ground truth of a sequence, as far as it is valid, and everything that is wrong with it.
#[derive(Debug, Default)]
pub(super) struct Truth {
    /// Per frame; `None` where there is no annotation or a faulty one.
    pub corners: Vec<Option<Corners>>,
    /// Line of each frame's row, from 1.
    pub lines: Vec<Option<usize>>,
    /// In order of lines.
    pub faults: Vec<DatasetError>,
}

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

/// Reads `bytes` of the file `path` as ground truth of the frames called `frames`; `form` is what the layout says its
/// form is.
pub(super) fn parse(bytes: &[u8], path: &Path, frames: &[&str], form: Option<&str>) -> Truth {
    let mut truth = Truth {
        corners: vec![None; frames.len()],
        lines: vec![None; frames.len()],
        faults: Vec::new(),
    };
    if let Err(fault) = parse_into(bytes, path, frames, form, &mut truth) {
        truth.faults.push(fault);
    }
    truth
}

fn parse_into(
    bytes: &[u8],
    path: &Path,
    frames: &[&str],
    form: Option<&str>,
    truth: &mut Truth,
) -> Result<(), DatasetError> {
    let text = std::str::from_utf8(bytes).map_err(|_| DatasetError::new(path, DatasetErrorKind::NotText))?;
    let mut rows: Vec<Row<'_>> = text
        .trim_start_matches('\u{feff}')
        .lines()
        .enumerate()
        .map(|(i, line)| {
            let words = line
                .split([' ', '\t', ',', ';', '\r'])
                .filter(|w| !w.is_empty())
                .collect();
            Row { line: i + 1, words }
        })
        .filter(|row| !row.words.is_empty() && !row.words[0].starts_with('#'))
        .collect();
    let form = choose_form(&rows, form).map_err(|(line, kind)| match line {
        Some(line) => DatasetError::at_line(path, line, kind),
        None => DatasetError::new(path, kind),
    })?;
    if is_header(&rows[0], form) {
        rows.remove(0);
    }
    if form.named {
        match_by_name(&rows, form, path, frames, truth);
    } else {
        match_by_order(&rows, form, path, frames, truth);
    }
    Ok(())
}

/// The first row is a header: it has no numbers and names no frame.
fn is_header(row: &Row<'_>, form: &Form) -> bool {
    let names_frame = row.words[0].contains(|c: char| c.is_ascii_digit());
    !(row.has_number() || form.named && names_frame)
}

/// The form whose name is given if the rows fit it, otherwise the first that most rows fit.
fn choose_form(
    rows: &[Row<'_>],
    name: Option<&str>,
) -> Result<&'static Form, (Option<usize>, DatasetErrorKind)> {
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
    let fits = |form: &Form| form.named == named && form.numbers == numbers;
    let chosen = FORMS
        .iter()
        .filter(|form| Some(form.name) == name)
        .find(|form| fits(form));
    chosen
        .or_else(|| FORMS.iter().find(|form| fits(form)))
        .ok_or((Some(line), DatasetErrorKind::UnknownForm { numbers }))
}

fn match_by_order(rows: &[Row<'_>], form: &Form, path: &Path, frames: &[&str], truth: &mut Truth) {
    for (i, row) in rows.iter().enumerate().take(frames.len()) {
        truth.lines[i] = Some(row.line);
        match read_row(&row.words, form) {
            Ok(corners) => truth.corners[i] = Some(corners),
            Err(kind) => truth.faults.push(DatasetError::at_line(path, row.line, kind)),
        }
    }
    let counts = (rows.len(), frames.len());
    if let Some(row) = rows.get(frames.len()) {
        let kind = DatasetErrorKind::MoreRows {
            rows: counts.0,
            frames: counts.1,
        };
        truth.faults.push(DatasetError::at_line(path, row.line, kind));
    } else if let (Some(frame), Some(last)) = (frames.get(rows.len()), rows.last()) {
        let kind = DatasetErrorKind::FewerRows {
            rows: counts.0,
            frames: counts.1,
            frame: frame.to_string(),
        };
        truth.faults.push(DatasetError::at_line(path, last.line, kind));
    }
}

fn match_by_name(rows: &[Row<'_>], form: &Form, path: &Path, frames: &[&str], truth: &mut Truth) {
    let stem = |name: &str| name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_string();
    let by_name: BTreeMap<&str, usize> = frames.iter().enumerate().map(|(i, &f)| (f, i)).collect();
    let by_stem: BTreeMap<String, usize> = frames.iter().enumerate().map(|(i, f)| (stem(f), i)).collect();
    for row in rows {
        let (name, words) = (row.words[0], &row.words[1..]);
        let mut fault = |kind| truth.faults.push(DatasetError::at_line(path, row.line, kind));
        // The extension may differ: ground truth outlives a conversion of the frames.
        let Some(&i) = by_name.get(name).or_else(|| by_stem.get(&stem(name))) else {
            fault(DatasetErrorKind::UnknownFrame {
                frame: name.to_string(),
            });
            continue;
        };
        if truth.lines[i].is_some() {
            fault(DatasetErrorKind::DuplicateRow {
                frame: name.to_string(),
            });
            continue;
        }
        truth.lines[i] = Some(row.line);
        if !words.is_empty() && words.iter().all(|w| w.parse::<f64>().is_err()) {
            continue; // such as `tracker_failed`: not annotated
        }
        match read_row(words, form) {
            Ok(corners) => truth.corners[i] = Some(corners),
            Err(kind) => fault(kind),
        }
    }
    for (frame, _) in frames.iter().zip(&truth.lines).filter(|(_, line)| line.is_none()) {
        truth.faults.push(DatasetError::new(
            path,
            DatasetErrorKind::MissingRow {
                frame: frame.to_string(),
            },
        ));
    }
}

fn read_row(words: &[&str], form: &Form) -> Result<Corners, DatasetErrorKind> {
    let mut numbers = Vec::with_capacity(words.len());
    for word in words {
        let number = word.parse::<f64>();
        numbers.push(number.map_err(|_| DatasetErrorKind::NotANumber {
            word: word.to_string(),
        })?);
    }
    if numbers.len() != form.numbers {
        return Err(DatasetErrorKind::WrongCount {
            found: numbers.len(),
            expected: form.numbers,
        });
    }
    let corners = (form.corners)(&numbers);
    check_quad(&corners)?;
    Ok(corners)
}

fn check_quad(corners: &Corners) -> Result<(), DatasetErrorKind> {
    if !corners.is_finite() {
        return Err(DatasetErrorKind::NotFinite);
    }
    let c = &corners.0;
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

#[cfg(test)]
mod tests {
    use super::*;

    const QUAD: &str = "10 20 30 21 31 40 9 39";

    fn quad() -> Corners {
        Corners::from_array([10.0, 20.0, 30.0, 21.0, 31.0, 40.0, 9.0, 39.0])
    }

    fn read(text: &str, frames: &[&str]) -> Truth {
        parse(text.as_bytes(), Path::new("gt"), frames, None)
    }

    #[test]
    fn mtf_text_matches_rows_by_name() {
        let text = format!(
            "frame\tulx\tuly\turx\tury\tlrx\tlry\tllx\tlly\r\nframe7.jpg\t{}\r\nframe2.jpg tracker_failed\n\nframe1.png {QUAD}",
            QUAD.replace(' ', "\t")
        );
        let truth = read(&text, &["frame1.jpg", "frame2.jpg", "frame7.jpg"]);
        assert!(truth.faults.is_empty(), "{:?}", truth.faults);
        assert_eq!(truth.corners, [Some(quad()), None, Some(quad())]);
        assert_eq!(truth.lines, [Some(5), Some(3), Some(2)]);
    }

    #[test]
    fn plain_rows_follow_the_frames() {
        for separator in [" ", ",", "\t", ", ", ";"] {
            let row = QUAD.replace(' ', separator);
            let truth = read(&format!("{row}\n{row}\n"), &["a.png", "b.png"]);
            assert_eq!((truth.corners, truth.faults.len()), (vec![Some(quad()); 2], 0));
        }
        let truth = read(&format!("x1,y1,x2,y2,x3,y3,x4,y4\n{QUAD}\n"), &["a.png"]);
        assert_eq!((truth.corners, truth.lines), (vec![Some(quad())], vec![Some(2)]));
    }

    #[test]
    fn forms_with_the_origin_at_the_corner_are_shifted() {
        let truth = read("10.5,20.5,30,40\n", &["a.png"]);
        assert_eq!(truth.corners, [Some(Corners::rect(10.0, 20.0, 30.0, 40.0))]);
        let truth = parse(QUAD.as_bytes(), Path::new("gt"), &["a.png"], Some("vot-polygon"));
        assert_eq!(truth.corners, [Some(quad().translated(-0.5, -0.5))]);
        // A box in a VOT folder stays a box.
        let truth = parse(
            b"10.5 20.5 30 40",
            Path::new("gt"),
            &["a.png"],
            Some("vot-polygon"),
        );
        assert_eq!(truth.corners, [Some(Corners::rect(10.0, 20.0, 30.0, 40.0))]);
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
            let truth = read(&format!("{good}{bad}{good}"), &frames);
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
            let truth = parse(text, Path::new("gt"), &frames, None);
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
        let truth = read(&text, &["f1.jpg", "f2.jpg", "f3.jpg", "f4.jpg"]);
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

    #[test]
    fn form_names_are_unique() {
        let names: std::collections::BTreeSet<_> = FORMS.iter().map(|f| f.name).collect();
        assert_eq!(names.len(), FORMS.len());
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_without_panic(text in "[f0-9a. ,\n-]{0,200}", n in 0usize..5) {
            let names: Vec<String> = (0..n).map(|i| format!("f{i}.png")).collect();
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let truth = read(&text, &names);
            proptest::prop_assert_eq!(truth.corners.len(), n);
        }
    }
}
