//! Nested trackers and the convergence experiment from the command line.

use crate::runs::{program, reproducible};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::{contains, is_empty};
use std::fs;

crate::tests! {
    nested_trackers_run_like_any_other;
    faults_in_nested_trackers_are_placed;
    basins_are_measured_and_repeat;
}

fn nested_trackers_run_like_any_other() {
    let dir = tempfile::tempdir().unwrap();
    let text = "cascade(pyramid(iclk/ncc/affine; levels=2), esm/ncc/homography)";
    let run = |out: &str, threads: &str| {
        program(dir.path())
            .args([
                "run",
                "--seq",
                "plain-page",
                "--seq",
                "plain-painting",
                "--seq",
                "noise",
                "--max-frames",
                "12",
                "--tracker",
                text,
                "--sm",
                "gres,pfic,lmes",
            ])
            .args([
                "--am", "ncc", "-q", "--format", "csv", "-j", threads, "--out", out,
            ])
            .assert()
            .success()
    };
    let table = String::from_utf8(run("a", "1").get_output().stdout.clone()).unwrap();
    for id in [
        text,
        "gres/ncc/homography",
        "pfic/ncc/homography",
        "lmes/ncc/homography",
    ] {
        let row = table
            .lines()
            .find(|l| l.contains(id) && l.contains("pooled"))
            .unwrap();
        assert!(row.contains(",33,1.000000,1.000000"), "{row}");
    }
    run("b", "2");
    assert_eq!(
        reproducible(&dir.path().join("a")),
        reproducible(&dir.path().join("b"))
    );
    let described = fs::read_dir(dir.path().join("a/frames"))
        .unwrap()
        .map(|e| fs::read_to_string(e.unwrap().path().join("tracker.json")).unwrap());
    let all: Vec<serde_json::Value> = described.map(|t| serde_json::from_str(&t).unwrap()).collect();
    let nested = all.iter().find(|t| t["id"] == text).unwrap();
    assert_eq!(nested["parameters"]["members"][0]["parameters"]["levels"], 2);
    let short = all.iter().find(|t| t["id"] == "gres/ncc/homography").unwrap();
    assert!(
        short["parameters"]["stands_for"]
            .as_str()
            .unwrap()
            .starts_with("cascade(flow")
    );
}

fn faults_in_nested_trackers_are_placed() {
    let dir = tempfile::tempdir().unwrap();
    for (text, message) in [
        ("cascade(esm/ssd/8", "column 18: expected ',', ';' or ')'"),
        (
            "cascade(esm/ssdd/8)",
            "unknown appearance model 'ssdd'; did you mean 'ssd'?",
        ),
        (
            "cascaed(esm/ssd/8)",
            "unknown composite tracker 'cascaed'; did you mean 'cascade'?",
        ),
        ("pyramid(esm/ssd/8, esm/ssd/8)", "expected 1 members of pyramid"),
        ("pyramid(esm/ssd/8; levels=0)", "levels=0: expected 1 to 8"),
        (
            "grid(flow; patch_size=9)",
            "patch_size is of no use to grid(flow)",
        ),
        (
            "cascade(nn/ncc/8, esm/sad/8)",
            "sad has no derivatives; esm needs them",
        ),
    ] {
        let refused = program(dir.path())
            .args(["run", "--tracker", text])
            .assert()
            .code(2);
        refused.stderr(contains(message)).stdout(is_empty());
    }
}

fn basins_are_measured_and_repeat() {
    let dir = tempfile::tempdir().unwrap();
    let basin = |threads: &str| {
        let words = "basin --sm esm,pyes --am ncc --side 120 --sigma 2,40 --trials 8 -q --format csv -j";
        let mut command = program(dir.path());
        let done = command.args(words.split(' ')).arg(threads).assert().success();
        String::from_utf8(done.get_output().stdout.clone()).unwrap()
    };
    let one = basin("1");
    assert_eq!(one, basin("2"));
    let rows: Vec<Vec<&str>> = one.lines().skip(1).map(|l| l.split(',').collect()).collect();
    assert_eq!(rows.len(), 4, "{one}");
    let header = one.lines().next().unwrap();
    assert!(header.ends_with("sigma50,threshold,perturbed_by"), "{header}");
    for row in &rows {
        assert_eq!(row[9..], ["1", "homography"], "{row:?}");
        let [rate, low, high]: [f64; 3] = std::array::from_fn(|k| row[4 + k].parse().unwrap());
        assert!(row[3] == "32" && low <= rate && rate <= high, "{row:?}");
        assert_eq!(rate > 0.95, row[2] == "2", "{row:?}");
    }
    // One threshold for every kind of search, and the warps that each can follow.
    let words = "basin --tracker nn/ssd/translation{n_samples=50} --tracker esm/ssd/translation --side 120 --sigma 2 \
                 --trials 4 --threshold 2.5 -q --format csv";
    let done = program(dir.path())
        .args(words.split(' ').filter(|w| !w.is_empty()))
        .assert()
        .success();
    let text = String::from_utf8(done.get_output().stdout.clone()).unwrap();
    assert_eq!(text.matches(",2.5,translation\n").count(), 2, "{text}");
    let mut command = program(dir.path());
    let done = command
        .args(words.split(' ').filter(|w| !w.is_empty()))
        .args(["--perturb", "homography"]);
    done.assert()
        .success()
        .stdout(contains(",2.5,homography\n").count(2));
    // What it costs is said first, and a picture drawn.
    let words = "basin --tracker esm/ssd/translation --side 120 --sigma 2,9 --trials 4 --chart basin.svg";
    let said = program(dir.path()).args(words.split(' ')).assert().success();
    said.stderr(contains(
        "1 tracker x 4 images x 2 sigmas x 4 warps = 32 starts, about",
    ));
    let chart = std::fs::read_to_string(dir.path().join("basin.svg")).unwrap();
    assert!(chart.starts_with("<svg") && chart.contains("esm/ssd/translation"));
    for (args, message) in [
        (&["--sigma", "0"][..], "numbers above 0"),
        (&["--threshold", "0"], "numbers above 0"),
        (&["missing.png"], "missing.png"),
        (&["."], "no images in this folder"),
        (&["--trials", "0"], "no trial"),
    ] {
        let refused = program(dir.path()).arg("basin").args(args).assert().code(2);
        refused.stderr(contains(message).and(contains("panicked").not()));
    }
}
