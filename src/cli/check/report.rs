//! What `check` says: for people, for programs, and in Markdown for the page of a CI run.

use crate::cli::exit::of_conclusion;
use crate::judge::change::Subject;
use crate::judge::gate::{Conclusion, Finding, Findings};
use crate::judge::pairing::OtherSettings;
use crate::judge::tolerances::{Tolerance, Tolerances};
use crate::metric::MetricSet;
use crate::report::text::{markdown, one_line};
use crate::report::{Format, json_text, render};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// What the gate finds, and how strict it was.
pub struct Report<'a> {
    pub findings: &'a Findings,
    pub tolerances: &'a Tolerances,
    /// What the figures are of.
    pub metrics: &'a MetricSet,
    /// Changes that tables show; 0 for all.
    pub top: usize,
    /// JSON is indented.
    pub pretty: bool,
}

impl Report<'_> {
    /// Drops, what is missing, and one line that says how it went.
    pub fn text(&self, format: Format) -> String {
        match format {
            Format::Json => json_text(&json(self.findings, Some(self.tolerances)), self.pretty),
            Format::Csv => self.drops(format),
            Format::Table => {
                format!("{}{}{}\n", self.drops(format), self.remarks(), self.conclusion())
            }
            Format::Md => {
                let rest = format!("{}{}\n", self.remarks(), self.conclusion());
                format!("{}{}", self.drops(format), paragraph(&rest))
            }
        }
    }

    /// A page: the verdict as its heading, what dropped, and what improved folded away.
    pub fn markdown(&self, run: &Path) -> String {
        let c = self.findings;
        let mark = match c.conclusion() {
            Conclusion::Passed => "✅",
            _ => "❌",
        };
        let mut text = format!("### {mark} mtf-eval {}\n\n", markdown(&self.conclusion()));
        text += &self.drops(Format::Md);
        for remark in self.remarks().lines() {
            text += &format!("- {}\n", markdown(remark));
        }
        if !c.improved.is_empty() {
            let improved: Vec<&Finding> = c.improved.iter().collect();
            let table = changes(&improved, "now", Format::Md, self.top);
            text += &format!(
                "\n<details><summary>{} improved</summary>\n\n{table}\n</details>\n",
                c.improved.len()
            );
        }
        text + &format!("\nRun: {}\n", markdown(&run.display().to_string()))
    }

    fn drops(&self, format: Format) -> String {
        let c = self.findings;
        // Where every difference fails, what got better does, too.
        let others = [&c.improved[..], &c.unjudged[..]].concat();
        let others = if c.exact { &others[..] } else { &[] };
        let drops: Vec<&Finding> = c.drops.iter().chain(others).collect();
        changes(&drops, "now", format, self.top)
    }

    /// What else stands in the way, a line each.
    fn remarks(&self) -> String {
        let c = self.findings;
        let mut text = String::new();
        for reason in &c.not_comparable {
            text += &format!("not comparable: {}\n", one_line(reason));
        }
        let (mut before, mut after) = (BTreeSet::new(), BTreeSet::new());
        let mut differences: BTreeMap<&str, Vec<&OtherSettings>> = BTreeMap::new();
        for pair in &c.other_settings {
            before.insert(pair.before.as_str());
            after.insert(pair.after.as_str());
            differences.entry(&pair.difference).or_default().push(pair);
        }
        for (difference, pairs) in differences {
            let what = match pairs[..] {
                [pair] => pair.before.clone(),
                _ => format!("{} trackers ({}, ...)", pairs.len(), pairs[0].before),
            };
            let line = format!("other settings: {what} ran with {difference}; --update-baseline accepts it");
            text += &format!("{}\n", one_line(&line));
        }
        let others = |subjects: &[Subject], named: &BTreeSet<&str>| -> Vec<Subject> {
            let others = subjects.iter().filter(|s| !named.contains(s.tracker.as_str()));
            others.cloned().collect()
        };
        text += &keys("missing", &others(&c.missing, &before));
        text += &keys("failed", &c.failed);
        text += &keys("not in the baseline", &others(&c.added, &after));
        for figure in &c.added_figures {
            text += &format!("not in the baseline: {figure}\n");
        }
        text
    }

    /// How it went, in one line.
    fn conclusion(&self) -> String {
        let c = self.findings;
        let trackers: BTreeSet<&str> = c.drops.iter().map(|d| d.subject.tracker.as_str()).collect();
        let tolerated = self.tolerances.figures().map(|(name, tolerance)| {
            let unit = match tolerance {
                Tolerance::Absolute(_) => self.metrics.figure(name).map_or("", |f| f.unit),
                Tolerance::Relative(_) => "",
            };
            format!("{name} {tolerance} {unit}").trim_end().to_owned()
        });
        let tolerated = match self.tolerances.exact {
            true => "exact: no difference passes".to_owned(),
            false => format!("tolerances: {}", tolerated.collect::<Vec<_>>().join(", ")),
        };
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
        let word = match c.conclusion() {
            Conclusion::Passed => "passed",
            Conclusion::Dropped => "failed",
            Conclusion::NotComparable => "not comparable",
            Conclusion::Incomplete => "incomplete",
        };
        format!(
            "check {word}: {worse}, {} improved, {} unchanged ({tolerated}{others})",
            c.improved.len(),
            c.unchanged
        )
    }
}

/// The first `top` changes (0: all) as a table with an empty line below; as CSV all of them, without.
pub fn changes(changes: &[&Finding], now: &str, format: Format, top: usize) -> String {
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
            let Finding { subject, change } = c;
            let by = change.after - change.before;
            let by = if by.is_nan() {
                "-".to_owned()
            } else {
                format!("{by:+.4}")
            };
            vec![
                subject.tracker.clone(),
                subject.place(),
                change.figure.clone(),
                figure(change.before),
                figure(change.after),
                by,
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

/// Lines of text as Markdown.
pub fn paragraph(lines: &str) -> String {
    lines.lines().map(|line| markdown(line) + "\n").collect()
}

/// One line per subject, at most twenty.
pub fn keys(what: &str, subjects: &[Subject]) -> String {
    const SHOWN: usize = 20;
    let mut text: String = subjects
        .iter()
        .take(SHOWN)
        .map(|k| format!("{what}: {} on {}\n", one_line(&k.tracker), one_line(&k.place())))
        .collect();
    if subjects.len() > SHOWN {
        text += &format!("{what}: {} more\n", subjects.len() - SHOWN);
    }
    text
}

/// Everything, for programs.
pub fn json(findings: &Findings, tolerances: Option<&Tolerances>) -> serde_json::Value {
    let change = |f: &Finding| {
        serde_json::json!({
            "tracker": f.subject.tracker, "dataset": f.subject.dataset, "sequence": f.subject.sequence,
            "start": f.subject.start, "figure": f.change.figure, "baseline": f.change.before, "now": f.change.after,
        })
    };
    let changes = |list: &[Finding]| list.iter().map(change).collect::<Vec<_>>();
    serde_json::json!({
        "passed": findings.conclusion() == Conclusion::Passed,
        "exit_code": of_conclusion(findings.conclusion()),
        "tolerances": tolerances,
        "drops": changes(&findings.drops),
        "improved": changes(&findings.improved),
        "unjudged": changes(&findings.unjudged),
        "unchanged": findings.unchanged,
        "failed": findings.failed,
        "missing": findings.missing,
        "other_settings": findings.other_settings,
        "exact": findings.exact,
        "added": findings.added,
        "not_comparable": findings.not_comparable,
    })
}
