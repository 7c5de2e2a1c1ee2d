//! What the program says of itself: help that fits a screen, numbers with their units, words that are explained, JSON.

use crate::runs::{program, write_data};
use predicates::str::contains;
use serde_json::Value;
use std::fs;

crate::tests! {
    short_help_is_one_screen;
    help_explains_its_words;
    every_format_says_what_it_prints;
    json_is_one_line_unless_indented;
    the_readme_goes_from_what_to_links;
    pages_explain_their_words;
}

/// Lines of a screen, and columns of a terminal that is wide enough for help.
const SCREEN: (usize, usize) = (45, 100);

/// Every command, as it is typed.
fn commands() -> Vec<String> {
    let help = help("", "-h");
    let (_, list) = help.split_once("Commands:\n").unwrap();
    let (list, _) = list.split_once("\n\n").unwrap();
    let names = list.lines().filter_map(|line| line.strip_prefix("  "));
    let mut names: Vec<String> = names
        .filter(|line| !line.starts_with(' '))
        .map(|line| line.split(' ').next().unwrap().to_owned())
        .filter(|name| name != "help")
        .collect();
    assert!(names.len() > 10, "{names:?}");
    names.extend(["data info", "data check"].map(str::to_owned));
    names
}

fn help(command: &str, flag: &str) -> String {
    let dir = tempfile::tempdir().unwrap();
    let mut program = program(dir.path());
    let words = command.split_whitespace().chain([flag]);
    let output = program.env_remove("COLUMNS").args(words).output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap()
}

fn short_help_is_one_screen() {
    for command in commands() {
        let (short, long) = (help(&command, "-h"), help(&command, "--help"));
        let widest = short.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(
            short.lines().count() <= SCREEN.0 && widest <= SCREEN.1,
            "{command}:\n{short}"
        );
        assert!(long.lines().count() > short.lines().count(), "{command}");
    }
    let (short, long) = (help("run", "-h"), help("run", "--help"));
    for (flag, common) in [
        ("--tracker", true),
        ("--tag", true),
        ("--depth16", false),
        ("--epsilon", false),
    ] {
        assert_eq!(short.contains(flag), common, "{flag}:\n{short}");
        assert!(long.contains(flag), "{flag}");
    }
    assert!(long.contains("--epsilon <PX²>"), "{long}");
}

/// Words of this project's own with what has to stand beside them.
const GLOSSES: [(&str, &[&str]); 3] = [
    ("unit", &["one tracker on one sequence"]),
    ("figure", &["numbers", "number of", "columns of the table"]),
    ("course", &["anew"]),
];

/// Whether `text` has `word`, or several of it.
fn has(text: &str, word: &str) -> bool {
    let mut words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
    words.any(|w| w == word || w.strip_suffix('s') == Some(word))
}

fn help_explains_its_words() {
    for command in commands() {
        for flag in ["-h", "--help"] {
            let text = help(&command, flag);
            let plain = text.split_whitespace().collect::<Vec<_>>().join(" ");
            for (word, glosses) in GLOSSES {
                let told = !has(&plain, word) || glosses.iter().any(|gloss| plain.contains(gloss));
                assert!(told, "{command} {flag}: {word}\n{text}");
            }
        }
    }
}

fn every_format_says_what_it_prints() {
    for command in commands().iter().filter(|c| *c != "synth") {
        let text = help(command, "-h");
        let Some((_, format)) = text.split_once("--format <FORM") else {
            continue;
        };
        let format = format
            .split("\n      --")
            .next()
            .unwrap()
            .split_whitespace()
            .collect::<Vec<_>>()
            .join(" ");
        assert!(
            format.contains("row per") || format.contains("rows of") || format.contains("totals"),
            "{command}: {format}"
        );
    }
}

fn json_is_one_line_unless_indented() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[5]);
    let run = "run data -q --frame-logs none --res 20x20 --out out";
    program(dir).args(run.split(' ')).assert().success();
    for words in [
        run,
        "list sm",
        "list",
        "plan data",
        "status out",
        "data info data",
        "diagnose --am ssd --ssm 2",
    ] {
        let output = |more: &[&str]| {
            let words = words
                .split(' ')
                .chain(["--format", "json"])
                .chain(more.iter().copied());
            let output = program(dir).args(words).output().unwrap();
            assert!(
                output.status.success(),
                "{}",
                String::from_utf8_lossy(&output.stderr)
            );
            String::from_utf8(output.stdout).unwrap()
        };
        let (line, indented) = (output(&[]), output(&["--pretty"]));
        assert_eq!(line.lines().count(), 1, "{words}: {line}");
        assert!(indented.lines().count() > 3, "{words}: {indented}");
        let read = |text: &str| serde_json::from_str::<Value>(text).unwrap();
        assert_eq!(read(&line), read(&indented), "{words}");
    }
    program(dir)
        .args(["run", "--format", "xml"])
        .assert()
        .code(2)
        .stderr(contains("json"));
}

fn root(path: &str) -> String {
    fs::read_to_string(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

fn the_readme_goes_from_what_to_links() {
    let readme = root("README.md");
    let at = |part: &str| readme.find(part).unwrap_or_else(|| panic!("{part}"));
    let parts = [
        "Evaluates **registration-based trackers**",
        "docs/tracked.png",
        "    cargo run --release -- run\n    cargo test\n",
        "## Your own data",
        "## Reading a table",
        "## Read on",
    ];
    assert!(parts.map(at).is_sorted(), "{parts:?}");
}

fn pages_explain_their_words() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let pages = fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap());
    let pages = pages
        .filter(|name| name.ends_with(".md"))
        .map(|name| format!("docs/{name}"));
    // Pages for those who change the program, and one whose tables have a column of units.
    let internal = ["docs/architecture.md", "docs/extending.md", "docs/trackers.md"];
    for page in pages
        .chain(["README.md".to_owned()])
        .filter(|page| !internal.contains(&page.as_str()))
    {
        let text = root(&page).split_whitespace().collect::<Vec<_>>().join(" ");
        let (word, glosses) = ("figure", GLOSSES[1].1);
        let told = |word, glosses: &[&str]| !has(&text, word) || glosses.iter().any(|g| text.contains(g));
        assert!(
            told(word, &[glosses, &["AUC and the like"]].concat()),
            "{page}: {word}"
        );
        // `unit` is a unit of measurement here.
        if page != "docs/metrics.md" {
            assert!(told("unit", GLOSSES[0].1) || page == "docs/ci.md", "{page}: unit");
        }
    }
}
