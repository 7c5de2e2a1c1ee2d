//! Figures of the embedded dataset in documents: they are what the program prints. `MTF_EVAL_UPDATE=1` writes them again.

use crate::runs::program;
use mtf_eval::dataset;
use mtf_eval::synth::{Recipe, builtin_recipes, builtin_spec};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

crate::tests! {
    documents_and_their_plot_show_what_quick_gives;
    the_list_of_sequences_is_complete_and_has_what_the_default_run_gives;
}

/// What a newcomer may have heard of, from every family.
const KNOWN: [&str; 9] = [
    "best",
    "feature",
    "flow",
    "nn/ssd/homography",
    "pf/ssd/homography",
    "esm/ncc/homography",
    "esm/ssd/homography",
    "iclk/ssd/homography",
    "esm/ssd/affine",
];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn updating() -> bool {
    std::env::var_os("MTF_EVAL_UPDATE").is_some()
}

/// Holds `text` against what stands between `<!-- figures NAME -->` and `<!-- end figures -->` of a document.
fn hold(file: &str, name: &str, text: &str) {
    let path = root().join(file);
    let page = fs::read_to_string(&path).unwrap();
    let (begin, end) = (format!("<!-- figures {name} -->\n"), "<!-- end figures -->");
    let from = page.find(&begin).expect(name) + begin.len();
    let to = from + page[from..].find(end).expect(name);
    let mut fresh = page.clone();
    fresh.replace_range(from..to, &format!("\n{text}\n"));
    same(&path, &page, &fresh);
}

/// `fresh` is what the file at `path`, which holds `kept`, should hold.
fn same(path: &Path, kept: &str, fresh: &str) {
    if fresh != kept && updating() {
        fs::write(path, fresh).unwrap();
    } else {
        assert!(
            fresh == kept,
            "{} is stale: run the test with MTF_EVAL_UPDATE=1",
            path.display()
        );
    }
}

/// The rows of a table that a run wrote, by name of the column.
fn rows(path: &Path) -> Vec<std::collections::HashMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.deserialize().map(Result::unwrap).collect()
}

/// A number of a table with so many places.
fn places(text: &str, digits: usize) -> String {
    text.parse::<f64>()
        .map_or_else(|_| String::new(), |v| format!("{v:.digits$}"))
}

fn documents_and_their_plot_show_what_quick_gives() {
    let dir = tempfile::tempdir().unwrap();
    let mut run = program(dir.path());
    run.args(["run", "--tag", "quick", "-q", "--frame-logs", "none", "-o", "out"]);
    KNOWN.iter().for_each(|id| {
        run.args(["--tracker", id]);
    });
    run.assert().success();
    let mut summary = rows(&dir.path().join("out/summary.csv"));
    summary.retain(|row| row["average"] == "pooled");
    assert_eq!(summary.len(), KNOWN.len());
    let mut text = "| tracker | SR@5 | AUC | AL median, px | failures |\n|---|--:|--:|--:|--:|\n".to_owned();
    for row in &summary {
        let [sr, auc, median] = [("sr_5", 3), ("auc", 3), ("al_median", 2)].map(|(c, n)| places(&row[c], n));
        let _ = writeln!(
            text,
            "| `{}` | {sr} | {auc} | {median} | {} |",
            row["tracker"], row["failures"]
        );
    }
    hold("README.md", "quick", &text);
    let plot = root().join("docs/success.svg");
    let (kept, fresh) = (
        fs::read_to_string(&plot).unwrap_or_default(),
        fs::read_to_string(dir.path().join("out/success.svg")).unwrap(),
    );
    same(&plot, &kept, &fresh);
}

fn the_list_of_sequences_is_complete_and_has_what_the_default_run_gives() {
    let dir = tempfile::tempdir().unwrap();
    let words = [
        "run",
        "--am",
        "ssd,ncc",
        "-q",
        "--frame-logs",
        "none",
        "-o",
        "out",
    ];
    program(dir.path()).args(words).assert().success();
    let sequences = rows(&dir.path().join("out/sequences.csv"));
    let auc = |tracker: &str, sequence: &str| {
        let is = |r: &&std::collections::HashMap<String, String>| {
            r["tracker"] == tracker && r["sequence"] == sequence
        };
        places(&sequences.iter().find(is).expect(sequence)["auc"], 2)
    };
    let mut text = "| sequence | object | motion | px per frame | tags | `esm/ssd/homography` | `esm/ncc/homography` |\n\
                    |---|---|---|--:|---|--:|--:|\n"
        .to_owned();
    let data = dataset::builtin().unwrap();
    for (name, recipe) in builtin_recipes().unwrap() {
        let of = match &recipe {
            Recipe::Rendered(_) => &name,
            Recipe::Selected(selection) => &selection.of,
        };
        let spec = builtin_spec(of).unwrap();
        let sequence = data.sequences.iter().find(|s| s.name() == name).unwrap();
        let moved = |i: usize| {
            let (a, b) = (sequence.truth(i - 1)?, sequence.truth(i)?);
            let far =
                a.0.iter()
                    .zip(&b.0)
                    .map(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]));
            Some(far.sum::<f64>() / 4.0)
        };
        let steps: Vec<f64> = (1..sequence.len()).filter_map(moved).collect();
        let speed = steps.iter().sum::<f64>() / steps.len() as f64;
        let object = spec
            .command("")
            .split(' ')
            .skip_while(|w| *w != "--texture")
            .nth(1)
            .unwrap()
            .to_owned();
        let _ = writeln!(
            text,
            "| `{name}` | {object} | {} | {speed:.1} | {} | {} | {} |",
            spec.model.name(),
            recipe.tags().join(", "),
            auc("esm/ssd/homography", &name),
            auc("esm/ncc/homography", &name),
        );
    }
    hold("datasets/README.md", "sequences", &text);
}
