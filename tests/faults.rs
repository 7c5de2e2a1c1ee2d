//! Faults of single calls to the system, and losses of power: nothing that was finished is lost, and the next run of the
//! same command ends with the same bytes.

use crate::runs::{assert_same, journal_lines, program, reproducible, write_data};
use rand::{RngExt, SeedableRng};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

crate::tests! {
    #[cfg(target_os = "linux")]
    failing_calls_lose_nothing needs Strace;
    #[cfg(target_os = "linux")]
    logs_are_durable_before_the_lines_that_name_them needs Strace;
    losses_of_power_lose_nothing_that_was_synced;
}

const WORDS: [&str; 9] = [
    "run",
    "data",
    "--sm",
    "esm,iclk",
    "--am",
    "ssd",
    "--progress",
    "none",
    "--out",
];

fn lines(dir: &Path) -> usize {
    journal_lines(&fs::read(dir.join("journal.jsonl")).unwrap_or_default()).len()
}

/// The program under strace with `more` options, writing to `out`; its exit code, what it said and what was traced.
#[cfg(target_os = "linux")]
fn traced(dir: &Path, out: &str, more: &[&str]) -> (Option<i32>, String, String) {
    let trace = dir.join("trace");
    let output = Command::new("strace")
        .args(["-f", "-qq", "--seccomp-bpf", "-y", "-o"])
        .arg(&trace)
        .args(more)
        .arg(assert_cmd::cargo::cargo_bin!("mtf-eval"))
        .args(WORDS)
        .arg(out)
        .current_dir(dir)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let trace = fs::read(trace).unwrap_or_default();
    (
        output.status.code(),
        said,
        String::from_utf8_lossy(&trace).into_owned(),
    )
}

/// Every kind of call that writes, failing at the `when`-th time of a thread: a sample, or with MTF_EVAL_SLOW=1 each of
/// the first 60.
#[cfg(target_os = "linux")]
fn failing_calls_lose_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[6, 7]);
    program(dir).args(WORDS).arg("whole").assert().success();
    let all = std::env::var_os("MTF_EVAL_SLOW").is_some_and(|v| v == "1");
    let times: Vec<usize> = if all { (1..=60).collect() } else { vec![1, 3, 8] };
    let mut stopped = 0;
    for (call, error) in [
        ("write", "ENOSPC"),
        ("write", "EIO"),
        ("fsync", "EIO"),
        ("fdatasync", "EIO"),
        ("rename", "EACCES"),
        ("mkdir", "ENOSPC"),
        ("openat", "EMFILE"),
        ("ftruncate", "EIO"),
        ("unlink", "EIO"),
        ("flock", "ENOLCK"),
        ("clone3", "EAGAIN"),
    ] {
        for when in &times {
            let what = format!("{call}:error={error}:when={when}");
            let options = [&format!("--trace={call}"), &format!("--inject={what}")];
            let (code, said, _) = traced(dir, "out", &options.map(String::as_str));
            // 20: a frame could not be read, and its units are tried again. 127 is the system's loader, which could not start the program.
            assert!(
                matches!(code, Some(0 | 2 | 20 | 75 | 127)),
                "{what}: {code:?} {said}"
            );
            assert!(!said.contains("internal error"), "{what}: {said}");
            if call == "flock" {
                assert_eq!(code, Some(0), "{what}: {said}");
            }
            stopped += usize::from(code != Some(0));
            let before = lines(&dir.join("out"));
            program(dir).args(WORDS).arg("out").assert().success();
            assert!(lines(&dir.join("out")) >= before, "{what}");
            let [mut whole, mut out] = ["whole", "out"].map(|name| reproducible(&dir.join(name)));
            if call == "openat" {
                // A frame could not be opened, perhaps: the journal keeps the line of a unit that failed, and has
                // another of the same unit after it.
                for files in [&mut whole, &mut out] {
                    files.remove(Path::new("journal.jsonl"));
                }
            }
            assert!(whole == out, "{what}");
            fs::remove_dir_all(dir.join("out")).unwrap();
        }
    }
    // Else nothing was injected.
    assert!(stopped > times.len(), "{stopped}");
}

