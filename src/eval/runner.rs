//! A run from request to result files: lock, plan, resume, track, aggregate.
//!
//! The result files are always made from the journal and the frame logs on disk, never from memory, so that a run
//! that was interrupted any number of times ends with the same bytes as one that was not.

use super::aggregate::{Results, TrackerName, UnitResult, UnitStatus, aggregate_tracker};
use super::error::FrameError;
use super::framelog::{parse_log, score_log};
use super::journal::{Entry, EntryStatus, Journal, JournalWriter};
use super::lanes::{Context, lanes, run_units};
use super::plan::{FrameLogs, PROTOCOL, RunRequest, SCHEMA_VERSION, Unit};
use super::profile::{Profile, Spent};
use super::rundir::{RunDir, RunError, digest, host_name};
use crate::output::{self, Meta};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, mpsc};
use std::time::Instant;

/// Units that may wait for the journal before trackers do.
const JOURNAL_QUEUE: usize = 1024;

/// Watches a run. Called from many threads.
pub trait Observer: Sync {
    /// About to track: `pending` of `units` are left to do, `frames` tracker frames in all.
    fn begin(&self, units: usize, pending: usize, frames: u64) {
        let _ = (units, pending, frames);
    }
    /// `count` more tracker frames are done.
    fn frames(&self, count: u64) {
        let _ = count;
    }
    /// A unit has ended.
    fn unit(&self, entry: &Entry) {
        let _ = entry;
    }
    /// All units have ended, or the run stops early.
    fn end(&self) {}
    /// Something the user should know.
    fn warn(&self, message: &str) {
        let _ = message;
    }
}

/// Watches nothing.
#[derive(Clone, Copy, Debug)]
pub struct Silent;

impl Observer for Silent {}

/// What a finished run has to tell.
#[derive(Clone, Debug)]
pub struct RunReport {
    /// The run directory.
    pub path: PathBuf,
    /// The aggregated figures, as written.
    pub results: Results,
    /// Units requested.
    pub units: usize,
    /// Of those, units that an earlier run had done.
    pub resumed: usize,
    /// Units without a result: `tracker on dataset/sequence`, and why.
    pub failed: Vec<(String, String)>,
    /// Where the time went; `None` when an earlier run had done everything.
    pub profile: Option<Profile>,
}

/// Tracks everything in `request` that its directory does not hold yet and writes the result files.
///
/// `stop` may be set at any time (by a signal handler, say): the run then gives up what is in progress and returns
/// [`RunError::Interrupted`]; the same request goes on from there.
///
/// # Errors
/// See [`RunError`]. Failures of single trackers or sequences are no errors but part of the report.
pub fn run(request: &RunRequest, observer: &dyn Observer, stop: &AtomicBool) -> Result<RunReport, RunError> {
    let units = request.units()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(request.threads)
        .thread_name(|i| format!("worker {i}"))
        .build()
        .map_err(|e| RunError::Threads(e.to_string()))?;
    let threads = pool.current_num_threads();
    let dir = RunDir::open(&request.out, request.force)?;
    let writer = JournalWriter::open(&dir.journal())?;
    let journal = Journal::read(&dir.journal())?;
    if journal.damaged > 0 {
        observer.warn(&format!(
            "{}: {} damaged lines ignored",
            dir.journal().display(),
            journal.damaged
        ));
    }
    let done = pool.install(|| -> Vec<bool> {
        units
            .par_iter()
            .map(|unit| is_done(request, &dir, &journal.entries, unit))
            .collect()
    });
    write_descriptions(request, &dir, &units, threads)?;

    let mut pending: BTreeMap<usize, Vec<&Unit>> = BTreeMap::new();
    for (unit, _) in units.iter().zip(&done).filter(|(_, done)| !**done) {
        pending.entry(unit.sequence).or_default().push(unit);
    }
    let resumed = done.iter().filter(|&&done| done).count();
    let mut profile = None;
    if !pending.is_empty() {
        let per_sequence = pending.values().map(Vec::len).max().unwrap_or(0);
        let frames = |unit: &&Unit| (request.sequences[unit.sequence].len() - unit.start) as u64;
        observer.begin(
            units.len(),
            units.len() - resumed,
            pending.values().flatten().map(frames).sum(),
        );
        let (journal, finished) = mpsc::sync_channel(JOURNAL_QUEUE);
        let context = Context {
            request,
            dir: &dir,
            observer,
            stop,
            broken: AtomicBool::new(false),
            error: Mutex::new(None),
            lanes: lanes(threads, per_sequence, pending.len()),
            pool: &pool,
            spent: Spent::default(),
        };
        let begin = Instant::now();
        std::thread::scope(|scope| {
            let context = &context;
            scope.spawn(move || writer.serve(finished).unwrap_or_else(|error| context.fail(error)));
            run_units(context, journal, pending.into_values().collect());
        });
        observer.end();
        profile = Some(context.spent.profile(begin.elapsed().as_secs_f64(), threads));
        if let Some(error) = context.error.into_inner().unwrap_or_else(|e| e.into_inner()) {
            return Err(error);
        }
    }

    let journal = Journal::read(&dir.journal())?.entries;
    let ended = units
        .iter()
        .filter(|unit| journal.contains_key(&unit.key))
        .count();
    if stop.load(Ordering::Relaxed) && ended < units.len() {
        let done = |unit: &&Unit| {
            journal
                .get(&unit.key)
                .is_some_and(|e| e.status == EntryStatus::Ok)
        };
        return Err(RunError::Interrupted {
            done: units.iter().filter(done).count(),
            total: units.len(),
        });
    }
    // A tracker at a time, so that the errors of all frames of all trackers are never in memory together.
    let trackers: Vec<&[Unit]> = units.chunk_by(|a, b| a.tracker == b.tracker).collect();
    let parts: Vec<(Vec<&Entry>, Results)> = pool.install(|| {
        let load = |units: &&[Unit]| -> Result<_, RunError> {
            let loaded = units.iter().map(|unit| load_unit(request, &dir, &journal, unit));
            let loaded: Vec<(&Entry, UnitResult)> = loaded.collect::<Result<_, _>>()?;
            let results = aggregate_tracker(&loaded.iter().map(|(_, result)| result).collect::<Vec<_>>());
            Ok((loaded.into_iter().map(|(entry, _)| entry).collect(), results))
        };
        trackers.par_iter().map(load).collect::<Result<_, _>>()
    })?;
    let mut results = Results::default();
    let mut entries = Vec::new();
    for (part_entries, part) in parts {
        entries.extend(part_entries);
        results.extend(part);
    }
    write_timing(&dir, &entries)?;
    output::write_results(dir.path(), &results, &Meta::default())?;
    let failed = |entry: &&Entry| {
        let reason = entry.reason.clone()?;
        Some((
            format!("{} on {}/{}", entry.tracker, entry.dataset, entry.sequence),
            reason,
        ))
    };
    Ok(RunReport {
        path: dir.path().to_path_buf(),
        results,
        units: units.len(),
        resumed,
        failed: entries.iter().filter_map(failed).collect(),
        profile,
    })
}

