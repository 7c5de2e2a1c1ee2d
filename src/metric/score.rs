//! Figures of a set of frames: success rates, areas under their curve, averages. Depends on [`crate::metric::error`] alone.
//!
//! Every figure is computed from sorted errors, so it does not depend on the order of the frames.

use crate::metric::error::{FrameError, Metric, round6};
use serde::{Deserialize, Deserializer, Serialize};

/// A frame whose alignment error exceeds this many pixels is a failure; means are capped here.
pub const LOST_PX: f64 = 20.0;

/// What is made of the errors of a set of frames: name, unit and description, for `list metrics`.
pub const FIGURES: [[&str; 3]; 7] = [
    [
        "sr_T",
        "",
        "fraction of the evaluated frames with al <= T px; a frame without output is above every T",
    ],
    ["auc", "", "mean of sr_T over T = 0.2, 0.4, ..., 20 px"],
    ["sr_area", "px", "area under sr_T from 1 to 20 px, at most 18.99"],
    [
        "M_mean, M_median",
        "as M",
        "of al, mcd, cl, jaccard, grid; each frame of a mean capped at 20 px (1 for jaccard), no output counts as the cap",
    ],
    ["al_tracked", "px", "mean al of the frames at or below 20 px"],
    [
        "failures",
        "frames",
        "evaluated frames with al > 20 px or no output; with reinit, failures after which a tracker is started anew: they count in sr_T and auc, not in mean and median errors",
    ],
    [
        "frames_per_failure",
        "frames",
        "with reinit: evaluated frames / (failures + 1), the mean length of a stretch",
    ],
];

/// Points of a success curve: 0 to 20 px in steps of 0.2 px (0 to 1 in steps of 0.01 for the Jaccard distance).
pub const CURVE_POINTS: usize = 101;

/// Threshold `k` (below [`CURVE_POINTS`]) of a metric's success curve, in the metric's unit.
pub fn threshold(metric: Metric, k: usize) -> f64 {
    // One correctly rounded division: 0.2 k is the double nearest to the decimal, so `<=` is exact on rounded errors.
    k as f64 / if metric == Metric::Jaccard { 100.0 } else { 5.0 }
}

/// The thresholds of a metric's success curve.
pub fn thresholds(metric: Metric) -> Vec<f64> {
    (0..CURVE_POINTS).map(|k| threshold(metric, k)).collect()
}

/// The worst value a frame can contribute to a mean: 20 px, or a Jaccard distance of 1.
fn cap(metric: Metric) -> f64 {
    if metric == Metric::Jaccard { 1.0 } else { LOST_PX }
}

/// The errors of a set of frames, sorted per metric; frames without (finite) output are infinite.
#[derive(Clone, Debug)]
pub struct Sample {
    sorted: [Vec<f64>; 5],
    restarted: bool,
}

