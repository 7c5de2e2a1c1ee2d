//! Speed of trackers: time of `update` alone, on one thread, over frames that are decoded and filtered beforehand. The
//! pixels of a frame are read once, untimed, right before each update, as filtering does in a tracker's daily work: else
//! every update would begin by waiting for a frame that others have pushed out of the caches.
//!
//! Every pass over a sequence starts a fresh tracker with the same seed, so a frame costs the same work each time and the
//! least of its times is what the machine can do undisturbed. All figures are of these least times: their sum over all
//! frames (per frame, per iteration), their median and 95th percentile. Image pyramids are made once per frame and count
//! as filtering.

use crate::dataset::{DatasetError, Sequence};
use crate::measure::machine::Machine;
use crate::metric::{Errors, MetricSet, Sample, quantile};
use crate::panics;
use crate::plan::{RunRequest, TrackerEntry, sequence_id, usual_filter};
use mtf::image::{Frame, PreProcessor};
use mtf::tracker::{Tracker, afford};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Version of the file a measurement is saved in.
pub const MEASUREMENT_FORMAT_VERSION: u32 = 1;

/// What to measure.
#[derive(Clone, Debug)]
pub struct BenchRequest {
    /// The trackers.
    pub trackers: Vec<TrackerEntry>,
    /// The sequences, cut to the frames to be tracked. One at a time is in memory.
    pub sequences: Vec<Sequence>,
    /// Filter applied to each frame.
    pub pre: Arc<dyn PreProcessor>,
    /// Timed passes over each sequence, after one to warm up.
    pub repeats: usize,
    /// A tracker that has spent as long on a sequence makes no further pass (but one).
    pub budget: Duration,
    /// Seed of every tracker.
    pub seed: u64,
    /// Threads of the current `rayon` pool that a tracker may use.
    pub threads: usize,
}

/// Speed of one tracker of this or another program.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct BenchRow {
    /// Id of the tracker; of another program's, the tracker of ours that does the same.
    pub tracker: String,
    /// Program, version and what it calls the tracker.
    pub program: String,
    /// Updates timed.
    pub frames: usize,
    /// Iterations per frame; none for trackers that do not iterate or do not say.
    pub iterations: Option<f64>,
    /// µs per iteration.
    pub us_per_iteration: Option<f64>,
    /// µs per frame: all update time by the number of frames.
    pub us_per_frame: f64,
    /// Median µs of a frame.
    pub us_median: f64,
    /// 95th percentile, µs.
    pub us_p95: f64,
    /// Frames per second of update time: `1e6 / us_per_frame`.
    pub fps: f64,
    /// Fraction of the frames within 5 px of the truth: the speed of a tracker that has lost its object says little.
    pub sr_5: Option<f64>,
    /// Median alignment error over the frames, px: the accuracy that the time was spent on.
    pub al_median: Option<f64>,
}

/// What is done to each frame before any update, and not in its time: the medians over all frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Preparation {
    /// The filter, as `--filter` reads it.
    pub filter: String,
    /// µs to make gray floats of the decoded bytes and filter them.
    pub us_filter: f64,
    /// µs to halve the filtered image until it is small, for trackers that search pyramids.
    pub us_pyramid: f64,
}

impl BenchRequest {
    /// `trackers` over `sequences` with the program's defaults: the usual filter, 5 passes within 5 s per tracker and
    /// sequence, seed 0, one thread.
    pub fn new(trackers: Vec<TrackerEntry>, sequences: Vec<Sequence>) -> BenchRequest {
        BenchRequest {
            trackers,
            sequences,
            pre: usual_filter(),
            repeats: 5,
            budget: Duration::from_secs(5),
            seed: 0,
            threads: 1,
        }
    }
}

/// Why a measurement was not made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// A sequence has no frame to start on.
    #[error("{0}: no frame has ground truth to start from")]
    NoStart(String),
    /// A frame cannot be read.
    #[error(transparent)]
    Frame(#[from] DatasetError),
    /// Asked to stop.
    #[error("stopped; a measurement cannot be resumed, run it again")]
    Stopped,
}

/// What was measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BenchReport {
    /// What each frame cost before its updates.
    pub preparation: Preparation,
    /// A row per tracker, in their order.
    pub rows: Vec<BenchRow>,
    /// Trackers without figures, and why.
    pub failed: Vec<(String, String)>,
}

