//! A grid of points followed by pyramidal Lucas-Kanade flow from frame to frame, and one warp fitted to them.

use super::entry::{CompositeEntry, CompositeFamily, Make, Parts, Refused};
use super::nodes::{NodeParams, Nodes, PointSettings};
use crate::consensus::EstimatorParams;
use crate::flow::{Klt, KltParams, PointStatus, Tracked};
use crate::geom::{Corners, homography};
use crate::image::Frame;
use crate::interrupt;
use crate::params::Params;
use crate::ssm::{self, StateSpaceModel};
use crate::tracker::{Marks, Stop, TrackError, Tracker, Update};
use std::sync::Arc;

pub(super) type FlowSettings = (KltParams, PointSettings);

/// The table row.
pub(super) const ENTRY: CompositeEntry = CompositeEntry::new::<FlowSettings>(
    "flow",
    "a grid of points followed by pyramidal Lucas-Kanade flow, and one warp fitted to them",
    |a, parts| {
        let (klt, points) = FlowSettings::from_assignments(a)?;
        make(klt, points, parts)
    },
    CompositeFamily { members: (0, 0) },
)
.also(&["klt"]);

/// What builds a grid of points with these parameters.
pub(super) fn make(klt: KltParams, points: PointSettings, parts: &Parts<'_>) -> Result<Make, Refused> {
    let (nodes, (estimator, warp)) = points;
    let warp = parts.warp("ssm", &warp.ssm)?;
    Ok(Arc::new(move || {
        let (nodes, klt, estimator) = (nodes.clone(), klt.clone(), estimator.clone());
        Ok(Box::new(FlowGrid::new(nodes, klt, estimator, warp.build()?)))
    }))
}

/// Bytes per node: as tracked, twice, as found, its origin and its miss.
const NODE_BYTES: usize = 2 * size_of::<Tracked>() + size_of::<Option<[f64; 2]>>() + 3 * size_of::<f64>();

/// Highest level when the motion is small or nearly known.
const NEAR: usize = 2;

/// Tracks the nodes of a grid over the object from the last frame to the next by sparse optical flow, and fits the warp
/// `S` to them, outliers apart. Its similarity is the fraction of the nodes that agree with the fit.
///
/// Nodes are placed anew in each frame where the warp says, so errors add up slowly; in a cascade, a tracker with a
/// template removes them.
pub struct FlowGrid<S> {
    nodes: Nodes<S>,
    klt: Klt,
    previous: Option<Frame>,
    tracked: Vec<Tracked>,
    again: Vec<Tracked>,
    misses: Vec<f64>,
    found: Vec<Option<[f64; 2]>>,
    origins: Vec<[f64; 2]>,
}

impl<S: StateSpaceModel> FlowGrid<S> {
    /// With all parameters.
    pub fn new(nodes: NodeParams, klt: KltParams, estimator: EstimatorParams, ssm: S) -> Self {
        FlowGrid {
            nodes: Nodes::new(nodes, estimator, ssm),
            klt: Klt::new(klt),
            previous: None,
            tracked: Vec::new(),
            again: Vec::new(),
            misses: Vec::new(),
            found: Vec::new(),
            origins: Vec::new(),
        }
    }

    /// Tracks the nodes on level `highest` at most, and fits.
    fn follow(&mut self, previous: &Frame, frame: &Frame, highest: usize) -> Result<(), TrackError> {
        let (from, tracked) = (&self.origins, &mut self.tracked);
        self.klt.track(previous, frame, from, highest, tracked);
        interrupt::check()?;
        self.found.clear();
        self.found.extend(tracked.iter().map(|t| t.ok().then_some(t.at)));
        if self.nodes.params.grid_fb > 0.0 {
            self.klt
                .forward_backward(previous, frame, from, tracked, highest, &mut self.misses);
            self.nodes.check_back(&self.misses, &mut self.found);
        }
        self.nodes.fit(&self.found, frame)
    }

    /// Whether so many nodes agree with the fit that it can be relied on.
    fn enough(&self) -> bool {
        let textured = self.tracked.iter().filter(|t| t.status != PointStatus::Flat);
        self.nodes.enough(self.klt.params().klt_enough, textured.count())
    }

