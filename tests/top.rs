//! The best trackers of one or several runs, figures by group, and runs of different trackers, data or protocols as one.

use crate::runs::{assert_same, journal_lines, program, write_data};
use predicates::prelude::{Predicate, PredicateBooleanExt};
use predicates::str::{contains, is_match};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

crate::tests! {
    trackers_of_several_runs_are_ranked_together;
    what_is_picked_is_what_the_figures_say;
    figures_by_tag_are_those_of_the_sequences;
    a_run_prints_groups_beside_its_table;
    a_run_that_has_not_ended_is_ranked_as_far_as_it_is;
    bars_are_for_terminals;
    curves_of_several_runs_are_in_one_picture;
    rows_know_tags_and_speeds;
    a_union_of_trackers_equals_a_run_of_both;
    a_union_keeps_data_and_protocols_apart;
    a_union_refuses_what_differs;
    lists_can_be_filtered;
    a_tag_that_is_not_there_is_an_error_with_those_that_are;
}

/// Two runs of two trackers each on two sequences with tags: `a` and `b`.
fn two_runs() -> tempfile::TempDir {
    let place = tagged_data();
    let dir = place.path();
    track(
        dir,
        "a",
        &["--tracker", "esm/ssd/translation", "--tracker", "iclk/ncc/affine"],
    );
    let few = "fclk/ssd/translation{max_iters=1}";
    track(dir, "b", &["--tracker", few, "--tracker", "ialk/ncc/isometry"]);
    place
}

fn tagged_data() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    let dir = place.path();
    write_data(&dir.join("data"), &[7, 6]);
    fs::write(dir.join("data/seq0/tags.txt"), "near\nquick\n").unwrap();
    fs::write(dir.join("data/seq1/meta.json"), r#"{"tags": ["quick"]}"#).unwrap();
    place
}

fn track(dir: &Path, out: &str, args: &[&str]) {
    program(dir)
        .args([
            "run",
            "data",
            "-q",
            "-j",
            "1",
            "--frame-logs",
            "none",
            "--out",
            out,
        ])
        .args(args)
        .assert()
        .success();
}

fn printed(dir: &Path, args: &[&str]) -> String {
    let output = program(dir).args(args).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{args:?}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

fn document(dir: &Path, args: &[&str]) -> Value {
    serde_json::from_str(&printed(dir, &[args, &["--format", "json"]].concat())).unwrap()
}

/// The trackers that `top` prints.
fn trackers(document: &Value) -> &[Value] {
    document["trackers"].as_array().unwrap()
}

fn ids(document: &Value) -> Vec<&str> {
    trackers(document)
        .iter()
        .map(|t| t["tracker"].as_str().unwrap())
        .collect()
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("{key} in {row}"))
}

/// Rows of a CSV file by column.
fn table(text: &str) -> Vec<std::collections::HashMap<String, String>> {
    csv::Reader::from_reader(text.as_bytes())
        .deserialize()
        .map(Result::unwrap)
        .collect()
}

fn trackers_of_several_runs_are_ranked_together() {
    let place = two_runs();
    let dir = place.path();
    for key in ["auc", "al_mean", "fps"] {
        let top = document(dir, &["top", "a", "b", "--sort", key]);
        assert_eq!(trackers(&top).len(), 4);
        let value = |t: &Value| match key {
            "fps" => -number(t, "fps"),
            "auc" => -number(t, "value"),
            _ => number(t, "value"),
        };
        assert!(trackers(&top).is_sorted_by_key(value), "{top}");
        for t in trackers(&top) {
            let (low, high) = (number(t, "low95"), number(t, "high95"));
            assert!(low <= number(t, "value") && number(t, "value") <= high, "{t}");
            assert!((number(t, "ms") * number(t, "fps") - 1000.0).abs() < 1e-6, "{t}");
        }
        let runs: BTreeSet<&str> = trackers(&top)
            .iter()
            .map(|t| t["run"].as_str().unwrap())
            .collect();
        assert_eq!(runs, BTreeSet::from(["a", "b"]));
    }
    // The figures are those of the files.
    let top = document(dir, &["top", "a"]);
    for row in table(&fs::read_to_string(dir.join("a/summary.csv")).unwrap()) {
        if row["average"] == "pooled" {
            let of = trackers(&top)
                .iter()
                .find(|t| t["tracker"] == *row["tracker"])
                .unwrap();
            assert_eq!(number(of, "value"), row["auc"].parse::<f64>().unwrap());
        }
    }
    let text = printed(dir, &["top", "a", "b", "-n", "3"]);
    let first = text.lines().next().unwrap();
    for column in ["tracker", "run", "auc", "95 % interval", "fps", "ms"] {
        assert!(first.contains(column), "{text}");
    }
    assert!(text.contains("1 more tracker (-n 0 shows all)"), "{text}");
    assert!(
        !printed(dir, &["top", "a"])
            .lines()
            .next()
            .unwrap()
            .contains("run")
    );
    assert_eq!(
        table(&printed(dir, &["top", "a", "b", "--format", "csv", "-n", "2"])).len(),
        2
    );
    assert!(printed(dir, &["top", "a", "--format", "md"]).starts_with("| tracker"));
    program(dir)
        .args(["top", "a", "--metric", "nosuch"])
        .assert()
        .code(2)
        .stderr(contains("no column 'nosuch'"));
    program(dir).args(["top", "data"]).assert().code(2);
}

