//! The order of the modules of both crates, lowest first. A `use` that goes up fails. `docs/architecture.md` shows the
//! same order and draws the arrows that the code has; `MTF_EVAL_UPDATE=1` draws them again.

use proc_macro2::{Delimiter, TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

crate::tests! {
    modules_use_what_is_below_them;
    the_page_shows_the_code;
}

/// A crate: its name, its folder, and ranks of modules, lowest first. A module may use those of lower ranks only.
struct House {
    name: &'static str,
    source: &'static str,
    ranks: &'static [&'static [&'static str]],
}

const HOUSES: [House; 2] = [
    House {
        name: "mtf",
        source: "crates/mtf/src",
        ranks: &[
            &["expr", "geom", "interrupt", "params"],
            &["entry", "threads"],
            &["kernels"],
            &["image"],
            &["tracker"],
            &["consensus"],
            &["flow"],
            &["am"],
            &["ilm"],
            &["ssm"],
            &["sm"],
            &["features"],
            &["compose"],
            &["best"],
            &["registry"],
            &["diagnose"],
            &["conformance"],
            &["prelude"],
        ],
    },
    House {
        name: "mtf-eval",
        source: "src",
        ranks: &[
            &["files", "panics"],
            &["dataset", "metric"],
            &["synth"],
            &["plan"],
            &["store"],
            &["judge", "measure"],
            &["report"],
            &["run"],
            &["catalogue"],
            &["cli"],
            &["prelude"],
        ],
    },
];

impl House {
    fn rank(&self, module: &str) -> Option<usize> {
        self.ranks.iter().position(|rank| rank.contains(&module))
    }

    fn module_exists(&self, module: &str) -> bool {
        let folder = root().join(self.source);
        folder.join(module).is_dir() || folder.join(format!("{module}.rs")).is_file()
    }

    /// Every use of one top-level module by another, with a file that has it; tests apart.
    fn arrows(&self) -> BTreeMap<(String, String), PathBuf> {
        let mut arrows = BTreeMap::new();
        let mut folders = vec![root().join(self.source)];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(&folder).expect("a folder of the crate") {
                let path = entry.expect("an entry").path();
                if path.is_dir() {
                    folders.push(path);
                    continue;
                }
                let place = path
                    .strip_prefix(root().join(self.source))
                    .expect("below the crate");
                let stem = |p: &Path| p.file_stem().map(|s| s.to_string_lossy().into_owned());
                let inner: Vec<String> = place
                    .with_extension("")
                    .iter()
                    .map(|s| s.to_string_lossy().into_owned())
                    .collect();
                let is_test = inner.iter().any(|part| part == "tests");
                if path.extension().is_none_or(|e| e != "rs") || is_test {
                    continue;
                }
                let module = inner[0].clone();
                if module == "lib" || module == "main" {
                    continue;
                }
                // Modules above this file: itself, unless it is the `mod.rs` of its folder.
                let depth = inner.len() - usize::from(stem(&path).is_some_and(|s| s == "mod"));
                let source = fs::read_to_string(&path).expect("a source file");
                let tokens: TokenStream = source
                    .parse()
                    .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
                let mut used = BTreeSet::new();
                scan(tokens, depth, &mut used);
                for other in used.into_iter().filter(|other| *other != module) {
                    arrows
                        .entry((module.clone(), other))
                        .or_insert_with(|| path.clone());
                }
            }
        }
        arrows
    }
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn is_punct(token: Option<&TokenTree>, sign: char) -> bool {
    matches!(token, Some(TokenTree::Punct(p)) if p.as_char() == sign)
}

/// Collects the top-level modules that `tokens`, `depth` modules deep, name after `crate::` or enough `super::`. Items
/// under `#[cfg(test)]` are passed over.
fn scan(tokens: TokenStream, depth: usize, used: &mut BTreeSet<String>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let mut at = 0;
    while at < tokens.len() {
        match &tokens[at] {
            TokenTree::Punct(p) if p.as_char() == '#' => {
                let test = matches!(tokens.get(at + 1), Some(TokenTree::Group(g)) if g.stream().to_string().replace(' ', "") == "cfg(test)");
                at += 1;
                if test {
                    // Past the item: to its braces or its semicolon.
                    while at < tokens.len() && !is_punct(tokens.get(at), ';') {
                        let braces =
                            matches!(&tokens[at], TokenTree::Group(g) if g.delimiter() == Delimiter::Brace);
                        if braces {
                            break;
                        }
                        at += 1;
                    }
                    at += 1;
                }
            }
            TokenTree::Ident(word) if *word == "crate" || *word == "super" => {
                let mut up = usize::from(*word == "super");
                at += 1;
                let mut top = *word == "crate";
                while is_punct(tokens.get(at), ':') && is_punct(tokens.get(at + 1), ':') {
                    at += 2;
                    match tokens.get(at) {
                        Some(TokenTree::Ident(next)) if *next == "super" => {
                            up += 1;
                            at += 1;
                        }
                        next => {
                            top |= up >= depth;
                            if top {
                                names(next, used);
                            }
                            break;
                        }
                    }
                }
            }
            TokenTree::Group(group) => {
                scan(group.stream(), depth, used);
                at += 1;
            }
            _ => at += 1,
        }
    }
}

/// The modules in what follows `crate::`: one name, or the first names within braces.
fn names(next: Option<&TokenTree>, used: &mut BTreeSet<String>) {
    match next {
        Some(TokenTree::Ident(name)) => {
            used.insert(name.to_string());
        }
        Some(TokenTree::Group(group)) => {
            let mut first = true;
            for token in group.stream() {
                match token {
                    TokenTree::Ident(name) if first => {
                        used.insert(name.to_string());
                        first = false;
                    }
                    TokenTree::Punct(p) if p.as_char() == ',' => first = true,
                    _ => {}
                }
            }
        }
        _ => {}
    }
}

fn modules_use_what_is_below_them() {
    let mut faults = String::new();
    for house in &HOUSES {
        let arrows = house.arrows();
        assert!(arrows.len() > 10, "{}: {} arrows found", house.name, arrows.len());
        for ((from, to), file) in arrows {
            // Macros and constants at the root of the crate are no modules.
            let Some(below) = house.rank(&to) else { continue };
            let Some(rank) = house.rank(&from) else {
                let _ = writeln!(faults, "{}: {from} has no rank in the table", house.name);
                continue;
            };
            if below >= rank {
                let _ = writeln!(
                    faults,
                    "{}: {from} uses {to}, which is not below it ({})",
                    house.name,
                    file.display()
                );
            }
        }
    }
    assert!(faults.is_empty(), "\n{faults}");
}

/// The drawing of a crate: its ranks from the top down, and every arrow that no chain of others implies.
fn drawing(house: &House) -> String {
    let mut uses: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (from, to) in house.arrows().into_keys() {
        if house.rank(&to).is_some() {
            uses.entry(from).or_default().insert(to);
        }
    }
    // Modules that can be reached from one.
    let reach = |from: &String| {
        let mut seen = BTreeSet::new();
        let mut next = vec![from];
        while let Some(module) = next.pop() {
            for to in uses.get(module).into_iter().flatten() {
                if seen.insert(to) {
                    next.push(to);
                }
            }
        }
        seen
    };
    let mut text = "```mermaid\nflowchart TD\n".to_owned();
    for rank in house.ranks.iter().rev() {
        let used: Vec<&&str> = rank.iter().filter(|m| house.module_exists(m)).collect();
        for module in used {
            let _ = writeln!(text, "    {module}");
        }
    }
    for (from, targets) in &uses {
        let implied = |to: &String| {
            targets
                .iter()
                .any(|other| other != to && reach(other).contains(to))
        };
        for to in targets.iter().filter(|to| !implied(to)) {
            let _ = writeln!(text, "    {from} --> {to}");
        }
    }
    text + "```\n"
}

/// The table of ranks, lowest first, as in the test.
fn table(house: &House) -> String {
    let mut text = format!("| rank | modules of `{}` |\n|--:|---|\n", house.name);
    let ranks = house
        .ranks
        .iter()
        .map(|rank| rank.iter().filter(|m| house.module_exists(m)));
    for (k, rank) in ranks.enumerate() {
        let names: Vec<String> = rank.map(|m| format!("`{m}`")).collect();
        if !names.is_empty() {
            let _ = writeln!(text, "| {} | {} |", k + 1, names.join(", "));
        }
    }
    text
}

fn the_page_shows_the_code() {
    let path = root().join("docs/architecture.md");
    let page = fs::read_to_string(&path).expect("docs/architecture.md");
    let mut fresh = page.clone();
    for house in &HOUSES {
        for (what, text) in [("table", table(house)), ("drawing", drawing(house))] {
            let (begin, end) = (
                format!("<!-- {what} {} -->\n", house.name),
                format!("<!-- end {what} {} -->", house.name),
            );
            let from = fresh
                .find(&begin)
                .unwrap_or_else(|| panic!("no '{begin}' in the page"))
                + begin.len();
            let to = fresh
                .find(&end)
                .unwrap_or_else(|| panic!("no '{end}' in the page"));
            fresh.replace_range(from..to, &format!("\n{text}\n"));
        }
    }
    if fresh != page && std::env::var_os("MTF_EVAL_UPDATE").is_some() {
        fs::write(&path, &fresh).expect("the page can be written");
    } else {
        assert!(
            fresh == page,
            "docs/architecture.md is stale: run the test with MTF_EVAL_UPDATE=1"
        );
    }
}
