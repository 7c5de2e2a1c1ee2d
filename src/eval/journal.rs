//! The journal of a run directory: one JSON line per finished unit, the source of truth for resuming.
//!
//! Lines are appended as units finish (so a killed process loses nothing it reported) and made durable in groups,
//! because a sync costs milliseconds and a small unit does not. Later lines of the same key replace earlier ones.

use super::rundir::RunError;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Longest time a line waits for its sync.
const COMMIT_AFTER: Duration = Duration::from_secs(1);
/// Files that are synced at the same time.
const SYNCS: usize = 16;
/// Most lines that wait for one sync.
const COMMIT_UNITS: usize = 100;

/// How a unit ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EntryStatus {
    /// Every frame was tracked (well or badly).
    Ok,
    /// The unit has no result: see the reason.
    Failed,
}

/// Time a unit took. Never part of what must be reproducible.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UnitTime {
    /// Sum of the times of all updates, s.
    pub seconds: f64,
    /// Median time of an update, ms.
    pub ms_median: f64,
    /// 95th percentile of the times of the updates, ms.
    pub ms_p95: f64,
    /// Sum of the times to read, decode and filter the tracked frames, s.
    pub input_seconds: f64,
    /// Updates these figures are taken over.
    pub updates: usize,
    /// Worker threads of the run; only figures of one thread compare between machines.
    pub threads: usize,
    /// When the unit finished, UTC, RFC 3339.
    pub finished: String,
}

/// One finished unit: a tracker on a sequence from a start frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Hash of everything that can change the result.
    pub key: String,
    /// Id of the tracker.
    pub tracker: String,
    /// Data set of the sequence.
    pub dataset: String,
    /// Name of the sequence.
    pub sequence: String,
    /// Frame the tracker was started on.
    pub start: usize,
    /// Whether there is a result.
    pub status: EntryStatus,
    /// Why there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Rows of the frame log.
    pub frames: usize,
    /// SHA-256 of the frame log, so that a log that was torn, edited or replaced is not taken for this result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log: Option<String>,
    /// `[al, mcd, cl, jaccard]` per scored frame, kept here when no frame logs are written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub errors: Option<Vec<Option<[f64; 4]>>>,
    /// Error over the dense grid of each frame that has such truth (`null` without output), likewise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub grid: Vec<Option<f64>>,
    /// Speed figures.
    pub time: UnitTime,
}

/// What a journal file holds.
#[derive(Debug, Default)]
pub struct Journal {
    /// Last entry of each key.
    pub entries: HashMap<String, Entry>,
    /// Complete lines that could not be understood; their units run again.
    pub damaged: usize,
}

impl Journal {
    /// Reads the journal at `path`; a missing file is an empty journal and a torn last line is ignored.
    ///
    /// # Errors
    /// The file exists and cannot be read.
    pub fn read(path: &Path) -> Result<Journal, RunError> {
        let mut bytes = Vec::new();
        match File::open(path) {
            Ok(mut file) => file.read_to_end(&mut bytes).map_err(|e| RunError::io(path, e))?,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Journal::default()),
            Err(e) => return Err(RunError::io(path, e)),
        };
        let whole = bytes.iter().rposition(|&b| b == b'\n').map_or(0, |at| at + 1);
        let mut journal = Journal::default();
        for line in bytes[..whole].split(|&b| b == b'\n').filter(|l| !l.is_empty()) {
            match serde_json::from_slice::<Entry>(line) {
                Ok(entry) => {
                    journal.entries.insert(entry.key.clone(), entry);
                }
                Err(_) => journal.damaged += 1,
            }
        }
        Ok(journal)
    }
}

/// A finished unit on its way to the journal, with the frame log that must be durable before its line is.
#[derive(Debug)]
pub struct Finished {
    /// The line.
    pub entry: Entry,
    /// Its log, if one was written.
    pub log: Option<PathBuf>,
}

/// Appends to the journal of a run directory.
#[derive(Debug)]
pub struct JournalWriter {
    path: PathBuf,
    file: File,
    waiting: Vec<Option<PathBuf>>,
    oldest: Option<Instant>,
}

impl JournalWriter {
    /// Opens `path` for appending, cutting off a torn last line.
    ///
    /// # Errors
    /// The file cannot be opened or shortened.
    pub fn open(path: &Path) -> Result<JournalWriter, RunError> {
        let io = |e| RunError::io(path, e);
        let mut file = OpenOptions::new()
            .create(true)
            .read(true)
            .write(true)
            .truncate(false)
            .open(path)
            .map_err(io)?;
        let whole = whole_lines(&mut file).map_err(io)?;
        if whole < file.metadata().map_err(io)?.len() {
            file.set_len(whole).map_err(io)?;
        }
        file.seek(SeekFrom::Start(whole)).map_err(io)?;
        Ok(JournalWriter {
            path: path.to_path_buf(),
            file,
            waiting: Vec::new(),
            oldest: None,
        })
    }

    /// Writes one line; it is durable after the next [`commit`](Self::commit).
    ///
    /// # Errors
    /// The line cannot be written (disk full).
    pub fn append(&mut self, finished: &Finished) -> Result<(), RunError> {
        let mut line = serde_json::to_vec(&finished.entry).map_err(|e| RunError::io(&self.path, e.into()))?;
        line.push(b'\n');
        self.file
            .write_all(&line)
            .map_err(|e| RunError::io(&self.path, e))?;
        self.waiting.push(finished.log.clone());
        self.oldest.get_or_insert_with(Instant::now);
        if self.waiting.len() >= COMMIT_UNITS || self.until_commit().is_zero() {
            self.commit()?;
        }
        Ok(())
    }