impl Sample {
    /// Sorts the errors of scored frames; `None` is a frame without output. `grid` holds the errors over a dense grid of
    /// the frames that have one.
    pub fn new<'a>(
        errors: impl IntoIterator<Item = &'a Option<FrameError>>,
        grid: impl IntoIterator<Item = f64>,
    ) -> Sample {
        let mut sorted: [Vec<f64>; 5] = Default::default();
        for error in errors {
            let values = error.map(|e| e.values());
            let finite = values.filter(|v| v.iter().all(|v| v.is_finite()));
            for (list, value) in sorted.iter_mut().zip(finite.unwrap_or([f64::INFINITY; 4])) {
                list.push(value);
            }
        }
        sorted[Metric::Grid as usize].extend(grid);
        sorted
            .iter_mut()
            .for_each(|values| values.sort_unstable_by(f64::total_cmp));
        Sample {
            sorted,
            restarted: false,
        }
    }

    /// The same frames as those of trackers that are started anew after each failure
    /// ([`Protocol::Reinit`](super::Protocol::Reinit)): the frames without output are the failures. They count in success
    /// rates, but have no part in means and medians.
    pub fn restarted(mut self) -> Sample {
        self.restarted = true;
        self
    }

    fn sorted(&self, metric: Metric) -> &[f64] {
        &self.sorted[metric as usize]
    }

    /// The errors that are averaged.
    fn averaged(&self, metric: Metric) -> &[f64] {
        let all = self.sorted(metric);
        match self.restarted {
            true => &all[..all.partition_point(|e| e.is_finite())],
            false => all,
        }
    }

    /// Failures: frames with an alignment error above 20 px or without output; for restarted trackers, those that ended a
    /// stretch.
    pub fn failures(&self) -> usize {
        match self.restarted {
            true => self.frames() - self.averaged(Metric::Al).len(),
            false => self.frames() - self.within(Metric::Al, LOST_PX),
        }
    }

    /// Metrics that at least one frame has a value of, besides those of the corners.
    pub fn metrics(&self) -> impl Iterator<Item = Metric> {
        let dense = !self.sorted(Metric::Grid).is_empty();
        Metric::ALL
            .into_iter()
            .filter(move |&m| m != Metric::Grid || dense)
    }

    /// Number of scored frames.
    pub fn frames(&self) -> usize {
        self.sorted[0].len()
    }

    /// Frames whose error is at most `t`.
    fn within(&self, metric: Metric, t: f64) -> usize {
        self.sorted(metric).partition_point(|&e| e <= t)
    }

    /// `SR(t)`: fraction of the frames with error `<= t`; NaN without frames.
    pub fn success_rate(&self, metric: Metric, t: f64) -> f64 {
        self.within(metric, t) as f64 / self.sorted(metric).len() as f64
    }

    /// `SR` at the [`thresholds`] of the metric, rounded to 1e-6.
    pub fn curve(&self, metric: Metric) -> Vec<f64> {
        (0..CURVE_POINTS)
            .map(|k| round6(self.success_rate(metric, threshold(metric, k))))
            .collect()
    }

    /// Area under the success curve as the mean of `SR(t)` over the 100 thresholds above 0, in `[0, 1]`.
    pub fn auc(&self, metric: Metric) -> f64 {
        let hits: usize = (1..CURVE_POINTS)
            .map(|k| self.within(metric, threshold(metric, k)))
            .sum();
        hits as f64 / (100 * self.sorted(metric).len()) as f64
    }

    /// Trapezoid area under `SR` of the alignment error over the points of `linspace(0, 20, 100)` in `[1, 20]` px:
    /// MTF's legend number, 18.99 for a perfect tracker.
    pub fn sr_area(&self) -> f64 {
        let t = |i: usize| 20.0 * i as f64 / 99.0;
        let first = (0..100).find(|&i| t(i) >= 1.0).unwrap_or(0);
        let twice: usize = (first..99)
            .map(|i| self.within(Metric::Al, t(i)) + self.within(Metric::Al, t(i + 1)))
            .sum();
        twice as f64 / self.frames() as f64 * (20.0 / 99.0) / 2.0
    }

    /// Mean with each frame capped at 20 px (1 for Jaccard); frames without output count as the cap.
    pub fn mean(&self, metric: Metric) -> f64 {
        let values = self.averaged(metric);
        values.iter().map(|e| e.min(cap(metric))).sum::<f64>() / values.len() as f64
    }

    /// Mean alignment error over the frames within 20 px; NaN when there is none.
    pub fn al_tracked(&self) -> f64 {
        let tracked = &self.sorted(Metric::Al)[..self.within(Metric::Al, LOST_PX)];
        tracked.iter().sum::<f64>() / tracked.len() as f64
    }

    /// Uncapped median (mean of the middle two for an even count): infinite when at least half of the frames have no
    /// output, except Jaccard, where no output is 1. NaN without frames.
    pub fn median(&self, metric: Metric) -> f64 {
        let worst = if metric == Metric::Jaccard {
            1.0
        } else {
            f64::INFINITY
        };
        let values = self.averaged(metric);
        let (lower, upper) = match values.len() {
            0 => return f64::NAN,
            n => (values[(n - 1) / 2].min(worst), values[n / 2].min(worst)),
        };
        if upper.is_infinite() {
            upper
        } else {
            (lower + upper) / 2.0
        }
    }

    /// All figures, rounded to 1e-6.
    pub fn score(&self) -> Score {
        let sr = |t: f64| round6(self.success_rate(Metric::Al, t));
        let mean = |m| round6(self.mean(m));
        let median = |m| round6(self.median(m));
        Score {
            frames: self.frames(),
            sr_1: sr(1.0),
            sr_2: sr(2.0),
            sr_5: sr(5.0),
            sr_10: sr(10.0),
            sr_20: sr(20.0),
            auc: round6(self.auc(Metric::Al)),
            sr_area: round6(self.sr_area()),
            al_mean: mean(Metric::Al),
            al_median: median(Metric::Al),
            al_tracked: round6(self.al_tracked()),
            mcd_mean: mean(Metric::Mcd),
            mcd_median: median(Metric::Mcd),
            cl_mean: mean(Metric::Cl),
            cl_median: median(Metric::Cl),
            jaccard_mean: mean(Metric::Jaccard),
            jaccard_median: median(Metric::Jaccard),
            grid_mean: mean(Metric::Grid),
            grid_median: median(Metric::Grid),
            failures: self.failures(),
            frames_per_failure: match self.restarted {
                true => round6(self.frames() as f64 / (self.failures() + 1) as f64),
                false => f64::NAN,
            },
        }
    }
}

