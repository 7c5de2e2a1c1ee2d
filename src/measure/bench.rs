//! Speed of trackers: time of `update` alone, on one thread, over frames that are decoded and filtered beforehand. The
//! pixels of a frame are read once, untimed, right before each update, as filtering does in a tracker's daily work: else
//! every update would begin by waiting for a frame that others have pushed out of the caches.
//!
//! Every pass over a sequence starts a fresh tracker with the same seed, so a frame costs the same work each time and the
//! least of its times is what the machine can do undisturbed. All figures are of these least times: their sum over all
//! frames (per frame, per iteration), their median and 95th percentile. Image pyramids are made once per frame and count
//! as filtering.
//!
//! What a loop around a camera would see takes the time of input along: decoding, filtering, and halving for trackers that
//! read the pyramid, each with its median over all frames.

use crate::dataset::{DatasetError, Sequence};
use crate::measure::lead::{Passes, ratio};
use crate::measure::machine::Machine;
use crate::metric::{Errors, MetricSet, Sample, quantile};
use crate::panics;
use crate::plan::{Job, RunRequest, TrackerEntry, sequence_id, usual_filter};
use mtf::image::{Frame, PreProcessor};
use mtf::tracker::{Tracker, afford};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

pub use crate::measure::lead::Lead;

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
    /// Updates that gave no corners. They have no time: giving up is no speed.
    pub lost: usize,
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
    /// Frames per second with input: `1e6 / (us_per_frame + us_input)`, where the input of a frame is decoding, the filter
    /// and, for trackers that read it, the pyramid ([`Preparation::us_input`]). None for other programs that do not say.
    pub fps_with_input: Option<f64>,
    /// Fraction of the frames within 5 px of the truth: the speed of a tracker that has lost its object says little.
    pub sr_5: Option<f64>,
    /// Median alignment error over the frames, px: the accuracy that the time was spent on.
    pub al_median: Option<f64>,
}

/// What is done to each frame before any update, and not in its time: the medians over all frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Preparation {
    /// The filter, as `--pre` reads it.
    pub filter: String,
    /// µs to read and decode a frame.
    pub us_decode: f64,
    /// µs to make gray floats of the decoded bytes and filter them.
    pub us_filter: f64,
    /// µs to do so in three channels; 0 where no tracker reads colour.
    pub us_colour: f64,
    /// µs to halve the filtered image until it is small, for trackers that search pyramids.
    pub us_pyramid: f64,
}

impl Preparation {
    /// µs of input of a frame for a tracker that reads `channels` and, perhaps, the `pyramid`.
    pub fn us_input(&self, channels: usize, pyramid: bool) -> f64 {
        let filter = if channels == 1 {
            self.us_filter
        } else {
            self.us_colour
        };
        self.us_decode + filter + if pyramid { self.us_pyramid } else { 0.0 }
    }
}

/// A sequence as it was measured on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeasuredSequence {
    /// `dataset/sequence`.
    pub sequence: String,
    /// Frames from the first on that was read.
    pub frames: usize,
    /// Identity of those frames and their ground truth ([`Sequence::fingerprint`]).
    pub fingerprint: String,
}

/// Settings that times depend on and that ids of trackers do not hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BenchSettings {
    /// [`BenchRequest::repeats`].
    pub repeats: usize,
    /// [`BenchRequest::threads`].
    pub threads_per_tracker: usize,
    /// [`BenchRequest::seed`].
    pub seed: u64,
}

impl BenchRequest {
    /// The data, as a measurement keeps it. Reads the files of all frames.
    pub fn data(&self) -> Vec<MeasuredSequence> {
        let measured = |s: &Sequence| MeasuredSequence {
            sequence: sequence_id(s),
            frames: s.len(),
            fingerprint: s.fingerprint(),
        };
        self.sequences.iter().map(measured).collect()
    }

    /// The settings, as a measurement keeps them.
    pub fn settings(&self) -> BenchSettings {
        BenchSettings {
            repeats: self.repeats,
            threads_per_tracker: self.threads,
            seed: self.seed,
        }
    }

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
    /// A row per tracker, fastest first.
    pub rows: Vec<BenchRow>,
    /// The first row beside the second; `None` with fewer, or where no frame has a time of both.
    pub lead: Option<Lead>,
    /// Trackers without figures, and why.
    pub failed: Vec<(String, String)>,
}

