//! `bench` from outside: what it reports, never how long anything takes.

use crate::runs::{program, write_data};
use assert_cmd::assert::Assert;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;
use std::fs;
use std::path::Path;

crate::tests! {
    measures_saves_compares_and_draws;
    refuses_other_data_frames_and_filters;
    limits_fail_and_targets_mark;
    runs_are_sorted_by_speed;
}

fn measures_saves_compares_and_draws() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[6, 5]);
    let bench = |args: &[&str]| {
        let mut command = program(dir);
        command
            .args(["bench", "data", "--res", "20x20", "--repeats", "1"])
            .args(args);
        command.assert()
    };
    bench(&[
        "--sm",
        "esm,pf",
        "--am",
        "ssd,sad",
        "--set",
        "pf.n_particles=30",
        "--save",
        "ours.json",
    ])
    .success()
    .stdout(
        contains("us/iteration")
            .and(contains(
                "refused: esm/sad/homography{res=20x20}: sad has no derivatives",
            ))
            .and(contains("rustc 1."))
            .and(contains("fps with input"))
            .and(contains(" times (95 % interval ").and(contains(") faster than "))),
    );
    let saved: Value = serde_json::from_slice(&fs::read(dir.join("ours.json")).unwrap()).unwrap();
    let rows = saved["rows"].as_array().unwrap();
    let ids: Vec<&str> = rows.iter().map(|r| r["tracker"].as_str().unwrap()).collect();
    assert_eq!(ids.len(), 3, "{ids:?}");
    let esm = ids
        .iter()
        .position(|id| *id == "esm/ssd/homography{res=20x20}")
        .unwrap();
    assert_eq!(
        (&rows[esm]["frames"], &rows[esm]["sr_5"]),
        (&9.into(), &1.0.into())
    );
    assert!(rows[esm]["us_per_iteration"].as_f64().unwrap() > 0.0);
    // Fastest first, with a word on how much.
    let speeds: Vec<f64> = rows.iter().map(|r| r["fps"].as_f64().unwrap()).collect();
    assert!(speeds.is_sorted_by(|a, b| a >= b), "{speeds:?}");
    assert!(
        rows.iter()
            .all(|r| r["fps_with_input"].as_f64() < r["fps"].as_f64())
    );
    assert_eq!(
        (&saved["lead"]["fastest"], &saved["lead"]["next"]),
        (&ids[0].into(), &ids[1].into())
    );
    assert!(saved["lead"]["times"].as_f64().unwrap() >= 1.0);
    for field in ["cpu", "cores", "os", "simd", "rustc", "build", "version"] {
        assert!(!saved["machine"][field].is_null(), "{field}");
    }
    assert_eq!(saved["refused"][0][0], "esm/sad/homography{res=20x20}");

    // Another program's figures beside ours: it says nothing of its data.
    let mut row = rows[esm].clone();
    row["program"] = "Other 1.0".into();
    row["frames"] = 8.into();
    row["lost"] = 1.into();
    let other = serde_json::json!({ "schema_version": 1, "rows": [row] });
    fs::write(dir.join("other.json"), other.to_string()).unwrap();
    bench(&["--against", "other.json", "--chart", "bars.svg"])
        .success()
        .stdout(
            contains("Other 1.0")
                .and(contains("times, iteration"))
                .and(contains(
                    "the numbers of frames differ: updates without a result have no time: \
             esm/ssd/homography{res=20x20} (Other 1.0) 1 of 9",
                )),
        );
    let svg = fs::read_to_string(dir.join("bars.svg")).unwrap();
    assert!(svg.contains("esm/ssd/homography{res=20x20}") && svg.contains("Other 1.0"));
    for format in ["csv", "md", "json"] {
        bench(&["--against", "other.json", "--format", format])
            .success()
            .stdout(contains("Other 1.0"));
    }
    fs::write(dir.join("other.json"), "{\"schema_version\": 9, \"rows\": []}").unwrap();
    bench(&["--against", "other.json"])
        .code(2)
        .stderr(contains("version 9"));
    bench(&["--sm", "esn"]).code(2).stderr(contains("did you mean"));
    bench(&["--seq", "none"]).code(4);
}

