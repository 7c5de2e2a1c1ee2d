//! From the errors of finished units (tracker x sequence x start frame) to the rows of result files.
//!
//! Rows are sorted (trackers by id, sequences by data set, name and start frame), so the result does not depend on
//! the order in which units finished.

use crate::metric::{Direction, Errors, Metric, MetricSet, Sample, Score};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A tracker's id and the parts it is made of (empty where a composite has none).
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TrackerName {
    /// Canonical expression.
    #[serde(rename = "tracker")]
    pub id: String,
    /// Search method.
    pub sm: String,
    /// Appearance model.
    pub am: String,
    /// State space model.
    pub ssm: String,
    /// Illumination model.
    pub ilm: String,
}

/// How a unit ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "status", content = "reason", rename_all = "lowercase")]
pub enum UnitStatus {
    /// Tracked to the end (losing the object is a result, too).
    Ok,
    /// The run died (panic, unreadable frame, ...); the reason.
    Failed(String),
}

impl UnitStatus {
    /// `ok` or `failed`.
    pub fn word(&self) -> &'static str {
        if self.is_failed() { "failed" } else { "ok" }
    }

    /// The reason of a failure; empty otherwise.
    pub fn reason(&self) -> &str {
        if let UnitStatus::Failed(reason) = self {
            reason
        } else {
            ""
        }
    }

    /// True for [`UnitStatus::Failed`].
    pub fn is_failed(&self) -> bool {
        matches!(self, UnitStatus::Failed(_))
    }
}

/// One tracker on one sequence from one start frame.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitResult {
    /// Who tracked.
    pub tracker: TrackerName,
    /// Data set.
    pub dataset: String,
    /// Sequence in the data set.
    pub sequence: String,
    /// Index of the initial frame.
    pub start: usize,
    /// Protocol: `ope`, `subseq:10`, ...
    pub protocol: String,
    /// Whether the protocol starts a tracker anew after a failure; see [`Sample::restarted`].
    pub restarted: bool,
    /// Whether the answers are upright boxes; see [`Sample::of_boxes`].
    pub boxes: bool,
    /// How the run ended.
    pub status: UnitStatus,
    /// Of the evaluated frames: annotated and not started on. No output: none or a non-finite one, or a failure that the
    /// tracker was started anew after. A failed run has no output in the frames it did not reach, as far as their number is
    /// known.
    pub errors: Errors,
}

/// What an aggregate averages over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Average {
    /// All frames of all sequences together: the primary average.
    Pooled,
    /// Mean over sequences of the figures of each (all its start frames pooled).
    SeqMean,
}

impl Average {
    /// `pooled` or `seq_mean`.
    pub fn name(self) -> &'static str {
        match self {
            Average::Pooled => "pooled",
            Average::SeqMean => "seq_mean",
        }
    }
}

/// Figures of one unit. Serialised without the tracker, under which files nest it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SequenceRow {
    /// Who tracked.
    #[serde(skip)]
    pub tracker: TrackerName,
    /// Data set.
    pub dataset: String,
    /// Sequence in the data set.
    pub sequence: String,
    /// Index of the initial frame.
    pub start: usize,
    /// Protocol.
    pub protocol: String,
    /// How the run ended.
    #[serde(flatten)]
    pub status: UnitStatus,
    /// Its figures; those of a failed run count the frames it did not reach as failures.
    #[serde(flatten)]
    pub score: Score,
}

/// Figures of one tracker over all its sequences. Serialised without the tracker, under which files nest it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SummaryRow {
    /// Who tracked.
    #[serde(skip)]
    pub tracker: TrackerName,
    /// Over frames or over sequences.
    pub average: Average,
    /// What the success rates are of: the primary metric.
    pub metric: Metric,
    /// Protocol.
    pub protocol: String,
    /// Distinct sequences.
    pub sequences: usize,
    /// Units: sequences x start frames.
    pub runs: usize,
    /// Units that failed to run.
    pub failed_runs: usize,
    /// The figures.
    #[serde(flatten)]
    pub score: Score,
}

/// A success curve at the [thresholds](Metric::thresholds) of its metric.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveRow {
    /// Who tracked.
    pub tracker: TrackerName,
    /// Data set; `all` in the pooled curve.
    pub dataset: String,
    /// Sequence (all its start frames pooled); `pooled` for all sequences of all data sets.
    pub sequence: String,
    /// Protocol.
    pub protocol: String,
    /// The error on the threshold axis.
    pub metric: Metric,
    /// `SR` at each threshold; empty when there are no frames.
    pub success_rate: Vec<f64>,
}

/// `dataset` of rows over all data sets.
pub const ALL_DATASETS: &str = "all";
/// `sequence` of rows over all sequences.
pub const POOLED: &str = "pooled";

