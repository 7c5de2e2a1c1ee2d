//! A run directory: its lock, its atomic writes and its file names; and why a run may end early.

use crate::output::OutputError;
use sha2::{Digest, Sha256};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};

/// Files at the top of a run directory that a fresh start removes.
const TOP_FILES: [&str; 8] = [
    "run.json",
    "summary.csv",
    "sequences.csv",
    "curves.csv",
    "summary.json",
    "success.svg",
    "timing.csv",
    "journal.jsonl",
];

/// Why a run could not be made, or did not get to its end.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// No tracker or no sequence was asked for.
    #[error("nothing to run: {0}")]
    Nothing(&'static str),
    /// Two different sequences would write the same files.
    #[error(
        "two different sequences are both called {0}: give one of the data sets another folder name, or run them apart"
    )]
    Ambiguous(String),
    /// A sequence cannot be evaluated.
    #[error("{sequence}: {reason}")]
    Sequence {
        /// Data set and sequence.
        sequence: String,
        /// What is wrong with it.
        reason: String,
    },
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
    /// Asked to stop by a signal; what was finished is kept.
    #[error("stopped: {done} of {total} units done, nothing lost, run the same command again to go on")]
    Interrupted {
        /// Units with a result.
        done: usize,
        /// Units requested.
        total: usize,
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
    /// A frame log written by this run cannot be read back.
    #[error("{path}: damaged frame log ({reason}), run again to replace it", path = .path.display())]
    Damaged {
        /// The log.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Worker threads cannot be started.
    #[error("cannot start worker threads: {0}")]
    Threads(String),
    /// The result files cannot be made.
    #[error(transparent)]
    Output(OutputError),
}

impl From<OutputError> for RunError {
    fn from(error: OutputError) -> RunError {
        match error {
            OutputError::Io { path, source } => RunError::io(&path, source),
            other => RunError::Output(other),
        }
    }
}

impl RunError {
    /// Wraps an error of the system, telling a full disk from other failures.
    pub fn io(path: &Path, source: io::Error) -> RunError {
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                RunError::DiskFull(path.to_path_buf())
            }
            _ => RunError::Io {
                path: path.to_path_buf(),
                source,
            },
        }
    }
}

/// A run directory held under its lock.
#[derive(Debug)]
pub struct RunDir {
    path: PathBuf,
    lock: File,
}

impl RunDir {
    /// Creates or opens the directory at `path`, takes its lock and makes sure it can be written to. `fresh` removes
    /// what an earlier run wrote there.
    ///
    /// # Errors
    /// The directory is locked, holds other things than a run, cannot be created or written to, or the disk is full.
    pub fn open(path: &Path, fresh: bool) -> Result<RunDir, RunError> {
        fs::create_dir_all(path).map_err(|e| RunError::io(path, e))?;
        let lock_path = path.join(".lock");
        let io = |e| RunError::io(&lock_path, e);
        if !lock_path.exists() && !path.join("journal.jsonl").exists() && !path.join("run.json").exists() {
            let mut others = fs::read_dir(path).map_err(|e| RunError::io(path, e))?;
            if others.next().is_some() {
                return Err(RunError::NotARunDirectory(path.to_path_buf()));
            }
        }
        let mut lock = OpenOptions::new()
            .create(true)
            .read(true)
            .write(true)
            .truncate(false)
            .open(&lock_path)
            .map_err(io)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                let _ = lock.read_to_string(&mut holder);
                let holder = match holder.trim() {
                    "" => "holder unknown".to_string(),
                    known => known.to_string(),
                };
                return Err(RunError::Locked {
                    path: path.to_path_buf(),
                    holder,
                });
            }
            // Some network file systems have no locks: better unlocked than not at all.
            Err(TryLockError::Error(e)) if e.kind() == io::ErrorKind::Unsupported => {}
            Err(TryLockError::Error(e)) => return Err(io(e)),
        }
        let holder = format!(
            "pid {} on {} since {}\n",
            std::process::id(),
            host_name(),
            super::utc_now()
        );
        lock.set_len(0)
            .and_then(|()| lock.rewind())
            .and_then(|()| lock.write_all(holder.as_bytes()))
            .and_then(|()| lock.sync_data())
            .map_err(io)?;
        let dir = RunDir {
            path: path.to_path_buf(),
            lock,
        };
        dir.sweep()?;
        if fresh {
            dir.clear()?;
        }
        Ok(dir)
    }

    /// Removes temporary files that a killed run left at the top.
    fn sweep(&self) -> Result<(), RunError> {
        for entry in fs::read_dir(&self.path)
            .map_err(|e| RunError::io(&self.path, e))?
            .flatten()
        {
            if entry.file_name().to_string_lossy().ends_with(".tmp") {
                let _ = fs::remove_file(entry.path());
            }
        }
        Ok(())
    }

    fn clear(&self) -> Result<(), RunError> {
        let gone = |path: &Path, result: io::Result<()>| match result {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(RunError::io(path, e)),
            _ => Ok(()),
        };
        // The journal goes first: without it nothing else counts, however far this gets.
        for name in TOP_FILES.iter().rev() {
            let path = self.path.join(name);
            gone(&path, fs::remove_file(&path))?;
        }
        let frames = self.path.join("frames");
        gone(&frames, fs::remove_dir_all(&frames))
    }

    /// The directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of the journal.
    pub fn journal(&self) -> PathBuf {
        self.path.join("journal.jsonl")
    }

    /// Path of the folder of a tracker's logs.
    pub fn tracker_dir(&self, slug: &str) -> PathBuf {
        self.path.join("frames").join(file_name(slug))
    }

    /// Path of the frame log of a unit.
    pub fn log(&self, slug: &str, dataset: &str, sequence: &str, start: usize) -> PathBuf {
        let name = match start {
            0 => format!("{}.csv", file_name(sequence)),
            _ => format!("{}@{start}.csv", file_name(sequence)),
        };
        self.tracker_dir(slug).join(file_name(dataset)).join(name)
    }

    /// Writes `<dir>/<name>` as [`write_atomic`] does, unless it has these bytes already.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), RunError> {
        if fs::read(path).is_ok_and(|old| old == bytes) {
            return Ok(());
        }
        write_atomic(path, bytes, true)
    }
}

