//! Results as benchmarks of the field report them: the figures of [`BENCHMARKS`], made from the corners in a run's frame logs.
//!
//! A benchmark is a row of the table: which figures, of which metric, averaged how. What is not a row is one of the metrics
//! themselves, each in its file. Depends on `metric`, `plan` and `store`.

use crate::dataset::recorded::{LoggedFrame, logged_frames};
use crate::files::{self, Kind};
use crate::metric::{Definition, Metric, al, best_rotation, cl, hd, jaccard, normalised_cl, relative_al};
use crate::plan::{Plan, Unit, UnitKeys};
use crate::store::StoreError;
use crate::store::framelog;
use crate::store::journal::{EntryStatus, Journal};
use crate::store::rundir::RunDir;
use crate::store::truth::{self, KeptTruth};
use mtf::geom::Corners;
use std::path::Path;

/// How the figures of sequences are joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Joined {
    /// All frames of all sequences count alike.
    Pooled,
    /// All sequences count alike.
    PerSequence,
}

/// What a figure is made of the values of a metric; a frame without output has the worst value.
#[derive(Clone, Copy, Debug)]
pub enum Of {
    /// Share of the frames at most so large.
    AtMost(f64),
    /// Share of the frames below this.
    Below(f64),
    /// Share of the frames above this.
    Above(f64),
    /// Mean over `steps + 1` thresholds from 0 to `most` of the share of frames at most as large.
    AreaAtMost {
        /// The largest threshold.
        most: f64,
        /// Number of thresholds above 0.
        steps: usize,
    },
    /// The same of the share of frames whose `1 - value` is above the threshold: success over the overlap.
    AreaOverlap {
        /// Number of thresholds above 0.
        steps: usize,
    },
    /// Mean of `1 - value`: the mean overlap.
    MeanComplement,
    /// Mean of `1 - value` over the frames with output.
    MeanComplementTracked,
    /// Number of frames without output, or of failures that the tracker was started anew after, per sequence.
    Lost,
    /// Share of the frames without the object in which the tracker gives corners and does not say that it is absent.
    FalsePresence,
    /// Share of the frames with the object in which the tracker says that it is absent, or gives nothing.
    MissedPresence,
    /// Mean number of frames from the return of the object to the first with a value of at most so much; all frames until the
    /// next absence where there is none.
    Redetection(f64),
    /// Area under the curve of true against false positives of "the value is at most so much" by the logged confidence, which
    /// a frame without output has least of; equal confidences count half.
    ConfidenceArea(f64),
}

impl Of {
    /// From the frames that count of a sequence or of all, in their order. NaN where there are none that it is of.
    fn figure(self, frames: &[Seen], metric: &Metric) -> f64 {
        let value = |seen: &Seen| seen.value(metric);
        let present = || frames.iter().filter(|seen| seen.truth.is_some());
        let absent = || frames.iter().filter(|seen| seen.truth.is_none());
        let share = |hits: usize, all: usize| hits as f64 / all as f64;
        match self {
            Of::FalsePresence => {
                let wrong = absent().filter(|seen| seen.tracked.is_some() && !seen.says_absent);
                share(wrong.count(), absent().count())
            }
            Of::MissedPresence => {
                let missed = present().filter(|seen| seen.says_absent || seen.tracked.is_none());
                share(missed.count(), present().count())
            }
            Of::Redetection(most) => redetection(frames, |seen| value(seen) <= most),
            Of::ConfidenceArea(most) => roc_area(&mut confidences(frames, metric, most)),
            _ => self.value(&present().map(value).collect::<Vec<f64>>()),
        }
    }

    /// From the values of frames with the object, infinite without output.
    fn value(self, values: &[f64]) -> f64 {
        let n = values.len() as f64;
        let share = |fits: &dyn Fn(f64) -> bool| values.iter().filter(|v| fits(**v)).count() as f64 / n;
        let overlap = |v: f64| if v.is_finite() { 1.0 - v } else { 0.0 };
        match self {
            Of::AtMost(t) => share(&|v| v <= t),
            Of::Below(t) => share(&|v| v < t),
            Of::Above(t) => share(&|v| v > t),
            Of::AreaAtMost { most, steps } => {
                let at = |k: usize| most * k as f64 / steps as f64;
                (0..=steps).map(|k| share(&|v| v <= at(k))).sum::<f64>() / (steps + 1) as f64
            }
            Of::AreaOverlap { steps } => {
                let at = |k: usize| k as f64 / steps as f64;
                (0..=steps).map(|k| share(&|v| overlap(v) > at(k))).sum::<f64>() / (steps + 1) as f64
            }
            Of::MeanComplement => values.iter().map(|v| overlap(*v)).sum::<f64>() / n,
            Of::MeanComplementTracked => {
                let tracked: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
                tracked.iter().map(|v| 1.0 - v).sum::<f64>() / tracked.len() as f64
            }
            Of::Lost => values.iter().filter(|v| v.is_infinite()).count() as f64,
            // Of more than values.
            Of::FalsePresence | Of::MissedPresence | Of::Redetection(_) | Of::ConfidenceArea(_) => f64::NAN,
        }
    }
}

