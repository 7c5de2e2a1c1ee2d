//! `score`: results of other programs, from outside.

use crate::harness::shared;
use crate::runs::{program, write_data};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

crate::tests! {
    a_run_scored_again_has_the_same_figures;
    corners_of_an_absent_object_count;
    layouts_and_forms;
    what_is_missing_counts_as_failure_and_is_told;
    the_first_row_is_found_out_or_asked_for;
    boxes_are_scored_by_what_they_say;
    homographies_go_the_way_that_is_said;
    results_that_cannot_be_read_are_refused;
    a_workspace_of_the_vot_toolkit;
    benchmarks_are_reported_with_their_captions;
    figures_are_those_of_an_independent_program needs Numpy;
    other_programs_logs_score_as_an_independent_program_says needs Shared Numpy;
}

fn with_data(lengths: &[usize]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_data(&dir.path().join("data"), lengths);
    dir
}

fn put(dir: &Path, name: &str, text: &str) {
    let path = dir.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

/// The corners of frame `f` of a sequence of [`write_data`], moved by `by` px to the right.
fn corners(f: usize, by: f64) -> [f64; 8] {
    let (dx, dy) = (f as f64 / 3.0 + by, f as f64 / 5.0);
    let (l, t, r, b) = (20.0 + dx, 15.0 + dy, 60.0 + dx, 45.0 + dy);
    [l, t, r, t, r, b, l, b]
}

fn rows(frames: impl Iterator<Item = usize>, by: f64) -> String {
    frames.fold(String::new(), |mut text, f| {
        let row: Vec<String> = corners(f, by).iter().map(f64::to_string).collect();
        let _ = writeln!(text, "{}", row.join(","));
        text
    })
}

/// The pooled row of each tracker.
fn score(dir: &Path, args: &[&str]) -> Vec<Value> {
    let output = program(dir)
        .args(["score", "data"])
        .args(args)
        .args(["--format", "json", "--force", "-o", "out"])
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    let trackers = document["trackers"].as_array().unwrap().clone();
    trackers
        .into_iter()
        .map(|mut tracker| {
            let mut row = tracker["aggregates"][0].take();
            row["tracker"] = tracker["tracker"].take();
            row
        })
        .collect()
}

fn a_run_scored_again_has_the_same_figures() {
    let dir = with_data(&[9, 7]);
    let path = dir.path();
    for logs in ["csv", "zst"] {
        program(path)
            .args([
                "run",
                "data",
                "--res",
                "20x20",
                "--ssm",
                "translation,affine",
                "--force",
                "-q",
                "-o",
                "run",
                "--frame-logs",
                logs,
            ])
            .assert()
            .success();
        let again = score(path, &["run"]);
        let summary: Value =
            serde_json::from_slice(&fs::read(path.join("run/summary.json")).unwrap()).unwrap();
        let own = summary["trackers"].as_array().unwrap();
        assert_eq!((again.len(), own.len()), (2, 2));
        for tracker in own {
            let name = &tracker["tracker"];
            let row = again.iter().find(|row| row["tracker"] == *name).unwrap();
            for figure in [
                "sr_1",
                "auc",
                "al_mean",
                "al_median",
                "cl_median",
                "jaccard_mean",
                "failures",
                "frames",
            ] {
                assert_eq!(row[figure], tracker["aggregates"][0][figure], "{name} {figure}");
            }
        }
    }
}

/// What `best` and `guard` say of a lost object never changes a score: the corners beside it do.
fn corners_of_an_absent_object_count() {
    let dir = with_data(&[4]);
    let path = dir.path();
    let row = |f: usize, status: &str, by: f64| {
        let corners: Vec<String> = corners(f, by).iter().map(f64::to_string).collect();
        format!("{f},frame{:05}.png,{status},{},1,0.5\n", f + 1, corners.join(","))
    };
    let header = "frame,file,status,x1,y1,x2,y2,x3,y3,x4,y4,iterations,similarity\n";
    let rows = [
        row(0, "init", 0.0),
        row(1, "ok", 1.0),
        row(2, "absent", 2.0),
        row(3, "absent", 3.0),
    ];
    put(path, "r/T/seq0.csv", &(header.to_owned() + &rows.concat()));
    let scored = score(path, &["r"]);
    assert_eq!(
        (&scored[0]["al_mean"], &scored[0]["failures"]),
        (&2.0.into(), &0.into())
    );
    let log = fs::read_dir(path.join("out/frames"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path();
    let log = fs::read_to_string(log.join("data/seq0.csv")).unwrap();
    assert_eq!(log.matches(",absent,").count(), 2, "{log}");
}

fn layouts_and_forms() {
    let dir = with_data(&[4, 3]);
    let path = dir.path();
    let log = |n: usize| {
        (0..n).fold(
            "frame ulx uly urx ury lrx lry llx lly\n".to_owned(),
            |mut text, f| {
                let row: Vec<String> = corners(f, 3.0).iter().map(f64::to_string).collect();
                let _ = writeln!(text, "frame{:05}.jpg\t{}", f + 1, row.join("\t"));
                text
            },
        )
    };
    for (name, one, two) in [
        ("a", "KCF/seq0.txt", "KCF/seq1.txt"),
        ("b", "KCF/seq0_KCF.txt", "KCF/seq1_KCF.txt"),
        ("c", "seq0/seq0_KCF.txt", "seq1/seq1_KCF.txt"),
        ("d", "seq0_KCF.txt", "seq1_KCF.txt"),
        ("e", "KCF_seq0.csv", "KCF_seq1.csv"),
        ("f", "KCF/seq0/seq0_001.txt", "KCF/seq1/seq1_001.txt"),
    ] {
        put(&path.join(name), one, &rows(0..4, 3.0));
        put(&path.join(name), two, &log(3));
        let scored = score(path, &[name]);
        assert_eq!(scored.len(), 1, "{name}");
        let row = &scored[0];
        assert_eq!(row["tracker"], "KCF", "{name}");
        assert_eq!(
            (&row["frames"], &row["al_mean"]),
            (&5.into(), &3.0.into()),
            "{name}"
        );
    }
    // A single sequence needs no name; its results may lie anywhere.
    put(path, "mine.txt", &rows(0..4, 1.0));
    let scored = score(path, &["mine.txt", "--seq", "seq0"]);
    assert_eq!(
        (&scored[0]["tracker"], &scored[0]["al_mean"]),
        (&"mine".into(), &1.0.into())
    );
    // Several at once, and ground truth alone in place of the data.
    put(path, "both/a_seq0.txt", &rows(0..4, 0.0));
    put(path, "both/b_seq0.txt", &rows(0..4, 2.0));
    put(path, "both/seq0_groundtruth.txt", &log(4).replace(".jpg", ".png"));
    program(path)
        .args([
            "score",
            "both/seq0_groundtruth.txt",
            "both",
            "-o",
            "alone",
            "--format",
            "csv",
        ])
        .assert()
        .success()
        .stdout(contains("a,,,,,pooled,al,ope,1,1,0,3,").and(contains("b,,,,,pooled,al,ope")))
        .stderr(contains("2 files of results, called {tracker}_{seq}"));
}

fn what_is_missing_counts_as_failure_and_is_told() {
    let dir = with_data(&[6, 5]);
    let path = dir.path();
    // The first row is the region of the start, so the last frames are missing; one is absent; a whole sequence is missing.
    put(
        path,
        "r/T/seq0.txt",
        &format!(
            "{}nan,nan,nan,nan,nan,nan,nan,nan\n{}",
            rows(0..2, 0.0),
            rows(3..4, 0.0)
        ),
    );
    program(path)
        .args(["score", "data", "r", "-o", "out"])
        .assert()
        .success()
        .stderr(contains("T: no result for 7 of 11 frames, which count as failures (data/seq0 and 1 more)"))
        .stdout(contains("with frames that have no result and count as failures (data/seq0: T has no result for 2 of 6 frames"));
    let rows = fs::read_to_string(path.join("out/sequences.csv")).unwrap();
    let of = |sequence: &str| rows.lines().find(|l| l.contains(sequence)).unwrap().to_owned();
    assert!(of("seq0").contains(",5,0.400000,"), "{rows}");
    assert!(of("seq1").contains(",4,0.000000,"), "{rows}");
    let log = fs::read_dir(path.join("out/frames"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path()
        .join("data/seq0.csv");
    let log = fs::read_to_string(log).unwrap();
    let status = |k: usize| {
        log.lines()
            .nth(k + 1)
            .unwrap()
            .split(',')
            .nth(2)
            .unwrap()
            .to_owned()
    };
    assert_eq!(
        [0, 1, 2, 3, 4].map(status),
        ["init", "ok", "absent", "ok", "missing"]
    );
    // All rows present, nothing to be told.
    put(path, "whole/T/seq0.txt", &crate::score::rows(0..6, 0.0));
    put(path, "whole/T/seq1.txt", &crate::score::rows(0..5, 0.0));
    program(path)
        .args(["score", "data", "whole", "-o", "out2"])
        .assert()
        .success()
        .stdout(contains("no result").not());
}

fn the_first_row_is_found_out_or_asked_for() {
    let dir = with_data(&[5]);
    let path = dir.path();
    put(path, "late/T/seq0.txt", &rows(1..5, 0.5));
    let refused = ["score", "data", "late", "-o", "out"];
    program(path)
        .args(refused)
        .assert()
        .code(2)
        .stderr(contains("late/T/seq0.txt: 4 rows for 5 frames").and(contains("--first-frame-included no")));
    let scored = score(path, &["late", "--first-frame-included", "no"]);
    assert_eq!(
        (&scored[0]["frames"], &scored[0]["al_mean"]),
        (&4.into(), &0.5.into())
    );
    // Taken for the first frames, they are a frame late.
    let scored = score(path, &["late", "--first-frame-included", "yes"]);
    assert_eq!(scored[0]["sr_1"].as_f64(), Some(0.75));
    assert!(scored[0]["al_mean"].as_f64().unwrap() > 5.0);
    put(path, "more/T/seq0.txt", &rows(0..9, 0.0));
    program(path)
        .args(["score", "data", "more", "-o", "out"])
        .assert()
        .code(2)
        .stderr(contains("9 rows for 5 frames"));
    // All frames of the video, of which some are chosen; or as many as are.
    put(path, "all/T/seq0.txt", &rows(0..5, 0.25));
    let scored = score(path, &["all", "--frame-gap", "2"]);
    assert_eq!(
        (&scored[0]["frames"], &scored[0]["al_mean"]),
        (&2.into(), &0.25.into())
    );
    put(path, "every/T/seq0.txt", &rows((0..5).step_by(2), 0.25));
    let scored = score(path, &["every", "--frame-gap", "2"]);
    assert_eq!(scored[0]["al_mean"].as_f64(), Some(0.25));
}

fn boxes_are_scored_by_what_they_say() {
    let dir = with_data(&[4]);
    let path = dir.path();
    // The upper left corner of pixel (20, 15) is at (19.5, 14.5): a box of the pixels' edges has an origin of 0.5.
    let boxes = |shift: f64| {
        (0..4).fold(String::new(), |mut text, f| {
            let [x, y, right, _, _, below, ..] = corners(f, 0.0);
            let _ = writeln!(text, "{} {} {} {}", x + shift, y + shift, right - x, below - y);
            text
        })
    };
    put(path, "r/B/seq0.txt", &boxes(0.5));
    let scored = score(path, &["r"]);
    let row = &scored[0];
    assert_eq!(
        (&row["cl_mean"], &row["jaccard_mean"]),
        (&0.0.into(), &0.0.into()),
        "{row}"
    );
    for figure in ["auc", "sr_5", "al_mean", "al_median", "mcd_mean", "sr_area"] {
        assert_eq!(row[figure], Value::Null, "{figure}");
    }
    assert_eq!((&row["frames"], &row["failures"]), (&3.into(), &0.into()));
    program(path)
        .args(["score", "data", "r", "-o", "out2"])
        .assert()
        .success()
        .stdout(contains("trackers without success rates give boxes").and(contains("CL median")))
        .stderr(contains(
            "boxes, read as xywh with the first pixel's centre at 0.5",
        ));
    let scored = score(path, &["r", "--origin", "0"]);
    assert!((scored[0]["cl_mean"].as_f64().unwrap() - 0.5f64.hypot(0.5)).abs() < 1e-6);
    // Beside a tracker with corners, and in the figures of a benchmark.
    put(path, "r/C/seq0.txt", &rows(0..4, 1.0));
    program(path)
        .args(["score", "data", "r", "-o", "out3", "--report-as", "planartrack"])
        .assert()
        .success()
        .stdout(
            contains("C")
                .and(contains("1.000"))
                .and(predicates::str::is_match("B +- +- +-").unwrap()),
        );
    put(path, "mixed/B/seq0.txt", &boxes(0.5));
    write_data(&path.join("data"), &[4, 3]);
    put(path, "mixed/B/seq1.txt", &rows(0..3, 0.0));
    program(path)
        .args(["score", "data", "mixed", "-o", "out4"])
        .assert()
        .code(2)
        .stderr(contains("give them apart"));
}

fn homographies_go_the_way_that_is_said() {
    let dir = with_data(&[4]);
    let path = dir.path();
    let matrices = |sign: f64| {
        (0..4).fold(String::new(), |mut text, f| {
            let (dx, dy) = (sign * (f as f64 / 3.0), sign * (f as f64 / 5.0));
            let _ = writeln!(text, "1 0 {dx} 0 1 {dy} 0 0 1");
            text
        })
    };
    put(path, "to/T/seq0.txt", &matrices(1.0));
    put(path, "from/T/seq0.txt", &matrices(-1.0));
    for (folder, way) in [("to", "from-first"), ("from", "to-first")] {
        let scored = score(path, &[folder, "--homographies", way]);
        assert!(scored[0]["al_mean"].as_f64().unwrap() < 1e-5, "{way}");
        let other = if way == "to-first" {
            "from-first"
        } else {
            "to-first"
        };
        assert!(
            score(path, &[folder, "--homographies", other])[0]["al_mean"]
                .as_f64()
                .unwrap()
                > 0.5
        );
    }
    // Never guessed.
    program(path)
        .args(["score", "data", "to", "-o", "out"])
        .assert()
        .code(2)
        .stderr(contains("to/T/seq0.txt:1:").and(contains("--homographies")));
    // Three lines each.
    put(
        path,
        "lines/T/seq0.txt",
        &(0..4).fold(String::new(), |mut text, f| {
            let _ = writeln!(text, "1 0 {}\n0 1 {}\n0 0 1", f as f64 / 3.0, f as f64 / 5.0);
            text
        }),
    );
    assert!(
        score(path, &["lines", "--homographies", "from-first"])[0]["al_mean"]
            .as_f64()
            .unwrap()
            < 1e-5
    );
}

fn results_that_cannot_be_read_are_refused() {
    let dir = with_data(&[4]);
    let path = dir.path();
    let good = rows(0..4, 0.0);
    for (name, text, message) in [
        (
            "word",
            good.replacen("20", "x20", 1),
            "word/T/seq0.txt:1: `x20` is not a number",
        ),
        (
            "short",
            good.replacen("20,15,", "", 1),
            "short/T/seq0.txt:1: 6 numbers instead of 8",
        ),
        ("empty", String::new(), "empty/T/seq0.txt: "),
        (
            "restarted",
            format!("1\n{}2\n0\n", rows(1..2, 0.0)),
            "restarted/T/seq0.txt:3: results of an experiment that starts",
        ),
        (
            "names",
            "a.png 1 2 3 4 5 6 7 8\nb.png 1 2 3 4 5 6 7 8\n".into(),
            "names/T/seq0.txt: none of its rows",
        ),
        (
            "log",
            "frame,file,status,x1,y1\n0,frame00001.png,ok,1,2\n".into(),
            "log/T/seq0.txt:2: a damaged frame log",
        ),
    ] {
        put(path, &format!("{name}/T/seq0.txt"), &text);
        program(path)
            .args(["score", "data", name, "-o", "out"])
            .assert()
            .code(2)
            .stderr(contains(message));
    }
    put(path, "other/T/nothing.txt", &good);
    write_data(&path.join("data"), &[4, 4]);
    program(path)
        .args(["score", "data", "other", "-o", "out"])
        .assert()
        .code(2)
        .stderr(
            contains("other: no results")
                .and(contains("such as `seq0`"))
                .and(contains("{tracker}/{seq}")),
        );
    program(path)
        .args(["score", "data", "nowhere", "-o", "out"])
        .assert()
        .code(2)
        .stderr(contains("nowhere: no such file or folder"));
    put(path, "twice/T/seq0.txt", &good);
    put(path, "twice/seq0_T.txt", &good);
    program(path)
        .args(["score", "data", "twice", "-o", "out"])
        .assert()
        .code(2)
        .stderr(contains("results of T on seq0"));
    assert!(!path.join("out").exists());
}

fn a_workspace_of_the_vot_toolkit() {
    let dir = with_data(&[4, 3]);
    let path = dir.path();
    let region = |bytes: &mut Vec<u8>, f: usize| {
        bytes.extend([2, 4, 0]);
        corners(f, 1.0)
            .iter()
            .for_each(|v| bytes.extend((*v as f32).to_le_bytes()));
    };
    let mut bytes = vec![1, 0, 4, 0, 0, 0, 0, 1, 0, 0, 0];
    (1..4).for_each(|f| region(&mut bytes, f));
    let folder = path.join("w/results/KCF/baseline/seq0");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("seq0_001.bin"), &bytes).unwrap();
    put(
        path,
        "w/results/KCF/baseline/seq0/seq0_001_time.value",
        "0.1\n0.02\n0.02\n0.02\n",
    );
    put(
        path,
        "w/results/KCF/baseline/seq1/seq1_001.txt",
        &format!("1\n{}", rows(1..3, 1.0)),
    );
    let scored = score(path, &["w"]);
    assert_eq!(
        (&scored[0]["tracker"], &scored[0]["frames"]),
        (&"KCF".into(), &5.into())
    );
    assert!((scored[0]["al_mean"].as_f64().unwrap() - 1.0).abs() < 1e-5);
    let timing = fs::read_to_string(path.join("out/timing.csv")).unwrap();
    assert!(timing.contains("KCF,data,seq0,0,3,0.060000,50.00,"), "{timing}");
    assert!(timing.contains("KCF,data,seq1,0,0,0.000000,,"), "{timing}");
    bytes.pop();
    fs::write(folder.join("seq0_001.bin"), &bytes).unwrap();
    program(path)
        .args(["score", "data", "w", "-o", "out"])
        .assert()
        .code(2)
        .stderr(contains("ends in region 4"));
}

fn benchmarks_are_reported_with_their_captions() {
    let dir = with_data(&[4, 3]);
    let path = dir.path();
    let run = ["run", "data", "--res", "20x20", "-q", "-o", "run"];
    program(path)
        .args(run)
        .args(["--report-as", "planartrack", "--with-published"])
        .assert()
        .success()
        .stdout(contains("WOFT (published)").and(contains("0.433")).and(contains(
            "as planartrack: means over sequences, the first frame not counted (Liu et al.",
        )));
    for benchmark in ["planartrack", "pot", "vot", "tmt", "otb"] {
        let output = program(path)
            .args(run)
            .args(["--report-as", benchmark, "--format", "json"])
            .output()
            .unwrap();
        let document: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(
            (&document["benchmark"], &document["trackers"][0]["frames"]),
            (&benchmark.into(), &5.into())
        );
    }
    program(path)
        .args(run)
        .args(["--report-as", "nothing"])
        .assert()
        .code(2)
        .stderr(contains("planartrack, pot, vot, tmt, otb, longterm"));
    program(path)
        .args([
            "run",
            "data",
            "--res",
            "20x20",
            "-q",
            "-o",
            "bare",
            "--frame-logs",
            "none",
            "--report-as",
            "pot",
        ])
        .assert()
        .code(2)
        .stderr(contains("kept no frame logs"));
}

/// What the independent program says.
fn independent(truth: &Path, result: &Path) -> Value {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/field_figures.py");
    let output = Command::new("python3")
        .arg(script)
        .args([truth, result])
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

fn assert_equal(
    dir: &Path,
    data: &Path,
    results: &Path,
    files: &[(String, std::path::PathBuf)],
    truth: &Path,
) {
    let of = |more: &[&str]| -> Value {
        let output = program(dir)
            .arg("score")
            .args([data, results])
            .args(["--format", "json", "-o", "out", "-q"])
            .args(more)
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let summary = of(&[]);
    let benchmarks =
        ["planartrack", "pot", "vot", "tmt", "otb"].map(|name| (name, of(&["--report-as", name])));
    for (tracker, file) in files {
        let expected = independent(truth, file);
        let own = |document: &Value| {
            let rows = document["trackers"].as_array().unwrap();
            rows.iter()
                .find(|row| row["tracker"] == tracker.as_str())
                .unwrap()
                .clone()
        };
        let near = |about: &str, ours: &Value, theirs: &Value| {
            for (name, value) in theirs.as_object().unwrap() {
                let (ours, theirs) = (ours[name].as_f64().unwrap(), value.as_f64().unwrap());
                assert!(
                    (ours - theirs).abs() <= 1.5e-6,
                    "{tracker} {about} {name}: {ours}, {theirs}"
                );
            }
        };
        near("summary", &own(&summary)["aggregates"][0], &expected["summary"]);
        for (name, document) in &benchmarks {
            near(name, &own(document)["figures"], &expected[*name]);
        }
    }
}

fn figures_are_those_of_an_independent_program() {
    let dir = with_data(&[40]);
    let path = dir.path();
    // Errors from none to far beyond all thresholds, a corner at a time.
    let text = (0..40).fold(
        "frame ulx uly urx ury lrx lry llx lly\n".to_owned(),
        |mut text, f| {
            let mut row = corners(f, 0.37 * f as f64);
            row[f % 8] += 0.21 * f as f64;
            let row: Vec<String> = row.iter().map(|v| format!("{v:.6}")).collect();
            let _ = writeln!(text, "frame{:05}.png {}", f + 1, row.join(" "));
            text
        },
    );
    put(path, "r/T_seq0.txt", &text);
    let files = [("T".to_owned(), path.join("r/T_seq0.txt"))];
    assert_equal(
        path,
        &path.join("data"),
        &path.join("r"),
        &files,
        &path.join("data/seq0.txt"),
    );
}

fn other_programs_logs_score_as_an_independent_program_says() {
    let logs = shared("reference/corner_logs");
    let truth = logs.join("seqA_groundtruth.txt");
    let dir = tempfile::tempdir().unwrap();
    let names = fs::read_dir(&logs).unwrap().map(|entry| entry.unwrap().path());
    let files: Vec<_> = names
        .filter_map(|path| {
            let name = path.file_name()?.to_str()?.strip_suffix("_seqA.txt")?.to_owned();
            Some((name, path))
        })
        .collect();
    assert!(files.len() > 5);
    assert_equal(dir.path(), &truth, &logs, &files, &truth);
}
