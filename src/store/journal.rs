//! The journal of a run directory: one JSON line per finished unit, the source of truth for resuming.
//!
//! Lines are appended as units finish (so a killed process loses nothing it reported) and made durable in groups,
//! because a sync costs milliseconds and a small unit does not. Later lines of the same key replace earlier ones.

use crate::files;
use crate::plan::UnitKey;
use crate::store::error::StoreError;
use crate::store::packed;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};
use twox_hash::XxHash64;

/// Longest time a line waits for its sync.
const COMMIT_AFTER: Duration = Duration::from_secs(1);
/// Most files that are synced at the same time: enough to share the disk's waits, few beside a limit of open files.
const SYNCS: usize = 4;
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

/// Time a unit took, rounded to 1e-9 s. Never part of what must be reproducible.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UnitTime {
    /// Time to start on the first frame, and to start anew, s.
    #[serde(default)]
    pub init_seconds: f64,
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
    pub key: UnitKey,
    /// Id of the tracker.
    pub tracker: String,
    /// Data set of the sequence.
    pub dataset: String,
    /// Name of the sequence.
    pub sequence: String,
    /// Frame the tracker was started on.
    pub start: u32,
    /// What happened to it after its start, where that is not one pass to the end: `reinit:20:5`, ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub course: Option<String>,
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
    /// Per evaluated frame the values of the metrics that every frame has, in the order of the run's (`[al, mcd, cl,
    /// jaccard]`; none without output), packed; kept here when no frame logs are written.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "packed")]
    pub errors: Option<packed::Rows>,
    /// Of each frame that has dense truth, one after the other: the values of the dense metrics (`null` without output),
    /// likewise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub grid: Vec<Option<f64>>,
    /// The build of the program that tracked it: see [`build`](crate::store::host::build).
    pub build: String,
    /// Speed figures.
    pub time: UnitTime,
}

/// What a journal file holds: an index of its lines, which are read when they are needed.
#[derive(Debug, Default)]
pub struct Journal {
    path: PathBuf,
    file: Option<Mutex<File>>,
    lines: HashMap<UnitKey, Line>,
    /// Complete lines that could not be understood; their units run again.
    pub damaged: usize,
}

/// Where the last line of a key is, and how its unit ended.
#[derive(Clone, Copy, Debug)]
struct Line {
    at: u64,
    len: u32,
    status: EntryStatus,
}

/// What the index needs of an [`Entry`].
#[derive(Deserialize)]
struct Head {
    key: UnitKey,
    status: EntryStatus,
}

/// How a line begins: the checksum of the rest of it.
const SUM: &str = "{\"sum\":\"";

/// The checksum of `rest`: XXH64, 16 hexadecimal digits.
fn sum(rest: &[u8]) -> String {
    format!("{:016x}", XxHash64::oneshot(0, rest))
}

impl Entry {
    /// Its line: a JSON object whose first field, `sum`, is the checksum of what follows it.
    ///
    /// # Errors
    /// None that its fields can cause.
    pub fn to_line(&self) -> serde_json::Result<Vec<u8>> {
        let entry = serde_json::to_vec(self)?;
        // Its opening brace is that of the line.
        let rest = entry.get(1..).unwrap_or_default();
        Ok([SUM.as_bytes(), sum(rest).as_bytes(), b"\",", rest, b"\n"].concat())
    }
}

/// What a line without its newline says; `None` when it is not to the bit what [`Entry::to_line`] wrote.
fn checked<T: DeserializeOwned>(line: &[u8]) -> Option<T> {
    let (found, rest) = line.strip_prefix(SUM.as_bytes())?.split_at_checked(16)?;
    let rest = rest.strip_prefix(b"\",")?;
    (found == sum(rest).as_bytes()).then_some(())?;
    serde_json::from_slice(line).ok()
}

/// Whether the file is the journal of a run: it has a whole line or none.
pub(crate) fn is_journal(path: &Path) -> bool {
    let Ok(file) = files::open(path) else {
        return false;
    };
    let mut reader = BufReader::new(file).take(1 << 26);
    let mut text = Vec::new();
    let mut lines = 0;
    while reader.read_until(b'\n', &mut text).is_ok_and(|n| n > 0) {
        if checked::<Head>(text.trim_ascii()).is_some() {
            return true;
        }
        lines += usize::from(text.ends_with(b"\n"));
        text.clear();
    }
    lines == 0
}

