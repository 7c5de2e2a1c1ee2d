//! What enters the program: files that are none, links in circles, names that are no text, numbers beyond reason. Each
//! is one line at once, never a wait, a crash or a silent loss.

use crate::runs::{program, write_data};
use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Duration;
use tempfile::TempDir;

crate::tests! {
    pipes_and_devices_in_data_are_refused;
    pipes_and_devices_as_settings_are_refused;
    huge_files_are_refused_before_they_are_read;
    links_in_circles_end;
    a_folder_that_is_reached_twice_counts_once;
    links_that_lead_nowhere_are_named;
    arguments_that_are_no_text_never_crash;
    paths_that_are_no_text_work;
    names_of_one_text_are_refused;
    coordinates_beyond_reason_are_refused;
    a_run_over_no_frame_is_no_success;
}

/// No command here takes as long unless it waits for what never comes.
const NEVER: Duration = Duration::from_secs(120);

/// Folder `data` with `seq0` and `seq1`.
fn data() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_data(&dir.path().join("data"), &[3, 3]);
    dir
}

fn output(dir: &Path, words: &[&OsStr]) -> Output {
    program(dir)
        .args(words)
        .args(["--progress", "none"])
        .timeout(NEVER)
        .output()
        .unwrap()
}

fn go(dir: &Path, words: &str) -> Output {
    let words: Vec<&OsStr> = words.split(' ').map(OsStr::new).collect();
    output(dir, &words)
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Exit code `code`, and one line on stderr that begins with `error:` and has each of `parts`.
#[track_caller]
fn refused(output: &Output, code: i32, parts: &[&str]) {
    let text = stderr(output);
    assert_eq!(output.status.code(), Some(code), "{text}");
    let errors: Vec<&str> = text.lines().filter(|l| l.starts_with("error:")).collect();
    assert_eq!(errors.len(), 1, "{text}");
    assert_eq!(text.lines().last(), Some(errors[0]), "{text}");
    for part in parts {
        assert!(errors[0].contains(part), "no '{part}' in {text}");
    }
}

fn pipe(path: &Path) {
    let _ = fs::remove_file(path);
    let made = std::process::Command::new("mkfifo").arg(path).status();
    assert!(made.unwrap().success());
}

/// `data check` finds one fault, in `file`, and `run` refuses with the same.
#[track_caller]
fn data_refused(dir: &Path, file: &str, what: &str) {
    let checked = go(dir, "data check data");
    let found = stdout(&checked);
    assert_eq!(
        (checked.status.code(), found.lines().count()),
        (Some(2), 1),
        "{found}"
    );
    assert!(
        found.starts_with(&format!("{file}:")) && found.contains(what),
        "{found}"
    );
    refused(&go(dir, "run data"), 2, &[file, what]);
}

fn pipes_and_devices_in_data_are_refused() {
    let dir = data();
    let root = dir.path();
    for file in ["data/seq0/frame00003.png", "data/seq0.txt"] {
        let kept = fs::read(root.join(file)).unwrap();
        pipe(&root.join(file));
        data_refused(root, file, "not a regular file but a named pipe");
        fs::remove_file(root.join(file)).unwrap();
        symlink("/dev/zero", root.join(file)).unwrap();
        data_refused(root, file, "not a regular file but a device");
        fs::remove_file(root.join(file)).unwrap();
        fs::write(root.join(file), kept).unwrap();
    }
    // What is not needed to track is a warning.
    for file in ["data/seq0/tags.txt", "data/seq1/meta.json"] {
        pipe(&root.join(file));
        let checked = go(root, "data check data");
        let expected = format!("{file}: warning: not a regular file but a named pipe");
        assert!(
            checked.status.success() && stdout(&checked).contains(&expected),
            "{}",
            stdout(&checked)
        );
        fs::remove_file(root.join(file)).unwrap();
    }
    pipe(&root.join("data/seq1/groundtruth_grid.csv"));
    data_refused(root, "data/seq1/groundtruth_grid.csv", "a named pipe");
}

fn pipes_and_devices_as_settings_are_refused() {
    let dir = data();
    let root = dir.path();
    pipe(&root.join("pipe"));
    symlink("/dev/zero", root.join("zero")).unwrap();
    fs::create_dir(root.join("folder")).unwrap();
    assert!(go(root, "run data -o run").status.success());
    assert!(
        go(root, "check run --baseline base.json --update-baseline")
            .status
            .success()
    );
    for (file, what) in [
        ("pipe", "a named pipe"),
        ("zero", "a device"),
        ("folder", "a folder"),
    ] {
        for command in [
            "run data --grid FILE",
            "check run --baseline FILE",
            "check run --baseline base.json --tolerances FILE",
            "bench data --against FILE",
            "synth out --image FILE",
        ] {
            refused(
                &go(root, &command.replace("FILE", file)),
                2,
                &[file, "not a regular file but", what],
            );
        }
    }
    for file in ["pipe", "zero"] {
        refused(
            &go(root, &format!("basin {file}")),
            2,
            &[file, "not a regular file"],
        );
    }
}

fn huge_files_are_refused_before_they_are_read() {
    let dir = data();
    let root = dir.path();
    let huge = |file: &str| {
        let file = fs::File::create(root.join(file)).unwrap();
        // All of it a hole.
        file.set_len(1 << 40).unwrap();
    };
    huge("grid.toml");
    refused(
        &go(root, "run data --grid grid.toml"),
        2,
        &["grid.toml", "limit of 16777216 for settings"],
    );
    huge("data/seq0/frame00001.png");
    data_refused(
        root,
        "data/seq0/frame00001.png",
        "limit of 536870912 for an image",
    );
    write_data(&root.join("data"), &[3, 3]);
    huge("data/seq1.txt");
    data_refused(root, "data/seq1.txt", "limit of 536870912 for ground truth");
}

fn sequences(root: &Path) -> Vec<String> {
    let listed = go(root, "list data --data data --format csv");
    let text = stdout(&listed);
    let rows = text
        .lines()
        .skip(1)
        .map(|row| row.split(',').next().unwrap().to_owned());
    rows.collect()
}

fn links_in_circles_end() {
    let dir = data();
    let root = dir.path();
    for k in 0..2000 {
        symlink(".", root.join(format!("data/again{k}"))).unwrap();
    }
    symlink("../..", root.join("data/seq0/up")).unwrap();
    assert_eq!(sequences(root), ["data/seq0", "data/seq1"]);
    assert!(go(root, "data check data").status.success());
}

fn a_folder_that_is_reached_twice_counts_once() {
    let dir = data();
    let root = dir.path();
    // A link comes first in the order of names, the folder itself is what counts.
    symlink("seq1", root.join("data/another")).unwrap();
    write_data(&root.join("else"), &[3, 3, 3]);
    for name in ["p", "q"] {
        symlink("../else/seq2", root.join("data").join(name)).unwrap();
        fs::copy(root.join("else/seq2.txt"), root.join(format!("data/{name}.txt"))).unwrap();
    }
    assert_eq!(sequences(root), ["data/p", "data/seq0", "data/seq1"]);
}

fn links_that_lead_nowhere_are_named() {
    let dir = data();
    let root = dir.path();
    symlink("gone", root.join("data/seq7")).unwrap();
    data_refused(root, "data/seq7", "the link leads nowhere; ");
    // What is not asked for does not matter.
    assert!(go(root, "run data --seq seq0 -o one").status.success());
    let skipping = go(root, "run data --on-bad-data skip -o two");
    assert!(skipping.status.success());
    let warning = "warning: data/seq7: the link leads nowhere";
    assert!(stderr(&skipping).contains(warning));
    assert!(stderr(&go(root, "list data --data data")).contains(warning));
    fs::remove_file(root.join("data/seq7")).unwrap();

    let frame = root.join("data/seq1/frame00002.png");
    fs::rename(&frame, root.join("moved.png")).unwrap();
    symlink("moved.png", &frame).unwrap();
    data_refused(root, "data/seq1/frame00002.png", "the link leads nowhere; ");
    fs::remove_file(&frame).unwrap();
    symlink("../../moved.png", &frame).unwrap();
    assert!(go(root, "data check data").status.success());
    symlink("gone", root.join("data/seq1/tags.txt")).unwrap();
    data_refused(root, "data/seq1/tags.txt", "the link leads nowhere; ");
}

fn raw(bytes: &[u8]) -> OsString {
    OsString::from_vec(bytes.to_vec())
}

fn arguments_that_are_no_text_never_crash() {
    let dir = tempfile::tempdir().unwrap();
    for words in [
        "X",
        "-X",
        "--X",
        "help X",
        "run X",
        "run --X",
        "run --sm X",
        "run --am=X",
        "run --ssm X",
        "run --set X",
        "run --seq X",
        "run --tag X",
        "run --tracker X",
        "run --pre X",
        "run --include X",
        "run --protocol X",
        "run --shard X",
        "run --res X",
        "run --seed X",
        "run --max-time X",
        "run --memory X",
        "run --color X",
        "run --format X",
        "run --grid X",
        "run --gt-ssm X",
        "run -j X",
        "plan X",
        "status X",
        "merge X",
        "merge X X",
        "check X",
        "check X --baseline X",
        "check --baseline X",
        "compare X X",
        "compare --figures X X X",
        "synth --image X out",
        "synth --texture X out",
        "diagnose X",
        "diagnose --am X",
        "basin X",
        "bench X",
        "bench --against X",
        "list X",
        "list data --data X",
        "data X",
        "data check X",
        "data info X",
        "completions X",
        "man X",
    ] {
        let words: Vec<OsString> = words
            .split(' ')
            .map(|word| {
                raw(&word
                    .bytes()
                    .flat_map(|b| if b == b'X' { vec![b'x', 0xff] } else { vec![b] })
                    .collect::<Vec<u8>>())
            })
            .collect();
        let output = program(dir.path()).args(&words).timeout(NEVER).output().unwrap();
        let text = stderr(&output);
        let code = output.status.code();
        // `status` of what is no run, like `data check`, says so on stdout.
        // Two shards that hold nothing are nothing to merge.
        let expected = if words[0] == "merge" { [2, 4] } else { [2, 2] };
        assert!(
            code.is_some_and(|code| expected.contains(&code)),
            "{words:?}: {text}{}",
            stdout(&output)
        );
        let said = text.lines().filter(|l| l.starts_with("error:")).count();
        let checks = words.first().is_some_and(|w| w == "data") && words[1] == "check";
        assert!(said == 1 || checks, "{words:?}: {text}");
    }
}

fn paths_that_are_no_text_work() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    let name = raw(b"d\xff");
    write_data(&root.join(&name), &[3]);
    // Also the sequence itself, and a frame.
    let (old, new) = (
        root.join(&name).join("seq0"),
        root.join(&name).join(raw(b"s\xfe")),
    );
    fs::rename(&old, &new).unwrap();
    fs::rename(
        old.with_extension("txt"),
        root.join(&name).join(raw(b"s\xfe.txt")),
    )
    .unwrap();
    let run = raw(b"r\xff");
    for words in [
        vec![OsStr::new("data"), "check".as_ref(), &name],
        vec!["data".as_ref(), "info".as_ref(), &name],
        vec!["run".as_ref(), &name, "--out".as_ref(), &run],
        vec!["status".as_ref(), &run],
    ] {
        let output = output(root, &words);
        assert!(
            output.status.success(),
            "{words:?}: {}{}",
            stdout(&output),
            stderr(&output)
        );
    }
    assert!(root.join(run).join("summary.csv").is_file());
}

