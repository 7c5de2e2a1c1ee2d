//! Limits of memory and time, as a user meets them: single trackers are refused or ended, the others go on.

use crate::runs::program;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::path::Path;

crate::tests! {
    a_tracker_that_needs_too_much_memory_is_refused;
    time_limits_end_a_long_start;
    speeds_of_too_large_a_tracker_are_refused;
}

const LARGE: [&str; 4] = [
    "nn/ssd/homography{n_samples=1000000}",
    "regression/ssd/homography{n_samples=1000000}",
    "grid(iclk/ssd/translation; size=300x300)",
    "grid(grid(iclk/ssd/translation; size=1000x1000); size=1000x1000)",
];

/// `run` on a few frames of three easy sequences.
fn run(dir: &Path) -> assert_cmd::Command {
    let mut program = program(dir);
    program.args([
        "run",
        "--seq",
        "plain-page",
        "--seq",
        "plain-painting",
        "--seq",
        "noise",
        "--max-frames",
        "3",
        "--out",
        "out",
    ]);
    program
}

/// How many CSV files lie in a folder and those below.
fn logs_in(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let count = |path: std::path::PathBuf| match path.is_dir() {
        true => logs_in(&path),
        false => usize::from(path.extension().is_some_and(|e| e == "csv")),
    };
    entries.map(count).sum()
}

fn a_tracker_that_needs_too_much_memory_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    // Resuming meets the same.
    for _ in 0..2 {
        let mut run = run(dir.path());
        run.args(["--memory", "500M", "--tracker", "esm/ssd/homography"]);
        for large in LARGE {
            run.args(["--tracker", large]);
        }
        run.assert()
            .code(20)
            .stderr(contains("12 failed").and(contains(
                "on builtin/noise: needs about 6.9 GiB, more than allowed (500 MiB); use fewer samples or patches",
            )));
        let sequences = fs::read_to_string(dir.path().join("out/sequences.csv")).unwrap();
        for large in LARGE {
            let rows = sequences.lines().filter(|row| row.contains(large));
            assert_eq!(
                rows.filter(|row| row.contains("more than allowed")).count(),
                3,
                "{sequences}"
            );
        }
    }
    let count = logs_in(&dir.path().join("out/frames"));
    assert_eq!(count, 3, "those of esm alone");
}

fn time_limits_end_a_long_start() {
    let dir = tempfile::tempdir().unwrap();
    // Takes minutes to start.
    let long = "nn/mi/homography{index=gnn,n_samples=100000,res=12x12}";
    run(dir.path())
        .args(["--tracker", long, "--max-time", "1", "--grace", "0"])
        .timeout(std::time::Duration::from_secs(120))
        .assert()
        .code(75)
        .stderr(contains("0 of 3 units (one tracker on one sequence each) done"));
    run(dir.path())
        .args([
            "--tracker",
            long,
            "--timeout",
            "0.5",
            "--tracker",
            "esm/ssd/homography",
        ])
        .timeout(std::time::Duration::from_secs(120))
        .assert()
        .code(20)
        .stderr(contains(format!("{long} on builtin/noise: longer than 0.5 s")));
}

fn speeds_of_too_large_a_tracker_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let tracker = ["--tracker", "nn/ssd/homography{n_samples=1000000}"];
    for command in [&["bench", "--max-frames", "3", "--seq", "noise"][..], &["basin"]] {
        program(dir.path())
            .args(command)
            .args(tracker)
            .assert()
            .failure()
            .stderr(contains("GiB, more than allowed (3.0 GiB)"));
    }
}
