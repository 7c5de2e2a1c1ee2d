//! Frame logs: the corners of every frame of a unit and its errors as CSV. Errors are all that scores are made of, and
//! written as exactly as they are counted, so a log can be scored at any time.

use crate::metric::{Errors, Metric, MetricSet};
use crate::plan::FrameLogs;
use mtf::geom::Corners;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};

/// One row of a frame log.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Corners in image pixels, rounded by [`round_corners`]; `None` when the tracker gave none or non-finite ones.
    pub corners: Option<Corners>,
    /// `converged`, `max_iters`, `ok`, the word of a [`TrackError`](mtf::tracker::TrackError), or one of [`INIT`],
    /// [`FAILED`], [`SKIPPED`], [`BROKEN`].
    pub status: &'static str,
    /// Iterations used.
    pub iterations: u32,
    /// Similarity of the appearance model where the search evaluated it last; see
    /// [`Update::similarity`](mtf::tracker::Update::similarity).
    pub similarity: f64,
    /// What [`MetricSet::dense_errors`] says; `None` on frames that are not evaluated by dense truth.
    pub dense: Option<Box<[f64]>>,
    /// Frame that the tracker was started on.
    pub since: usize,
}

/// Status of a frame that the tracker was started on; not evaluated.
pub const INIT: &str = "init";
/// Status of a frame in which a tracker failed that is started anew for that; evaluated as a failure, with or without
/// ground truth.
pub const FAILED: &str = "failed";
/// Status of a frame between a failure and the next start; not evaluated.
pub const SKIPPED: &str = "skipped";
/// Status of a frame for which there is no tracker that works.
pub const BROKEN: &str = "broken";

/// Status of a frame in which the tracker believes that the object cannot be seen; evaluated by its corners like any other.
pub const ABSENT: &str = "absent";

impl Row {
    /// A frame without a tracker.
    pub fn without_tracker(status: &'static str) -> Row {
        Row {
            corners: None,
            status,
            iterations: 0,
            similarity: f64::NAN,
            dense: None,
            since: 0,
        }
    }
}

/// What a row of a log says of its frame.
struct Outcome<'a> {
    status: &'a str,
    /// The tracker gave corners.
    output: bool,
    /// The frame has ground truth.
    annotated: bool,
    /// The values of the metrics that every frame has; `None` without corners or truth.
    values: Option<&'a [f64]>,
    /// Those of the dense metrics; `None` where the frame is not evaluated by them.
    dense: Option<&'a [f64]>,
}

impl Outcome<'_> {
    /// The primary error, which is the first, of a frame that counts; infinite without output.
    fn error(&self) -> Option<f64> {
        match (self.status, self.values) {
            (INIT | SKIPPED, _) => None,
            (FAILED, _) => Some(f64::INFINITY),
            (_, Some(values)) => values.first().copied(),
            (_, None) if self.annotated && !self.output => Some(f64::INFINITY),
            (_, None) => None,
        }
    }

    /// Counts the frame: not at all when the tracker was started on it or it was skipped; as one without output when it
    /// was a failure that the tracker was started anew after, with or without ground truth; else by its errors, where
    /// there is ground truth.
    fn count(&self, errors: &mut Errors) {
        match (self.status, self.values) {
            (INIT | SKIPPED, _) => {}
            (FAILED, _) => errors.push_lost(),
            (_, Some(values)) => errors.push_values(values),
            (_, None) if self.annotated && !self.output => errors.push_lost(),
            (_, None) => {}
        }
        match (self.status, self.dense) {
            (_, None) => {}
            (FAILED, Some(_)) => errors.push_dense_lost(),
            (_, Some(values)) => errors.push_dense(values),
        }
    }
}

/// Corners rounded to 1e-6 px, which six decimals hold exactly: a log scores the same as the run that wrote it.
/// `None` if one is not finite.
pub fn round_corners(corners: &Corners) -> Option<Corners> {
    let rounded = Corners(corners.0.map(|c| c.map(|v| (v * 1e6).round() / 1e6)));
    rounded.is_finite().then_some(rounded)
}

