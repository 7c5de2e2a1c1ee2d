//! Protocols from outside: trackers that lose the object of an embedded sequence and are started anew.

use crate::runs::{assert_same, program, write_data};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

crate::tests! {
    a_tracker_that_loses_the_object_is_started_anew;
    fitted_truth_is_that_of_the_start;
    a_failure_shows_the_errors_of_its_frame;
    grids_list_protocols;
}

/// Trackers for which the sequence is too fast.
const FAST: [&str; 10] = [
    "run",
    "--seq",
    "fast",
    "--sm",
    "iclk,pf",
    "--res",
    "25x25",
    "--set",
    "pf.n_particles=40",
    "--quiet",
];
const FOUR: [&str; 2] = ["--protocol", "reinit,ope,every:5,subseq:2"];

/// The rows of a CSV file, by column.
fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.deserialize().map(Result::unwrap).collect()
}

/// The pooled row of a tracker under a protocol.
fn pooled(dir: &Path, tracker: &str, protocol: &str) -> BTreeMap<String, String> {
    let all = rows(&dir.join("summary.csv"));
    let mut all = all.into_iter();
    all.find(|r| r["tracker"].starts_with(tracker) && r["average"] == "pooled" && r["protocol"] == protocol)
        .unwrap()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap()
}

/// The four corners in columns `x1` to `y4`; `None` where they are empty.
fn corners(row: &BTreeMap<String, String>) -> Option<[[f64; 2]; 4]> {
    let at = |k: usize| {
        let of = |axis: &str| row[&format!("{axis}{}", k + 1)].parse().ok();
        Some([of("x")?, of("y")?])
    };
    Some([at(0)?, at(1)?, at(2)?, at(3)?])
}