    /// Makes the frame logs of all appended lines durable, then the lines.
    ///
    /// # Errors
    /// The journal cannot be synced.
    pub fn commit(&mut self) -> Result<(), RunError> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        let logs: Vec<PathBuf> = self.waiting.drain(..).flatten().collect();
        sync_all(&logs)?;
        self.oldest = None;
        self.file.sync_data().map_err(|e| RunError::io(&self.path, e))
    }

    fn until_commit(&self) -> Duration {
        self.oldest
            .map_or(COMMIT_AFTER, |t| COMMIT_AFTER.saturating_sub(t.elapsed()))
    }

    /// Appends what arrives, committing in groups, until every sender is gone.
    ///
    /// # Errors
    /// The first failure to write or sync.
    pub fn serve(mut self, finished: Receiver<Finished>) -> Result<(), RunError> {
        loop {
            match finished.recv_timeout(self.until_commit()) {
                Ok(unit) => self.append(&unit)?,
                Err(RecvTimeoutError::Timeout) => self.commit()?,
                Err(RecvTimeoutError::Disconnected) => return self.commit(),
            }
        }
    }
}

/// Makes files durable, many at a time: each sync waits for the disk, and those that wait together share its work.
fn sync_all(logs: &[PathBuf]) -> Result<(), RunError> {
    let sync = |log: &PathBuf| match File::open(log) {
        Ok(file) => file.sync_data().map_err(|e| RunError::io(log, e)),
        // A log that has gone since is found by its digest when the directory is next read.
        Err(_) => Ok(()),
    };
    std::thread::scope(|scope| {
        let share = logs.len().div_ceil(SYNCS).max(1);
        let parts: Vec<_> = logs
            .chunks(share)
            .map(|part| scope.spawn(move || part.iter().try_for_each(sync)))
            .collect();
        // A panic of the standard library is one here.
        parts
            .into_iter()
            .try_for_each(|part| part.join().unwrap_or_else(|p| std::panic::resume_unwind(p)))
    })
}

/// Length of the file up to and including its last newline.
fn whole_lines(file: &mut File) -> std::io::Result<u64> {
    const BLOCK: u64 = 1 << 16;
    let mut end = file.seek(SeekFrom::End(0))?;
    let mut block = Vec::new();
    while end > 0 {
        let begin = end.saturating_sub(BLOCK);
        block.resize((end - begin) as usize, 0);
        file.seek(SeekFrom::Start(begin))?;
        file.read_exact(&mut block)?;
        if let Some(at) = block.iter().rposition(|&b| b == b'\n') {
            return Ok(begin + at as u64 + 1);
        }
        end = begin;
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(key: &str, status: EntryStatus) -> Entry {
        Entry {
            key: key.into(),
            tracker: "esm/ssd/homography".into(),
            dataset: "d".into(),
            sequence: "s".into(),
            start: 0,
            status,
            reason: (status == EntryStatus::Failed).then(|| "because".into()),
            frames: 3,
            log: None,
            errors: Some(vec![Some([0.1, 0.2, 1.0 / 3.0, 1e-7]), None]),
            grid: vec![Some(0.25), None],
            time: UnitTime::default(),
        }
    }

    fn unit(key: &str, status: EntryStatus) -> Finished {
        Finished {
            entry: entry(key, status),
            log: None,
        }
    }

    #[test]
    fn a_torn_last_line_is_ignored_and_cut_off() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let mut writer = JournalWriter::open(&path).unwrap();
        writer.append(&unit("a", EntryStatus::Ok)).unwrap();
        writer.append(&unit("b", EntryStatus::Failed)).unwrap();
        drop(writer);
        let whole = std::fs::read(&path).unwrap();
        for cut in 1..whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let lines = whole[..cut].iter().filter(|&&b| b == b'\n').count();
            assert_eq!(Journal::read(&path).unwrap().entries.len(), lines);
            let mut writer = JournalWriter::open(&path).unwrap();
            writer.append(&unit("c", EntryStatus::Ok)).unwrap();
            drop(writer);
            let journal = Journal::read(&path).unwrap();
            assert_eq!((journal.entries.len(), journal.damaged), (lines + 1, 0));
        }
    }

    #[test]
    fn the_last_line_of_a_key_counts_and_numbers_come_back_exactly() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let mut writer = JournalWriter::open(&path).unwrap();
        writer.append(&unit("a", EntryStatus::Failed)).unwrap();
        writer.append(&unit("a", EntryStatus::Ok)).unwrap();
        writer.commit().unwrap();
        let journal = Journal::read(&path).unwrap();
        assert_eq!(journal.entries["a"], entry("a", EntryStatus::Ok));
    }

    #[test]
    fn a_missing_journal_is_empty_and_damaged_lines_are_counted() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        assert!(Journal::read(&path).unwrap().entries.is_empty());
        std::fs::write(&path, "{\"key\": 3}\nnot json\n").unwrap();
        assert_eq!(Journal::read(&path).unwrap().damaged, 2);
    }
}
