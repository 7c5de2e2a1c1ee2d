//! What a user's files and verdicts survive: inputs of a merge, readers that go away, results of another run or build,
//! limits of the system.

use crate::runs::{assert_same, program, reproducible, write_data};
use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};

crate::tests! {
    a_merge_never_deletes_what_it_joins;
    a_merge_notices_altered_truth;
    results_of_a_run_that_was_begun_anew_are_not_judged;
    results_that_are_not_of_the_journal_are_not_judged;
    frames_changed_in_place_are_tracked_again;
    builds_are_not_mixed_unawares;
    other_peoples_folders_are_left_alone;
    #[cfg(unix)]
    messages_that_nobody_reads_stop_nothing;
    #[cfg(unix)]
    few_open_files_are_enough;
    #[cfg(unix)]
    a_limit_of_file_sizes_is_a_full_disk;
    #[cfg(target_os = "linux")]
    little_memory_is_one_clear_line;
    #[cfg(target_os = "linux")]
    a_verdict_that_cannot_be_written_is_no_verdict needs DevFull;
    too_many_threads_are_refused;
}

/// A run of few units, in `out`.
fn run(dir: &Path, out: &str, more: &[&str]) -> assert_cmd::assert::Assert {
    program(dir)
        .args([
            "run",
            "data",
            "--sm",
            "esm,iclk",
            "--am",
            "ssd",
            "--progress",
            "none",
        ])
        .args(["--out", out])
        .args(more)
        .assert()
}

fn said(assert: &assert_cmd::assert::Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}

fn a_merge_never_deletes_what_it_joins() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8, 9]);
    run(dir, "whole", &[]).success();
    for k in ["1", "2"] {
        run(dir, &format!("s{k}"), &["--shard", &format!("slice:{k}/2")]).success();
    }
    let shard = reproducible(&dir.join("s1"));
    let merge = |args: &[&str]| program(dir).arg("merge").args(args).assert();
    let mut names = vec!["s1", "./s1", "s1/../s1"];
    if cfg!(unix) {
        #[cfg(unix)]
        std::os::unix::fs::symlink("s1", dir.join("linked")).unwrap();
        names.push("linked");
    }
    for name in &names {
        for out in &names {
            let refused = merge(&["--force", out, name, "s2"]).code(11);
            assert!(said(&refused).contains("--force"), "{}", said(&refused));
            assert!(shard == reproducible(&dir.join("s1")), "{out} {name}");
        }
    }
    // A directory that holds another merge is replaced, once the new one is whole.
    merge(&["all", "s1", "./s1", "s2"]).success();
    assert_same(&dir.join("whole"), &dir.join("all"));
    let incomplete = merge(&["--force", "all", "s1"]).code(21);
    assert!(said(&incomplete).contains("missing"));
    assert_same(&dir.join("whole"), &dir.join("all"));
    merge(&["--force", "all", "s2", "s1"]).success();
    assert_same(&dir.join("whole"), &dir.join("all"));
    assert!(shard == reproducible(&dir.join("s1")));
    // Nothing is left beside it, and a shard within it is kept.
    let hidden = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with(".merge");
    let names = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(names.filter(|name| hidden(name)).count(), 0);
    fs::create_dir_all(dir.join("all/frames")).unwrap();
    fs::rename(dir.join("s2"), dir.join("all/frames/s2")).unwrap();
    let within = merge(&["--force", "all", "s1", "all/frames/s2"]).code(11);
    assert!(said(&within).contains("holds the shard"), "{}", said(&within));
    fs::rename(dir.join("all/frames/s2"), dir.join("s2")).unwrap();
    // Into a shard itself: what it holds stays, and the others come to it.
    merge(&["s1", "./s1", "s2"]).success();
    assert_same(&dir.join("whole"), &dir.join("s1"));
}

fn a_merge_notices_altered_truth() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8, 9]);
    for k in ["1", "2"] {
        run(dir, &format!("s{k}"), &["--shard", &format!("slice:{k}/2")]).success();
    }
    let path = dir.join("s1/truth.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replacen("20", "21", 1)).unwrap();
    let refused = program(dir).args(["merge", "all", "s1", "s2"]).assert().code(2);
    assert!(said(&refused).contains("truth.csv"), "{}", said(&refused));
}

