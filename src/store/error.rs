//! What may be wrong with a run directory and its files.

use std::io;
use std::path::{Path, PathBuf};

/// A run directory that cannot be used, or a file in it that cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// The directory holds other things.
    #[error("{0} is neither empty nor a run directory: choose another --out")]
    NotARunDirectory(PathBuf),
    /// Another process writes to the directory.
    #[error("{path} is locked by another run ({holder})", path = .path.display())]
    Locked {
        /// The run directory.
        path: PathBuf,
        /// Process, host and start time of the other run, as far as known.
        holder: String,
    },
    /// The directory holds no run.
    #[error("{path} is not a run directory: {reason}", path = .path.display())]
    NoRun {
        /// The directory.
        path: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// Directories of different runs.
    #[error("{path} is of another run: {reason}", path = .path.display())]
    Mismatch {
        /// The directory.
        path: PathBuf,
        /// What differs.
        reason: String,
    },
    /// No space left; what was finished is kept.
    #[error("no space left on the disk while writing {0}: nothing finished is lost, make room and run again")]
    DiskFull(PathBuf),
    /// A file cannot be read or written.
    #[error("cannot read or write {path}: {source}; choose another --out", path = .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A file written by a run cannot be read back.
    #[error("{path}: damaged ({reason}), run again to replace it", path = .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

impl StoreError {
    /// Wraps an error of the system, telling a full disk from other failures.
    pub fn io(path: &Path, source: io::Error) -> StoreError {
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                StoreError::DiskFull(path.to_path_buf())
            }
            _ => StoreError::Io {
                path: path.to_path_buf(),
                source,
            },
        }
    }
}
