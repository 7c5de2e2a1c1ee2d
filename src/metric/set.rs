//! A metric, and the metrics of a run.

use crate::metric::figure::{self, Figure};
use crate::metric::{Direction, METRICS};
use mtf::geom::Corners;
use serde::{Serialize, Serializer};
use std::sync::Arc;

/// Points of a success curve: 0 and 100 steps.
pub const CURVE_POINTS: usize = 101;

/// The steps whose points of a success curve are kept in files: for the alignment error 0.2, 0.4, 0.6, 1, 2, 3, 4, 5, 10, 15
/// and 20 px. Curves bend near 0, and all points together would be most of a run directory.
pub const KEPT_STEPS: [usize; 11] = [1, 2, 3, 5, 10, 15, 20, 25, 50, 75, 100];

/// A metric: what it is called, what its values mean and how they are computed. A program may add its own to a
/// [`MetricSet`].
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Name in files and on the command line: lower-case letters, digits and `_`.
    pub name: &'static str,
    /// Unit for axis labels; empty for a ratio.
    pub unit: &'static str,
    /// One line for `list metrics`.
    pub summary: &'static str,
    /// Which values are better.
    pub better: Direction,
    /// The worst that a frame can contribute to a mean, in the metric's unit; a frame without output counts as this.
    pub cap: f64,
    /// What a frame without output counts as in a median: infinite, or the worst value of a metric that has one.
    pub lost: f64,
    /// The success curve has its thresholds at `k / steps_per_unit` for `k = 0, 1, ..., 100`.
    pub steps_per_unit: f64,
    /// By how much the median may get worse before the regression gate fails, where nobody says otherwise; `None`: the
    /// gate does not look at it.
    pub tolerance: Option<f64>,
    /// Whether it means something for answers that are upright boxes around the object.
    pub of_boxes: bool,
    /// How it is computed, and of which frames.
    pub definition: Definition,
}

/// How a metric is computed, and of which frames. Places are in image px. A value that is not finite counts as no output.
#[derive(Clone, Copy, Debug)]
pub enum Definition {
    /// Of every annotated frame, from its tracked corners and their truth (UL UR LR LL), which are finite.
    Corners(fn(&Corners, &Corners) -> f64),
    /// Of the frames of sequences with dense ground truth, from where the tracker has its points and where they truly
    /// are: two lists of one length.
    Dense(fn(&[[f64; 2]], &[[f64; 2]]) -> f64),
}

impl Metric {
    /// Threshold `k` (below [`CURVE_POINTS`]) of the success curve, in the metric's unit.
    pub fn threshold(&self, k: usize) -> f64 {
        // One correctly rounded division: k / 5 is the double nearest to the decimal, so `<=` is exact on rounded errors.
        k as f64 / self.steps_per_unit
    }

    /// The thresholds of the success curve.
    pub fn thresholds(&self) -> Vec<f64> {
        (0..CURVE_POINTS).map(|k| self.threshold(k)).collect()
    }

    /// Whether it is only known where there is dense ground truth.
    pub fn is_dense(&self) -> bool {
        matches!(self.definition, Definition::Dense(_))
    }

    /// Rounded to 1e-6, so that what is written is what is counted; the worst there is when it is not finite.
    fn value(&self, raw: f64) -> f64 {
        let rounded = round6(raw);
        if rounded.is_finite() {
            rounded
        } else {
            self.better.worst()
        }
    }
}

impl PartialEq for Metric {
    /// Of one name.
    fn eq(&self, other: &Metric) -> bool {
        self.name == other.name
    }
}