/// The confidence of each frame with the object, and whether its value is at most so much.
fn confidences(frames: &[Seen], metric: &Metric, most: f64) -> Vec<(f64, bool)> {
    let present = frames.iter().filter(|seen| seen.truth.is_some());
    present
        .map(|seen| (seen.confidence, seen.value(metric) <= most))
        .collect()
}

/// False and true positive rates of `(confidence, right)` from the most to the least sure, after each hundredth of the frames;
/// empty where there is no [area](roc_area) under them.
fn roc(frames: &mut [(f64, bool)]) -> Vec<[f64; 2]> {
    if roc_area(frames).is_nan() {
        return Vec::new();
    }
    let all = frames.len();
    let right = frames.iter().filter(|(_, right)| *right).count() as f64;
    let wrong = all as f64 - right;
    let at = |k: usize| {
        let hits = frames[all - k..].iter().filter(|(_, right)| *right).count() as f64;
        [(k as f64 - hits) / wrong, hits / right]
    };
    let mut steps: Vec<usize> = (0..=100).map(|k| k * all / 100).collect();
    steps.dedup();
    steps.into_iter().map(at).collect()
}

/// See [`Of::Redetection`].
fn redetection(frames: &[Seen], holds: impl Fn(&Seen) -> bool) -> f64 {
    let stretches: Vec<&[Seen]> = frames
        .chunk_by(|a, b| a.sequence == b.sequence && a.truth.is_some() == b.truth.is_some())
        .collect();
    // A return follows an absence.
    let returns = stretches
        .windows(2)
        .filter(|pair| pair[0][0].sequence == pair[1][0].sequence)
        .map(|pair| pair[1])
        .filter(|stretch| stretch[0].truth.is_some());
    let waits: Vec<usize> = returns
        .map(|stretch| stretch.iter().position(&holds).unwrap_or(stretch.len()))
        .collect();
    waits.iter().sum::<usize>() as f64 / waits.len() as f64
}

/// Area under the ROC curve of `(confidence, right)`, by ranks; NaN where a confidence is not known, or all or none are right.
fn roc_area(frames: &mut [(f64, bool)]) -> f64 {
    if frames.iter().any(|(confidence, _)| confidence.is_nan()) {
        return f64::NAN;
    }
    frames.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut ranks, mut before) = (0.0, 0);
    for equal in frames.chunk_by(|a, b| a.0 == b.0) {
        // The mean of the ranks from before + 1 on.
        let rank = before as f64 + (equal.len() + 1) as f64 / 2.0;
        ranks += rank * equal.iter().filter(|(_, right)| *right).count() as f64;
        before += equal.len();
    }
    let right = frames.iter().filter(|(_, right)| *right).count() as f64;
    let wrong = frames.len() as f64 - right;
    (ranks - right * (right + 1.0) / 2.0) / (right * wrong)
}

/// A figure of a benchmark.
#[derive(Clone, Copy, Debug)]
pub struct Quantity {
    /// What its column is called.
    pub name: &'static str,
    /// What it is made of.
    pub metric: Metric,
    /// How.
    pub of: Of,
}

/// Published figures of a tracker.
#[derive(Clone, Copy, Debug)]
pub struct Published {
    /// Name.
    pub tracker: &'static str,
    /// Figures, in the order of the benchmark's; NaN where none was published.
    pub figures: &'static [f64],
}

/// A benchmark.
#[derive(Clone, Copy, Debug)]
pub struct Benchmark {
    /// Name on the command line.
    pub name: &'static str,
    /// Its figures; the first ranks.
    pub quantities: &'static [Quantity],
    /// How they are joined.
    pub joined: Joined,
    /// Where it is defined.
    pub source: &'static str,
    /// Published figures, for comparison.
    pub published: &'static [Published],
}