impl BenchRow {
    /// Times of frames that took `seconds` each, NaN for lost ones, and `iterations` together.
    fn new(tracker: &str, mut seconds: Vec<f64>, iterations: u64) -> BenchRow {
        let all = seconds.len();
        seconds.retain(|s| !s.is_nan());
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
            lost: all - frames,
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
    /// The data; empty in measurements of other programs, which say nothing of it.
    #[serde(default)]
    pub data: Vec<MeasuredSequence>,
    /// The settings, where they are known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settings: Option<BenchSettings>,
    /// What each frame cost before its updates.
    #[serde(default)]
    pub preparation: Preparation,
    /// A row per tracker.
    pub rows: Vec<BenchRow>,
    /// The fastest beside the next.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lead: Option<Lead>,
    /// Combinations that cannot work, and why.
    #[serde(default)]
    pub refused: Vec<(String, String)>,
    /// Trackers without figures, and why.
    #[serde(default)]
    pub failed: Vec<(String, String)>,
}

impl Measurement {
    /// Why times of this measurement do not compare with those of `data` after `filter`: other sequences, frames or filter.
    /// `None` where they do, or where it does not say what it is of.
    pub fn other_than(&self, data: &[MeasuredSequence], filter: &str) -> Option<String> {
        if !self.preparation.filter.is_empty() && self.preparation.filter != filter {
            let theirs = &self.preparation.filter;
            return Some(format!("filter {theirs} there, {filter} here (--pre)"));
        }
        if self.data.is_empty() {
            return None;
        }
        for ours in data {
            let id = &ours.sequence;
            let Some(theirs) = self.data.iter().find(|s| s.sequence == *id) else {
                return Some(format!("{id} is not in it"));
            };
            if theirs.frames != ours.frames {
                let frames = [theirs.frames, ours.frames];
                return Some(format!(
                    "{id} has {} frames there, {} here (--start, --frame-gap, --max-frames)",
                    frames[0], frames[1]
                ));
            }
            if theirs.fingerprint != ours.fingerprint {
                return Some(format!("{id} has other frames or ground truth there"));
            }
        }
        let more = self
            .data
            .iter()
            .find(|s| data.iter().all(|ours| ours.sequence != s.sequence));
        more.map(|s| format!("{} is not measured here", s.sequence))
    }
}

/// What the measurement of one tracker adds up to, over sequences.
struct Sum {
    /// Least time of each frame, NaN for those that were lost.
    seconds: Vec<f64>,
    /// The times of all passes, per sequence.
    passes: Vec<Passes>,
    /// Whether the tracker read a pyramid.
    pyramid: bool,
    channels: usize,
    iterations: u64,
    errors: Errors,
    failed: Option<String>,
}

/// One pass over a sequence.
struct Pass {
    /// NaN for frames that were lost.
    seconds: Vec<f64>,
    /// Of the first update of a pass to warm up.
    pyramid: bool,
    channels: usize,
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
        passes: Vec::new(),
        pyramid: false,
        channels: 1,
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
        let mut passes_of: Vec<Passes> = vec![Passes::new(); best.len()];
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
                let made = panics::catch(|| track(entry, sequence, start, &frames, request, pass == 0));
                spent[i] += begin.elapsed();
                match made.and_then(|made| made) {
                    Ok(new) if pass == 0 => {
                        sums[i].pyramid |= new.pyramid;
                        sums[i].channels = new.channels;
                    }
                    Ok(new) => {
                        passes_of[i].push(new.seconds.iter().map(|&s| s as f32).collect());
                        best[i] = Some(least(best[i].take(), new));
                    }
                    Err(reason) => sums[i].failed = Some(format!("{}: {reason}", sequence_id(sequence))),
                }
                progress(done / passes);
            }
        }
        for ((sum, pass), passes) in sums.iter_mut().zip(best).zip(passes_of) {
            let Some(pass) = pass else { continue };
            sum.passes.push(passes);
            sum.seconds.extend(pass.seconds);
            sum.iterations += pass.iterations;
            sum.errors.extend(&pass.errors);
        }
    }
    let mut report = BenchReport {
        preparation: prepared.summary(request.pre.id()),
        ..BenchReport::default()
    };
    let mut measured: Vec<(BenchRow, Vec<Passes>)> = Vec::new();
    for (entry, sum) in request.trackers.iter().zip(sums) {
        let id = &entry.name.id;
        match sum.failed {
            Some(reason) => report.failed.push((id.clone(), reason)),
            None if sum.seconds.iter().all(|s| s.is_nan()) => report
                .failed
                .push((id.clone(), "no frame could be tracked".to_owned())),
            None => {
                let score = Sample::new(&metrics, [&sum.errors]).score();
                let figure = |name| Some(score[name]).filter(|v| v.is_finite());
                let row = BenchRow::new(id, sum.seconds, sum.iterations);
                let input = report.preparation.us_input(sum.channels, sum.pyramid);
                let row = BenchRow {
                    fps_with_input: Some(1e6 / (row.us_per_frame + input)),
                    sr_5: figure("sr_5"),
                    al_median: figure("al_median"),
                    ..row
                };
                measured.push((row, sum.passes));
            }
        }
    }
    measured.sort_by(|(a, _), (b, _)| b.fps.total_cmp(&a.fps).then_with(|| a.tracker.cmp(&b.tracker)));
    if let [(fastest, fast), (next, slow), ..] = &measured[..] {
        report.lead = ratio(fast, slow).map(|(times, interval)| Lead {
            fastest: fastest.tracker.clone(),
            next: next.tracker.clone(),
            times,
            interval,
        });
    }
    report.rows = measured.into_iter().map(|(row, _)| row).collect();
    Ok(report)
}

