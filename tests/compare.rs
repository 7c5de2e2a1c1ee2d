//! `compare` and the reports of `check`, from outside.

use crate::runs::{program, write_data};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

crate::tests! {
    finds_the_tracker_that_changed;
    figures_are_those_of_the_tables;
    a_run_of_the_reference_alone_is_compared_with_another;
    trackers_with_other_settings_are_paired;
    the_gate_names_other_settings_in_one_line;
    refuses_what_does_not_compare;
    all_trackers_are_ranked_in_groups;
    warns_of_few_sequences;
    the_gate_reports_to_ci_services;
    the_page_on_ci_works_as_written;
}

/// Twelve short sequences.
fn with_data() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_data(&dir.path().join("data"), &[5; 12]);
    dir
}

fn run(dir: &Path, out: &str, more: &[&str]) {
    program(dir)
        .args([
            "run",
            "data",
            "-q",
            "--frame-logs",
            "none",
            "--res",
            "20x20",
            "--out",
            out,
        ])
        .args(more)
        .assert()
        .success();
}

fn json(dir: &Path, args: &[&str]) -> Value {
    let output = program(dir)
        .arg("compare")
        .args(args)
        .args(["--format", "json"])
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

fn finds_the_tracker_that_changed() {
    let dir = with_data();
    let dir = dir.path();
    let trackers = ["--sm", "esm,iclk,pf", "--set", "pf.n_particles=40"];
    run(dir, "a", &trackers);
    run(dir, "again", &trackers);
    run(dir, "b", &[&trackers[..], &["--seed", "1"]].concat());
    program(dir)
        .args(["compare", "a", "again"])
        .assert()
        .success()
        .stdout(contains(
            "no difference: 36 units (one tracker on one sequence each) of 3 trackers equal",
        ));
    let found = json(dir, &["a", "b"]);
    let found = &found["comparisons"][0];
    assert_eq!((&found["units"], &found["trackers"]), (&36.into(), &3.into()));
    let changed = found["changed"].as_array().unwrap();
    assert_eq!(changed.len(), 1, "{changed:?}");
    assert_eq!(
        changed[0]["tracker"],
        "pf/ssd/homography{n_particles=40,res=20x20}"
    );
    assert_eq!(changed[0]["figures"][0]["figure"], "auc");
    assert_eq!(found["settings"][0], "seed: 0 -> 1");
    let table = program(dir)
        .args(["compare", "a", "b", "again"])
        .output()
        .unwrap();
    let table = String::from_utf8(table.stdout).unwrap();
    for text in [
        "95 % interval",
        "sr_5",
        "al_mean",
        "1 of 3 trackers changed",
        "no difference",
    ] {
        assert!(table.contains(text), "{text}: {table}");
    }
    program(dir)
        .args(["compare", "a", "b", "--format", "csv", "--figures", "auc"])
        .assert()
        .success()
        .stdout(contains("a,b,reference,tracker,figure,").and(contains("a,b,,\"pf/ssd/")));
    program(dir)
        .args(["compare", "a", "b", "--format", "md"])
        .assert()
        .success()
        .stdout(contains("| tracker"));
    // Trackers of one run against one of them.
    let found = json(dir, &["a", "--reference", "esm/ssd/homography{res=20x20}"]);
    assert_eq!(found["comparisons"][0]["trackers"], 2);
}

fn figures_are_those_of_the_tables() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[9, 7, 12]);
    // Failures from 4 px on: trackers differ in the number of their frames.
    let protocols = "ope,subseq:2,reinit:4:1,every:2";
    for (out, seed) in [("a", "0"), ("b", "1")] {
        let pf = [
            "--sm",
            "pf",
            "--set",
            "pf.n_particles=40",
            "--protocol",
            protocols,
        ];
        run(dir, out, &[&pf[..], &["--seed", seed]].concat());
    }
    let aggregates = |run: &str| -> Vec<Value> {
        let text = fs::read_to_string(dir.join(run).join("summary.json")).unwrap();
        let summary: Value = serde_json::from_str(&text).unwrap();
        summary["trackers"][0]["aggregates"].as_array().unwrap().clone()
    };
    let tables = [aggregates("a"), aggregates("b")];
    let names = "auc,sr_1,sr_2,sr_5,sr_10,sr_20,sr_area,al_mean,mcd_mean,cl_mean,jaccard_mean";
    for average in ["pooled", "seq_mean"] {
        let found = json(dir, &["a", "b", "--average", average, "--figures", names]);
        let changed = found["comparisons"][0]["changed"].as_array().unwrap();
        assert_eq!(changed.len(), 4, "{changed:?}");
        for change in changed {
            let of = |table: &[Value]| -> Value {
                let mut rows = table.iter();
                let wanted = |r: &&Value| r["protocol"] == change["protocol"] && r["average"] == average;
                rows.find(wanted).unwrap().clone()
            };
            let [a, b] = [of(&tables[0]), of(&tables[1])];
            if change["protocol"] == "reinit:4:1" {
                assert_ne!((&a["frames"], &a["failures"]), (&b["frames"], &b["failures"]));
            }
            for figure in change["figures"].as_array().unwrap() {
                let name = figure["figure"].as_str().unwrap();
                assert_eq!(
                    (&figure["a"], &figure["b"]),
                    (&a[name], &b[name]),
                    "{average} {name} {change}"
                );
            }
        }
    }
    program(dir)
        .args(["compare", "a", "b"])
        .assert()
        .success()
        .stdout(contains(
            "1 of 1 tracker changed (4 of 4 with each protocol apart), in ",
        ));
}

