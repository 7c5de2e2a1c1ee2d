//! The program from outside: what it prints, where, and how it ends.

use crate::runs::{program, write_data};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::{contains, is_empty};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

crate::tests! {
    help_and_version_go_to_stdout;
    lists_come_from_the_registry;
    illumination_and_colour_have_names;
    a_run_tracks_and_leaves_what_it_promises;
    results_on_stdout_are_for_programs_too;
    settings_reach_the_trackers;
    filters_are_part_of_what_a_run_is;
    mistakes_are_told_with_the_way_out;
    a_broken_frame_fails_its_sequence_and_no_other;
    faulty_data_is_refused_or_left_out;
    default_directories_are_new_and_named;
    a_baseline_checks_what_it_records;
    #[cfg(unix)]
    a_closed_pipe_is_no_failure;
    truth_is_fitted_with_a_warp_of_fewer_degrees_of_freedom;
}

fn with_data(lengths: &[usize]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_data(&dir.path().join("data"), lengths);
    dir
}

fn help_and_version_go_to_stdout() {
    let dir = tempfile::tempdir().unwrap();
    for args in [
        &["--help"][..],
        &["run", "--help"],
        &["list", "-h"],
        &["help", "run"],
    ] {
        program(dir.path())
            .args(args)
            .assert()
            .success()
            .stdout(contains("Usage:"))
            .stderr(is_empty());
    }
    program(dir.path())
        .arg("--version")
        .assert()
        .success()
        .stdout(contains(env!("CARGO_PKG_VERSION")));
    program(dir.path())
        .assert()
        .code(2)
        .stdout(is_empty())
        .stderr(contains("Usage:"));
    for shell in ["bash", "zsh", "fish"] {
        program(dir.path())
            .args(["completions", shell])
            .assert()
            .success()
            .stdout(contains("mtf-eval"));
    }
    program(dir.path())
        .arg("man")
        .assert()
        .success()
        .stdout(contains(".TH").and(contains("max\\-iters")));
}

fn lists_come_from_the_registry() {
    let dir = with_data(&[5]);
    program(dir.path())
        .arg("list")
        .assert()
        .success()
        .stdout(contains("esm").and(contains("homography")));
    for what in [
        "sm", "am", "ssm", "ilm", "trackers", "params", "filters", "metrics",
    ] {
        let output = program(dir.path())
            .args(["list", what, "--format", "json"])
            .output()
            .unwrap();
        let rows: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(!rows.as_array().unwrap().is_empty(), "{what}");
        for format in ["table", "csv", "md"] {
            program(dir.path())
                .args(["list", what, "--format", format])
                .assert()
                .success();
        }
    }
    program(dir.path())
        .args(["list", "trackers"])
        .assert()
        .stdout(contains("esm/ssd/homography"));
    program(dir.path())
        .args(["list", "params"])
        .assert()
        .stdout(contains("sm.esm.max_iters"));
    program(dir.path())
        .args(["list", "data", "--data", "data"])
        .assert()
        .success()
        .stdout(contains("data/seq0"));
}

fn illumination_and_colour_have_names() {
    let dir = with_data(&[5]);
    program(dir.path())
        .args([
            "run",
            "data",
            "--am",
            "ssd,mcncc",
            "--ilm",
            "all",
            "--out",
            "out",
            "-j",
            "1",
        ])
        .assert()
        .success()
        .stdout(contains("esm/ssd+pgb/homography").and(contains("esm/ncc+rbf/homography{channels=3}")))
        .stderr(contains("ncc is blind to one gain and bias"));
    let summary = fs::read_to_string(dir.path().join("out/summary.csv")).unwrap();
    assert!(
        summary.contains("esm/ssd+gb/homography,esm,ssd,homography,gb,"),
        "{summary}"
    );
    assert!(
        dir.path()
            .join("out/frames/esm-ssd-gb-homography/data/seq0.csv")
            .exists()
    );
    program(dir.path())
        .args(["run", "data", "--am", "sad", "--ilm", "gb"])
        .assert()
        .code(2)
        .stderr(contains("sad has no derivatives"));
    program(dir.path())
        .args([
            "diagnose",
            "data",
            "--am",
            "ssd",
            "--ssm",
            "homography",
            "--ilm",
            "all",
        ])
        .assert()
        .success()
        .stdout(contains("ssd+rbf").and(contains("ssd+pgb/homography")));
}

