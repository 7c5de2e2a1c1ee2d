//! A run directory: its lock, its atomic writes, its file names, and frame logs.

use super::error::{FrameError, frame_error};
use crate::geom::Corners;
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
    #[error("{path}: {source}", path = .path.display())]
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

/// One row of a frame log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Corners in image pixels, rounded by [`round_corners`]; `None` when the tracker gave none or non-finite ones.
    pub corners: Option<Corners>,
    /// `init`, `converged`, `max_iters`, `ok`, or the word of a [`TrackError`](crate::tracker::TrackError).
    pub status: &'static str,
    /// Iterations used.
    pub iterations: u32,
    /// Similarity of the appearance model.
    pub similarity: f64,
}

/// Corners rounded to 1e-6 px, which six decimals hold exactly: a log scores the same as the run that wrote it.
/// `None` if one is not finite.
pub fn round_corners(corners: &Corners) -> Option<Corners> {
    let rounded = Corners(corners.0.map(|c| c.map(|v| (v * 1e6).round() / 1e6)));
    rounded.is_finite().then_some(rounded)
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

/// A frame log as CSV: `rows[k]` is frame `start + k` of the sequence, `name(i)` its file, `truth(i)` its ground truth.
///
/// Errors stand in a row only where they count: not on the first (initialisation), not without ground truth.
pub fn format_log<'a>(
    rows: &[Row],
    start: usize,
    name: impl Fn(usize) -> String,
    truth: impl Fn(usize) -> Option<Corners> + 'a,
) -> Vec<u8> {
    use std::fmt::Write as _;
    let mut out = String::with_capacity(160 * rows.len() + 80);
    out.push_str("frame,file,status,x1,y1,x2,y2,x3,y3,x4,y4,al,mcd,cl,jaccard,iterations,similarity\n");
    for (k, row) in rows.iter().enumerate() {
        let frame = start + k;
        let _ = write!(out, "{frame},{},{}", quoted(&name(frame)), row.status);
        match row.corners {
            Some(corners) => corners.to_array().iter().for_each(|v| {
                let _ = write!(out, ",{v:.6}");
            }),
            None => out.push_str(",,,,,,,,"),
        }
        match (row.corners, truth(frame)) {
            (Some(corners), Some(truth)) if k > 0 => {
                let e = frame_error(&corners, &truth);
                let _ = write!(out, ",{:.6},{:.6},{:.6},{:.6}", e.al, e.mcd, e.cl, e.jaccard);
            }
            _ => out.push_str(",,,,"),
        }
        // Single precision is what the images carry; a missing similarity is an empty field.
        let similarity = row.similarity as f32;
        let _ = match (similarity.is_finite(), similarity.abs()) {
            (false, _) => writeln!(out, ",{},", row.iterations),
            (true, 1e-4..1e9 | 0.0) => writeln!(out, ",{},{similarity}", row.iterations),
            (true, _) => writeln!(out, ",{},{similarity:e}", row.iterations),
        };
    }
    out.into_bytes()
}

fn quoted(field: &str) -> std::borrow::Cow<'_, str> {
    if field.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\"")).into()
    } else {
        field.into()
    }
}

/// Corners per frame of a log written by [`format_log`], and the frame of its first row.
///
/// # Errors
/// What is wrong with the text.
pub fn parse_log(bytes: &[u8]) -> Result<(usize, Vec<Option<Corners>>), String> {
    let mut reader = csv::ReaderBuilder::new().has_headers(true).from_reader(bytes);
    let headers = reader.byte_headers().map_err(|e| e.to_string())?;
    if headers.iter().nth(3) != Some(b"x1") || headers.iter().next() != Some(b"frame") {
        return Err("unknown columns".into());
    }
    let mut record = csv::StringRecord::new();
    let (mut start, mut corners) = (None, Vec::new());
    while reader.read_record(&mut record).map_err(|e| e.to_string())? {
        if start.is_none() {
            start = Some(
                record[0]
                    .parse()
                    .map_err(|_| format!("bad frame number {:?}", &record[0]))?,
            );
        }
        let mut values = [0.0; 8];
        let mut present = true;
        for (value, field) in values.iter_mut().zip(record.iter().skip(3)) {
            match field {
                "" => present = false,
                field => *value = field.parse().map_err(|_| format!("bad number {field:?}"))?,
            }
        }
        corners.push(present.then(|| Corners::from_array(values)));
    }
    start.map(|s| (s, corners)).ok_or_else(|| "no rows".into())
}

/// Errors of the scored frames of a log: those after the first with ground truth.
pub fn score_log(
    start: usize,
    corners: &[Option<Corners>],
    truth: impl Fn(usize) -> Option<Corners>,
) -> Vec<Option<FrameError>> {
    corners
        .iter()
        .enumerate()
        .skip(1)
        .filter_map(|(k, corners)| truth(start + k).map(|truth| corners.map(|c| frame_error(&c, &truth))))
        .collect()
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
    use proptest::prelude::*;

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

    proptest! {
        #[test]
        fn logs_come_back_exactly(values in prop::collection::vec(prop::array::uniform8(-1e5f64..1e5), 1..8), start in 0usize..5) {
            let rows: Vec<Row> = values
                .iter()
                .map(|v| Row {
                    corners: round_corners(&Corners::from_array(*v)),
                    status: "ok",
                    iterations: 3,
                    similarity: v[0],
                })
                .collect();
            let name = |i: usize| format!("frame,{i}.jpg");
            let truth = |i: usize| (i % 2 == 0).then(|| Corners::rect(0.0, 0.0, 9.0, 9.0));
            let (from, corners) = parse_log(&format_log(&rows, start, name, truth)).unwrap();
            prop_assert_eq!(from, start);
            for (row, read) in rows.iter().zip(&corners) {
                prop_assert_eq!(row.corners.unwrap().to_array().map(f64::to_bits), read.unwrap().to_array().map(f64::to_bits));
            }
        }
    }

    #[test]
    fn rows_without_corners_stay_empty_and_count_as_scored() {
        let row = |corners| Row {
            corners,
            status: "not_finite",
            iterations: 0,
            similarity: f64::NAN,
        };
        let here = Corners::rect(1.0, 2.0, 30.0, 40.0);
        let rows = [row(Some(here)), row(None), row(Some(here)), row(None)];
        let truth = |i: usize| (i != 3).then_some(here);
        let log = format_log(&rows, 0, |i| i.to_string(), truth);
        let (start, corners) = parse_log(&log).unwrap();
        let errors = score_log(start, &corners, truth);
        assert_eq!(errors.len(), 2);
        assert!(errors[0].is_none());
        assert_eq!(errors[1].unwrap().al, 0.0);
        assert!(round_corners(&Corners::rect(f64::NAN, 0.0, 1.0, 1.0)).is_none());
    }

    #[test]
    fn damaged_logs_are_told() {
        assert!(parse_log(b"").is_err());
        assert!(parse_log(b"a,b,c\n1,2,3\n").is_err());
        let good = format_log(
            &[Row {
                corners: None,
                status: "ok",
                iterations: 0,
                similarity: 0.0,
            }],
            0,
            |_| "f".into(),
            |_| None,
        );
        assert!(parse_log(&good).is_ok());
        assert!(parse_log(&good[..good.len() - 12]).is_err());
    }
}
