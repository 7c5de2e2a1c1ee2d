//! Robust estimation of a warp from point pairs with outliers: RANSAC, least median of squares, least squares.
//!
//! The consensus loop knows no warp: a [`PointModel`] solves for matrices from samples and from inliers. RANSAC scores
//! samples by the truncated squared error (MSAC, Torr & Zisserman 2000), optimises each new best one on its inliers (LO,
//! Chum, Matas & Kittler 2003) and stops when a better one is unlikely. All methods end alike: the noise is estimated
//! from the inliers' median error, pairs beyond four and a half standard deviations are dropped, and the warp of least
//! reprojection error of the rest is found. `est_truncated=0`, `est_local=0` and `est_trim=0` give the plain form: the
//! sample with most inliers, refitted to them once. Draws come from a seeded stream. Interrupted, a method makes do with
//! the samples drawn so far. May depend on `geom`, `interrupt`, `params` and `tracker`.

use crate::geom::{Mat3, homography};
use crate::interrupt;
use crate::params::param_enum;
use crate::tracker::TrackError;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

param_enum! {
    /// How outliers are met.
    pub enum EstimateMethod {
        /// Sampling consensus with a fixed inlier threshold.
        Ransac = "ransac",
        /// Least median of squares: no threshold, fewer than half outliers.
        Lmeds = "lmeds",
        /// Least squares over all pairs.
        LeastSquares = "lsq",
    }
}

crate::params! {
    /// Parameters of robust estimation.
    pub struct EstimatorParams {
        /// Estimator: ransac, lmeds or lsq (all pairs).
        estimator: EstimateMethod = EstimateMethod::Ransac;
        /// RANSAC: largest distance of an inlier, px.
        est_thresh: f64 = 5.0, in 1e-3..=1e4;
        /// Pairs per sample; 0 or fewer than the model's minimum: the minimum.
        est_points: usize = 0, in 0..=16;
        /// Most samples.
        est_iters: usize = 2000, in 1..=1_000_000;
        /// Probability of having drawn a sample without outliers.
        est_confidence: f64 = 0.99999, in 0.5..=0.999999999999, paper 0.995 => "the best sample is missed less often: AUC of `flow` .858 against .855";
        /// RANSAC: samples are scored by the truncated squared error of all pairs; 0: by the number of inliers.
        est_truncated: bool = true, paper false => "good inliers count more than those on the edge: AUC of `flow` .858 against .855";
        /// RANSAC: each new best sample is refitted to its inliers at once (local optimisation).
        est_local: bool = true, paper false => "fewer samples are needed; AUC of `flow` .858 with both";
        /// The last inliers are those within the noise estimated from them; 0: all that the estimator found.
        est_trim: bool = true, paper false => "5 px is far more than the noise: `flow` on 12 real sequences AUC .766 against .713 (embedded data .858 against .861)";
        /// Minimise the reprojection error over the inliers; 0: a linear fit.
        est_refine: bool = true;
        /// Most Levenberg-Marquardt steps of a refinement.
        est_refine_iters: usize = 10, in 1..=1000;
    }
}

/// Why no warp was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EstimateError {
    /// Fewer pairs than determine the model, or lists of different lengths.
    #[error("{got} point pairs, {needed} needed")]
    TooFew {
        /// Pairs given.
        got: usize,
        /// Pairs that determine the model.
        needed: usize,
    },
    /// A coordinate is not finite.
    #[error("points are not finite")]
    NotFinite,
    /// No sample had as many inliers as determine the model.
    #[error("no consensus among the point pairs")]
    NoConsensus,
}

impl From<EstimateError> for TrackError {
    fn from(e: EstimateError) -> Self {
        match e {
            EstimateError::TooFew { .. } => TrackError::BadRegion("too few point pairs"),
            EstimateError::NotFinite => TrackError::NotFinite("points"),
            EstimateError::NoConsensus => TrackError::Degenerate("no consensus among the point pairs"),
        }
    }
}

/// A family of 3x3 matrices that point pairs determine.
pub trait PointModel {
    /// Pairs that determine a member.
    fn min_points(&self) -> usize;
    /// Least-squares member; `None` for degenerate pairs.
    fn fit(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3>;
    /// The same for exactly `min_points` pairs.
    fn minimal(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        self.fit(from, to)
    }
    /// Member of least reprojection error near `m`.
    fn refine(&self, m: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], iterations: usize) -> Option<Mat3>;
}

