//! Evaluation of registration-based trackers on image sequences with ground truth; the trackers themselves are those
//! of the crate [`mtf`].
#![deny(missing_docs)]

pub mod catalogue;
pub mod cli;
pub mod dataset;
pub mod judge;
pub mod measure;
pub mod metric;
pub mod panics;
pub mod plan;
pub mod report;
pub mod run;
pub mod store;
pub mod synth;

/// What most programs need.
pub mod prelude {
    pub use crate::dataset;
    pub use crate::metric::error::frame_error;
    pub use mtf::prelude::*;
}
