//! The errors of a set of evaluated frames, metric by metric.

use crate::metric::{Metric, MetricSet};
use mtf::geom::Corners;

/// The errors of evaluated frames: a list for each metric. Frames without (finite) output have the infinity that is worse
/// than every value.
#[derive(Clone, Debug, PartialEq)]
pub struct Errors {
    metrics: MetricSet,
    lists: Vec<Vec<f64>>,
}

impl Errors {
    /// No frames yet.
    pub fn new(metrics: &MetricSet) -> Errors {
        Errors {
            metrics: metrics.clone(),
            lists: vec![Vec::new(); metrics.metrics().len()],
        }
    }

    /// Of `frames` frames without output, `dense` of which are evaluated by dense ground truth.
    pub fn lost(metrics: &MetricSet, frames: usize, dense: usize) -> Errors {
        let list = |m: &Metric| vec![m.better.worst(); if m.is_dense() { dense } else { frames }];
        Errors {
            metrics: metrics.clone(),
            lists: metrics.metrics().iter().map(list).collect(),
        }
    }

    /// Adds a frame with ground truth; `None` is a frame without output. A frame in which one value is not finite has no
    /// output.
    pub fn push(&mut self, tracked: Option<&Corners>, truth: &Corners) {
        match tracked {
            Some(tracked) => {
                let values: Vec<f64> = self.metrics.frame_errors(tracked, truth).collect();
                self.push_values(&values);
            }
            None => self.push_lost(),
        }
    }

    /// Adds a frame of which the values of the metrics that each frame has are `values`. With one that is not finite it has
    /// no output.
    pub fn push_values(&mut self, values: &[f64]) {
        if values.iter().all(|value| value.is_finite()) {
            let mut values = values.iter();
            self.each(|list, _| list.extend(values.next()));
        } else {
            self.push_lost();
        }
    }

    /// Adds a frame without output.
    pub fn push_lost(&mut self) {
        self.each(|list, metric| list.push(metric.better.worst()));
    }

    /// Adds what [`MetricSet::dense_errors`] says of a frame.
    pub fn push_dense(&mut self, values: &[f64]) {
        let lists = self.lists.iter_mut().zip(self.metrics.metrics());
        let lists = lists.filter(|(_, m)| m.is_dense());
        lists.zip(values).for_each(|((list, _), value)| list.push(*value));
    }

    /// Adds a frame with dense ground truth and without output.
    pub fn push_dense_lost(&mut self) {
        let lists = self.lists.iter_mut().zip(self.metrics.metrics());
        lists
            .filter(|(_, m)| m.is_dense())
            .for_each(|(list, metric)| list.push(metric.better.worst()));
    }

    /// Every list of the metrics that each frame has.
    fn each(&mut self, mut change: impl FnMut(&mut Vec<f64>, &Metric)) {
        let lists = self.lists.iter_mut().zip(self.metrics.metrics());
        let lists = lists.filter(|(_, m)| !m.is_dense());
        lists.for_each(|(list, metric)| change(list, metric));
    }

    /// Appends the frames of `other`, which is of the same metrics.
    pub fn extend(&mut self, other: &Errors) {
        for (list, more) in self.lists.iter_mut().zip(&other.lists) {
            list.extend(more);
        }
    }

    /// What they are of.
    pub fn metrics(&self) -> &MetricSet {
        &self.metrics
    }

    /// The list of metric number `index`.
    pub fn list(&self, index: usize) -> &[f64] {
        &self.lists[index]
    }

    /// Frame by frame: the values of the metrics that each frame has; `None` without output.
    pub fn rows(&self) -> Vec<Option<Vec<f64>>> {
        let lists: Vec<&Vec<f64>> = self
            .lists
            .iter()
            .zip(self.metrics.metrics())
            .filter_map(|(list, m)| (!m.is_dense()).then_some(list))
            .collect();
        let row = |k: usize| {
            lists[0][k]
                .is_finite()
                .then(|| lists.iter().map(|l| l[k]).collect())
        };
        (0..self.lists[0].len()).map(row).collect()
    }

    /// Frame by frame, the values of the dense metrics; `None` without output.
    pub fn dense_rows(&self) -> Vec<Option<f64>> {
        let lists: Vec<&Vec<f64>> = self
            .lists
            .iter()
            .zip(self.metrics.metrics())
            .filter_map(|(list, m)| m.is_dense().then_some(list))
            .collect();
        let frames = lists.first().map_or(0, |list| list.len());
        let values = (0..frames).flat_map(|k| lists.iter().map(move |list| list[k]));
        values.map(|v| v.is_finite().then_some(v)).collect()
    }

