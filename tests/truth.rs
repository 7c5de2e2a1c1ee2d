//! Ground truth as people have it: in many forms of text, with frames where the object cannot be seen, in other
//! conventions, and well formed but wrong.

use crate::runs::program;
use mtf::geom::Corners;
use mtf_eval::dataset::{
    self, BoxForm, Dataset, DatasetError, LoadOptions, OnBadData, Origin, Reading, Region, Sequence, Severity,
};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

crate::tests! {
    absent_rows_are_read_with_and_without_names;
    rows_of_nothing_known_are_refused_with_a_remedy_that_works;
    texts_of_every_kind_are_read;
    flags_beside_the_truth_make_frames_absent;
    flags_of_another_number_are_refused;
    tags_of_vot_are_words_about_frames;
    boxes_of_another_form_are_suspected;
    boxes_are_read_as_asked;
    fractions_are_suspected;
    x_and_y_exchanged_are_suspected;
    another_order_of_corners_is_suspected;
    corners_that_jump_are_suspected;
    a_start_without_texture_is_found_by_the_check;
    good_truth_gives_no_warning;
    a_start_partly_outside_is_tracked_unless_strict;
    the_origin_is_shown_and_can_be_given;
    every_year_of_vot_has_one_origin;
    many_faults_of_a_kind_are_one_line;
    a_run_repeats_warnings_in_one_line;
}

const FRAMES: usize = 12;
const SIZE: (u32, u32) = (160, 120);

/// Corners that turn, grow and move, px.
fn quad(k: usize) -> Corners {
    let (sin, cos) = (k as f64).to_radians().sin_cos();
    let scale = 1.0 + 0.004 * k as f64;
    let turned = |[x, y]: [f64; 2]| {
        let (u, v) = (x - 75.0, y - 60.0);
        [
            75.0 + scale * (cos * u - sin * v) + 1.6 * k as f64,
            60.0 + scale * (sin * u + cos * v) + 0.7 * k as f64,
        ]
    };
    Corners([[50.0, 40.0], [100.0, 40.0], [100.0, 80.0], [50.0, 80.0]].map(turned))
}

/// Box about [`quad`]: left, top, right, bottom, px.
fn bounds(k: usize) -> [f64; 4] {
    let c = quad(k).0;
    let least = |i: usize| c.iter().map(|p| p[i]).fold(f64::INFINITY, f64::min).round();
    let most = |i: usize| c.iter().map(|p| p[i]).fold(-f64::INFINITY, f64::max).round();
    [least(0), least(1), most(0), most(1)]
}

fn line(numbers: &[f64]) -> String {
    let words: Vec<String> = numbers.iter().map(|v| v.to_string()).collect();
    words.join(" ")
}

fn quads() -> Vec<String> {
    (0..FRAMES).map(|k| line(&quad(k).to_array())).collect()
}

fn xywh() -> Vec<String> {
    let row = |[l, t, r, b]: [f64; 4]| line(&[l, t, r - l, b - t]);
    (0..FRAMES).map(|k| row(bounds(k))).collect()
}

fn xyxy() -> Vec<String> {
    (0..FRAMES).map(|k| line(&bounds(k))).collect()
}

fn texture(x: u32, y: u32) -> u8 {
    (x * x * 7 + y * 13 + x * y * 3) as u8
}

/// Folder `data` that holds one sequence, `s`.
struct Data {
    root: TempDir,
    frames: PathBuf,
}

impl Data {
    /// Textured frames in `s/inner`.
    fn within(inner: &str) -> Data {
        Data::painted(inner, &texture)
    }

    fn new() -> Data {
        Data::within("")
    }

    fn painted(inner: &str, pixel: &dyn Fn(u32, u32) -> u8) -> Data {
        let root = tempfile::tempdir().unwrap();
        let frames = root.path().join("data/s").join(inner);
        fs::create_dir_all(&frames).unwrap();
        let image = image::GrayImage::from_fn(SIZE.0, SIZE.1, |x, y| image::Luma([pixel(x, y)]));
        image.save(frames.join("00001.png")).unwrap();
        for k in 2..=FRAMES {
            fs::copy(frames.join("00001.png"), frames.join(format!("{k:05}.png"))).unwrap();
        }
        Data { root, frames }
    }

    fn path(&self) -> PathBuf {
        self.root.path().join("data")
    }

    fn file(self, name: &str, content: impl AsRef<[u8]>) -> Data {
        fs::write(self.path().join("s").join(name), content).unwrap();
        self
    }

    fn truth(self, rows: &[String]) -> Data {
        self.file("groundtruth.txt", rows.join("\n") + "\n")
    }

