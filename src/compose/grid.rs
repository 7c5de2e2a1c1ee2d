//! A grid of small trackers of any kind, and one warp fitted to where they go.

use super::line::Lines;
use super::nodes::{NodeParams, Nodes};
use crate::estimate::EstimatorParams;
use crate::geom::Corners;
use crate::image::Frame;
use crate::params::{Resolution, param_enum};
use crate::ssm::StateSpaceModel;
use crate::tracker::{Stop, TrackError, Tracker, Update};

param_enum! {
    /// What happens to the patches after each frame.
    pub enum GridReset {
        /// Nothing: each goes its own way with the template it began with.
        Never = "never",
        /// Each learns a new template where the warp puts its node.
        Reinit = "reinit",
        /// Each is moved to where the warp puts its node, and keeps its template.
        Move = "move",
        /// The same, its region warped as well: the patch is compared with its look in the first frame.
        Fixed = "fixed",
    }
}

crate::params! {
    /// Parameters of the patches of a grid.
    pub struct PatchParams {
        /// Side of the square patch around each point, px.
        patch_size: f64 = 25.0, in 4.0..=1000.0;
        /// Each patch as large as a cell of the grid, and of its shape, instead of a square.
        patch_cell: bool = false;
        /// After each frame: never, reinit (new templates), move (same templates) or fixed (same templates, warped along).
        grid_reset: GridReset = GridReset::Reinit;
        /// Tracking back begins with a new template from the present frame.
        grid_fb_reinit: bool = true;
    }
}

/// Tracks patches around the nodes of a grid over the object, each by a tracker of its own, and fits the warp `S` to
/// their centres, outliers apart. Its similarity is the fraction of the nodes that agree with the fit.
pub struct Grid<S> {
    params: PatchParams,
    nodes: Nodes<S>,
    members: Vec<Box<dyn Tracker>>,
    /// Tracks back with templates of the present frame.
    back: Box<dyn Tracker>,
    previous: Option<Frame>,
    found: Vec<Option<[f64; 2]>>,
    /// Members that the next frame starts from their node, whatever the way of reset.
    lost: Vec<bool>,
    misses: Vec<f64>,
    /// Holds rows and columns straight.
    lines: Option<Lines>,
}

impl<S: StateSpaceModel> Grid<S> {
    /// With all parameters and `member`, which builds one patch tracker.
    pub fn new<E>(
        nodes: NodeParams,
        params: PatchParams,
        estimator: EstimatorParams,
        ssm: S,
        member: impl Fn() -> Result<Box<dyn Tracker>, E>,
    ) -> Result<Self, E> {
        Self::with_lines(nodes, params, estimator, ssm, None, member)
    }

    pub(super) fn with_lines<E>(
        nodes: NodeParams,
        params: PatchParams,
        estimator: EstimatorParams,
        ssm: S,
        lines: Option<Lines>,
        member: impl Fn() -> Result<Box<dyn Tracker>, E>,
    ) -> Result<Self, E> {
        let members = (0..nodes.size.len()).map(|_| member());
        Ok(Grid {
            params,
            members: members.collect::<Result<_, E>>()?,
            back: member()?,
            nodes: Nodes::new(nodes, estimator, ssm),
            previous: None,
            found: Vec::new(),
            lost: Vec::new(),
            misses: Vec::new(),
            lines,
        })
    }

    /// Which nodes, row by row, were found in the last frame and agree with the fit.
    pub fn inliers(&self) -> &[bool] {
        self.nodes.inliers()
    }

    /// The nodes in the last frame, px, row by row.
    pub fn nodes(&self) -> &[[f64; 2]] {
        self.nodes.now()
    }

    /// Corners of patch `i` in the image, px: warped along, or upright around its node.
    fn patch(&self, i: usize, warped: bool) -> Corners {
        let half = self.params.patch_size / 2.0;
        let square = |[x, y]: [f64; 2]| Corners::rect(x - half, y - half, 2.0 * half, 2.0 * half);
        match (self.params.patch_cell, warped) {
            (true, _) => self.cell(i),
            (false, true) => Corners(square(self.nodes.base()[i]).0.map(|x| self.nodes.carry(x))),
            (false, false) => square(self.nodes.now()[i]),
        }
    }