fn a_run_tracks_and_leaves_what_it_promises() {
    let dir = with_data(&[12, 9]);
    program(dir.path())
        .args(["run", "data", "--sm", "ESM,iclk", "--out", "out", "-j", "1"])
        .assert()
        .success()
        .stdout(
            contains("esm/ssd/homography")
                .and(contains("iclk/ssd/homography"))
                .and(contains("AUC")),
        )
        .stderr(contains("results in out"));
    let read = |name: &str| fs::read_to_string(dir.path().join("out").join(name)).unwrap();
    let log = read("frames/esm-ssd-homography/data/seq0.csv");
    let columns = "frame,file,status,x1,y1,x2,y2,x3,y3,x4,y4,al,mcd,cl,jaccard,iterations,similarity";
    assert_eq!(log.lines().next(), Some(columns));
    assert_eq!(log.lines().count(), 1 + 12);
    let sequences = read("sequences.csv");
    let begin = "tracker,sm,am,ssm,ilm,dataset,sequence,start,protocol,status,frames,sr_1,";
    assert!(sequences.starts_with(begin), "{sequences}");
    assert_eq!(sequences.lines().count(), 1 + 2 * 2);
    let mut summary = csv::Reader::from_reader(read("summary.csv").into_bytes().leak() as &[u8]);
    let sr_5 = summary
        .headers()
        .unwrap()
        .iter()
        .position(|h| h == "sr_5")
        .unwrap();
    for row in summary.records() {
        let row = row.unwrap();
        assert!(row[sr_5].parse::<f64>().unwrap() >= 0.95, "{row:?}");
    }
    let timing = read("timing.csv");
    assert!(timing.starts_with("tracker,dataset,sequence,start,frames,seconds,fps,ms_median,ms_p95,"));
    assert!(timing.lines().skip(1).all(|l| l.contains(",1,yes,")), "{timing}");
    let run: serde_json::Value = serde_json::from_str(&read("run.json")).unwrap();
    assert_eq!(run["command"], serde_json::json!(["data", "--sm", "ESM,iclk"]));
    assert_eq!(run["sequences"][0]["frames"], 12);
    let tracker: serde_json::Value =
        serde_json::from_str(&read("frames/esm-ssd-homography/tracker.json")).unwrap();
    assert_eq!(tracker["parameters"]["max_iters"], 30);
    for name in ["curves.csv", "summary.json", "success.svg", "journal.jsonl"] {
        assert!(!read(name).is_empty(), "{name}");
    }
}

fn results_on_stdout_are_for_programs_too() {
    let dir = with_data(&[6]);
    let run = |args: &[&str]| {
        let base = ["run", "data", "--out", "out", "-q"];
        let assert = program(dir.path())
            .args(base)
            .args(args)
            .assert()
            .success()
            .stderr(is_empty());
        String::from_utf8(assert.get_output().stdout.clone()).unwrap()
    };
    let json: serde_json::Value = serde_json::from_str(&run(&["--format", "json"])).unwrap();
    assert_eq!(json["trackers"].as_array().unwrap().len(), 1);
    assert!(run(&["--format", "csv"]).lines().count() >= 2);
    assert!(run(&["--format", "md"]).starts_with('|'));
    assert!(!run(&[]).contains('\u{1b}'));
}

fn settings_reach_the_trackers() {
    let dir = with_data(&[6]);
    let args = [
        "--max-iters",
        "7",
        "--res",
        "20x25",
        "--set",
        "esm.epsilon=0.01",
        "--pre",
        "none",
    ];
    program(dir.path())
        .args(["run", "data", "--out", "out"])
        .args(args)
        .assert()
        .success();
    let run: serde_json::Value =
        serde_json::from_slice(&fs::read(dir.path().join("out/run.json")).unwrap()).unwrap();
    let tracker = &run["trackers"][0];
    assert_eq!(
        tracker["id"],
        "esm/ssd/homography{epsilon=0.01,max_iters=7,res=20x25}"
    );
    assert_eq!(tracker["parameters"]["max_iters"], 7);
    assert_eq!(run["pre"], "none");
    program(dir.path())
        .args([
            "run",
            "data",
            "--out",
            "few",
            "--frame-gap",
            "2",
            "--max-frames",
            "2",
        ])
        .assert()
        .success();
    let log = fs::read_to_string(dir.path().join("few/frames/esm-ssd-homography/data/seq0.csv")).unwrap();
    let files: Vec<&str> = log
        .lines()
        .skip(1)
        .map(|l| l.split(',').nth(1).unwrap())
        .collect();
    assert_eq!(files, ["frame00001.png", "frame00003.png"]);
}