fn what_is_picked_is_what_the_figures_say() {
    let place = two_runs();
    let dir = place.path();
    let all = document(dir, &["top", "a", "b"]);
    let best = document(dir, &["top", "a", "b", "--best-per", "am"]);
    let mut seen = BTreeSet::new();
    let firsts = trackers(&all).iter().filter(|t| seen.insert(t["am"].to_string()));
    let firsts: Vec<&str> = firsts.map(|t| t["tracker"].as_str().unwrap()).collect();
    assert_eq!((ids(&best), firsts.len()), (firsts.clone(), 2));
    let pareto = document(dir, &["top", "a", "b", "--pareto", "fps"]);
    let beaten = |t: &&Value| {
        let (value, fps) = (number(t, "value"), number(t, "fps"));
        trackers(&all).iter().any(|o| {
            let (v, f) = (number(o, "value"), number(o, "fps"));
            v >= value && f >= fps && (v > value || f > fps)
        })
    };
    let rest = trackers(&all).iter().filter(|t| !beaten(t));
    assert_eq!(
        ids(&pareto),
        rest.map(|t| t["tracker"].as_str().unwrap()).collect::<Vec<_>>()
    );
    // A limit between the second and the third.
    let mut times: Vec<f64> = trackers(&all).iter().map(|t| number(t, "ms")).collect();
    times.sort_by(f64::total_cmp);
    let limit = format!("{:.6}ms", (times[1] + times[2]) / 2.0);
    let under = document(dir, &["top", "a", "b", "--under", &limit]);
    assert_eq!(trackers(&under).len(), 2, "{under}");
    assert!(trackers(&under).iter().all(|t| number(t, "ms") <= times[1]));
    program(dir)
        .args(["top", "a", "b", "--under", "0.000001ms"])
        .assert()
        .code(4)
        .stderr(contains("no tracker takes less than").and(contains("the fastest, ")));
    program(dir)
        .args(["top", "a", "--under", "2"])
        .assert()
        .code(2)
        .stderr(contains("such as 2ms"));
}

fn figures_by_tag_are_those_of_the_sequences() {
    let place = two_runs();
    let dir = place.path();
    let top = document(dir, &["top", "a", "--by", "tag"]);
    let groups = top["groups"]["groups"].as_array().unwrap();
    let names: Vec<&str> = groups.iter().map(|g| g["group"].as_str().unwrap()).collect();
    assert_eq!(names, ["near", "quick"]);
    assert_eq!(
        (&groups[0]["sequences"], &groups[1]["sequences"]),
        (&1.into(), &2.into())
    );
    let sequences = table(&fs::read_to_string(dir.join("a/sequences.csv")).unwrap());
    for t in top["groups"]["trackers"].as_array().unwrap() {
        let own = sequences.iter().filter(|r| t["tracker"] == *r["tracker"]);
        let of = |r: &std::collections::HashMap<String, String>| -> (f64, f64) {
            (r["frames"].parse().unwrap(), r["auc"].parse().unwrap())
        };
        let (near, quick): (Vec<_>, Vec<_>) = own.map(|r| (r["sequence"] == "seq0", of(r))).unzip();
        let at = near.iter().position(|n| *n).unwrap();
        assert_eq!(number(&t["values"], "near"), quick[at].1);
        let frames: f64 = quick.iter().map(|(n, _)| n).sum();
        let mean = quick.iter().map(|(n, auc)| n * auc).sum::<f64>() / frames;
        assert!((number(&t["values"], "quick") - mean).abs() < 1e-9, "{t}");
    }
    let text = printed(dir, &["top", "a", "--by", "tag"]);
    for words in ["near", "*1.000", "best tracker", "the best of all trackers"] {
        assert!(text.contains(words), "{words} in {text}");
    }
    let csv = table(&printed(
        dir,
        &["top", "a", "--by", "sequence", "--format", "csv"],
    ));
    assert_eq!(csv.len(), 2 * 2);
    assert!(csv.iter().all(|row| row["sequence"].starts_with("seq")));
    let by_am = printed(dir, &["top", "a", "b", "--by", "am"]);
    assert!(by_am.contains("best tracker") && by_am.contains("ncc"), "{by_am}");
    program(dir)
        .args(["top", "a", "--by", "tag", "--sort", "al_median"])
        .assert()
        .code(2)
        .stderr(contains("al_median of several sequences cannot be joined by tag"));
    program(dir)
        .args(["top", "a", "--by", "sequence", "--sort", "al_median"])
        .assert()
        .success();
}