/// `bench` of one tracker on what `write_data` made in `dir`.
fn bench_iclk(dir: &Path, args: &[&str]) -> Assert {
    let mut command = program(dir);
    command
        .args([
            "bench",
            "data",
            "--tracker",
            "iclk/ssd/affine{res=20x20}",
            "--repeats",
            "1",
        ])
        .args(args);
    command.assert()
}

fn refuses_other_data_frames_and_filters() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[6, 5]);
    bench_iclk(dir, &["--save", "saved.json"]).success();
    let against = |args: &[&str]| bench_iclk(dir, &[&["--against", "saved.json"], args].concat());
    against(&[]).success();
    for (args, why) in [
        (&["--max-frames", "4"][..], "data/seq0 has 6 frames there, 4 here"),
        (&["--seq", "seq0"], "data/seq1 is not measured here"),
        (&["--pre", "none"], "filter gaussian:5:3 there, none here"),
    ] {
        against(args)
            .code(11)
            .stderr(contains("saved.json").and(contains(why)).and(contains(
                "it was made by: mtf-eval bench data --tracker iclk/ssd/affine{res=20x20}",
            )));
    }
    // Settings are told, not refused.
    against(&["--seed", "3"])
        .success()
        .stderr(contains("saved.json was measured with --seed 0, this with 3"));
    let mut command = program(dir);
    command.args([
        "bench",
        "data",
        "--tracker",
        "esm/ssd/affine",
        "--repeats",
        "1",
        "--against",
        "saved.json",
    ]);
    command
        .assert()
        .success()
        .stderr(contains("saved.json has no row of the trackers measured here"));
    // The same names, another picture.
    fs::copy(
        dir.join("data/seq0/frame00002.png"),
        dir.join("data/seq0/frame00003.png"),
    )
    .unwrap();
    against(&[])
        .code(11)
        .stderr(contains("data/seq0 has other frames or ground truth there"));
}

fn limits_fail_and_targets_mark() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[5]);
    let bench = |args: &[&str]| bench_iclk(dir, args);
    bench(&["--fail-above", "1e9", "--fail-below", "1e-6"]).success();
    bench(&["--fail-above", "1e-6"])
        .code(10)
        .stderr(contains("us per update, more than --fail-above 0.000001"));
    bench(&["--fail-below", "1e9"])
        .code(10)
        .stderr(contains("updates per second, fewer than --fail-below 1000000000"));
    bench(&["--target-fps", "0.001"])
        .success()
        .stdout(contains("0.001 fps").and(contains("fewer than").not()));
    bench(&["--target-fps", "1e9"]).success().stdout(contains(
        "fewer than 1000000000 frames per second with input: iclk/ssd/affine{res=20x20}",
    ));
    let json = bench(&["--target-fps", "1e9", "--format", "json"]).success();
    let json: Value = serde_json::from_slice(&json.get_output().stdout).unwrap();
    assert_eq!(json["below_target"][0], "iclk/ssd/affine{res=20x20}");
    bench(&["--target-fps", "0"]).code(2).stderr(contains("above 0"));
}

fn runs_are_sorted_by_speed() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[5]);
    let run = |args: &[&str]| {
        let mut command = program(dir);
        command
            .args([
                "run",
                "data",
                "--sm",
                "iclk,esm",
                "--am",
                "ssd",
                "--ssm",
                "translation",
                "--res",
                "20x20",
            ])
            .args(args);
        let output = command.assert().success().get_output().stdout.clone();
        String::from_utf8(output).unwrap()
    };
    let table = run(&["--out", "out", "--sort", "fps"]);
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines[0].ends_with("fps"), "{table}");
    let speed = |line: &str| -> f64 { line.split_whitespace().last().unwrap().parse().unwrap() };
    assert!(
        speed(lines[1]) >= speed(lines[2]) && speed(lines[2]) > 0.0,
        "{table}"
    );
    // What else is printed is the same in every run.
    assert!(!run(&["--out", "out"]).contains("fps"));
}
