//! What a run directory promises: the same bytes however often the run was interrupted, by whatever, on any number of
//! threads.

use crate::runs::{journal_lines, program, reproducible, write_data};
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

crate::tests! {
    interruptions_and_threads_leave_no_trace;
    a_directory_in_use_is_left_alone;
}

const GRID: [&str; 8] = [
    "run",
    "data",
    "--sm",
    "lk",
    "--am",
    "ssd,zncc",
    "--progress",
    "none",
];

fn whole(dir: &Path, out: &str, threads: &str) {
    program(dir)
        .args(GRID)
        .args(["--out", out, "-j", threads])
        .assert()
        .success();
}

/// Starts the run and waits until it has finished `units` more units (or all).
fn start(dir: &Path, out: &str, units: usize) -> Child {
    let journal = dir.join(out).join("journal.jsonl");
    let lines = || fs::read(&journal).map_or(0, |bytes| bytes.iter().filter(|&&b| b == b'\n').count());
    let before = lines();
    let mut child = Command::new(assert_cmd::cargo::cargo_bin!("mtf-eval"))
        .args(GRID)
        .args(["--out", out, "-j", "2"])
        .current_dir(dir)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let begin = Instant::now();
    while lines() < before + units && child.try_wait().unwrap().is_none() {
        assert!(begin.elapsed() < Duration::from_secs(60), "no progress");
        std::thread::sleep(Duration::from_millis(1));
    }
    child
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill")
        .args([name, &child.id().to_string()])
        .stderr(Stdio::null())
        .status();
    assert!(status.is_ok());
}

fn interruptions_and_threads_leave_no_trace() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[40, 25, 60]);
    whole(dir, "one", "1");
    whole(dir, "two", "2");
    let reference = reproducible(&dir.join("one"));
    assert_eq!(reference, reproducible(&dir.join("two")));

    // Killed outright, twice, then asked to stop, then a torn line as of a machine that lost power, then left alone.
    for units in [1, 4] {
        let mut child = start(dir, "parts", units);
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let child = start(dir, "parts", 2);
    signal(&child, "-TERM");
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    match output.status.code() {
        Some(75) => assert!(said.contains("nothing lost"), "{said}"),
        // It may have been done before the signal came.
        code => assert_eq!(code, Some(0), "{said}"),
    }
    let journal = dir.join("parts/journal.jsonl");
    let before = fs::read(&journal).unwrap();
    let finished = journal_lines(&before).len();
    assert!(finished >= 7, "{finished}");
    fs::write(&journal, [&before[..], b"{\"key\": \"torn off he"].concat()).unwrap();
    whole(dir, "parts", "1");
    assert_eq!(reference, reproducible(&dir.join("parts")));
    // Nothing that was finished has been run again.
    assert!(fs::read(&journal).unwrap().starts_with(&before));

    // Nothing is left to do.
    let done = fs::read(&journal).unwrap();
    whole(dir, "parts", "2");
    assert_eq!(fs::read(&journal).unwrap(), done);
    assert_eq!(reference, reproducible(&dir.join("parts")));
}

fn a_directory_in_use_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[10]);
    fs::create_dir(dir.join("out")).unwrap();
    let mut lock = fs::File::create(dir.join("out/.lock")).unwrap();
    std::io::Write::write_all(&mut lock, b"pid 4321 on elsewhere since yesterday\n").unwrap();
    lock.lock().unwrap();
    let assert = program(dir)
        .args(["run", "data", "--out", "out"])
        .assert()
        .code(75);
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(said.contains("pid 4321 on elsewhere"), "{said}");
    assert_eq!(fs::read_dir(dir.join("out")).unwrap().count(), 1);
    drop(lock);
    program(dir)
        .args(["run", "data", "--out", "out"])
        .assert()
        .success();
}