fn results_of_a_run_that_was_begun_anew_are_not_judged() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[30, 30]);
    run(dir, "out", &[]).success();
    run(dir, "other", &[]).success();
    let judge = |code: i32| {
        let check = ["check", "out", "--baseline", "baseline.json"];
        let check = program(dir).args(check).assert().code(code);
        program(dir).args(["compare", "out", "other"]).assert().code(code);
        said(&check)
    };
    let record = ["check", "out", "--baseline", "baseline.json", "--update-baseline"];
    program(dir).args(record).assert().success();
    judge(0);
    // Asked to stop before anything is done.
    let anew = ["--seed", "1", "--force", "--max-time", "0", "--grace", "0"];
    run(dir, "out", &anew).code(75);
    assert!(!dir.join("out/summary.json").exists());
    let text = judge(21);
    assert!(
        text.contains("incomplete") && text.contains("have no result"),
        "{text}"
    );
    run(dir, "out", &["--seed", "1"]).success();
    judge(0);
}

fn results_that_are_not_of_the_journal_are_not_judged() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[10]);
    run(dir, "a", &[]).success();
    run(dir, "b", &["--pre", "none"]).success();
    fs::copy(dir.join("b/summary.json"), dir.join("a/summary.json")).unwrap();
    let compared = program(dir).args(["compare", "a", "b"]).assert().code(21);
    assert!(said(&compared).contains("summary.json"), "{}", said(&compared));
    // Its own command mends it.
    run(dir, "a", &[]).success();
    program(dir).args(["compare", "a", "b"]).assert().success();
}

/// Other pixels in a file of the same size, and the same in another file.
fn frames_changed_in_place_are_tracked_again() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[6, 7]);
    for (sequence, frames) in [("seq0", 6), ("seq1", 7)] {
        for frame in 1..=frames {
            let png = dir.join(format!("data/{sequence}/frame{frame:05}.png"));
            image::open(&png)
                .unwrap()
                .save(png.with_extension("pgm"))
                .unwrap();
            fs::remove_file(png).unwrap();
        }
        let truth = dir.join(format!("data/{sequence}.txt"));
        fs::write(
            &truth,
            fs::read_to_string(&truth).unwrap().replace(".png", ".pgm"),
        )
        .unwrap();
    }
    let lines = |out: &str| {
        fs::read_to_string(dir.join(out).join("journal.jsonl"))
            .unwrap()
            .lines()
            .count()
    };
    run(dir, "out", &[]).success();
    run(dir, "s1", &["--shard", "slice:1/2"]).success();
    assert_eq!(lines("out"), 4);
    let frame = dir.join("data/seq1/frame00004.pgm");
    let mut bytes = fs::read(&frame).unwrap();
    bytes[3000..4000].fill(9);
    fs::write(&frame, bytes).unwrap();
    run(dir, "out", &[]).success();
    assert_eq!(lines("out"), 6);
    run(dir, "s2", &["--shard", "slice:2/2"]).success();
    let refused = program(dir).args(["merge", "all", "s1", "s2"]).assert().code(11);
    assert!(said(&refused).contains("seq1"), "{}", said(&refused));
}

fn builds_are_not_mixed_unawares() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8, 9]);
    // The same program with another byte behind its end is another file.
    let other = dir.join("other-build");
    let mut bytes = fs::read(assert_cmd::cargo::cargo_bin!("mtf-eval")).unwrap();
    bytes.push(b'\n');
    fs::write(&other, bytes).unwrap();
    #[cfg(unix)]
    fs::set_permissions(&other, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let by_other = |args: &[&str]| {
        let output = Command::new(&other).current_dir(dir).args(args).output().unwrap();
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stderr).into_owned(),
        )
    };
    let words = [
        "run",
        "data",
        "--sm",
        "esm,iclk",
        "--am",
        "ssd",
        "--progress",
        "none",
    ];
    let with = |more: &[&'static str]| [&words[..], more].concat();

    run(dir, "out", &[]).success();
    let (code, text) = by_other(&with(&["--out", "out"]));
    assert_eq!(code, Some(11), "{text}");
    assert!(
        text.contains("another build") && text.contains("--mix-builds"),
        "{text}"
    );
    assert_eq!(by_other(&with(&["--out", "out", "--mix-builds"])).0, Some(0));
    assert_eq!(by_other(&with(&["--out", "out", "--force"])).0, Some(0));

    run(dir, "s1", &["--shard", "slice:1/2"]).success();
    assert_eq!(
        by_other(&with(&["--out", "s2", "--shard", "slice:2/2"])).0,
        Some(0)
    );
    let refused = program(dir).args(["merge", "all", "s1", "s2"]).assert().code(11);
    assert!(said(&refused).contains("another build"), "{}", said(&refused));
    program(dir)
        .args(["merge", "--mix-builds", "all", "s1", "s2"])
        .assert()
        .success();
}

