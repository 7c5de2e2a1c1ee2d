//! Composite trackers: trackers made of trackers, which may be composites themselves.
//!
//! One file per kind, with its row; [`COMPOSITES`] lists the rows. [`SHORT`] lists the search methods that are short for
//! composites of others. May depend on everything below `best`.

mod cascade;
mod entry;
mod feature;
mod flow_grid;
mod grid;
mod guard;
mod history;
mod line;
mod members;
mod nodes;
mod parallel;
mod pyramid;
mod rklt;
mod same;
mod seed;
mod short;
mod straighten;

pub use cascade::{Cascade, CascadeParams};
pub use entry::{CompositeEntry, CompositeFamily, Make, Member, Parts, Refused, Warp, WarpParams, build_all};
pub use flow_grid::FlowGrid;
pub use grid::{Grid, GridReset, PatchParams};
pub use guard::{Guard, GuardParams};
pub use line::LineTracker;
pub use nodes::NodeParams;
pub use parallel::{Combination, Parallel, ParallelParams};
pub use pyramid::{Pyramid, PyramidParams};
pub use rklt::{Rklt, RkltParams};
pub use short::{SHORT, ShortEntry, ShortFamily};
pub use straighten::LineParams;

/// Every kind of composite, in the order of the documentation.
pub const COMPOSITES: &[CompositeEntry] = &[
    cascade::ENTRY,
    parallel::ENTRY,
    pyramid::ENTRY,
    same::CASCADE,
    same::PARALLEL,
    rklt::ENTRY,
    guard::ENTRY,
    grid::ENTRY,
    flow_grid::ENTRY,
    line::ENTRY,
    feature::ENTRY,
];
