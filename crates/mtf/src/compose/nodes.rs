//! The nodes of a grid over the object, and the warp that a robust fit makes of their motion.
//!
//! Nodes are fixed places of the object: the fit is always between where they were when the warp's state was zero and
//! where they have been found, so that nothing is composed from frame to frame but what the nodes themselves carry.

use super::entry::WarpParams;
use crate::consensus::{Estimator, EstimatorParams};
use crate::geom::{Corners, Mat3, homography};
use crate::image::Frame;
use crate::interrupt;
use crate::params::Resolution;
use crate::ssm::{self, StateSpaceModel};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of grids of points.
    pub struct NodeParams {
        /// Points over the object, columns x rows.
        size: Resolution = Resolution { cols: 10, rows: 10 };
        /// Points at the centres of the grid's cells instead of its nodes, which include the corners.
        grid_cells: bool = false;
        /// Largest squared distance by which a point tracked back to the frame before may miss its origin, px²; 0: no such check.
        grid_fb: f64 = 0.0, in 0.0..=1e6;
    }
}

/// What all trackers by nodes have in common.
pub(super) type PointSettings = (NodeParams, (EstimatorParams, WarpParams));

/// Largest RMS misfit, px, at which a region that is set keeps the base frame.
const KEEP_BASE: f64 = 0.5;
/// Largest misfit of a node that agrees with a fit, and of one that is found where it puts it, px.
const APART: f64 = 5.0;
const CLOSE: f64 = 1.5;
/// Change of a window's shape that shifts where it is found too little to matter, px.
const BENT: f64 = 0.25;

/// Bytes per node, with what the estimator keeps of it.
const NODE_BYTES: usize = 160;

/// Nodes, warp and estimator.
pub(super) struct Nodes<S> {
    pub params: NodeParams,
    pub ssm: S,
    pub estimator: Estimator,
    seed: u64,
    /// Places where the state is zero, px.
    base: Vec<[f64; 2]>,
    /// Places at the present state, px.
    now: Vec<[f64; 2]>,
    /// Which nodes the last fit agreed with.
    inliers: Vec<bool>,
    from: Vec<[f64; 2]>,
    to: Vec<[f64; 2]>,
    sorted: Vec<f64>,
    /// State and inliers to go back to.
    before: Vec<f64>,
    saved: (Vec<f64>, Vec<bool>, usize),
    /// How many nodes were found where the last fit puts them.
    close: usize,
    /// From the base to the present state, where corners tell all.
    matrix: Mat3,
}

impl<S: StateSpaceModel> Nodes<S> {
    pub fn new(params: NodeParams, estimator: EstimatorParams, ssm: S) -> Self {
        Nodes {
            params,
            ssm,
            estimator: Estimator::new(estimator, 0),
            seed: 0,
            base: Vec::new(),
            now: Vec::new(),
            inliers: Vec::new(),
            from: Vec::new(),
            to: Vec::new(),
            sorted: Vec::new(),
            before: Vec::new(),
            saved: (Vec::new(), Vec::new(), 0),
            close: 0,
            matrix: Mat3::identity(),
        }
    }

    pub fn reseed(&mut self, seed: u64) {
        self.seed = seed;
        self.estimator.reseed(seed);
    }

    pub fn started(&self) -> bool {
        !self.base.is_empty()
    }

    pub fn init(&mut self, corners: &Corners) -> Result<(), TrackError> {
        // The warp's own grid is that of the nodes, for warps whose controls depend on it.
        self.ssm.init(corners, self.params.size)?;
        self.estimator.reseed(self.seed);
        self.inliers.clear();
        self.inliers.resize(self.params.size.len(), true);
        self.spread()
    }

    /// Puts the nodes on the base.
    fn spread(&mut self) -> Result<(), TrackError> {
        let square = Corners::rect(0.0, 0.0, 1.0, 1.0);
        let place = homography::from_corners(&square, &self.ssm.base().corners_in_image())
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        let Resolution { cols, rows } = self.params.size;
        let cells = self.params.grid_cells;
        let at = |i: usize, n: usize| {
            if cells {
                (i as f64 + 0.5) / n as f64
            } else {
                i as f64 / (n - 1) as f64
            }
        };
        self.base.clear();
        for row in 0..rows {
            for col in 0..cols {
                self.base
                    .push(homography::apply(&place, [at(col, cols), at(row, rows)]));
            }
        }
        self.follow()
    }

    /// Moves the nodes to the present state.
    fn follow(&mut self) -> Result<(), TrackError> {
        self.matrix = homography::from_corners(&self.ssm.base().corners_in_image(), &self.ssm.corners())
            .ok_or(TrackError::Degenerate("region is not convex"))?;
        let mut now = std::mem::take(&mut self.now);
        now.clear();
        now.extend(self.base.iter().map(|&x| self.carry(x)));
        self.now = now;
        Ok(())
    }

    /// Present place of a place `x` of the base, px.
    pub fn carry(&self, x: [f64; 2]) -> [f64; 2] {
        ssm::place(&self.ssm, x).unwrap_or_else(|| homography::apply(&self.matrix, x))
    }

    pub fn base(&self) -> &[[f64; 2]] {
        &self.base
    }

