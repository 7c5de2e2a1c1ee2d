//! What `check` says: for people, for programs, and in Markdown for the page of a CI run.

use crate::cli::exit::of_verdict;
use crate::judge::baseline::{Figure, Key};
use crate::judge::gate::{Change, Comparison, Tolerances, Verdict};
use crate::report::{Format, render};
use std::collections::BTreeSet;
use std::path::Path;

/// A comparison with a baseline, and how strict it was.
pub struct Report<'a> {
    pub comparison: &'a Comparison,
    pub tolerances: &'a Tolerances,
    /// Changes that tables show; 0 for all.
    pub top: usize,
}

impl Report<'_> {
    /// Drops, what is missing, and one line that says how it went.
    pub fn text(&self, format: Format) -> String {
        match format {
            Format::Json => json(self.comparison, Some(self.tolerances)),
            Format::Csv => self.drops(format),
            Format::Table | Format::Md => {
                format!("{}{}{}\n", self.drops(format), self.remarks(), self.verdict())
            }
        }
    }

    /// A page: the verdict as its heading, what dropped, and what improved folded away.
    pub fn markdown(&self, run: &Path) -> String {
        let c = self.comparison;
        let mark = match c.verdict() {
            Verdict::Passed => "✅",
            _ => "❌",
        };
        let mut text = format!("### {mark} mtf-eval {}\n\n", self.verdict());
        text += &self.drops(Format::Md);
        for remark in self.remarks().lines() {
            text += &format!("- {remark}\n");
        }
        if !c.improved.is_empty() {
            let improved: Vec<&Change> = c.improved.iter().collect();
            let table = changes(&improved, "now", Format::Md, self.top);
            text += &format!(
                "\n<details><summary>{} improved</summary>\n\n{table}\n</details>\n",
                c.improved.len()
            );
        }
        text + &format!("\nRun: `{}`\n", run.display())
    }

    fn drops(&self, format: Format) -> String {
        let drops: Vec<&Change> = self.comparison.drops.iter().collect();
        changes(&drops, "now", format, self.top)
    }

    /// What else stands in the way, a line each.
    fn remarks(&self) -> String {
        let c = self.comparison;
        let mut text = String::new();
        for reason in &c.not_comparable {
            text += &format!("not comparable: {reason}\n");
        }
        text += &keys("missing", &c.missing);
        text += &keys("failed", &c.failed);
        text + &keys("not in the baseline", &c.added)
    }

    /// How it went, in one line.
    fn verdict(&self) -> String {
        let c = self.comparison;
        let trackers: BTreeSet<&str> = c.drops.iter().map(|d| d.key.tracker.as_str()).collect();
        let tolerated = Figure::ALL
            .map(|f| format!("{} {}", f.name(), self.tolerances.general(f)))
            .join(", ");
        let others = match self.tolerances.overrides.len() {
            0 => String::new(),
            n => format!(", {n} override{}", if n == 1 { "" } else { "s" }),
        };
        let worse = match c.drops.len() {
            0 => "no drops".to_owned(),
            n => format!(
                "{n} drops in {} tracker{}",
                trackers.len(),
                if trackers.len() == 1 { "" } else { "s" }
            ),
        };
        let word = match c.verdict() {
            Verdict::Passed => "passed",
            Verdict::Dropped => "failed",
            Verdict::NotComparable => "not comparable",
            Verdict::Incomplete => "incomplete",
        };
        format!(
            "check {word}: {worse}, {} improved, {} unchanged (tolerances: {tolerated} px{others})",
            c.improved.len(),
            c.unchanged
        )
    }
}

/// The first `top` changes (0: all) as a table with an empty line below; as CSV all of them, without.
pub fn changes(changes: &[&Change], now: &str, format: Format, top: usize) -> String {
    if changes.is_empty() && format != Format::Csv {
        return String::new();
    }
    let shown = if top == 0 || format == Format::Csv {
        changes.len()
    } else {
        top.min(changes.len())
    };
    let header = ["tracker", "sequence", "figure", "baseline", now, "change"];
    let figure = |v: f64| {
        if v.is_nan() {
            "-".to_owned()
        } else {
            format!("{v:.4}")
        }
    };
    let rows: Vec<Vec<String>> = changes[..shown]
        .iter()
        .map(|c| {
            let change = c.now - c.baseline;
            let change = if change.is_nan() {
                "-".to_owned()
            } else {
                format!("{change:+.4}")
            };
            vec![
                c.key.tracker.clone(),
                c.key.place(),
                c.figure.name().to_owned(),
                figure(c.baseline),
                figure(c.now),
                change,
            ]
        })
        .collect();
    let mut text = render(&header, &rows, format, false);
    if shown < changes.len() {
        text += &format!("\n{} more changes (--top 0 shows all)\n", changes.len() - shown);
    }
    if format != Format::Csv {
        text.push('\n');
    }
    text
}

/// One line per key, at most twenty.
pub fn keys(what: &str, keys: &[Key]) -> String {
    const SHOWN: usize = 20;
    let mut text: String = keys
        .iter()
        .take(SHOWN)
        .map(|k| format!("{what}: {} on {}\n", k.tracker, k.place()))
        .collect();
    if keys.len() > SHOWN {
        text += &format!("{what}: {} more\n", keys.len() - SHOWN);
    }
    text
}

/// Everything, for programs.
pub fn json(comparison: &Comparison, tolerances: Option<&Tolerances>) -> String {
    let change = |c: &Change| {
        serde_json::json!({
            "tracker": c.key.tracker, "dataset": c.key.dataset, "sequence": c.key.sequence, "start": c.key.start,
            "figure": c.figure, "baseline": c.baseline, "now": c.now,
        })
    };
    let changes = |list: &[Change]| list.iter().map(change).collect::<Vec<_>>();
    let value = serde_json::json!({
        "passed": comparison.verdict() == Verdict::Passed,
        "exit_code": of_verdict(comparison.verdict()),
        "tolerances": tolerances,
        "drops": changes(&comparison.drops),
        "improved": changes(&comparison.improved),
        "unjudged": changes(&comparison.unjudged),
        "unchanged": comparison.unchanged,
        "failed": comparison.failed,
        "missing": comparison.missing,
        "added": comparison.added,
        "not_comparable": comparison.not_comparable,
    });
    format!("{value:#}\n")
}