impl BenchRow {
    /// Times of frames that took `seconds` each and `iterations` together.
    fn new(tracker: &str, mut seconds: Vec<f64>, iterations: u64) -> BenchRow {
        let frames = seconds.len();
        seconds.sort_by(f64::total_cmp);
        let quantile = |q: f64| quantile::nearest(&seconds, q).map_or(f64::NAN, |s| 1e6 * s);
        let total: f64 = seconds.iter().sum();
        let us_per_frame = 1e6 * total / frames as f64;
        let per = |n: u64| (n > 0).then(|| 1e6 * total / n as f64);
        BenchRow {
            tracker: tracker.to_owned(),
            program: format!("{} {}", env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION")),
            frames,
            iterations: (iterations > 0).then(|| iterations as f64 / frames as f64),
            us_per_iteration: per(iterations),
            us_per_frame,
            us_median: quantile(0.5),
            us_p95: quantile(0.95),
            fps: 1e6 / us_per_frame,
            ..BenchRow::default()
        }
    }

    /// How many times longer `self` takes than `ours`, per frame and (where both iterate) per iteration.
    pub fn times(&self, ours: &BenchRow) -> (f64, Option<f64>) {
        let iteration = self.us_per_iteration.zip(ours.us_per_iteration);
        (
            self.us_per_frame / ours.us_per_frame,
            iteration.map(|(theirs, ours)| theirs / ours),
        )
    }
}

/// A measurement as it is saved.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// [`MEASUREMENT_FORMAT_VERSION`].
    pub schema_version: u32,
    /// Where it was made.
    #[serde(default)]
    pub machine: Machine,
    /// How it was made.
    #[serde(default)]
    pub command: Vec<String>,
    /// Sequences, `dataset/sequence`.
    #[serde(default)]
    pub sequences: Vec<String>,
    /// What each frame cost before its updates.
    #[serde(default)]
    pub preparation: Preparation,
    /// A row per tracker.
    pub rows: Vec<BenchRow>,
    /// Combinations that cannot work, and why.
    #[serde(default)]
    pub refused: Vec<(String, String)>,
    /// Trackers without figures, and why.
    #[serde(default)]
    pub failed: Vec<(String, String)>,
}

/// What the measurement of one tracker adds up to, over sequences.
struct Sum {
    seconds: Vec<f64>,
    iterations: u64,
    errors: Errors,
    failed: Option<String>,
}

/// One pass over a sequence.
struct Pass {
    seconds: Vec<f64>,
    iterations: u64,
    errors: Errors,
}

/// Measures everything in `request`, one tracker at a time. `progress` is told the share that is done.
///
/// # Errors
/// A frame cannot be read, a sequence has no ground truth to start from, or `stop` was set.
pub fn run(
    request: &BenchRequest,
    stop: &AtomicBool,
    progress: &dyn Fn(f64),
) -> Result<BenchReport, BenchError> {
    let metrics = MetricSet::builtin();
    let nothing = || Sum {
        seconds: Vec::new(),
        iterations: 0,
        errors: Errors::new(&metrics),
        failed: None,
    };
    let mut sums: Vec<Sum> = request.trackers.iter().map(|_| nothing()).collect();
    let passes = (request.sequences.len() * request.trackers.len() * (request.repeats + 1)) as f64;
    let mut done = 0.0;
    let mut prepared = Prepared::default();
    for sequence in &request.sequences {
        let start = (0..sequence.len())
            .find(|&i| sequence.truth(i).is_some())
            .ok_or_else(|| BenchError::NoStart(sequence_id(sequence)))?;
        let frames = load(request, sequence, start, &mut prepared)?;
        let mut best: Vec<Option<Pass>> = request.trackers.iter().map(|_| None).collect();
        let mut spent = vec![Duration::ZERO; best.len()];
        // Pass by pass rather than tracker by tracker: what disturbs the machine for a while spoils one pass of many
        // trackers, not all of one.
        for pass in 0..=request.repeats {
            for (i, entry) in request.trackers.iter().enumerate() {
                if stop.load(Ordering::Relaxed) {
                    return Err(BenchError::Stopped);
                }
                done += 1.0;
                if sums[i].failed.is_some() || (pass > 1 && spent[i] > request.budget) {
                    continue;
                }
                let begin = Instant::now();
                let made = panics::catch(|| track(entry, sequence, start, &frames, request));
                spent[i] += begin.elapsed();
                match made.and_then(|made| made) {
                    Ok(new) => best[i] = Some(least(best[i].take().filter(|_| pass > 1), new)),
                    Err(reason) => sums[i].failed = Some(format!("{}: {reason}", sequence_id(sequence))),
                }
                progress(done / passes);
            }
        }
        for (sum, pass) in sums.iter_mut().zip(best) {
            let Some(pass) = pass else { continue };
            sum.seconds.extend(pass.seconds);
            sum.iterations += pass.iterations;
            sum.errors.extend(&pass.errors);
        }
    }
    let mut report = BenchReport {
        preparation: prepared.summary(request.pre.id()),
        ..BenchReport::default()
    };
    for (entry, sum) in request.trackers.iter().zip(sums) {
        let id = &entry.name.id;
        match sum.failed {
            Some(reason) => report.failed.push((id.clone(), reason)),
            None if sum.seconds.is_empty() => report
                .failed
                .push((id.clone(), "no frame could be tracked".to_owned())),
            None => {
                let score = Sample::new(&metrics, [&sum.errors]).score();
                let figure = |name| Some(score[name]).filter(|v| v.is_finite());
                report.rows.push(BenchRow {
                    sr_5: figure("sr_5"),
                    al_median: figure("al_median"),
                    ..BenchRow::new(id, sum.seconds, sum.iterations)
                });
            }
        }
    }
    Ok(report)
}