impl CurveRow {
    /// True for the curve over all sequences.
    pub fn is_pooled(&self) -> bool {
        self.dataset == ALL_DATASETS && self.sequence == POOLED
    }
}

/// All rows of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Results {
    /// The metrics that all rows are of.
    pub metrics: MetricSet,
    /// A row per unit.
    pub sequences: Vec<SequenceRow>,
    /// Two rows (pooled, seq_mean) per tracker and protocol.
    pub summary: Vec<SummaryRow>,
    /// Per tracker and protocol: the pooled curve of every metric, then the alignment error's of each sequence.
    pub curves: Vec<CurveRow>,
    /// Tags of the sequences that have some, by `dataset/sequence`.
    pub tags: BTreeMap<String, Vec<String>>,
}

impl Results {
    /// The pooled rows, best `auc` first (then by id).
    pub fn ranking(&self) -> Vec<&SummaryRow> {
        let mut rows: Vec<&SummaryRow> = self
            .summary
            .iter()
            .filter(|r| r.average == Average::Pooled)
            .collect();
        let larger = Direction::LargerIsBetter;
        rows.sort_by(|a, b| {
            larger
                .order(a.score["auc"], b.score["auc"])
                .then_with(|| a.tracker.cmp(&b.tracker))
        });
        rows
    }

    /// Tags of a sequence.
    pub fn tags_of(&self, dataset: &str, sequence: &str) -> &[String] {
        self.tags
            .get(&format!("{dataset}/{sequence}"))
            .map_or(&[], Vec::as_slice)
    }

    /// Units that failed to run.
    pub fn failed_runs(&self) -> usize {
        self.sequences.iter().filter(|r| r.status.is_failed()).count()
    }
}

/// Computes every row from finished units. The order of `units` does not matter; each (tracker, data set, sequence,
/// start, protocol) must occur once.
pub fn aggregate(metrics: &MetricSet, units: &[UnitResult]) -> Results {
    let mut groups: BTreeMap<(&TrackerName, &str), Vec<&UnitResult>> = BTreeMap::new();
    for unit in units {
        groups
            .entry((&unit.tracker, &unit.protocol))
            .or_default()
            .push(unit);
    }
    let groups: Vec<Vec<&UnitResult>> = groups.into_values().collect();
    let parts: Vec<Results> = groups
        .par_iter()
        .map(|units| aggregate_tracker(metrics, units))
        .collect();
    let mut all = Results::new(metrics);
    for part in parts {
        all.extend(part);
    }
    all
}

/// The rows of one tracker under one protocol: [`aggregate`] for callers that cannot hold the errors of all trackers
/// at once. Feed the trackers sorted and join the parts with [`Results::extend`]. Every unit must name the same
/// tracker and protocol.
pub fn aggregate_tracker(metrics: &MetricSet, units: &[&UnitResult]) -> Results {
    let mut results = Results::new(metrics);
    let mut units: Vec<&UnitResult> = units.to_vec();
    let Some(UnitResult {
        tracker,
        protocol,
        restarted,
        boxes,
        ..
    }) = units.first().copied()
    else {
        return results;
    };
    units.sort_by_key(|u| (&u.dataset, &u.sequence, u.start));

    let sample = |units: &[&UnitResult]| {
        let sample = Sample::new(metrics, units.iter().map(|u| &u.errors));
        let sample = if *restarted { sample.restarted() } else { sample };
        if *boxes { sample.of_boxes() } else { sample }
    };
    let pooled = sample(&units);
    let curve = |dataset: &str, sequence: &str, index: usize, sample: &Sample| CurveRow {
        tracker: tracker.clone(),
        dataset: dataset.to_owned(),
        sequence: sequence.to_owned(),
        protocol: protocol.clone(),
        metric: metrics.metrics()[index],
        success_rate: sample.curve(index),
    };
    results
        .curves
        .extend(pooled.measured().map(|m| curve(ALL_DATASETS, POOLED, m, &pooled)));

    let mut sequence_values = Vec::new();
    for starts in units.chunk_by(|a, b| (&a.dataset, &a.sequence) == (&b.dataset, &b.sequence)) {
        let all = sample(starts);
        // Of the primary metric.
        results
            .curves
            .push(curve(&starts[0].dataset, &starts[0].sequence, 0, &all));
        let values = all.values();
        let score = Score::new(metrics, values.clone());
        sequence_values.push(values);
        results.sequences.extend(starts.iter().map(|unit| SequenceRow {
            tracker: tracker.clone(),
            dataset: unit.dataset.clone(),
            sequence: unit.sequence.clone(),
            start: unit.start,
            protocol: protocol.clone(),
            status: unit.status.clone(),
            score: if starts.len() == 1 {
                score.clone()
            } else {
                sample(&[unit]).score()
            },
        }));
    }

    let summary = |average, score| SummaryRow {
        tracker: tracker.clone(),
        average,
        metric: *metrics.primary(),
        protocol: protocol.clone(),
        sequences: sequence_values.len(),
        runs: units.len(),
        failed_runs: units.iter().filter(|u| u.status.is_failed()).count(),
        score,
    };
    results.summary = vec![
        summary(Average::Pooled, pooled.score()),
        summary(Average::SeqMean, Score::mean(metrics, &sequence_values)),
    ];
    results
}