/// The figures of a set of frames, each rounded to 1e-6. `sr_*`, `auc` and `sr_area` are of the alignment error.
/// NaN: undefined (no scored frame; no tracked frame for `al_tracked`; no dense truth for `grid_*`; no starting anew after
/// failures for `frames_per_failure`), empty in CSV and `null` in JSON. Infinite medians are `inf` in CSV and `null` in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // sr_T, M_mean and M_median repeat one sentence each: see `Sample`.
pub struct Score {
    /// Scored frames: annotated, not initial and not skipped; and all failures that a tracker was started anew after.
    pub frames: usize,
    #[serde(deserialize_with = "nan")]
    pub sr_1: f64,
    #[serde(deserialize_with = "nan")]
    pub sr_2: f64,
    #[serde(deserialize_with = "nan")]
    pub sr_5: f64,
    #[serde(deserialize_with = "nan")]
    pub sr_10: f64,
    #[serde(deserialize_with = "nan")]
    pub sr_20: f64,
    /// See [`Sample::auc`].
    #[serde(deserialize_with = "nan")]
    pub auc: f64,
    /// See [`Sample::sr_area`], px.
    #[serde(deserialize_with = "nan")]
    pub sr_area: f64,
    #[serde(deserialize_with = "nan")]
    pub al_mean: f64,
    #[serde(deserialize_with = "infinite")]
    pub al_median: f64,
    /// See [`Sample::al_tracked`], px.
    #[serde(deserialize_with = "nan")]
    pub al_tracked: f64,
    #[serde(deserialize_with = "nan")]
    pub mcd_mean: f64,
    #[serde(deserialize_with = "infinite")]
    pub mcd_median: f64,
    #[serde(deserialize_with = "nan")]
    pub cl_mean: f64,
    #[serde(deserialize_with = "infinite")]
    pub cl_median: f64,
    #[serde(deserialize_with = "nan")]
    pub jaccard_mean: f64,
    #[serde(deserialize_with = "nan")]
    pub jaccard_median: f64,
    #[serde(deserialize_with = "nan")]
    pub grid_mean: f64,
    #[serde(deserialize_with = "infinite")]
    pub grid_median: f64,
    /// See [`Sample::failures`].
    pub failures: usize,
    /// Mean length of the `failures + 1` stretches of tracking, frames: `frames / (failures + 1)`.
    #[serde(default = "undefined", deserialize_with = "nan")]
    pub frames_per_failure: f64,
}