    fn load_with(&self, options: &LoadOptions) -> Result<Dataset, DatasetError> {
        dataset::load(&self.path(), options)
    }

    fn sequence(&self) -> Sequence {
        self.load_with(&LoadOptions::default()).unwrap().sequences[0].clone()
    }

    /// What `data check` says, without the path of the sequence.
    fn checked(&self, options: &LoadOptions) -> Vec<(Severity, String)> {
        let here = format!("{}/", self.path().join("s").display());
        let faults = dataset::check(&self.path(), options).faults;
        faults
            .iter()
            .map(|f| (f.severity, f.to_string().replace(&here, "")))
            .collect()
    }

    /// `data check` gives one warning, which has each of `parts`, and loading notes it when it is seen without pixels.
    fn suspected(&self, parts: &[&str]) {
        let found = self.checked(&LoadOptions::default());
        assert_eq!(found.len(), 1, "{parts:?}: {found:#?}");
        let (severity, message) = &found[0];
        assert_eq!(*severity, Severity::Warning, "{message}");
        for part in parts {
            assert!(message.contains(part), "{message}: {part}");
        }
        assert!(message.contains("; ") && !message.contains('\n'), "{message}");
    }

    fn unsuspected(&self) {
        self.unsuspected_with(&LoadOptions::default());
    }

    fn unsuspected_with(&self, options: &LoadOptions) {
        assert_eq!(self.checked(options), []);
        assert!(self.load_with(options).unwrap().sequences[0].notes().is_empty());
    }
}

fn reading(origin: Option<&str>, boxes: Option<&str>) -> LoadOptions {
    LoadOptions {
        reading: Reading {
            origin: origin.map(|text| text.parse().unwrap()),
            boxes: boxes.map(|text| text.parse().unwrap()),
            ..Reading::default()
        },
        ..LoadOptions::default()
    }
}

fn named(rows: &[String]) -> Vec<String> {
    let name = |(k, row): (usize, &String)| format!("{:05}.png {row}", k + 1);
    rows.iter().enumerate().map(name).collect()
}

fn absent_rows_are_read_with_and_without_names() {
    for numbers in [8, 4] {
        for word in ["nan", "NaN", "0", "0.0", "-1", "-1.0"] {
            let rows = if numbers == 8 { quads() } else { xywh() };
            let absent = vec![word; numbers].join(" ");
            absent_row(rows, &absent);
        }
        for word in ["absent", "Absent", "out_of_view", "null null", "none"] {
            absent_row(if numbers == 8 { quads() } else { xywh() }, word);
        }
    }
    // Nothing is known of these.
    for word in ["unannotated", "tracker_failed"] {
        let mut rows = quads();
        rows[4] = word.into();
        for rows in [named(&rows), rows] {
            let data = Data::new().truth(&rows);
            assert_eq!(data.sequence().annotation(4).region, Region::Unknown);
            data.unsuspected();
        }
    }
}

fn absent_row(mut rows: Vec<String>, absent: &str) {
    rows[4] = absent.into();
    rows[5] = absent.into();
    for rows in [named(&rows), rows] {
        let data = Data::new().truth(&rows);
        let sequence = data.sequence();
        let is_absent = |i: usize| sequence.annotation(i).region == Region::Absent;
        let found: Vec<usize> = (0..FRAMES).filter(|&i| is_absent(i)).collect();
        assert_eq!((found, sequence.absent()), (vec![4, 5], 2), "{absent}");
        assert_eq!(sequence.annotated(), FRAMES - 2);
        data.unsuspected();
    }
}

fn rows_of_nothing_known_are_refused_with_a_remedy_that_works() {
    for (bad, message) in [
        (
            "50 40 nan 40 100 80 50 80",
            "groundtruth.txt:5: a coordinate is not finite",
        ),
        (
            "5 5 5 5 5 5 5 5",
            "groundtruth.txt:5: the quadrilateral has zero area",
        ),
        ("gone", "groundtruth.txt:5: `gone` is not a number"),
        ("0 0 0 0", "groundtruth.txt:5: 4 numbers instead of 8"),
    ] {
        let mut rows = quads();
        rows[4] = bad.into();
        let error = Data::new()
            .truth(&rows)
            .load_with(&LoadOptions::default())
            .unwrap_err();
        assert!(error.to_string().contains(message), "{error}");
    }
    for (remedy, numbers) in [("nan", 8), ("0", 8)] {
        let mut rows = quads();
        rows[4] = vec![remedy; numbers].join(" ");
        Data::new().truth(&rows).unsuspected();
    }
}