impl Drop for RunDir {
    fn drop(&mut self) {
        // The file stays (removing a lock file is a race) but says nothing any more.
        let _ = self.lock.set_len(0);
        let _ = self.lock.unlock();
    }
}

/// Writes a file so that its name never shows part of it: temporary name, sync (when asked), rename. Missing folders are
/// made. The temporary name is always the same, so what a killed run leaves is replaced by the next.
///
/// # Errors
/// A folder or the file cannot be written.
pub(super) fn write_atomic(path: &Path, bytes: &[u8], sync: bool) -> Result<(), RunError> {
    let io = |e| RunError::io(path, e);
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".tmp");
    let temporary = path.with_file_name(name);
    let write = || -> io::Result<()> {
        let mut file = match File::create(&temporary) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                path.parent().map_or(Ok(()), fs::create_dir_all)?;
                File::create(&temporary)?
            }
            other => other?,
        };
        file.write_all(bytes)?;
        if sync {
            file.sync_all()?;
        }
        fs::rename(&temporary, path)
    };
    write().map_err(|e| {
        let _ = fs::remove_file(&temporary);
        io(e)
    })
}

/// `name` as one component of a path: letters, digits and `-_.,+=` stay, the rest becomes `_` and a hash of the name is
/// added so that two names never share a file.
pub fn file_name(name: &str) -> String {
    const LONGEST: usize = 120;
    let kept: String = name
        .chars()
        .enumerate()
        .map(|(i, c)| match c {
            '.' if i > 0 => c,
            c if c.is_alphanumeric() || "-_,+=".contains(c) => c,
            _ => '_',
        })
        .collect();
    if kept == name && !name.is_empty() && name.len() <= LONGEST {
        return kept;
    }
    let short: String = kept.chars().take(LONGEST / 4).collect();
    format!("{short}-{}", &hex(&Sha256::digest(name.as_bytes()))[..8])
}

/// Lower-case hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::new(), |mut s, b| {
        let _ = write!(s, "{b:02x}");
        s
    })
}

/// SHA-256 of a file's bytes, hexadecimal.
pub fn digest(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Name of this machine.
pub fn host_name() -> String {
    fs::read_to_string("/proc/sys/kernel/hostname")
        .ok()
        .or_else(|| std::env::var("HOSTNAME").ok())
        .or_else(|| std::env::var("COMPUTERNAME").ok())
        .map(|s| s.trim().to_string())
        .filter(|s| !s.is_empty())
        .unwrap_or_else(|| "unknown host".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_are_safe_and_distinct() {
        assert_eq!(file_name("nl_bookI_s3"), "nl_bookI_s3");
        assert_eq!(file_name("esm_ssd+gb_affine{max_iters=50}").len(), 30 + 9);
        for bad in ["", ".", "..", "a/b", "../x", ".hidden", "a b", &"x".repeat(300)] {
            let name = file_name(bad);
            assert!(
                !name.contains('/') && !name.starts_with('.') && !name.is_empty() && name.len() < 140,
                "{name}"
            );
        }
        assert_ne!(file_name("a/b"), file_name("a_b"));
        assert_ne!(file_name("a/b"), file_name("a:b"));
    }

    #[test]
    fn a_second_opener_learns_who_holds_the_lock() {
        let dir = tempfile::tempdir().unwrap();
        let held = RunDir::open(dir.path(), false).unwrap();
        match RunDir::open(dir.path(), false) {
            Err(RunError::Locked { holder, .. }) => {
                assert!(
                    holder.contains(&format!("pid {}", std::process::id())),
                    "{holder}"
                )
            }
            other => panic!("{other:?}"),
        }
        drop(held);
        assert!(RunDir::open(dir.path(), false).is_ok());
    }

    #[test]
    fn other_peoples_folders_are_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("thesis.tex"), "x").unwrap();
        assert!(matches!(
            RunDir::open(dir.path(), true),
            Err(RunError::NotARunDirectory(_))
        ));
        assert!(dir.path().join("thesis.tex").exists());
    }
}