/// Seconds of the preparation of each frame.
#[derive(Default)]
struct Prepared {
    filter: Vec<f64>,
    pyramid: Vec<f64>,
}

impl Prepared {
    fn summary(mut self, filter: String) -> Preparation {
        let median = |seconds: &mut Vec<f64>| {
            seconds.sort_by(f64::total_cmp);
            quantile::nearest(seconds, 0.5).map_or(0.0, |s| 1e6 * s)
        };
        Preparation {
            filter,
            us_filter: median(&mut self.filter),
            us_pyramid: median(&mut self.pyramid),
        }
    }
}

/// Decodes and filters the frames from `start` on, in as many channels as the trackers want.
fn load(
    request: &BenchRequest,
    sequence: &Sequence,
    start: usize,
    prepared: &mut Prepared,
) -> Result<Vec<Frame>, DatasetError> {
    let colour = request.trackers.iter().any(|entry| {
        let made = panics::catch(|| (entry.make)());
        made.and_then(|made| made).is_ok_and(|t| t.channels() == 3)
    });
    (start..sequence.len())
        .map(|i| {
            let decoded = sequence.read(i, colour)?;
            let frame = Frame::new(decoded, Arc::clone(&request.pre));
            let begin = Instant::now();
            frame.gray();
            prepared.filter.push(begin.elapsed().as_secs_f64());
            let begin = Instant::now();
            frame.level(frame.levels() - 1, 1);
            prepared.pyramid.push(begin.elapsed().as_secs_f64());
            if colour {
                frame.colour();
            }
            Ok(frame)
        })
        .collect()
}

fn track(
    entry: &TrackerEntry,
    sequence: &Sequence,
    start: usize,
    frames: &[Frame],
    request: &BenchRequest,
) -> Result<Pass, String> {
    let mut tracker: Box<dyn Tracker> = (entry.make)()?;
    tracker.reseed(request.seed);
    tracker.set_threads(request.threads);
    afford(tracker.as_ref(), RunRequest::MEMORY).map_err(|e| e.to_string())?;
    let truth = sequence.truth(start).ok_or("no ground truth to start from")?;
    tracker
        .init(&frames[0], &truth)
        .map_err(|e| format!("cannot start: {e}"))?;
    let mut pass = Pass {
        seconds: Vec::with_capacity(frames.len()),
        iterations: 0,
        errors: Errors::new(&MetricSet::builtin()),
    };
    for (i, frame) in (start + 1..).zip(&frames[1..]) {
        let truth = sequence.truth(i);
        if let (Some(truth), Some(analysis)) = (&truth, tracker.needs_truth()) {
            analysis.tell_truth(truth);
        }
        touch(frame, tracker.channels());
        let begin = Instant::now();
        let update = tracker.update(frame);
        let seconds = begin.elapsed().as_secs_f64();
        // A frame that could not be tracked is a failure, not a fast frame.
        if let Ok(update) = &update {
            pass.seconds.push(seconds);
            pass.iterations += u64::from(update.iterations);
        }
        if let Some(truth) = truth {
            pass.errors.push(update.ok().map(|u| u.corners).as_ref(), &truth);
        }
    }
    Ok(pass)
}