fn texts_of_every_kind_are_read() {
    let rows = quads();
    let comma: Vec<String> = rows.iter().map(|row| row.replace(' ', ",")).collect();
    let with = |each: &dyn Fn(usize, &str) -> String| -> Vec<u8> {
        let lines: Vec<String> = comma.iter().enumerate().map(|(k, row)| each(k, row)).collect();
        (lines.join("\n") + "\n").into_bytes()
    };
    let plain = with(&|_, row| row.to_string());
    let text = String::from_utf8(plain.clone()).unwrap();
    let utf16 = |unit: fn(u16) -> [u8; 2]| -> Vec<u8> {
        format!("\u{feff}{text}").encode_utf16().flat_map(unit).collect()
    };
    let quoted = |row: &str| format!("\"{}\"", row.replace(',', "\",\""));
    let texts: Vec<(&str, Vec<u8>)> = vec![
        ("Ctrl-Z", [&plain[..], b"\x1a"].concat()),
        (
            "Ctrl-Z and CR LF",
            [text.replace('\n', "\r\n").as_bytes(), b"\x1a\r\n"].concat(),
        ),
        ("CR", text.replace('\n', "\r").into_bytes()),
        ("byte order mark", format!("\u{feff}{text}").into_bytes()),
        ("UTF-16 LE", utf16(u16::to_le_bytes)),
        ("UTF-16 BE", utf16(u16::to_be_bytes)),
        ("Latin-1", [b"# gr\xf6\xdfe der tafel\n", &plain[..]].concat()),
        (
            "Latin-1 blanks",
            text.replace(',', "\u{1}")
                .bytes()
                .map(|b| if b == 1 { 0xa0 } else { b })
                .collect(),
        ),
        ("comments of Matlab", [b"% x y\n// x y\n", &plain[..]].concat()),
        ("non-breaking spaces", with(&|_, row| row.replace(',', "\u{a0}"))),
        ("blanks behind", with(&|_, row| format!("  {row} \t"))),
        ("quotation marks", with(&|_, row| quoted(row))),
        ("one quoted field", with(&|_, row| format!("\"{row}\""))),
        (
            "quoted names",
            with(&|k, row| format!("\"{:05}.png\",{}", k + 1, quoted(row))),
        ),
        (
            "quoted header",
            [
                &b"\"frame\",\"x1\",\"y1\",\"x2\",\"y2\",\"x3\",\"y3\",\"x4\",\"y4\"\n"[..],
                &with(&|k, row| format!("\"{:05}.png\",{}", k + 1, quoted(row))),
            ]
            .concat(),
        ),
        ("brackets", with(&|_, row| format!("[{row}]"))),
        (
            "points in brackets",
            with(&|_, row| {
                let v: Vec<&str> = row.split(',').collect();
                let points: Vec<String> = v.chunks(2).map(|p| format!("({}, {})", p[0], p[1])).collect();
                format!("[{}]", points.join(", "))
            }),
        ),
        ("a colon", with(&|k, row| format!("{:05}.png: {row}", k + 1))),
    ];
    for (what, bytes) in texts {
        let data = Data::new().file("groundtruth.txt", bytes);
        let sequence = data
            .load_with(&LoadOptions::default())
            .map(|set| set.sequences[0].clone());
        let sequence = sequence.unwrap_or_else(|e| panic!("{what}: {e}"));
        for k in 0..FRAMES {
            let expected: Vec<f64> = rows[k].split(' ').map(|v| v.parse().unwrap()).collect();
            assert_eq!(sequence.truth(k).unwrap().to_array()[..], expected, "{what}");
        }
        data.unsuspected();
    }
    let error = Data::new()
        .file("groundtruth.txt", b"\x89PNG\x00\xff\x00")
        .load_with(&LoadOptions::default());
    assert!(
        error
            .unwrap_err()
            .to_string()
            .contains("groundtruth.txt: not a text file; ")
    );
}

fn flags_beside_the_truth_make_frames_absent() {
    let column = |shown: &str, hidden: &str| -> String {
        (0..FRAMES)
            .map(|k| format!("{}\n", if (4..7).contains(&k) { hidden } else { shown }))
            .collect()
    };
    let row = |text: String| text.trim().replace('\n', ",");
    for (name, content) in [
        ("s_flag.txt", column("0", "1")),
        ("s_flag.txt", column("0", "3")),
        ("flag.txt", column("0", "2")),
        ("full_occlusion.txt", row(column("0", "1"))),
        ("out_of_view.txt", row(column("0", "1"))),
        ("full-occlusion.tag", column("0", "1")),
        ("absence.label", column("0", "1")),
        ("absent.txt", column("0.0", "1.0")),
        ("visible.txt", column("1", "0")),
    ] {
        for rows in [quads(), named(&quads()), xywh()] {
            let data = Data::new().truth(&rows).file(name, &content);
            let sequence = data.sequence();
            let absent = (0..FRAMES).filter(|&i| sequence.annotation(i).region == Region::Absent);
            assert_eq!(absent.collect::<Vec<_>>(), [4, 5, 6], "{name}");
            data.unsuspected();
        }
    }
    // Beside the folder, where the truth of MTF and POT lies.
    let data = Data::new();
    fs::write(data.path().join("s.txt"), quads().join("\n")).unwrap();
    fs::write(data.path().join("s_flag.txt"), column("0", "2")).unwrap();
    assert_eq!(data.sequence().absent(), 3);
    let occlusion = row(column("0", "1"));
    let data = Data::new().truth(&quads()).file("full_occlusion.txt", occlusion);
    let data = data.file("out_of_view.txt", "0,1,0,0,0,0,0,0,0,0,0,0");
    assert_eq!(data.sequence().absent(), 4);
}

