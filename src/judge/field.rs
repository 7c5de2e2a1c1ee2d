//! Results as benchmarks of the field report them: the figures of [`BENCHMARKS`], made from the corners in a run's frame logs.
//!
//! A benchmark is a row of the table: which figures, of which metric, averaged how. What is not a row is one of the metrics
//! themselves, each in its file. Depends on `metric`, `plan` and `store`.

use crate::files::{self, Kind};
use crate::metric::{Definition, Metric, al, best_rotation, cl, hd, jaccard, normalised_cl, relative_al};
use crate::plan::{Plan, Unit, UnitKeys};
use crate::store::StoreError;
use crate::store::framelog::{self, LoggedFrame};
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
}

impl Of {
    /// From the values of a sequence's frames or of all, infinite without output.
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
        }
    }
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

/// Published at 5 px and at a homography discrepancy of 30.
const fn planartrack(tracker: &'static str, figures: &'static [f64]) -> Published {
    Published { tracker, figures }
}

const NONE: f64 = f64::NAN;

/// All benchmarks.
pub static BENCHMARKS: [Benchmark; 5] = [
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
            planartrack("WOFT", &[0.433, NONE, 0.306, NONE, NONE, NONE]),
            planartrack("HDN", &[0.263, NONE, 0.236, NONE, NONE, NONE]),
            planartrack("GIFT", &[0.254, NONE, 0.223, NONE, NONE, NONE]),
            planartrack("LISRD", &[0.220, NONE, 0.174, NONE, NONE, NONE]),
            planartrack("SIFT", &[0.177, NONE, 0.144, NONE, NONE, NONE]),
            planartrack("Gracker", &[0.167, NONE, 0.137, NONE, NONE, NONE]),
            planartrack("SOL", &[0.142, NONE, 0.107, NONE, NONE, NONE]),
            planartrack("SCV", &[0.113, NONE, 0.082, NONE, NONE, NONE]),
            planartrack("ESM", &[0.097, NONE, 0.073, NONE, NONE, NONE]),
            planartrack("IC", &[0.048, NONE, 0.038, NONE, NONE, NONE]),
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
];

impl Benchmark {
    /// The one called `name`.
    pub fn named(name: &str) -> Option<&'static Benchmark> {
        BENCHMARKS.iter().find(|b| b.name.eq_ignore_ascii_case(name))
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
                None if failed => vec![Seen::Lost; truth.scored(unit.start as usize)],
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
            let figure = |quantity: &Quantity| match boxes && !quantity.metric.of_boxes {
                true => f64::NAN,
                false => figure(quantity, benchmark.joined, &sequences),
            };
            rows.push(Row {
                tracker: tracker.id.clone(),
                protocol: protocol.to_string(),
                figures: benchmark.quantities.iter().map(figure).collect(),
                frames: sequences.iter().map(|seen| seen.len()).sum(),
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

/// A frame that counts.
#[derive(Clone, Copy, Debug)]
enum Seen {
    /// What the tracker gave, and the truth.
    There(Corners, Corners),
    /// No output, or a failure.
    Lost,
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
    let mut seen = Vec::new();
    for frame in framelog::frames(&text).map_err(damaged)? {
        let LoggedFrame {
            frame,
            status,
            corners,
        } = frame;
        match (status.as_str(), corners, truth.at(frame)) {
            (framelog::INIT | framelog::SKIPPED, ..) => {}
            (framelog::FAILED, ..) | (_, None, Some(_)) => seen.push(Seen::Lost),
            (_, Some(corners), Some(truth)) => seen.push(Seen::There(corners, truth)),
            (_, _, None) => {}
        }
    }
    Ok(seen)
}

fn figure(quantity: &Quantity, joined: Joined, sequences: &[&[Seen]]) -> f64 {
    let value = |seen: &Seen| match (seen, quantity.metric.definition) {
        (Seen::There(tracked, truth), Definition::Corners(of)) => of(tracked, truth),
        _ => f64::INFINITY,
    };
    let values = |seen: &[Seen]| seen.iter().map(value).collect::<Vec<f64>>();
    match joined {
        Joined::Pooled => quantity.of.value(&values(&sequences.concat())),
        Joined::PerSequence => {
            let of_sequences = sequences.iter().map(|seen| quantity.of.value(&values(seen)));
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
        let (good, bad) = (Seen::There(here, here), Seen::Lost);
        let sequences: [&[Seen]; 2] = [&[good, good, good], &[bad]];
        let p5 = quantity("", al::METRIC, Of::AtMost(5.0));
        assert_eq!(figure(&p5, Joined::Pooled, &sequences), 0.75);
        assert_eq!(figure(&p5, Joined::PerSequence, &sequences), 0.5);
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
