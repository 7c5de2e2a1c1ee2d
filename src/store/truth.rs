//! Ground truth of a run's sequences, kept in the run directory (`truth.csv`: data set, sequence, frame, four corners in
//! px, empty where the object is said not to be seen, whether there is a dense grid), so that shards are joined and figures made again where the data is not.

use crate::dataset::Region;
use crate::files::{self, Kind};
use crate::plan::{PlannedSequence, Prepared};
use crate::store::error::StoreError;
use crate::store::rundir::digest;
use mtf::geom::Corners;
use std::collections::HashMap;
use std::path::Path;

/// Ground truth of a sequence as a run directory keeps it, per frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeptTruth {
    corners: Vec<Option<Corners>>,
    dense: Vec<bool>,
    absent: Vec<bool>,
}

impl KeptTruth {
    /// Corners of frame `i` in px, `None` when it is not annotated or beyond the end.
    pub fn at(&self, i: usize) -> Option<Corners> {
        self.corners.get(i).copied().flatten()
    }

    /// Whether the object is said not to be seen in frame `i`.
    pub fn is_absent(&self, i: usize) -> bool {
        self.absent.get(i).copied().unwrap_or(false)
    }

    /// Frames after `start` that are scored.
    pub fn scored(&self, start: usize) -> usize {
        self.corners.iter().skip(start + 1).flatten().count()
    }

    /// Frames after `start` that are scored by the dense grid.
    pub fn dense(&self, start: usize) -> usize {
        match self.dense.get(start) {
            Some(true) => self.dense.iter().skip(start + 1).filter(|d| **d).count(),
            _ => 0,
        }
    }
}

/// The ground truth of each sequence of the plan.
pub(crate) fn of(prepared: &Prepared<'_>) -> Vec<KeptTruth> {
    let truth = |s: &&crate::dataset::Sequence| KeptTruth {
        corners: (0..s.len()).map(|i| s.truth(i)).collect(),
        dense: (0..s.len()).map(|i| s.dense_truth(i).is_some()).collect(),
        absent: (0..s.len())
            .map(|i| s.annotation(i).region == Region::Absent)
            .collect(),
    };
    prepared.sequences.iter().map(truth).collect()
}

/// As a file.
pub(crate) fn format(sequences: &[PlannedSequence], truth: &[KeptTruth]) -> Vec<u8> {
    let mut out = csv::Writer::from_writer(Vec::new());
    let mut put = |fields: &[String]| {
        // A vector takes everything.
        let _ = out.write_record(fields);
    };
    let header = "dataset,sequence,frame,x1,y1,x2,y2,x3,y3,x4,y4,grid";
    put(&header.split(',').map(str::to_owned).collect::<Vec<_>>());
    for (sequence, truth) in sequences.iter().zip(truth) {
        for (frame, corners) in truth.corners.iter().enumerate() {
            if corners.is_none() && !truth.is_absent(frame) {
                continue;
            }
            let mut fields = vec![
                sequence.dataset.clone(),
                sequence.sequence.clone(),
                frame.to_string(),
            ];
            match corners {
                Some(corners) => fields.extend(corners.to_array().iter().map(f64::to_string)),
                None => fields.extend([""; 8].map(str::to_owned)),
            }
            fields.push(u8::from(truth.dense[frame]).to_string());
            put(&fields);
        }
    }
    out.into_inner().unwrap_or_default()
}

/// Reads what [`format`] wrote, with the SHA-256 `sum`.
///
/// # Errors
/// The file cannot be read or understood, or is another.
pub(crate) fn read(
    path: &Path,
    sequences: &[PlannedSequence],
    sum: &str,
) -> Result<Vec<KeptTruth>, StoreError> {
    let bytes = files::read(path, Kind::TRUTH).map_err(|e| StoreError::io(path, e))?;
    if digest(&bytes) != sum {
        return Err(StoreError::Damaged {
            path: path.to_path_buf(),
            reason: "its checksum is not the one in run.json".into(),
        });
    }
    let mut truths: Vec<KeptTruth> = sequences
        .iter()
        .map(|s| KeptTruth {
            corners: vec![None; s.frames],
            dense: vec![false; s.frames],
            absent: vec![false; s.frames],
        })
        .collect();
    let places: HashMap<(&str, &str), usize> = (0..)
        .zip(sequences)
        .map(|(k, s)| ((s.dataset.as_str(), s.sequence.as_str()), k))
        .collect();
    let mut reader = csv::Reader::from_reader(bytes.as_slice());
    let mut record = csv::StringRecord::new();
    loop {
        let damaged = |reason: String| StoreError::Damaged {
            path: path.to_path_buf(),
            reason,
        };
        match reader.read_record(&mut record) {
            Ok(true) => {}
            Ok(false) => return Ok(truths),
            Err(e) => return Err(damaged(e.to_string())),
        }
        let parse = || -> Option<(usize, usize, Option<Corners>, bool)> {
            let place = *places.get(&(record.get(0)?, record.get(1)?))?;
            let frame = record
                .get(2)?
                .parse()
                .ok()
                .filter(|f| *f < sequences[place].frames)?;
            let dense = record.get(11)? == "1";
            if (3..11).all(|k| record.get(k) == Some("")) {
                return Some((place, frame, None, dense));
            }
            let mut corners = [0.0; 8];
            for (k, value) in corners.iter_mut().enumerate() {
                *value = record.get(3 + k)?.parse().ok()?;
            }
            Some((place, frame, Some(Corners::from_array(corners)), dense))
        };
        let line = record.position().map_or(0, csv::Position::line);
        let (place, frame, corners, dense) = parse().ok_or_else(|| damaged(format!("line {line}")))?;
        truths[place].corners[frame] = corners;
        truths[place].absent[frame] = corners.is_none();
        truths[place].dense[frame] = dense;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_comes_back_exactly() {
        let sequences = [PlannedSequence {
            dataset: "d,\"x\"".into(),
            sequence: "s".into(),
            frames: 5,
            starts: vec![vec![1]],
            fingerprint: String::new(),
            tags: Vec::new(),
        }];
        let corners = |k: f64| Some(Corners::rect(0.1 * k, 1.0 / 3.0, 1e-9 + k, 40.0));
        let truth = [KeptTruth {
            corners: vec![None, corners(1.0), corners(2.0), None, corners(4.0)],
            dense: vec![false, true, false, false, true],
            absent: vec![false, false, false, true, false],
        }];
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("truth.csv");
        let text = format(&sequences, &truth);
        std::fs::write(&path, &text).unwrap();
        assert_eq!(read(&path, &sequences, &digest(&text)).unwrap(), truth);
        assert_eq!(
            (truth[0].scored(1), truth[0].dense(1), truth[0].dense(2)),
            (2, 1, 0)
        );
        let short = "dataset,sequence\nd,s\n";
        std::fs::write(&path, short).unwrap();
        let error = |sum: &str| read(&path, &sequences, sum).unwrap_err().to_string();
        assert!(error(&digest(short.as_bytes())).contains("line 2"));
        assert!(error(&digest(&text)).contains("checksum"));
    }
}