fn flags_of_another_number_are_refused() {
    for content in [
        "0\n1\n",
        "",
        "0 0 0 0 0 0 0 0 0 0 0 0 0",
        "0\n0\nx\n0\n0\n0\n0\n0\n0\n0\n0\n0\n",
    ] {
        let data = Data::new().truth(&quads()).file("absence.label", content);
        let error = data.load_with(&LoadOptions::default()).unwrap_err().to_string();
        let what = if content.contains('x') {
            "absence.label:3: `x` is not a number"
        } else {
            "flags for 12 frames"
        };
        assert!(error.contains(what) && error.contains("; "), "{error}");
    }
}

fn tags_of_vot_are_words_about_frames() {
    let data = Data::within("color").truth(&quads());
    let data = data.file("occlusion.tag", "0\n1\n1\n0\n0\n0\n0\n0\n0\n0\n0\n0\n");
    let sequence = data.sequence();
    assert_eq!((sequence.absent(), sequence.annotated()), (0, FRAMES));
    let flagged: Vec<usize> = (0..FRAMES)
        .filter(|&i| sequence.annotation(i).flags == ["occlusion"])
        .collect();
    assert_eq!(flagged, [1, 2]);
}

fn boxes_of_another_form_are_suspected() {
    Data::new().truth(&xyxy()).suspected(&[
        "groundtruth.txt:",
        "look like x1 y1 x2 y2",
        "`--box xyxy`",
        "frame `",
    ]);
    Data::new()
        .truth(&named(&xyxy()))
        .suspected(&["look like x1 y1 x2 y2"]);
    // A small object far from the border of the image: only the motion tells.
    let small = |k: usize| {
        let [x, y] = [20.0 + 3.0 * k as f64, 15.0 + 2.0 * k as f64];
        line(&[x, y, x + 21.0, y + 18.0])
    };
    let rows: Vec<String> = (0..FRAMES).map(small).collect();
    Data::new()
        .truth(&rows)
        .suspected(&["look like x1 y1 x2 y2", "third and fourth number"]);
    // One that rests near the lower right corner: only the border tells.
    let rows = vec![line(&[100.0, 60.0, 150.0, 110.0]); FRAMES];
    let resting = Data::new().truth(&rows).checked(&LoadOptions::default());
    let told = |m: &str| m.contains("look like x1 y1 x2 y2") && m.contains("12 of 12 frames leave");
    assert!(resting.iter().any(|(_, m)| told(m)), "{resting:#?}");
    // About the centre, right and below.
    let rows: Vec<String> = (0..FRAMES)
        .map(|k| line(&[125.0 + k as f64 / 4.0, 90.0, 50.0, 40.0]))
        .collect();
    let outside: Vec<(Severity, String)> = Data::new().truth(&rows).checked(&LoadOptions::default());
    assert!(
        outside
            .iter()
            .any(|(_, m)| m.contains("look like cx cy w h") && m.contains("`--box cxcywh`")),
        "{outside:#?}"
    );
    assert!(outside.iter().all(|(severity, _)| *severity == Severity::Warning));
}

