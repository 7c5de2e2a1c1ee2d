//! Names and settings as published: what the page says of them is what the registry has.

use crate::runs::program;
use mtf::ilm::IlmEntry;
use mtf::registry::Registry;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

crate::tests! {
    the_page_shows_names_and_values;
    a_switch_selects_the_published_values;
}

/// Each short name, what it stands for, and where the paper has it.
fn names(registry: &Registry) -> String {
    let mut text = "| name | stands for | in the paper |\n|---|---|---|\n".to_owned();
    for e in registry.short() {
        let whole = e.text("AM", IlmEntry::NONE.name, "SSM");
        let other = registry.parse(e.name) != registry.parse(&format!("{}{{paper=1}}", e.name));
        let place = match (e.published, other) {
            (None, _) => "no".to_owned(),
            (Some(place), true) => format!("{place}, with `paper=1`"),
            (Some(place), false) => place.to_owned(),
        };
        let _ = writeln!(text, "| `{}` | `{whole}` | {place} |", e.name);
    }
    text
}

/// Each published value that is not the default. Methods that share a parameter share a row.
fn values(registry: &Registry) -> String {
    let mut text = "| parameter | of | default | paper | why |\n|---|---|--:|--:|---|\n".to_owned();
    let mut rows: Vec<([String; 4], Vec<&str>)> = Vec::new();
    for (_, of, info) in registry.params() {
        let Some(paper) = &info.paper else { continue };
        let row = [info.name, &info.default, &paper.value, paper.why].map(str::to_owned);
        match rows.iter_mut().find(|(r, _)| *r == row) {
            Some((_, names)) => names.push(of),
            None => rows.push((row, vec![of])),
        }
    }
    for ([name, default, paper, why], of) in rows {
        let of: Vec<String> = of.iter().map(|n| format!("`{n}`")).collect();
        let _ = writeln!(
            text,
            "| `{name}` | {} | {default} | {paper} | {why} |",
            of.join(", ")
        );
    }
    text
}

fn the_page_shows_names_and_values() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/trackers.md");
    let page = fs::read_to_string(&path).unwrap();
    let registry = Registry::builtin();
    let mut fresh = page.clone();
    for (what, table) in [("names", names(&registry)), ("values", values(&registry))] {
        let (begin, end) = (
            format!("<!-- table {what} -->\n"),
            format!("<!-- end table {what} -->"),
        );
        let from = fresh.find(&begin).expect(what) + begin.len();
        let to = fresh.find(&end).expect(what);
        fresh.replace_range(from..to, &format!("\n{table}\n"));
    }
    if fresh != page && std::env::var_os("MTF_EVAL_UPDATE").is_some() {
        fs::write(&path, &fresh).unwrap();
    } else {
        assert!(
            fresh == page,
            "docs/trackers.md is stale: run the test with MTF_EVAL_UPDATE=1"
        );
    }
}

fn a_switch_selects_the_published_values() {
    let dir = tempfile::tempdir().unwrap();
    let run = |words: &str| {
        let mut command = program(dir.path());
        command.args([
            "run",
            "--seq",
            "plain-page",
            "--max-frames",
            "2",
            "-q",
            "--force",
            "--out",
            "out",
        ]);
        command.args(["--format", "csv"]).args(words.split(' '));
        command.assert().success()
    };
    run("--paper --sm esm,nn --am riu,mi --set nn.n_samples=50").stdout(
        contains("esm/riu/homography{kappa=1}")
            .and(contains("esm/mi/homography{centred=0}"))
            .and(contains("max_iters=1,n_samples=50")),
    );
    run("--paper --set kappa=7 --sm esm --am riu").stdout(contains("{kappa=7}"));
    program(dir.path())
        .args(["list", "params"])
        .assert()
        .success()
        .stdout(contains("am.riu.kappa").and(contains("paper")));
    program(dir.path())
        .args(["list", "sm"])
        .assert()
        .success()
        .stdout(contains("algorithm 8").and(contains("grid(iclk/AM/translation{res=25x25}")));
}