/// All homographies: the motion of a plane.
#[derive(Clone, Copy, Debug)]
pub struct Homographies;

impl PointModel for Homographies {
    fn min_points(&self) -> usize {
        4
    }
    fn fit(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        homography::from_points(from, to)
    }
    fn minimal(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        homography::from_four(from, to)
    }
    fn refine(&self, m: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], iterations: usize) -> Option<Mat3> {
        homography::refine(m, from, to, iterations)
    }
}

/// Largest sample.
const MAX_SAMPLE: usize = 16;
/// Rounds of local optimisation, and Levenberg-Marquardt steps in each.
const LOCAL: (usize, usize) = (4, 2);
/// Rounds of the final estimate of noise and warp.
const POLISH: usize = 5;
/// Squared distance, in variances of one coordinate, that all but four in 100 000 normal errors stay below.
const CUT: f64 = 20.25;
/// Median of the squared distance of normal errors, in variances of one coordinate.
const MEDIAN: f64 = 2.0 * std::f64::consts::LN_2;
/// Least median: squared distance, px², of pairs that surely belong together, and fewest samples however many there are.
const CLOSE: f64 = 1.0;
const FEWEST: usize = 12;
/// Pairs scored between looks at the best score so far.
const CHUNK: usize = 16;

/// Squared distance of `w(a)` from `b`, px²; infinite behind the camera.
#[inline(always)]
fn error(m: &Mat3, a: &[f64; 2], b: &[f64; 2]) -> f64 {
    let d = m[(2, 0)] * a[0] + m[(2, 1)] * a[1] + m[(2, 2)];
    let k = 1.0 / d;
    let u = (m[(0, 0)] * a[0] + m[(0, 1)] * a[1] + m[(0, 2)]) * k - b[0];
    let v = (m[(1, 0)] * a[0] + m[(1, 1)] * a[1] + m[(1, 2)]) * k - b[1];
    if d > 1e-9 { u * u + v * v } else { f64::INFINITY }
}

/// A candidate: matrix, score (smaller is better), inliers.
#[derive(Clone, Copy)]
struct Candidate {
    m: Mat3,
    cost: f64,
    inliers: usize,
}

/// A robust estimator with its stream of random numbers and its scratch.
#[derive(Clone, Debug)]
pub struct Estimator {
    /// Parameters.
    pub params: EstimatorParams,
    rng: Pcg64,
    errors: Vec<f64>,
    from: Vec<[f64; 2]>,
    to: Vec<[f64; 2]>,
    mask: Vec<bool>,
}

impl Estimator {
    /// With a seed for its draws.
    pub fn new(params: EstimatorParams, seed: u64) -> Self {
        Estimator {
            params,
            rng: Pcg64::seed_from_u64(seed),
            errors: Vec::new(),
            from: Vec::new(),
            to: Vec::new(),
            mask: Vec::new(),
        }
    }

    /// Starts its stream anew.
    pub fn reseed(&mut self, seed: u64) {
        self.rng = Pcg64::seed_from_u64(seed);
    }

    /// Which pairs of the last successful estimate were inliers.
    pub fn inliers(&self) -> &[bool] {
        &self.mask
    }

    /// Replaces the inliers, for models that judge them further.
    pub(crate) fn set_inliers(&mut self, inliers: impl Iterator<Item = bool>) {
        self.mask.clear();
        self.mask.extend(inliers);
    }

    /// Matrix that takes `from` to `to`, px, outliers apart.
    pub fn estimate<M: PointModel>(
        &mut self,
        model: &M,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
    ) -> Result<Mat3, EstimateError> {
        let (n, least) = (from.len(), model.min_points());
        if n < least || to.len() != n {
            return Err(EstimateError::TooFew {
                got: n.min(to.len()),
                needed: least,
            });
        }
        if !from.iter().chain(to).flatten().all(|v| v.is_finite()) {
            return Err(EstimateError::NotFinite);
        }
        let sample = self.params.est_points.clamp(least, n.min(MAX_SAMPLE));
        self.mask.clear();
        self.mask.resize(n, true);
        if n == sample || self.params.estimator == EstimateMethod::LeastSquares {
            let m = model.fit(from, to).ok_or(EstimateError::NoConsensus)?;
            let refined = (self.params.est_refine && n > least)
                .then(|| model.refine(&m, from, to, self.params.est_refine_iters))
                .flatten();
            return Ok(refined.unwrap_or(m));
        }
        let (m, cut) = match self.params.estimator {
            EstimateMethod::Lmeds => self.least_median(model, from, to, sample)?,
            _ => self.ransac(model, from, to, sample)?,
        };
        self.polish(model, m, cut, from, to)
    }

