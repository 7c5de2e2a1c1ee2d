//! Which frame a row of ground truth is for: by number, by name, in order, or as is said; and what is left out.

use mtf::geom::Corners;
use mtf_eval::dataset::{self, Dataset, DatasetError, LoadOptions, OnBadData, Reading, TruthRows};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

crate::tests! {
    blank_lines_are_rows_where_rows_are_as_many_only_with_them;
    lost_frames_are_known_by_their_numbers;
    rows_for_other_frames_are_placed_as_told;
    rows_that_cannot_be_placed_leave_the_sequence_out;
    rows_name_their_frames_in_any_spelling;
    frames_are_in_the_order_of_time;
    odd_numbers_are_warned_about;
    a_sequence_with_a_bad_frame_is_left_out;
    ground_truth_is_found_in_a_folder_of_its_own;
    the_depth_of_a_search_is_told;
}

/// Corners of frame `i`, from 1.
fn quad(i: usize) -> Corners {
    Corners::rect(5.0 + i as f64, 6.0, 20.0, 15.0)
}

fn row(i: usize) -> String {
    quad(i).to_array().map(|v| v.to_string()).join(",")
}

fn rows(of: impl IntoIterator<Item = usize>) -> Vec<String> {
    of.into_iter().map(row).collect()
}

fn frame(path: &Path, size: u32) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let image = image::GrayImage::from_fn(64, size, |x, y| image::Luma([(x * 7 + y * 13 + x * y) as u8]));
    image.save(path).unwrap();
}

/// A sequence `s` of these frames and lines of ground truth.
fn sequence<N: AsRef<str>>(names: &[N], lines: &[String]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    for name in names {
        frame(&dir.path().join("s").join(name.as_ref()), 48);
    }
    fs::write(dir.path().join("s/groundtruth.txt"), lines.join("\n") + "\n").unwrap();
    dir
}

/// `00001.png` and so on.
fn numbered(numbers: impl IntoIterator<Item = usize>) -> Vec<String> {
    numbers.into_iter().map(|i| format!("{i:05}.png")).collect()
}

fn skip() -> LoadOptions {
    LoadOptions {
        on_bad_data: OnBadData::Skip,
        ..LoadOptions::default()
    }
}

fn told(start: Option<u64>, step: Option<u64>) -> LoadOptions {
    LoadOptions {
        reading: Reading {
            rows: TruthRows { start, step },
            ..Reading::default()
        },
        ..LoadOptions::default()
    }
}

fn load(dir: &TempDir, options: &LoadOptions) -> Result<Dataset, DatasetError> {
    dataset::load(dir.path(), options)
}

/// The names of frames, and which rows they have.
fn placed(data: &Dataset) -> Vec<(&str, Option<usize>)> {
    let s = &data.sequences[0];
    let number = |i: usize| (0..100).find(|&k| s.truth(i) == Some(quad(k)));
    (0..s.len()).map(|i| (s.frame_name(i), number(i))).collect()
}

fn notes(data: &Dataset) -> Vec<String> {
    data.sequences[0]
        .notes()
        .iter()
        .map(ToString::to_string)
        .collect()
}

fn numbers(data: &Dataset) -> Vec<Option<usize>> {
    placed(data).into_iter().map(|(_, number)| number).collect()
}

