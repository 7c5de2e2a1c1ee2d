//! One tracker for planes that move fast, turn, come near, are half covered, blurred or outside the image. It has one
//! file per part; uses everything up to `compose`.
//!
//! # What happens in a frame
//!
//! *Starts* are proposed one after the other, each is *aligned* and *judged*, and the search ends with the first that is
//! good enough (`Best::locate` in `seek.rs`):
//!
//! 1. **Motion.** The object goes on as it moved last, or stays, whichever agrees better.
//! 2. **Flow.** The blocks that agreed in the last frame are followed by sparse flow, and a homography is fitted.
//! 3. **A near scan** (`Scanner` in `scan.rs`) compares the template with every place around, on a coarse level.
//! 4. **A wider scan** does so for seven turns and three sizes, three times as far.
//! 5. **Key points** find the object by its features ([`FeatureTracker`]).
//! 6. **A scan of the whole image**, a third of all turns and sizes in each frame.
//!
//! The last three take turns while the object remains lost.
//!
//! Aligning (`Aligner` in `align/`) is Gauss-Newton on the homography, coarse to fine: the points of a level (`View` in
//! `view.rs`) lie in blocks, and blocks that do not fit lose their weight. Judging gives a `Score`: how well the
//! template's blocks correlate with the image. The object is *found* when enough of them do, whatever covers the others
//! (`Best::found`).
//!
//! When the object is found, three things are learnt: its motion, what score is usual, and, while it moves fast, how long
//! the shutter is open (`Best::learn_exposure`). The template is blurred by motion as the image is (`smear.rs`). The
//! template itself stays that of the first frame, so nothing drifts. When it is not found, the pose follows flow for some
//! frames, then goes on a little as it moved last.
//!
//! Users choose [`BestParams`]; all other numbers are in `constants.rs`, with units and reasons.

mod align;
#[cfg(feature = "ablation")]
pub mod constants;
#[cfg(not(feature = "ablation"))]
mod constants;
mod entry;
mod scan;
mod seek;
mod smear;
mod view;

use crate::consensus::{EstimateMethod, Estimator, EstimatorParams};
use crate::features::{FeatureParams, FeatureTracker, MatchParams};
use crate::flow::{Klt, KltParams};
use crate::geom::{Corners, Mat3, homography};
use crate::image::Frame;
use crate::interrupt;
use crate::ssm::Homography;
use crate::tracker::{Stop, TrackError, Tracker, Update};
pub use entry::ENTRY;

use align::{Aligner, Score};
use constants::K;
use scan::{Found, Scanner};
use std::collections::VecDeque;

crate::params! {
    /// Parameters of `best`.
    pub struct BestParams {
        /// Points of the template at each level of the pyramid, at most about this many.
        best_points: usize = 3600, in 200..=1_000_000;
        /// Points that poses are judged with, at least, where the template has as many.
        best_judge: usize = 1200, in 100..=100_000;
        /// Score, relative to the median of the last frames, from which no other start is tried.
        best_enough: f64 = 0.9, in 0.0..=1.0;
        /// Mean correlation of the best two fifths of the visible template from which it has been found.
        best_found: f64 = 0.6, in 0.0..=1.0;
        /// Distance that is searched around the last place, px.
        best_reach: f64 = 48.0, in 0.0..=1000.0;
        /// Most frames that flow alone is believed.
        best_coast: usize = 10, in 0..=10_000;
    }
}

/// Usual total and correlation of the best blocks before anything has been found: then the absolute limits decide.
const USUAL: (f64, f64) = (1.0, 0.0);
/// Bytes per point of the template, over all levels, with what a scan of a frame of usual size takes.
const POINT_BYTES: usize = 300;

/// The tracker `best`; its similarity is the mean of the cubed correlations of the template's blocks, 0 to 1 (blocks
/// outside the image count less).
pub struct Best {
    params: BestParams,
    aligner: Aligner,
    scanner: Scanner,
    /// Places of a scan, and those aligned coarsely, with their scores and contrasts.
    places: Vec<Found>,
    coarse: Vec<(Mat3, Score, f32)>,
    pose: Mat3,
    /// Where the object was expected in the last frame.
    expected: Mat3,
    /// Whether what has been found in this frame is blurred by motion, once it is known.
    blurred: Option<bool>,
    /// Motion in the image from the frame before the last to the last.
    motion: Mat3,
    /// That of its middle, px; less and less of it while the object is lost.
    speed: [f64; 2],
    previous: Option<Frame>,
    klt: Klt,
    estimator: Estimator,
    features: FeatureTracker<Homography>,
    has_features: bool,
    seed: u64,
    /// Scores of the last frames in which the object was found.
    scores: VecDeque<Score>,
    sorted: Vec<f64>,
    /// Medians of their totals and of the correlations of their best blocks.
    usual: (f64, f64),
    /// Total of the last frame in which it was found.
    last: f64,
    /// Frames in a row in which what was found was little like the object.
    doubtful: usize,
    /// Mean gain of the total with each exposure, and frames in which the object moved fast.
    gains: Vec<f64>,
    moved: usize,
    /// Frames in a row in which it was not sure that the object was found.
    unsure: usize,
    /// Parts of the whole image's scan that have been done.
    scans: usize,
    /// Frames since the object was last found, and of these those in which flow was believed.
    lost: usize,
    /// Places in the base that flow follows, and pairs of places in the last frame and this one.
    nodes: Vec<[f64; 2]>,
    from: Vec<[f64; 2]>,
    to: Vec<[f64; 2]>,
    iterations: u32,
}