fn undefined() -> f64 {
    f64::NAN
}

fn nan<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(d)?.unwrap_or(f64::NAN))
}

fn infinite<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(d)?.unwrap_or(f64::INFINITY))
}

impl Score {
    /// Column names, in the order of files and of [`Score::values`].
    pub const COLUMNS: [&'static str; 21] = [
        "frames",
        "sr_1",
        "sr_2",
        "sr_5",
        "sr_10",
        "sr_20",
        "auc",
        "sr_area",
        "al_mean",
        "al_median",
        "al_tracked",
        "mcd_mean",
        "mcd_median",
        "cl_mean",
        "cl_median",
        "jaccard_mean",
        "jaccard_median",
        "grid_mean",
        "grid_median",
        "failures",
        "frames_per_failure",
    ];

    /// The figures in the order of [`Score::COLUMNS`].
    pub fn values(&self) -> [f64; 21] {
        [
            self.frames as f64,
            self.sr_1,
            self.sr_2,
            self.sr_5,
            self.sr_10,
            self.sr_20,
            self.auc,
            self.sr_area,
            self.al_mean,
            self.al_median,
            self.al_tracked,
            self.mcd_mean,
            self.mcd_median,
            self.cl_mean,
            self.cl_median,
            self.jaccard_mean,
            self.jaccard_median,
            self.grid_mean,
            self.grid_median,
            self.failures as f64,
            self.frames_per_failure,
        ]
    }

    /// The figure called `column`, if there is one.
    pub fn get(&self, column: &str) -> Option<f64> {
        let index = Score::COLUMNS.iter().position(|c| *c == column)?;
        Some(self.values()[index])
    }

    /// Mean of each figure over `scores` that have frames (and in which it is defined); `frames` and `failures` are
    /// sums.
    pub fn mean(scores: &[Score]) -> Score {
        let scored: Vec<&Score> = scores.iter().filter(|s| s.frames > 0).collect();
        let mean = |f: fn(&Score) -> f64| {
            let defined: Vec<f64> = scored.iter().map(|s| f(s)).filter(|v| !v.is_nan()).collect();
            round6(defined.iter().sum::<f64>() / defined.len() as f64)
        };
        Score {
            frames: scored.iter().map(|s| s.frames).sum(),
            sr_1: mean(|s| s.sr_1),
            sr_2: mean(|s| s.sr_2),
            sr_5: mean(|s| s.sr_5),
            sr_10: mean(|s| s.sr_10),
            sr_20: mean(|s| s.sr_20),
            auc: mean(|s| s.auc),
            sr_area: mean(|s| s.sr_area),
            al_mean: mean(|s| s.al_mean),
            al_median: mean(|s| s.al_median),
            al_tracked: mean(|s| s.al_tracked),
            mcd_mean: mean(|s| s.mcd_mean),
            mcd_median: mean(|s| s.mcd_median),
            cl_mean: mean(|s| s.cl_mean),
            cl_median: mean(|s| s.cl_median),
            jaccard_mean: mean(|s| s.jaccard_mean),
            jaccard_median: mean(|s| s.jaccard_median),
            grid_mean: mean(|s| s.grid_mean),
            grid_median: mean(|s| s.grid_median),
            failures: scored.iter().map(|s| s.failures).sum(),
            frames_per_failure: mean(|s| s.frames_per_failure),
        }
    }