impl Serialize for Metric {
    /// As its name.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

/// Rounds to six decimals such that printing with six decimals and parsing gives the same number back.
pub(crate) fn round6(v: f64) -> f64 {
    if v.abs() < 1e9 {
        (v * 1e6).round() / 1e6
    } else {
        v.round()
    }
}

/// Why a metric cannot be added.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MetricError {
    /// The name cannot be a column.
    #[error("'{0}' is no name of a metric: lower-case letters, digits and _, beginning with a letter")]
    Name(&'static str),
    /// The name, or that of one of its figures, stands for something else already.
    #[error("there is a column '{0}' already")]
    Taken(String),
    /// Steps, cap or tolerance make no sense.
    #[error("{0}: its success curve needs steps above 0, its cap a number and its tolerance one >= 0")]
    Range(&'static str),
}

/// The metrics of a run and the figures that follow from them. Cheap to clone.
#[derive(Clone)]
pub struct MetricSet(Arc<Tables>);

struct Tables {
    metrics: Vec<Metric>,
    figures: Vec<Figure>,
}

impl Default for MetricSet {
    fn default() -> Self {
        MetricSet::builtin()
    }
}

impl std::fmt::Debug for MetricSet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list()
            .entries(self.metrics().iter().map(|m| m.name))
            .finish()
    }
}

impl PartialEq for MetricSet {
    fn eq(&self, other: &MetricSet) -> bool {
        self.metrics() == other.metrics()
    }
}

impl MetricSet {
    /// Those of [`METRICS`].
    pub fn builtin() -> MetricSet {
        MetricSet::of(METRICS.to_vec())
    }

    pub(super) fn of(metrics: Vec<Metric>) -> MetricSet {
        let figures = figure::expand(&metrics);
        MetricSet(Arc::new(Tables { metrics, figures }))
    }