    /// A sample's matrix; `None` when it is degenerate.
    fn draw<M: PointModel>(
        &mut self,
        model: &M,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
        sample: usize,
    ) -> Option<Mat3> {
        let mut at = [0usize; MAX_SAMPLE];
        let (mut a, mut b) = ([[0.0; 2]; MAX_SAMPLE], [[0.0; 2]; MAX_SAMPLE]);
        for k in 0..sample {
            at[k] = loop {
                let i = self.rng.random_range(0..from.len());
                if !at[..k].contains(&i) {
                    break i;
                }
            };
            (a[k], b[k]) = (from[at[k]], to[at[k]]);
        }
        if sample == model.min_points() {
            model.minimal(&a[..sample], &b[..sample])
        } else {
            model.fit(&a[..sample], &b[..sample])
        }
    }

    /// Truncated squared error, or number of outliers, and inliers; `None` once the former reaches `bound`.
    fn score(
        &self,
        m: &Mat3,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
        limit: f64,
        bound: f64,
    ) -> Option<Candidate> {
        let truncated = self.params.est_truncated;
        let (mut cost, mut inliers) = (0.0, 0);
        for (a, b) in from.chunks(CHUNK).zip(to.chunks(CHUNK)) {
            for (a, b) in a.iter().zip(b) {
                let e = error(m, a, b);
                let near = e <= limit;
                cost += if truncated {
                    e.min(limit)
                } else {
                    f64::from(u8::from(!near))
                };
                inliers += usize::from(near);
            }
            if cost >= bound {
                return None;
            }
        }
        Some(Candidate { m: *m, cost, inliers })
    }

    /// Samples needed to draw one without outliers with the wanted confidence.
    fn samples(&self, inlier_ratio: f64, sample: usize) -> usize {
        let good = inlier_ratio.powi(sample as i32);
        let needed = libm::log(1.0 - self.params.est_confidence) / libm::log1p(-good);
        if needed.is_nan() || needed >= self.params.est_iters as f64 {
            self.params.est_iters
        } else {
            needed.ceil() as usize
        }
    }

    fn ransac<M: PointModel>(
        &mut self,
        model: &M,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
        sample: usize,
    ) -> Result<(Mat3, f64), EstimateError> {
        let n = from.len();
        let limit = self.params.est_thresh * self.params.est_thresh;
        let mut best: Option<Candidate> = None;
        let mut needed = self.params.est_iters;
        let mut drawn = 0;
        while drawn < needed && !interrupt::requested() {
            drawn += 1;
            let Some(m) = self.draw(model, from, to, sample) else {
                continue;
            };
            let bound = best.map_or(f64::INFINITY, |b| b.cost);
            let Some(found) = self.score(&m, from, to, limit, bound) else {
                continue;
            };
            let found = match self.params.est_local {
                true => self.optimise(model, found, limit, from, to),
                false => found,
            };
            needed = needed.min(self.samples(found.inliers as f64 / n as f64, sample));
            best = Some(found);
        }
        match best {
            // A sample always agrees with itself.
            Some(b) if b.inliers > model.min_points() => Ok((b.m, limit)),
            _ => Err(EstimateError::NoConsensus),
        }
    }

    /// Refits a candidate to its inliers while its score improves.
    fn optimise<M: PointModel>(
        &mut self,
        model: &M,
        mut best: Candidate,
        limit: f64,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
    ) -> Candidate {
        for _ in 0..LOCAL.0 {
            if best.inliers <= model.min_points() {
                break;
            }
            self.gather(&best.m, limit, from, to);
            let refined = model.refine(&best.m, &self.from, &self.to, LOCAL.1);
            let Some(next) = refined.and_then(|m| self.score(&m, from, to, limit, best.cost * 0.999)) else {
                break;
            };
            best = next;
        }
        best
    }