/// Reads a value of every cache line of a frame and its pyramid, the largest image last.
fn touch(frame: &Frame, channels: usize) {
    const LINE: usize = 16;
    for level in (0..frame.levels()).rev() {
        let image = frame.level(level, channels).with_channels(channels);
        for plane in 0..channels {
            let sum: f32 = image.plane(plane).iter().step_by(LINE).sum();
            std::hint::black_box(sum);
        }
    }
}

/// The least time of each frame; everything else is the same in all passes.
fn least(old: Option<Pass>, mut new: Pass) -> Pass {
    if let Some(old) = old {
        for (new, old) in new.seconds.iter_mut().zip(old.seconds) {
            *new = new.min(old);
        }
    }
    new
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{self, LoadOptions};
    use mtf::image::Identity;
    use mtf::registry::Registry;

    #[test]
    fn figures() {
        let seconds: Vec<f64> = (1..=101).rev().map(|k| f64::from(k) * 1e-6).collect();
        let row = BenchRow::new("t", seconds, 202);
        assert_eq!(
            (row.frames, row.us_median.round(), row.us_p95.round()),
            (101, 51.0, 96.0)
        );
        assert_eq!(row.iterations, Some(2.0));
        assert!(
            (row.us_per_frame - 51.0).abs() < 1e-9 && (row.us_per_iteration.unwrap() - 25.5).abs() < 1e-9
        );
        assert!((row.fps * row.us_per_frame - 1e6).abs() < 1e-3);
        let slow = BenchRow::new("t", vec![102e-6; 10], 10);
        let (frame, iteration) = slow.times(&row);
        assert!((frame - 2.0).abs() < 1e-9 && (iteration.unwrap() - 4.0).abs() < 1e-9);
        let still = BenchRow::new("t", vec![1e-6], 0);
        assert_eq!((still.iterations, still.times(&row).1), (None, None));
    }

    #[test]
    fn passes_keep_the_least_of_each_frame() {
        let pass = |seconds: &[f64]| Pass {
            seconds: seconds.to_vec(),
            iterations: 3,
            errors: Errors::new(&MetricSet::builtin()),
        };
        let kept = least(Some(pass(&[1.0, 5.0])), pass(&[2.0, 4.0]));
        assert_eq!((kept.seconds, kept.iterations), (vec![1.0, 4.0], 3));
    }

    #[test]
    fn measures_what_tracks_and_names_what_does_not() {
        let registry = Arc::new(Registry::builtin());
        let entry = |id: &str| TrackerEntry::from_registry(&registry, &registry.parse(id).unwrap()).unwrap();
        let mut broken = entry("esm/ssd/affine");
        broken.make = Arc::new(|| Err("out of order".to_owned()));
        let options = LoadOptions {
            on_bad_data: dataset::OnBadData::Fail,
            start: 0,
            frame_gap: 1,
            max_frames: Some(6),
            ..LoadOptions::default()
        };
        let set = dataset::load(std::path::Path::new(dataset::BUILTIN), &options).unwrap();
        let request = BenchRequest {
            trackers: vec![
                entry("esm/ssd/homography"),
                broken,
                entry("pf/ssd/affine{n_particles=20}"),
            ],
            sequences: set.sequences.into_iter().take(2).collect(),
            pre: Arc::new(Identity),
            repeats: 1,
            budget: Duration::from_secs(60),
            seed: 0,
            threads: 1,
        };
        let BenchReport { rows, failed, .. } = run(&request, &AtomicBool::new(false), &|_| {}).unwrap();
        assert_eq!((rows.len(), failed.len()), (2, 1));
        assert_eq!(
            (rows[0].tracker.as_str(), rows[0].frames),
            ("esm/ssd/homography", 10)
        );
        assert!(rows[0].iterations.unwrap() >= 1.0 && rows[0].us_per_frame > 0.0);
        assert!(failed[0].1.contains("out of order"));
        let stopped = run(&request, &AtomicBool::new(true), &|_| {});
        assert!(matches!(stopped, Err(BenchError::Stopped)));
    }
}