    /// With one more metric, which comes last.
    ///
    /// # Errors
    /// Its name cannot be a column or is taken, or its numbers make no sense.
    pub fn with(&self, metric: Metric) -> Result<MetricSet, MetricError> {
        let valid = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        if !metric.name.starts_with(|c: char| c.is_ascii_lowercase()) || !metric.name.chars().all(valid) {
            return Err(MetricError::Name(metric.name));
        }
        let tolerable = metric.tolerance.is_none_or(|t| t >= 0.0);
        let steps = metric.steps_per_unit > 0.0 && metric.steps_per_unit.is_finite();
        if !(steps && metric.cap.is_finite() && tolerable && !metric.lost.is_nan()) {
            return Err(MetricError::Range(metric.name));
        }
        let mut metrics = self.metrics().to_vec();
        metrics.push(metric);
        let extended = MetricSet::of(metrics);
        let mut columns: Vec<&str> = figure::RESERVED.to_vec();
        columns.extend(extended.metrics().iter().map(|m| m.name));
        columns.extend(extended.figures().iter().map(|f| f.name.as_str()));
        columns.sort_unstable();
        match columns.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(twice) => Err(MetricError::Taken(twice[0].to_owned())),
            None => Ok(extended),
        }
    }

    /// All metrics, in the order in which files list them.
    pub fn metrics(&self) -> &[Metric] {
        &self.0.metrics
    }

    /// All figures, in the order of columns.
    pub fn figures(&self) -> &[Figure] {
        &self.0.figures
    }

    /// The metric that success rates, failures and rankings are of: the alignment error.
    pub fn primary(&self) -> &Metric {
        &self.0.metrics[0]
    }

    /// The metric called `name`.
    pub fn metric(&self, name: &str) -> Option<&Metric> {
        self.metrics().iter().find(|m| m.name == name)
    }

    /// The figure called `name`.
    pub fn figure(&self, name: &str) -> Option<&Figure> {
        self.figures().iter().find(|f| f.name == name)
    }

    /// The names of the metrics that a program has added to those of [`METRICS`].
    pub fn added_names(&self) -> Vec<String> {
        let added = self.metrics().iter().skip(METRICS.len());
        added.map(|m| m.name.to_owned()).collect()
    }

    /// The metrics that every annotated frame has.
    pub fn of_every_frame(&self) -> impl Iterator<Item = &Metric> {
        self.metrics().iter().filter(|m| !m.is_dense())
    }

    /// The metrics that need dense ground truth.
    pub fn dense(&self) -> impl Iterator<Item = &Metric> {
        self.metrics().iter().filter(|m| m.is_dense())
    }

    /// The values of [`of_every_frame`](Self::of_every_frame), each rounded to 1e-6; infinite on the bad side when corners
    /// or a value are not finite.
    pub fn frame_errors(&self, tracked: &Corners, truth: &Corners) -> impl Iterator<Item = f64> {
        let finite = tracked.is_finite() && truth.is_finite();
        self.metrics().iter().filter_map(move |m| match m.definition {
            Definition::Corners(error) if finite => Some(m.value(error(tracked, truth))),
            Definition::Corners(_) => Some(m.better.worst()),
            Definition::Dense(_) => None,
        })
    }

    /// The values of [`dense`](Self::dense) for points at `tracked` (`None`: no output) that truly are at `truth`, rounded
    /// likewise.
    pub fn dense_errors(&self, tracked: Option<&[[f64; 2]]>, truth: &[[f64; 2]]) -> Box<[f64]> {
        let value = |m: &Metric| match (m.definition, tracked) {
            (Definition::Dense(error), Some(tracked)) => Some(m.value(error(tracked, truth))),
            (Definition::Dense(_), None) => Some(m.better.worst()),
            (Definition::Corners(_), _) => None,
        };
        self.metrics().iter().filter_map(value).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn named(name: &'static str) -> Metric {
        Metric {
            name,
            ..crate::metric::cl::METRIC
        }
    }

    #[test]
    fn names_are_columns_of_their_own() {
        let set = MetricSet::builtin();
        for name in ["", "2d", "Angle", "a b", "a,b"] {
            assert_eq!(set.with(named(name)).unwrap_err(), MetricError::Name(name));
        }
        for name in ["al", "grid", "frames", "similarity", "tracker", "auc"] {
            assert_eq!(
                set.with(named(name)).unwrap_err(),
                MetricError::Taken(name.to_owned())
            );
        }
        let steps = Metric {
            steps_per_unit: 0.0,
            ..named("angle")
        };
        assert_eq!(set.with(steps).unwrap_err(), MetricError::Range("angle"));
        let set = set.with(named("angle")).unwrap();
        assert_eq!(set.added_names(), ["angle"]);
        assert_eq!(set.metric("angle"), set.metrics().last());
        assert!(set.figure("angle_mean").is_some() && set.with(named("angle")).is_err());
    }

    #[test]
    fn what_is_not_finite_is_no_output() {
        let set = MetricSet::builtin();
        let square = Corners::rect(10.0, 10.0, 10.0, 10.0);
        let mut broken = square;
        broken.0[2][1] = f64::NAN;
        assert!(set.frame_errors(&broken, &square).all(|e| e == f64::INFINITY));
        assert_eq!(set.frame_errors(&square, &square).collect::<Vec<_>>(), [0.0; 4]);
        assert_eq!(*set.dense_errors(None, &[[0.0; 2]]), [f64::INFINITY]);
        assert_eq!(
            *set.dense_errors(Some(&[[f64::NAN, 0.0]]), &[[0.0; 2]]),
            [f64::INFINITY]
        );
        assert_eq!(*set.dense_errors(Some(&[[3.0, 4.0]]), &[[0.0; 2]]), [5.0]);
    }

    proptest! {
        #[test]
        fn laws(v in prop::array::uniform8(-300.0..300.0f64), w in prop::array::uniform8(-300.0..300.0f64)) {
            let set = MetricSet::builtin();
            let (a, b) = (Corners::from_array(v), Corners::from_array(w));
            prop_assert_eq!(set.frame_errors(&a, &a).collect::<Vec<_>>(), [0.0; 4]);
            let e: Vec<f64> = set.frame_errors(&a, &b).collect();
            // RMS >= mean >= distance of the means.
            prop_assert!(e[0] >= e[1] - 2e-6 && e[1] >= e[2] - 2e-6);
            prop_assert!((0.0..=1.0).contains(&e[3]));
        }

        #[test]
        fn written_is_counted(v in 0.0..1e12f64) {
            let r = round6(v);
            prop_assert_eq!(format!("{r:.6}").parse::<f64>().unwrap(), r);
        }
    }
}