/// Columns before those of the metrics that every frame has.
const HEAD: &str = "frame,file,status,x1,y1,x2,y2,x3,y3,x4,y4";
/// Columns after them.
const TAIL: &str = "iterations,similarity";

/// A frame log as CSV: `rows[k]` is frame `i = start + k` of the sequence, `name(i)` its file, `truth(since, i)` its ground
/// truth for a tracker that was started on frame `since`.
///
/// Values of metrics stand in every row that has corners and ground truth, but not where the tracker was started. The
/// columns of dense metrics are the last, and there for sequences with dense truth only.
pub fn format_log<'a>(
    metrics: &MetricSet,
    rows: &[Row],
    start: usize,
    name: impl Fn(usize) -> String,
    truth: impl Fn(usize, usize) -> Option<Corners> + 'a,
) -> Vec<u8> {
    use std::fmt::Write as _;
    let mut out = String::with_capacity(160 * rows.len() + 80);
    let with_dense = rows.iter().any(|row| row.dense.is_some());
    let of_every_frame = metrics.of_every_frame().map(|m| m.name);
    let of_dense = metrics.dense().filter(|_| with_dense).map(|m| m.name);
    let columns = [HEAD]
        .into_iter()
        .chain(of_every_frame)
        .chain([TAIL])
        .chain(of_dense);
    out.push_str(&columns.collect::<Vec<_>>().join(","));
    out.push('\n');
    let (errors, dense) = (metrics.of_every_frame().count(), metrics.dense().count());
    for (k, row) in rows.iter().enumerate() {
        let frame = start + k;
        let _ = write!(out, "{frame},{},{}", quoted(&name(frame)), row.status);
        match row.corners {
            Some(corners) => corners.to_array().iter().for_each(|v| {
                let _ = write!(out, ",{v:.6}");
            }),
            None => out.push_str(",,,,,,,,"),
        }
        match (row.corners, truth(row.since, frame)) {
            (Some(corners), Some(truth)) if row.status != INIT => {
                metrics.frame_errors(&corners, &truth).for_each(|e| {
                    let _ = write!(out, ",{e:.6}");
                });
            }
            _ => out.extend(std::iter::repeat_n(',', errors)),
        }
        // Single precision is what the images carry; a missing similarity is an empty field.
        let similarity = row.similarity as f32;
        let _ = match (similarity.is_finite(), similarity.abs()) {
            (false, _) => write!(out, ",{},", row.iterations),
            (true, 1e-4..1e9 | 0.0) => write!(out, ",{},{similarity}", row.iterations),
            (true, _) => write!(out, ",{},{similarity:e}", row.iterations),
        };
        match &row.dense {
            Some(values) => values.iter().for_each(|e| {
                let _ = write!(out, ",{e:.6}");
            }),
            None if with_dense => out.extend(std::iter::repeat_n(',', dense)),
            None => {}
        }
        out.push('\n');
    }
    out.into_bytes()
}

fn quoted(field: &str) -> std::borrow::Cow<'_, str> {
    if field.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\"")).into()
    } else {
        field.into()
    }
}

/// The bytes that go to the disk.
pub fn pack_log(text: Vec<u8>, logs: FrameLogs) -> Vec<u8> {
    match logs {
        FrameLogs::Zst => compress_to_vec(text.as_slice(), CompressionLevel::Fastest),
        _ => text,
    }
}

/// Errors of the evaluated frames of a log written by [`format_log`]: those with ground truth that the tracker was not
/// started on, and all failures, which count as without output; and of those with dense truth. `annotated(i)`: frame `i` has
/// ground truth.
///
/// # Errors
/// What is wrong with the text.
pub fn score_log(
    metrics: &MetricSet,
    text: &[u8],
    annotated: impl Fn(usize) -> bool,
) -> Result<Errors, String> {
    let mut errors = Errors::new(metrics);
    read_log(metrics, text, annotated, |_, outcome| outcome.count(&mut errors))?;
    Ok(errors)
}

