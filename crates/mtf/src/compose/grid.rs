//! A grid of small trackers of any kind, and one warp fitted to where they go.

use super::entry::{CompositeEntry, CompositeFamily, Refused};
use super::flow_grid::{self, FlowSettings};
use super::members;
use super::nodes::{NodeParams, Nodes, PointSettings};
use super::seed::{self, Apart};
use super::straighten::Lines;
use crate::consensus::EstimatorParams;
use crate::flow::Texture;
use crate::geom::{Corners, homography};
use crate::image::Frame;
use crate::interrupt;
use crate::params::{Params, Resolution, param_enum};
use crate::ssm::{self, StateSpaceModel};
use crate::tracker::{Marks, Stop, TrackError, Tracker, Update};
use rayon::prelude::*;
use std::sync::Arc;

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
        /// Passes over each frame. In all but the first, patches begin where the fit before puts them, their regions warped
        /// like it. Not for grid_reset=never, whose patches go their own ways.
        grid_passes: usize = 2, in 1..=10;
        /// Share of the patches with texture that must agree after the first pass for the others to be left out, in frames that
        /// hardly warp a patch; 0: they never are.
        grid_enough: f64 = 0.8, in 0.0..=1.0;
        /// Patches of less texture are left out: smaller eigenvalue of the mean of ∇I ∇Iᵀ, (intensity/px)²; 0: none is.
        grid_min_eigen: f64 = 0.1, in 0.0..=1e6;
    }
}

pub(super) type GridSettings = (PatchParams, PointSettings);

/// The table row: a grid of trackers, or of points where the member is `flow`.
pub(super) const ENTRY: CompositeEntry = CompositeEntry::new::<GridSettings>(
    "grid",
    "patches around the nodes of a grid, and one warp fitted to their motion; of a tracker each, or grid(flow)",
    |a, parts| {
        let (patches, points) = GridSettings::from_assignments(a)?;
        let member = &parts.members[0];
        if member.kind == flow_grid::ENTRY.name {
            let of_patches = |name: &str| PatchParams::info().iter().any(|i| i.name == name);
            if let Some((name, _)) = a.iter().find(|(name, _)| of_patches(name)) {
                return Err(Refused::Unfit(format!(
                    "{name} is of no use to grid(flow), whose points have klt_window"
                )));
            }
            let (klt, _) = FlowSettings::from_assignments(&member.assignments)?;
            return flow_grid::make(klt, points, parts);
        }
        let (nodes, (estimator, warp)) = points;
        let (warp, patch) = (parts.warp("ssm", &warp.ssm)?, Arc::clone(&member.make));
        Ok(Arc::new(move || {
            let (nodes, patches, estimator) = (nodes.clone(), patches.clone(), estimator.clone());
            let patch = Arc::clone(&patch);
            Ok(Box::new(Grid::new(
                nodes,
                patches,
                estimator,
                warp.build()?,
                move || patch(),
            )?))
        }))
    },
    CompositeFamily { members: (1, 1) },
)
.published("section 3.2");

/// Bytes per node: where its patch begins, twice, its update, its place and its marks.
const NODE_BYTES: usize = 2 * size_of::<Corners>()
    + size_of::<Option<Update>>()
    + size_of::<Option<[f64; 2]>>()
    + 4 * size_of::<f64>();

/// Patches are left out as long as there are this many times as many as determine the warp.
const ENOUGH: usize = 3;
/// Texture is judged in windows no wider than this, px.
const MAX_WINDOW: usize = 101;