const fn quantity(name: &'static str, metric: Metric, of: Of) -> Quantity {
    Quantity { name, metric, of }
}

const fn published(tracker: &'static str, figures: &'static [f64]) -> Published {
    Published { tracker, figures }
}

const NONE: f64 = f64::NAN;

/// All benchmarks.
pub static BENCHMARKS: [Benchmark; 6] = [
    Benchmark {
        name: "planartrack",
        quantities: &[
            quantity("P@5", al::METRIC, Of::AtMost(5.0)),
            quantity("P@15", al::METRIC, Of::AtMost(15.0)),
            quantity("S@30", hd::METRIC, Of::AtMost(30.0)),
            quantity("best rotation P@5", best_rotation::METRIC, Of::AtMost(5.0)),
            quantity("IoU > 0.8", jaccard::METRIC, Of::Below(0.2)),
            quantity("IoU < 0.5", jaccard::METRIC, Of::Above(0.5)),
        ],
        joined: Joined::PerSequence,
        source: "Liu et al., PlanarTrack, ICCV 2023",
        published: &[
            published("WOFT", &[0.433, NONE, 0.306, NONE, NONE, NONE]),
            published("HDN", &[0.263, NONE, 0.236, NONE, NONE, NONE]),
            published("GIFT", &[0.254, NONE, 0.223, NONE, NONE, NONE]),
            published("LISRD", &[0.220, NONE, 0.174, NONE, NONE, NONE]),
            published("SIFT", &[0.177, NONE, 0.144, NONE, NONE, NONE]),
            published("Gracker", &[0.167, NONE, 0.137, NONE, NONE, NONE]),
            published("SOL", &[0.142, NONE, 0.107, NONE, NONE, NONE]),
            published("SCV", &[0.113, NONE, 0.082, NONE, NONE, NONE]),
            published("ESM", &[0.097, NONE, 0.073, NONE, NONE, NONE]),
            published("IC", &[0.048, NONE, 0.038, NONE, NONE, NONE]),
        ],
    },
    Benchmark {
        name: "pot",
        quantities: &[
            quantity("P@5", al::METRIC, Of::AtMost(5.0)),
            quantity("P@15", al::METRIC, Of::AtMost(15.0)),
            quantity(
                "P area to 50",
                al::METRIC,
                Of::AreaAtMost {
                    most: 50.0,
                    steps: 50,
                },
            ),
            quantity("S@10", hd::METRIC, Of::AtMost(10.0)),
            quantity(
                "S area to 200",
                hd::METRIC,
                Of::AreaAtMost {
                    most: 200.0,
                    steps: 200,
                },
            ),
        ],
        joined: Joined::Pooled,
        source: "Liang et al., Planar object tracking in the wild, ICRA 2018",
        published: &[],
    },
    Benchmark {
        name: "vot",
        quantities: &[
            quantity("average overlap", jaccard::METRIC, Of::MeanComplement),
            quantity("accuracy", jaccard::METRIC, Of::MeanComplementTracked),
            quantity("failures per sequence", jaccard::METRIC, Of::Lost),
            quantity("success area", jaccard::METRIC, Of::AreaOverlap { steps: 100 }),
        ],
        joined: Joined::PerSequence,
        source: "Kristan et al., A novel performance evaluation methodology for single-target trackers, TPAMI 2016",
        published: &[],
    },
    Benchmark {
        name: "tmt",
        quantities: &[
            quantity("SR@5", crate::metric::mcd::METRIC, Of::AtMost(5.0)),
            quantity("SR@10", crate::metric::mcd::METRIC, Of::AtMost(10.0)),
            quantity(
                "SR area to 20",
                crate::metric::mcd::METRIC,
                Of::AreaAtMost {
                    most: 20.0,
                    steps: 100,
                },
            ),
            quantity("relative SR@0.1", relative_al::METRIC, Of::AtMost(0.1)),
        ],
        joined: Joined::Pooled,
        source: "Roy, Zhang, Wolleb, Perez Quintero, Jagersand, Tracking benchmark and evaluation for manipulation tasks, ICRA 2015",
        published: &[],
    },
    Benchmark {
        name: "otb",
        quantities: &[
            quantity("success area", jaccard::METRIC, Of::AreaOverlap { steps: 20 }),
            quantity("precision@20", cl::METRIC, Of::AtMost(20.0)),
            quantity("IoU > 0.5", jaccard::METRIC, Of::Below(0.5)),
            quantity("normalised precision@0.2", normalised_cl::METRIC, Of::AtMost(0.2)),
        ],
        joined: Joined::PerSequence,
        source: "Wu, Lim, Yang, Object tracking benchmark, TPAMI 2015; Müller et al., TrackingNet, ECCV 2018",
        published: &[],
    },
    Benchmark {
        name: "longterm",
        quantities: &[
            quantity("false presence", al::METRIC, Of::FalsePresence),
            quantity("missed presence", al::METRIC, Of::MissedPresence),
            quantity("frames to re-detection", jaccard::METRIC, Of::Redetection(0.5)),
            quantity("ROC area, al <= 5 px", al::METRIC, Of::ConfidenceArea(5.0)),
            quantity("ROC area, IoU >= 0.5", jaccard::METRIC, Of::ConfidenceArea(0.5)),
        ],
        joined: Joined::Pooled,
        source: "presence as in Valmadre et al., Long-term tracking in the wild, ECCV 2018; a return is found at an IoU of 0.5",
        published: &[],
    },
];