    pub fn now(&self) -> &[[f64; 2]] {
        &self.now
    }

    pub fn inliers(&self) -> &[bool] {
        &self.inliers
    }

    /// Fraction of the nodes that the last fit agreed with.
    pub fn agreement(&self) -> f64 {
        self.inliers.iter().filter(|i| **i).count() as f64 / self.inliers.len().max(1) as f64
    }

    /// Whether windows that reach `radius` px from nodes keep their shape, to `BENT` px, in the motion from corners `before`
    /// to the present ones.
    pub fn stiff(&self, before: &Corners, radius: f64) -> bool {
        let Some(motion) = homography::from_corners(before, &self.ssm.corners()) else {
            return false;
        };
        // Perspective warps most at a corner.
        before.0.iter().all(|&x| {
            let (a, _) = homography::spatial_derivatives(&motion, x);
            let row =
                |i: usize, a: f64, b: f64| (a - f64::from(i == 0)).abs() + (b - f64::from(i == 1)).abs();
            radius * row(0, a[(0, 0)], a[(0, 1)]).max(row(1, a[(1, 0)], a[(1, 1)])) <= BENT
        })
    }

    /// Whether at least `share` of `count` nodes were found where the last fit puts them; never when that is 0.
    pub fn enough(&self, share: f64, count: usize) -> bool {
        share > 0.0 && self.close as f64 >= share * count as f64
    }

    pub fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        if !self.started() {
            return Err(TrackError::NotInitialised);
        }
        if !corners.is_finite() {
            return Err(TrackError::NotFinite("corners"));
        }
        if self
            .ssm
            .fit_corners(corners)
            .is_ok_and(|misfit| misfit <= KEEP_BASE)
        {
            self.follow()
        } else {
            self.ssm.rebase(corners)?;
            self.spread()
        }
    }

    /// Drops the nodes in `found` that miss their origin by more than the limit; as many of the least as determine the
    /// warp are kept.
    pub fn check_back(&mut self, misses: &[f64], found: &mut [Option<[f64; 2]>]) {
        let least = self.ssm.capabilities().min_points;
        let good = |d: f64| d <= self.params.grid_fb;
        let sound = |(d, f): (&f64, &Option<_>)| f.is_some() && good(*d);
        let mut limit = self.params.grid_fb;
        if misses
            .iter()
            .zip(found.iter())
            .filter(|p| sound((p.0, p.1)))
            .count()
            < least
        {
            let finite = misses.iter().zip(found.iter());
            let finite = finite.filter(|(d, f)| f.is_some() && d.is_finite());
            self.sorted.clear();
            self.sorted.extend(finite.map(|p| *p.0));
            self.sorted.sort_unstable_by(f64::total_cmp);
            limit = self.sorted.get(least - 1).copied().unwrap_or(f64::MAX);
        }
        for (d, f) in misses.iter().zip(found) {
            if d.is_nan() || *d > limit {
                *f = None;
            }
        }
    }

    /// Fits the warp to the nodes that were found, outliers apart, and moves all nodes along. On failure they stay.
    pub fn fit(&mut self, found: &[Option<[f64; 2]>], frame: &Frame) -> Result<(), TrackError> {
        self.from.clear();
        self.to.clear();
        for (x, f) in self.base.iter().zip(found) {
            if let Some(f) = f {
                self.from.push(*x);
                self.to.push(*f);
            }
        }
        self.inliers.fill(false);
        self.close = 0;
        if self.from.len() < self.ssm.capabilities().min_points {
            return Err(TrackError::Degenerate("too few points were found"));
        }
        self.before.clear();
        self.before.extend_from_slice(self.ssm.state());
        ssm::estimate(&mut self.ssm, &mut self.estimator, &self.from, &self.to)?;
        interrupt::check()?;
        let huge = self.ssm.corners().outgrow(frame.width(), frame.height());
        if huge || self.follow().is_err() {
            self.ssm.set_state(&self.before)?;
            self.follow()?;
            return Err(TrackError::TOO_LARGE);
        }
        let mut agreed = self.estimator.inliers().iter();
        for ((inlier, f), x) in self.inliers.iter_mut().zip(found).zip(&self.now) {
            if let Some(f) = f {
                let apart = (f[0] - x[0]).powi(2) + (f[1] - x[1]).powi(2);
                // What does not agree to a few pixels does not, whatever the others do.
                *inlier = agreed.next().copied().unwrap_or(false) && apart <= APART * APART;
                self.close += usize::from(*inlier && apart <= CLOSE * CLOSE);
            }
        }
        Ok(())
    }

    /// Remembers the present fit.
    pub fn save(&mut self) {
        self.saved.0.clear();
        self.saved.0.extend_from_slice(self.ssm.state());
        self.saved.1.clone_from(&self.inliers);
        self.saved.2 = self.close;
    }

    /// Goes back to the fit that was remembered.
    pub fn restore(&mut self) -> Result<(), TrackError> {
        self.ssm.set_state(&self.saved.0)?;
        self.inliers.copy_from_slice(&self.saved.1);
        self.close = self.saved.2;
        self.follow()
    }

    pub fn memory(&self) -> usize {
        self.ssm.memory() + NODE_BYTES * self.params.size.len()
    }
}