fn boxes_are_read_as_asked() {
    let centred = |k: usize| {
        let [l, t, r, b] = bounds(k);
        line(&[(l + r) / 2.0, (t + b) / 2.0, r - l, b - t])
    };
    let centred: Vec<String> = (0..FRAMES).map(centred).collect();
    for (form, rows) in [("xywh", xywh()), ("xyxy", xyxy()), ("cxcywh", centred)] {
        let said = format!("{{\"box\": \"{form}\", \"tags\": [\"a\"]}}");
        let by_meta = Data::new().truth(&rows).file("meta.json", said);
        by_meta.unsuspected();
        let by_option = Data::new().truth(&rows);
        by_option.unsuspected_with(&reading(None, Some(form)));
        // The option goes first.
        let other = Data::new().truth(&rows).file("meta.json", "{\"box\": \"xywh\"}");
        let loaded = [
            by_meta.sequence(),
            by_option.load_with(&reading(None, Some(form))).unwrap().sequences[0].clone(),
            other.load_with(&reading(None, Some(form))).unwrap().sequences[0].clone(),
        ];
        for sequence in loaded {
            assert_eq!(sequence.boxes(), Some(form.parse::<BoxForm>().unwrap()));
            for k in 0..FRAMES {
                let [l, t, r, b] = bounds(k);
                let expected = Corners::rect(l - 0.5, t - 0.5, r - l, b - t);
                assert_eq!(sequence.truth(k), Some(expected), "{form}");
            }
        }
    }
    for bad in ["{\"box\": \"xxyy\"}", "{\"origin\": 2}"] {
        let data = Data::new().truth(&xywh()).file("meta.json", bad);
        let error = data.load_with(&LoadOptions::default()).unwrap_err().to_string();
        assert!(
            error.contains("meta.json: bad metadata") && error.contains("\"cxcywh\""),
            "{error}"
        );
    }
    // Words of the same name that are somebody else's.
    let data = Data::new()
        .truth(&xywh())
        .file("meta.json", "{\"box\": [1, 2], \"origin\": \"a camera\"}");
    data.unsuspected();
}

fn fractions_are_suspected() {
    let scaled = |v: &[f64]| {
        let fractions = v
            .iter()
            .enumerate()
            .map(|(i, v)| v / f64::from(if i % 2 == 0 { SIZE.0 } else { SIZE.1 }));
        line(&fractions.collect::<Vec<_>>())
    };
    let quads: Vec<String> = (0..FRAMES).map(|k| scaled(&quad(k).to_array())).collect();
    let boxes = |k: usize| {
        let [l, t, r, b] = bounds(k);
        scaled(&[l, t, r - l, b - t])
    };
    let boxes: Vec<String> = (0..FRAMES).map(boxes).collect();
    let corners: Vec<String> = (0..FRAMES).map(|k| scaled(&bounds(k))).collect();
    for rows in [quads.clone(), named(&quads), boxes, corners] {
        Data::new().truth(&rows).suspected(&[
            "groundtruth.txt:1: warning: all coordinates of 12 frames lie in 0..1",
            "multiply x by 160 and y by 120",
        ]);
    }
}

fn x_and_y_exchanged_are_suspected() {
    let moved = |k: usize, x: f64| quad(k).translated(x, 0.0);
    let exchanged = |c: Corners| c.0.map(|[x, y]| [y, x]).concat();
    // To the right, where x is larger than the image is high.
    let rows: Vec<String> = (0..FRAMES).map(|k| line(&exchanged(moved(k, 30.0)))).collect();
    let found = Data::new().truth(&rows).checked(&LoadOptions::default());
    assert!(
        found
            .iter()
            .any(|(_, m)| m.contains("x and y look exchanged") && m.contains("write x before y")),
        "{found:#?}"
    );
    // In the middle only the sense of the corners tells.
    let rows: Vec<String> = (0..FRAMES).map(|k| line(&exchanged(moved(k, -20.0)))).collect();
    Data::new()
        .truth(&rows)
        .suspected(&["counter-clockwise, or x and y are exchanged", "x before y"]);
    let boxes = |k: usize| {
        let [l, t, r, b] = bounds(k);
        line(&[t, l + 30.0, b - t, r - l])
    };
    let rows: Vec<String> = (0..FRAMES).map(boxes).collect();
    let found = Data::new().truth(&rows).checked(&LoadOptions::default());
    assert!(
        found.iter().any(|(_, m)| m.contains("x and y look exchanged")),
        "{found:#?}"
    );
}

fn another_order_of_corners_is_suspected() {
    let turned = |k: usize, by: usize, mirrored: bool| {
        let c = quad(k).0;
        let at = |i: usize| if mirrored { (by + 4 - i) % 4 } else { (by + i) % 4 };
        line(&[0, 1, 2, 3].map(|i| c[at(i)]).concat())
    };
    let every: Vec<String> = (0..FRAMES)
        .map(|k| turned(k, [0, 1, 2, 3, 0, 1][k % 6], false))
        .collect();
    Data::new().truth(&every).suspected(&[
        "groundtruth.txt:2:",
        "the first corner changes in",
        "frame `00002.png`",
    ]);
    let once: Vec<String> = (0..FRAMES)
        .map(|k| turned(k, usize::from(k >= 7), false))
        .collect();
    Data::new()
        .truth(&named(&once))
        .suspected(&["groundtruth.txt:8:", "the first corner changes in 1 frame "]);
    let opposite: Vec<String> = (0..FRAMES)
        .map(|k| turned(k, if k == 11 { 2 } else { 0 }, false))
        .collect();
    Data::new()
        .truth(&opposite)
        .suspected(&["groundtruth.txt:12:", "the first corner changes in 1 frame "]);
    let sense: Vec<String> = (0..FRAMES).map(|k| turned(k, 0, k >= 5)).collect();
    Data::new()
        .truth(&sense)
        .suspected(&["groundtruth.txt:6:", "the orientation of the corners changes"]);
    // With frames between that are not annotated.
    let mut gaps = every;
    for k in (1..FRAMES).step_by(2) {
        gaps[k] = line(&[0.0; 8]);
    }
    Data::new()
        .truth(&gaps)
        .suspected(&["groundtruth.txt:3:", "the first corner changes"]);
}

