//! Joining the run directories of shards into one that equals an unsharded run's, or those of different runs into their union.
//!
//! Every directory of a shard records the whole plan, and they must agree about it; the plan of a union is [that of all its
//! runs](Plan::union). Each unit of the plan must have ended in one of the directories, with a frame log that is what the
//! journal says, and must not have ended differently in another.

use crate::metric::MetricSet;
use crate::plan::{Cut, Plan, PlanError, Shard, Sharding, Unit, UnitKeys};
use crate::report::Exporters;
use crate::run::error::RunError;
use crate::run::finish::{self, ResultSource};
use crate::run::observer::Observer;
use crate::run::pool::pool;
use crate::run::runner::{RunReport, one_build};
use crate::store::StoreError;
use crate::store::held::{Held, held};
use crate::store::journal::{Entry, Journal, JournalWriter};
use crate::store::lock::Holder;
use crate::store::rundir::{Recorded, RunDir};
use crate::store::truth::{self, KeptTruth};
use rayon::prelude::*;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// What to join, and where.
#[derive(Clone, Debug)]
pub struct MergeRequest {
    /// The run directories of the shards, in any order.
    pub parts: Vec<PathBuf>,
    /// The run directory to be made; what it holds already counts as a part.
    pub out: PathBuf,
    /// The directories are of different trackers, sequences or protocols rather than shards of one run.
    pub union: bool,
    /// Discard what it holds.
    pub force: bool,
    /// Join results of different builds of the program.
    pub mix_builds: bool,
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
    /// Journals and frame logs that are damaged, gone or cannot be read: why a unit that has ended counts as missing.
    pub unusable: Vec<PathBuf>,
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
    let mut sources = distinct(&request.parts);
    let is_out = |part: &PathBuf| resolved(part) == resolved(&request.out);
    let within = |part: &&PathBuf| resolved(part).starts_with(resolved(&request.out));
    if request.force
        && let Some(part) = sources.iter().find(within)
    {
        return Err(StoreError::Mismatch {
            path: request.out.clone(),
            reason: format!(
                "it is or holds the shard {}, which --force would discard; leave --force out, or choose another directory",
                part.display()
            ),
        }
        .into());
    }
    sources.retain(|part| !is_out(part));
    if !request.force && request.out.join("run.json").exists() {
        // First, so that what it holds stays as it is.
        sources.insert(0, request.out.clone());
    }
    let mut described: Vec<(PathBuf, Recorded)> = Vec::new();
    let mut union: Option<Plan> = None;
    let mut parts = Vec::new();
    let mut cuts = BTreeSet::new();
    for path in &sources {
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
        let recorded = dir.recorded()?;
        // The parts of a union are cut each by its own plan.
        let cut = recorded.shard().filter(|_| !request.union);
        cuts.extend(cut.map(|shard| (shard.cut, shard.count)));
        dir.lay_out(&recorded.plan);
        let journal = Journal::read(&dir.journal())?;
        if journal.damaged > 0 {
            observer.warn(&format!(
                "{}: {} damaged lines, their units count as missing",
                dir.journal().display(),
                journal.damaged
            ));
        }
        parts.push(Part { dir, journal });
        let other = |reason: String| StoreError::Mismatch {
            path: path.clone(),
            reason,
        };
        match (described.first(), &union) {
            (None, _) => union = Some(recorded.plan.clone()),
            (Some(_), Some(plan)) if request.union => {
                let joined = plan.union(&recorded.plan);
                let against = "(against the directories before it)";
                union = Some(joined.map_err(|difference| other(format!("{difference} {against}")))?);
            }
            (Some((known_path, known)), _) => {
                let truth = (known.truth != recorded.truth).then(|| "other ground truth than".to_owned());
                let difference = known.plan.difference(&recorded.plan).map(|d| format!("{d} in"));
                if let Some(difference) = difference.or(truth) {
                    let reason = format!("{difference} {}", known_path.display());
                    return Err(other(reason).into());
                }
            }
        }
        described.push((path.clone(), recorded));
    }
    let (Some(plan), Some((first, _))) = (union, described.first()) else {
        return Err(PlanError::Nothing("no run directory").into());
    };
    if plan.metrics != request.metrics.added_names() {
        return Err(StoreError::Mismatch {
            path: first.clone(),
            reason: "it was run with other metrics".into(),
        }
        .into());
    }
    let keys = UnitKeys::new(&plan);
    let units: Vec<Unit> = plan.units().collect();
    let pool = pool(request.threads, &|text| observer.warn(text))?;
    let chosen: Vec<Choice> = pool.install(|| {
        let choose = |unit: &Unit| choose(&parts, &plan, &keys, unit);
        units.par_iter().map(choose).collect::<Result<_, _>>()
    })?;
    let absent = units
        .iter()
        .zip(&chosen)
        .filter(|(_, choice)| choice.part.is_none());
    let absent: Vec<Unit> = absent.map(|(unit, _)| *unit).collect();
    if !absent.is_empty() {
        let mut missing = missing(&plan, &absent, &cuts);
        missing.unusable = chosen
            .iter()
            .filter_map(|choice| choice.unusable.clone())
            .collect();
        return Ok(Merged::Incomplete(missing));
    }
    let builds = chosen.iter().filter_map(|choice| choice.build.clone()).collect();
    one_build(&request.out, &builds, request.mix_builds)?;

