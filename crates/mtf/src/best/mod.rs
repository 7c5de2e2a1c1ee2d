//! One tracker of its own: second-order alignment to the first frame's template over a pyramid, started from where the
//! object should be, and, as long as the template does not agree there, from where flow, scans of a coarse level of the
//! image and key points say it is. When motion blurs the image, the template is blurred the same way; how long the shutter
//! is open is learnt from the frames.
//!
//! What decides is always the agreement of the template, block by block: a pose is taken when enough blocks agree, even
//! if the others are covered or outside the image.

mod align;
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
use crate::ssm::Homography;
use crate::tracker::{Stop, TrackError, Tracker, Update};
pub use entry::ENTRY;

use align::{Aligner, Score};
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

/// Fewest blocks that agree, and least share of all, where the object has been found.
const AGREEING: (usize, f64) = (4, 0.2);
/// Frames whose scores are remembered.
const MEMORY: usize = 15;
/// Correlation of the best blocks, relative to the median of the last frames, from which the object has been found, and
/// from which key points need not be asked.
const FOUND: (f64, f64) = (0.72, 0.85);
/// The same and the least total once it has been lost, or for more than a few frames: among so many places, some look a
/// little like it.
const FOUND_AGAIN: (f64, f64) = (0.8, 0.33);
const FEW: usize = 5;
/// The least total anywhere else, unless the best blocks agree so well that the others must be covered.
const FOUND_ELSEWHERE: f64 = 0.42;
const PERFECT: f64 = 0.93;
/// What is usual before anything has been found: then the absolute limit decides.
const USUAL: (f64, f64) = (1.0, 0.0);
/// What is left of the motion after each frame in which the object is lost.
const SLOWER: f64 = 0.8;
/// Total from which there is no doubt that the object is where it seems to be.
const SURE: f64 = 0.45;
/// Motion between frames from which blur tells of the exposure, px; into how many steps exposures are divided, what they
/// must be better by than none, how far each frame is followed, and of how many frames one is looked at while there is no
/// blur.
const FAST: f64 = 10.0;
const EXPOSURES: usize = 5;
const SURER: f64 = 0.012;
const FOLLOW: f64 = 0.4;
const OFTEN: usize = 4;

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
    gains: [f64; EXPOSURES + 1],
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
            feat_points: 800,
            feat_points_whole: 1500,
            ..FeatureParams::default()
        };
        let klt = KltParams {
            klt_iters: 15,
            klt_epsilon: 0.03,
            ..KltParams::default()
        };
        let estimator = EstimatorParams {
            estimator: EstimateMethod::Ransac,
            est_thresh: 3.0,
            est_iters: 500,
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
            scores: VecDeque::with_capacity(MEMORY + 1),
            sorted: Vec::with_capacity(MEMORY + 1),
            usual: USUAL,
            last: 1.0,
            doubtful: 0,
            gains: [0.0; EXPOSURES + 1],
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
        self.doubtful = if score.total < FOUND_AGAIN.1 {
            self.doubtful + 1
        } else {
            0
        };
        self.scores.push_back(score);
        if self.scores.len() > MEMORY {
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
            (FOUND_AGAIN.0, FOUND_ELSEWHERE)
        } else if self.lost == 0 && self.doubtful < FEW {
            (FOUND.0, 0.0)
        } else {
            FOUND_AGAIN
        };
        let score = &at.score;
        (score.total >= total || score.best >= PERFECT && score.total >= FOUND_AGAIN.1)
            && score.best >= self.params.best_found.max(part * self.usual.1)
            && score.agreeing >= AGREEING.0
            && score.agree >= AGREEING.1
    }

    /// Looks for the exposure that explains best, over the last frames, how an object that moves fast is blurred.
    fn learn_exposure(&mut self, frame: &Frame, pose: &Mat3) {
        let judge = self.params.best_judge;
        if self.aligner.way(pose) < FAST {
            return;
        }
        self.moved += 1;
        if self.moved > OFTEN && self.aligner.smear.exposure == 0.0 && !self.moved.is_multiple_of(OFTEN) {
            return;
        }
        let mut sharp = 0.0;
        for (k, gain) in self.gains.iter_mut().enumerate() {
            self.aligner.smear.exposure = k as f64 / EXPOSURES as f64;
            let total = self.aligner.assess(frame, pose, judge).total;
            if k == 0 {
                sharp = total;
            }
            *gain += (total - sharp - *gain) * FOLLOW.max(1.0 / self.moved as f64);
        }
        let gains = &self.gains;
        let best = (0..=EXPOSURES).fold(0, |best, k| if gains[k] > gains[best] { k } else { best });
        self.aligner.smear.exposure = if gains[best] < SURER {
            0.0
        } else {
            // The top of the parabola through it and its neighbours.
            let (below, above) = (gains[best - 1], gains[(best + 1).min(EXPOSURES)]);
            let bend = below - 2.0 * gains[best] + above;
            let top = if bend < 0.0 {
                0.5 * (below - above) / bend
            } else {
                0.0
            };
            ((best as f64 + top.clamp(-0.5, 0.5)) / EXPOSURES as f64).min(1.0)
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
        self.speed = self.speed.map(|v| v * SLOWER);
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
            self.speed = self.speed.map(|v| v * SLOWER);
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
        self.scores.clear();
        self.usual = USUAL;
        self.last = 1.0;
        self.doubtful = 0;
        self.unsure = 0;
        self.scans = 0;
        self.gains = [0.0; EXPOSURES + 1];
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
        self.aligner.smear.back = back;
        let score = best.map_or(Score::default(), |b| b.score);
        let sure = best.is_some_and(|b| self.found(&b) && b.score.total >= SURE);
        self.unsure = if sure { 0 } else { self.unsure + 1 };
        if let Some(b) = best.filter(|b| self.found(b)) {
            if score.total >= SURE {
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
            stop: Stop::Done,
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
        self.aligner.memory() + self.scanner.memory() + self.klt.memory() + self.features.memory()
    }
}

#[cfg(test)]
mod tests;
