//! Composite trackers: made of other trackers, of points, or of both.
//!
//! May depend on everything below `registry`.

mod feature;
mod grid;
mod klt_grid;
mod line;
mod nodes;

pub use feature::{Detection, FeatureParams, FeatureTracker};
pub use grid::{Grid, GridReset, PatchParams};
pub use klt_grid::KltGrid;
pub use line::{LineParams, LineTracker};
pub use nodes::NodeParams;
