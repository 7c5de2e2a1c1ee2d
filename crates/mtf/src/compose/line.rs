//! A grid of trackers whose rows and columns are held straight.

use super::entry::{CompositeEntry, CompositeFamily};
use super::grid::{Grid, GridSettings, PatchParams};
use super::nodes::NodeParams;
use super::straighten::{LineParams, Lines};
use crate::consensus::EstimatorParams;
use crate::geom::Corners;
use crate::image::Frame;
use crate::params::Params;
use crate::ssm::StateSpaceModel;
use crate::tracker::{Marks, TrackError, Tracker, Update};
use std::sync::Arc;

type LineSettings = (LineParams, GridSettings);

/// The table row.
pub(super) const ENTRY: CompositeEntry = CompositeEntry::new::<LineSettings>(
    "line",
    "a grid whose rows and columns are held straight",
    |a, parts| {
        let (lines, (patches, (nodes, (estimator, warp)))) = LineSettings::from_assignments(a)?;
        let (warp, patch) = (parts.warp("ssm", &warp.ssm)?, Arc::clone(&parts.members[0].make));
        Ok(Arc::new(move || {
            let (nodes, patches, lines) = (nodes.clone(), patches.clone(), lines.clone());
            let (ssm, patch) = (warp.build()?, Arc::clone(&patch));
            let tracker = LineTracker::new(nodes, patches, lines, estimator.clone(), ssm, move || patch())?;
            Ok(Box::new(tracker))
        }))
    },
    CompositeFamily { members: (1, 1) },
)
.published("section 3.2");

/// A [`Grid`] whose members are held to straight rows and columns before the warp is fitted: members that go astray are
/// put back on the intersection of their lines.
pub struct LineTracker<S> {
    grid: Grid<S>,
}

impl<S: StateSpaceModel> LineTracker<S> {
    /// With all parameters and `member`, which builds one patch tracker. Those of all nodes but one are built by `init`.
    ///
    /// # Errors
    /// Those of `member`.
    pub fn new<E>(
        nodes: NodeParams,
        params: PatchParams,
        lines: LineParams,
        estimator: EstimatorParams,
        ssm: S,
        member: impl Fn() -> Result<Box<dyn Tracker>, E> + Send + 'static,
    ) -> Result<Self, E> {
        let lines = Lines::new(lines, nodes.size);
        let grid = Grid::with_lines(nodes, params, estimator, ssm, Some(lines), member)?;
        Ok(LineTracker { grid })
    }

    /// The grid of members.
    pub fn grid(&self) -> &Grid<S> {
        &self.grid
    }
}

impl<S: StateSpaceModel> Tracker for LineTracker<S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.grid.init(frame, corners)
    }
    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        self.grid.update(frame)
    }
    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.grid.set_region(corners)
    }
    fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.grid.skip(frame, corners)
    }
    fn corners(&self) -> Corners {
        self.grid.corners()
    }
    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        self.grid.place(x)
    }
    fn agreeing(&self) -> Option<Marks<'_>> {
        self.grid.agreeing()
    }
    fn reseed(&mut self, seed: u64) {
        self.grid.reseed(seed);
    }
    fn set_threads(&mut self, threads: usize) {
        self.grid.set_threads(threads);
    }
    fn channels(&self) -> usize {
        self.grid.channels()
    }
    fn memory(&self) -> usize {
        self.grid.memory()
    }
    fn memory_needed(&self) -> usize {
        self.grid.memory_needed()
    }
}
