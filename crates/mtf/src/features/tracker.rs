//! Key points of the template found again in each frame, and one warp fitted to the matches.

use super::{Extractor, KeyPoint, MatchParams, Matcher, Region, SCALES, scale_factor};
use crate::consensus::{Estimator, EstimatorParams};
use crate::geom::{Corners, Mat3, homography};
use crate::image::Frame;
use crate::interrupt;
use crate::kernels::{Bits, hamming};
use crate::ssm::{self, StateSpaceModel};
use crate::tracker::{Stop, TrackError, Tracker, Update};

crate::params! {
    /// Parameters of tracking by key points.
    pub struct FeatureParams {
        /// Key points of the template, at most.
        feat_template: usize = 600, in 8..=20_000;
        /// Key points of the searched part of a frame, at most.
        feat_points: usize = 1000, in 8..=20_000;
        /// Key points of a whole frame, at most.
        feat_points_whole: usize = 2000, in 8..=50_000;
        /// Margin of the search window around the last region, as a fraction of its longer side; 0: the whole image.
        feat_margin: f64 = 0.5, in 0.0..=100.0;
        /// Least number of matches that agree with the warp.
        feat_min: usize = 10, in 4..=10_000;
    }
}

/// An object that was found by its key points.
#[derive(Clone, Copy, Debug)]
pub struct Detection {
    /// Its corners, px.
    pub corners: Corners,
    /// Matches that agree with the warp.
    pub inliers: usize,
    /// The same as a fraction of the template's key points that should be visible.
    pub support: f64,
}

/// Finds the template's key points in a window around the last region, or else in the whole frame, and fits the warp
/// `S` to the matches, outliers apart. Its similarity is the fraction of the template's key points that agree.
///
/// The template is that of the first frame: nothing drifts, and an object that was lost is found again.
pub struct FeatureTracker<S> {
    params: FeatureParams,
    matching: MatchParams,
    ssm: S,
    estimator: Estimator,
    seed: u64,
    extractor: Extractor,
    matcher: Matcher,
    /// Key points of the template and their places in the base, px.
    points: Vec<KeyPoint>,
    descriptors: Vec<Bits>,
    base: Vec<[f64; 2]>,
    /// Corners that the template was learnt with.
    learnt: Corners,
    /// Whether the last frame was found.
    tracking: bool,
    from: Vec<[f64; 2]>,
    to: Vec<[f64; 2]>,
    /// Key points of the template and of the frame near each other.
    near: Vec<(usize, usize)>,
    /// State to go back to.
    before: Vec<f64>,
}

/// Matches closer to each other than this are the same place, px of their scale.
const SAME_PLACE: f32 = 5.0;
/// Looks after the first: distance from where the fit before puts a point, px of the point's scale there.
const REACHES: [f64; 2] = [5.0, 2.5];
/// Largest distance of descriptors then, bits.
const NEAR_BITS: u32 = 90;
/// Key points of coarse scales, whose places are less certain, are left out when finer ones are at least so many.
const ENOUGH: usize = 120;
/// Largest change of area since the template was learnt, and largest number of images the region covers.
const AREA: (f64, f64) = (40.0, 4.0);
/// Largest RMS misfit, px, at which a region that is set keeps the base frame.
const KEEP_BASE: f64 = 0.5;
/// Bytes per key point of the template, and per one that is looked for in a frame, with its part of the frame.
const KEY_POINT_BYTES: usize = 96;
const FOUND_BYTES: usize = 80;

impl<S: StateSpaceModel> FeatureTracker<S> {
    /// With all parameters.
    pub fn new(params: FeatureParams, matching: MatchParams, estimator: EstimatorParams, ssm: S) -> Self {
        FeatureTracker {
            params,
            matching,
            ssm,
            estimator: Estimator::new(estimator, 0),
            seed: 0,
            extractor: Extractor::default(),
            matcher: Matcher::default(),
            points: Vec::new(),
            descriptors: Vec::new(),
            base: Vec::new(),
            learnt: Corners::default(),
            tracking: false,
            from: Vec::new(),
            to: Vec::new(),
            near: Vec::new(),
            before: Vec::new(),
        }
    }

    /// Searches the whole frame for the object, wherever it was before; the tracker stays where it is.
    pub fn detect(&mut self, frame: &Frame) -> Result<Detection, TrackError> {
        let before = self.ssm.state().to_vec();
        let found = self.locate(frame, None);
        self.ssm.set_state(&before)?;
        found
    }

    /// The search window around the present region.
    fn window(&self) -> Region {
        let corners = self.ssm.corners();
        let side = |i: usize| {
            let (a, b) = (corners.0[i], corners.0[(i + 1) % 4]);
            libm::hypot(b[0] - a[0], b[1] - a[1])
        };
        let longest = (0..4).map(side).fold(0.0, f64::max);
        Region::around(&corners.0, self.params.feat_margin * longest)
    }