    /// Undoes what JSON cannot say: a `null` median of an empty set is undefined, not infinite.
    pub(crate) fn after_reading(mut self) -> Score {
        // Only restarted trackers can have frames and no average.
        if self.frames == 0 || self.al_mean.is_nan() {
            (self.al_median, self.mcd_median, self.cl_median) = (f64::NAN, f64::NAN, f64::NAN);
        }
        if self.grid_mean.is_nan() {
            self.grid_median = f64::NAN;
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use proptest::prelude::*;

    fn error(al: f64) -> Option<FrameError> {
        Some(FrameError {
            al,
            mcd: al / 2.0,
            cl: al / 4.0,
            jaccard: (al / 100.0).min(1.0),
        })
    }

    fn score(errors: &[Option<FrameError>]) -> Score {
        Sample::new(errors, []).score()
    }

    #[test]
    fn perfect() {
        let sample = Sample::new(&[error(0.0), error(0.0)], [0.0]);
        for metric in Metric::ALL {
            assert_eq!(sample.success_rate(metric, 0.0), 1.0);
            assert_eq!(sample.curve(metric), vec![1.0; 101]);
            assert!(sample.metrics().any(|m| m == metric));
        }
        let s = sample.score();
        assert_eq!(
            (s.sr_1, s.auc, s.al_mean, s.al_median, s.failures),
            (1.0, 1.0, 0.0, 0.0, 0)
        );
        // linspace(0, 20, 100) from its first point at or above 1 (1.0101) to 20.
        assert_abs_diff_eq!(s.sr_area, 18.989899, epsilon = 1e-6);
    }

    #[test]
    fn by_hand() {
        // 0.2 and 20 sit on thresholds; 30 is lost; one frame has no output.
        let s = score(&[error(30.0), error(0.2), None, error(20.0), error(5.000001)]);
        assert_eq!((s.frames, s.failures), (5, 2));
        assert_eq!(
            (s.sr_1, s.sr_2, s.sr_5, s.sr_10, s.sr_20),
            (0.2, 0.2, 0.2, 0.4, 0.6)
        );
        // Thresholds at or above each error: 100 for 0.2, 75 for 5.000001 (5.2, ..., 20), 1 for 20.
        assert_eq!(s.auc, (100 + 75 + 1) as f64 / 500.0);
        assert_abs_diff_eq!(
            s.al_mean,
            (0.2 + 5.000001 + 20.0 + 20.0 + 20.0) / 5.0,
            epsilon = 1e-6
        );
        assert_eq!(s.al_median, 20.0);
        assert_abs_diff_eq!(s.al_tracked, (0.2 + 5.000001 + 20.0) / 3.0, epsilon = 1e-6);
        assert_abs_diff_eq!(s.mcd_mean, (0.1 + 2.5 + 10.0 + 15.0 + 20.0) / 5.0, epsilon = 2e-6);
        assert_abs_diff_eq!(
            s.jaccard_mean,
            (0.002 + 0.05 + 0.2 + 0.3 + 1.0) / 5.0,
            epsilon = 1e-6
        );
    }

    #[test]
    fn sr_area_by_hand() {
        // Error 10: success from linspace point 50 (10.101) on; 49 full steps and half of the one before.
        assert_abs_diff_eq!(score(&[error(10.0)]).sr_area, 49.5 * 20.0 / 99.0, epsilon = 1e-6);
    }

    #[test]
    fn medians_see_missing_output_as_infinite() {
        assert_eq!(score(&[error(1.0), None]).al_median, f64::INFINITY);
        assert_eq!(score(&[error(1.0), error(2.0), None]).al_median, 2.0);
        assert_eq!(score(&[error(1.0), error(400.0)]).al_median, 200.5);
        assert_eq!(score(&[None, None]).jaccard_median, 1.0);
        // No output is not within any threshold, not even a Jaccard distance of 1.
        assert_eq!(Sample::new(&[None], []).success_rate(Metric::Jaccard, 1.0), 0.0);
    }

    #[test]
    fn nothing_tracked_and_nothing_scored() {
        let lost = score(&[error(50.0), None]);
        assert_eq!((lost.auc, lost.al_mean, lost.failures), (0.0, 20.0, 2));
        assert!(lost.al_tracked.is_nan());
        let empty = score(&[]);
        assert_eq!((empty.frames, empty.failures), (0, 0));
        assert!(empty.sr_5.is_nan() && empty.al_median.is_nan() && empty.auc.is_nan());
        // Neither drags the mean over sequences.
        let mean = Score::mean(&[score(&[error(0.0)]), lost, empty]);
        assert_eq!(
            (mean.frames, mean.sr_5, mean.al_tracked, mean.failures),
            (3, 0.5, 0.0, 2)
        );
    }

    #[test]
    fn restarted_trackers_fail_and_are_averaged_without_it() {
        let errors = [error(1.0), None, error(3.0), error(25.0), None];
        let s = Sample::new(&errors, [0.5, f64::INFINITY]).restarted().score();
        assert_eq!((s.frames, s.failures, s.frames_per_failure), (5, 2, 1.666667));
        // An error of 25 px is no failure where more is allowed.
        assert_eq!((s.sr_1, s.sr_5, s.sr_20), (0.2, 0.4, 0.4));
        assert_eq!((s.al_mean, s.al_median, s.al_tracked), (8.0, 3.0, 2.0));
        assert_eq!((s.grid_mean, s.grid_median), (0.5, 0.5));
        let lost = Sample::new(&[None, None], []).restarted().score();
        assert_eq!((lost.frames, lost.failures, lost.auc), (2, 2, 0.0));
        assert!(lost.al_mean.is_nan() && lost.al_median.is_nan() && lost.jaccard_mean.is_nan());
        assert!(score(&errors).frames_per_failure.is_nan());
    }

    #[test]
    fn infinite_errors_are_missing_output() {
        let inf = Some(FrameError {
            al: f64::INFINITY,
            mcd: f64::INFINITY,
            cl: f64::INFINITY,
            jaccard: 1.0,
        });
        // Compared as text, since NaN differs from itself.
        assert_eq!(format!("{:?}", score(&[inf])), format!("{:?}", score(&[None])));
    }

    #[test]
    fn dense_truth_counts_its_own_frames() {
        let s = Sample::new(&[error(1.0), error(2.0), None], [0.5, f64::INFINITY]);
        assert_eq!(
            (s.success_rate(Metric::Grid, 1.0), s.score().grid_mean),
            (0.5, 10.25)
        );
        assert_eq!(s.score().grid_median, f64::INFINITY);
        assert!(score(&[error(1.0)]).grid_mean.is_nan());
    }

    proptest! {
        #[test]
        fn laws(errors in prop::collection::vec(prop::option::weighted(0.9, 0.0..40.0f64), 1..60)) {
            let errors: Vec<_> = errors.into_iter().map(|e| e.and_then(error)).collect();
            let sample = Sample::new(&errors, []);
            prop_assert_eq!(sample.metrics().count(), 4);
            for metric in sample.metrics() {
                let curve = sample.curve(metric);
                prop_assert!(curve.windows(2).all(|w| w[0] <= w[1]));
                prop_assert!(curve.iter().all(|r| (0.0..=1.0).contains(r)));
                prop_assert!((0.0..=1.0).contains(&sample.auc(metric)));
                let mean = curve[1..].iter().sum::<f64>() / 100.0;
                prop_assert!((sample.auc(metric) - mean).abs() < 1e-6);
            }
            let s = sample.score();
            prop_assert!((0.0..=18.99).contains(&s.sr_area));
            prop_assert_eq!(s.failures, s.frames - (s.sr_20 * s.frames as f64).round() as usize);
            let mut reversed = errors.clone();
            reversed.reverse();
            prop_assert_eq!(format!("{s:?}"), format!("{:?}", Sample::new(&reversed, []).score()));
        }
    }
}