/// What a translation can follow, from each start: the corners of the start, moved as the mean of the corners was.
fn fitted_truth_is_that_of_the_start() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let words = "run --seq fast --sm iclk --res 25x25 --quiet --out";
    let run = |out: &str, more: &[&str]| {
        program(dir)
            .args(words.split(' '))
            .arg(out)
            .args(more)
            .assert()
            .success();
    };
    run("plain", &[]);
    let protocols = [
        "--protocol",
        "ope,subseq:4,reinit,every:5",
        "--ssm",
        "translation",
    ];
    run("fitted", &[&protocols[..], &["--gt-ssm", "translation"]].concat());
    let truth: Vec<_> = rows(&dir.join("plain/truth.csv"))
        .iter()
        .filter_map(corners)
        .collect();
    let fitted = |start: usize, i: usize| {
        let mut moved = truth[start];
        for axis in 0..2 {
            let mean = |of: usize| truth[of].iter().map(|c| c[axis]).sum::<f64>() / 4.0;
            moved.iter_mut().for_each(|c| c[axis] += mean(i) - mean(start));
        }
        moved
    };
    let apart = |a: [[f64; 2]; 4], b: [[f64; 2]; 4]| {
        let squares = a
            .iter()
            .zip(b)
            .map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2));
        (squares.sum::<f64>() / 4.0).sqrt()
    };
    let logs = fs::read_dir(dir.join("fitted/frames"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path();
    let logs: Vec<_> = fs::read_dir(logs.join("builtin"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    assert_eq!(logs.len(), 4 + 2, "{logs:?}");
    let (mut starts, mut scored) = (0, 0);
    for path in logs {
        let every = path.to_str().unwrap().contains("every");
        let mut since = 0;
        for row in rows(&path) {
            let frame: usize = row["frame"].parse().unwrap();
            if row["status"] == "init" {
                since = frame;
                starts += 1;
                assert!(
                    apart(corners(&row).unwrap(), truth[frame]) < 2e-6,
                    "{path:?} {frame}"
                );
            } else if let Some(corners) = corners(&row) {
                let expected = apart(corners, fitted(since, frame));
                assert!(
                    (number(&row, "al") - expected).abs() < 1e-5,
                    "{path:?} {frame}: {expected} {row:?}"
                );
                scored += 1;
            }
            if every && frame > since && (frame - since).is_multiple_of(5) {
                since = frame;
            }
        }
    }
    assert!(
        starts >= 4 + 2 + 2 && scored > 100,
        "{starts} starts, {scored} frames"
    );
    // The tables are of the same errors, whether logs are kept or not.
    run(
        "unkept",
        &[
            &protocols[..],
            &["--gt-ssm", "translation", "--frame-logs", "none"],
        ]
        .concat(),
    );
    let read = |out: &str| fs::read_to_string(dir.join(out).join("sequences.csv")).unwrap();
    assert_eq!(read("fitted"), read("unkept"));
}

/// The dense error of a frame in which a tracker failed is that of the points that it gave, as its alignment error is.
fn a_failure_shows_the_errors_of_its_frame() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let words = "run --seq bending --sm iclk --res 25x25 --quiet --protocol reinit:0.5:3 --out out";
    program(dir).args(words.split(' ')).assert().success();
    let folder = fs::read_dir(dir.join("out/frames"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path();
    let log = fs::read_dir(folder.join("builtin"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path();
    let failed: Vec<_> = rows(&log)
        .into_iter()
        .filter(|r| r["status"] == "failed" && !r["al"].is_empty())
        .collect();
    assert!(!failed.is_empty());
    assert!(
        failed.iter().all(|row| number(row, "grid").is_finite()),
        "{failed:?}"
    );
    // It counts as a failure all the same.
    let row = pooled(&dir.join("out"), "iclk", "reinit:0.5:3");
    assert!(
        number(&row, "failures") >= failed.len() as f64 && number(&row, "grid_mean") < 20.0,
        "{row:?}"
    );
}

fn a_tracker_that_loses_the_object_is_started_anew() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    program(dir)
        .args(FAST)
        .args(FOUR)
        .args(["--out", "whole", "-j", "2"])
        .assert()
        .success()
        .stdout(
            contains("frames/failure")
                .and(contains("reinit:20:5"))
                .and(contains("subseq:2")),
        );
    let whole = dir.join("whole");
    let (ope, reinit) = (
        pooled(&whole, "iclk", "ope"),
        pooled(&whole, "iclk", "reinit:20:5"),
    );
    let every = pooled(&whole, "iclk", "every:5");
    assert!(number(&ope, "sr_5") < 0.5, "{ope:?}");
    assert!(number(&every, "sr_5") > number(&ope, "sr_5"), "{every:?}");
    assert_eq!(
        (&every["frames"], &ope["frames_per_failure"]),
        (&ope["frames"], &String::new())
    );
    let failures = number(&reinit, "failures");
    assert!(
        failures >= 1.0 && number(&reinit, "al_mean") <= 20.0,
        "{reinit:?}"
    );
    let stretch = number(&reinit, "frames") / (failures + 1.0);
    assert!((number(&reinit, "frames_per_failure") - stretch).abs() < 1e-6);
    assert!((number(&reinit, "sr_20") - 1.0 + failures / number(&reinit, "frames")).abs() < 1e-6);

    // The log says the same.
    let folder = fs::read_dir(whole.join("frames")).unwrap();
    let folder = folder
        .map(|f| f.unwrap().path())
        .find(|p| p.to_string_lossy().contains("iclk"));
    let log = rows(&folder.unwrap().join("builtin/fast@reinit-20-5.csv"));
    let count = |status: &str| log.iter().filter(|r| r["status"] == status).count();
    assert_eq!(count("failed") as f64, failures);
    assert_eq!(
        log.len() - count("init") - count("skipped"),
        number(&reinit, "frames") as usize
    );
    for (at, row) in log.iter().enumerate().filter(|(_, r)| r["status"] == "failed") {
        assert!(row["al"].is_empty() || number(row, "al") > 20.0, "{row:?}");
        let after: Vec<&str> = log[at + 1..]
            .iter()
            .take(5)
            .map(|r| r["status"].as_str())
            .collect();
        let whole = ["skipped", "skipped", "skipped", "skipped", "init"];
        assert!(after == whole || log.len() - at <= 6, "{at}: {after:?}");
    }

    // In parts, one thread, some units lost on the way: the same bytes.
    for shard in ["slice:1/2", "slice:2/2"] {
        let out = shard.replace([':', '/'], "-");
        program(dir)
            .args(FAST)
            .args(FOUR)
            .args(["--shard", shard, "--out", &out, "-j", "1"])
            .assert()
            .success();
    }
    program(dir)
        .args(["merge", "joined", "slice-1-2"])
        .assert()
        .code(21)
        .stderr(contains("slice:2/2 lacks"));
    program(dir)
        .args(["merge", "joined", "slice-2-2", "slice-1-2", "-q"])
        .assert()
        .success();
    assert_same(&whole, &dir.join("joined"));
    let journal = dir.join("joined/journal.jsonl");
    let text = fs::read_to_string(&journal).unwrap();
    let kept: Vec<&str> = text.lines().step_by(2).collect();
    fs::write(&journal, kept.join("\n") + "\n").unwrap();
    program(dir)
        .args(["status", "joined"])
        .assert()
        .code(21)
        .stdout(contains("stopped"));
    program(dir)
        .args(FAST)
        .args(FOUR)
        .args(["--out", "joined"])
        .assert()
        .success();
    assert_same(&whole, &dir.join("joined"));
    program(dir).args(["status", "joined"]).assert().success();

    // One protocol alone is the same run of it, and not comparable with another.
    for protocol in ["reinit", "every:5"] {
        program(dir)
            .args(FAST)
            .args(["--protocol", protocol, "--out", protocol])
            .assert()
            .success();
    }
    program(dir)
        .args(["compare", "whole", "reinit"])
        .assert()
        .success()
        .stdout(contains("no difference"))
        .stderr(contains("of compared trackers are in whole alone"));
    program(dir)
        .args(["compare", "every:5", "reinit"])
        .assert()
        .code(11)
        .stderr(contains("protocol every:5 in every:5, reinit:20:5 in reinit"));
    program(dir)
        .args(["check", "reinit", "--baseline", "base.json", "--update-baseline"])
        .assert()
        .success();
    program(dir)
        .args(["check", "whole", "--baseline", "base.json"])
        .assert()
        .success();
    program(dir)
        .args(["check", "every:5", "--baseline", "base.json"])
        .assert()
        .code(11);
}

fn grids_list_protocols() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[10, 7]);
    let grid = "data = 'data'\nsm = ['esm', 'iclk']\nprotocol = ['subseq:3',\n 'ope', 'reinit:10']\n[params]\nres = '15x15'\n";
    fs::write(dir.join("grid.toml"), grid).unwrap();
    let plan = |args: &[&str]| -> Value {
        let mut command = program(dir);
        command
            .args(["plan", "--grid", "grid.toml", "--format", "json"])
            .args(args);
        serde_json::from_slice(&command.assert().success().get_output().stdout).unwrap()
    };
    // Starts 0, 3, 6 of 10 frames and 0, 2, 4 of 7, of which 0 serves both; and one of each sequence for reinit.
    let all = plan(&["--shards", "3"]);
    assert_eq!(all["protocol"], "ope,reinit:10:5,subseq:3");
    assert_eq!((&all["starts"], &all["units"]), (&8.into(), &16.into()));
    assert_eq!(all["frames"], 2 * (10 + 7 + 4 + 7 + 5 + 3 + 10 + 7));
    let shards = all["shards"].as_array().unwrap().iter();
    assert_eq!(shards.map(|s| s["units"].as_i64().unwrap()).sum::<i64>(), 16);
    assert_eq!(plan(&["--protocol", "every,ope"])["units"], 8);

    let run = ["run", "--grid", "grid.toml", "--out", "out", "--quiet"];
    program(dir).args(run).assert().success();
    let summary = rows(&dir.join("out/summary.csv"));
    let names: Vec<String> = summary
        .iter()
        .map(|r| format!("{} {} {}", r["sm"], r["protocol"], r["runs"]))
        .step_by(2)
        .collect();
    let expected = |sm: &str| {
        [
            format!("{sm} ope 2"),
            format!("{sm} reinit:10:5 2"),
            format!("{sm} subseq:3 6"),
        ]
    };
    assert_eq!(names, [expected("esm"), expected("iclk")].concat());
    assert_eq!(rows(&dir.join("out/sequences.csv")).len(), 2 * (2 + 2 + 6));
    program(dir)
        .args(["status", "out", "--format", "json"])
        .assert()
        .success()
        .stdout(contains("\"units\":16"));
    let journal = fs::read(dir.join("out/journal.jsonl")).unwrap();
    program(dir)
        .args(run)
        .args(["--protocol", "ope"])
        .assert()
        .success();
    assert_eq!(fs::read(dir.join("out/journal.jsonl")).unwrap(), journal);

    fs::write(dir.join("grid.toml"), grid.replace("'ope'", "'opa'")).unwrap();
    program(dir)
        .args(run)
        .assert()
        .code(2)
        .stderr(contains("grid.toml:4: protocol: unknown protocol 'opa'"));
    program(dir)
        .args(["run", "--protocol", "reinit:0"])
        .assert()
        .code(2)
        .stderr(contains("reinit[:thresh[:skip]]"));
}