impl Results {
    /// No rows yet.
    pub fn new(metrics: &MetricSet) -> Results {
        Results {
            metrics: metrics.clone(),
            ..Results::default()
        }
    }

    /// Appends the rows of another tracker, of the same metrics.
    pub fn extend(&mut self, other: Results) {
        self.sequences.extend(other.sequences);
        self.summary.extend(other.summary);
        self.curves.extend(other.curves);
        self.tags.extend(other.tags);
    }
}

/// A small fixed result set shared by the tests of everything that consumes results.
#[cfg(test)]
pub(crate) mod example {
    use super::*;
    use mtf::geom::Corners;

    pub(crate) fn unit(tracker: &str, sequence: &str, shifts: &[Option<f64>]) -> UnitResult {
        let mut parts = tracker.split('/').map(str::to_owned);
        let mut part = || parts.next().unwrap_or_default();
        let truth = Corners::rect(40.0, 40.0, 100.0, 80.0);
        let mut errors = Errors::new(&MetricSet::builtin());
        for shift in shifts {
            errors.push(shift.map(|d| truth.translated(d, 0.0)).as_ref(), &truth);
        }
        UnitResult {
            tracker: TrackerName {
                id: tracker.to_owned(),
                sm: part(),
                am: part(),
                ssm: part(),
                ilm: String::new(),
            },
            dataset: "builtin".to_owned(),
            sequence: sequence.to_owned(),
            start: 0,
            protocol: "ope".to_owned(),
            restarted: false,
            boxes: false,
            status: UnitStatus::Ok,
            errors,
        }
    }

    /// Of [`units`].
    pub(crate) fn results() -> Results {
        of(&units())
    }

    /// Of the metrics of this program.
    pub(crate) fn of(units: &[UnitResult]) -> Results {
        aggregate(&MetricSet::builtin(), units)
    }