fn corners_that_jump_are_suspected() {
    let rows = |change: &dyn Fn(usize, Corners) -> Corners| -> Vec<String> {
        (0..FRAMES)
            .map(|k| line(&change(k, quad(k)).to_array()))
            .collect()
    };
    let slip = rows(&|k, c| if k == 6 { c.translated(-40.0, 0.0) } else { c });
    Data::new().truth(&slip).suspected(&[
        "groundtruth.txt:7:",
        "the corners jump by 39 px in 1 frame (frame `00007.png`)",
    ]);
    let corner = rows(&|k, mut c| {
        if k == 4 {
            c.0[2][0] += 30.0;
        }
        c
    });
    Data::new()
        .truth(&corner)
        .suspected(&["groundtruth.txt:5:", "the corners jump by"]);
    let from_there = rows(&|k, c| if k >= 6 { c.translated(-35.0, 20.0) } else { c });
    Data::new()
        .truth(&from_there)
        .suspected(&["groundtruth.txt:7:", "the corners jump by"]);
    let last = rows(&|k, c| if k == 11 { c.translated(-45.0, 0.0) } else { c });
    Data::new()
        .truth(&last)
        .suspected(&["groundtruth.txt:12:", "the corners jump by"]);
    let boxes = |k: usize| {
        let [l, t, r, b] = bounds(k);
        line(&[if k == 3 { l - 40.0 } else { l }, t, r - l, b - t])
    };
    let boxes: Vec<String> = (0..FRAMES).map(boxes).collect();
    Data::new()
        .truth(&boxes)
        .suspected(&["groundtruth.txt:4:", "the corners jump by"]);
}

fn a_start_without_texture_is_found_by_the_check() {
    let noise = |x: u32, y: u32| 118 + (x * 7 + y * 5 + x * y) as u8 % 3;
    let outside = |x: u32, y: u32| {
        if (40..115).contains(&x) && (30..95).contains(&y) {
            90
        } else {
            texture(x, y)
        }
    };
    let ramp = |x: u32, y: u32| 100 + (x + y) as u8 / 100;
    for pixel in [
        &|_: u32, _: u32| 90_u8,
        &noise as &dyn Fn(u32, u32) -> u8,
        &outside,
        &ramp,
    ] {
        let data = Data::painted("", pixel).truth(&quads());
        data.suspected(&["groundtruth.txt:1: warning: the start has no texture to track"]);
    }
    let checked = |x: u32, y: u32| {
        if (x / 6 + y / 6).is_multiple_of(2) {
            100
        } else {
            110
        }
    };
    Data::painted("", &checked).truth(&quads()).unsuspected();
}

fn good_truth_gives_no_warning() {
    Data::new().truth(&quads()).unsuspected();
    Data::new().truth(&xywh()).unsuspected();
    // Fast, with a turn; shaking; a zoom; an object that leaves the image on the right or below.
    let motions: [&dyn Fn(f64) -> (f64, f64, f64, f64); 6] = [
        &|t| (8.0 * t, 20.0 + 3.0 * t, 30.0, 20.0),
        &|t| {
            (
                50.0 + 40.0 * (t * 0.7).sin(),
                40.0 + 20.0 * (t * 0.9).cos(),
                30.0,
                25.0,
            )
        },
        &|t| (40.0 - 2.0 * t, 30.0 - 1.5 * t, 40.0 + 5.0 * t, 30.0 + 4.0 * t),
        &|t| (60.0 + 6.0 * t, 40.0, 40.0, 30.0),
        &|t| (60.0, 40.0 + 5.0 * t, 40.0, 30.0),
        &|t| {
            (
                60.0 + if t > 5.0 { 25.0 * (t - 5.0).min(3.0) } else { 0.0 },
                40.0,
                60.0,
                40.0,
            )
        },
    ];
    for (i, motion) in motions.iter().enumerate() {
        let boxes: Vec<String> = (0..FRAMES)
            .map(|k| {
                let (x, y, w, h) = motion(k as f64);
                line(&[x, y, w, h])
            })
            .collect();
        let found = Data::new().truth(&boxes).checked(&LoadOptions::default());
        assert_eq!(found, [], "motion {i}");
    }
    // A quick turn in the plane.
    let turn = |k: usize| {
        let (sin, cos) = (25.0 * k as f64).to_radians().sin_cos();
        let at = |[u, v]: [f64; 2]| [80.0 + cos * u - sin * v, 60.0 + sin * u + cos * v];
        line(
            &[[-25.0, -20.0], [25.0, -20.0], [25.0, 20.0], [-25.0, 20.0]]
                .map(at)
                .concat(),
        )
    };
    Data::new()
        .truth(&(0..FRAMES).map(turn).collect::<Vec<_>>())
        .unsuspected();
}