    /// Searches a window around the last region, or the whole frame; moves the warp there. On failure it stays.
    fn locate(&mut self, frame: &Frame, window: Option<Region>) -> Result<Detection, TrackError> {
        if self.points.is_empty() {
            return Err(TrackError::NotInitialised);
        }
        let count = if window.is_some() {
            self.params.feat_points
        } else {
            self.params.feat_points_whole
        };
        let region = window.unwrap_or(Region::whole(frame));
        self.extractor.extract(frame, region, count, |_| true);
        let (points, descriptors) = (self.extractor.points(), self.extractor.descriptors());
        self.matcher.find(
            &self.matching,
            &self.descriptors,
            (points, descriptors),
            SAME_PLACE,
        );
        interrupt::check()?;
        self.matcher.vote(&self.points, points);
        self.from.clear();
        self.to.clear();
        for m in self.matcher.matches() {
            self.from.push(self.base[m.first]);
            self.to.push(points[m.second].at.map(f64::from));
        }
        let few = TrackError::Degenerate("too few matches");
        let least = self.params.feat_min.max(self.ssm.capabilities().min_points);
        if self.from.len() < least {
            return Err(few);
        }
        self.before.clear();
        self.before.extend_from_slice(self.ssm.state());
        let fitted = self.fit(frame, least);
        if fitted.is_err() {
            self.ssm.set_state(&self.before)?;
        }
        fitted
    }

    /// Fits the warp to the matches, looks again for every key point near where that puts it, and fits again.
    fn fit(&mut self, frame: &Frame, least: usize) -> Result<Detection, TrackError> {
        ssm::estimate(&mut self.ssm, &mut self.estimator, &self.from, &self.to)?;
        interrupt::check()?;
        self.judge(frame, least)?;
        let mut visible = 0;
        for reach in REACHES {
            visible = self.match_near(frame, reach)?;
            ssm::estimate(&mut self.ssm, &mut self.estimator, &self.from, &self.to)?;
        }
        self.judge(frame, least)?;
        let inliers = self.agreeing()?;
        Ok(Detection {
            corners: self.ssm.corners(),
            inliers,
            support: inliers as f64 / visible as f64,
        })
    }

    /// Inliers of the last fit; fails when they are too few or the region is not sound.
    fn judge(&self, frame: &Frame, least: usize) -> Result<usize, TrackError> {
        let inliers = self.estimator.inliers().iter().filter(|i| **i).count();
        if inliers < least {
            return Err(TrackError::Degenerate("too few matches agree"));
        }
        let area = self.ssm.corners().signed_area().abs();
        let change = area / self.learnt.signed_area().abs();
        if !(change < AREA.0 && change * AREA.0 > 1.0)
            || area > AREA.1 * (frame.width() * frame.height()) as f64
        {
            return Err(TrackError::Degenerate("region has an unlikely size"));
        }
        Ok(inliers)
    }

    /// Replaces the matches by those of least distance near where the warp puts each key point of the template, at about
    /// the scale it should have there. Returns how many of these lie in the frame.
    fn match_near(&mut self, frame: &Frame, reach: f64) -> Result<usize, TrackError> {
        let warp = Carry::new(&self.ssm)?;
        let zoom = (self.ssm.corners().signed_area() / self.ssm.base().corners_in_image().signed_area())
            .abs()
            .sqrt();
        let rise = 3.0 * libm::log2(zoom);
        let (points, descriptors) = (self.extractor.points(), self.extractor.descriptors());
        self.near.clear();
        let mut visible = 0;
        let mut counts = [0; SCALES];
        for (i, x) in self.base.iter().enumerate() {
            let u = warp.apply(&self.ssm, *x);
            if !(u[0] >= 0.0 && u[1] >= 0.0 && u[0] < frame.width() as f64 && u[1] < frame.height() as f64) {
                continue;
            }
            visible += 1;
            let scale = self.points[i].scale;
            let reach = reach * (f64::from(scale_factor(scale)) * zoom).max(1.0);
            let mut best = (NEAR_BITS + 1, 0);
            for (k, p) in points.iter().enumerate() {
                let (dx, dy) = (f64::from(p.at[0]) - u[0], f64::from(p.at[1]) - u[1]);
                let near = dx * dx + dy * dy <= reach * reach;
                if near && (f64::from(p.scale) - f64::from(scale) - rise).abs() <= 2.0 {
                    best = best.min((hamming(&self.descriptors[i], &descriptors[k]), k));
                }
            }
            if best.0 <= NEAR_BITS {
                counts[usize::from(points[best.1].scale)] += 1;
                self.near.push((i, best.1));
            }
        }
        let mut total = 0;
        let coarsest = counts.iter().position(|n| {
            total += n;
            total >= ENOUGH
        });
        let coarsest = coarsest.unwrap_or(SCALES - 1);
        self.from.clear();
        self.to.clear();
        for (i, k) in &self.near {
            if usize::from(points[*k].scale) <= coarsest {
                self.from.push(self.base[*i]);
                self.to.push(points[*k].at.map(f64::from));
            }
        }
        Ok(visible)
    }