fn other_peoples_folders_are_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[5]);
    for (name, text) in [
        (".lock", "held by apt"),
        ("run.json", "{}"),
        ("journal.jsonl", "Monday\n"),
    ] {
        let folder = dir.join("mine");
        fs::create_dir_all(folder.join("frames")).unwrap();
        fs::write(folder.join("frames/0001.png"), "x").unwrap();
        fs::write(folder.join(name), text).unwrap();
        let refused = run(dir, "mine", &["--force"]).code(2);
        assert!(
            said(&refused).contains("run directory"),
            "{name}: {}",
            said(&refused)
        );
        assert!(folder.join("frames/0001.png").exists());
        assert_eq!(fs::read_to_string(folder.join(name)).unwrap(), text);
        let count = fs::read_dir(&folder).unwrap().count();
        assert_eq!(count, 2, "{name}: something was left behind");
        fs::remove_dir_all(folder).unwrap();
    }
}

/// The program through a shell that first does `before`.
#[cfg(unix)]
fn shell(dir: &Path, before: &str, args: &str) -> std::process::Output {
    let program = assert_cmd::cargo::cargo_bin!("mtf-eval");
    Command::new("sh")
        .args(["-c", &format!("{before}; exec '{}' {args}", program.display())])
        .current_dir(dir)
        .output()
        .unwrap()
}

#[cfg(unix)]
fn messages_that_nobody_reads_stop_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[20, 20]);
    let mut child = Command::new(assert_cmd::cargo::cargo_bin!("mtf-eval"))
        .args(["run", "data", "--sm", "lk", "-v", "--out", "piped"])
        .current_dir(dir)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // As `2>&1 | head -1` does.
    let mut reader = child.stderr.take().unwrap();
    reader.read_exact(&mut [0]).unwrap();
    drop(reader);
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(dir.join("piped/summary.json").exists());
    if Path::new("/dev/full").exists() {
        let output = shell(dir, "exec 2>/dev/full", "run data --sm lk -v --out full");
        assert_eq!(output.status.code(), Some(0));
    }
    // An error has its code, whoever reads.
    let output = shell(dir, "exec 2>&-", "run nowhere");
    assert_eq!(output.status.code(), Some(2));
}

#[cfg(unix)]
fn few_open_files_are_enough() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8, 8, 8]);
    let output = shell(
        dir,
        "ulimit -n 16",
        "run data --sm lk --am ssd,zncc --out out -j 2",
    );
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{text}");
}

#[cfg(unix)]
fn a_limit_of_file_sizes_is_a_full_disk() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[30, 30]);
    let words = "run data --sm esm,iclk --am ssd --progress none --out out";
    // Blocks of 512 or 1024 bytes, as the shell has it.
    let output = shell(dir, "ulimit -f 4", words);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(75), "{text}");
    run(dir, "out", &[]).success();
    run(dir, "whole", &[]).success();
    assert_same(&dir.join("whole"), &dir.join("out"));
}

#[cfg(target_os = "linux")]
fn little_memory_is_one_clear_line() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8]);
    let mut enough = false;
    for megabytes in [40, 80, 160, 320, 640, 4096] {
        let limit = format!("ulimit -v {}", megabytes * 1024);
        let output = shell(
            dir,
            &limit,
            &format!("run data --out m{megabytes} --progress none -j 4"),
        );
        let text = String::from_utf8_lossy(&output.stderr);
        let code = output.status.code();
        // 127, or in the least of memory an abort of the C library: the system could not even start the program.
        let started = megabytes > 40 || !text.contains("Fatal glibc error");
        assert!(
            matches!(code, Some(0 | 75 | 127)) || !started,
            "{megabytes} MB: {code:?} {text}"
        );
        if code == Some(75) {
            assert!(text.contains("memory") || text.contains("thread"), "{text}");
        }
        enough |= code == Some(0);
    }
    assert!(enough);
}

#[cfg(target_os = "linux")]
fn a_verdict_that_cannot_be_written_is_no_verdict() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8]);
    run(dir, "out", &[]).success();
    let baseline = ["check", "out", "--baseline", "baseline.json", "--update-baseline"];
    program(dir).args(baseline).assert().success();
    for words in [
        "check out --baseline baseline.json",
        "compare out out",
        "status out",
        "list sm",
    ] {
        let output = shell(dir, "exec >/dev/full", words);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(75), "{words}: {text}");
    }
}

fn too_many_threads_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[5]);
    let refused = run(dir, "out", &["-j", "100000"]).code(2);
    assert!(said(&refused).contains("1024"), "{}", said(&refused));
}