fn a_start_partly_outside_is_tracked_unless_strict() {
    let strict = LoadOptions {
        strict: true,
        ..LoadOptions::default()
    };
    let moved = |x: f64, y: f64| -> Vec<String> {
        (0..FRAMES)
            .map(|k| line(&quad(k).translated(x, y).to_array()))
            .collect()
    };
    let boxes: Vec<String> = (0..FRAMES)
        .map(|k| line(&[-10.0 + k as f64, 30.0, 40.0, 30.0]))
        .collect();
    for rows in [
        moved(61.0, 0.0),
        moved(-60.0, 0.0),
        moved(0.0, -50.0),
        moved(0.0, 60.0),
        boxes,
    ] {
        let data = Data::new().truth(&rows);
        data.suspected(&["groundtruth.txt:1: warning: a corner of the initial quadrilateral lies outside the 160x120 image"]);
        assert!(
            data.sequence().notes()[0]
                .to_string()
                .contains("outside the 160x120 image")
        );
        let error = data.load_with(&strict).unwrap_err().to_string();
        assert!(
            error.contains("lies outside the 160x120 image; ") && error.contains("`--strict`"),
            "{error}"
        );
        assert_eq!(data.checked(&strict)[0].0, Severity::Error);
    }
    let data = Data::new().truth(&moved(-60.0, 0.0));
    let run = |word: &str| {
        let mut command = program(data.root.path());
        command.args(["run", "data", "--out", "out", "--progress", "none"]);
        command
            .args(Some(word).filter(|w| !w.is_empty()))
            .output()
            .unwrap()
    };
    let (loose, strict) = (run(""), run("--strict"));
    assert_eq!(loose.status.code(), Some(0), "{loose:?}");
    assert_eq!(strict.status.code(), Some(2), "{strict:?}");
    let away = Data::new()
        .truth(&moved(200.0, 0.0))
        .load_with(&LoadOptions::default());
    assert!(
        away.unwrap_err()
            .to_string()
            .contains("the initial quadrilateral lies outside the 160x120 image; ")
    );
}

fn the_origin_is_shown_and_can_be_given() {
    let first = |data: &Data, options: &LoadOptions| {
        let sequence = &data.load_with(options).unwrap().sequences[0];
        (sequence.origin(), sequence.truth(0).unwrap())
    };
    let asked = |text: &str| reading(Some(text), None);
    let shifted = |by: f64| quad(0).translated(-by, -by);
    let usual = LoadOptions::default();
    for inner in ["", "img"] {
        let data = Data::within(inner).truth(&quads());
        assert_eq!(first(&data, &usual), (Origin::CENTRE, quad(0)));
        data.unsuspected();
    }
    // Nothing but the name of the folder speaks for VOT's convention: that is said.
    let colour = Data::within("color").truth(&quads());
    assert_eq!(first(&colour, &usual), (Origin::CORNER, shifted(0.5)));
    colour.suspected(&["origin", "`color`", "`--origin 0`"]);
    let boxes = Data::new().truth(&xywh());
    let corner = |by: f64| Corners::rect(bounds(0)[0] - by, bounds(0)[1] - by, 50.0, 40.0);
    assert_eq!(first(&boxes, &usual), (Origin::CORNER, corner(0.5)));
    for (text, by) in [("0", 0.0), ("0.5", 0.5), ("1", 1.0), ("1.5", 1.5)] {
        colour.unsuspected_with(&asked(text));
        assert_eq!(first(&colour, &asked(text)).1, shifted(by));
        assert_eq!(first(&boxes, &asked(text)).1, corner(by));
        let said = format!("{{\"origin\": {text}}}");
        let by_meta = Data::within("color").truth(&quads()).file("meta.json", said);
        by_meta.unsuspected();
        assert_eq!(first(&by_meta, &usual).1, shifted(by));
        assert_eq!(first(&by_meta, &asked("0")).1, quad(0));
    }
    let run = |words: &str| {
        program(colour.root.path())
            .args(words.split(' '))
            .output()
            .unwrap()
    };
    let info = |words: &str| -> serde_json::Value {
        let words = format!("data info data --format json {words}");
        let found: serde_json::Value = serde_json::from_slice(&run(words.trim()).stdout).unwrap();
        found["datasets"][0]["sequences"][0].clone()
    };
    assert_eq!(
        (&info("")["origin"], &info("")["box"]),
        (&0.5.into(), &serde_json::Value::Null)
    );
    assert_eq!(info("--origin 1")["origin"], 1.0);
    assert_ne!(info("")["fingerprint"], info("--origin 1")["fingerprint"]);
    assert_eq!(run("data info data --origin 2").status.code(), Some(2));
    assert_eq!(run("run data --out out --progress none").status.code(), Some(0));
    let read = fs::read_to_string(colour.root.path().join("out/run.json")).unwrap();
    let about: serde_json::Value = serde_json::from_str(&read).unwrap();
    assert_eq!(about["read_as"]["data/s"]["origin"], 0.5, "{about:#}");
}

