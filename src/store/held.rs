//! What a run directory holds, compared with its plan: which units have a result, and whether the result files are of them.

use crate::files::{self, Kind};
use crate::metric::MetricSet;
use crate::plan::{DataNotes, FrameLogs, Plan, Unit, UnitKey, UnitKeys};
use crate::store::StoreError;
use crate::store::journal::{Entry, EntryStatus, Journal};
use crate::store::rundir::{RunDir, digest};
use crate::store::summary::{self, Summary};
use std::collections::BTreeMap;
use std::hash::Hasher;
use std::io;
use std::path::{Path, PathBuf};
use twox_hash::XxHash64;

/// What a directory has of a unit.
#[derive(Clone, Debug)]
pub enum Held {
    /// No line in the journal.
    Nothing,
    /// The unit failed.
    Failed(Box<Entry>),
    /// A result, whose frame log (if it has one) is what the journal says.
    Result(Box<Entry>),
    /// A result that cannot be used: a damaged line, or the frame log of this path is missing, unreadable or another.
    Unusable(PathBuf),
}

/// What `dir` has of the unit of `plan` with the key `key`.
pub fn held(dir: &RunDir, plan: &Plan, unit: &Unit, journal: &Journal, key: &UnitKey) -> Held {
    let entry = match journal.get(key) {
        Ok(Some(entry)) => Box::new(entry),
        Ok(None) => return Held::Nothing,
        Err(_) => return Held::Unusable(dir.journal()),
    };
    if entry.status == EntryStatus::Failed {
        return Held::Failed(entry);
    }
    match &entry.log {
        Some(log) => {
            let path = dir.log(plan, unit);
            match files::read(&path, Kind::RESULTS).is_ok_and(|bytes| digest(&bytes) == *log) {
                true => Held::Result(entry),
                false => Held::Unusable(path),
            }
        }
        None if plan.frame_logs == FrameLogs::None && entry.errors.is_some() => Held::Result(entry),
        // A result that was kept otherwise than this run keeps them.
        None => Held::Nothing,
    }
}

/// Checksum over how the units ended, in the order of the plan: what result files are made from, apart from the truth.
/// `None` when one has not.
///
/// # Errors
/// The journal cannot be read.
pub fn ended_as(journal: &Journal, keys: &UnitKeys, units: &[Unit]) -> Result<Option<String>, StoreError> {
    let mut sum = Endings::default();
    for unit in units {
        let key = keys.of(unit);
        match journal.get(&key)? {
            Some(entry) => sum.add(ending(&entry)),
            None => return Ok(None),
        }
    }
    Ok(Some(sum.finish()))
}

/// Checksum of how a unit ended. Its time and build do not count.
pub(crate) fn ending(entry: &Entry) -> u64 {
    let result = (
        &entry.key,
        &entry.status,
        &entry.reason,
        &entry.log,
        &entry.errors,
        &entry.grid,
    );
    // Strings and numbers always serialise.
    XxHash64::oneshot(0, &serde_json::to_vec(&result).unwrap_or_default())
}

/// The checksum of [`ended_as`], unit by unit.
#[derive(Default)]
pub(crate) struct Endings(XxHash64);

impl Endings {
    /// The next unit, by its [`ending`].
    pub fn add(&mut self, ending: u64) {
        self.0.write(&ending.to_le_bytes());
    }

    /// 16 hexadecimal digits.
    pub fn finish(self) -> String {
        format!("{:016x}", self.0.finish())
    }
}

/// The results of a run that has got to its end.
#[derive(Clone, Debug)]
pub struct Finished {
    /// Its `summary.json`.
    pub summary: Summary,
    /// There is a description and a journal to compare it with; else it stands alone.
    pub whole: bool,
    /// Data that was not read as it stands.
    pub data: DataNotes,
    /// Fingerprint of the data of each sequence, by `dataset/sequence`.
    pub fingerprints: BTreeMap<String, String>,
}

/// Reads the results in the directory `path` as a run of `metrics`, and compares them with what else the directory holds.
///
/// # Errors
/// There are none; [`StoreError::Incomplete`] when units of the run have not ended; [`StoreError::Stale`] when the results
/// are of other units than the journal holds; [`StoreError::Damaged`] when a line or a frame log is.
pub fn finished(path: &Path, metrics: &MetricSet) -> Result<Finished, StoreError> {
    let mut dir = RunDir::view(path);
    let there = |name: &str| path.join(name).exists();
    if !there("run.json") && !there("journal.jsonl") {
        if !there(summary::FILE) {
            return Err(StoreError::NoRun {
                path: path.to_path_buf(),
                reason: format!("it has neither run.json nor {}", summary::FILE),
            });
        }
        let summary = summary::read(path, metrics)?;
        return Ok(Finished {
            summary,
            whole: false,
            data: DataNotes::default(),
            fingerprints: BTreeMap::new(),
        });
    }
    let recorded = dir.recorded()?;
    dir.lay_out(&recorded.plan);
    let journal = Journal::read(&dir.journal())?;
    let (keys, units) = (UnitKeys::new(&recorded.plan), recorded.units());
    let missing = units
        .iter()
        .filter(|unit| journal.status(&keys.of(unit)).is_none());
    let missing = missing.count();
    if missing > 0 {
        return Err(StoreError::Incomplete {
            path: path.to_path_buf(),
            units: units.len(),
            missing,
        });
    }
    let ended = ended_as(&journal, &keys, &units)?;
    let summary = match summary::read(path, metrics) {
        // The run ended, and was stopped before it wrote them.
        Err(summary::FileError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => {
            return Err(StoreError::Stale {
                path: path.join(summary::FILE),
            });
        }
        other => other?,
    };
    let file = path.join(summary::FILE);
    let Some(expected) = recorded
        .digest_of(summary::FILE)
        .filter(|_| summary.made_from == ended)
    else {
        return Err(StoreError::Stale { path: file });
    };
    if digest(&files::read(&file, Kind::RESULTS).map_err(|e| StoreError::io(&file, e))?) != expected {
        return Err(StoreError::Damaged {
            path: file,
            reason: "its checksum is not the one in run.json".into(),
        });
    }
    let Plan { data, sequences, .. } = recorded.plan;
    let fingerprints = sequences.into_iter().map(|s| (s.id(), s.fingerprint)).collect();
    Ok(Finished {
        summary,
        whole: true,
        data,
        fingerprints,
    })
}