    pub(crate) fn units() -> Vec<UnitResult> {
        let mut died = unit("nn/mi/affine", "wall", &[None, None]);
        died.status = UnitStatus::Failed("panicked at frame 1".to_owned());
        vec![
            unit(
                "iclk/ssd/affine",
                "wall",
                &[Some(1.5), Some(2.5), Some(30.0), None],
            ),
            unit("iclk/ssd/affine", "book", &[Some(0.1), Some(0.3)]),
            unit(
                "esm/ssd/homography",
                "wall",
                &[Some(0.0), Some(0.25), Some(0.5), Some(4.0)],
            ),
            unit("esm/ssd/homography", "book", &[Some(0.0), Some(0.1)]),
            died,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::example::{of, unit, units};
    use super::*;

    #[test]
    fn pooled_weighs_frames_and_seq_mean_sequences() {
        let results = of(&units());
        let iclk: Vec<_> = results
            .summary
            .iter()
            .filter(|r| r.tracker.sm == "iclk")
            .collect();
        assert_eq!(iclk[0].average, Average::Pooled);
        // 4 of 6 frames within 5 px; per sequence 2/2 and 2/4.
        assert_eq!(iclk[0].score["sr_5"], 0.666667);
        assert_eq!(iclk[1].score["sr_5"], 0.75);
        assert_eq!(
            (iclk[0].sequences, iclk[0].runs, iclk[0].score.failures()),
            (2, 2, 2)
        );
        assert_eq!(results.ranking()[0].tracker.id, "esm/ssd/homography");
        assert_eq!(results.failed_runs(), 1);
        // The failed run appears with its frames as failures.
        let died = results.sequences.iter().find(|r| r.status.is_failed()).unwrap();
        assert_eq!(
            (died.score.frames(), died.score.failures(), died.score["sr_20"]),
            (2, 2, 0.0)
        );
    }

    #[test]
    fn ties_are_ranked_by_name() {
        let ids = ["c/ssd/affine", "a/ssd/affine", "best/ssd/affine", "b/ssd/affine"];
        let mut results = of(&ids.map(|id| {
            let error = if id.starts_with("best") { 0.0 } else { 3.0 };
            unit(id, "wall", &[Some(error)])
        }));
        let sorted = ["best/ssd/affine", "a/ssd/affine", "b/ssd/affine", "c/ssd/affine"];
        for _ in 0..2 {
            let ranking: Vec<&str> = results.ranking().iter().map(|r| r.tracker.id.as_str()).collect();
            assert_eq!(ranking, sorted);
            // Whatever order the rows are in.
            results.summary.reverse();
        }
    }

    #[test]
    fn order_of_units_does_not_matter() {
        let mut shuffled = units();
        shuffled.reverse();
        shuffled.swap(1, 3);
        assert_eq!(format!("{:?}", of(&shuffled)), format!("{:?}", of(&units())));
    }

    #[test]
    fn sub_sequences_pool_within_their_sequence() {
        let mut late = unit("esm/ssd/affine", "wall", &[Some(50.0)]);
        late.start = 3;
        let units = [
            late,
            unit("esm/ssd/affine", "wall", &[Some(0.0), Some(0.0), Some(0.0)]),
            unit("esm/ssd/affine", "book", &[Some(50.0)]),
        ];
        let results = of(&units);
        assert_eq!(
            results
                .sequences
                .iter()
                .map(|r| (r.sequence.as_str(), r.start))
                .collect::<Vec<_>>(),
            [("book", 0), ("wall", 0), ("wall", 3)]
        );
        assert_eq!(results.summary[0].score["sr_20"], 0.6);
        // book 0, wall 3/4.
        assert_eq!(results.summary[1].score["sr_20"], 0.375);
        assert_eq!((results.summary[0].sequences, results.summary[0].runs), (2, 3));
        assert_eq!(results.curves.len(), 4 + 2);
    }

    #[test]
    fn sequences_without_frames_appear() {
        let mut dead = unit("esm/ssd/affine", "wall", &[]);
        dead.status = UnitStatus::Failed("cannot read frame 1".to_owned());
        let results = of(&[dead, unit("esm/ssd/affine", "book", &[Some(0.0)])]);
        assert_eq!(results.sequences.len(), 2);
        assert_eq!(
            (results.summary[1].score["sr_5"], results.summary[1].failed_runs),
            (1.0, 1)
        );
        assert!(results.curves.last().unwrap().success_rate.is_empty());
    }

    #[test]
    fn nothing() {
        assert_eq!(of(&[]), Results::default());
    }

    #[test]
    fn rankings_are_of_all_frames_together() {
        // Over frames `a` is better (5 of 6 on the mark against 3), over sequences `b` (3/4 against 1/2).
        let on = |n: usize, of: usize| {
            (0..of)
                .map(|k| Some(if k < n { 0.0 } else { 50.0 }))
                .collect::<Vec<_>>()
        };
        let results = of(&[
            unit("a/ssd/affine", "wall", &on(5, 5)),
            unit("a/ssd/affine", "book", &on(0, 1)),
            unit("b/ssd/affine", "wall", &on(2, 5)),
            unit("b/ssd/affine", "book", &on(1, 1)),
        ]);
        let ranking = results.ranking();
        assert!(ranking.iter().all(|row| row.average == Average::Pooled));
        let ranking: Vec<(&str, f64)> = ranking
            .iter()
            .map(|r| (r.tracker.sm.as_str(), r.score["sr_5"]))
            .collect();
        assert_eq!(ranking, [("a", 0.833333), ("b", 0.5)]);
    }

    #[test]
    fn failed_units_are_counted() {
        let mut units = units();
        assert_eq!(of(&units[..4]).failed_runs(), 0);
        units[0].status = UnitStatus::Failed("panicked at frame 2".to_owned());
        assert_eq!(of(&units).failed_runs(), 2);
    }

    #[test]
    fn the_curve_over_all_sequences_is_that_of_the_two_names() {
        let mut row = of(&units()).curves.swap_remove(0);
        for (dataset, sequence, pooled) in [
            (ALL_DATASETS, POOLED, true),
            (ALL_DATASETS, "wall", false),
            ("builtin", POOLED, false),
            ("builtin", "wall", false),
        ] {
            (row.dataset, row.sequence) = (dataset.to_owned(), sequence.to_owned());
            assert_eq!(row.is_pooled(), pooled, "{dataset} {sequence}");
        }
    }

    #[test]
    fn words_are_those_that_are_written() {
        for average in [Average::Pooled, Average::SeqMean] {
            assert_eq!(serde_json::json!(average), average.name());
        }
        for status in [UnitStatus::Ok, UnitStatus::Failed("lost".to_owned())] {
            assert_eq!(serde_json::json!(status)["status"], status.word());
        }
    }
}
