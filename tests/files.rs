//! The page about the files of a run directory says what is in them: every column, and no other.

use crate::runs::{journal_lines, program, write_data};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

crate::tests! {
    the_page_has_every_column_of_every_file;
    runs_without_frame_logs_are_small;
    large_runs_keep_one_curve_per_tracker;
}

type Columns = BTreeSet<String>;

/// The names in the first column of the tables of `docs/files.md`, by heading.
fn page() -> BTreeMap<String, Columns> {
    let text = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/files.md")).unwrap();
    let mut columns: BTreeMap<String, Columns> = BTreeMap::new();
    let mut heading = String::new();
    for line in text.lines() {
        if let Some(title) = line.strip_prefix("## ") {
            heading = title.to_owned();
        } else if line.starts_with("| `") && !heading.is_empty() {
            let cells: Vec<&str> = line.trim_matches('|').split('|').collect();
            assert_eq!(cells.len(), 4, "name, type, unit, meaning: {line}");
            let names = cells[0].split('`').skip(1).step_by(2).map(str::to_owned);
            columns.entry(heading.clone()).or_default().extend(names);
        }
    }
    columns
}

/// The keys of the objects of a value, with dots between and `[]` for elements, but for those within `free`.
fn keys(value: &Value, path: &str, free: &[&str], found: &mut Columns) {
    if free.contains(&path) {
        return;
    }
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                let name = if path.is_empty() {
                    key.clone()
                } else {
                    format!("{path}.{key}")
                };
                keys(value, &name, free, found);
                found.insert(name);
            }
        }
        Value::Array(all) => all
            .iter()
            .for_each(|value| keys(value, &format!("{path}[]"), free, found)),
        _ => {}
    }
}

fn json(bytes: &[u8], free: &[&str]) -> Columns {
    let mut found = Columns::new();
    keys(&serde_json::from_slice(bytes).unwrap(), "", free, &mut found);
    found
}

/// All files below a folder.
fn below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => found.extend(below(&path)),
            false => found.push(path),
        }
    }
    found
}

/// The columns of the files of a run directory, by the heading of the page.
fn written(dir: &Path, columns: &mut BTreeMap<String, Columns>) {
    for path in below(dir) {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let bytes = fs::read(&path).unwrap();
        let (heading, found) = match name.as_str() {
            ".lock" | "success.svg" => continue,
            "journal.jsonl" => {
                let mut found = Columns::new();
                for line in journal_lines(&bytes) {
                    keys(&line, "", &[], &mut found);
                }
                (name, found)
            }
            "run.json" => {
                let free = ["trackers[].parameters", "host.files", "read_as"];
                (name, json(&bytes, &free))
            }
            "summary.json" => (name, json(&bytes, &["thresholds", "tags"])),
            "tracker.json" => (name, json(&bytes, &["parameters"])),
            _ => {
                let text = String::from_utf8(bytes).unwrap();
                let header = text.lines().next().unwrap().split(',').map(str::to_owned);
                let log = path.strip_prefix(dir).unwrap().starts_with("frames");
                let heading = if log { "Frame logs".to_owned() } else { name };
                (heading, header.collect())
            }
        };
        columns.entry(heading).or_default().extend(found);
    }
}