fn a_run_of_the_reference_alone_is_compared_with_another() {
    let dir = with_data();
    let dir = dir.path();
    run(dir, "a", &["--sm", "esm", "--seq", "seq[0-3]"]);
    run(dir, "b", &["--sm", "iclk,fclk", "--seq", "seq[0-3]"]);
    let id = |sm: &str| format!("{sm}/ssd/homography{{res=20x20}}");
    let found = json(dir, &["a", "b", "--reference", &id("esm")]);
    let found = found["comparisons"].as_array().unwrap();
    assert_eq!(found.len(), 1);
    assert_eq!((&found[0]["b"], &found[0]["trackers"]), (&"b".into(), &2.into()));
    // Several, one of them of the second run.
    let several = ["a", "b", "--reference", &id("esm"), "--reference", &id("iclk")];
    let found = json(dir, &several);
    let found = found["comparisons"].as_array().unwrap();
    let sides: Vec<_> = found
        .iter()
        .map(|c| (c["reference"].clone(), c["b"].clone(), c["trackers"].clone()))
        .collect();
    let side = |sm: &str, b: &str, n: usize| (id(sm).into(), b.into(), n.into());
    assert_eq!(
        sides,
        [side("esm", "b", 2), side("iclk", "a", 1), side("iclk", "b", 1)]
    );
}

fn trackers_with_other_settings_are_paired() {
    let dir = with_data();
    let dir = dir.path();
    run(dir, "a", &["--sm", "esm,iclk", "--seq", "seq[0-3]"]);
    let more = ["--sm", "esm,iclk", "--seq", "seq[0-3]", "--set", "max_iters=1"];
    run(dir, "b", &more);
    program(dir).args(["compare", "a", "b"]).assert().success().stdout(
        contains("parameters of esm/ssd/homography{res=20x20}, iclk/ssd/homography{res=20x20}: max_iters: default -> 1")
            .and(contains("of 2 trackers changed"))
            .and(contains("only in").not()),
    );
}

fn the_gate_names_other_settings_in_one_line() {
    let dir = with_data();
    let dir = dir.path();
    run(dir, "a", &["--sm", "esm,iclk", "--seq", "seq[0-3]"]);
    let set = [
        "--sm",
        "esm,iclk",
        "--seq",
        "seq[0-3]",
        "--set",
        "iclk.max_iters=1",
    ];
    run(dir, "b", &set);
    let check = |args: &[&str]| {
        let mut command = program(dir);
        command.args(["check", "--baseline", "baseline.json"]).args(args);
        command.assert()
    };
    check(&["a"]).code(2).stderr(contains(
        "mtf-eval check a --baseline baseline.json --update-baseline records it",
    ));
    check(&["a", "--update-baseline"])
        .success()
        .stderr(contains("success rates and AUCs are as good as 1"));
    check(&["a", "--exact"])
        .success()
        .stdout(contains("exact: no difference passes"));
    check(&["b", "--junit", "junit.xml"]).code(21).stdout(
        contains("other settings: iclk/ssd/homography{res=20x20} ran with max_iters: default -> 1; --update-baseline")
            .and(contains("missing:").not())
            .and(contains("not in the baseline").not()),
    );
    let xml = fs::read_to_string(dir.join("junit.xml")).unwrap();
    assert!(
        xml.contains("run with other settings, max_iters: default -&gt; 1"),
        "{xml}"
    );
    check(&["a", "--tol-sr5", "two"]).code(2).stderr(contains("2%"));
    check(&["a", "--tol-sr5", "2%"])
        .success()
        .stdout(contains("sr_5 2%"));
}

