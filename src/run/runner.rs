//! A run from request to result files: lock, plan, resume, track, aggregate.

use crate::metric::Results;
use crate::plan::{DataNotes, Plan, RunRequest, Sharding, Unit, UnitKeys, spread};
use crate::report::Exporters;
use crate::run::error::RunError;
use crate::run::finish::{self, ResultSource};
use crate::run::observer::{Observer, Work};
use crate::run::pool::pool;
use crate::run::profile::{Profile, Spent};
use crate::run::schedule::{Context, Pace, groups, groups_at_once, run_units};
use crate::run::watch::Watch;
use crate::store::StoreError;
use crate::store::held::{Held, held};
use crate::store::host::build;
use crate::store::journal::{EntryStatus, Journal, JournalWriter};
use crate::store::rundir::{Recorded, RunDir};
use crate::store::truth;
use rayon::prelude::*;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, mpsc};
use std::time::Instant;

/// Units that may wait for the journal before trackers do.
const JOURNAL_QUEUE: usize = 1024;

/// What a finished run has to tell.
#[derive(Clone, Debug)]
pub struct RunReport {
    /// The run directory.
    pub path: PathBuf,
    /// The aggregated figures, as written.
    pub results: Results,
    /// Frames per second of update time of each tracker, by id; they differ from run to run.
    pub speeds: BTreeMap<String, f64>,
    /// Units requested.
    pub units: usize,
    /// Of those, units that an earlier run had done.
    pub resumed: usize,
    /// Units without a result: `tracker on dataset/sequence`, and why.
    pub failed: Vec<(String, String)>,
    /// Data that was not read as it stands.
    pub data: DataNotes,
    /// Where the time went; `None` when an earlier run had done everything.
    pub profile: Option<Profile>,
}

/// Tracks everything in `request` that its directory does not hold yet and writes the result files of `exporters`.
///
/// `stop` may be set at any time (by a signal handler, say): the run then ends what is in progress, as far as the
/// request's grace allows, and returns [`RunError::Interrupted`]; the same request goes on from there.
///
/// # Errors
/// See [`RunError`]. Failures of single trackers or sequences are no errors but part of the report.
pub fn run(
    request: &RunRequest,
    exporters: &Exporters,
    observer: &dyn Observer,
    stop: &AtomicBool,
) -> Result<RunReport, RunError> {
    let prepared = request.prepare()?;
    let plan = &prepared.plan;
    let keys = UnitKeys::new(plan);
    let mut units: Vec<Unit> = match request.shard {
        None => plan.units().collect(),
        Some(shard) => {
            let sharding = Sharding::new(plan, shard.cut, shard.count);
            plan.units()
                .filter(|unit| sharding.of(unit) == shard.index)
                .collect()
        }
    };
    units.shrink_to_fit();
    let pool = pool(request.threads, &|text| observer.warn(text))?;
    let threads = pool.current_num_threads();
    let files: Vec<&str> = exporters.files().collect();
    let (mut dir, dead) = RunDir::open(&request.out, request.force, &files)?;
    dir.lay_out(plan);
    if let Some(dead) = dead {
        observer.warn(&format!(
            "an earlier run of this directory was killed ({})",
            dead.text
        ));
    }
    let writer = JournalWriter::open(&dir.journal())?;
    let journal = Journal::read(&dir.journal())?;
    if journal.damaged > 0 {
        let path = dir.journal();
        observer.warn(&format!(
            "{}: {} damaged lines ignored",
            path.display(),
            journal.damaged
        ));
    }
    let last = match earlier(&dir, plan, journal.is_empty(), observer) {
        Ok(earlier) => Last::of(earlier.as_ref()),
        Err(error) => return Err(error.into()),
    };
    let truth = truth::of(&prepared);
    let mut done = Vec::new();
    let mut builds = BTreeSet::new();
    let found: Vec<Option<String>> = pool.install(|| {
        let found = |unit: &Unit| match held(&dir, plan, unit, &journal, &keys.of(unit)) {
            Held::Result(entry) => Some(entry.build),
            _ => None,
        };
        units.par_iter().map(found).collect()
    });
    for build in found {
        done.push(build.is_some());
        builds.extend(build);
    }
    builds.insert(build().to_owned());
    one_build(&request.out, &builds, request.mix_builds)?;
    let mut host = finish::host(threads);
    host.insert("shard".into(), request.shard.map(|s| s.to_string()).into());
    host.insert("held".into(), done.iter().filter(|done| **done).count().into());
    host.extend(request.host.clone());
    if done.contains(&false) {
        dir.discard_results(&files)?;
    }
    let recorded = finish::describe(&dir, plan, &units, &truth, host)?;

    let mut pending: Vec<Unit> = units
        .iter()
        .zip(&done)
        .filter(|(_, done)| !**done)
        .map(|(unit, _)| *unit)
        .collect();
    let resumed = units.len() - pending.len();
    let mut profile = None;
    if !pending.is_empty() {
        // Trackers of all kinds from the first: what is done says what the rest costs.
        pending.sort_by_key(|unit| {
            let tracker = spread(u64::from(unit.tracker));
            (unit.sequence, tracker, unit.course, unit.start)
        });
        observer.begin(&Work {
            plan,
            units: units.len(),
            pending: &pending,
        });
        let groups: Vec<&[Unit]> = pending
            .chunk_by(|a, b| a.sequence == b.sequence)
            .flat_map(|units| groups(units, threads))
            .collect();
        let largest = groups.iter().map(|group| group.len()).max().unwrap_or(0);
        let (journal, finished) = mpsc::sync_channel(JOURNAL_QUEUE);
        let context = Context {
            request,
            prepared: &prepared,
            keys: &keys,
            dir: &dir,
            observer,
            stop,
            stopped: OnceLock::new(),
            broken: AtomicBool::new(false),
            error: Mutex::new(None),
            pace: Pace::new(request.hurry || last.stopped, last.held == Some(resumed), threads),
            // Few units in progress end sooner than many.
            at_once: match request.hurry || last.held == Some(resumed) {
                true => 1,
                false => groups_at_once(threads, largest, groups.len()),
            },
            pool: &pool,
            spent: Spent::default(),
            watch: Watch::default(),
        };
        let begin = Instant::now();
        std::thread::scope(|scope| {
            let context = &context;
            let drive = move || {
                let _closing = context.watch.closing();
                run_units(context, journal, groups);
            };
            match std::thread::Builder::new().spawn_scoped(scope, drive) {
                Ok(_) => {
                    // Where no more threads can be had, what takes too long is ended between frames.
                    let watch = || context.watch.serve(|| context.halted());
                    let _ = std::thread::Builder::new().spawn_scoped(scope, watch);
                    writer
                        .serve(finished)
                        .unwrap_or_else(|error| context.fail(error.into()))
                }
                Err(error) => context.fail(RunError::Threads(error)),
            }
        });
        observer.end();
        profile = Some(context.spent.profile(begin.elapsed().as_secs_f64(), threads));
        if let Some(error) = context.error.into_inner().unwrap_or_else(|e| e.into_inner()) {
            return Err(error);
        }
    }

    let journal = Journal::read(&dir.journal())?;
    let ended = units.iter().map(|unit| journal.status(&keys.of(unit)));
    let (done, ended) = ended.flatten().fold((0, 0), |(done, ended), status| {
        (done + usize::from(status == EntryStatus::Ok), ended + 1)
    });
    if stop.load(Ordering::Relaxed) && ended < units.len() {
        return Err(RunError::Interrupted {
            path: dir.path().to_path_buf(),
            done,
            total: units.len(),
        });
    }
    let source = ResultSource {
        dir: &dir,
        plan,
        keys: &keys,
        metrics: &request.metrics,
        truth: &truth,
        journal: &journal,
    };
    let (results, speeds, failed) = source.finish(exporters, &units, &pool)?;
    finish::seal(&dir, recorded, exporters)?;
    Ok(RunReport {
        path: dir.path().to_path_buf(),
        results,
        speeds,
        units: units.len(),
        resumed,
        failed,
        data: plan.data.clone(),
        profile,
    })
}