    /// From what [`rows`](Self::rows) and [`dense_rows`](Self::dense_rows) gave; `None` when they are not of these metrics.
    pub fn from_rows(
        metrics: &MetricSet,
        rows: &[Option<Vec<f64>>],
        dense: &[Option<f64>],
    ) -> Option<Errors> {
        let mut errors = Errors::new(metrics);
        let width = metrics.of_every_frame().count();
        for row in rows {
            match row {
                None => errors.push_lost(),
                Some(values) if values.len() == width => errors.push_values(values),
                Some(_) => return None,
            }
        }
        let of_dense: Vec<&Metric> = metrics.dense().collect();
        if dense.is_empty() {
            return Some(errors);
        }
        let frames = dense.chunks_exact(of_dense.len().max(1));
        if !frames.remainder().is_empty() || of_dense.is_empty() {
            return None;
        }
        for frame in frames {
            let values = frame.iter().zip(&of_dense);
            let values: Vec<f64> = values.map(|(v, m)| v.unwrap_or(m.better.worst())).collect();
            errors.push_dense(&values);
        }
        Some(errors)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_value_that_is_not_finite_leaves_a_frame_without_output() {
        let metrics = MetricSet::builtin();
        for (k, bad) in [(0, f64::NAN), (1, f64::INFINITY), (3, f64::NAN)] {
            let mut values = [1.0, 2.0, 3.0, 0.5];
            values[k] = bad;
            let mut errors = Errors::new(&metrics);
            errors.push_values(&values);
            assert!(
                (0..4).all(|index| errors.list(index) == [f64::INFINITY]),
                "{errors:?}"
            );
            assert_eq!(errors.rows(), [None]);
        }
    }

    #[test]
    fn rows_come_back() {
        let metrics = MetricSet::builtin();
        let truth = Corners::rect(0.0, 0.0, 10.0, 10.0);
        let mut errors = Errors::new(&metrics);
        errors.push(Some(&truth.translated(3.0, 4.0)), &truth);
        errors.push(None, &truth);
        errors.push(Some(&truth.translated(f64::NAN, 0.0)), &truth);
        errors.push_dense(&[0.5]);
        errors.push_dense(&[f64::INFINITY]);
        let (rows, dense) = (errors.rows(), errors.dense_rows());
        assert_eq!(rows[0].as_ref().map(|r| r[..3].to_vec()), Some(vec![5.0; 3]));
        assert_eq!((rows.len(), &rows[1], &rows[2]), (3, &None, &None));
        assert_eq!(dense, [Some(0.5), None]);
        assert_eq!(Errors::from_rows(&metrics, &rows, &dense), Some(errors));
        assert_eq!(Errors::from_rows(&metrics, &[Some(vec![1.0])], &[]), None);
        assert_eq!(Errors::lost(&metrics, 2, 1).list(4), [f64::INFINITY]);
    }

    #[test]
    fn rows_of_two_dense_metrics_come_back() {
        let metrics = MetricSet::builtin();
        let second = Metric {
            name: "grid_b",
            better: crate::metric::Direction::LargerIsBetter,
            ..crate::metric::grid::METRIC
        };
        let metrics = metrics.with(second).unwrap();
        let mut errors = Errors::new(&metrics);
        for k in 0..3 {
            errors.push_values(&[1.0, 2.0, 3.0, 0.5]);
            errors.push_dense(&[f64::from(k), 10.0 + f64::from(k)]);
        }
        errors.push_lost();
        errors.push_dense_lost();
        let lists: Vec<&[f64]> = metrics
            .dense()
            .map(|m| {
                let index = metrics.metrics().iter().position(|other| other == m).unwrap();
                errors.list(index)
            })
            .collect();
        assert_eq!(lists[0], [0.0, 1.0, 2.0, f64::INFINITY]);
        assert_eq!(lists[1], [10.0, 11.0, 12.0, f64::NEG_INFINITY]);
        let (rows, dense) = (errors.rows(), errors.dense_rows());
        assert_eq!(dense.len(), 8);
        assert_eq!(Errors::from_rows(&metrics, &rows, &dense), Some(errors));
        // A frame that is not whole.
        assert_eq!(Errors::from_rows(&metrics, &rows, &dense[..7]), None);
        // Values of metrics that there are not.
        let plain = MetricSet::of(metrics.of_every_frame().copied().collect());
        assert_eq!(Errors::from_rows(&plain, &[], &[Some(1.0)]), None);
    }
}
