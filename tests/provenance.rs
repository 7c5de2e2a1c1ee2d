//! What results are of: data that changed or was left out, directories of other experiments, bits that flipped.

use crate::runs::{journal_lines, program, reproducible, write_data};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use rand::{RngExt, SeedableRng};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

crate::tests! {
    frames_that_change_in_place_are_noticed;
    data_that_changes_during_a_run_fails_its_units;
    results_of_another_experiment_are_not_replaced;
    tables_say_what_was_left_out_or_repaired;
    flipped_bits_are_noticed_or_change_nothing;
}

/// Quick trackers.
const QUICK: [&str; 4] = ["--ssm", "translation", "--progress", "none"];

fn run(dir: &Path, args: &[&str]) -> assert_cmd::assert::Assert {
    program(dir).arg("run").args(args).args(QUICK).assert()
}

fn said(assert: &assert_cmd::assert::Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}

/// Makes frames of the sequence `folder` from `from` on noise, with the same names, sizes and times.
fn spoil(folder: &Path, from: usize) {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
    let mut names: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    for path in &names[from..] {
        let time = fs::metadata(path).unwrap().modified().unwrap();
        let mut bytes = fs::read(path).unwrap();
        let header = bytes.len() - 96 * 72;
        bytes[header..]
            .iter_mut()
            .for_each(|v| *v = rng.random_range(0..=255));
        fs::write(path, bytes).unwrap();
        set_time(path, time);
    }
}

fn set_time(path: &Path, time: SystemTime) {
    let file = fs::File::options().write(true).open(path).unwrap();
    file.set_modified(time).unwrap();
}

/// [`write_data`] in PGM: as many bytes whatever the picture.
fn write_pgm(root: &Path, lengths: &[usize]) {
    write_data(root, lengths);
    for s in 0..lengths.len() {
        for entry in fs::read_dir(root.join(format!("seq{s}"))).unwrap() {
            let path = entry.unwrap().path();
            image::open(&path)
                .unwrap()
                .save(path.with_extension("pgm"))
                .unwrap();
            fs::remove_file(&path).unwrap();
        }
        let truth = root.join(format!("seq{s}.txt"));
        let text = fs::read_to_string(&truth).unwrap().replace(".png", ".pgm");
        fs::write(truth, text).unwrap();
    }
}

fn frames_that_change_in_place_are_noticed() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_pgm(&dir.join("data"), &[10, 8]);
    run(dir, &["data", "-o", "clean"]).success();
    run(dir, &["data", "-o", "out"]).success();
    run(dir, &["data", "-o", "s1", "--shard", "slice:1/2"]).success();
    let check = |run: &str| {
        program(dir)
            .args(["check", run, "--baseline", "base.json"])
            .assert()
    };
    program(dir)
        .args(["check", "out", "--baseline", "base.json", "--update-baseline"])
        .assert()
        .success();
    check("out").success();

    spoil(&dir.join("data/seq0"), 3);
    let again = run(dir, &["data", "-o", "out"]).success();
    assert!(
        said(&again).contains("data/seq0: its frames or ground truth have changed"),
        "{}",
        said(&again)
    );
    run(dir, &["data", "-o", "noise"]).success();
    assert_eq!(
        reproducible(&dir.join("out"))[Path::new("summary.csv")],
        reproducible(&dir.join("noise"))[Path::new("summary.csv")]
    );
    check("out")
        .code(11)
        .stdout(contains("data/seq0: other frames or ground truth"));
    program(dir)
        .args(["compare", "clean", "out"])
        .assert()
        .code(11)
        .stderr(contains("fingerprint) in data/seq0"));
    run(dir, &["data", "-o", "s2", "--shard", "slice:2/2"]).success();
    program(dir)
        .args(["merge", "all", "s1", "s2"])
        .assert()
        .code(11)
        .stderr(contains("data/seq0 is not the same"));
    assert!(!dir.join("all").exists());
}