impl Best {
    /// With its parameters.
    pub fn new(params: BestParams) -> Self {
        let features = FeatureParams {
            feat_points: K.key_points,
            feat_points_whole: K.key_points_whole,
            ..FeatureParams::default()
        };
        let klt = KltParams {
            klt_iters: K.flow_steps,
            klt_epsilon: K.flow_epsilon,
            ..KltParams::default()
        };
        let estimator = EstimatorParams {
            estimator: EstimateMethod::Ransac,
            est_thresh: K.flow_threshold,
            est_iters: K.flow_samples,
            ..EstimatorParams::default()
        };
        Best {
            params,
            aligner: Aligner::default(),
            scanner: Scanner::default(),
            places: Vec::new(),
            coarse: Vec::new(),
            pose: Mat3::identity(),
            expected: Mat3::identity(),
            blurred: None,
            motion: Mat3::identity(),
            speed: [0.0; 2],
            previous: None,
            klt: Klt::new(klt),
            estimator: Estimator::new(estimator, 0),
            features: FeatureTracker::new(
                features,
                MatchParams::default(),
                EstimatorParams::default(),
                Homography::default(),
            ),
            has_features: false,
            seed: 0,
            scores: VecDeque::with_capacity(K.remembered + 1),
            sorted: Vec::with_capacity(K.remembered + 1),
            usual: USUAL,
            last: 1.0,
            doubtful: 0,
            gains: vec![0.0; K.exposures + 1],
            moved: 0,
            unsure: 0,
            scans: 0,
            lost: 0,
            nodes: Vec::new(),
            from: Vec::new(),
            to: Vec::new(),
            iterations: 0,
        }
    }

    /// Takes note of the score of a frame in which the object was found.
    fn remember(&mut self, score: Score) {
        self.last = score.total;
        self.doubtful = if score.total < K.again_total {
            self.doubtful + 1
        } else {
            0
        };
        self.scores.push_back(score);
        if self.scores.len() > K.remembered {
            self.scores.pop_front();
        }
        let mut median = |of: fn(&Score) -> f64| {
            self.sorted.clear();
            self.sorted.extend(self.scores.iter().map(of));
            self.sorted.sort_unstable_by(f64::total_cmp);
            self.sorted[self.sorted.len() / 2]
        };
        self.usual = (median(|s| s.total), median(|s| s.best));
    }

    /// Whether the object is at a candidate.
    fn found(&self, at: &seek::Candidate) -> bool {
        let (part, total) = if !at.near {
            (K.again_part, K.elsewhere_total)
        } else if self.lost == 0 && self.doubtful < K.doubtful_frames {
            (K.found_part, 0.0)
        } else {
            (K.again_part, K.again_total)
        };
        let score = &at.score;
        (score.total >= total || score.best >= K.covered_best && score.total >= K.again_total)
            && score.best >= self.params.best_found.max(part * self.usual.1)
            && score.agreeing >= K.agreeing_blocks
            && score.agree >= K.agreeing_share
    }

    /// Looks for the exposure that explains best, over the last frames, how an object that moves fast is blurred.
    fn learn_exposure(&mut self, frame: &Frame, pose: &Mat3) {
        let judge = self.params.best_judge;
        if self.aligner.way(pose) < K.fast {
            return;
        }
        self.moved += 1;
        if self.moved > K.exposure_every
            && self.aligner.smear.exposure == 0.0
            && !self.moved.is_multiple_of(K.exposure_every)
        {
            return;
        }
        let mut sharp = 0.0;
        for (k, gain) in self.gains.iter_mut().enumerate() {
            self.aligner.smear.exposure = k as f64 / K.exposures as f64;
            let total = self.aligner.assess(frame, pose, judge).total;
            if k == 0 {
                sharp = total;
            }
            *gain += (total - sharp - *gain) * K.follow.max(1.0 / self.moved as f64);
        }
        let gains = &self.gains[..];
        let best = (0..=K.exposures).fold(0, |best, k| if gains[k] > gains[best] { k } else { best });
        self.aligner.smear.exposure = if gains[best] < K.blur_gain {
            0.0
        } else {
            // The top of the parabola through it and its neighbours.
            let (below, above) = (gains[best - 1], gains[(best + 1).min(K.exposures)]);
            let bend = below - 2.0 * gains[best] + above;
            let top = if bend < 0.0 {
                0.5 * (below - above) / bend
            } else {
                0.0
            };
            ((best as f64 + top.clamp(-0.5, 0.5)) / K.exposures as f64).min(1.0)
        };
    }

