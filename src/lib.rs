//! Evaluation of registration-based trackers on image sequences with ground truth; the trackers themselves are those
//! of the crate [`mtf`].
//!
//! A room for each step of an evaluation, in the order in which they depend on each other:
//!
//! - [`files`]: reading of what users name. [`dataset`]: image sequences with ground truth, read and checked; [`synth`]: sequences rendered with exact truth.
//! - [`metric`]: errors of a frame, figures of many.
//! - [`plan`]: what is asked of a run, its units (tracker, sequence, start), their keys and seeds, shards.
//! - [`store`]: a run directory on disk: lock, journal, frame logs.
//! - [`judge`]: comparison of runs, baselines; [`measure`]: speed and basins of convergence.
//! - [`report`]: result files and tables.
//! - [`run`]: from a request to result files.
//! - [`catalogue`]: what a program may add to; [`cli`]: the command line, which is all that prints.
//!
//! A run of a program of one's own begins with [`plan::RunRequest::builder`]; a whole program with models of its own is
//! one call of [`cli::main`].
#![deny(missing_docs)]
// They panic where nobody reads the other end: `cli::console` writes instead.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod catalogue;
pub mod cli;
pub mod dataset;
pub mod files;
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
    pub use crate::metric::al::alignment_error;
    pub use crate::plan::{RunRequest, TrackerEntry};
    pub use mtf::prelude::*;
}