fn a_run_prints_groups_beside_its_table() {
    let place = two_runs();
    let dir = place.path();
    let trackers_ = ["--tracker", "esm/ssd/translation", "--tracker", "iclk/ncc/affine"];
    let again = |more: &[&str]| {
        let args = ["run", "data", "-q", "--frame-logs", "none", "--out", "a"];
        printed(dir, &[&args[..], &trackers_[..], more].concat())
    };
    let plain = again(&[]);
    let with_tags = again(&["--by", "tag"]);
    assert!(with_tags.starts_with(&plain), "{with_tags}");
    assert!(
        is_match("tracker +near +quick").unwrap().eval(&with_tags),
        "{with_tags}"
    );
    let picked = again(&["--best-per", "am", "--pareto", "fps"]);
    assert!(picked.contains("fps"), "{picked}");
    let json: Value = serde_json::from_str(&again(&["--by", "am", "--format", "json"])).unwrap();
    assert_eq!(json["groups"]["groups"].as_array().unwrap().len(), 2);
    let csv = table(&again(&["--by", "tag", "--format", "csv"]));
    assert_eq!(csv.len(), 2 * 2);
}

fn a_run_that_has_not_ended_is_ranked_as_far_as_it_is() {
    let place = two_runs();
    let dir = place.path();
    let whole = document(dir, &["top", "a"]);
    // As a run leaves it that was killed after three of four units.
    let journal = fs::read_to_string(dir.join("a/journal.jsonl")).unwrap();
    let lines: Vec<&str> = journal.lines().take(3).collect();
    fs::write(dir.join("a/journal.jsonl"), lines.join("\n") + "\n").unwrap();
    for file in ["summary.json", "summary.csv", "sequences.csv", "curves.csv"] {
        fs::remove_file(dir.join("a").join(file)).unwrap();
    }
    program(dir).args(["top", "a"]).assert().success().stdout(
        contains("a: 3 of 4 units have ended").and(contains("not all rows are of the same sequences")),
    );
    let part = document(dir, &["top", "a"]);
    assert_eq!(part["notes"].as_array().unwrap().len(), 1);
    let complete = trackers(&part).iter().find(|t| t["sequences"] == 2).unwrap();
    let same = trackers(&whole)
        .iter()
        .find(|t| t["tracker"] == complete["tracker"])
        .unwrap();
    assert_eq!(complete["value"], same["value"]);
    fs::write(dir.join("a/journal.jsonl"), "").unwrap();
    program(dir)
        .args(["top", "a"])
        .assert()
        .code(4)
        .stderr(contains("no unit has ended"));
}

fn bars_are_for_terminals() {
    let place = two_runs();
    let dir = place.path();
    let bars = printed(dir, &["top", "a", "--color", "always"]);
    assert!(bars.contains("\x1b[36m█"), "{bars}");
    let plain = printed(dir, &["top", "a"]);
    assert!(!plain.contains('█') && !plain.contains('\x1b'));
    assert!(!printed(dir, &["top", "a", "--color", "always", "--format", "csv"]).contains('█'));
}

fn curves_of_several_runs_are_in_one_picture() {
    let place = two_runs();
    let dir = place.path();
    program(dir)
        .args(["plot", "a", "--out", "one.svg"])
        .assert()
        .success();
    let read = |file: &str| fs::read_to_string(dir.join(file)).unwrap();
    assert_eq!(read("one.svg"), read("a/success.svg"));
    program(dir)
        .args(["plot", "a", "b", "--out", "both.svg"])
        .assert()
        .success();
    for name in ["esm/ssd/translation (a)", "ialk/ncc/isometry (b)"] {
        assert!(read("both.svg").contains(name), "{name}");
    }
    program(dir)
        .args(["plot", "data", "--out", "none.svg"])
        .assert()
        .code(2);
    assert!(!dir.join("none.svg").exists());
}