fn blank_lines_are_rows_where_rows_are_as_many_only_with_them() {
    for (empty, options) in [
        ("", LoadOptions::default()),
        ("  ", skip()),
        (",,,,,,,", LoadOptions::default()),
        (";;;;;;;", skip()),
    ] {
        let mut lines = rows(1..=8);
        lines[3] = empty.into();
        lines[4] = empty.into();
        let dir = sequence(&numbered(1..=8), &lines);
        let data = load(&dir, &options).unwrap();
        let expected = [Some(1), Some(2), Some(3), None, None, Some(6), Some(7), Some(8)];
        assert_eq!(numbers(&data), expected, "{empty:?}");
        let warned = notes(&data)
            .iter()
            .any(|n| n.contains("warning: 2 blank lines are taken as frames"));
        assert_eq!(warned, empty.trim().is_empty());
    }
    // Blank lines between all rows, and rows of separators at the end of a table.
    let spaced: Vec<String> = rows(1..=6).into_iter().flat_map(|r| [r, String::new()]).collect();
    let table = [rows(1..=6), vec![",,,,,,,".into(); 3]].concat();
    let all: Vec<_> = (1..=6).map(Some).collect();
    for lines in [spaced, table] {
        let dir = sequence(&numbered(1..=6), &lines);
        let data = load(&dir, &LoadOptions::default()).unwrap();
        assert_eq!((numbers(&data), notes(&data)), (all.clone(), vec![]));
    }
    // A blank line at either end says nothing of frames.
    for lines in [
        [vec![String::new()], rows(1..=5)].concat(),
        [rows(1..=5), vec![String::new()]].concat(),
    ] {
        let dir = sequence(&numbered(1..=6), &lines);
        assert!(load(&dir, &skip()).is_err());
    }
}

fn lost_frames_are_known_by_their_numbers() {
    for (there, step) in [
        (vec![1, 2, 3, 4, 6, 7, 8, 9], 1),
        (vec![1, 2, 4, 5, 6, 9], 1),
        (vec![10, 15, 25, 30, 35], 5),
    ] {
        let (first, last) = (there[0], there[there.len() - 1]);
        let dir = sequence(&numbered(there.clone()), &rows((first..=last).step_by(step)));
        let fault = load(&dir, &LoadOptions::default()).unwrap_err().to_string();
        assert!(
            fault.contains("which is not there") && fault.contains("; add the frame"),
            "{fault}"
        );
        let data = load(&dir, &skip()).unwrap();
        assert_eq!(numbers(&data), there.iter().map(|i| Some(*i)).collect::<Vec<_>>());
        assert_eq!(notes(&data).len(), 1);
    }
}

