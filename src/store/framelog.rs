//! Frame logs: the corners of every frame of a unit as CSV. Corners are all that scores are made of, so a log can be
//! scored again at any time.

use crate::metric::{Errors, MetricSet};
use crate::plan::FrameLogs;
use mtf::geom::Corners;
use ruzstd::decoding::StreamingDecoder;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use std::io::Read;

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
    /// Similarity of the appearance model.
    pub similarity: f64,
    /// What [`MetricSet::dense_errors`] says; `None` on frames that are not evaluated by dense truth.
    pub dense: Option<Box<[f64]>>,
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

impl Row {
    /// A frame without a tracker.
    pub fn without_tracker(status: &'static str) -> Row {
        Row {
            corners: None,
            status,
            iterations: 0,
            similarity: f64::NAN,
            dense: None,
        }
    }

    /// How the row counts.
    pub fn outcome(&self) -> Outcome {
        Outcome::new(self.status, self.corners)
    }
}

/// How a row of a log counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// Not at all: a start, or a frame that was skipped.
    None,
    /// As a failure, with or without ground truth.
    Failure,
    /// By its corners, where there is ground truth.
    Output(Option<Corners>),
}

impl Outcome {
    fn new(status: &str, corners: Option<Corners>) -> Outcome {
        match status {
            INIT | SKIPPED => Outcome::None,
            FAILED => Outcome::Failure,
            _ => Outcome::Output(corners),
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

/// A frame log as CSV: `rows[k]` is frame `start + k` of the sequence, `name(i)` its file, `truth(i)` its ground truth.
///
/// Values of metrics stand in every row that has corners and ground truth, but not where the tracker was started. The
/// columns of dense metrics are the last, and there for sequences with dense truth only.
pub fn format_log<'a>(
    metrics: &MetricSet,
    rows: &[Row],
    start: usize,
    name: impl Fn(usize) -> String,
    truth: impl Fn(usize) -> Option<Corners> + 'a,
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
        match (row.corners, truth(frame)) {
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

/// The text of a log from the bytes on the disk, compressed or not.
///
/// # Errors
/// What is wrong with the compressed bytes.
pub fn unpack_log(bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
    if !bytes.starts_with(&MAGIC) {
        return Ok(bytes);
    }
    let mut text = Vec::new();
    let mut decoder = StreamingDecoder::new(bytes.as_slice()).map_err(|e| e.to_string())?;
    decoder.read_to_end(&mut text).map_err(|e| e.to_string())?;
    Ok(text)
}

/// What a frame log holds that scores are made of.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameLog {
    /// Frame of the first row.
    pub start: usize,
    /// What each frame counts as.
    pub outcomes: Vec<Outcome>,
    /// The values of the dense metrics, of each frame that has such truth.
    pub dense: Vec<Box<[f64]>>,
}

/// Reads a log written by [`format_log`].
///
/// # Errors
/// What is wrong with the text.
pub fn parse_log(metrics: &MetricSet, bytes: &[u8]) -> Result<FrameLog, String> {
    let mut reader = csv::ReaderBuilder::new().has_headers(true).from_reader(bytes);
    let headers = reader.byte_headers().map_err(|e| e.to_string())?;
    if headers.iter().nth(3) != Some(b"x1") || headers.iter().next() != Some(b"frame") {
        return Err("unknown columns".into());
    }
    let column = |name: &str| headers.iter().position(|h| h == name.as_bytes());
    // All of them or none.
    let columns: Vec<usize> = metrics.dense().filter_map(|m| column(m.name)).collect();
    if !columns.is_empty() && columns.len() != metrics.dense().count() {
        return Err("dense metrics are missing".into());
    }
    let mut record = csv::StringRecord::new();
    let (mut start, mut outcomes, mut dense) = (None, Vec::new(), Vec::new());
    let number = |field: &str| field.parse().map_err(|_| format!("bad number {field:?}"));
    while reader.read_record(&mut record).map_err(|e| e.to_string())? {
        if start.is_none() {
            start = Some(
                record[0]
                    .parse()
                    .map_err(|_| format!("bad frame number {:?}", &record[0]))?,
            );
        }
        let mut values = [0.0; 8];
        let mut present = true;
        for (value, field) in values.iter_mut().zip(record.iter().skip(3)) {
            match field {
                "" => present = false,
                field => *value = number(field)?,
            }
        }
        let corners = present.then(|| Corners::from_array(values));
        outcomes.push(Outcome::new(&record[2], corners));
        if columns.iter().any(|&at| !record[at].is_empty()) {
            let values = columns.iter().map(|&at| number(&record[at]));
            dense.push(values.collect::<Result<_, _>>()?);
        }
    }
    let start = start.ok_or("no rows")?;
    Ok(FrameLog {
        start,
        outcomes,
        dense,
    })
}

/// Errors of the evaluated frames of a log, of which the first is frame `start`: those with ground truth that the tracker
/// was not started on, and all failures, which count as without output; and of those with dense truth.
pub fn score_log<'a>(
    metrics: &MetricSet,
    start: usize,
    outcomes: impl IntoIterator<Item = Outcome>,
    dense: impl IntoIterator<Item = &'a [f64]>,
    truth: impl Fn(usize) -> Option<Corners>,
) -> Errors {
    let mut errors = Errors::new(metrics);
    for (frame, outcome) in (start..).zip(outcomes) {
        match (outcome, truth(frame)) {
            (Outcome::None, _) | (Outcome::Output(_), None) => {}
            (Outcome::Failure, _) => errors.push_lost(),
            (Outcome::Output(corners), Some(truth)) => errors.push(corners.as_ref(), &truth),
        }
    }
    dense.into_iter().for_each(|values| errors.push_dense(values));
    errors
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn logs_come_back_exactly(values in prop::collection::vec(prop::array::uniform8(-1e5f64..1e5), 1..8), start in 0usize..5) {
            let rows: Vec<Row> = values
                .iter()
                .map(|v| Row {
                    corners: round_corners(&Corners::from_array(*v)),
                    status: "ok",
                    iterations: 3,
                    similarity: v[0],
                    dense: (v[1] > 0.0).then(|| [(v[1] * 1e6).round() / 1e6].into()),
                })
                .collect();
            let name = |i: usize| format!("frame,{i}.jpg");
            let truth = |i: usize| (i.is_multiple_of(2)).then(|| Corners::rect(0.0, 0.0, 9.0, 9.0));
            let text = format_log(&MetricSet::builtin(), &rows, start, name, truth);
            prop_assert_eq!(&unpack_log(pack_log(text.clone(), FrameLogs::Zst)).unwrap(), &text);
            let log = parse_log(&MetricSet::builtin(), &text).unwrap();
            prop_assert_eq!(log.start, start);
            prop_assert_eq!(log.dense, rows.iter().filter_map(|r| r.dense.clone()).collect::<Vec<_>>());
            for (row, read) in rows.iter().zip(&log.outcomes) {
                let Outcome::Output(Some(read)) = read else { panic!("{read:?}") };
                prop_assert_eq!(row.corners.unwrap().to_array().map(f64::to_bits), read.to_array().map(f64::to_bits));
            }
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
        let truth = |i: usize| (i != 3 && i != 8).then_some(here);
        let text = format_log(&MetricSet::builtin(), &rows, 0, |i| i.to_string(), truth);
        let log = parse_log(&MetricSet::builtin(), &text).unwrap();
        let errors = score_log(&metrics, log.start, log.outcomes, [], truth);
        assert_eq!(
            errors,
            score_log(&metrics, 0, rows.iter().map(Row::outcome), [], truth)
        );
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
    fn damaged_logs_are_told() {
        let metrics = MetricSet::builtin();
        let parse_log = |text: &[u8]| parse_log(&metrics, text);
        assert!(parse_log(b"").is_err());
        assert!(parse_log(b"a,b,c\n1,2,3\n").is_err());
        let good = format_log(
            &metrics,
            &[Row {
                similarity: 0.0,
                ..Row::without_tracker("ok")
            }],
            0,
            |_| "f".into(),
            |_| None,
        );
        assert!(parse_log(&good).is_ok());
        assert!(parse_log(&good[..good.len() - 12]).is_err());
    }
}