fn refuses_what_does_not_compare() {
    let dir = with_data();
    let dir = dir.path();
    run(dir, "a", &[]);
    run(dir, "short", &["--max-frames", "4"]);
    run(dir, "other", &["--sm", "iclk"]);
    run(dir, "fitted", &["--gt-ssm", "translation"]);
    for (other, reason) in [
        ("short", "fingerprint"),
        ("fitted", "fingerprint"),
        ("other", "no tracker in common"),
    ] {
        program(dir)
            .args(["compare", "a", other])
            .assert()
            .code(11)
            .stderr(contains("not comparable").and(contains(reason)));
    }
    for (args, reason) in [
        (&["compare", "a"][..], "give two runs"),
        (&["compare", "a", "nowhere"], "not a run directory"),
        (
            &["compare", "a", "other", "--figures", "al_median"],
            "no mean over frames",
        ),
        (&["compare", "a", "other", "--fdr", "2"], "between 0 and 1"),
        (
            &["compare", "a", "other", "--reference", "esm/ssd/homograph"],
            "did you mean",
        ),
    ] {
        program(dir).args(args).assert().code(2).stderr(contains(reason));
    }
}

fn warns_of_few_sequences() {
    let dir = with_data();
    let dir = dir.path();
    for (out, seed) in [("a", "0"), ("b", "1")] {
        run(
            dir,
            out,
            &[
                "--sm",
                "pf",
                "--set",
                "pf.n_particles=40",
                "--seq",
                "seq[0-3]",
                "--seed",
                seed,
            ],
        );
    }
    program(dir)
        .args(["compare", "a", "b"])
        .assert()
        .success()
        .stdout(contains("~"))
        .stderr(contains("only 4 sequences").and(contains("nothing can be significant")));
}

