//! How far a run directory is, whoever writes to it.

use crate::plan::{Shard, Sharding, Unit, UnitKeys};
use crate::store::error::StoreError;
use crate::store::journal::{EntryStatus, Journal};
use crate::store::lock::Holder;
use crate::store::rundir::RunDir;
use serde::Serialize;
use serde_json::Value;
use std::path::Path;
use std::time::Duration;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

/// Whether somebody works on a directory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Activity {
    /// Its process lives.
    Running,
    /// Its process is on another machine, and has not said that it ended.
    Elsewhere,
    /// Its process was killed.
    Dead,
    /// The last run ended in order.
    Idle,
}

/// State of a run directory.
#[derive(Clone, Debug, Serialize)]
pub struct Status {
    /// Whether somebody works on it.
    pub activity: Activity,
    /// Who holds it, or held it when killed.
    pub holder: Option<String>,
    /// The part of the plan that it is for.
    pub shard: Option<String>,
    /// Units it is for.
    pub units: usize,
    /// Those with a result.
    pub done: usize,
    /// Those that failed.
    pub failed: usize,
    /// Those without an end.
    pub missing: usize,
    /// Frames of all units.
    pub frames: u64,
    /// Frames of those that ended.
    pub frames_done: u64,
    /// When the last unit ended, UTC.
    pub last: Option<String>,
    /// Time that the rest will take at the pace of this run, s; only while it is running.
    pub left_seconds: Option<f64>,
    /// Units without an end: tracker, sequence and start.
    #[serde(skip)]
    pub missing_units: Vec<String>,
    /// Units that failed, and why.
    #[serde(skip)]
    pub failures: Vec<(String, String)>,
}

/// Reads the state of `path` without touching it.
///
/// # Errors
/// It is no run directory, or cannot be read.
pub fn status(path: &Path) -> Result<Status, StoreError> {
    let mut dir = RunDir::view(path);
    let (plan, host) = dir.plan()?;
    dir.lay_out(&plan);
    let keys = UnitKeys::new(&plan);
    let shard: Option<Shard> = host
        .get("shard")
        .and_then(Value::as_str)
        .and_then(|s| s.parse().ok());
    let sharding = shard.map(|s| (Sharding::new(&plan, s.cut, s.count), s.index));
    let mine = |unit: &Unit| {
        sharding
            .as_ref()
            .is_none_or(|(cut, index)| cut.of(unit) == *index)
    };
    let began = host.get("started").and_then(Value::as_str).unwrap_or_default();
    let holder = Holder::of(path);
    let activity = match holder.as_ref().map(|h| h.alive) {
        None => Activity::Idle,
        Some(Some(true)) => Activity::Running,
        Some(Some(false)) => Activity::Dead,
        Some(None) => Activity::Elsewhere,
    };
    let journal = Journal::read(&dir.journal())?;
    let mut status = Status {
        activity,
        holder: holder.map(|h| h.text),
        shard: shard.map(|s| s.to_string()),
        units: 0,
        done: 0,
        failed: 0,
        missing: 0,
        frames: 0,
        frames_done: 0,
        last: None,
        left_seconds: None,
        missing_units: Vec::new(),
        failures: Vec::new(),
    };
    let mut this_run = 0;
    for unit in plan.units().filter(mine) {
        let frames = plan.unit_frames(&unit);
        status.units += 1;
        status.frames += frames;
        let key = keys.of(&unit);
        match journal.status(&key) {
            None => status.missing_units.push(plan.describe(&unit)),
            Some(ended) => {
                status.frames_done += frames;
                status.done += usize::from(ended == EntryStatus::Ok);
                if let Some(entry) = journal.get(&key)? {
                    // RFC 3339 in UTC sorts as text.
                    if entry.time.finished.as_str() >= began {
                        this_run += frames;
                    }
                    if status
                        .last
                        .as_ref()
                        .is_none_or(|last| *last < entry.time.finished)
                    {
                        status.last = Some(entry.time.finished);
                    }
                    if let Some(reason) = entry.reason {
                        status.failures.push((plan.describe(&unit), reason));
                    }
                }
            }
        }
    }
    status.failed = status.failures.len();
    status.missing = status.missing_units.len();
    let elapsed = OffsetDateTime::parse(began, &Rfc3339)
        .ok()
        .and_then(|began| Duration::try_from(OffsetDateTime::now_utc() - began).ok());
    if let Some(elapsed) = elapsed.filter(|_| activity == Activity::Running && this_run > 0) {
        let left = status.frames - status.frames_done;
        status.left_seconds = Some(elapsed.as_secs_f64() * left as f64 / this_run as f64);
    }
    Ok(status)
}