    fn least_median<M: PointModel>(
        &mut self,
        model: &M,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
        sample: usize,
    ) -> Result<(Mat3, f64), EstimateError> {
        let n = from.len();
        // Rousseeuw's optimal order statistic.
        let rank = ((n + sample) / 2).min(n - 1);
        let (mut best, mut median) = (None, f64::INFINITY);
        let mut needed = self.samples(0.55, sample).max(3);
        let mut drawn = 0;
        while drawn < needed && !interrupt::requested() {
            drawn += 1;
            let Some(m) = self.draw(model, from, to, sample) else {
                continue;
            };
            self.errors.clear();
            let mut below = 0;
            for (a, b) in from.iter().zip(to) {
                let e = error(&m, a, b);
                below += usize::from(e < median);
                self.errors.push(e);
            }
            // The median improves exactly when more than `rank` errors are below the best one.
            if below > rank {
                median = *self.errors.select_nth_unstable_by(rank, f64::total_cmp).1;
                best = Some(m);
                // So many pairs agree by accident only where few would do.
                let close = self.errors.iter().filter(|e| **e <= CLOSE).count();
                needed = needed.min(self.samples(close as f64 / n as f64, sample).max(FEWEST));
            }
        }
        let m = best.ok_or(EstimateError::NoConsensus)?;
        let sigma = 2.5 * 1.4826 * (1.0 + 5.0 / (n - sample) as f64) * median.sqrt();
        Ok((m, sigma.max(1e-3).powi(2)))
    }

    /// Puts the pairs within `limit` (px²) of `m` into the scratch.
    fn gather(&mut self, m: &Mat3, limit: f64, from: &[[f64; 2]], to: &[[f64; 2]]) {
        self.from.clear();
        self.to.clear();
        for (a, b) in from.iter().zip(to) {
            if error(m, a, b) <= limit {
                self.from.push(*a);
                self.to.push(*b);
            }
        }
    }