    /// Matches of all scales that agree with the warp.
    fn agreeing(&self) -> Result<usize, TrackError> {
        let warp = Carry::new(&self.ssm)?;
        let limit = self.estimator.params.est_thresh;
        let points = self.extractor.points();
        let agrees = |(i, k): &&(usize, usize)| {
            let u = warp.apply(&self.ssm, self.base[*i]);
            let [x, y] = points[*k].at.map(f64::from);
            libm::hypot(x - u[0], y - u[1]) <= limit
        };
        Ok(self.near.iter().filter(agrees).count())
    }

    /// Puts the template's key points into the base of the warp.
    fn settle(&mut self) -> Result<(), TrackError> {
        let carry = homography::from_corners(&self.learnt, &self.ssm.base().corners_in_image())
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        self.base.clear();
        let places = self.points.iter().map(|p| p.at.map(f64::from));
        self.base.extend(places.map(|x| homography::apply(&carry, x)));
        Ok(())
    }
}

/// Where the warp takes places of its base.
struct Carry(Mat3);

impl Carry {
    fn new<S: StateSpaceModel>(ssm: &S) -> Result<Self, TrackError> {
        let m = homography::from_corners(&ssm.base().corners_in_image(), &ssm.corners());
        m.map(Carry).ok_or(TrackError::Degenerate("region is not convex"))
    }

    fn apply<S: StateSpaceModel>(&self, ssm: &S, x: [f64; 2]) -> [f64; 2] {
        ssm::place(ssm, x).unwrap_or_else(|| homography::apply(&self.0, x))
    }
}

/// Whether `x` lies inside the convex quadrilateral.
fn inside(corners: &Corners, x: [f64; 2]) -> bool {
    let side = |i: usize| {
        let (a, b) = (corners.0[i], corners.0[(i + 1) % 4]);
        (b[0] - a[0]) * (x[1] - a[1]) - (b[1] - a[1]) * (x[0] - a[0])
    };
    let sides = [side(0), side(1), side(2), side(3)];
    sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
}

impl<S: StateSpaceModel> Tracker for FeatureTracker<S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        // The grid plays no part but for warps whose controls lie on it.
        self.ssm.init(corners, crate::sm::SamplingParams::default().res)?;
        self.estimator.reseed(self.seed);
        self.tracking = false;
        let region = Region::around(&corners.0, 0.0);
        self.extractor
            .extract(frame, region, self.params.feat_template, |x| inside(corners, x));
        self.points.clear();
        self.descriptors.clear();
        if self.extractor.points().len() < self.params.feat_min {
            return Err(TrackError::Template("too few key points"));
        }
        self.points.extend_from_slice(self.extractor.points());
        self.descriptors.extend_from_slice(self.extractor.descriptors());
        self.learnt = *corners;
        self.tracking = true;
        self.settle()
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        let mut found = Err(TrackError::NotInitialised);
        if self.tracking && self.params.feat_margin > 0.0 {
            let window = self.window();
            found = self.locate(frame, Some(window));
            if found.is_ok_and(|d| !window.holds(&d.corners.0, frame)) {
                // Seen in part only.
                let better = self.locate(frame, Some(self.window()));
                found = better.or(found);
            }
        }
        if found.is_err() {
            found = self.locate(frame, None);
        }
        self.tracking = found.is_ok();
        let found = found?;
        Ok(Update {
            corners: found.corners,
            stop: Stop::Done,
            iterations: 1,
            similarity: found.inliers as f64 / self.points.len() as f64,
        })
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        if self.points.is_empty() {
            return Err(TrackError::NotInitialised);
        }
        if !corners.is_finite() {
            return Err(TrackError::NotFinite("corners"));
        }
        let fitted = self.ssm.fit_corners(corners);
        if !fitted.is_ok_and(|misfit| misfit <= KEEP_BASE) {
            self.ssm.rebase(corners)?;
            self.settle()?;
        }
        self.tracking = true;
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.ssm.corners()
    }

    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        ssm::place(&self.ssm, x)
    }

    fn reseed(&mut self, seed: u64) {
        self.seed = seed;
        self.estimator.reseed(seed);
    }

    fn memory(&self) -> usize {
        if self.points.is_empty() {
            let (template, whole) = (self.params.feat_template, self.params.feat_points_whole);
            return self.ssm.memory() + KEY_POINT_BYTES * template + FOUND_BYTES * whole;
        }
        self.ssm.memory() + self.extractor.memory() + KEY_POINT_BYTES * self.points.capacity()
    }
}
