//! Names that leave the program: whatever characters folders and arguments have, they are text where they are shown.

use crate::runs::{program, write_data};
use std::fs;
use std::path::Path;
use std::process::Output;

crate::tests! {
    no_control_character_reaches_a_terminal;
    names_are_text_in_markdown;
    names_are_no_formulas_in_csv;
}

/// Moves a cursor, turns the direction of writing, ends a line.
const WILD: &str = "s\x1b[31m\u{202e}x\u{9b}\u{7}\ny";

/// Folder `data` with `seq0` called `name`.
fn data(root: &Path, name: &str) {
    write_data(&root.join("data"), &[3]);
    fs::rename(root.join("data/seq0"), root.join("data").join(name)).unwrap();
    fs::rename(root.join("data/seq0.txt"), root.join(format!("data/{name}.txt"))).unwrap();
}

fn go(root: &Path, words: &str) -> Output {
    let mut command = program(root);
    command.env("GITHUB_STEP_SUMMARY", root.join("page.md"));
    command.args(words.split(' ')).output().unwrap()
}

/// Both streams.
fn said(output: &Output) -> String {
    let text = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8(text).expect("UTF-8")
}

fn no_control_character_reaches_a_terminal() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    data(root, WILD);
    assert!(go(root, "run data -o run").status.success());
    assert!(
        go(root, "check run --baseline base.json --update-baseline")
            .status
            .success()
    );
    let base = fs::read_to_string(root.join("base.json")).unwrap();
    fs::write(
        root.join("base.json"),
        base.replace("\"sr_5\":1.0", "\"sr_5\":1.5"),
    )
    .unwrap();
    // Recorded twice: under another name the sequence is missing.
    let more = base.replace("x\u{9b}", "z\u{9b}");
    fs::write(root.join("more.json"), more).unwrap();
    fs::write(root.join(format!("data/{WILD}/meta.json")), "{").unwrap();
    let mut seen = String::new();
    for words in [
        "list data --data data",
        "list data --data data --format csv",
        "data info data",
        "data check data",
        "check run --baseline base.json",
        "check run --baseline more.json",
        "run data -o run2 -vv --color always",
        "run data --seq none",
        "compare run run2",
        "status run",
        "plan data",
    ] {
        let output = go(root, words);
        let mut text = said(&output);
        if words.contains("always") {
            for colour in ["\x1b[1m", "\x1b[1;33m", "\x1b[0m"] {
                text = text.replace(colour, "");
            }
        }
        let hidden = |c: char| c.is_control() && c != '\n' && c != '\t' || c == '\u{202e}';
        assert!(!text.contains(hidden), "{words}: {text:?}");
        seen += &text;
    }
    assert!(seen.matches("s\\u001b[31m\\u202e").count() > 5, "{seen}");
    let fault = said(&go(root, "data check data"));
    assert!(
        fault.starts_with("data/s\\u001b[31m\\u202ex\\u009b\\u0007\\u000ay/meta.json: warning"),
        "{fault}"
    );
    // JSON says the same as ever.
    let output = go(root, "data info data --format json");
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(value["datasets"][0]["sequences"][0]["sequence"], WILD);
    // What is read back is the name itself.
    let journal = fs::read(root.join("run/journal.jsonl")).unwrap();
    assert!(go(root, "run data -o run").status.success());
    assert!(
        fs::read(root.join("run/journal.jsonl")).unwrap() == journal,
        "tracked again"
    );
}

fn names_are_text_in_markdown() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    let name = "a|b`c`<img src=x>![i](http:) *e* [l](www.x)\nrow";
    data(root, name);
    assert!(go(root, "run data -o run").status.success());
    assert!(
        go(root, "check run --baseline base.json --update-baseline")
            .status
            .success()
    );
    let base = fs::read_to_string(root.join("base.json")).unwrap();
    fs::write(
        root.join("drop.json"),
        base.replace("\"sr_5\":1.0", "\"sr_5\":1.5"),
    )
    .unwrap();
    fs::write(root.join("miss.json"), base.replace("b`c`", "b`d`")).unwrap();
    let safe = "a\\|b\\`c\\`\\<img src=x\\>!\\[i\\](http:) \\*e\\* \\[l\\](www\\.x)\\\\u000arow";
    for words in [
        "list data --data data --format md",
        "check run --baseline drop.json --format md",
        "check run --baseline miss.json --format md --summary-md page2.md",
    ] {
        let text = said(&go(root, words));
        for line in text.lines().filter(|l| l.contains("img src")) {
            let shown = line.replace("b\\`d\\`", "b\\`c\\`");
            assert!(shown.contains(safe), "{words}: {line}");
        }
        assert!(text.contains("img src"), "{words}: {text}");
        let rows: Vec<&str> = text.lines().filter(|l| l.starts_with('|')).collect();
        let cells = |row: &str| row.replace("\\|", "").matches('|').count();
        assert!(rows.iter().all(|row| cells(row) == cells(rows[0])), "{text}");
    }
    for page in ["page.md", "page2.md"] {
        let page = fs::read_to_string(root.join(page)).unwrap();
        let named: Vec<&str> = page.lines().filter(|l| l.contains("img src")).collect();
        assert!(!named.is_empty(), "{page}");
        for line in named {
            assert!(line.replace("b\\`d\\`", "b\\`c\\`").contains(safe), "{line}");
        }
    }
}

fn names_are_no_formulas_in_csv() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    data(root, "=1+1");
    fs::rename(root.join("data"), root.join("@data")).unwrap();
    assert!(go(root, "run @data -o run").status.success());
    let listed = said(&go(root, "list data --data @data --format csv"));
    assert!(listed.contains("\n'@data/=1+1,3,3,96x72,"), "{listed}");
    for file in ["sequences.csv", "timing.csv"] {
        let text = fs::read_to_string(root.join("run").join(file)).unwrap();
        assert!(text.contains(",'@data,'=1+1,0,"), "{text}");
    }
    // Numbers keep their signs.
    assert!(
        go(root, "check run --baseline base.json --update-baseline")
            .status
            .success()
    );
    let base = fs::read_to_string(root.join("base.json")).unwrap();
    fs::write(
        root.join("base.json"),
        base.replace("\"sr_5\":1.0", "\"sr_5\":1.5"),
    )
    .unwrap();
    let changes = said(&go(root, "check run --baseline base.json --format csv"));
    let row = changes.lines().find(|l| l.contains("=1+1")).unwrap();
    assert!(row.ends_with(",'@data/=1+1,sr_5,1.5000,1.0000,-0.5000"), "{row}");
    // What the program reads back has the names themselves.
    let text = fs::read_to_string(root.join("run/truth.csv")).unwrap();
    assert!(text.contains("\n@data,=1+1,0,"), "{text}");
    let journal = fs::read(root.join("run/journal.jsonl")).unwrap();
    assert!(go(root, "run @data -o run").status.success());
    assert!(
        fs::read(root.join("run/journal.jsonl")).unwrap() == journal,
        "tracked again"
    );
}