/// Tracks patches around the nodes of a grid over the object, each by a tracker of its own, and fits the warp `S` to
/// their centres, outliers apart. Its similarity is the fraction of the nodes that agree with the fit.
pub struct Grid<S> {
    params: PatchParams,
    nodes: Nodes<S>,
    /// One per node, from `init` on.
    members: Vec<Box<dyn Tracker>>,
    make: Box<dyn Fn() -> Option<Box<dyn Tracker>> + Send>,
    seed: Option<u64>,
    /// Tracks back with templates of the present frame.
    back: Box<dyn Tracker>,
    previous: Option<Frame>,
    found: Vec<Option<[f64; 2]>>,
    /// Members that the next frame starts from their node, whatever the way of reset.
    lost: Vec<bool>,
    texture: Texture,
    /// Patches left out.
    flat: Vec<bool>,
    /// Patches that failed the way back in this frame.
    failed: Vec<bool>,
    /// Whether the members have yet to be made ready for the next frame.
    unready: bool,
    /// Where the patches begin in the next frame.
    starts: Vec<Corners>,
    /// Where they begin in the present pass.
    regions: Vec<Corners>,
    updates: Vec<Option<Update>>,
    misses: Vec<f64>,
    /// Holds rows and columns straight.
    lines: Option<Lines>,
    threads: usize,
}

impl<S: StateSpaceModel> Grid<S> {
    /// With all parameters and `member`, which builds one patch tracker. Those of all nodes are built by `init`.
    ///
    /// # Errors
    /// Those of `member`.
    pub fn new<E>(
        nodes: NodeParams,
        params: PatchParams,
        estimator: EstimatorParams,
        ssm: S,
        member: impl Fn() -> Result<Box<dyn Tracker>, E> + Send + 'static,
    ) -> Result<Self, E> {
        Self::with_lines(nodes, params, estimator, ssm, None, member)
    }