impl Journal {
    /// Reads the journal at `path`; a missing file is an empty journal and a torn last line is ignored.
    ///
    /// # Errors
    /// The file exists and cannot be read.
    pub fn read(path: &Path) -> Result<Journal, StoreError> {
        let io = |e| StoreError::io(path, e);
        let mut journal = Journal {
            path: path.to_path_buf(),
            ..Journal::default()
        };
        let file = match files::open(path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(journal),
            other => other.map_err(io)?,
        };
        let mut reader = BufReader::with_capacity(1 << 20, &file);
        let (mut at, mut text) = (0, Vec::new());
        while reader.read_until(b'\n', &mut text).map_err(io)? > 0 && text.ends_with(b"\n") {
            let line = text.trim_ascii();
            match checked::<Head>(line) {
                Some(Head { key, status }) => {
                    let len = line.len() as u32;
                    journal.lines.insert(key, Line { at, len, status });
                }
                None if line.is_empty() => {}
                None => journal.damaged += 1,
            }
            at += text.len() as u64;
            text.clear();
        }
        drop(reader);
        journal.file = Some(Mutex::new(file));
        Ok(journal)
    }

    /// Number of units that have a line.
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// No lines.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// How the unit ended, if it did.
    pub fn status(&self, key: &UnitKey) -> Option<EntryStatus> {
        self.lines.get(key).map(|line| line.status)
    }

