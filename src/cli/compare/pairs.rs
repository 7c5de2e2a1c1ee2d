//! What `compare --all-pairs` says: all trackers by mean rank, and the groups that do not differ.

use crate::judge::compare::{Options, Ranked, Ranking};
use crate::report::{Format, render};
use serde_json::{Value, json};

/// Rankings for people, with a header in bold if `colour`.
pub fn people(found: &[Ranking], options: &Options, format: Format, colour: bool) -> String {
    let each: Vec<String> = found.iter().map(|r| one(r, options, format, colour)).collect();
    each.join("\n")
}

fn one(ranking: &Ranking, options: &Options, format: Format, colour: bool) -> String {
    let end = if format == Format::Md { "  \n" } else { "\n" };
    let runs = several_runs(ranking);
    let mut header = vec!["mean rank", "tracker"];
    if runs {
        header.push("run");
    }
    header.extend([ranking.figure.as_str(), "groups"]);
    let row = |tracker: &Ranked| {
        let mut cells = vec![format!("{:.2}", tracker.mean_rank), tracker.tracker.clone()];
        if runs {
            cells.push(tracker.run.clone());
        }
        cells.extend([format!("{:.4}", tracker.value), tracker.groups.clone()]);
        cells
    };
    let rows: Vec<Vec<String>> = ranking.trackers.iter().map(row).collect();
    let mut text = render(&header, &rows, format, colour);
    text += &format!(
        "\n{} of {} trackers over {} sequences, protocol {}; ranks 1 (best) to {} on each sequence by {}{end}",
        ranking.trackers.len(),
        ranking.trackers.len() + ranking.left_out,
        ranking.sequences,
        ranking.protocol,
        ranking.trackers.len(),
        ranking.figure
    );
    text += &format!(
        "chance of mean ranks as far apart if no tracker is better: p = {} (Friedman){end}",
        probability(ranking.p)
    );
    let differ = ranking
        .pairs
        .iter()
        .filter(|pair| pair.p_holm <= options.fdr)
        .count();
    text + &format!(
        "trackers that share a letter do not differ: {differ} of {} pairs differ at {} (sign flips, corrected after \
             Holm){end}",
        ranking.pairs.len(),
        options.fdr
    )
}

fn several_runs(ranking: &Ranking) -> bool {
    ranking
        .trackers
        .iter()
        .any(|tracker| tracker.run != ranking.trackers[0].run)
}

fn probability(p: f64) -> String {
    if p < 0.001 {
        "below 0.001".to_owned()
    } else {
        format!("{p:.3}")
    }
}

/// A row per tracker.
pub fn csv(found: &[Ranking]) -> String {
    let header = [
        "protocol",
        "mean_rank",
        "tracker",
        "run",
        "figure",
        "value",
        "groups",
        "sequences",
        "p_friedman",
    ];
    let row = |r: &Ranking, t: &Ranked| {
        vec![
            r.protocol.clone(),
            format!("{:.6}", t.mean_rank),
            t.tracker.clone(),
            t.run.clone(),
            r.figure.clone(),
            format!("{:.6}", t.value),
            t.groups.clone(),
            r.sequences.to_string(),
            format!("{:.6}", r.p),
        ]
    };
    let rows: Vec<Vec<String>> = found
        .iter()
        .flat_map(|r| r.trackers.iter().map(move |t| row(r, t)))
        .collect();
    render(&header, &rows, Format::Csv, false)
}

/// Rankings with the tests of all pairs.
pub fn json(found: &[Ranking], options: &Options) -> Value {
    json!({
        "tool": env!("CARGO_PKG_NAME"),
        "version": env!("CARGO_PKG_VERSION"),
        "average": options.average,
        "rate": options.fdr,
        "seed": options.seed,
        "rankings": found,
    })
}