    /// The cell around node `i`: its corners lie half a step from it along both axes of the grid.
    fn cell(&self, i: usize) -> Corners {
        let Resolution { cols, rows } = self.nodes.params.size;
        let (col, row, now) = (i % cols, i / cols, self.nodes.now());
        let step = |a: usize, b: usize| {
            let k = 0.5 / if b - a == 2 { 2.0 } else { 1.0 };
            (a, b, k)
        };
        let (l, r, kx) = step(col.saturating_sub(1), (col + 1).min(cols - 1));
        let (t, b, ky) = step(row.saturating_sub(1), (row + 1).min(rows - 1));
        let axis = |from: [f64; 2], to: [f64; 2], k: f64| [k * (to[0] - from[0]), k * (to[1] - from[1])];
        let across = axis(now[row * cols + l], now[row * cols + r], kx);
        let down = axis(now[t * cols + col], now[b * cols + col], ky);
        let signs = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        Corners(signs.map(|[u, v]| [0, 1].map(|c| now[i][c] + u * across[c] + v * down[c])))
    }

    /// Makes the members ready for the next frame.
    fn reset(&mut self, frame: &Frame) {
        for i in 0..self.members.len() {
            // A member that cannot start here is not found in the next frame; others stand in for it.
            let _ = match self.params.grid_reset {
                GridReset::Never if !self.lost[i] => Ok(()),
                GridReset::Reinit => {
                    let patch = self.patch(i, false);
                    self.members[i].init(frame, &patch)
                }
                GridReset::Never | GridReset::Move => {
                    let patch = self.patch(i, false);
                    self.members[i].set_region(&patch)
                }
                GridReset::Fixed => {
                    let patch = self.patch(i, true);
                    self.members[i].set_region(&patch)
                }
            };
        }
    }

    /// Squared distance by which member `i` misses its origin on the way back; infinite when it does not arrive.
    fn miss(&mut self, i: usize, previous: &Frame, frame: &Frame) -> f64 {
        let origin = self.nodes.now()[i];
        let region = self.members[i].corners();
        let back = if self.params.grid_fb_reinit {
            let started = self.back.init(frame, &region);
            started.and_then(|()| self.back.update(previous))
        } else {
            let back = self.members[i].update(previous);
            let restored = self.members[i].set_region(&region);
            restored.and(back)
        };
        back.map_or(f64::INFINITY, |u| {
            let [x, y] = u.corners.centroid();
            (x - origin[0]).powi(2) + (y - origin[1]).powi(2)
        })
    }
}

impl<S: StateSpaceModel> Tracker for Grid<S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.nodes.init(corners)?;
        self.previous = None;
        let mut started = 0;
        for i in 0..self.members.len() {
            let patch = self.patch(i, false);
            started += usize::from(self.members[i].init(frame, &patch).is_ok());
        }
        if started < self.nodes.ssm.capabilities().min_points {
            return Err(TrackError::Template("too few patches can be tracked"));
        }
        self.previous = Some(frame.clone());
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        let previous = self
            .previous
            .replace(frame.clone())
            .ok_or(TrackError::NotInitialised)?;
        self.found.clear();
        let mut iterations = 0;
        for member in &mut self.members {
            let update = member.update(frame);
            iterations = update
                .as_ref()
                .map_or(iterations, |u| iterations.max(u.iterations));
            self.found.push(update.ok().map(|u| u.corners.centroid()));
        }
        if self.nodes.params.grid_fb > 0.0 {
            self.misses.clear();
            for i in 0..self.members.len() {
                let d = if self.found[i].is_some() {
                    self.miss(i, &previous, frame)
                } else {
                    f64::INFINITY
                };
                self.misses.push(d);
            }
            self.nodes.check_back(&self.misses, &mut self.found);
        }
        self.lost.clear();
        self.lost.extend(self.found.iter().map(Option::is_none));
        if let Some(lines) = &mut self.lines {
            lines.straighten(self.nodes.now(), &mut self.found, &mut self.lost);
        }
        let fitted = self.nodes.fit(&self.found, frame);
        self.reset(frame);
        fitted?;
        Ok(Update {
            corners: self.corners(),
            stop: Stop::Done,
            iterations,
            similarity: self.nodes.agreement(),
        })
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.nodes.set_region(corners)?;
        let frame = self.previous.clone().ok_or(TrackError::NotInitialised)?;
        self.lost.clear();
        self.lost.resize(self.members.len(), true);
        self.reset(&frame);
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.nodes.ssm.corners()
    }

    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        self.nodes.ssm.place(x)
    }

    fn reseed(&mut self, seed: u64) {
        self.nodes.reseed(seed);
        let members = self.members.iter_mut().chain([&mut self.back]);
        for (member, i) in members.zip(1u64..) {
            // Multiples of an odd number are distinct.
            member.reseed(seed.wrapping_add(i.wrapping_mul(0x9e37_79b9_7f4a_7c15)));
        }
    }

    fn channels(&self) -> usize {
        self.back.channels()
    }

    fn memory(&self) -> usize {
        let members: usize = self.members.iter().map(Tracker::memory).sum();
        self.nodes.memory() + members + self.back.memory()
    }
}
