//! The three CSV files of a run directory.

use super::text;
use crate::metric::aggregate::{CurveRow, Results, SummaryRow, TrackerName};
use crate::metric::figure::Kind;
use crate::metric::set::KEPT_STEPS;
use crate::metric::{MetricSet, Score};
use crate::report::{About, Exporter};
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

/// The cells of a score; counts are whole numbers.
fn score_cells(score: &Score) -> impl Iterator<Item = String> {
    score.iter().map(|(figure, v)| match figure.kind {
        Kind::Count => v.to_string(),
        Kind::Number => number(v),
    })
}

/// Their columns.
fn score_columns(metrics: &MetricSet) -> impl Iterator<Item = &str> {
    metrics.figures().iter().map(|f| f.name.as_str())
}

fn write_rows<'a>(
    out: &mut dyn Write,
    header: impl IntoIterator<Item = &'a str>,
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
        csv.write_record(row.iter().map(|c| text::cell(c).into_owned()))
            .map_err(own)?;
    }
    csv.flush()
}

/// `sequences.csv`: a row per unit.
pub(super) struct SequencesCsv;

impl Exporter for SequencesCsv {
    fn file(&self) -> &str {
        "sequences.csv"
    }

    fn summary(&self) -> &str {
        "figures of each tracker on each sequence from each start frame"
    }

    fn write(&self, results: &Results, _: &About, out: &mut dyn Write) -> io::Result<()> {
        sequences(out, results)
    }
}

/// `summary.csv`: a row per tracker and average.
pub(super) struct SummaryCsv;

impl Exporter for SummaryCsv {
    fn file(&self) -> &str {
        "summary.csv"
    }

    fn summary(&self) -> &str {
        "figures of each tracker over frames and over sequences"
    }

    fn write(&self, results: &Results, _: &About, out: &mut dyn Write) -> io::Result<()> {
        summary(out, &results.metrics, &results.summary)
    }
}

/// `curves.csv`: a row per kept point of each curve.
pub(super) struct CurvesCsv;

impl Exporter for CurvesCsv {
    fn file(&self) -> &str {
        "curves.csv"
    }

    fn summary(&self) -> &str {
        "success curves of each metric"
    }

    fn write(&self, results: &Results, about: &About, out: &mut dyn Write) -> io::Result<()> {
        curves(out, results, about.all_curves)
    }
}

fn sequences(out: &mut dyn Write, results: &Results) -> io::Result<()> {
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
        let tags = results.tags_of(&r.dataset, &r.sequence).join(" ");
        cells.chain([r.status.reason().to_owned(), tags]).collect()
    });
    let columns = score_columns(&results.metrics);
    write_rows(out, header.chain(columns).chain(["reason", "tags"]), rows)
}

/// The rows of `summary.csv` for some trackers.
pub(super) fn summary<'a>(
    out: &mut dyn Write,
    metrics: &MetricSet,
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
        let what = [r.average.name(), r.metric.name, &r.protocol].map(str::to_owned);
        let counts = [r.sequences, r.runs, r.failed_runs].map(|n| n.to_string());
        tracker_cells(&r.tracker)
            .chain(what)
            .chain(counts)
            .chain(score_cells(&r.score))
            .collect()
    });
    write_rows(out, header.chain(score_columns(metrics)), rows)
}

