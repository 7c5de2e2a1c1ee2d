//! Frame logs: the corners of every frame of a unit as CSV. Corners are all that scores are made of, so a log can be
//! scored again at any time.

use super::error::{FrameError, frame_error};
use crate::geom::Corners;

/// One row of a frame log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Corners in image pixels, rounded by [`round_corners`]; `None` when the tracker gave none or non-finite ones.
    pub corners: Option<Corners>,
    /// `init`, `converged`, `max_iters`, `ok`, or the word of a [`TrackError`](crate::tracker::TrackError).
    pub status: &'static str,
    /// Iterations used.
    pub iterations: u32,
    /// Similarity of the appearance model.
    pub similarity: f64,
}

/// Corners rounded to 1e-6 px, which six decimals hold exactly: a log scores the same as the run that wrote it.
/// `None` if one is not finite.
pub fn round_corners(corners: &Corners) -> Option<Corners> {
    let rounded = Corners(corners.0.map(|c| c.map(|v| (v * 1e6).round() / 1e6)));
    rounded.is_finite().then_some(rounded)
}

/// A frame log as CSV: `rows[k]` is frame `start + k` of the sequence, `name(i)` its file, `truth(i)` its ground truth.
///
/// Errors stand in a row only where they count: not on the first (initialisation), not without ground truth.
pub fn format_log<'a>(
    rows: &[Row],
    start: usize,
    name: impl Fn(usize) -> String,
    truth: impl Fn(usize) -> Option<Corners> + 'a,
) -> Vec<u8> {
    use std::fmt::Write as _;
    let mut out = String::with_capacity(160 * rows.len() + 80);
    out.push_str("frame,file,status,x1,y1,x2,y2,x3,y3,x4,y4,al,mcd,cl,jaccard,iterations,similarity\n");
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
            (Some(corners), Some(truth)) if k > 0 => {
                let e = frame_error(&corners, &truth);
                let _ = write!(out, ",{:.6},{:.6},{:.6},{:.6}", e.al, e.mcd, e.cl, e.jaccard);
            }
            _ => out.push_str(",,,,"),
        }
        // Single precision is what the images carry; a missing similarity is an empty field.
        let similarity = row.similarity as f32;
        let _ = match (similarity.is_finite(), similarity.abs()) {
            (false, _) => writeln!(out, ",{},", row.iterations),
            (true, 1e-4..1e9 | 0.0) => writeln!(out, ",{},{similarity}", row.iterations),
            (true, _) => writeln!(out, ",{},{similarity:e}", row.iterations),
        };
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

/// Corners per frame of a log written by [`format_log`], and the frame of its first row.
///
/// # Errors
/// What is wrong with the text.
pub fn parse_log(bytes: &[u8]) -> Result<(usize, Vec<Option<Corners>>), String> {
    let mut reader = csv::ReaderBuilder::new().has_headers(true).from_reader(bytes);
    let headers = reader.byte_headers().map_err(|e| e.to_string())?;
    if headers.iter().nth(3) != Some(b"x1") || headers.iter().next() != Some(b"frame") {
        return Err("unknown columns".into());
    }
    let mut record = csv::StringRecord::new();
    let (mut start, mut corners) = (None, Vec::new());
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
                field => *value = field.parse().map_err(|_| format!("bad number {field:?}"))?,
            }
        }
        corners.push(present.then(|| Corners::from_array(values)));
    }
    start.map(|s| (s, corners)).ok_or_else(|| "no rows".into())
}

/// Errors of the scored frames of a log: those after the first with ground truth.
pub fn score_log(
    start: usize,
    corners: &[Option<Corners>],
    truth: impl Fn(usize) -> Option<Corners>,
) -> Vec<Option<FrameError>> {
    corners
        .iter()
        .enumerate()
        .skip(1)
        .filter_map(|(k, corners)| truth(start + k).map(|truth| corners.map(|c| frame_error(&c, &truth))))
        .collect()
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
                })
                .collect();
            let name = |i: usize| format!("frame,{i}.jpg");
            let truth = |i: usize| (i.is_multiple_of(2)).then(|| Corners::rect(0.0, 0.0, 9.0, 9.0));
            let (from, corners) = parse_log(&format_log(&rows, start, name, truth)).unwrap();
            prop_assert_eq!(from, start);
            for (row, read) in rows.iter().zip(&corners) {
                prop_assert_eq!(row.corners.unwrap().to_array().map(f64::to_bits), read.unwrap().to_array().map(f64::to_bits));
            }
        }
    }

    #[test]
    fn rows_without_corners_stay_empty_and_count_as_scored() {
        let row = |corners| Row {
            corners,
            status: "not_finite",
            iterations: 0,
            similarity: f64::NAN,
        };
        let here = Corners::rect(1.0, 2.0, 30.0, 40.0);
        let rows = [row(Some(here)), row(None), row(Some(here)), row(None)];
        let truth = |i: usize| (i != 3).then_some(here);
        let log = format_log(&rows, 0, |i| i.to_string(), truth);
        let (start, corners) = parse_log(&log).unwrap();
        let errors = score_log(start, &corners, truth);
        assert_eq!(errors.len(), 2);
        assert!(errors[0].is_none());
        assert_eq!(errors[1].unwrap().al, 0.0);
        assert!(round_corners(&Corners::rect(f64::NAN, 0.0, 1.0, 1.0)).is_none());
    }

    #[test]
    fn damaged_logs_are_told() {
        assert!(parse_log(b"").is_err());
        assert!(parse_log(b"a,b,c\n1,2,3\n").is_err());
        let good = format_log(
            &[Row {
                corners: None,
                status: "ok",
                iterations: 0,
                similarity: 0.0,
            }],
            0,
            |_| "f".into(),
            |_| None,
        );
        assert!(parse_log(&good).is_ok());
        assert!(parse_log(&good[..good.len() - 12]).is_err());
    }
}