fn filters_are_part_of_what_a_run_is() {
    let dir = with_data(&[4]);
    let mut seen = Vec::new();
    for (given, name) in [
        ("Median:3, gaussian", "median:3,gaussian:5:3"),
        ("gaussian,median:3", "gaussian:5:3,median:3"),
        ("box", "box:5"),
        ("bilateral:3", "bilateral:3:15:15"),
        ("aniso", "aniso:0.142857:30:15"),
        ("sobel", "sobel:5:0"),
        ("histeq", "histeq"),
    ] {
        program(dir.path())
            .args(["run", "data", "--out", "out", "--force", "--pre", given])
            .assert()
            .success();
        let read = |file: &str| fs::read_to_string(dir.path().join("out").join(file)).unwrap();
        let run: serde_json::Value = serde_json::from_str(&read("run.json")).unwrap();
        assert_eq!(run["pre"], name);
        let journal = read("journal.jsonl");
        let key = journal.lines().find_map(|line| {
            let line: serde_json::Value = serde_json::from_str(line).ok()?;
            Some(line["key"].as_str()?.to_owned())
        });
        seen.push((
            key.expect("a unit"),
            read("frames/esm-ssd-homography/data/seq0.csv"),
        ));
    }
    let count = seen.len();
    let (mut keys, mut logs): (Vec<_>, Vec<_>) = seen.into_iter().unzip();
    for list in [&mut keys, &mut logs] {
        list.sort();
        list.dedup();
        assert_eq!(list.len(), count);
    }
    program(dir.path())
        .args(["list", "filters"])
        .assert()
        .success()
        .stdout(contains("bilateral:5:15:15").and(contains("median of a window")));
}

fn mistakes_are_told_with_the_way_out() {
    let dir = with_data(&[4]);
    let cases: &[(&[&str], i32, &str)] = &[
        (&["run", "data", "--sm", "esmm"], 2, "did you mean 'esm'"),
        (&["run", "data", "--am", "sssd"], 2, "did you mean 'ssd'"),
        (
            &["run", "data", "--ssm", "homograpy"],
            2,
            "did you mean 'homography'",
        ),
        (&["run", "data", "--tracker", "esm/ssd"], 2, "expected"),
        (
            &["run", "data", "--set", "max_itres=3"],
            2,
            "did you mean 'max_iters'",
        ),
        (&["run", "data", "--max-iters", "0"], 2, "--max-iters"),
        (&["run", "data", "--res", "0x9"], 2, "--res"),
        (&["run", "data", "--pre", "gausian"], 2, "gaussian"),
        (
            &["run", "data", "--pre", "box,median:2"],
            2,
            "odd size from 3 to 15",
        ),
        (&["run", "data", "--sort", "aucc"], 2, "auc"),
        (&["run", "data", "--memory", "much"], 2, "512M"),
        (&["run", "nowhere"], 2, "nowhere"),
        (&["run", "data", "--seq", "x*"], 4, "none of 1 sequences"),
        (&["run", "data", "--tag", "fast"], 4, "--tag"),
        (&["run", "data", "--seq", "[", "--out", "o"], 2, "--seq"),
        (&["run", "data", "--out", "data"], 2, "--out"),
        (&["run", "data", "--out", "data/seq0.txt"], 2, "seq0.txt"),
        (&["check", "--baseline", "none.json"], 2, "none.json"),
        (&["data", "check", "nowhere"], 2, "1 error"),
    ];
    for (args, code, said) in cases {
        program(dir.path())
            .args(*args)
            .assert()
            .code(*code)
            .stderr(contains(*said));
    }
    assert!(
        !dir.path().join("results").exists(),
        "nothing is created for a command that cannot run"
    );
    fs::create_dir(dir.path().join("empty")).unwrap();
    program(dir.path())
        .args(["run", "empty"])
        .assert()
        .code(2)
        .stderr(contains("empty"));
}

fn a_broken_frame_fails_its_sequence_and_no_other() {
    let dir = with_data(&[8, 8]);
    fs::write(dir.path().join("data/seq1/frame00005.png"), "no image").unwrap();
    program(dir.path())
        .args(["run", "data", "--sm", "esm,fclk", "--out", "out"])
        .assert()
        .code(20)
        .stdout(contains("esm/ssd/homography"))
        .stderr(contains("frame00005.png"));
    let sequences = fs::read_to_string(dir.path().join("out/sequences.csv")).unwrap();
    assert_eq!(
        sequences
            .lines()
            .filter(|l| l.contains(",seq0,") && l.contains(",ok,"))
            .count(),
        2
    );
    assert_eq!(
        sequences
            .lines()
            .filter(|l| l.contains(",seq1,") && l.contains(",failed,"))
            .count(),
        2
    );
    // Mended, only what failed runs again.
    fs::copy(
        dir.path().join("data/seq1/frame00004.png"),
        dir.path().join("data/seq1/frame00005.png"),
    )
    .unwrap();
    program(dir.path())
        .args(["run", "data", "--sm", "esm,fclk", "--out", "out"])
        .assert()
        .success()
        .stderr(contains("2 of 4 are done already"));
}

