//! A grid of points followed by pyramidal Lucas-Kanade flow from frame to frame, and one warp fitted to them.

use super::nodes::{NodeParams, Nodes};
use crate::estimate::EstimatorParams;
use crate::flow::{Klt, KltParams, Tracked};
use crate::geom::{Corners, homography};
use crate::image::Frame;
use crate::ssm::StateSpaceModel;
use crate::tracker::{Stop, TrackError, Tracker, Update};

/// Tracks the nodes of a grid over the object from the last frame to the next by sparse optical flow, and fits the warp
/// `S` to them, outliers apart. Its similarity is the fraction of the nodes that agree with the fit.
///
/// Nodes are placed anew in each frame where the warp says, so errors add up slowly; in a cascade, a tracker with a
/// template removes them.
pub struct KltGrid<S> {
    nodes: Nodes<S>,
    klt: Klt,
    previous: Option<Frame>,
    tracked: Vec<Tracked>,
    misses: Vec<f64>,
    found: Vec<Option<[f64; 2]>>,
    origins: Vec<[f64; 2]>,
}

impl<S: StateSpaceModel> KltGrid<S> {
    /// With all parameters.
    pub fn new(nodes: NodeParams, klt: KltParams, estimator: EstimatorParams, ssm: S) -> Self {
        KltGrid {
            nodes: Nodes::new(nodes, estimator, ssm),
            klt: Klt::new(klt),
            previous: None,
            tracked: Vec::new(),
            misses: Vec::new(),
            found: Vec::new(),
            origins: Vec::new(),
        }
    }

    /// Tracks the nodes again, from where the fit has put them and through windows warped like it, and fits again; keeps
    /// the first fit when fewer nodes agree with the second. `before`: corners in the last frame.
    fn refine(&mut self, previous: &Frame, frame: &Frame, before: &Corners) -> Result<(), TrackError> {
        let (after, agreement) = (self.nodes.ssm.corners(), self.nodes.agreement());
        let Some(motion) = homography::from_corners(before, &after) else {
            return Ok(());
        };
        for (i, found) in self.found.iter_mut().enumerate() {
            // Nodes that failed the way back are not asked again.
            if found.is_none() && self.tracked[i].ok() {
                continue;
            }
            let x = self.origins[i];
            let (a, _) = homography::spatial_derivatives(&motion, x);
            let a = [a[(0, 0)], a[(0, 1)], a[(1, 0)], a[(1, 1)]];
            let again = self.klt.track_warped(previous, frame, x, self.nodes.now()[i], a);
            *found = again.ok().then_some(again.at);
        }
        self.nodes.save();
        let fitted = self.nodes.fit(&self.found, frame);
        if fitted.is_err() || self.nodes.agreement() < agreement {
            self.nodes.restore()?;
        }
        Ok(())
    }

    /// Which nodes, row by row, were found in the last frame and agree with the fit.
    pub fn inliers(&self) -> &[bool] {
        self.nodes.inliers()
    }

    /// The nodes in the last frame, px, row by row.
    pub fn nodes(&self) -> &[[f64; 2]] {
        self.nodes.now()
    }
}

impl<S: StateSpaceModel> Tracker for KltGrid<S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.nodes.init(corners)?;
        self.previous = None;
        // Points that cannot be followed where nothing moves cannot be followed at all.
        self.klt.track(frame, frame, self.nodes.now(), &mut self.tracked);
        let good = self.tracked.iter().filter(|t| t.ok()).count();
        if good < self.nodes.ssm.capabilities().min_points {
            return Err(TrackError::Template("too few points can be followed"));
        }
        self.previous = Some(frame.clone());
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        // A frame that fails is the last one all the same: the object is nearer to where it is in the next.
        let previous = self
            .previous
            .replace(frame.clone())
            .ok_or(TrackError::NotInitialised)?;
        let now = self.nodes.now();
        self.klt.track(&previous, frame, now, &mut self.tracked);
        self.found.clear();
        self.found
            .extend(self.tracked.iter().map(|t| t.ok().then_some(t.at)));
        if self.nodes.params.grid_fb > 0.0 {
            self.klt
                .forward_backward(&previous, frame, now, &self.tracked, &mut self.misses);
            self.nodes.check_back(&self.misses, &mut self.found);
        }
        let before = self.corners();
        self.origins.clear();
        self.origins.extend_from_slice(self.nodes.now());
        self.nodes.fit(&self.found, frame)?;
        for _ in 1..self.klt.params().klt_passes {
            self.refine(&previous, frame, &before)?;
        }
        Ok(Update {
            corners: self.corners(),
            stop: Stop::Done,
            iterations: 1,
            similarity: self.nodes.agreement(),
        })
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.nodes.set_region(corners)
    }

    fn corners(&self) -> Corners {
        self.nodes.ssm.corners()
    }

    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        self.nodes.ssm.place(x)
    }

    fn reseed(&mut self, seed: u64) {
        self.nodes.reseed(seed);
    }

    fn memory(&self) -> usize {
        self.nodes.memory() + self.klt.memory()
    }
}