    /// Tracks the nodes again, from where the fit has put them and through windows warped like it, on level `highest` at
    /// most, and fits again; keeps the first fit when fewer nodes agree with the second. `before`: corners in the last frame.
    fn refine(
        &mut self,
        previous: &Frame,
        frame: &Frame,
        before: &Corners,
        highest: usize,
    ) -> Result<(), TrackError> {
        let (after, agreement) = (self.nodes.ssm.corners(), self.nodes.agreement());
        let Some(motion) = homography::from_corners(before, &after) else {
            return Ok(());
        };
        let (now, origins, found, tracked) = (self.nodes.now(), &self.origins, &self.found, &self.tracked);
        // Nodes that failed the way back are not asked again.
        let failed = |i: usize| found[i].is_none() && tracked[i].ok();
        self.klt.track_each(now.len(), &mut self.again, |klt, i| {
            if failed(i) {
                return tracked[i];
            }
            let (a, _) = homography::spatial_derivatives(&motion, origins[i]);
            let a = [a[(0, 0)], a[(0, 1)], a[(1, 0)], a[(1, 1)]];
            klt.track_warped(previous, frame, origins[i], now[i], a, highest)
        });
        interrupt::check()?;
        for (i, again) in self.again.iter().enumerate() {
            let failed = self.found[i].is_none() && self.tracked[i].ok();
            self.found[i] = (!failed && again.ok()).then_some(again.at);
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

impl<S: StateSpaceModel> Tracker for FlowGrid<S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.nodes.init(corners)?;
        self.previous = None;
        // Points that cannot be followed where nothing moves cannot be followed at all.
        self.klt
            .track(frame, frame, self.nodes.now(), usize::MAX, &mut self.tracked);
        interrupt::check()?;
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
        let before = self.corners();
        self.origins.clear();
        self.origins.extend_from_slice(self.nodes.now());
        let KltParams {
            klt_passes,
            klt_levels,
            klt_enough,
            klt_window,
            ..
        } = *self.klt.params();
        // Most motion is small: only where it is not is all of the pyramid worth its time.
        let mut done = false;
        if klt_enough > 0.0 && klt_levels > NEAR {
            self.nodes.save();
            done = self.follow(&previous, frame, NEAR).is_ok() && self.enough();
            if !done {
                self.nodes.restore()?;
            }
        }
        if !done {
            self.follow(&previous, frame, usize::MAX)?;
        }
        for _ in 1..klt_passes {
            let near = self.enough();
            if near && self.nodes.stiff(&before, klt_window as f64 / 2.0) {
                break;
            }
            self.refine(&previous, frame, &before, if near { 0 } else { NEAR })?;
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

    fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.nodes.set_region(corners)?;
        self.previous = Some(frame.clone());
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.nodes.ssm.corners()
    }

    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        ssm::place(&self.nodes.ssm, x)
    }

    fn agreeing(&self) -> Option<Marks<'_>> {
        let (size, marks) = (self.nodes.params.size, self.nodes.inliers());
        (!marks.is_empty()).then_some(Marks { size, marks })
    }

    fn reseed(&mut self, seed: u64) {
        self.nodes.reseed(seed);
    }

    fn set_threads(&mut self, threads: usize) {
        self.klt.set_threads(threads);
    }

    fn memory(&self) -> usize {
        let points = NODE_BYTES * self.nodes.params.size.len();
        self.nodes.memory() + self.klt.memory() + points
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use crate::ssm::Translation;

    /// Waves moved by `(dx, dy)` px; right of `edge` (px) something else covers them.
    fn frame([dx, dy]: [f64; 2], edge: usize) -> Frame {
        Frame::from_gray(Image::from_fn(240, 200, |x, y| {
            let (u, v) = (x as f64 - dx, y as f64 - dy);
            let wave = |a: f64, b: f64, c: f64| libm::sin(a * u + b * v + c);
            if x >= edge {
                return (110.0 + 50.0 * libm::sin(0.31 * x as f64 + 0.9 * libm::sin(0.11 * y as f64))) as f32;
            }
            (128.0 + 40.0 * wave(0.21, 0.13, 0.4) + 35.0 * wave(-0.11, 0.27, 1.9)) as f32
        }))
    }

    #[test]
    fn nodes_that_miss_their_origin_on_the_way_back_are_left_out() {
        let (first, second) = (frame([0.0; 2], 240), frame([2.0, 1.0], 130));
        let nodes = NodeParams {
            grid_fb: 1.0,
            ..NodeParams::default()
        };
        // One pass, and no other check of what was found.
        let klt = KltParams {
            klt_min_ncc: -1.0,
            klt_passes: 1,
            klt_enough: 0.0,
            ..KltParams::default()
        };
        let mut tracker = FlowGrid::new(nodes, klt.clone(), EstimatorParams::default(), Translation::new());
        tracker
            .init(&first, &Corners::rect(60.0, 50.0, 120.0, 100.0))
            .unwrap();
        let origins = tracker.nodes().to_vec();
        tracker.update(&second).unwrap();
        let mut klt = Klt::new(klt);
        let (mut kept, mut left) = (0, 0);
        for (i, &x) in origins.iter().enumerate() {
            let there = klt.track_point(&first, &second, x, x);
            let back = klt.track_point(&second, &first, there.at, there.at);
            let miss = (back.at[0] - x[0]).hypot(back.at[1] - x[1]);
            let returns = there.ok() && back.ok() && miss <= 1.0;
            assert_eq!(tracker.found[i].is_some(), returns, "{x:?} {there:?} {back:?}");
            kept += usize::from(returns);
            left += usize::from(there.ok() && !returns);
        }
        assert!(kept > 30 && left > 5, "{kept} {left}");
    }
}