fn rows_know_tags_and_speeds() {
    let place = two_runs();
    let dir = place.path();
    let read = |file: &str| table(&fs::read_to_string(dir.join("a").join(file)).unwrap());
    for row in read("sequences.csv") {
        let tags = if row["sequence"] == "seq0" {
            "near quick"
        } else {
            "quick"
        };
        assert_eq!(row["tags"], tags);
    }
    let timing = read("timing.csv");
    let (speeds, units): (Vec<_>, Vec<_>) = timing.into_iter().partition(|row| row["sequence"] == "pooled");
    assert_eq!((speeds.len(), units.len()), (2, 4));
    for row in speeds {
        let own = units.iter().filter(|t| t["tracker"] == row["tracker"]);
        let frames: u32 = own.map(|t| t["frames"].parse::<u32>().unwrap()).sum();
        assert_eq!(row["frames"].parse::<u32>().unwrap(), frames);
        let fps = |column: &str| row[column].parse::<f64>().unwrap();
        assert!(0.0 < fps("fps_with_input") && fps("fps_with_input") <= fps("fps"));
        assert_eq!(
            (row["dataset"].as_str(), row["comparable"].as_str()),
            ("all", "yes")
        );
    }
    let run: Value = serde_json::from_slice(&fs::read(dir.join("a/run.json")).unwrap()).unwrap();
    assert_eq!(run["sequences"][0]["tags"], serde_json::json!(["near", "quick"]));
}

fn merge(dir: &Path, args: &[&str]) -> assert_cmd::assert::Assert {
    program(dir).args(["merge", "--union", "-q"]).args(args).assert()
}

/// The rows of a table that do not depend on speed.
fn rows(dir: &Path, run: &str, file: &str) -> BTreeSet<String> {
    let text = fs::read_to_string(dir.join(run).join(file)).unwrap();
    text.lines().skip(1).map(str::to_owned).collect()
}

fn a_union_of_trackers_equals_a_run_of_both() {
    let place = two_runs();
    let dir = place.path();
    let few = "fclk/ssd/translation{max_iters=1}";
    let all = ["esm/ssd/translation", "iclk/ncc/affine", few, "ialk/ncc/isometry"];
    track(dir, "whole", &all.map(|t| ["--tracker", t]).concat());
    merge(dir, &["one", "a", "b"]).success();
    merge(dir, &["other", "b", "a", "a"]).success();
    assert_same(&dir.join("one"), &dir.join("other"));
    for file in [
        "summary.csv",
        "sequences.csv",
        "curves.csv",
        "success.svg",
        "truth.csv",
    ] {
        let bytes = |run: &str| fs::read(dir.join(run).join(file)).unwrap();
        assert_eq!(bytes("one"), bytes("whole"), "{file}");
    }
    program(dir)
        .args(["status", "one"])
        .assert()
        .success()
        .stdout(contains("complete"));
    program(dir)
        .args(["compare", "one", "whole"])
        .assert()
        .success()
        .stdout(contains("no difference"));
    // Once more, with what it has already.
    merge(dir, &["one", "b"]).success();
    assert_same(&dir.join("one"), &dir.join("other"));
}

fn a_union_keeps_data_and_protocols_apart() {
    let place = two_runs();
    let dir = place.path();
    write_data(&dir.join("more"), &[9]);
    program(dir)
        .args(["run", "more", "-q", "--frame-logs", "none", "--out", "c"])
        .args(["--tracker", "esm/ssd/translation", "--protocol", "subseq:2"])
        .assert()
        .success();
    merge(dir, &["all", "c", "a", "b"]).success();
    for file in ["sequences.csv", "summary.csv"] {
        let parts = ["a", "b", "c"].map(|run| rows(dir, run, file));
        let expected: BTreeSet<String> = parts.into_iter().flatten().collect();
        assert_eq!(rows(dir, "all", file), expected, "{file}");
    }
    let status = document(dir, &["status", "all"]);
    assert_eq!(
        (&status[0]["units"], &status[0]["missing"]),
        (&(4 + 4 + 2).into(), &0.into())
    );
    let top = document(dir, &["top", "all"]);
    assert_eq!(trackers(&top).len(), 5);
    // A union is a part of a union like any other run.
    track(dir, "d", &["--tracker", "esm/zncc/translation"]);
    merge(dir, &["more-yet", "d", "all"]).success();
    let expected: BTreeSet<String> = ["all", "d"]
        .iter()
        .flat_map(|run| rows(dir, run, "sequences.csv"))
        .collect();
    assert_eq!(rows(dir, "more-yet", "sequences.csv"), expected);
    program(dir).args(["status", "more-yet"]).assert().success();
}