    /// Last line of the unit.
    ///
    /// # Errors
    /// The file cannot be read, or the line is damaged where the index does not look.
    pub fn get(&self, key: &UnitKey) -> Result<Option<Entry>, StoreError> {
        let (Some(line), Some(file)) = (self.lines.get(key), &self.file) else {
            return Ok(None);
        };
        let mut text = vec![0; line.len as usize];
        let mut file = file.lock().unwrap_or_else(|e| e.into_inner());
        file.seek(SeekFrom::Start(line.at))
            .and_then(|_| file.read_exact(&mut text))
            .map_err(|e| StoreError::io(&self.path, e))?;
        drop(file);
        let damaged = || StoreError::Damaged {
            path: self.path.clone(),
            reason: format!("the line at byte {}", line.at),
        };
        checked(&text).map(Some).ok_or_else(damaged)
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
    pub fn open(path: &Path) -> Result<JournalWriter, StoreError> {
        let io = |e| StoreError::io(path, e);
        // What it leads to belongs to somebody else, and a pipe waits for ever.
        let known = path.symlink_metadata().map(|meta| meta.file_type());
        if let Some(what) = known.ok().and_then(files::irregular) {
            return Err(StoreError::Damaged {
                path: path.to_path_buf(),
                reason: format!("not a file but {what}"),
            });
        }
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
    pub fn append(&mut self, finished: &Finished) -> Result<(), StoreError> {
        let line = finished
            .entry
            .to_line()
            .map_err(|e| StoreError::io(&self.path, e.into()))?;
        self.file
            .write_all(&line)
            .map_err(|e| StoreError::io(&self.path, e))?;
        self.waiting.push(finished.log.clone());
        self.oldest.get_or_insert_with(Instant::now);
        if self.waiting.len() >= COMMIT_UNITS || self.until_commit().is_zero() {
            self.commit()?;
        }
        Ok(())
    }

    /// Writes many lines whose frame logs are durable already, or can be had again, and makes them durable together.
    ///
    /// # Errors
    /// The lines cannot be written or synced.
    pub fn extend(&mut self, entries: impl Iterator<Item = Entry>) -> Result<(), StoreError> {
        let io = |e| StoreError::io(&self.path, e);
        let mut out = BufWriter::with_capacity(1 << 20, &self.file);
        for entry in entries {
            let line = entry.to_line().map_err(|e| io(e.into()))?;
            out.write_all(&line).map_err(io)?;
        }
        out.flush().map_err(io)?;
        drop(out);
        self.file.sync_data().map_err(io)
    }

    /// Makes the frame logs of all appended lines durable, then the lines.
    ///
    /// # Errors
    /// The journal cannot be synced.
    pub fn commit(&mut self) -> Result<(), StoreError> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        let logs: Vec<PathBuf> = self.waiting.drain(..).flatten().collect();
        sync_all(&logs)?;
        self.oldest = None;
        self.file.sync_data().map_err(|e| StoreError::io(&self.path, e))
    }

    fn until_commit(&self) -> Duration {
        self.oldest
            .map_or(COMMIT_AFTER, |t| COMMIT_AFTER.saturating_sub(t.elapsed()))
    }

    /// Appends what arrives, committing in groups, until every sender is gone.
    ///
    /// # Errors
    /// The first failure to write or sync.
    pub fn serve(mut self, finished: Receiver<Finished>) -> Result<(), StoreError> {
        loop {
            match finished.recv_timeout(self.until_commit()) {
                Ok(unit) => self.append(&unit)?,
                Err(RecvTimeoutError::Timeout) => self.commit()?,
                Err(RecvTimeoutError::Disconnected) => return self.commit(),
            }
        }
    }
}

/// Makes files durable, several at a time: each sync waits for the disk, and those that wait together share its work.
fn sync_all(logs: &[PathBuf]) -> Result<(), StoreError> {
    let sync = |log: &PathBuf| match File::open(log) {
        Ok(file) => file.sync_data().map_err(|e| StoreError::io(log, e)),
        // A log that has gone since is found by its digest when the directory is next read.
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(StoreError::io(log, e)),
    };
    let next = AtomicUsize::new(0);
    let some = || {
        let take = || logs.get(next.fetch_add(1, Ordering::Relaxed));
        std::iter::from_fn(take).try_for_each(sync)
    };
    std::thread::scope(|scope| {
        // Threads that cannot be had leave more to the others and to this one.
        let helpers: Vec<_> = (1..SYNCS.min(logs.len()))
            .map_while(|_| std::thread::Builder::new().spawn_scoped(scope, some).ok())
            .collect();
        let mut result = some();
        for helper in helpers {
            // A panic of the standard library is one here.
            let done = helper.join().unwrap_or_else(|p| std::panic::resume_unwind(p));
            result = result.and(done);
        }
        result
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

    fn key(name: u8) -> UnitKey {
        UnitKey([name; 16])
    }

    fn entry(name: u8, status: EntryStatus) -> Entry {
        Entry {
            key: key(name),
            tracker: "esm/ssd/homography".into(),
            dataset: "d".into(),
            sequence: "s".into(),
            start: 0,
            course: None,
            status,
            reason: (status == EntryStatus::Failed).then(|| "because".into()),
            frames: 3,
            log: None,
            errors: Some(vec![Some(vec![0.1, 0.2, 1.0 / 3.0, 1e-6]), None]),
            grid: vec![Some(0.25), None],
            build: "b".into(),
            time: UnitTime::default(),
        }
    }

    fn unit(name: u8, status: EntryStatus) -> Finished {
        Finished {
            entry: entry(name, status),
            log: None,
        }
    }

    #[test]
    fn a_torn_last_line_is_ignored_and_cut_off() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let mut writer = JournalWriter::open(&path).unwrap();
        writer.append(&unit(b'a', EntryStatus::Ok)).unwrap();
        writer.append(&unit(b'b', EntryStatus::Failed)).unwrap();
        drop(writer);
        let whole = std::fs::read(&path).unwrap();
        for cut in 1..whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let lines = whole[..cut].iter().filter(|&&b| b == b'\n').count();
            assert_eq!(Journal::read(&path).unwrap().len(), lines);
            let mut writer = JournalWriter::open(&path).unwrap();
            writer.append(&unit(b'c', EntryStatus::Ok)).unwrap();
            drop(writer);
            let journal = Journal::read(&path).unwrap();
            assert_eq!((journal.len(), journal.damaged), (lines + 1, 0));
        }
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let mut writer = JournalWriter::open(&path).unwrap();
        writer.append(&unit(b'a', EntryStatus::Ok)).unwrap();
        drop(writer);
        let whole = std::fs::read(&path).unwrap();
        assert!(is_journal(&path));
        // The newline is another matter: without it the line is torn.
        for bit in 0..8 * (whole.len() - 1) {
            let mut bytes = whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            std::fs::write(&path, &bytes).unwrap();
            let journal = Journal::read(&path).unwrap();
            assert_eq!(journal.status(&key(b'a')), None, "bit {bit}");
            // A flip may make a newline, and two lines.
            assert!(journal.damaged > 0, "bit {bit}");
        }
    }

    #[test]
    fn the_last_line_of_a_key_counts_and_numbers_come_back_exactly() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let mut writer = JournalWriter::open(&path).unwrap();
        writer.append(&unit(b'a', EntryStatus::Failed)).unwrap();
        writer.append(&unit(b'a', EntryStatus::Ok)).unwrap();
        writer.commit().unwrap();
        let journal = Journal::read(&path).unwrap();
        assert_eq!(
            journal.get(&key(b'a')).unwrap(),
            Some(entry(b'a', EntryStatus::Ok))
        );
        assert_eq!(journal.status(&key(b'b')), None);
    }

    #[test]
    fn a_missing_journal_is_empty_and_damaged_lines_are_counted() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        assert!(Journal::read(&path).unwrap().is_empty());
        std::fs::write(&path, "{\"key\": 3}\nnot json\n").unwrap();
        assert_eq!(Journal::read(&path).unwrap().damaged, 2);
    }

    #[test]
    fn lines_are_made_durable_in_groups() {
        let dir = tempfile::tempdir().unwrap();
        let mut writer = JournalWriter::open(&dir.path().join("journal.jsonl")).unwrap();
        let unit = unit(b'a', EntryStatus::Ok);
        let begin = Instant::now();
        for waiting in 1..COMMIT_UNITS {
            writer.append(&unit).unwrap();
            // By their number, or because the first has waited long enough.
            assert!(
                writer.waiting.len() == waiting || begin.elapsed() > COMMIT_AFTER,
                "{waiting}"
            );
        }
        writer.append(&unit).unwrap();
        assert!(writer.waiting.is_empty() || begin.elapsed() > COMMIT_AFTER);
        writer.append(&unit).unwrap();
        writer.commit().unwrap();
        assert!(writer.waiting.is_empty() && writer.oldest.is_none());
    }
}