    pub(super) fn with_lines<E>(
        nodes: NodeParams,
        params: PatchParams,
        estimator: EstimatorParams,
        ssm: S,
        lines: Option<Lines>,
        member: impl Fn() -> Result<Box<dyn Tracker>, E> + Send + 'static,
    ) -> Result<Self, E> {
        let window = (params.patch_size as usize).clamp(3, MAX_WINDOW);
        Ok(Grid {
            params,
            members: Vec::new(),
            back: member()?,
            make: Box::new(move || member().ok()),
            seed: None,
            nodes: Nodes::new(nodes, estimator, ssm),
            previous: None,
            found: Vec::new(),
            lost: Vec::new(),
            texture: Texture::new(window),
            flat: Vec::new(),
            failed: Vec::new(),
            unready: false,
            starts: Vec::new(),
            regions: Vec::new(),
            updates: Vec::new(),
            misses: Vec::new(),
            lines,
            threads: 1,
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

    /// Builds the members that are not there yet.
    fn populate(&mut self) -> Result<(), TrackError> {
        let count = self.nodes.params.size.len();
        while self.members.len() < count {
            interrupt::check()?;
            let unable = TrackError::Unable("a patch tracker can no longer be built");
            let mut member = (self.make)().ok_or(unable)?;
            if let Some(seed) = self.seed {
                let number = self.members.len() as u64 + 1;
                member.reseed(seed::of_member(seed, number, Apart::Spaced));
            }
            self.members.push(member);
        }
        self.failed.resize(count, false);
        self.updates.resize(count, None);
        Ok(())
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

    /// Tracks every patch that is neither left out nor has failed, `step` says how, and notes where they were found. Returns the most
    /// iterations.
    fn track(
        &mut self,
        step: impl Fn(usize, &[Corners], &mut Box<dyn Tracker>) -> Result<Update, TrackError> + Sync,
    ) -> u32 {
        let (flat, failed, regions) = (&self.flat, &self.failed, &self.regions);
        act(&mut self.members, &mut self.updates, self.threads, |i, member| {
            let wanted = !flat[i] && !failed[i];
            wanted.then(|| step(i, regions, member)).and_then(Result::ok)
        });
        self.found.clear();
        let found = self.updates.iter();
        self.found.extend(found.map(|u| u.map(|u| u.corners.centroid())));
        self.updates
            .iter()
            .flatten()
            .map(|u| u.iterations)
            .max()
            .unwrap_or(0)
    }

    /// Fits the warp to the patches as found, held to straight lines where that is asked for.
    fn fit(&mut self, frame: &Frame) -> Result<(), TrackError> {
        self.lost.clear();
        self.lost.extend(self.found.iter().map(Option::is_none));
        if let Some(lines) = &mut self.lines {
            lines.straighten(self.nodes.now(), &mut self.found, &mut self.lost);
        }
        self.nodes.fit(&self.found, frame)
    }

    /// Tracks the patches again, from where the fit has put them, and fits again; keeps the first fit when fewer patches
    /// agree with the second. `before`: corners in the last frame.
    fn refine(&mut self, frame: &Frame, before: &Corners) -> Result<(), TrackError> {
        let agreement = self.nodes.agreement();
        let Some(motion) = homography::from_corners(before, &self.corners()) else {
            return Ok(());
        };
        let mut regions = std::mem::take(&mut self.regions);
        regions.clear();
        regions.extend((0..self.members.len()).map(|i| match self.params.grid_reset {
            GridReset::Fixed => self.patch(i, true),
            GridReset::Move => self.patch(i, false),
            GridReset::Never | GridReset::Reinit => homography::apply_corners(&motion, &self.starts[i]),
        }));
        self.regions = regions;
        self.track(|i, regions, member| member.set_region(&regions[i]).and_then(|()| member.update(frame)));
        interrupt::check()?;
        self.nodes.save();
        let fitted = self.fit(frame);
        if fitted.is_err() || self.nodes.agreement() < agreement {
            self.nodes.restore()?;
        }
        Ok(())
    }

    /// Sees which patches have too little texture; none when hardly any has enough.
    fn judge(&mut self, frame: &Frame) -> Result<(), TrackError> {
        self.flat.clear();
        for &x in self.nodes.now() {
            interrupt::check()?;
            let least = self.params.grid_min_eigen;
            let flat = least > 0.0 && self.texture.min_eigen(frame.gray(), x) < least;
            self.flat.push(flat);
        }
        let left = self.flat.iter().filter(|flat| !**flat).count();
        if left < ENOUGH * self.nodes.ssm.capabilities().min_points {
            self.flat.fill(false);
        }
        Ok(())
    }

    /// Whether so many patches agree with the fit that it can be relied on.
    fn enough(&self) -> bool {
        let textured = self.flat.iter().filter(|flat| !**flat).count();
        self.nodes.enough(self.params.grid_enough, textured)
    }

    /// How far patches reach from their nodes, px.
    fn radius(&self) -> f64 {
        let area = self.starts.first().map_or(0.0, Corners::signed_area);
        area.abs().sqrt() / 2.0
    }

    /// Makes the members ready for the next frame; `frame` is the one before it.
    fn reset(&mut self, frame: &Frame) -> Result<(), TrackError> {
        let how = self.params.grid_reset;
        // Where templates are new, so is the texture.
        if how == GridReset::Reinit {
            self.judge(frame)?;
        }
        let mut starts = std::mem::take(&mut self.starts);
        starts.clear();
        starts.extend((0..self.members.len()).map(|i| self.patch(i, how == GridReset::Fixed)));
        self.starts = starts;
        let (lost, flat, starts) = (&self.lost, &self.flat, &self.starts);
        act(&mut self.members, &mut self.updates, self.threads, |i, member| {
            // A member that cannot start here is not found in the next frame; others stand in for it.
            let _ = match how {
                GridReset::Never if !lost[i] => Ok(()),
                _ if flat[i] => Ok(()),
                GridReset::Reinit => member.init(frame, &starts[i]),
                GridReset::Never | GridReset::Move | GridReset::Fixed => member.set_region(&starts[i]),
            };
            None
        });
        Ok(interrupt::check()?)
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

/// Fewest members that are worth another thread.
const MIN_SHARE: usize = 8;

/// Does something with every member, on several threads if there are more than one. Interrupted, it leaves out the rest.
fn act(
    members: &mut [Box<dyn Tracker>],
    updates: &mut [Option<Update>],
    threads: usize,
    act: impl Fn(usize, &mut Box<dyn Tracker>) -> Option<Update> + Sync,
) {
    let act = |i: usize, member: &mut Box<dyn Tracker>| match interrupt::requested() {
        true => None,
        false => act(i, member),
    };
    if threads > 1 {
        let token = interrupt::current();
        let count = updates.len();
        let both = members.par_iter_mut().zip(updates).enumerate();
        both.with_min_len(MIN_SHARE.max(count.div_ceil(threads)))
            .for_each(|(i, (member, update))| {
                *update = interrupt::under(token.clone(), || act(i, member));
            });
    } else {
        for (i, (member, update)) in members.iter_mut().zip(updates).enumerate() {
            *update = act(i, member);
        }
    }
}

impl<S: StateSpaceModel> Tracker for Grid<S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.populate()?;
        self.nodes.init(corners)?;
        self.previous = None;
        self.unready = false;
        let mut started = 0;
        self.starts.clear();
        for i in 0..self.members.len() {
            let patch = self.patch(i, false);
            started += usize::from(self.members[i].init(frame, &patch).is_ok());
            interrupt::check()?;
            self.starts.push(patch);
        }
        if started < self.nodes.ssm.capabilities().min_points {
            return Err(TrackError::Template("too few patches can be tracked"));
        }
        self.judge(frame)?;
        self.previous = Some(frame.clone());
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        let previous = self
            .previous
            .replace(frame.clone())
            .ok_or(TrackError::NotInitialised)?;
        if std::mem::take(&mut self.unready) {
            self.reset(&previous)?;
        }
        self.failed.fill(false);
        let iterations = self.track(|_, _, member| member.update(frame));
        interrupt::check()?;
        if self.nodes.params.grid_fb > 0.0 {
            self.misses.clear();
            for i in 0..self.members.len() {
                interrupt::check()?;
                let d = if self.found[i].is_some() {
                    self.miss(i, &previous, frame)
                } else {
                    f64::INFINITY
                };
                self.misses.push(d);
            }
            self.nodes.check_back(&self.misses, &mut self.found);
            for ((failed, update), found) in self.failed.iter_mut().zip(&self.updates).zip(&self.found) {
                *failed = update.is_some() && found.is_none();
            }
        }
        let before = self.corners();
        let mut fitted = self.fit(frame);
        let passes = match self.params.grid_reset {
            GridReset::Never => 1,
            _ => self.params.grid_passes,
        };
        for _ in 1..passes {
            if self.enough() && self.nodes.stiff(&before, self.radius()) {
                break;
            }
            fitted = fitted.and_then(|()| self.refine(frame, &before));
        }
        // The next frame does it, where the object is thought to be by then.
        self.unready = true;
        fitted?;
        Ok(Update {
            corners: self.corners(),
            stop: Stop::Done,
            iterations,
            similarity: self.nodes.agreement(),
        })
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        if self.previous.is_none() {
            return Err(TrackError::NotInitialised);
        }
        self.nodes.set_region(corners)?;
        self.lost.clear();
        self.lost.resize(self.members.len(), true);
        self.unready = true;
        Ok(())
    }

    fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.set_region(corners)?;
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
        self.seed = Some(seed);
        let of_member = |i: u64| seed::of_member(seed, i, Apart::Spaced);
        for (member, i) in self.members.iter_mut().zip(1..) {
            member.reseed(of_member(i));
        }
        self.back
            .reseed(of_member(self.nodes.params.size.len() as u64 + 1));
    }

    fn set_threads(&mut self, threads: usize) {
        self.threads = threads;
    }

    fn channels(&self) -> usize {
        self.back.channels()
    }

    fn memory(&self) -> usize {
        let (count, back) = (self.nodes.params.size.len(), self.back.memory());
        let members = match self.members.is_empty() {
            true => count.saturating_mul(back),
            false => members::kept(self.members.iter().map(AsRef::as_ref)),
        };
        (self.nodes.memory() + NODE_BYTES * count)
            .saturating_add(members)
            .saturating_add(back)
    }

    fn memory_needed(&self) -> usize {
        let passing = members::passing([self.back.as_ref()]);
        self.memory()
            .saturating_add(passing.saturating_mul(self.threads.max(1)))
    }
}