impl Benchmark {
    /// The one called `name`.
    pub fn named(name: &str) -> Option<&'static Benchmark> {
        BENCHMARKS.iter().find(|b| b.name == name)
    }

    /// What is to be said of the figures, in a line.
    pub fn caption(&self) -> String {
        let how = match self.joined {
            Joined::Pooled => "over all frames of all sequences",
            Joined::PerSequence => "means over sequences",
        };
        format!(
            "as {}: {how}, the first frame not counted ({})",
            self.name, self.source
        )
    }
}

/// The figures of a tracker.
#[derive(Clone, Debug)]
pub struct Row {
    /// Its id.
    pub tracker: String,
    /// Protocol of the run.
    pub protocol: String,
    /// In the order of the benchmark's; NaN where one means nothing, as for boxes.
    pub figures: Vec<f64>,
    /// Frames that count.
    pub frames: usize,
    /// The ROC curve of the benchmark's first area under one: false and true positive rates, from none to all; empty where
    /// there is none.
    pub roc: Vec<[f64; 2]>,
}

/// Why there are no such figures.
#[derive(Debug, thiserror::Error)]
pub enum FieldError {
    /// The run kept no corners.
    #[error("{}: the run kept no frame logs, which these figures are made of; run it with --frame-logs csv", .0.display())]
    NoLogs(std::path::PathBuf),
    /// A file cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// The figures of `benchmark` for every tracker and protocol of the finished run in `dir`, best first.
///
/// # Errors
/// See [`FieldError`].
pub fn report(dir: &Path, benchmark: &Benchmark) -> Result<Vec<Row>, FieldError> {
    let mut run = RunDir::view(dir);
    let recorded = run.recorded()?;
    let plan = &recorded.plan;
    run.lay_out(plan);
    let truth = truth::read(&dir.join("truth.csv"), &plan.sequences, recorded.truth_sum())?;
    let journal = Journal::read(&run.journal())?;
    let keys = UnitKeys::new(plan);
    let units = recorded.units();
    let mut rows = Vec::new();
    for own in units.chunk_by(|a, b| a.tracker == b.tracker) {
        let mut frames: Vec<(Unit, Vec<Seen>)> = Vec::new();
        for unit in own {
            let entry = journal.get(&keys.of(unit))?;
            let failed = entry
                .as_ref()
                .is_some_and(|entry| entry.status == EntryStatus::Failed);
            let truth = &truth[unit.sequence as usize];
            let seen = match entry.and_then(|entry| entry.log) {
                Some(_) => seen(&run, plan, unit, truth)?,
                None if failed => {
                    let all = unit.start as usize + 1..plan.sequences[unit.sequence as usize].frames;
                    all.filter(|&i| truth.at(i).is_some() || truth.is_absent(i))
                        .map(|i| Seen::lost(unit.sequence, truth.at(i)))
                        .collect()
                }
                None => return Err(FieldError::NoLogs(dir.to_path_buf())),
            };
            frames.push((*unit, seen));
        }
        for (index, protocol) in plan.protocol.iter().enumerate() {
            let of_protocol = frames.iter().filter(|(unit, _)| plan.belongs(unit, index));
            let mut sequences: Vec<(u32, Vec<Seen>)> = Vec::new();
            for (unit, seen) in of_protocol {
                match sequences
                    .iter_mut()
                    .find(|(sequence, _)| *sequence == unit.sequence)
                {
                    Some((_, all)) => all.extend(seen),
                    None => sequences.push((unit.sequence, seen.clone())),
                }
            }
            let tracker = &plan.trackers[own[0].tracker as usize];
            let boxes = !tracker.answers.are_corners();
            let sequences: Vec<&[Seen]> = sequences.iter().map(|(_, seen)| &seen[..]).collect();
            let roc = benchmark
                .quantities
                .iter()
                .find_map(|quantity| match quantity.of {
                    Of::ConfidenceArea(most) if !boxes || quantity.metric.of_boxes => {
                        Some(roc(&mut confidences(&sequences.concat(), &quantity.metric, most)))
                    }
                    _ => None,
                });
            let figure = |quantity: &Quantity| match boxes && !quantity.metric.of_boxes {
                true => f64::NAN,
                false => figure(quantity, benchmark.joined, &sequences),
            };
            rows.push(Row {
                tracker: tracker.id.clone(),
                protocol: protocol.to_string(),
                roc: roc.unwrap_or_default(),
                figures: benchmark.quantities.iter().map(figure).collect(),
                frames: sequences
                    .iter()
                    .flat_map(|seen| seen.iter())
                    .filter(|seen| seen.truth.is_some())
                    .count(),
            });
        }
    }
    let first = |row: &Row| {
        row.figures
            .iter()
            .copied()
            .find(|v| !v.is_nan())
            .unwrap_or(f64::NEG_INFINITY)
    };
    rows.sort_by(|a, b| {
        first(b)
            .total_cmp(&first(a))
            .then_with(|| a.tracker.cmp(&b.tracker))
    });
    Ok(rows)
}

/// A frame that counts: one with the object, or where it is said not to be seen.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Number of the sequence.
    sequence: u32,
    /// What the tracker gave; none for a failure that it was started anew after.
    tracked: Option<Corners>,
    /// Where the object is; `None` where it cannot be seen.
    truth: Option<Corners>,
    /// The tracker said that it cannot.
    says_absent: bool,
    /// What it logged of how sure it is; least without output.
    confidence: f64,
}