/// Whether the directory holds the unit's result.
fn is_done(request: &RunRequest, dir: &RunDir, entries: &HashMap<String, Entry>, unit: &Unit) -> bool {
    let Some(entry) = entries.get(&unit.key).filter(|e| e.status == EntryStatus::Ok) else {
        return false;
    };
    match &entry.log {
        Some(log) => {
            let tracker = &request.trackers[unit.tracker];
            let path = dir.log(&tracker.slug, &entry.dataset, &entry.sequence, unit.start);
            fs::read(path).is_ok_and(|bytes| digest(&bytes) == *log)
        }
        None => request.frame_logs == FrameLogs::None && entry.errors.is_some(),
    }
}

/// The unit's result as it stands on disk.
fn load_unit<'a>(
    request: &RunRequest,
    dir: &RunDir,
    entries: &'a HashMap<String, Entry>,
    unit: &Unit,
) -> Result<(&'a Entry, UnitResult), RunError> {
    let damaged = |path: PathBuf, reason: &str| RunError::Damaged {
        path,
        reason: reason.into(),
    };
    let sequence = &request.sequences[unit.sequence];
    let tracker = &request.trackers[unit.tracker];
    let truth = |i: usize| {
        if i < sequence.len() {
            sequence.truth(i)
        } else {
            None
        }
    };
    let entry = entries
        .get(&unit.key)
        .ok_or_else(|| damaged(dir.journal(), &format!("no line for {}", tracker.name.id)))?;
    let scored = || {
        (unit.start + 1..sequence.len())
            .filter(|&i| truth(i).is_some())
            .count()
    };
    let dense = || {
        (unit.start + 1..sequence.len())
            .filter(|&i| sequence.grid(unit.start).is_some() && sequence.grid(i).is_some())
            .count()
    };
    let (errors, grid) = match (&entry.status, &entry.log, &entry.errors) {
        (EntryStatus::Failed, ..) => (vec![None; scored()], vec![f64::INFINITY; dense()]),
        (_, Some(_), _) => {
            let path = dir.log(&tracker.slug, sequence.dataset(), sequence.name(), unit.start);
            let bytes = fs::read(&path).map_err(|e| RunError::io(&path, e))?;
            let log = parse_log(&bytes).map_err(|reason| damaged(path, &reason))?;
            (score_log(log.start, &log.corners, truth), log.grid)
        }
        (_, None, Some(errors)) => {
            let error = |[al, mcd, cl, jaccard]: [f64; 4]| FrameError { al, mcd, cl, jaccard };
            let grid = entry.grid.iter().map(|e| e.unwrap_or(f64::INFINITY));
            (errors.iter().map(|e| e.map(error)).collect(), grid.collect())
        }
        (_, None, None) => return Err(damaged(dir.journal(), "a line has neither log nor errors")),
    };
    let status = match &entry.reason {
        Some(reason) => UnitStatus::Failed(reason.clone()),
        None => UnitStatus::Ok,
    };
    let result = UnitResult {
        tracker: tracker.name.clone(),
        dataset: sequence.dataset().to_string(),
        sequence: sequence.name().to_string(),
        start: unit.start,
        protocol: PROTOCOL.to_string(),
        status,
        errors,
        grid,
    };
    Ok((entry, result))
}