/// The run before in the same directory, which `plan` must go on with unless it left nothing; warns of what is left out of
/// the tables, and of data that has changed in its place since.
///
/// # Errors
/// [`StoreError::OtherExperiment`] when results would be replaced by others; a description that cannot be read.
fn earlier(
    dir: &RunDir,
    plan: &Plan,
    nothing_done: bool,
    observer: &dyn Observer,
) -> Result<Option<Recorded>, StoreError> {
    let recorded = match dir.recorded() {
        Ok(recorded) => recorded,
        Err(StoreError::NoRun { .. }) if nothing_done => return Ok(None),
        Err(StoreError::NoRun { .. }) if !dir.path().join("run.json").exists() => return Ok(None),
        Err(StoreError::NoRun { path, reason }) => {
            let differences = vec![reason];
            return Err(StoreError::OtherExperiment { path, differences });
        }
        Err(StoreError::Damaged { path, reason }) => {
            observer.warn(&format!("{}: damaged ({reason}), written anew", path.display()));
            return Ok(None);
        }
        Err(error) => return Err(error),
    };
    if nothing_done {
        return Ok(Some(recorded));
    }
    let differences = recorded.plan.departures(plan);
    if !differences.is_empty() {
        let path = dir.path().to_path_buf();
        return Err(StoreError::OtherExperiment { path, differences });
    }
    if let [first, rest @ ..] = &recorded.plan.lacking(plan)[..] {
        let more = match rest.len() {
            0 => " is".to_owned(),
            n => format!(" and {n} more are"),
        };
        observer.warn(&format!(
            "{first}{more} not asked for and left out of the tables; the results stay in {}",
            dir.path().display()
        ));
    }
    for id in recorded.plan.changed(plan) {
        observer.warn(&format!(
            "{id}: its frames or ground truth have changed since the last run in {}; it is tracked again",
            dir.path().display()
        ));
    }
    Ok(Some(recorded))
}

/// What the run before in the same directory left.
#[derive(Default)]
struct Last {
    /// It did not get to its end.
    stopped: bool,
    /// Results that it had when it began.
    held: Option<usize>,
}

impl Last {
    fn of(earlier: Option<&Recorded>) -> Last {
        let Some(recorded) = earlier else {
            return Last::default();
        };
        let held = recorded.host.get("held").and_then(Value::as_u64);
        Last {
            stopped: true,
            held: held.map(|n| n as usize),
        }
    }
}

/// Checks that one build of the program made all results, unless they may be mixed.
pub(crate) fn one_build(path: &Path, builds: &BTreeSet<String>, mix: bool) -> Result<(), StoreError> {
    if builds.len() < 2 || mix {
        return Ok(());
    }
    let builds: Vec<&str> = builds.iter().map(String::as_str).collect();
    Err(StoreError::OtherBuild {
        path: path.to_path_buf(),
        builds: builds.join(", "),
    })
}
