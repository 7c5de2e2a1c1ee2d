//! Why a file cannot be used.

use std::io;
use std::path::{Path, PathBuf};

/// A file could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// Reading, writing, syncing or renaming failed.
    #[error("{path}: {source}", path = .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is not what its name promises.
    #[error("{path}: {reason}", path = .path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

impl FileError {
    /// Of `path`: what the system says.
    pub fn io(path: &Path, source: io::Error) -> FileError {
        FileError::Io {
            path: path.to_path_buf(),
            source,
        }
    }

    /// Of `path`: what is wrong with it.
    pub fn format(path: &Path, reason: impl ToString) -> FileError {
        FileError::Format {
            path: path.to_path_buf(),
            reason: reason.to_string(),
        }
    }
}