/// Truth of a failure in a frame without: it counts, whatever the truth.
const NOWHERE: Corners = Corners([[0.0; 2]; 4]);

impl Seen {
    /// Of a tracker that does not run.
    fn lost(sequence: u32, truth: Option<Corners>) -> Seen {
        Seen {
            sequence,
            tracked: None,
            truth,
            says_absent: false,
            confidence: f64::NEG_INFINITY,
        }
    }

    /// The value of a metric; infinite without output or object.
    fn value(&self, metric: &Metric) -> f64 {
        match (self.tracked, self.truth, metric.definition) {
            (Some(tracked), Some(truth), Definition::Corners(of)) => of(&tracked, &truth),
            _ => f64::INFINITY,
        }
    }
}

/// The frames that count of a unit's log.
fn seen(run: &RunDir, plan: &Plan, unit: &Unit, truth: &KeptTruth) -> Result<Vec<Seen>, StoreError> {
    let path = run.log(plan, unit);
    let bytes = files::read(&path, Kind::RESULTS).map_err(|e| StoreError::io(&path, e))?;
    let damaged = |reason| StoreError::Damaged {
        path: path.clone(),
        reason,
    };
    let text = files::unpack(bytes).map_err(damaged)?;
    let frames = logged_frames(&text).map_err(|e| damaged(e.to_string()))?;
    let counts = |logged: &LoggedFrame| {
        let known = truth.at(logged.frame).is_some() || truth.is_absent(logged.frame);
        (known || logged.status == framelog::FAILED)
            && ![framelog::INIT, framelog::SKIPPED].contains(&logged.status.as_str())
    };
    let frame = |logged: LoggedFrame| {
        let here = truth.at(logged.frame);
        match logged.corners.filter(|_| logged.status != framelog::FAILED) {
            // A failure counts with or without ground truth.
            None if logged.status == framelog::FAILED => Seen::lost(unit.sequence, here.or(Some(NOWHERE))),
            tracked => Seen {
                sequence: unit.sequence,
                tracked,
                truth: here,
                says_absent: logged.status == framelog::ABSENT,
                confidence: if tracked.is_some() {
                    logged.similarity
                } else {
                    f64::NEG_INFINITY
                },
            },
        }
    };
    Ok(frames.into_iter().filter(counts).map(frame).collect())
}