    /// Final warp and inliers from a good start, pairs beyond `limit` (px²) apart.
    fn polish<M: PointModel>(
        &mut self,
        model: &M,
        start: Mat3,
        limit: f64,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
    ) -> Result<Mat3, EstimateError> {
        let least = model.min_points();
        let (mut m, mut cut, mut count) = (start, limit, 0);
        let trims = self.params.est_refine && self.params.est_trim;
        for _ in 0..POLISH {
            if trims {
                self.errors.clear();
                let all = from.iter().zip(to).map(|(a, b)| error(&m, a, b));
                self.errors.extend(all.filter(|e| *e <= limit));
                let inside = self.errors.len();
                if inside <= least {
                    break;
                }
                let median = *self.errors.select_nth_unstable_by(inside / 2, f64::total_cmp).1;
                // Errors of pairs that the warp was fitted to are too small.
                let variance = median / MEDIAN * inside as f64 / (inside - least) as f64;
                cut = (CUT * variance).clamp(1e-12_f64.min(limit), limit);
            }
            self.gather(&m, cut, from, to);
            if self.from.len() < least {
                return Err(EstimateError::NoConsensus);
            }
            let next = if self.params.est_refine {
                model.refine(&m, &self.from, &self.to, self.params.est_refine_iters)
            } else {
                model.fit(&self.from, &self.to)
            };
            let Some(next) = next else { break };
            m = next;
            if !trims || self.from.len() == count {
                break;
            }
            count = self.from.len();
        }
        for ((a, b), inlier) in from.iter().zip(to).zip(&mut self.mask) {
            *inlier = error(&m, a, b) <= cut;
        }
        Ok(m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::fit::Moments;
    use crate::geom::homography;

    struct Affine;
    impl PointModel for Affine {
        fn min_points(&self) -> usize {
            3
        }
        fn fit(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
            Moments::new(from, to)?.affine()
        }
        fn refine(&self, _: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], _: usize) -> Option<Mat3> {
            self.fit(from, to)
        }
    }

    fn params(estimator: EstimateMethod) -> EstimatorParams {
        EstimatorParams {
            estimator,
            ..EstimatorParams::default()
        }
    }

    /// Exact pairs, every third one spoiled.
    fn pairs(n: usize) -> (Mat3, Vec<[f64; 2]>, Vec<[f64; 2]>) {
        let m = Mat3::new(1.1, -0.2, 30.0, 0.25, 0.9, -12.0, 0.0, 0.0, 1.0);
        let from: Vec<[f64; 2]> = (0..n)
            .map(|i| [(i * 37 % 101) as f64, (i * 53 % 97) as f64])
            .collect();
        let to = from
            .iter()
            .enumerate()
            .map(|(i, &p)| {
                let [u, v] = homography::apply(&m, p);
                if i % 3 == 0 {
                    [u + 40.0 + i as f64, v - 25.0]
                } else {
                    [u, v]
                }
            })
            .collect();
        (m, from, to)
    }

    #[test]
    fn exact_inliers_are_found_exactly_and_repeatably() {
        let (m, from, to) = pairs(60);
        for method in [EstimateMethod::Ransac, EstimateMethod::Lmeds] {
            let mut e = Estimator::new(params(method), 3);
            let got = e.estimate(&Affine, &from, &to).unwrap();
            assert!((got - m).abs().max() < 1e-9, "{got}");
            assert!(
                e.inliers()
                    .iter()
                    .enumerate()
                    .all(|(i, &inlier)| inlier == (i % 3 != 0))
            );
            e.reseed(3);
            assert_eq!(e.estimate(&Affine, &from, &to).unwrap(), got);
        }
        let mut e = Estimator::new(params(EstimateMethod::LeastSquares), 3);
        let got = e.estimate(&Affine, &from, &to).unwrap();
        assert!((got - m).abs().max() > 0.1);
    }

    #[test]
    fn sample_sizes_and_unrefined_estimates() {
        let (m, from, to) = pairs(60);
        for (est_points, est_refine) in [(5, true), (0, false), (1, false)] {
            let p = EstimatorParams {
                est_points,
                est_refine,
                ..EstimatorParams::default()
            };
            let got = Estimator::new(p, 1).estimate(&Affine, &from, &to).unwrap();
            assert!((got - m).abs().max() < 1e-9, "{got}");
        }
    }

    #[test]
    fn the_plain_form_takes_the_sample_with_most_inliers() {
        let (m, from, to) = pairs(60);
        let plain = |est_trim| EstimatorParams {
            est_truncated: false,
            est_local: false,
            est_trim,
            ..EstimatorParams::default()
        };
        let got = Estimator::new(plain(false), 1)
            .estimate(&Affine, &from, &to)
            .unwrap();
        assert!((got - m).abs().max() < 1e-9, "{got}");
        // Pairs 3 px off are inliers to a threshold of 5 px, not to the noise of the others.
        let to: Vec<[f64; 2]> = to
            .iter()
            .zip(0..)
            .map(|([u, v], i)| [u + if i % 12 == 1 { 3.0 } else { 0.0 }, *v])
            .collect();
        let count = |est_trim| {
            let mut e = Estimator::new(plain(est_trim), 1);
            e.estimate(&Affine, &from, &to).unwrap();
            e.inliers().iter().filter(|i| **i).count()
        };
        assert_eq!((count(false), count(true)), (40, 35));
    }

    #[test]
    fn failures_are_typed() {
        let (_, from, to) = pairs(30);
        let mut e = Estimator::new(EstimatorParams::default(), 0);
        assert_eq!(
            e.estimate(&Affine, &from[..2], &to[..2]),
            Err(EstimateError::TooFew { got: 2, needed: 3 })
        );
        assert!(matches!(
            e.estimate(&Affine, &from, &to[..9]),
            Err(EstimateError::TooFew { .. })
        ));
        assert_eq!(
            e.estimate(&Affine, &[[f64::NAN, 0.0]; 5], &[[0.0; 2]; 5]),
            Err(EstimateError::NotFinite)
        );
        let line: Vec<[f64; 2]> = (0..20).map(|i| [i as f64, 2.0 * i as f64]).collect();
        for method in [
            EstimateMethod::Ransac,
            EstimateMethod::Lmeds,
            EstimateMethod::LeastSquares,
        ] {
            let mut e = Estimator::new(params(method), 0);
            assert_eq!(e.estimate(&Affine, &line, &line), Err(EstimateError::NoConsensus));
        }
        // As many pairs as determine it.
        assert!(e.estimate(&Affine, &from[1..4], &to[1..4]).is_ok());
    }

    #[test]
    fn candidates_are_scored_by_squared_distances() {
        let from: Vec<[f64; 2]> = (0..5).map(|i| [f64::from(i), 0.0]).collect();
        let off = [0.0, 4.9, 5.1, 9.0, 30.0];
        let to: Vec<[f64; 2]> = from.iter().zip(off).map(|(p, d)| [p[0], p[1] + d]).collect();
        let score = |est_truncated, bound| {
            let p = EstimatorParams {
                est_truncated,
                ..EstimatorParams::default()
            };
            let found = Estimator::new(p, 0).score(&Mat3::identity(), &from, &to, 25.0, bound);
            found.map(|c| (c.cost, c.inliers))
        };
        let (cost, inliers) = score(true, f64::INFINITY).unwrap();
        assert!(
            (cost - (4.9 * 4.9 + 3.0 * 25.0)).abs() < 1e-9 && inliers == 2,
            "{cost}"
        );
        assert_eq!(score(false, f64::INFINITY), Some((3.0, 2)));
        // Candidates no better than the bound are none.
        assert_eq!((score(false, 3.1), score(false, 3.0)), (Some((3.0, 2)), None));
    }

    #[test]
    fn the_threshold_of_inliers_is_in_pixels() {
        for est_thresh in [0.5, 2.0, 5.0] {
            for plain in [false, true] {
                let p = EstimatorParams {
                    est_thresh,
                    est_truncated: !plain,
                    est_local: !plain,
                    est_trim: false,
                    ..EstimatorParams::default()
                };
                let (_, from, mut to) = pairs(90);
                to[1][0] += 0.75 * est_thresh;
                to[2][1] -= 1.25 * est_thresh;
                let mut e = Estimator::new(p, 1);
                e.estimate(&Affine, &from, &to).unwrap();
                let expected = (0..90).map(|i| i % 3 != 0 && i != 2);
                assert!(e.inliers().iter().copied().eq(expected), "{est_thresh}");
            }
        }
    }

    /// Shifts, which one pair determines.
    struct Shift;
    impl PointModel for Shift {
        fn min_points(&self) -> usize {
            1
        }
        fn fit(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
            let mean =
                |c: usize| from.iter().zip(to).map(|(a, b)| b[c] - a[c]).sum::<f64>() / from.len() as f64;
            Some(Mat3::new(1.0, 0.0, mean(0), 0.0, 1.0, mean(1), 0.0, 0.0, 1.0))
        }
        fn refine(&self, _: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], _: usize) -> Option<Mat3> {
            self.fit(from, to)
        }
    }