fn the_gate_reports_to_ci_services() {
    let dir = with_data();
    let dir = dir.path();
    run(dir, "a", &["--sm", "esm,iclk", "--seq", "seq[0-1]"]);
    let check = |args: &[&str]| {
        let mut command = program(dir);
        command
            .args(["check", "a", "--baseline", "baseline.json"])
            .args(args);
        command.env("GITHUB_STEP_SUMMARY", dir.join("step.md"));
        command.assert()
    };
    check(&["--update-baseline"])
        .success()
        .stdout(contains("recorded 6 lines"));
    check(&["--junit", "junit.xml", "--summary-md", "summary.md"]).success();
    let read = |name: &str| fs::read_to_string(dir.join(name)).unwrap();
    let xml = read("junit.xml");
    assert!(
        xml.contains(r#"tests="6" skipped="0" failures="0" errors="0""#),
        "{xml}"
    );
    assert!(
        read("summary.md").starts_with("### ✅ mtf-eval check passed"),
        "{}",
        read("summary.md")
    );
    // A baseline that was better on one sequence.
    let worse = read("baseline.json").replacen(
        r#""sequence":"seq1","start":0,"protocol":"ope","frames":4,"sr_5":1.0"#,
        r#""sequence":"seq1","start":0,"protocol":"ope","frames":4,"sr_5":1.5"#,
        1,
    );
    fs::write(dir.join("baseline.json"), worse).unwrap();
    let reports = [
        "--junit",
        "junit.xml",
        "--summary-md",
        "summary.md",
        "--code-quality",
        "quality.json",
    ];
    check(&reports).code(10);
    let (xml, summary) = (read("junit.xml"), read("summary.md"));
    // Times of all cases, frames of the one that failed.
    let cases = xml.lines().filter(|line| line.contains("<testcase name=\"data/"));
    assert!(
        cases.clone().count() == 4 && cases.clone().all(|case| case.contains(" time=\"")),
        "{xml}"
    );
    assert!(
        xml.contains("no frame above 5 px; worst frames: ") && xml.contains(" px)"),
        "{xml}"
    );
    let issues: Value = serde_json::from_str(&read("quality.json")).unwrap();
    let [issue] = issues.as_array().unwrap().as_slice() else {
        panic!("{issues}")
    };
    assert_eq!(
        (&issue["check_name"], &issue["severity"]),
        (&"mtf-eval/drop".into(), &"major".into())
    );
    assert_eq!(issue["location"]["path"], "baseline.json");
    let line = issue["location"]["lines"]["begin"].as_u64().unwrap() as usize;
    assert!(
        read("baseline.json")
            .lines()
            .nth(line - 1)
            .unwrap()
            .contains("\"seq1\"")
    );
    assert!(
        issue["description"]
            .as_str()
            .unwrap()
            .contains("sr_5 1.5000 -> 1.0000")
    );
    assert_eq!(issue["fingerprint"].as_str().unwrap().len(), 64);
    assert!(
        xml.contains(r#"failures="1""#) && xml.contains("sr_5 1.5000 -&gt; 1.0000 (tolerance 0.01)"),
        "{xml}"
    );
    assert!(
        summary.starts_with("### ❌") && summary.contains("| esm/ssd/homography"),
        "{summary}"
    );
    // Both summaries were appended to the page of the run, after that of the recording.
    let page = read("step.md");
    assert!(
        page.contains("recorded 6 lines") && page.contains("✅") && page.ends_with(&format!("{summary}\n")),
        "{page}"
    );
    fs::write(
        dir.join("check.toml"),
        "[[override]]\ntracker = \"esm/*\"\nsequence = \"seq1\"\nsr_5 = 0.5\n",
    )
    .unwrap();
    check(&[]).success().stdout(contains("1 override"));
    // Updating says what changes.
    check(&["--update-baseline"]).success().stdout(
        contains("1.5000")
            .and(contains("-0.5000"))
            .and(contains("updated; 1 worse")),
    );
}

fn all_trackers_are_ranked_in_groups() {
    let dir = with_data();
    let dir = dir.path();
    run(dir, "a", &["--sm", "esm,iclk"]);
    run(dir, "b", &["--sm", "fclk", "--set", "max_iters=1"]);
    let compared = program(dir)
        .args(["compare", "a", "b", "--all-pairs"])
        .assert()
        .success();
    compared.stdout(
        contains("mean rank")
            .and(contains("groups"))
            .and(contains("3 of 3 trackers over 12 sequences, protocol ope"))
            .and(contains("trackers that share a letter do not differ: "))
            .and(contains("(Friedman)")),
    );
    let found = json(dir, &["a", "b", "--all-pairs", "--figures", "al_mean"]);
    let ranking = &found["rankings"][0];
    let trackers = ranking["trackers"].as_array().unwrap();
    assert_eq!(
        (trackers.len(), ranking["pairs"].as_array().unwrap().len()),
        (3, 3)
    );
    let ranks = trackers.iter().map(|t| t["mean_rank"].as_f64().unwrap());
    let ranks: Vec<f64> = ranks.collect();
    assert!(
        ranks.is_sorted() && (ranks.iter().sum::<f64>() - 6.0).abs() < 1e-9,
        "{ranks:?}"
    );
    for pair in ranking["pairs"].as_array().unwrap() {
        let [a, b] = ["a", "b"].map(|k| {
            trackers[pair[k].as_u64().unwrap() as usize]["groups"]
                .as_str()
                .unwrap()
        });
        let differ = pair["p_holm"].as_f64().unwrap() <= 0.05;
        assert_eq!(differ, !a.chars().any(|letter| b.contains(letter)), "{ranking:#}");
    }
    // Too few sequences to tell anything apart.
    run(dir, "few", &["--sm", "esm,iclk", "--seq", "seq[0-3]"]);
    let few = program(dir)
        .args(["compare", "few", "--all-pairs"])
        .assert()
        .success();
    few.stderr(contains("no two trackers can differ: take more sequences"));
    let alone = program(dir)
        .args(["compare", "b", "--all-pairs"])
        .assert()
        .code(11);
    alone.stderr(contains("no two trackers under one protocol"));
}

/// The commands of docs/ci.md, in their order, as they stand there.
fn the_page_on_ci_works_as_written() {
    let page = include_str!("../docs/ci.md");
    let dir = tempfile::tempdir().unwrap();
    let commands: Vec<&str> = page
        .lines()
        .filter_map(|l| l.strip_prefix("    mtf-eval "))
        .collect();
    assert!(commands.len() >= 5, "{commands:?}");
    for command in commands {
        let words = command.split_whitespace();
        let ended = program(dir.path()).args(words).arg("-q").assert();
        // Whether a limit of time holds is up to the machine.
        if command.starts_with("bench ") {
            ended.code(predicates::ord::eq(0).or(predicates::ord::eq(10)));
        } else {
            ended.success();
        }
    }
    let tolerances = page
        .split("```toml\n")
        .nth(1)
        .and_then(|t| t.split("```").next())
        .unwrap();
    fs::write(dir.path().join("check.toml"), tolerances).unwrap();
    program(dir.path())
        .args(["check", "results/now", "--baseline", "baseline.json"])
        .assert()
        .success()
        .stdout(contains("2 overrides"));
}
