//! Joining the run directories of shards into one that equals an unsharded run's.
//!
//! Every directory records the whole plan. They must agree about it; each unit of the plan must have ended in one of
//! them, with a frame log that is what the journal says, and must not have ended differently in another.

use crate::metric::MetricSet;
use crate::plan::{Cut, Plan, PlanError, Shard, Sharding, Unit, UnitKeys};
use crate::report::Exporters;
use crate::run::error::RunError;
use crate::run::finish::{self, ResultSource, is_done};
use crate::run::observer::Observer;
use crate::run::runner::{RunReport, pool};
use crate::store::StoreError;
use crate::store::journal::{Entry, EntryStatus, Journal, JournalWriter};
use crate::store::lock::Holder;
use crate::store::rundir::RunDir;
use crate::store::truth;
use rayon::prelude::*;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// What to join, and where.
#[derive(Clone, Debug)]
pub struct MergeRequest {
    /// The run directories of the shards, in any order.
    pub parts: Vec<PathBuf>,
    /// The run directory to be made; what it holds already counts as a part.
    pub out: PathBuf,
    /// Discard what it holds.
    pub force: bool,
    /// The metrics; those that the shards were run with.
    pub metrics: MetricSet,
    /// What to write.
    pub exporters: Exporters,
    /// Worker threads; 0 for one per core.
    pub threads: usize,
    /// What else `run.json` shall say about this very execution.
    pub host: Map<String, Value>,
}

/// Outcome of a merge.
#[derive(Debug)]
pub enum Merged {
    /// The directory is complete.
    Complete(Box<RunReport>),
    /// Units are missing; nothing was written.
    Incomplete(Missing),
}

/// What keeps a merge from being complete.
#[derive(Clone, Debug)]
pub struct Missing {
    /// Units of the plan.
    pub units: usize,
    /// Those without an end: tracker, sequence and start.
    pub missing: Vec<String>,
    /// The shards that they belong to, with the number of their missing units, where shards are what was run.
    pub shards: BTreeMap<String, usize>,
}

/// A directory to take units from.
struct Part {
    dir: RunDir,
    journal: Journal,
}

/// Joins `request.parts`.
///
/// # Errors
/// [`StoreError::Mismatch`] when directories are of different runs or disagree about a unit, [`StoreError::Locked`] when one
/// is being written to, and what reading and writing may meet.
pub fn merge(request: &MergeRequest, observer: &dyn Observer) -> Result<Merged, RunError> {
    let mut sources: Vec<&PathBuf> = request
        .parts
        .iter()
        .filter(|part| **part != request.out)
        .collect();
    if !request.force && request.out.join("run.json").exists() {
        // First, so that what it holds stays as it is.
        sources.insert(0, &request.out);
    }
    let mut first: Option<(Plan, PathBuf)> = None;
    let mut parts = Vec::new();
    let mut cuts = BTreeSet::new();
    for path in sources {
        if !path.join("run.json").exists() {
            // A job that never came to its start leaves nothing, or an empty folder.
            if path.exists()
                && fs::read_dir(path)
                    .map_err(|e| StoreError::io(path, e))?
                    .next()
                    .is_some()
            {
                return Err(StoreError::NoRun {
                    path: path.clone(),
                    reason: "no run.json".into(),
                }
                .into());
            }
            observer.warn(&format!("{}: nothing there", path.display()));
            continue;
        }
        if let Some(holder) = Holder::of(path).filter(|h| h.alive == Some(true)) {
            return Err(StoreError::Locked {
                path: path.clone(),
                holder: holder.text,
            }
            .into());
        }
        let mut dir = RunDir::view(path);
        let (plan, host) = dir.plan()?;
        if let Some(shard) = host
            .get("shard")
            .and_then(Value::as_str)
            .and_then(|s| s.parse::<Shard>().ok())
        {
            cuts.insert((shard.cut, shard.count));
        }
        dir.lay_out(&plan);
        let journal = Journal::read(&dir.journal())?;
        parts.push(Part { dir, journal });
        match &first {
            None => first = Some((plan, path.clone())),
            Some((known, known_path)) => {
                if let Some(difference) = known.difference(&plan) {
                    return Err(StoreError::Mismatch {
                        path: path.clone(),
                        reason: format!("{difference} in {}", known_path.display()),
                    }
                    .into());
                }
            }
        }
    }
    let Some((plan, first)) = first else {
        return Err(PlanError::Nothing("no run directory").into());
    };
    if plan.metrics != request.metrics.added_names() {
        return Err(StoreError::Mismatch {
            path: first,
            reason: "it was run with other metrics".into(),
        }
        .into());
    }
    let keys = UnitKeys::new(&plan);
    let units: Vec<Unit> = plan.units().collect();
    let pool = pool(request.threads)?;
    let chosen: Vec<Option<usize>> = pool.install(|| {
        let choose = |unit: &Unit| choose(&parts, &plan, &keys, unit);
        units.par_iter().map(choose).collect::<Result<_, _>>()
    })?;
    if chosen.iter().any(Option::is_none) {
        let absent = units.iter().zip(&chosen).filter(|(_, part)| part.is_none());
        let absent: Vec<Unit> = absent.map(|(unit, _)| *unit).collect();
        return Ok(Merged::Incomplete(missing(&plan, &absent, &cuts)));
    }

    let truth = truth::read(&first.join("truth.csv"), &plan.sequences)?;
    let files: Vec<&str> = request.exporters.files().collect();
    let (mut dir, _) = RunDir::open(&request.out, request.force, &files)?;
    dir.lay_out(&plan);
    let mut host = finish::host(pool.current_num_threads());
    host.insert("merged".into(), request.parts.len().into());
    host.extend(request.host.clone());
    finish::describe(&dir, &plan, &units, &truth, &host)?;
    let elsewhere: Vec<(&Unit, &Part)> = units
        .iter()
        .zip(&chosen)
        .filter_map(|(unit, part)| Some((unit, &parts[(*part)?])))
        .filter(|(_, part)| part.dir.path() != request.out)
        .collect();
    pool.install(|| {
        let copy = |&(unit, part): &(&Unit, &Part)| -> Result<(), StoreError> {
            if part
                .journal
                .get(&keys.of(unit))?
                .is_some_and(|entry| entry.log.is_some())
            {
                link(&part.dir.log(&plan, unit), &dir.log(&plan, unit))?;
            }
            Ok(())
        };
        elsewhere.par_iter().try_for_each(copy)
    })?;
    let entries = elsewhere
        .iter()
        .filter_map(|(unit, part)| part.journal.get(&keys.of(unit)).ok()?);
    JournalWriter::open(&dir.journal())?.extend(entries)?;
    let journal = Journal::read(&dir.journal())?;
    let source = ResultSource {
        dir: &dir,
        plan: &plan,
        keys: &keys,
        metrics: &request.metrics,
        exporters: &request.exporters,
        truth: &truth,
        journal: &journal,
    };
    let (results, failed) = source.finish(&units, &pool)?;
    Ok(Merged::Complete(Box::new(RunReport {
        path: request.out.clone(),
        results,
        units: units.len(),
        resumed: units.len() - elsewhere.len(),
        failed,
        profile: None,
    })))
}