    /// The sample whose distances from the other pairs have the least median, found by trying all; the limit is 2.5 of the
    /// standard deviations that Rousseeuw & Leroy (1987) make of it.
    #[test]
    fn least_median_is_that_of_all_samples() {
        for n in [10, 11, 14, 15] {
            let from = vec![[0.0; 2]; n];
            let to: Vec<[f64; 2]> = (0..n)
                .map(|i| [(i * i) as f64 * 1.7, ((i * 29) % 13) as f64 * 2.3])
                .collect();
            let median = |i: usize| {
                let apart = |j: usize| (to[i][0] - to[j][0]).powi(2) + (to[i][1] - to[j][1]).powi(2);
                let mut others: Vec<f64> = (0..n).filter(|&j| j != i).map(apart).collect();
                others.sort_by(f64::total_cmp);
                others[others.len() / 2]
            };
            let best = (0..n).min_by(|&i, &j| median(i).total_cmp(&median(j))).unwrap();
            let deviation = 1.4826 * (1.0 + 5.0 / (n as f64 - 1.0)) * median(best).sqrt();
            let p = EstimatorParams {
                est_confidence: 0.999_999_999_999,
                ..params(EstimateMethod::Lmeds)
            };
            // Each seed may miss a sample.
            let tried = (0..6).map(|seed| {
                Estimator::new(p.clone(), seed)
                    .least_median(&Shift, &from, &to, 1)
                    .unwrap()
            });
            let (m, cut) = tried.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
            assert_eq!([m[(0, 2)], m[(1, 2)]], to[best], "{n}");
            assert!(
                (cut.sqrt() - 2.5 * deviation).abs() < 1e-9 * deviation,
                "{n} {cut}"
            );
        }
    }
}