/// Seconds of the preparation of each frame.
#[derive(Default)]
struct Prepared {
    decode: Vec<f64>,
    filter: Vec<f64>,
    colour: Vec<f64>,
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
            us_decode: median(&mut self.decode),
            us_colour: median(&mut self.colour),
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
    let job = Job {
        sequence: Some(sequence),
        start,
    };
    let colour = request.trackers.iter().any(|entry| {
        let made = panics::catch(|| (entry.make)(job));
        made.and_then(|made| made).is_ok_and(|t| t.channels() == 3)
    });
    (start..sequence.len())
        .map(|i| {
            let begin = Instant::now();
            let decoded = sequence.read(i, colour)?;
            prepared.decode.push(begin.elapsed().as_secs_f64());
            let frame = Frame::new(decoded, Arc::clone(&request.pre));
            let begin = Instant::now();
            frame.gray();
            prepared.filter.push(begin.elapsed().as_secs_f64());
            let begin = Instant::now();
            frame.level(frame.levels() - 1, 1);
            prepared.pyramid.push(begin.elapsed().as_secs_f64());
            if colour {
                let begin = Instant::now();
                frame.colour();
                prepared.colour.push(begin.elapsed().as_secs_f64());
            }
            Ok(frame)
        })
        .collect()
}

/// A pass. One to warm up finds out from its first update whether the tracker reads pyramids.
fn track(
    entry: &TrackerEntry,
    sequence: &Sequence,
    start: usize,
    frames: &[Frame],
    request: &BenchRequest,
    warm_up: bool,
) -> Result<Pass, String> {
    let job = Job {
        sequence: Some(sequence),
        start,
    };
    let mut tracker: Box<dyn Tracker> = (entry.make)(job)?;
    tracker.reseed(request.seed);
    tracker.set_threads(request.threads);
    afford(tracker.as_ref(), RunRequest::MEMORY).map_err(|e| e.to_string())?;
    let truth = sequence.truth(start).ok_or("no ground truth to start from")?;
    tracker
        .init(&frames[0], &truth)
        .map_err(|e| format!("cannot start: {e}"))?;
    let mut pass = Pass {
        seconds: Vec::with_capacity(frames.len()),
        pyramid: false,
        channels: tracker.channels(),
        iterations: 0,
        errors: Errors::new(&MetricSet::builtin()),
    };
    let fresh = match frames.get(1) {
        Some(frame) if warm_up => Some(Frame::new(frame.decoded().clone(), Arc::clone(&request.pre))),
        _ => None,
    };
    for (i, frame) in (start + 1..).zip(&frames[1..]) {
        let fresh = fresh.as_ref().filter(|_| i == start + 1);
        let frame = fresh.unwrap_or(frame);
        let truth = sequence.truth(i);
        if let (Some(truth), Some(analysis)) = (&truth, tracker.needs_truth()) {
            analysis.tell_truth(truth);
        }
        if fresh.is_none() {
            touch(frame, tracker.channels());
        }
        let begin = Instant::now();
        let update = tracker.update(frame);
        let seconds = begin.elapsed().as_secs_f64();
        pass.pyramid |= fresh.is_some_and(Frame::is_halved);
        // A frame that could not be tracked is a failure, not a fast frame.
        match &update {
            Ok(update) => {
                pass.seconds.push(seconds);
                pass.iterations += u64::from(update.iterations);
            }
            Err(_) => pass.seconds.push(f64::NAN),
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
    fn lost_frames_have_no_time() {
        let row = BenchRow::new("t", vec![2e-6, f64::NAN, 4e-6], 2);
        assert_eq!((row.frames, row.lost), (2, 1));
        assert!((row.us_per_frame - 3.0).abs() < 1e-9 && row.us_p95.is_finite());
    }

    #[test]
    fn input_is_what_the_tracker_reads() {
        let made = Preparation {
            us_decode: 1000.0,
            us_filter: 100.0,
            us_colour: 300.0,
            us_pyramid: 20.0,
            ..Preparation::default()
        };
        let inputs = [(1, false), (1, true), (3, false)].map(|(c, p)| made.us_input(c, p));
        assert_eq!(inputs, [1100.0, 1120.0, 1300.0]);
    }

    #[test]
    fn other_data_frames_and_filters_do_not_compare() {
        let sequence = |id: &str, frames: usize, fingerprint: &str| MeasuredSequence {
            sequence: id.to_owned(),
            frames,
            fingerprint: fingerprint.to_owned(),
        };
        let mut saved = Measurement::default();
        let data = vec![sequence("d/a", 9, "1"), sequence("d/b", 5, "2")];
        assert_eq!(saved.other_than(&data, "none"), None);
        saved.data = data.clone();
        saved.preparation.filter = "none".to_owned();
        assert_eq!(saved.other_than(&data, "none"), None);
        let why = |data: &[MeasuredSequence], filter: &str| saved.other_than(data, filter).unwrap();
        assert!(why(&data, "gaussian:5:3").contains("filter none there, gaussian:5:3 here"));
        assert!(why(&data[..1], "none").contains("d/b is not measured here"));
        assert!(why(&[sequence("d/c", 5, "2")], "none").contains("d/c is not in it"));
        assert!(why(&[sequence("d/a", 7, "1")], "none").contains("9 frames there, 7 here"));
        assert!(why(&[sequence("d/a", 9, "3")], "none").contains("other frames or ground truth"));
    }

    #[test]
    fn passes_keep_the_least_of_each_frame() {
        let pass = |seconds: &[f64]| Pass {
            seconds: seconds.to_vec(),
            pyramid: false,
            channels: 1,
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
        broken.make = Arc::new(|_| Err("out of order".to_owned()));
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
        let BenchReport {
            preparation,
            rows,
            lead,
            failed,
        } = run(&request, &AtomicBool::new(false), &|_| {}).unwrap();
        assert_eq!((rows.len(), failed.len()), (2, 1));
        assert!(rows[0].fps >= rows[1].fps, "{rows:?}");
        let lead = lead.unwrap();
        assert_eq!((&lead.fastest, &lead.next), (&rows[0].tracker, &rows[1].tracker));
        assert!(lead.times >= 1.0 && lead.interval[0] <= lead.times && lead.times <= lead.interval[1]);
        let esm = rows.iter().find(|r| r.tracker == "esm/ssd/homography").unwrap();
        assert_eq!((esm.frames, esm.lost), (10, 0));
        assert!(esm.iterations.unwrap() >= 1.0 && esm.us_per_frame > 0.0);
        // No pyramid is read.
        let input = preparation.us_decode + preparation.us_filter;
        let with_input = 1e6 / (esm.us_per_frame + input);
        assert!((esm.fps_with_input.unwrap() / with_input - 1.0).abs() < 1e-9);
        assert!(preparation.us_decode > 0.0 && with_input < esm.fps);
        assert!(failed[0].1.contains("out of order"));
        let stopped = run(&request, &AtomicBool::new(true), &|_| {});
        assert!(matches!(stopped, Err(BenchError::Stopped)));
    }
}
