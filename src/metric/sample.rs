//! The errors of a set of frames, sorted, and the formulas of all figures.
//!
//! Every figure is computed from sorted errors, so it does not depend on the order of the frames. Metrics go by their
//! number in the [`MetricSet`]; 0 is the primary one, the alignment error.

use crate::metric::al::LOST_PX;
use crate::metric::set::{CURVE_POINTS, round6};
use crate::metric::{Errors, Metric, MetricSet, Score};

/// Number of the primary metric.
const PRIMARY: usize = 0;

/// The errors of a set of frames.
#[derive(Clone, Debug)]
pub struct Sample {
    metrics: MetricSet,
    /// Best first for each metric: values of which smaller is better, or their negatives; infinite without output.
    sorted: Vec<Vec<f64>>,
    frames: usize,
    /// Of them, those without output.
    lost: usize,
    restarted: bool,
}

impl Sample {
    /// Sorts the errors of evaluated frames.
    pub fn new<'a>(metrics: &MetricSet, errors: impl IntoIterator<Item = &'a Errors>) -> Sample {
        let mut sorted: Vec<Vec<f64>> = vec![Vec::new(); metrics.metrics().len()];
        for errors in errors {
            for (index, (list, metric)) in sorted.iter_mut().zip(metrics.metrics()).enumerate() {
                let sign = metric.better.sign();
                list.extend(errors.list(index).iter().map(|value| sign * value));
            }
        }
        sorted
            .iter_mut()
            .for_each(|values| values.sort_unstable_by(f64::total_cmp));
        let primary = &sorted[PRIMARY];
        Sample {
            metrics: metrics.clone(),
            frames: primary.len(),
            lost: primary.len() - primary.partition_point(|e| e.is_finite()),
            sorted,
            restarted: false,
        }
    }

    /// The same frames as those of a tracker whose answers are upright boxes: of metrics that are not
    /// [of boxes](crate::metric::Metric::of_boxes) no frame has a value, and failures are the frames without output.
    pub fn of_boxes(mut self) -> Sample {
        let metrics = self.metrics.metrics().iter().zip(&mut self.sorted);
        metrics
            .filter(|(metric, _)| !metric.of_boxes)
            .for_each(|(_, values)| values.clear());
        self
    }

    /// The same frames as those of trackers that are started anew after each failure: the frames without output are the
    /// failures. They count in success rates, but have no part in means and medians.
    pub fn restarted(mut self) -> Sample {
        self.restarted = true;
        self
    }

    fn sign(&self, metric: usize) -> f64 {
        self.metrics.metrics()[metric].better.sign()
    }

    /// The errors that are averaged.
    fn averaged(&self, metric: usize) -> &[f64] {
        let all = &self.sorted[metric];
        match self.restarted {
            true => &all[..all.partition_point(|e| e.is_finite())],
            false => all,
        }
    }

    /// Failures: frames with an alignment error above 20 px or without output; for restarted trackers, those that ended a
    /// stretch.
    pub fn failures(&self) -> usize {
        match self.restarted {
            false if self.has(PRIMARY) => self.frames - self.within(PRIMARY, LOST_PX),
            _ => self.lost,
        }
    }

    /// Mean length of the `failures + 1` stretches of tracking of restarted trackers, frames: `frames / (failures + 1)`; NaN
    /// for others.
    pub fn frames_per_failure(&self) -> f64 {
        match self.restarted {
            true => self.frames() as f64 / (self.failures() + 1) as f64,
            false => f64::NAN,
        }
    }

    /// Numbers of the metrics that every frame has, and of those that at least one frame has.
    pub fn measured(&self) -> impl Iterator<Item = usize> {
        let metrics = self.metrics.metrics().iter().zip(&self.sorted).enumerate();
        let of_every_frame = |m: &Metric| !m.is_dense() && self.frames == 0;
        metrics.filter_map(move |(index, (m, values))| {
            (of_every_frame(m) || !values.is_empty()).then_some(index)
        })
    }

    /// Whether there are values of the metric.
    fn has(&self, metric: usize) -> bool {
        !self.sorted[metric].is_empty()
    }

    /// Number of evaluated frames.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Frames whose value is at `t` or better.
    fn within(&self, metric: usize, t: f64) -> usize {
        let t = self.sign(metric) * t;
        self.sorted[metric].partition_point(|&e| e <= t)
    }

    /// `SR(t)`: fraction of the frames whose error is `<= t` (whose value is `>= t` where larger is better); NaN without
    /// frames.
    pub fn success_rate(&self, metric: usize, t: f64) -> f64 {
        self.within(metric, t) as f64 / self.sorted[metric].len() as f64
    }

    /// `SR` at the [thresholds](crate::metric::Metric::thresholds) of the metric, rounded to 1e-6; empty without frames.
    pub fn curve(&self, metric: usize) -> Vec<f64> {
        if self.sorted[metric].is_empty() {
            return Vec::new();
        }
        let at = |k: usize| self.metrics.metrics()[metric].threshold(k);
        let rate = |k: usize| round6(self.success_rate(metric, at(k)));
        (0..CURVE_POINTS).map(rate).collect()
    }

    /// Area under the success curve as the mean of `SR(t)` over the 100 thresholds above 0, in `[0, 1]`.
    pub fn auc(&self, metric: usize) -> f64 {
        let at = |k: usize| self.metrics.metrics()[metric].threshold(k);
        let hits: usize = (1..CURVE_POINTS).map(|k| self.within(metric, at(k))).sum();
        hits as f64 / ((CURVE_POINTS - 1) * self.sorted[metric].len()) as f64
    }

    /// `∫ SR(t) dt` of the alignment error over `t` from 1 to 20 px, px; 19 for a perfect tracker. `SR` is a step function,
    /// so the integral is exact: a frame of error `e` within 20 px adds `20 - max(e, 1)`, divided by the number of frames.
    pub fn sr_area(&self) -> f64 {
        let tracked = &self.sorted[PRIMARY][..self.within(PRIMARY, LOST_PX)];
        // The sum of nothing would be -0.
        let area = tracked.iter().fold(0.0, |area, e| area + (LOST_PX - e.max(1.0)));
        area / self.sorted[PRIMARY].len() as f64
    }

    /// Mean with each frame capped at the metric's [cap](crate::metric::Metric::cap); frames without output count as the cap.
    pub fn mean(&self, metric: usize) -> f64 {
        let values = self.averaged(metric);
        let sign = self.sign(metric);
        let cap = sign * self.metrics.metrics()[metric].cap;
        sign * (values.iter().map(|e| e.min(cap)).sum::<f64>() / values.len() as f64)
    }

    /// Mean alignment error over the frames within 20 px; NaN when there is none.
    pub fn al_tracked(&self) -> f64 {
        let tracked = &self.sorted[PRIMARY][..self.within(PRIMARY, LOST_PX)];
        tracked.iter().sum::<f64>() / tracked.len() as f64
    }

    /// Median, not capped (mean of the middle two for an even count), in which a frame without output counts as the
    /// metric's [`lost`](crate::metric::Metric::lost). Where that is infinite, so is the median when at least half of the
    /// frames have no output. A cap in its place would make no output better than an output beyond the cap. NaN without
    /// frames.
    pub fn median(&self, metric: usize) -> f64 {
        let sign = self.sign(metric);
        let worst = sign * self.metrics.metrics()[metric].lost;
        let values = self.averaged(metric);
        let (lower, upper) = match values.len() {
            0 => return f64::NAN,
            n => (values[(n - 1) / 2].min(worst), values[n / 2].min(worst)),
        };
        sign * if upper.is_infinite() {
            upper
        } else {
            (lower + upper) / 2.0
        }
    }

    /// The values of all figures, in the order of columns, not rounded.
    pub(crate) fn values(&self) -> Box<[f64]> {
        self.metrics.figures().iter().map(|f| f.of(self)).collect()
    }

    /// All figures, rounded to 1e-6.
    pub fn score(&self) -> Score {
        Score::new(&self.metrics, self.values())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::{Definition, Direction, Metric};
    use approx::assert_abs_diff_eq;
    use mtf::geom::Corners;
    use proptest::prelude::*;

    const JACCARD: usize = 3;
    const GRID: usize = 4;

    /// Frames with alignment errors `al`, half of that as mean corner distance and so on.
    fn errors(al: &[Option<f64>], grid: &[f64]) -> Errors {
        let row = |al: &f64| vec![*al, al / 2.0, al / 4.0, (al / 100.0).min(1.0)];
        let rows: Vec<_> = al.iter().map(|al| al.as_ref().map(row)).collect();
        let grid: Vec<_> = grid.iter().map(|e| e.is_finite().then_some(*e)).collect();
        Errors::from_rows(&MetricSet::builtin(), &rows, &grid).unwrap()
    }

    fn sample(al: &[Option<f64>], grid: &[f64]) -> Sample {
        Sample::new(&MetricSet::builtin(), [&errors(al, grid)])
    }

    fn score(al: &[Option<f64>]) -> Score {
        sample(al, &[]).score()
    }

    fn values<const N: usize>(score: &Score, names: [&str; N]) -> [f64; N] {
        names.map(|name| score[name])
    }

    #[test]
    fn perfect() {
        let sample = sample(&[Some(0.0), Some(0.0)], &[0.0]);
        assert_eq!(sample.measured().count(), 5);
        for metric in 0..5 {
            assert_eq!(sample.success_rate(metric, 0.0), 1.0);
            assert_eq!(sample.curve(metric), vec![1.0; 101]);
        }
        let s = sample.score();
        let names = ["sr_1", "auc", "al_mean", "al_median", "failures"];
        assert_eq!(values(&s, names), [1.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(s["sr_area"], 19.0);
    }

    #[test]
    fn by_hand() {
        // 0.2 and 20 sit on thresholds; 30 is lost; one frame has no output.
        let s = score(&[Some(30.0), Some(0.2), None, Some(20.0), Some(5.000001)]);
        assert_eq!(values(&s, ["frames", "failures"]), [5.0, 2.0]);
        let rates = ["sr_1", "sr_2", "sr_5", "sr_10", "sr_20"];
        assert_eq!(values(&s, rates), [0.2, 0.2, 0.2, 0.4, 0.6]);
        // Thresholds at or above each error: 100 for 0.2, 75 for 5.000001 (5.2, ..., 20), 1 for 20.
        assert_eq!(s["auc"], (100 + 75 + 1) as f64 / 500.0);
        let al_mean = (0.2 + 5.000001 + 20.0 + 20.0 + 20.0) / 5.0;
        assert_abs_diff_eq!(s["al_mean"], al_mean, epsilon = 1e-6);
        assert_eq!(s["al_median"], 20.0);
        assert_abs_diff_eq!(s["al_tracked"], (0.2 + 5.000001 + 20.0) / 3.0, epsilon = 1e-6);
        let mcd_mean = (0.1 + 2.5 + 10.0 + 15.0 + 20.0) / 5.0;
        assert_abs_diff_eq!(s["mcd_mean"], mcd_mean, epsilon = 2e-6);
        let jaccard_mean = (0.002 + 0.05 + 0.2 + 0.3 + 1.0) / 5.0;
        assert_abs_diff_eq!(s["jaccard_mean"], jaccard_mean, epsilon = 1e-6);
    }

    #[test]
    fn sr_area_by_hand() {
        // A success rate of 1 from 10 to 20 px, of 1/2 from 1 to 20 px, and none.
        assert_eq!(score(&[Some(10.0)])["sr_area"], 10.0);
        assert_eq!(score(&[Some(0.5), None])["sr_area"], 9.5);
        assert_eq!(score(&[Some(20.5), None])["sr_area"], 0.0);
    }

    #[test]
    fn sr_area_is_the_integral_from_1_to_20() {
        let al = [
            Some(0.3),
            Some(1.005),
            Some(2.75),
            Some(7.1),
            Some(19.99),
            Some(21.0),
            None,
        ];
        let sample = sample(&al, &[]);
        // The midpoint rule, by the definition of the success rate alone.
        let steps = 190_000;
        let width = 19.0 / f64::from(steps);
        let rates = (0..steps).map(|k| sample.success_rate(PRIMARY, 1.0 + (f64::from(k) + 0.5) * width));
        assert_abs_diff_eq!(sample.sr_area(), rates.sum::<f64>() * width, epsilon = 2e-4);
    }

    #[test]
    fn medians_see_missing_output_as_infinite() {
        assert_eq!(score(&[Some(1.0), None])["al_median"], f64::INFINITY);
        assert_eq!(score(&[Some(1.0), Some(2.0), None])["al_median"], 2.0);
        assert_eq!(score(&[Some(1.0), Some(400.0)])["al_median"], 200.5);
        assert_eq!(score(&[None, None])["jaccard_median"], 1.0);
        // No output is not within any threshold, not even a Jaccard distance of 1.
        assert_eq!(sample(&[None], &[]).success_rate(JACCARD, 1.0), 0.0);
    }

    #[test]
    fn nothing_tracked_and_nothing_scored() {
        let lost = score(&[Some(50.0), None]);
        assert_eq!(values(&lost, ["auc", "al_mean", "failures"]), [0.0, 20.0, 2.0]);
        assert!(lost["al_tracked"].is_nan());
        let empty = score(&[]);
        assert_eq!(values(&empty, ["frames", "failures"]), [0.0, 0.0]);
        assert!(empty["sr_5"].is_nan() && empty["al_median"].is_nan() && empty["auc"].is_nan());
        // Neither drags the mean over sequences.
        let values_of = |al: &[Option<f64>]| sample(al, &[]).values();
        let each = [&[Some(0.0)][..], &[Some(50.0), None], &[]].map(values_of);
        let mean = Score::mean(&MetricSet::builtin(), &each);
        let names = ["frames", "sr_5", "al_tracked", "failures"];
        assert_eq!(values(&mean, names), [3.0, 0.5, 0.0, 2.0]);
    }

    #[test]
    fn a_mean_over_sequences_is_rounded_once() {
        let two_thirds = || sample(&[Some(0.0), Some(0.0), None], &[]).values();
        let none = sample(&[None], &[]).values();
        // 4/9; of 0.666667, 0.666667 and 0 the mean is 0.444445.
        let mean = Score::mean(&MetricSet::builtin(), &[two_thirds(), two_thirds(), none]);
        assert_eq!(mean["sr_5"], 0.444444);
    }

    #[test]
    fn restarted_trackers_fail_and_are_averaged_without_it() {
        let al = [Some(1.0), None, Some(3.0), Some(25.0), None];
        let s = sample(&al, &[0.5, f64::INFINITY]).restarted().score();
        let names = ["frames", "failures", "frames_per_failure"];
        assert_eq!(values(&s, names), [5.0, 2.0, 1.666667]);
        // An error of 25 px is no failure where more is allowed.
        assert_eq!(values(&s, ["sr_1", "sr_5", "sr_20"]), [0.2, 0.4, 0.4]);
        assert_eq!(
            values(&s, ["al_mean", "al_median", "al_tracked"]),
            [8.0, 3.0, 2.0]
        );
        assert_eq!(values(&s, ["grid_mean", "grid_median"]), [0.5, 0.5]);
        let lost = sample(&[None, None], &[]).restarted().score();
        assert_eq!(values(&lost, ["frames", "failures", "auc"]), [2.0, 2.0, 0.0]);
        let undefined = values(&lost, ["al_mean", "al_median", "jaccard_mean"]);
        assert!(undefined.iter().all(|v| v.is_nan()));
        assert!(score(&al)["frames_per_failure"].is_nan());
    }

    #[test]
    fn dense_truth_counts_its_own_frames() {
        let sample = sample(&[Some(1.0), Some(2.0), None], &[0.5, f64::INFINITY]);
        assert_eq!(sample.success_rate(GRID, 1.0), 0.5);
        let s = sample.score();
        assert_eq!(values(&s, ["grid_mean", "grid_median"]), [10.25, f64::INFINITY]);
        assert!(score(&[Some(1.0)])["grid_mean"].is_nan());
    }

    #[test]
    fn larger_may_be_better() {
        let overlap = Metric {
            name: "overlap",
            unit: "",
            summary: "",
            better: Direction::LargerIsBetter,
            cap: 0.0,
            lost: 0.0,
            steps_per_unit: 100.0,
            tolerance: None,
            of_boxes: false,
            definition: Definition::Corners(|_, _| 1.0),
        };
        let metrics = MetricSet::builtin().with(overlap).unwrap();
        let row = |v: f64| Some(vec![0.0, 0.0, 0.0, 0.0, v]);
        let errors = Errors::from_rows(&metrics, &[row(0.9), row(0.5), None, row(1.0)], &[]).unwrap();
        let sample = Sample::new(&metrics, [&errors]);
        assert_eq!(sample.success_rate(5, 0.9), 0.5);
        assert_eq!(sample.curve(5)[0], 0.75);
        let s = sample.score();
        assert_eq!(values(&s, ["overlap_mean", "overlap_median"]), [0.6, 0.7]);
        let half = Errors::from_rows(&metrics, &[row(0.9), None], &[]).unwrap();
        assert_eq!(Sample::new(&metrics, [&half]).score()["overlap_median"], 0.45);
        let square = Corners::rect(0.0, 0.0, 1.0, 1.0);
        assert_eq!(metrics.frame_errors(&square, &square).last(), Some(1.0));
    }

    proptest! {
        #[test]
        fn laws(al in prop::collection::vec(prop::option::weighted(0.9, 0.0..40.0f64), 1..60)) {
            let sample = sample(&al, &[]);
            prop_assert_eq!(sample.measured().count(), 4);
            for metric in sample.measured() {
                let curve = sample.curve(metric);
                prop_assert!(curve.windows(2).all(|w| w[0] <= w[1]));
                prop_assert!(curve.iter().all(|r| (0.0..=1.0).contains(r)));
                prop_assert!((0.0..=1.0).contains(&sample.auc(metric)));
                let mean = curve[1..].iter().sum::<f64>() / 100.0;
                prop_assert!((sample.auc(metric) - mean).abs() < 1e-6);
            }
            let s = sample.score();
            prop_assert!((0.0..=19.0).contains(&s["sr_area"]));
            prop_assert_eq!(s["failures"], s["frames"] - (s["sr_20"] * s["frames"]).round());
            let mut reversed = al.clone();
            reversed.reverse();
            prop_assert_eq!(format!("{s:?}"), format!("{:?}", score(&reversed)));
        }
    }
}