/// The primary error of each evaluated frame of such a log, by the frame's number; infinite without output.
///
/// # Errors
/// What is wrong with the text.
pub fn frame_errors(
    metrics: &MetricSet,
    text: &[u8],
    annotated: impl Fn(usize) -> bool,
) -> Result<Vec<(usize, f64)>, String> {
    let mut found = Vec::new();
    read_log(metrics, text, annotated, |frame, outcome| {
        found.extend(outcome.error().map(|error| (frame, error)));
    })?;
    Ok(found)
}

/// Hands each row of a log to `each`, with the number of its frame.
fn read_log(
    metrics: &MetricSet,
    text: &[u8],
    annotated: impl Fn(usize) -> bool,
    mut each: impl FnMut(usize, &Outcome<'_>),
) -> Result<(), String> {
    let mut reader = csv::ReaderBuilder::new().has_headers(true).from_reader(text);
    let headers = reader.byte_headers().map_err(|e| e.to_string())?;
    if headers.iter().nth(3) != Some(b"x1") || headers.iter().next() != Some(b"frame") {
        return Err("unknown columns".into());
    }
    let column = |metric: &Metric| headers.iter().position(|h| h == metric.name.as_bytes());
    let of_every_frame: Vec<usize> = metrics.of_every_frame().filter_map(column).collect();
    if of_every_frame.len() != metrics.of_every_frame().count() {
        return Err("metrics are missing".into());
    }
    // All of them or none.
    let of_dense: Vec<usize> = metrics.dense().filter_map(column).collect();
    if !of_dense.is_empty() && of_dense.len() != metrics.dense().count() {
        return Err("dense metrics are missing".into());
    }
    let mut record = csv::StringRecord::new();
    let (mut values, mut dense, mut rows) = (Vec::new(), Vec::new(), 0);
    while reader.read_record(&mut record).map_err(|e| e.to_string())? {
        let frame = record[0]
            .parse()
            .map_err(|_| format!("bad frame number {:?}", &record[0]))?;
        let filled = |columns: &[usize]| columns.iter().any(|&at| !record[at].is_empty());
        let read = |columns: &[usize], into: &mut Vec<f64>| -> Result<bool, String> {
            into.clear();
            if !filled(columns) {
                return Ok(false);
            }
            for &at in columns {
                let value = record[at].parse();
                into.push(value.map_err(|_| format!("bad number {:?}", &record[at]))?);
            }
            Ok(true)
        };
        let (scored, scored_densely) = (read(&of_every_frame, &mut values)?, read(&of_dense, &mut dense)?);
        let outcome = Outcome {
            status: &record[2],
            output: !record[3].is_empty(),
            annotated: annotated(frame),
            values: scored.then_some(values.as_slice()),
            dense: scored_densely.then_some(dense.as_slice()),
        };
        each(frame, &outcome);
        rows += 1;
    }
    match rows {
        0 => Err("no rows".into()),
        _ => Ok(()),
    }
}

/// What [`score_log`] says of the log of `rows`, of which the first is frame `start`, with `truth` as for [`format_log`].
pub fn score_rows(
    metrics: &MetricSet,
    rows: &[Row],
    start: usize,
    annotated: impl Fn(usize) -> bool,
    truth: impl Fn(usize, usize) -> Option<Corners>,
) -> Errors {
    let mut errors = Errors::new(metrics);
    for (frame, row) in (start..).zip(rows) {
        let truth = row
            .corners
            .and_then(|corners| Some((corners, truth(row.since, frame)?)));
        let values: Option<Vec<f64>> =
            truth.map(|(corners, truth)| metrics.frame_errors(&corners, &truth).collect());
        let outcome = Outcome {
            status: row.status,
            output: row.corners.is_some(),
            annotated: annotated(frame),
            values: values.as_deref(),
            dense: row.dense.as_deref(),
        };
        outcome.count(&mut errors);
    }
    errors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::unpack;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn logs_score_exactly_as_their_rows(values in prop::collection::vec(prop::array::uniform8(-1e5f64..1e5), 1..8), start in 0usize..5) {
            let rows: Vec<Row> = values
                .iter()
                .map(|v| Row {
                    corners: round_corners(&Corners::from_array(*v)),
                    status: if v[2] > 5e4 { FAILED } else { "ok" },
                    iterations: 3,
                    similarity: v[0],
                    dense: (v[1] > 0.0).then(|| [(v[1] * 1e6).round() / 1e6].into()),
                    since: usize::from(v[3] > 0.0),
                })
                .collect();
            let metrics = MetricSet::builtin();
            let name = |i: usize| format!("frame,{i}.jpg");
            let annotated = |i: usize| i.is_multiple_of(2);
            let truth = |since: usize, i: usize| annotated(i).then(|| Corners::rect(since as f64, 0.0, 9.0, 9.0));
            let text = format_log(&metrics, &rows, start, name, truth);
            prop_assert_eq!(&unpack(pack_log(text.clone(), FrameLogs::Zst)).unwrap(), &text);
            let scored = score_rows(&metrics, &rows, start, annotated, truth);
            prop_assert_eq!(score_log(&metrics, &text, annotated).unwrap(), scored);
        }
    }

    #[test]
    fn rows_without_corners_stay_empty_and_count_as_scored() {
        let metrics = MetricSet::builtin();
        let row = |status, corners| Row {
            corners,
            ..Row::without_tracker(status)
        };
        let here = Corners::rect(1.0, 2.0, 30.0, 40.0);
        let rows = [
            row(INIT, Some(here)),
            row("not_finite", None),
            row("ok", Some(here)),
            row("ok", None),
            row(FAILED, Some(here)),
            row(SKIPPED, None),
            row(INIT, Some(here)),
            row(BROKEN, None),
            row(FAILED, None),
        ];
        let annotated = |i: usize| i != 3 && i != 8;
        let truth = |_: usize, i: usize| annotated(i).then_some(here);
        let text = format_log(&metrics, &rows, 0, |i| i.to_string(), truth);
        let errors = score_log(&metrics, &text, annotated).unwrap();
        assert_eq!(errors, score_rows(&metrics, &rows, 0, annotated, truth));
        let lost = f64::INFINITY;
        assert_eq!(errors.list(0), [lost, 0.0, lost, lost, lost]);
        // The error that made a frame a failure is there to be seen.
        let text = String::from_utf8(text).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[5].contains(",0.000000,0.000000,"), "{}", lines[5]);
        assert!(lines[7].ends_with(",,,,,0,"), "{}", lines[7]);
        assert!(round_corners(&Corners::rect(f64::NAN, 0.0, 1.0, 1.0)).is_none());
    }

    #[test]
    fn failures_show_their_dense_error_and_count_as_lost() {
        let metrics = MetricSet::builtin();
        let here = Corners::rect(1.0, 2.0, 30.0, 40.0);
        let row = |status, dense: f64| Row {
            corners: Some(here),
            dense: Some([dense].into()),
            ..Row::without_tracker(status)
        };
        let rows = [row("ok", 0.5), row(FAILED, 30.0)];
        let truth = |_: usize, _: usize| Some(here);
        let text = format_log(&metrics, &rows, 1, |i| i.to_string(), truth);
        let errors = score_log(&metrics, &text, |_| true).unwrap();
        assert_eq!(errors.list(4), [0.5, f64::INFINITY]);
        assert_eq!(errors, score_rows(&metrics, &rows, 1, |_| true, truth));
        assert!(String::from_utf8(text).unwrap().ends_with(",30.000000\n"));
    }

    #[test]
    fn damaged_logs_are_told() {
        let metrics = MetricSet::builtin();
        let score_log = |text: &[u8]| score_log(&metrics, text, |_| true);
        assert!(score_log(b"").is_err());
        assert!(score_log(b"a,b,c\n1,2,3\n").is_err());
        let good = format_log(
            &metrics,
            &[Row {
                similarity: 0.0,
                ..Row::without_tracker("ok")
            }],
            0,
            |_| "f".into(),
            |_, _| None,
        );
        assert!(score_log(&good).is_ok());
        assert!(score_log(&good[..good.len() - 12]).is_err());
    }
}