/// The part that has the unit's result, else one where it failed, else none.
fn choose(parts: &[Part], plan: &Plan, keys: &UnitKeys, unit: &Unit) -> Result<Option<usize>, StoreError> {
    let key = keys.of(unit);
    let (mut best, mut failed): (Option<(usize, Entry)>, _) = (None, None);
    for (index, part) in parts.iter().enumerate() {
        match part.journal.status(&key) {
            Some(EntryStatus::Failed) => failed = failed.or(Some(index)),
            Some(EntryStatus::Ok) if is_done(&part.dir, plan, unit, &part.journal, &key) => {
                let Some(entry) = part.journal.get(&key)? else {
                    continue;
                };
                match &best {
                    None => best = Some((index, entry)),
                    Some((_, known)) => {
                        if (&known.log, &known.errors, &known.grid)
                            != (&entry.log, &entry.errors, &entry.grid)
                        {
                            return Err(StoreError::Mismatch {
                                path: part.dir.path().to_path_buf(),
                                reason: format!("another result of {}", plan.describe(unit)),
                            });
                        }
                    }
                }
            }
            _ => {}
        }
    }
    Ok(best.map(|(index, _)| index).or(failed))
}

fn missing(plan: &Plan, absent: &[Unit], cuts: &BTreeSet<(Cut, u32)>) -> Missing {
    let mut shards = BTreeMap::new();
    // Which shard a unit belongs to is only certain when all were cut alike.
    if let [(cut, count)] = cuts.iter().copied().collect::<Vec<_>>()[..] {
        let sharding = Sharding::new(plan, cut, count);
        for unit in absent {
            let shard = Shard {
                cut,
                index: sharding.of(unit),
                count,
            };
            *shards.entry(shard.to_string()).or_default() += 1;
        }
    }
    Missing {
        units: plan.len(),
        missing: absent.iter().map(|unit| plan.describe(unit)).collect(),
        shards,
    }
}

/// Gives the file `from` the name `to` as well, or copies it where that cannot be.
fn link(from: &Path, to: &Path) -> Result<(), StoreError> {
    let attempt = || match fs::hard_link(from, to) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            to.parent().map_or(Ok(()), fs::create_dir_all)?;
            fs::hard_link(from, to)
        }
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {
            fs::remove_file(to)?;
            fs::hard_link(from, to)
        }
        other => other,
    };
    attempt()
        .or_else(|_| fs::copy(from, to).map(|_| ()))
        .map_err(|e| StoreError::io(to, e))
}