fn a_union_refuses_what_differs() {
    let place = two_runs();
    let dir = place.path();
    track(dir, "seed", &["--tracker", "esm/zncc/translation", "--seed", "1"]);
    merge(dir, &["out", "a", "seed"])
        .code(11)
        .stderr(contains("seed 0 against 1"));
    track(
        dir,
        "short",
        &["--tracker", "esm/zncc/translation", "--max-frames", "5"],
    );
    merge(dir, &["out", "a", "short"])
        .code(11)
        .stderr(contains("short").and(contains("other frames or ground truth of data/seq0")));
    // The same unit with another result.
    track(dir, "forged", &["--tracker", "esm/ssd/translation"]);
    let journal = dir.join("forged/journal.jsonl");
    let lines = journal_lines(&fs::read(&journal).unwrap());
    let at = lines.iter().position(|l| l["sequence"] == "seq1").unwrap();
    let entries = lines.into_iter().enumerate().map(|(k, line)| {
        let mut entry: mtf_eval::store::journal::Entry = serde_json::from_value(line).unwrap();
        if k == at {
            let first = entry.errors.as_mut().and_then(|rows| rows[0].as_mut());
            first.unwrap()[0] = 3.5;
        }
        entry.to_line().unwrap()
    });
    fs::write(&journal, entries.collect::<Vec<_>>().concat()).unwrap();
    merge(dir, &["out", "a", "forged"])
        .code(11)
        .stderr(contains("another result of esm/ssd/translation on data/seq1"));
    // A run that has not ended.
    let journal = dir.join("b/journal.jsonl");
    let text = fs::read_to_string(&journal).unwrap();
    fs::write(&journal, text.lines().next().unwrap().to_owned() + "\n").unwrap();
    merge(dir, &["out", "a", "b"])
        .code(21)
        .stderr(contains("incomplete: 3 of 8 units"));
    assert!(!dir.join("out").exists());
}

fn lists_can_be_filtered() {
    let place = tempfile::tempdir().unwrap();
    let dir = place.path();
    let args = [
        "list", "trackers", "--sm", "esm,iclk", "--am", "ssd", "--ssm", "affine", "--ilm", "none",
    ];
    let text = printed(dir, &args);
    assert!(text.contains("\n2 valid single-layer trackers"), "{text}");
    assert!(text.contains("esm/ssd/affine") && !text.contains("ncc"), "{text}");
    let text = printed(
        dir,
        &[
            "list",
            "trackers",
            "--am",
            "ssd",
            "--ilm",
            "none",
            "--grep",
            "ICLK/SSD/aff",
        ],
    );
    assert!(
        is_match("\n1 of \\d+ trackers have the text")
            .unwrap()
            .eval(&text),
        "{text}"
    );
    let params = printed(dir, &["list", "params", "--sm", "pf"]);
    assert!(
        params.contains("sm.pf.n_particles") && !params.contains("sm.esm."),
        "{params}"
    );
    let models = printed(dir, &["list", "am", "--grep", "mutual"]);
    assert!(models.contains("mi") && !models.contains("ssd "), "{models}");
    program(dir)
        .args(["list", "am", "--grep", "nosuchword"])
        .assert()
        .code(4);
    program(dir)
        .args(["list", "data", "--sm", "esm"])
        .assert()
        .code(2)
        .stderr(contains("--sm is for `list trackers`"));
    program(dir)
        .args(["list", "trackers", "--sm", "nosuch"])
        .assert()
        .code(2);
}

fn a_tag_that_is_not_there_is_an_error_with_those_that_are() {
    let place = tagged_data();
    let dir = place.path();
    program(dir)
        .args(["run", "data", "--tag", "quik", "--out", "x"])
        .assert()
        .code(4)
        .stderr(
            contains("--tag quik: no sequence has this tag; did you mean 'quick'?")
                .and(contains("near (1), quick (2)")),
        );
    // Beside one that is there, too.
    program(dir)
        .args(["run", "data", "--tag", "near,nosuch", "--out", "x"])
        .assert()
        .code(4)
        .stderr(contains("--tag nosuch").and(contains("quick (2)")));
    write_data(&dir.join("bare"), &[5]);
    program(dir)
        .args(["run", "bare", "--tag", "quick", "--out", "x"])
        .assert()
        .code(4)
        .stderr(contains("nor any other").and(contains("tags.txt")));
    assert!(!dir.join("x").exists());
}