fn curves(out: &mut dyn Write, results: &Results, all: bool) -> io::Result<()> {
    let header = [
        "tracker",
        "dataset",
        "sequence",
        "metric",
        "threshold",
        "success_rate",
        "protocol",
    ];
    let primary = results.metrics.primary();
    let kept = |c: &&CurveRow| all || (c.is_pooled() && c.metric == *primary);
    let curves = results.curves.iter().filter(kept);
    let rows = curves.flat_map(|c| {
        let points = KEPT_STEPS
            .iter()
            .filter_map(|&k| Some((k, c.success_rate.get(k)?)));
        points.map(move |(k, rate)| {
            let (t, metric) = (c.metric.threshold(k), c.metric.name);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::example;

    #[test]
    fn csv_files() {
        let results = example::results();
        let text = |exporter: &dyn Exporter| {
            let mut bytes = Vec::new();
            exporter.write(&results, &About::default(), &mut bytes).unwrap();
            String::from_utf8(bytes).unwrap()
        };
        insta::assert_snapshot!(text(&SummaryCsv), @"
        tracker,sm,am,ssm,ilm,average,metric,protocol,sequences,runs,failed_runs,frames,sr_1,sr_2,sr_5,sr_10,sr_20,auc,sr_area,al_mean,al_median,al_tracked,mcd_mean,mcd_median,cl_mean,cl_median,jaccard_mean,jaccard_median,grid_mean,grid_median,failures,frames_per_failure
        esm/ssd/homography,esm,ssd,homography,,pooled,al,ope,2,2,0,6,0.833333,0.833333,1.000000,1.000000,1.000000,0.963333,18.500000,0.808333,0.175000,0.808333,0.808333,0.175000,0.808333,0.175000,0.015643,0.003493,,,0,
        esm/ssd/homography,esm,ssd,homography,,seq_mean,al,ope,2,2,0,6,0.875000,0.875000,1.000000,1.000000,1.000000,0.972500,18.625000,0.618750,0.212500,0.618750,0.618750,0.212500,0.618750,0.212500,0.011982,0.004234,,,0,
        iclk/ssd/affine,iclk,ssd,affine,,pooled,al,ope,2,2,0,6,0.333333,0.500000,0.666667,0.666667,0.666667,0.633333,12.333333,7.400000,2.000000,1.100000,7.400000,2.000000,7.400000,2.000000,0.257976,0.039168,,,2,
        iclk/ssd/affine,iclk,ssd,affine,,seq_mean,al,ope,2,2,0,6,0.500000,0.625000,0.750000,0.750000,0.750000,0.723750,14.000000,5.600000,8.225000,1.100000,5.600000,8.225000,5.600000,8.225000,0.194479,0.129575,,,2,
        nn/mi/affine,nn,mi,affine,,pooled,al,ope,1,1,1,2,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,20.000000,inf,,20.000000,inf,20.000000,inf,1.000000,1.000000,,,2,
        nn/mi/affine,nn,mi,affine,,seq_mean,al,ope,1,1,1,2,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,20.000000,inf,,20.000000,inf,20.000000,inf,1.000000,1.000000,,,2,
        ");
        insta::assert_snapshot!(text(&SequencesCsv), @"
        tracker,sm,am,ssm,ilm,dataset,sequence,start,protocol,status,frames,sr_1,sr_2,sr_5,sr_10,sr_20,auc,sr_area,al_mean,al_median,al_tracked,mcd_mean,mcd_median,cl_mean,cl_median,jaccard_mean,jaccard_median,grid_mean,grid_median,failures,frames_per_failure,reason,tags
        esm/ssd/homography,esm,ssd,homography,,builtin,book,0,ope,ok,2,1.000000,1.000000,1.000000,1.000000,1.000000,1.000000,19.000000,0.050000,0.050000,0.050000,0.050000,0.050000,0.050000,0.050000,0.000999,0.000999,,,0,,,
        esm/ssd/homography,esm,ssd,homography,,builtin,wall,0,ope,ok,4,0.750000,0.750000,1.000000,1.000000,1.000000,0.945000,18.250000,1.187500,0.375000,1.187500,1.187500,0.375000,1.187500,0.375000,0.022965,0.007469,,,0,,,
        iclk/ssd/affine,iclk,ssd,affine,,builtin,book,0,ope,ok,2,1.000000,1.000000,1.000000,1.000000,1.000000,0.995000,19.000000,0.200000,0.200000,0.200000,0.200000,0.200000,0.200000,0.200000,0.003990,0.003990,,,0,,,
        iclk/ssd/affine,iclk,ssd,affine,,builtin,wall,0,ope,ok,4,0.000000,0.250000,0.500000,0.500000,0.500000,0.452500,9.000000,11.000000,16.250000,2.000000,11.000000,16.250000,11.000000,16.250000,0.384969,0.255159,,,2,,,
        nn/mi/affine,nn,mi,affine,,builtin,wall,0,ope,failed,2,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,20.000000,inf,,20.000000,inf,20.000000,inf,1.000000,1.000000,,,2,,panicked at frame 1,
        ");
        let curves = text(&CurvesCsv);
        assert_eq!(curves.lines().count(), 1 + 11 * (3 * 4 + 5));
        insta::assert_snapshot!(curves.lines().take(4).collect::<Vec<_>>().join("\n"), @"
        tracker,dataset,sequence,metric,threshold,success_rate,protocol
        esm/ssd/homography,all,pooled,al,0.20,0.500000,ope
        esm/ssd/homography,all,pooled,al,0.40,0.666667,ope
        esm/ssd/homography,all,pooled,al,0.60,0.833333,ope
        ");
    }
}