fn names_of_one_text_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    let names = [raw(b"d\xff"), raw(b"d\xfe")];
    for name in &names {
        // The same to the byte: nothing but the names tells them apart.
        write_data(&root.join("data").join(name), &[3]);
    }
    let both = [r"d\xFF", r"d\xFE", "rename one of them"];
    refused(&go(root, "run data"), 2, &both);
    let checked = go(root, "data check data");
    assert_eq!(checked.status.code(), Some(2));
    assert!(
        both.iter().all(|part| stdout(&checked).contains(part)),
        "{}",
        stdout(&checked)
    );
    // As two data sets.
    let [first, second]: [PathBuf; 2] = names.each_ref().map(|name| Path::new("data").join(name));
    refused(
        &output(root, &["run".as_ref(), first.as_ref(), second.as_ref()]),
        2,
        &both,
    );
    // One twice is one.
    let twice = output(root, &["run".as_ref(), first.as_ref(), first.as_ref()]);
    assert!(twice.status.success(), "{}", stderr(&twice));
    // Two frames.
    write_data(&root.join("frames"), &[3]);
    for name in [raw(b"frame\xff.png"), raw(b"frame\xfe.png")] {
        fs::copy(
            root.join("frames/seq0/frame00003.png"),
            root.join("frames/seq0").join(name),
        )
        .unwrap();
    }
    refused(
        &go(root, "run frames"),
        2,
        &[r#"frame\xFF.png""#, r#"frame\xFE.png""#],
    );
}