fn data_that_changes_during_a_run_fails_its_units() {
    use mtf_eval::dataset::{LoadOptions, load};
    let dir = tempfile::tempdir().unwrap();
    write_pgm(dir.path(), &[4]);
    let sequence = &load(dir.path(), &LoadOptions::default()).unwrap().sequences[0];
    sequence.fingerprint();
    assert!(sequence.read(3, false).is_ok());
    spoil(&dir.path().join("seq0"), 3);
    let error = sequence.read(3, false).unwrap_err().to_string();
    assert!(
        error.contains("frame00004.pgm: the file has changed since the run began"),
        "{error}"
    );
}

fn results_of_another_experiment_are_not_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_pgm(&dir.join("data"), &[12, 8]);
    fs::create_dir(dir.join("other")).unwrap();
    write_pgm(&dir.join("other/data"), &[12, 8]);
    spoil(&dir.join("other/data/seq1"), 2);
    write_pgm(&dir.join("more"), &[7]);
    let first = [
        "data",
        "--am",
        "ssd,zncc",
        "--protocol",
        "ope,subseq:2",
        "-o",
        "out",
    ];
    run(dir, &first).success();
    let held = |name: &str| fs::read(dir.join("out").join(name)).unwrap();
    let before = reproducible(&dir.join("out"));
    let ssd = ["--am", "ssd,zncc", "--protocol", "ope,subseq:2"];
    for (args, named) in [
        (
            vec!["data", "--am", "ncc", "--protocol", "ope,subseq:2"],
            "tracker esm/ssd/translation is not in the new one",
        ),
        ([&["data", "--seed", "1"], &ssd[..]].concat(), "seed 0 against 1"),
        (
            [&["data", "--pre", "none"], &ssd[..]].concat(),
            "filter gaussian:5:3 against none",
        ),
        (
            [&["data", "--max-frames", "5"], &ssd[..]].concat(),
            "max_frames null against 5",
        ),
        (
            [&["other/data"], &ssd[..]].concat(),
            "other frames or ground truth of data/seq1",
        ),
        (
            [&["more"], &ssd[..]].concat(),
            "sequence data/seq0 is not in the new one",
        ),
    ] {
        let refused = run(dir, &[&args[..], &["-o", "out"]].concat()).code(11);
        let text = said(&refused);
        assert!(
            text.contains("out holds another experiment") && text.contains(named),
            "{args:?}: {text}"
        );
        assert!(text.contains("--force"), "{text}");
        assert_eq!(reproducible(&dir.join("out")), before, "{args:?}");
    }
    // What was asked for in other words, and what is wider, goes on.
    let lines = journal_lines(&held("journal.jsonl")).len();
    run(
        dir,
        &[
            "data",
            "--protocol",
            "subseq:2,ope",
            "--am",
            "zncc",
            "--am",
            "ssd",
            "-o",
            "out",
        ],
    )
    .success();
    assert_eq!(journal_lines(&held("journal.jsonl")).len(), lines);
    run(
        dir,
        &[
            "data",
            "more",
            "--am",
            "ssd,zncc,ncc",
            "--protocol",
            "ope,subseq:2,every:4",
            "-o",
            "out",
        ],
    )
    .success();
    let entries = journal_lines(&held("journal.jsonl"));
    assert!(entries.len() > lines);
    let all = String::from_utf8(held("summary.csv")).unwrap();
    assert!(all.contains("esm/ncc/translation") && all.contains("every:4"));
    // A part of it gives tables of that part, and says so.
    let part = run(
        dir,
        &[
            "data",
            "more",
            "--am",
            "ssd,zncc,ncc",
            "--seq",
            "seq0",
            "-o",
            "out",
        ],
    )
    .success();
    let text = said(&part);
    assert!(
        text.contains("protocol every:4 and 2 more are not asked for and left out"),
        "{text}"
    );
    // As does anything where nothing has been done, or is to be kept.
    run(dir, &["data", "--am", "ncc", "-o", "out", "--force"]).success();
    assert!(!String::from_utf8(held("summary.csv")).unwrap().contains("zncc"));
    fs::write(dir.join("out/journal.jsonl"), "").unwrap();
    run(dir, &["more", "--am", "ssd", "-o", "out"]).success();
}