#[cfg(target_os = "linux")]
fn logs_are_durable_before_the_lines_that_name_them() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[6, 7]);
    let (code, said, trace) = traced(dir, "out", &["--trace=fsync,fdatasync,rename"]);
    assert_eq!(code, Some(0), "{said}");
    // A call that another thread's comes between has a second line, without its file.
    let calls: Vec<&str> = trace.lines().filter(|line| !line.contains("resumed>")).collect();
    let synced = |line: &&str| line.contains("fdatasync(") || line.contains("fsync(");
    let last_journal = calls
        .iter()
        .rposition(|line| synced(line) && line.contains("journal.jsonl"))
        .expect("the journal is synced");
    let logs: Vec<usize> = (0..calls.len())
        .filter(|&k| synced(&calls[k]) && calls[k].contains("/frames/") && calls[k].contains(".csv"))
        .collect();
    assert_eq!(logs.len(), 4, "{trace}");
    assert!(logs.iter().all(|&k| k < last_journal), "{trace}");
    // Files of the top have their content before they have their name.
    for name in [
        "summary.json",
        "summary.csv",
        "sequences.csv",
        "truth.csv",
        "run.json",
    ] {
        let renamed = calls
            .iter()
            .position(|line| line.contains("rename(") && line.contains(&format!("/{name}\"")))
            .unwrap_or_else(|| panic!("{name}: {trace}"));
        let content = |line: &&str| synced(line) && line.contains(&format!("/{name}."));
        assert!(calls[..renamed].iter().any(content), "{name}: {trace}");
    }
}

/// A loss of power keeps a prefix of the journal that was synced, the logs of its lines, and of all other files anything:
/// nothing, the name alone, half of it, zeros.
fn losses_of_power_lose_nothing_that_was_synced() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[6, 7]);
    program(dir).args(WORDS).arg("whole").assert().success();
    let whole = dir.join("whole");
    let mut files = Vec::new();
    let mut folders = vec![whole.clone()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => files.push(path.strip_prefix(&whole).unwrap().to_path_buf()),
            }
        }
    }
    files.sort();
    let journal = fs::read(whole.join("journal.jsonl")).unwrap();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
    let rounds = if std::env::var_os("MTF_EVAL_SLOW").is_some_and(|v| v == "1") {
        440
    } else {
        12
    };
    for round in 0..rounds {
        let out = dir.join("out");
        let cut = rng.random_range(0..=journal.len());
        let kept = journal_lines(&journal[..cut]);
        let durable = |file: &PathBuf| {
            let text = file.to_string_lossy().into_owned();
            kept.iter().any(|line| {
                let tracker = line["tracker"].as_str().unwrap().replace('/', "-");
                text.contains(&tracker)
                    && text.contains(&format!("{}.csv", line["sequence"].as_str().unwrap()))
            })
        };
        for file in &files {
            let bytes = fs::read(whole.join(file)).unwrap();
            let to = out.join(file);
            fs::create_dir_all(to.parent().unwrap()).unwrap();
            let left = match file.to_str().unwrap() {
                "journal.jsonl" => Some(journal[..cut].to_vec()),
                // Written and synced before the first unit begins.
                "run.json" | "truth.csv" => Some(bytes),
                _ if durable(file) => Some(bytes),
                _ => match rng.random_range(0..4) {
                    0 => None,
                    1 => Some(Vec::new()),
                    2 => Some(bytes[..bytes.len() / 2].to_vec()),
                    _ => Some(vec![0; bytes.len()]),
                },
            };
            if let Some(left) = left {
                fs::write(to, left).unwrap();
            }
        }
        fs::write(out.join("summary.json.77-3.tmp"), "half").unwrap();
        program(dir).args(WORDS).arg("out").assert().success();
        assert_same(&whole, &out);
        // What was synced has not been tracked again.
        let after = fs::read(out.join("journal.jsonl")).unwrap();
        let whole_lines = journal[..cut]
            .iter()
            .rposition(|&b| b == b'\n')
            .map_or(0, |at| at + 1);
        assert!(after.starts_with(&journal[..whole_lines]), "round {round}");
        assert_eq!(journal_lines(&after).len(), 4, "round {round}");
        fs::remove_dir_all(out).unwrap();
    }
}