/// Writes `run.json` and each tracker's `tracker.json`.
fn write_descriptions(
    request: &RunRequest,
    dir: &RunDir,
    units: &[Unit],
    threads: usize,
) -> Result<(), RunError> {
    let pretty = |value: &Value| format!("{value:#}\n").into_bytes();
    let name = |name: &TrackerName| json!({"id": name.id, "sm": name.sm, "am": name.am, "ssm": name.ssm, "ilm": name.ilm});
    let mut trackers = BTreeMap::new();
    let mut sequences = BTreeMap::new();
    for unit in units {
        trackers.insert(
            &request.trackers[unit.tracker].name.id,
            &request.trackers[unit.tracker],
        );
        let sequence = &request.sequences[unit.sequence];
        sequences.insert((sequence.dataset(), sequence.name()), (sequence, unit.start));
    }
    let mut described = Vec::new();
    for tracker in trackers.into_values() {
        let mut value = name(&tracker.name);
        value["slug"] = tracker.slug.clone().into();
        value["parameters"] = tracker.parameters.clone();
        dir.write(
            &dir.tracker_dir(&tracker.slug).join("tracker.json"),
            &pretty(&value),
        )?;
        described.push(value);
    }
    let sequences: Vec<Value> = sequences
        .into_values()
        .map(|(sequence, start)| {
            json!({
                "dataset": sequence.dataset(),
                "sequence": sequence.name(),
                "frames": sequence.len(),
                "start": start,
                "fingerprint": sequence.fingerprint(),
            })
        })
        .collect();
    let mut run = json!({
        "schema_version": SCHEMA_VERSION,
        "tool": env!("CARGO_PKG_NAME"),
        "version": env!("CARGO_PKG_VERSION"),
        "protocol": PROTOCOL,
        "seed": request.seed,
        "pre": request.pre.id(),
    });
    let mut host = Map::new();
    host.insert("name".into(), host_name().into());
    host.insert("cpu".into(), cpu_name().into());
    host.insert("os".into(), std::env::consts::OS.into());
    host.insert("arch".into(), std::env::consts::ARCH.into());
    host.insert("threads".into(), threads.into());
    host.insert("started".into(), super::utc_now().into());
    host.extend(request.host.clone());
    if let Value::Object(run) = &mut run {
        run.extend(request.about.clone());
        run.insert("trackers".into(), described.into());
        run.insert("sequences".into(), sequences.into());
        run.insert("host".into(), host.into());
    }
    dir.write(&dir.path().join("run.json"), &pretty(&run))
}

/// Writes `timing.csv`: the file that differs between machines.
fn write_timing(dir: &RunDir, entries: &[&Entry]) -> Result<(), RunError> {
    let path = dir.path().join("timing.csv");
    let cpu = cpu_name();
    let mut out = csv::Writer::from_writer(Vec::new());
    let write = |out: &mut csv::Writer<Vec<u8>>, fields: &[&str]| {
        out.write_record(fields)
            .map_err(|e| RunError::io(&path, e.into()))
    };
    let header = "tracker,dataset,sequence,start,frames,seconds,fps,ms_median,ms_p95,fps_with_input,threads,comparable,cpu";
    write(&mut out, &header.split(',').collect::<Vec<_>>())?;
    for entry in entries.iter().filter(|e| e.status == EntryStatus::Ok) {
        let time = &entry.time;
        let rate = |seconds: f64| match time.updates {
            0 => String::new(),
            n => format!("{:.2}", n as f64 / seconds.max(1e-9)),
        };
        write(
            &mut out,
            &[
                &entry.tracker,
                &entry.dataset,
                &entry.sequence,
                &entry.start.to_string(),
                &time.updates.to_string(),
                &format!("{:.6}", time.seconds),
                &rate(time.seconds),
                &format!("{:.4}", time.ms_median),
                &format!("{:.4}", time.ms_p95),
                &rate(time.seconds + time.input_seconds),
                &time.threads.to_string(),
                if time.threads == 1 { "yes" } else { "no" },
                &cpu,
            ],
        )?;
    }
    let bytes = out
        .into_inner()
        .map_err(|e| RunError::io(&path, e.into_error()))?;
    dir.write(&path, &bytes)
}

/// Model of this machine's processor.
fn cpu_name() -> String {
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info
        .lines()
        .find_map(|l| l.strip_prefix("model name")?.split_once(':'));
    model.map_or_else(
        || std::env::consts::ARCH.to_string(),
        |(_, name)| name.trim().to_string(),
    )
}