fn the_page_has_every_column_of_every_file() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[6, 5]);
    // One that is left out.
    write_data(&dir.join("bad"), &[4, 4]);
    fs::write(dir.join("bad/seq1/frame00002.png"), "").unwrap();
    let quick = ["--max-iters", "2", "--res", "10x10", "-q"];
    let run = |out: &str, args: &[&str], code: i32| {
        let mut command = program(dir);
        command.args(["run", "--out", out]).args(args).args(quick);
        command.assert().code(code);
    };
    let truth = ["--truth-start", "1", "--truth-step", "1", "--origin", "0.5"];
    let protocols = [
        "data",
        "--protocol",
        "ope,reinit",
        "--sm",
        "esm,nn",
        "--set",
        "nn.n_samples=20",
    ];
    run("a", &[&protocols[..], &truth].concat(), 0);
    let bending = ["builtin", "--seq", "bending", "--max-frames", "4"];
    run("b", &bending, 0);
    run("c", &[&bending[..], &["--frame-logs", "none"]].concat(), 0);
    run("d", &["data", "--timeout", "0.000001", "--shard", "hash:1/1"], 20);
    run("e", &["bad", "--on-bad-data", "skip"], 0);
    program(dir).args(["merge", "f", "c"]).assert().success();
    let mut columns = BTreeMap::new();
    for out in ["a", "b", "c", "d", "e", "f"] {
        written(&dir.join(out), &mut columns);
    }
    let mut page = page();
    let figures = page.remove("Figures").unwrap();
    for file in ["summary.csv", "sequences.csv"] {
        page.get_mut(file).unwrap().extend(figures.iter().cloned());
    }
    for list in ["aggregates", "sequences"] {
        let names = figures
            .iter()
            .map(|figure| format!("trackers[].{list}[].{figure}"));
        page.get_mut("summary.json").unwrap().extend(names);
    }
    let run = page.get_mut("run.json").unwrap();
    // Of programs with metrics of their own, of data of other kinds, of builds that know their commit.
    // Of unions and of recorded results, too.
    for name in [
        "metrics",
        "repaired",
        "missing",
        "doubtful",
        "noted",
        "joined",
        "trackers[].answers",
    ] {
        assert!(run.remove(name), "{name}");
    }
    let written = columns.get_mut("run.json").unwrap();
    for list in ["repaired", "doubtful", "noted"] {
        // Said once, for `left_out`.
        written.retain(|name| !name.starts_with(list));
    }
    for (file, expected) in &page {
        let found = columns.remove(file).unwrap_or_default();
        let unsaid: Vec<&String> = found.difference(expected).collect();
        let missing: Vec<&String> = expected.difference(&found).collect();
        assert!(
            unsaid.is_empty() && missing.is_empty(),
            "{file}: not on the page {unsaid:?}, not in the file {missing:?}"
        );
    }
    assert!(columns.is_empty(), "not on the page: {:?}", columns.keys());
}

/// The bytes that a folder takes on a disk with blocks of 4 KiB.
fn on_disk(dir: &Path) -> u64 {
    let blocks = |path: PathBuf| fs::metadata(path).unwrap().len().div_ceil(4096) * 4096;
    below(dir).into_iter().map(blocks).sum()
}

fn runs_without_frame_logs_are_small() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let words = "run --sm lk --am ssd,ncc --ssm translation,affine,homography --tag quick --max-iters 3 --res 12x12 \
                 --frame-logs none -q --out out";
    program(dir).args(words.split_whitespace()).assert().success();
    let out = dir.join("out");
    assert!(!out.join("frames").exists());
    let units = journal_lines(&fs::read(out.join("journal.jsonl")).unwrap()).len() as u64;
    let journal = fs::metadata(out.join("journal.jsonl")).unwrap().len();
    // 59 frames of 4 errors each: 2.7 kB as they are.
    assert!(journal / units < 1500, "{}", journal / units);
    assert!(on_disk(&out) / units < 6000, "{}", on_disk(&out) / units);
    program(dir).args(["status", "out"]).assert().success();
    let again = program(dir).args(words.split_whitespace()).assert().success();
    let table = String::from_utf8(again.get_output().stdout.clone()).unwrap();
    let so_far = program(dir).args(["status", "out", "--table"]).assert().success();
    let so_far = String::from_utf8(so_far.get_output().stdout.clone()).unwrap();
    assert!(so_far.starts_with(&table), "{so_far}");
    assert!(
        so_far.contains(&format!("complete: all {units} units are in it")),
        "{so_far}"
    );
}

fn large_runs_keep_one_curve_per_tracker() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[3, 3, 3, 3, 3]);
    let run = |settings: usize| {
        let values: Vec<String> = (1..=settings).map(|k| format!("{}e-9", k)).collect();
        let grid = format!(
            "data = 'data'\nframe_logs = 'none'\n[params]\nmax_iters = 1\nres = '5x5'\nepsilon = [{}]\n",
            values.join(", ")
        );
        fs::write(dir.join("grid.toml"), grid).unwrap();
        let mut command = program(dir);
        command.args(["run", "--grid", "grid.toml", "-q", "--force", "--out", "out"]);
        command.assert().success();
        let curves = fs::read_to_string(dir.join("out/curves.csv")).unwrap();
        curves.lines().count() - 1
    };
    // The four metrics that are not dense, and the alignment error on each of five sequences.
    assert_eq!(run(2), 2 * 11 * (4 + 5));
    assert_eq!(run(201), 201 * 11);
}