fn tables_say_what_was_left_out_or_repaired() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8, 8, 8]);
    run(dir, &["data", "-o", "whole", "-q"])
        .success()
        .stdout(contains("data:").not());
    fs::write(dir.join("data/seq1/frame00005.png"), "no image").unwrap();
    // A JPEG frame without end mark among the others.
    let frame = dir.join("data/seq2/frame00004.png");
    let mut jpeg = std::io::Cursor::new(Vec::new());
    image::open(&frame)
        .unwrap()
        .write_to(&mut jpeg, image::ImageFormat::Jpeg)
        .unwrap();
    let jpeg = jpeg.into_inner();
    fs::write(&frame, &jpeg[..jpeg.len() - 2]).unwrap();

    let args = ["data", "-o", "out", "--on-bad-data", "skip"];
    let line = || {
        contains("data: 1 sequence left out (data/seq1: ")
            .and(contains("frame00005.png"))
            .and(contains("1 sequence repaired (data/seq2: "))
            .and(contains("no end mark"))
    };
    let loud = run(dir, &args).success().stdout(line());
    assert!(
        said(&loud).contains("frame00004.png: the JPEG image has no end mark"),
        "{}",
        said(&loud)
    );
    run(dir, &[&args[..], &["-q"]].concat()).success().stdout(line());
    run(dir, &[&args[..], &["-q", "--format", "md"]].concat())
        .success()
        .stdout(contains("\n\ndata: 1 sequence left"));
    run(dir, &[&args[..], &["-q", "--format", "csv"]].concat())
        .success()
        .stdout(contains("data:").not())
        .stderr(line());
    program(dir)
        .args(["status", "-q", "out"])
        .assert()
        .success()
        .stdout(line());
    program(dir)
        .args(["compare", "-q", "whole", "out"])
        .assert()
        .code(11);
    program(dir)
        .args(["compare", "-q", "out", "out"])
        .assert()
        .success()
        .stdout(line());
    program(dir)
        .args([
            "check",
            "-q",
            "out",
            "--baseline",
            "base.json",
            "--update-baseline",
        ])
        .assert()
        .success()
        .stdout(line());
    program(dir)
        .args(["check", "-q", "out", "--baseline", "base.json"])
        .assert()
        .success()
        .stdout(line());
    program(dir)
        .args(["merge", "-q", "all", "out"])
        .assert()
        .success()
        .stdout(line());
    for out in ["out", "all"] {
        let run: serde_json::Value =
            serde_json::from_slice(&fs::read(dir.join(out).join("run.json")).unwrap()).unwrap();
        assert_eq!(run["left_out"][0]["sequence"], "seq1");
        assert!(
            run["left_out"][0]["reasons"][0]
                .as_str()
                .unwrap()
                .contains("frame00005.png")
        );
        assert_eq!(run["repaired"][0]["sequence"], "seq2");
        assert_eq!(run["repaired"].as_array().unwrap().len(), 1);
    }
}

/// Bits flipped in each file; `MTF_EVAL_FLIPS` has another number.
const FLIPS: usize = 2;

/// Every file below `dir`, with its bytes.
fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut found, mut folders) = (BTreeMap::new(), vec![dir.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => {
                    found.insert(path.clone(), fs::read(&path).unwrap());
                }
            }
        }
    }
    found
}

/// What a run writes at its end, whatever there is.
const RESULT_FILES: [&str; 6] = [
    "summary.csv",
    "sequences.csv",
    "curves.csv",
    "summary.json",
    "success.svg",
    "timing.csv",
];

/// What must be the same whatever happened, of a finished run.
fn figures(dir: &Path) -> BTreeMap<&'static str, Vec<u8>> {
    let names = [
        "summary.csv",
        "sequences.csv",
        "curves.csv",
        "summary.json",
        "success.svg",
        "truth.csv",
    ];
    names.map(|name| (name, fs::read(dir.join(name)).unwrap())).into()
}

