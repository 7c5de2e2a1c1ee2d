//! Why a run did not get to its end.

use crate::plan::PlanError;
use crate::store::{FileError, StoreError};
use std::path::PathBuf;

/// Why a run could not be made, or did not get to its end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// There is no plan for the request.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The run directory cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Asked to stop by a signal; what was finished is kept.
    #[error(
        "stopped: {done} of {total} units (one tracker on one sequence each) done and kept, nothing lost; go on with the same command and --out {}",
        path.display()
    )]
    Interrupted {
        /// The run directory.
        path: PathBuf,
        /// Units with a result.
        done: usize,
        /// Units requested.
        total: usize,
    },
    /// Not even one worker thread can be started.
    #[error(
        "cannot start a worker thread ({0}): allow this user more processes or more memory (ulimit -u, ulimit -v)"
    )]
    Threads(std::io::Error),
}

impl From<FileError> for RunError {
    fn from(error: FileError) -> RunError {
        RunError::Store(error.into())
    }
}