fn faulty_data_is_refused_or_left_out() {
    let dir = with_data(&[5, 5]);
    let truth = dir.path().join("data/seq1.txt");
    let text = fs::read_to_string(&truth).unwrap().replacen("20 15", "nan 15", 1);
    fs::write(&truth, text).unwrap();
    program(dir.path())
        .args(["run", "data", "--out", "a"])
        .assert()
        .code(2)
        .stderr(contains("seq1.txt:2"));
    assert!(!dir.path().join("a").exists());
    program(dir.path())
        .args(["run", "data", "--out", "a", "--on-bad-data", "skip"])
        .assert()
        .success()
        .stderr(contains("seq1.txt:2"));
    let sequences = fs::read_to_string(dir.path().join("a/sequences.csv")).unwrap();
    assert!(sequences.contains(",seq0,") && !sequences.contains(",seq1,"));
}

fn default_directories_are_new_and_named() {
    let dir = with_data(&[4]);
    let assert = program(dir.path()).args(["run", "data"]).assert().success();
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    let path = said.lines().last().unwrap().strip_prefix("results in ").unwrap();
    assert!(dir.path().join(path).join("summary.csv").exists());
    let name = Path::new(path).file_name().unwrap().to_str().unwrap();
    assert_eq!(name.len(), "yyyymmdd-hhmmss-hhhhhh".len());
}

fn a_baseline_checks_what_it_records() {
    let dir = with_data(&[10]);
    program(dir.path())
        .args(["run", "data", "--out", "out", "-j", "2"])
        .assert()
        .success();
    program(dir.path())
        .args(["check", "out", "--baseline", "b.json", "--update-baseline"])
        .assert()
        .success();
    program(dir.path())
        .args(["check", "out", "--baseline", "b.json"])
        .assert()
        .success();
    // Without a run, the recorded command is run first.
    program(dir.path())
        .args(["check", "--baseline", "b.json"])
        .assert()
        .success();
    program(dir.path())
        .args([
            "run",
            "data",
            "--max-iters",
            "1",
            "--frame-gap",
            "9",
            "--out",
            "bad",
        ])
        .assert()
        .success();
    let code = program(dir.path())
        .args(["check", "bad", "--baseline", "b.json"])
        .assert()
        .get_output()
        .status
        .code();
    assert!(matches!(code, Some(10 | 11 | 21)), "{code:?}");
}

#[cfg(unix)]
fn a_closed_pipe_is_no_failure() {
    let dir = with_data(&[4]);
    let program = assert_cmd::cargo::cargo_bin!("mtf-eval");
    let script = format!("set -o pipefail; '{}' list params | true", program.display());
    let status = std::process::Command::new("bash")
        .args(["-c", &script])
        .current_dir(dir.path())
        .status()
        .unwrap();
    assert!(status.success(), "{status:?}");
}

fn truth_is_fitted_with_a_warp_of_fewer_degrees_of_freedom() {
    let dir = tempfile::tempdir().unwrap();
    let mean = |extra: &[&str]| {
        let run =
            "run --seq plain-poster --sm esm --am ssd --ssm translation -q --format json --force --out out";
        let mut command = program(dir.path());
        let output = command.args(run.split(' ')).args(extra).assert().success();
        let summary: serde_json::Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
        summary["trackers"][0]["aggregates"][0]["al_mean"]
            .as_f64()
            .unwrap()
    };
    // The sequence turns by up to 25 degrees, which a shift cannot follow.
    let (plain, fitted) = (mean(&[]), mean(&["--gt-ssm", "translation"]));
    assert!(
        fitted < 0.7 * plain,
        "{fitted} px, {plain} px against the unfitted truth"
    );
    assert!((mean(&["--gt-ssm", "homography"]) - plain).abs() < 1e-4);
    let run: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(dir.path().join("out/run.json")).unwrap()).unwrap();
    assert_eq!(run["gt_ssm"], "homography");
    for (name, message) in [
        ("translatoin", "did you mean 'translation'?"),
        ("all", "give one state space model"),
    ] {
        let mut command = program(dir.path());
        let refused = command.args(["run", "--gt-ssm", name]).assert().code(2);
        refused.stderr(contains(message)).stdout(is_empty());
    }
}
