//! The three CSV files of a run directory.

use crate::metric::aggregate::{Results, SummaryRow, TrackerName};
use crate::metric::score::{Score, threshold};
use std::io::{self, Write};

const TRACKER: [&str; 5] = ["tracker", "sm", "am", "ssm", "ilm"];

/// The tracker's five cells.
fn tracker_cells(t: &TrackerName) -> impl Iterator<Item = String> + '_ {
    [&t.id, &t.sm, &t.am, &t.ssm, &t.ilm].into_iter().cloned()
}

/// A number with six decimals; `inf` when infinite, empty when undefined.
pub(super) fn number(v: f64) -> String {
    if v.is_nan() {
        String::new()
    } else if v.is_infinite() {
        "inf".to_owned()
    } else {
        format!("{v:.6}")
    }
}

/// The cells of [`Score::COLUMNS`]; counts are whole numbers.
fn score_cells(score: &Score) -> impl Iterator<Item = String> {
    let cells = Score::COLUMNS.into_iter().zip(score.values());
    cells.map(|(c, v)| {
        if c == "frames" || c == "failures" {
            v.to_string()
        } else {
            number(v)
        }
    })
}

fn write_rows(
    out: &mut dyn Write,
    header: impl IntoIterator<Item = &'static str>,
    rows: impl Iterator<Item = Vec<String>>,
) -> io::Result<()> {
    // The system's own error: wrapped in one of the csv crate a full disk could not be told from other failures.
    let own = |e: csv::Error| match e.into_kind() {
        csv::ErrorKind::Io(e) => e,
        other => io::Error::other(format!("{other:?}")),
    };
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(header).map_err(own)?;
    for row in rows {
        csv.write_record(row).map_err(own)?;
    }
    csv.flush()
}

/// `sequences.csv`: a row per unit.
pub(super) fn sequences(out: &mut dyn Write, results: &Results) -> io::Result<()> {
    let header = TRACKER
        .into_iter()
        .chain(["dataset", "sequence", "start", "protocol", "status"]);
    let rows = results.sequences.iter().map(|r| {
        let what = [
            r.dataset.as_str(),
            &r.sequence,
            &r.start.to_string(),
            &r.protocol,
            r.status.word(),
        ]
        .map(str::to_owned);
        let cells = tracker_cells(&r.tracker).chain(what).chain(score_cells(&r.score));
        cells.chain([r.status.reason().to_owned()]).collect()
    });
    write_rows(out, header.chain(Score::COLUMNS).chain(["reason"]), rows)
}

/// `summary.csv`: a row per tracker and average.
pub(super) fn summary<'a>(
    out: &mut dyn Write,
    rows: impl IntoIterator<Item = &'a SummaryRow>,
) -> io::Result<()> {
    let header = TRACKER.into_iter().chain([
        "average",
        "metric",
        "protocol",
        "sequences",
        "runs",
        "failed_runs",
    ]);
    let rows = rows.into_iter().map(|r| {
        let what = [r.average.name(), r.metric.name(), &r.protocol].map(str::to_owned);
        let counts = [r.sequences, r.runs, r.failed_runs].map(|n| n.to_string());
        tracker_cells(&r.tracker)
            .chain(what)
            .chain(counts)
            .chain(score_cells(&r.score))
            .collect()
    });
    write_rows(out, header.chain(Score::COLUMNS), rows)
}

/// `curves.csv`: a row per point of each curve.
pub(super) fn curves(out: &mut dyn Write, results: &Results, of_sequences: bool) -> io::Result<()> {
    let header = [
        "tracker",
        "dataset",
        "sequence",
        "metric",
        "threshold",
        "success_rate",
        "protocol",
    ];
    let curves = results.curves.iter().filter(|c| of_sequences || c.is_pooled());
    let rows = curves.flat_map(|c| {
        c.success_rate.iter().enumerate().map(move |(k, rate)| {
            let (t, metric) = (threshold(c.metric, k), c.metric.name());
            [
                c.tracker.id.as_str(),
                &c.dataset,
                &c.sequence,
                metric,
                &format!("{t:.2}"),
                &number(*rate),
                &c.protocol,
            ]
            .map(str::to_owned)
            .to_vec()
        })
    });
    write_rows(out, header, rows)
}
