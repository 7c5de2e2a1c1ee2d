//! What may be wrong with a run directory and its files.

use crate::store::file::FileError;
use std::io;
use std::path::{Path, PathBuf};

/// A run directory that cannot be used, or a file in it that cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// The directory holds other things.
    #[error("{path} is neither empty nor a run directory ({reason}): choose another --out", path = .path.display())]
    NotARunDirectory {
        /// The directory.
        path: PathBuf,
        /// What shows that it is none.
        reason: String,
    },
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
    /// The directory holds results that the run would replace by others.
    #[error("{path} holds another experiment ({}): choose another --out, or --force to discard it", listed(.differences), path = .path.display())]
    OtherExperiment {
        /// The run directory.
        path: PathBuf,
        /// What differs, of the directory's run against the new one; at least one.
        differences: Vec<String>,
    },
    /// A run that has not got to its end.
    #[error("{path} is incomplete: {missing} of {units} units (one tracker on one sequence each) have no result; run its command again to go on", path = .path.display())]
    Incomplete {
        /// The run directory.
        path: PathBuf,
        /// Units of the run, or of its shard.
        units: usize,
        /// Those without an end.
        missing: usize,
    },
    /// Results that another state of the run directory gave.
    #[error("{path} is not of the units that its directory holds; run the directory's command again to make it anew", path = .path.display())]
    Stale {
        /// The file.
        path: PathBuf,
    },
    /// Results of another build of the program.
    #[error("{path} holds results of another build of the program ({builds}): --force discards them, --mix-builds keeps them", path = .path.display())]
    OtherBuild {
        /// The run directory.
        path: PathBuf,
        /// The builds.
        builds: String,
    },
    /// The directory is not where it was.
    #[error("{0} was moved or deleted while the run wrote to it; put it back or run again")]
    Gone(PathBuf),
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

/// The first few differences, and how many more there are.
fn listed(differences: &[String]) -> String {
    const SHOWN: usize = 4;
    let mut text = differences[..differences.len().min(SHOWN)].join("; ");
    if differences.len() > SHOWN {
        text += &format!("; and {} more", differences.len() - SHOWN);
    }
    text
}

/// Whether there is no room for a file: the disk or quota is full, or a limit of file sizes is reached.
pub fn is_full(kind: io::ErrorKind) -> bool {
    matches!(
        kind,
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge
    )
}

impl StoreError {
    /// Wraps an error of the system, telling a full disk from other failures.
    pub fn io(path: &Path, source: io::Error) -> StoreError {
        match source.kind() {
            kind if is_full(kind) => StoreError::DiskFull(path.to_path_buf()),
            _ => StoreError::Io {
                path: path.to_path_buf(),
                source,
            },
        }
    }
}

impl From<FileError> for StoreError {
    fn from(error: FileError) -> StoreError {
        match error {
            FileError::Io { path, source } => StoreError::io(&path, source),
            FileError::Format { path, reason } => StoreError::Damaged { path, reason },
        }
    }
}