    // Shards have the same.
    let tellers = if request.union { described.len() } else { 1 };
    let truth = truth_of(&plan, &described[..tellers])?;
    let files: Vec<&str> = request.exporters.files().collect();
    // What the directory held is discarded last: everything is there first, in a folder beside it that is this merge's own.
    let aside = match request.force && request.out.exists() {
        true => {
            // Refuses what is no run directory, or is being written to.
            drop(RunDir::open(&request.out, false, &files)?);
            Some(beside(&request.out)?)
        }
        false => None,
    };
    let place = aside.as_ref().map_or(request.out.as_path(), TempDir::path);
    let (mut dir, _) = RunDir::open(place, request.force, &files)?;
    dir.lay_out(&plan);
    let mut host = finish::host(pool.current_num_threads());
    host.insert("merged".into(), request.parts.len().into());
    host.extend(request.host.clone());
    dir.discard_results(&files)?;
    let recorded = finish::describe(&dir, &plan, &units, &truth, host)?;
    let elsewhere: Vec<(&Unit, &Part)> = units
        .iter()
        .zip(&chosen)
        .filter_map(|(unit, choice)| Some((unit, &parts[choice.part?])))
        .filter(|(_, part)| aside.is_some() || part.dir.path() != request.out)
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
        truth: &truth,
        journal: &journal,
    };
    let (results, speeds, failed) = source.finish(&request.exporters, &units, &pool)?;
    finish::seal(&dir, recorded, &request.exporters)?;
    drop(dir);
    if let Some(aside) = &aside {
        let (old, _) = RunDir::open(&request.out, true, &files)?;
        take_in(aside.path(), &old)?;
    }
    Ok(Merged::Complete(Box::new(RunReport {
        path: request.out.clone(),
        results,
        speeds,
        units: units.len(),
        resumed: units.len() - elsewhere.len(),
        failed,
        data: plan.data.clone(),
        profile: None,
    })))
}

/// The ground truth of the plan's sequences, each as one of the directories has it.
fn truth_of(plan: &Plan, described: &[(PathBuf, Recorded)]) -> Result<Vec<KeptTruth>, StoreError> {
    let mut known: BTreeMap<String, KeptTruth> = BTreeMap::new();
    for (path, recorded) in described {
        let sequences = &recorded.plan.sequences;
        let truth = truth::read(&path.join("truth.csv"), sequences, &recorded.truth)?;
        known.extend(sequences.iter().map(|s| s.id()).zip(truth));
    }
    let of_plan = plan
        .sequences
        .iter()
        .map(|s| known.remove(&s.id()).unwrap_or_default());
    Ok(of_plan.collect())
}

/// Each directory once, however often and by whatever path it is named.
fn distinct(parts: &[PathBuf]) -> Vec<PathBuf> {
    let mut seen = BTreeSet::new();
    let new = |part: &&PathBuf| seen.insert(resolved(part));
    parts.iter().filter(new).cloned().collect()
}

/// What `path` leads to, links resolved; itself where there is nothing.
fn resolved(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_path_buf())
}

/// A new folder beside `out`, removed when it is dropped.
fn beside(out: &Path) -> Result<TempDir, StoreError> {
    let folder = resolved(out);
    let folder = folder.parent().unwrap_or(&folder);
    tempfile::Builder::new()
        .prefix(".merge-")
        .tempdir_in(folder)
        .map_err(|e| StoreError::io(folder, e))
}

/// Moves all files of the directory `from` into the run directory `to`, which was emptied. The journal goes last: without
/// it, the merge is to be done again.
fn take_in(from: &Path, to: &RunDir) -> Result<(), StoreError> {
    let entries = fs::read_dir(from).map_err(|e| StoreError::io(from, e))?;
    let mut names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    names.retain(|name| name != ".lock");
    names.sort_by_key(|name| name == "journal.jsonl");
    for name in names {
        let (old, new) = (from.join(&name), to.path().join(&name));
        fs::rename(&old, &new).map_err(|e| StoreError::io(&new, e))?;
    }
    Ok(())
}

/// Where a unit's result is to come from.
#[derive(Default)]
struct Choice {
    /// The part that has the result, else one where the unit failed, else none.
    part: Option<usize>,
    /// The build that made it.
    build: Option<String>,
    /// A file that kept a part from being taken.
    unusable: Option<PathBuf>,
}

/// The part that has the unit's result, which must not differ between parts.
fn choose(parts: &[Part], plan: &Plan, keys: &UnitKeys, unit: &Unit) -> Result<Choice, StoreError> {
    let key = keys.of(unit);
    let mut best: Option<(usize, Box<Entry>)> = None;
    let mut choice = Choice::default();
    for (index, part) in parts.iter().enumerate() {
        match held(&part.dir, plan, unit, &part.journal, &key) {
            Held::Nothing => {}
            Held::Unusable(path) => choice.unusable = Some(path),
            Held::Failed(_) => choice.part = choice.part.or(Some(index)),
            Held::Result(entry) => match &best {
                None => best = Some((index, entry)),
                Some((_, known)) => {
                    if (&known.log, &known.errors, &known.grid) != (&entry.log, &entry.errors, &entry.grid) {
                        return Err(StoreError::Mismatch {
                            path: part.dir.path().to_path_buf(),
                            reason: format!("another result of {}", plan.describe(unit)),
                        });
                    }
                }
            },
        }
    }
    if let Some((index, entry)) = best {
        choice.part = Some(index);
        choice.build = Some(entry.build);
    }
    Ok(choice)
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
        unusable: Vec::new(),
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