fn figure(quantity: &Quantity, joined: Joined, sequences: &[&[Seen]]) -> f64 {
    match joined {
        Joined::Pooled => quantity.of.figure(&sequences.concat(), &quantity.metric),
        Joined::PerSequence => {
            let of_sequences = sequences
                .iter()
                .map(|seen| quantity.of.figure(seen, &quantity.metric));
            let defined: Vec<f64> = of_sequences.filter(|v| !v.is_nan()).collect();
            defined.iter().sum::<f64>() / defined.len() as f64
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_by_hand() {
        let values = [0.1, 0.3, 0.6, f64::INFINITY];
        let is = |of: Of, expected: f64| {
            assert!(
                (of.value(&values) - expected).abs() < 1e-12,
                "{of:?} {}",
                of.value(&values)
            )
        };
        is(Of::AtMost(0.3), 0.5);
        is(Of::Below(0.3), 0.25);
        is(Of::Above(0.3), 0.5);
        is(Of::MeanComplement, 2.0 / 4.0);
        is(Of::MeanComplementTracked, 2.0 / 3.0);
        is(Of::Lost, 1.0);
        // Thresholds 0, 1/2, 1 of the overlaps 0.9, 0.7, 0.4, 0: 3/4, 2/4, 0.
        is(Of::AreaOverlap { steps: 2 }, (0.75 + 0.5) / 3.0);
        // Thresholds 0, 0.5, 1 of the values: 0, 2/4, 3/4.
        is(Of::AreaAtMost { most: 1.0, steps: 2 }, (0.5 + 0.75) / 3.0);
    }

    #[test]
    fn sequences_count_alike_or_frames_do() {
        let here = Corners::rect(0.0, 0.0, 10.0, 10.0);
        let bad = Seen::lost(0, Some(here));
        let good = Seen {
            tracked: Some(here),
            confidence: 1.0,
            ..bad
        };
        let sequences: [&[Seen]; 2] = [&[good, good, good], &[bad]];
        let p5 = quantity("", al::METRIC, Of::AtMost(5.0));
        assert_eq!(figure(&p5, Joined::Pooled, &sequences), 0.75);
        assert_eq!(figure(&p5, Joined::PerSequence, &sequences), 0.5);
    }

    #[test]
    fn presence_and_confidence_by_hand() {
        let here = Corners::rect(0.0, 0.0, 10.0, 10.0);
        let seen = |truth: bool, tracked: Option<f64>, says_absent: bool, confidence: f64| Seen {
            sequence: 0,
            tracked: tracked.map(|by| here.translated(by, 0.0)),
            truth: truth.then_some(here),
            says_absent,
            confidence,
        };
        let frames = [
            seen(true, Some(0.0), false, 0.9),
            seen(true, Some(8.0), true, 0.3),
            // Gone for three frames, of which the tracker notices two.
            seen(false, Some(0.0), false, 0.5),
            seen(false, Some(0.0), true, 0.1),
            seen(false, None, false, 0.0),
            // Back, and found in the third.
            seen(true, None, false, f64::NEG_INFINITY),
            seen(true, Some(9.0), false, 0.9),
            seen(true, Some(1.0), false, 0.8),
        ];
        let is = |of: Of, expected: f64| {
            let value = of.figure(&frames, &al::METRIC);
            assert!((value - expected).abs() < 1e-12, "{of:?} {value}");
        };
        is(Of::FalsePresence, 1.0 / 3.0);
        is(Of::MissedPresence, 2.0 / 5.0);
        is(Of::Redetection(5.0), 2.0);
        // Right 0.9, 0.8; wrong 0.3, -inf, 0.9: of six pairs four are in order, and one is a tie.
        is(Of::ConfidenceArea(5.0), 4.5 / 6.0);
        is(Of::AtMost(5.0), 2.0 / 5.0);
        assert!(Of::FalsePresence.figure(&frames[..2], &al::METRIC).is_nan());
        assert!(Of::Redetection(5.0).figure(&frames[..5], &al::METRIC).is_nan());
        let unknown = [frames[0], seen(true, Some(0.0), false, f64::NAN)];
        assert!(Of::ConfidenceArea(5.0).figure(&unknown, &al::METRIC).is_nan());
    }

    #[test]
    fn the_table_is_complete() {
        let mut names: Vec<&str> = BENCHMARKS.iter().map(|b| b.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), BENCHMARKS.len());
        for benchmark in &BENCHMARKS {
            assert!(
                benchmark
                    .published
                    .iter()
                    .all(|p| p.figures.len() == benchmark.quantities.len())
            );
            assert!(
                benchmark
                    .quantities
                    .iter()
                    .all(|q| matches!(q.metric.definition, Definition::Corners(_)))
            );
        }
    }
}