fn flipped_bits_are_noticed_or_change_nothing() {
    let flips = std::env::var("MTF_EVAL_FLIPS").map_or(FLIPS, |n| n.parse().unwrap());
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[5, 4]);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(11);
    for logs in ["zst", "none"] {
        let out = dir.join(logs);
        let args = [
            "data",
            "--sm",
            "esm,nn",
            "--ssm",
            "translation",
            "--frame-logs",
            logs,
            "-o",
            logs,
        ];
        let again = || {
            program(dir)
                .arg("run")
                .args(args)
                .args(["--progress", "none"])
                .output()
                .unwrap()
        };
        assert!(again().status.success());
        let code = |args: &[&str]| program(dir).args(args).output().unwrap().status.code();
        assert_eq!(
            code(&["check", logs, "--baseline", "base.json", "--update-baseline"]),
            Some(0)
        );
        let reference = figures(&out);
        fs::create_dir(dir.join("reference")).unwrap();
        let whole = contents(&out);
        for (path, bytes) in &whole {
            let copy = dir.join("reference").join(path.strip_prefix(&out).unwrap());
            fs::create_dir_all(copy.parent().unwrap()).unwrap();
            fs::write(copy, bytes).unwrap();
        }
        for (path, bytes) in whole.iter().filter(|(_, bytes)| !bytes.is_empty()) {
            let name = path.strip_prefix(&out).unwrap().to_string_lossy().into_owned();
            let (mut noticed, mut harmless) = (0, 0);
            for k in 0..flips {
                let (at, bit) = (rng.random_range(0..bytes.len()), rng.random_range(0..8));
                let mut flipped = bytes.clone();
                flipped[at] ^= 1 << bit;
                fs::write(path, &flipped).unwrap();
                let what = format!("{logs}: {name}, byte {at}, bit {bit}");
                let same = || match name.ends_with(".json") {
                    true => {
                        serde_json::from_slice::<serde_json::Value>(&flipped).ok()
                            == serde_json::from_slice(bytes).ok()
                    }
                    false => false,
                };
                match code(&["status", logs]) {
                    Some(0) if same() => harmless += 1,
                    Some(0) => panic!("{what}: status is content"),
                    _ => noticed += 1,
                }
                // Files that nothing else reads are left to `status`.
                let read = |names: &[&str]| names.contains(&name.as_str());
                if read(&["run.json", "journal.jsonl", "summary.json"]) {
                    assert!([Some(0), Some(2), Some(11), Some(21)].contains(&code(&[
                        "check",
                        logs,
                        "--baseline",
                        "base.json"
                    ])));
                    let compared = program(dir)
                        .args(["compare", "reference", logs])
                        .output()
                        .unwrap();
                    let equal = String::from_utf8_lossy(&compared.stdout).contains("no difference");
                    assert!(!compared.status.success() || equal, "{what}: compare");
                }
                if read(&["run.json", "journal.jsonl", "truth.csv"]) || name.starts_with("frames") {
                    if program(dir)
                        .args(["merge", "merged", logs])
                        .output()
                        .unwrap()
                        .status
                        .success()
                    {
                        assert_eq!(figures(&dir.join("merged")), reference, "{what}: merge");
                    }
                    let _ = fs::remove_dir_all(dir.join("merged"));
                }
                // The same command again mends it, or refuses to; a file that it writes whatever there is, once is enough.
                if (k == 0 || !read(&RESULT_FILES)) && again().status.success() {
                    assert_eq!(figures(&out), reference, "{what}: run");
                    assert_eq!(code(&["status", logs]), Some(0), "{what}: not mended");
                }
                for path in contents(&out).keys().filter(|path| !whole.contains_key(*path)) {
                    fs::remove_file(path).unwrap();
                }
                for (path, bytes) in &whole {
                    fs::write(path, bytes).unwrap();
                }
            }
            if flips > FLIPS {
                println!("{logs} {name}: {flips} flips, {noticed} noticed, {harmless} change nothing");
            }
        }
        fs::remove_dir_all(dir.join("reference")).unwrap();
    }
}