    /// Goes on for a while as the object moved last, as long as its middle stays within the image.
    fn drift(&mut self, frame: &Frame) {
        let [dx, dy] = self.speed;
        let next = Mat3::new(1.0, 0.0, dx, 0.0, 1.0, dy, 0.0, 0.0, 1.0) * self.pose;
        let [x, y] = homography::apply(&next, [0.0; 2]);
        if x >= 0.0 && y >= 0.0 && x < frame.width() as f64 && y < frame.height() as f64 {
            self.pose = next;
        }
        self.speed = self.speed.map(|v| v * K.slower);
    }

    /// Moves to a pose; flow follows the blocks that agree there.
    fn settle(&mut self, frame: &Frame, pose: Mat3) {
        if let Some(back) = self.pose.try_inverse() {
            let motion = pose * back;
            self.motion = motion / motion[(2, 2)];
        }
        if self.unsure == 0 {
            let [from, to] = [&self.pose, &pose].map(|p| homography::apply(p, [0.0; 2]));
            self.speed = [to[0] - from[0], to[1] - from[1]];
        } else {
            self.speed = self.speed.map(|v| v * K.slower);
        }
        self.pose = pose;
        let judge = self.params.best_judge;
        self.aligner.assess(frame, &pose, judge);
        self.nodes.clear();
        let agreeing = self.aligner.agreeing(frame, &pose, judge);
        self.nodes.extend(agreeing);
    }
}

impl Tracker for Best {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        if !corners.is_finite() {
            return Err(TrackError::NotFinite("corners"));
        }
        if !corners.is_convex() {
            return Err(TrackError::BadRegion("corners are not a convex quadrilateral"));
        }
        if !self.aligner.learn(frame, corners, self.params.best_points) {
            return Err(TrackError::Template("no texture"));
        }
        self.pose = self
            .aligner
            .pose_at(corners)
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        self.scanner.learn(frame, corners);
        self.features.reseed(self.seed);
        self.estimator.reseed(self.seed ^ 1);
        // Without key points all else works.
        self.has_features = self.features.init(frame, corners).is_ok();
        interrupt::check()?;
        self.scores.clear();
        self.usual = USUAL;
        self.last = 1.0;
        self.doubtful = 0;
        self.unsure = 0;
        self.scans = 0;
        self.gains.fill(0.0);
        self.moved = 0;
        self.lost = 0;
        self.settle(frame, self.pose);
        self.motion = Mat3::identity();
        self.speed = [0.0; 2];
        self.previous = Some(frame.clone());
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        if self.previous.is_none() {
            return Err(TrackError::NotInitialised);
        }
        self.iterations = 0;
        let back = self.pose.try_inverse().filter(|_| self.lost == 0);
        self.aligner.smear.back = back;
        let (best, coast) = self.locate(frame);
        interrupt::check()?;
        self.aligner.smear.back = back;
        let score = best.map_or(Score::default(), |b| b.score);
        let sure = best.is_some_and(|b| self.found(&b) && b.score.total >= K.sure_total);
        self.unsure = if sure { 0 } else { self.unsure + 1 };
        if let Some(b) = best.filter(|b| self.found(b)) {
            if score.total >= K.sure_total {
                self.learn_exposure(frame, &b.pose);
            }
            self.settle(frame, b.pose);
            if self.lost > 0 {
                self.motion = Mat3::identity();
                self.speed = [0.0; 2];
            }
            self.lost = 0;
            self.remember(score);
            self.previous = Some(frame.clone());
        } else {
            self.lost += 1;
            match coast.filter(|_| self.lost <= self.params.best_coast) {
                Some(pose) => {
                    // The nodes stay those that agreed last.
                    self.pose = pose;
                    self.previous = Some(frame.clone());
                }
                None => {
                    self.lost = self.lost.max(self.params.best_coast);
                    self.drift(frame);
                }
            }
            self.motion = Mat3::identity();
        }
        Ok(Update {
            corners: self.corners(),
            stop: match self.lost {
                0 => Stop::Done,
                _ => Stop::Absent,
            },
            iterations: self.iterations,
            similarity: score.total,
        })
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        if self.previous.is_none() {
            return Err(TrackError::NotInitialised);
        }
        if !corners.is_finite() {
            return Err(TrackError::NotFinite("corners"));
        }
        let pose = self.aligner.pose_at(corners);
        self.pose = pose.ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        self.motion = Mat3::identity();
        self.speed = [0.0; 2];
        Ok(())
    }

    fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.set_region(corners)?;
        self.previous = Some(frame.clone());
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.aligner.corners(&self.pose)
    }

    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        Some(homography::apply(&self.pose, self.aligner.to_base(x)))
    }

    fn reseed(&mut self, seed: u64) {
        self.seed = seed;
    }

    fn memory(&self) -> usize {
        let own = if self.previous.is_none() {
            POINT_BYTES * self.params.best_points
        } else {
            self.aligner.memory() + self.scanner.memory()
        };
        own + self.klt.memory() + self.features.memory()
    }
}

#[cfg(test)]
mod tests;