fn coordinates_beyond_reason_are_refused() {
    let dir = data();
    let root = dir.path();
    let truth = root.join("data/seq0.txt");
    let good = fs::read_to_string(&truth).unwrap();
    for far in ["1e308", "-1e12", "1000001", "inf"] {
        let lines: Vec<String> = good
            .lines()
            .enumerate()
            .map(|(k, line)| match k {
                3 => format!("frame00003.png 20 15 {far} 15 {far} 45 20 45"),
                _ => line.to_owned(),
            })
            .collect();
        fs::write(&truth, lines.join("\n")).unwrap();
        data_refused(root, "data/seq0.txt:4", "a coordinate is ");
    }
    fs::write(
        &truth,
        good.replace("frame00003.png 20.6", "frame00003.png -900000.6"),
    )
    .unwrap();
    let output = go(root, "data check data");
    assert!(output.status.success(), "{}", stdout(&output));
}

fn a_run_over_no_frame_is_no_success() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    write_data(&root.join("data"), &[3]);
    assert!(go(root, "run data -o good").status.success());
    assert!(
        go(root, "check good --baseline base.json --update-baseline")
            .status
            .success()
    );
    let truth = root.join("data/seq0.txt");
    let text = fs::read_to_string(&truth).unwrap();
    let rows = text.lines().take(2).map(str::to_owned);
    let rows: Vec<String> = rows
        .chain([2, 3].map(|k| format!("frame{k:05}.png unannotated")))
        .collect();
    fs::write(&truth, rows.join("\n")).unwrap();
    refused(
        &go(root, "run data -o none"),
        4,
        &["no frame was evaluated", "; "],
    );
    let checked = go(root, "check none --baseline base.json");
    assert_eq!(checked.status.code(), Some(11), "{}", stdout(&checked));
    assert!(
        stdout(&checked).contains("the run is over no frame"),
        "{}",
        stdout(&checked)
    );
    go(root, "check none --baseline none.json --update-baseline");
    assert_eq!(
        go(root, "check none --baseline none.json").status.code(),
        Some(11)
    );
}