fn every_year_of_vot_has_one_origin() {
    for (inner, own) in [
        ("", "occlusion.label"),
        ("", "camera_motion.tag"),
        ("", "sequence"),
        ("color", "sequence"),
        ("color", "occlusion.tag"),
    ] {
        let data = Data::within(inner)
            .truth(&quads())
            .file(own, "0\n".repeat(FRAMES));
        let sequence = data.sequence();
        assert_eq!(
            (sequence.format(), sequence.origin()),
            ("vot", Origin::CORNER),
            "{own}"
        );
        data.unsuspected();
    }
    assert!(Data::new().frames.ends_with("data/s/"));
}

fn many_faults_of_a_kind_are_one_line() {
    let mut rows = quads();
    for row in &mut rows[3..9] {
        *row = "1 2 3 4 x 6 7 8".into();
    }
    rows[10] = "5 5 5 5 5 5 5 5".into();
    let data = Data::new().truth(&rows);
    let found = data.checked(&LoadOptions::default());
    assert_eq!(found.len(), 2, "{found:#?}");
    assert!(
        found[0].1.starts_with("groundtruth.txt:4: `x` is not a number; "),
        "{found:#?}"
    );
    assert!(
        found[0].1.ends_with("(5 more of this kind, the last in line 9)"),
        "{found:#?}"
    );
    assert!(
        found[1]
            .1
            .starts_with("groundtruth.txt:11: the quadrilateral has zero area"),
        "{found:#?}"
    );
    let skip = LoadOptions {
        on_bad_data: OnBadData::Skip,
        ..LoadOptions::default()
    };
    assert_eq!(data.load_with(&skip).unwrap().sequences[0].notes().len(), 2);
    // Every second row is zero in POT: nothing to say.
    let zeros = |k: usize| {
        if k.is_multiple_of(2) {
            line(&quad(k).to_array())
        } else {
            line(&[0.0; 8])
        }
    };
    let data = Data::new().truth(&(0..FRAMES).map(zeros).collect::<Vec<_>>());
    data.unsuspected();
    assert_eq!((data.sequence().annotated(), data.sequence().absent()), (6, 6));
}

fn a_run_repeats_warnings_in_one_line() {
    let data = Data::new().truth(&xyxy());
    let copy = |name: &str| {
        let to = data.path().join(name);
        fs::create_dir(&to).unwrap();
        for entry in fs::read_dir(data.path().join("s")).unwrap() {
            let from: &Path = &entry.unwrap().path();
            fs::copy(from, to.join(from.file_name().unwrap())).unwrap();
        }
    };
    let warnings = || {
        let run = program(data.root.path())
            .args(["run", "data", "--out", "out", "--force", "--progress", "none"])
            .output()
            .unwrap();
        let text = String::from_utf8(run.stderr).unwrap();
        text.lines()
            .filter(|l| l.starts_with("warning:"))
            .map(String::from)
            .collect::<Vec<_>>()
    };
    let one = warnings();
    assert_eq!(one.len(), 1, "{one:#?}");
    assert!(
        one[0].contains("s/groundtruth.txt:") && one[0].contains("look like x1 y1 x2 y2"),
        "{one:#?}"
    );
    copy("t");
    copy("u");
    let three = warnings();
    assert_eq!(three.len(), 1, "{three:#?}");
    assert!(three[0].ends_with("(and 2 more, see `data check`)"), "{three:#?}");
}