fn rows_for_other_frames_are_placed_as_told() {
    let all: Vec<_> = (4..=12).map(Some).collect();
    // From frame 4 on.
    let dir = sequence(&numbered(1..=12), &rows(4..=12));
    let data = load(&dir, &told(Some(4), None)).unwrap();
    assert_eq!(placed(&data)[0], ("00004.png", Some(4)));
    assert_eq!(numbers(&data), all);
    // The same of a sequence itself; what is asked for goes first.
    fs::write(dir.path().join("s/meta.json"), r#"{"truth_start": 4}"#).unwrap();
    assert_eq!(numbers(&load(&dir, &LoadOptions::default()).unwrap()), all);
    let first = load(&dir, &told(Some(1), None)).unwrap();
    assert_eq!(placed(&first)[0], ("00001.png", Some(4)));
    fs::write(dir.path().join("s/meta.json"), r#"{"truth_start": "4"}"#).unwrap();
    assert!(
        load(&dir, &LoadOptions::default())
            .unwrap_err()
            .to_string()
            .contains("truth_start")
    );
    // Every second frame, then every third from the second on.
    let dir = sequence(&numbered(1..=9), &rows((1..=9).step_by(2)));
    let second: Vec<_> = (1..=9).map(|i| (i % 2 == 1).then_some(i)).collect();
    assert_eq!(numbers(&load(&dir, &told(None, Some(2))).unwrap()), second);
    fs::write(dir.path().join("s/meta.json"), r#"{"tags": [], "truth_step": 2}"#).unwrap();
    assert_eq!(numbers(&load(&dir, &LoadOptions::default()).unwrap()), second);
    let dir = sequence(&numbered(1..=9), &rows([2, 5, 8]));
    let third: Vec<_> = (2..=9).map(|i| (i % 3 == 2).then_some(i)).collect();
    assert_eq!(numbers(&load(&dir, &told(Some(2), Some(3))).unwrap()), third);
    // Frames counted from 0; names without numbers, counted from 1.
    let dir = sequence(&numbered(0..=5), &rows(2..=5));
    assert_eq!(
        placed(&load(&dir, &told(Some(2), None)).unwrap())[0],
        ("00002.png", Some(2))
    );
    let dir = sequence(&["a.png", "b.png", "c.png"], &rows([2, 3]));
    assert_eq!(
        placed(&load(&dir, &told(Some(2), None)).unwrap())[0],
        ("b.png", Some(2))
    );
    // Rows beyond the last frame, and a start that no frame has.
    let dir = sequence(&numbered(1..=6), &rows(1..=8));
    assert!(
        load(&dir, &told(Some(1), None))
            .unwrap_err()
            .to_string()
            .contains(":7: from here on 2 rows")
    );
    let both = LoadOptions {
        on_bad_data: OnBadData::Skip,
        ..told(Some(1), None)
    };
    assert_eq!(
        numbers(&load(&dir, &both).unwrap()),
        (1..=6).map(Some).collect::<Vec<_>>()
    );
    let fault = load(&dir, &told(Some(40), None)).unwrap_err().to_string();
    assert!(fault.contains("frames are numbered from 1 to 6"), "{fault}");
}

fn rows_that_cannot_be_placed_leave_the_sequence_out() {
    let twice: Vec<String> = (1..=6)
        .flat_map(|i| [format!("{i:05}.png"), format!("{i:05}.jpg")])
        .collect();
    for (names, lines, message) in [
        (
            numbered(1..=9),
            rows(1..=6),
            "6 rows of ground truth for 9 frames",
        ),
        (numbered(1..=10), rows((1..=10).step_by(2)), "--truth-step 2"),
        (numbered(1..=12), rows(4..=12), "--truth-start 4"),
        (
            numbered(2..=9),
            rows(1..=9),
            "9 rows of ground truth for 8 frames",
        ),
        (
            twice,
            rows(1..=6),
            "`00001.jpg` and `00001.png` have the same number",
        ),
    ] {
        let dir = sequence(&names, &lines);
        for i in 1..=3 {
            frame(&dir.path().join(format!("good/{i}.png")), 48);
        }
        fs::write(dir.path().join("good/groundtruth.txt"), rows(1..=3).join("\n")).unwrap();
        let fault = load(&dir, &LoadOptions::default()).unwrap_err().to_string();
        assert!(fault.contains(message) && !fault.contains('\n'), "{fault}");
        let data = load(&dir, &skip()).unwrap();
        assert_eq!((data.sequences.len(), data.sequences[0].name()), (1, "good"));
        let left_out = &data.left_out[0];
        assert_eq!((left_out.sequence.as_str(), left_out.reasons.len()), ("s", 1));
        assert!(left_out.reasons[0].message.contains(message));
    }
}

fn rows_name_their_frames_in_any_spelling() {
    for (frames, names) in [
        (["seq.0001.png", "seq.0002.png"], ["seq.0001", "seq.0002"]),
        (["frame00001.png", "frame00002.png"], ["frame1.png", "frame2.png"]),
        (["frame1.png", "frame2.png"], ["frame00001.jpg", "frame00002.jpg"]),
        (
            ["frame 00001.png", "frame 00002.png"],
            ["frame 00001.png", "frame 00002.png"],
        ),
        (["my frame 1.png", "my frame 2.png"], ["my frame 1", "my frame 2"]),
        (["IMG_1.PNG", "IMG_2.PNG"], ["img_1.png", "img_2.png"]),
        (["1.png", "2.png"], ["data/img/1.png", r"data\img\2.png"]),
        (["00001.png", "00002.png"], ["1", "2"]),
        (["img00007.png", "img00008.png"], ["7", "8"]),
        (["img00007.png", "img00008.png"], ["0", "1"]),
    ] {
        for separator in [" ", ","] {
            let line = |i: usize| format!("{}{separator}{}", names[i], row(i + 1).replace(',', separator));
            // By name, whatever the order of rows; counts are in order.
            let lines = match names[0].parse::<u64>() {
                Ok(_) => vec![line(0), line(1)],
                Err(_) => vec![line(1), line(0)],
            };
            let dir = sequence(&frames, &lines);
            let data = load(&dir, &LoadOptions::default());
            let data = data.unwrap_or_else(|e| panic!("{names:?} {separator:?}: {e}"));
            assert_eq!(numbers(&data), [Some(1), Some(2)], "{names:?} {separator:?}");
        }
    }
    let ambiguous = format!("f001 {}", row(1).replace(',', " "));
    let dir = sequence(&["f1.png", "f01.png"], &[ambiguous]);
    let fault = load(&dir, &LoadOptions::default()).unwrap_err().to_string();
    assert!(fault.contains("`f001` may be `f01.png` or `f1.png`; "), "{fault}");
}

fn frames_are_in_the_order_of_time() {
    for (names, doubt) in [
        (
            vec![
                "0.9.png", "0.95.png", "1.png", "1.05.png", "1.1.png", "1.15.png", "1.2.png",
            ],
            true,
        ),
        (vec!["x.png", "x (1).png", "x (2).png", "x (10).png"], false),
        (vec!["IMG_1.png", "img_2.png", "IMG_3.png", "img_10.png"], false),
        (vec!["1.8.png", "1.9.png", "1.10.png", "1.11.png"], false),
    ] {
        let dir = sequence(&names, &rows(1..=names.len()));
        let data = load(&dir, &LoadOptions::default()).unwrap();
        let expected: Vec<_> = names.iter().copied().zip((1..).map(Some)).collect();
        assert_eq!(placed(&data), expected);
        assert_eq!(
            notes(&data)
                .iter()
                .any(|n| n.contains("warning: frames are ordered by decimal")),
            doubt
        );
    }
}

fn odd_numbers_are_warned_about() {
    for (names, message) in [
        (
            numbered([1, 2, 3, 4, 6, 7]),
            "jump from `00004.png` to `00006.png`",
        ),
        (
            numbered([10, 20, 30, 60, 70]),
            "jump from `00030.png` to `00060.png`",
        ),
        (
            ["1.png", "2.png", "02.png", "3.png"].map(String::from).into(),
            "`02.png` and `2.png` have the same number",
        ),
    ] {
        let dir = sequence(&names, &rows(1..=names.len()));
        let data = load(&dir, &LoadOptions::default()).unwrap();
        assert_eq!(numbers(&data), (1..=names.len()).map(Some).collect::<Vec<_>>());
        let notes = notes(&data);
        assert!(
            notes.iter().any(|n| n.contains(message) && n.contains("warning")),
            "{notes:?}"
        );
    }
    // Frames taken at a distance, and times.
    for there in [vec![1, 3, 5, 7], vec![0, 33, 67, 99, 134]] {
        let dir = sequence(&numbered(there.clone()), &rows(1..=there.len()));
        assert_eq!(
            notes(&load(&dir, &LoadOptions::default()).unwrap()),
            Vec::<String>::new()
        );
    }
}

fn a_sequence_with_a_bad_frame_is_left_out() {
    type Spoil = fn(&Path);
    let spoils: [(Spoil, &str); 4] = [
        (
            |path| frame(path, 50),
            "the frame is 64x50 pixels but the first is 64x48",
        ),
        (|path| fs::write(path, b"").unwrap(), "the image file is empty"),
        (
            |path| {
                let bytes = fs::read(path).unwrap();
                fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
            },
            "truncated",
        ),
        (
            |path| {
                fs::remove_file(path).unwrap();
                #[cfg(unix)]
                std::os::unix::fs::symlink("gone", path).unwrap();
                #[cfg(not(unix))]
                fs::write(path, b"gone").unwrap();
            },
            if cfg!(unix) {
                "the link leads nowhere"
            } else {
                "not an image"
            },
        ),
    ];
    for (spoil, message) in spoils {
        let dir = sequence(&numbered(1..=5), &rows(1..=5));
        for i in 1..=3 {
            frame(&dir.path().join(format!("good/{i}.png")), 48);
        }
        fs::write(dir.path().join("good/groundtruth.txt"), rows(1..=3).join("\n")).unwrap();
        spoil(&dir.path().join("s/00003.png"));
        let data = load(&dir, &skip()).unwrap();
        assert_eq!((data.sequences.len(), data.sequences[0].name()), (1, "good"));
        let reason = &data.left_out[0].reasons[0];
        assert!(
            reason.to_string().contains("00003.png") && reason.message.contains(message),
            "{reason}"
        );
        // Frames that are not asked for do not matter.
        let before = LoadOptions {
            max_frames: Some(2),
            ..skip()
        };
        assert_eq!(load(&dir, &before).unwrap().sequences.len(), 2);
    }
}

fn ground_truth_is_found_in_a_folder_of_its_own() {
    for (frames, truth) in [
        ("sequences/A", "annos/A.txt"),
        ("A", "gt/A.txt"),
        ("A/img", "anno/A.txt"),
        ("frames/A", "anno/A.txt"),
        ("images/train/A", "annotations/train/A.txt"),
        ("sequences/A", "annotation/A_gt_points.txt"),
        ("sequences/A", "gt/A/groundtruth.txt"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        for i in 1..=4 {
            frame(&dir.path().join(frames).join(format!("{i:04}.jpg")), 48);
        }
        let truth = dir.path().join(truth);
        fs::create_dir_all(truth.parent().unwrap()).unwrap();
        fs::write(&truth, rows(1..=4).join("\n")).unwrap();
        // Ground truth may lie beside what is given.
        let given = match frames.split_once("/train/") {
            Some((images, _)) => dir.path().join(images),
            None => dir.path().to_path_buf(),
        };
        let data = dataset::load(&given, &LoadOptions::default()).unwrap_or_else(|e| panic!("{frames}: {e}"));
        assert_eq!(data.sequences[0].name(), "A");
        assert_eq!(numbers(&data), (1..=4).map(Some).collect::<Vec<_>>(), "{frames}");
        // Of another sequence.
        fs::rename(&truth, truth.with_file_name("B.txt")).unwrap();
        assert!(dataset::load(&given, &LoadOptions::default()).is_err());
    }
}

fn the_depth_of_a_search_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let deep = dir.path().join("a/b/c/d");
    frame(&deep.join("1.png"), 48);
    fs::write(deep.join("groundtruth.txt"), row(1)).unwrap();
    let fault = load(&dir, &LoadOptions::default()).unwrap_err().to_string();
    assert!(
        fault.contains("2 levels of folders below it (deeper ones such as"),
        "{fault}"
    );
    assert!(dataset::load(&dir.path().join("a/b"), &LoadOptions::default()).is_ok());

    // A folder of frames, given in place of the sequence around it.
    let near = dir.path().join("near");
    frame(&near.join("img/1.png"), 48);
    fs::write(near.join("groundtruth.txt"), row(1)).unwrap();
    let fault = dataset::load(&near.join("img"), &LoadOptions::default())
        .unwrap_err()
        .to_string();
    assert!(fault.contains("; give `") && fault.ends_with("near`"), "{fault}");

    // Images that lie too deep beside sequences that do not.
    frame(&dir.path().join("a/b/c/1.png"), 48);
    let data = load(&dir, &LoadOptions::default()).unwrap();
    assert_eq!(data.sequences.len(), 1);
    assert!(
        data.notes[0].message.contains("more than 2 levels below"),
        "{:?}",
        data.notes
    );
}
