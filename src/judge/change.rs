//! The engine of comparison: which rows of two runs are about the same, and by how much a figure got better.

use crate::metric::aggregate::{ALL_DATASETS, POOLED};
use crate::metric::{Direction, Figure};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a row of figures is about. Data set `all` and sequence `pooled`: the tracker's average over all frames.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Subject {
    /// Tracker id.
    pub tracker: String,
    /// Data set.
    pub dataset: String,
    /// Sequence.
    pub sequence: String,
    /// Index of the initial frame.
    pub start: usize,
    /// Protocol.
    pub protocol: String,
}

impl Subject {
    /// The average of a tracker over all frames.
    pub fn pooled(tracker: &str, protocol: &str) -> Subject {
        Subject {
            tracker: tracker.to_owned(),
            dataset: ALL_DATASETS.to_owned(),
            sequence: POOLED.to_owned(),
            start: 0,
            protocol: protocol.to_owned(),
        }
    }

    /// True for the average over all frames.
    pub fn is_pooled(&self) -> bool {
        self.dataset == ALL_DATASETS && self.sequence == POOLED
    }

    /// `dataset/sequence[@start]`, or `pooled`.
    pub fn place(&self) -> String {
        match self.start {
            _ if self.is_pooled() => POOLED.to_owned(),
            0 => format!("{}/{}", self.dataset, self.sequence),
            start => format!("{}/{}@{start}", self.dataset, self.sequence),
        }
    }
}

/// Rows of two runs: those that are about the same in pairs, and the rest.
#[derive(Clone, Debug)]
pub struct Matched<'a, R> {
    /// A row of each, in the order of the first run.
    pub both: Vec<(&'a R, &'a R)>,
    /// Rows of the first run alone.
    pub only_before: Vec<&'a R>,
    /// Rows of the second run alone.
    pub only_after: Vec<&'a R>,
}

impl<'a, R> Matched<'a, R> {
    /// Matches rows of equal `key`, of which each run has one.
    pub fn new<K: Ord>(
        before: impl IntoIterator<Item = &'a R>,
        after: impl IntoIterator<Item = &'a R>,
        key: impl Fn(&'a R) -> K,
    ) -> Matched<'a, R> {
        let after: Vec<&'a R> = after.into_iter().collect();
        let mut open: BTreeMap<K, &'a R> = after.iter().map(|row| (key(row), *row)).collect();
        let (mut both, mut only_before) = (Vec::new(), Vec::new());
        for row in before {
            match open.remove(&key(row)) {
                Some(other) => both.push((row, other)),
                None => only_before.push(row),
            }
        }
        Matched {
            both,
            only_before,
            only_after: after
                .into_iter()
                .filter(|row| open.contains_key(&key(row)))
                .collect(),
        }
    }
}

/// A figure in two runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Its name.
    pub figure: String,
    /// Which values are better.
    pub better: Direction,
    /// Its value in the first run.
    pub before: f64,
    /// Its value in the second.
    pub after: f64,
}

impl Change {
    /// Of a figure.
    pub fn new(figure: &Figure, before: f64, after: f64) -> Change {
        Change {
            figure: figure.name.clone(),
            better: figure.better,
            before,
            after,
        }
    }

    /// Whether both are the same.
    pub fn is_none(&self) -> bool {
        equal(self.before, self.after)
    }

    /// Whether both are defined.
    pub fn is_defined(&self) -> bool {
        !self.before.is_nan() && !self.after.is_nan()
    }

    /// How much better the second run is, in the figure's unit; negative when it is worse.
    pub fn gain(&self) -> f64 {
        self.better.gain(self.before, self.after)
    }
}

/// Equal values; undefined figures are equal to each other.
pub fn equal(before: f64, after: f64) -> bool {
    before == after || (before.is_nan() && after.is_nan())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::MetricSet;

    #[test]
    fn rows_find_each_other() {
        let (before, after) = ([3, 1, 2], [4, 2, 3]);
        let matched = Matched::new(&before, &after, |row| *row);
        assert_eq!(matched.both, [(&3, &3), (&2, &2)]);
        assert_eq!((matched.only_before, matched.only_after), (vec![&1], vec![&4]));
    }

    #[test]
    fn the_table_says_what_is_better() {
        let metrics = MetricSet::builtin();
        let gain = |name: &str| Change::new(metrics.figure(name).unwrap(), 1.0, 3.0).gain();
        assert_eq!(["sr_5", "auc", "frames_per_failure"].map(gain), [2.0; 3]);
        assert_eq!(["al_median", "failures", "jaccard_mean"].map(gain), [-2.0; 3]);
        assert!(equal(f64::NAN, f64::NAN) && !equal(f64::NAN, 0.0));
    }
}
