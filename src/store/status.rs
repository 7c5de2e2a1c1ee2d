//! How far a run directory is, whoever writes to it.

use crate::plan::{DataNotes, Remaining, UnitKeys};
use crate::store::error::StoreError;
use crate::store::held::{Held, held};
use crate::store::journal::{EntryStatus, Journal};
use crate::store::lock::Holder;
use crate::store::rundir::RunDir;
use serde::Serialize;
use serde_json::Value;
use std::path::{Path, PathBuf};
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
    /// Those whose result cannot be used: a line of the journal or a frame log is damaged or gone. They will be tracked
    /// again, and count as missing; looked for only while nobody works on the directory.
    pub damaged: usize,
    /// Those without an end.
    pub missing: usize,
    /// Frames of all units.
    pub frames: u64,
    /// Frames of those that ended.
    pub frames_done: u64,
    /// When the last unit ended, UTC.
    pub last: Option<String>,
    /// Time that the rest will take by what trackers of its kinds have cost, s; only while it is running.
    pub left_seconds: Option<f64>,
    /// Units without an end: tracker, sequence and start.
    #[serde(skip)]
    pub missing_units: Vec<String>,
    /// Files that are damaged or gone.
    #[serde(skip)]
    pub unusable: Vec<PathBuf>,
    /// Files besides the journal and frame logs that are not as the run wrote them; looked for only while nobody works on the
    /// directory.
    pub altered: Vec<PathBuf>,
    /// Data that was not read as it stands.
    #[serde(flatten)]
    pub data: DataNotes,
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
    let recorded = dir.recorded()?;
    let plan = &recorded.plan;
    dir.lay_out(plan);
    let keys = UnitKeys::new(plan);
    let began = recorded
        .host
        .get("started")
        .and_then(Value::as_str)
        .unwrap_or_default();
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
        shard: recorded.shard().map(|s| s.to_string()),
        units: 0,
        done: 0,
        failed: 0,
        damaged: 0,
        missing: 0,
        frames: 0,
        frames_done: 0,
        last: None,
        left_seconds: None,
        missing_units: Vec::new(),
        unusable: Vec::new(),
        altered: match activity {
            Activity::Idle | Activity::Dead => dir.altered(&recorded),
            Activity::Running | Activity::Elsewhere => Vec::new(),
        },
        data: plan.data.clone(),
        failures: Vec::new(),
    };
    let units = recorded.units();
    let (mut remaining, mut this_run) = (Remaining::new(plan, &units), 0.0);
    for unit in units {
        let frames = plan.unit_frames(&unit);
        status.units += 1;
        status.frames += frames;
        let key = keys.of(&unit);
        // Logs are read only when they are to stay as they are.
        let entry = match activity {
            Activity::Idle | Activity::Dead => match held(&dir, plan, &unit, &journal, &key) {
                Held::Nothing => None,
                Held::Failed(entry) | Held::Result(entry) => Some(*entry),
                Held::Unusable(path) => {
                    status.damaged += 1;
                    status.unusable.push(path);
                    None
                }
            },
            Activity::Running | Activity::Elsewhere => journal.get(&key)?,
        };
        let Some(entry) = entry else {
            status.missing_units.push(plan.describe(&unit));
            continue;
        };
        status.frames_done += frames;
        status.done += usize::from(entry.status == EntryStatus::Ok);
        let seconds = entry.time.init_seconds + entry.time.seconds;
        remaining.add(unit.tracker, frames, seconds);
        // RFC 3339 in UTC sorts as text.
        if entry.time.finished.as_str() >= began {
            this_run += seconds;
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
    status.failed = status.failures.len();
    status.missing = status.missing_units.len();
    let elapsed = OffsetDateTime::parse(began, &Rfc3339)
        .ok()
        .and_then(|began| Duration::try_from(OffsetDateTime::now_utc() - began).ok());
    if let Some(elapsed) = elapsed.filter(|_| activity == Activity::Running && this_run > 0.0) {
        status.left_seconds = remaining
            .left()
            .map(|left| elapsed.as_secs_f64() * left / this_run);
    }
    Ok(status)
}
