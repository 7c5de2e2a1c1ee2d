//! `mtf-eval run`: from the arguments to a request for the runner, and from its report to the table.

use super::args::{
    Cli, Command, ExecutionArgs, FrameLogsArg, OnBadData, ProgressMode, RunArgs, SelectionArgs, TrackerArgs,
};
use super::progress::Progress;
use super::{Console, Failure, Outcome, exit, print};
use clap::Parser;
use globset::{GlobBuilder, GlobSet, GlobSetBuilder};
use mtf_eval::dataset::{self, LoadOptions, Sequence};
use mtf_eval::eval::baseline::recordable;
use mtf_eval::eval::plan::sequence_id;
use mtf_eval::eval::{self, FrameLogs, RunError, RunReport, RunRequest, TrackerEntry};
use mtf_eval::image::parse_preprocessor;
use mtf_eval::output::{TableOptions, table};
use mtf_eval::registry::{Registry, Selection};
use mtf_eval::ssm;
use serde_json::Map;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Failed units named on stderr; the rest is in the files.
const FAILURES_SHOWN: usize = 5;

/// Runs the command.
///
/// # Errors
/// Wrong arguments, unusable data or output directory, nothing selected, or stopped early.
pub fn run(args: &RunArgs, progress: ProgressMode, console: &Console) -> Outcome {
    let command: Vec<String> = std::env::args().collect();
    let report = track(args, &command, progress, console)?;
    let options = TableOptions {
        format: args.table.format,
        sort: args.table.sort.clone(),
        top: args.table.top,
        colour: console.table_colour,
    };
    print(&table(&report.results, &options))?;
    for (unit, reason) in report.failed.iter().take(FAILURES_SHOWN) {
        console.warn(&format!("{unit}: {reason}"));
    }
    if report.failed.len() > FAILURES_SHOWN {
        console.warn(&format!(
            "{} more failed, see sequences.csv",
            report.failed.len() - FAILURES_SHOWN
        ));
    }
    console.note(&format!("results in {}", report.path.display()));
    Ok(ExitCode::from(if report.failed.is_empty() {
        0
    } else {
        exit::FAILED
    }))
}

/// Runs the arguments of another `run`, as a baseline records them; returns the run directory.
///
/// # Errors
/// As [`run`].
pub fn run_recorded(
    command: &[String],
    progress: ProgressMode,
    console: &Console,
) -> Result<PathBuf, Failure> {
    let words = ["mtf-eval", "run"]
        .into_iter()
        .map(str::to_owned)
        .chain(command.iter().cloned());
    match Cli::try_parse_from(words).map(|cli| cli.command) {
        Ok(Command::Run(args)) => Ok(track(&args, command, progress, console)?.path),
        Ok(_) => Err(Failure::usage("not the arguments of a run")),
        Err(error) => Err(Failure::usage(error.render())),
    }
}

/// Tracks what `args` ask for. `command` is how they were given.
fn track(
    args: &RunArgs,
    command: &[String],
    progress: ProgressMode,
    console: &Console,
) -> Result<RunReport, Failure> {
    let request = request(args, command, console)?;
    let stop = stop_on_signals()?;
    eval::run(&request, &Progress::new(console, progress), &stop).map_err(failure)
}

/// Set by an interrupt or a request to terminate.
///
/// # Errors
/// The system refuses.
pub(super) fn stop_on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // A second signal ends the process at once: a killed run is resumed all the same.
        signal_hook::flag::register_conditional_default(signal, Arc::clone(&stop))
            .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&stop)))
            .map_err(|e| Failure::usage(format!("cannot handle signals: {e}")))?;
    }
    Ok(stop)
}

fn failure(error: RunError) -> Failure {
    let code = match &error {
        RunError::Locked { .. } | RunError::Interrupted { .. } | RunError::DiskFull(_) => exit::STOPPED,
        RunError::Nothing(_) => exit::NOTHING,
        _ => exit::USAGE,
    };
    Failure::new(code, error)
}

/// The request that the arguments describe.
fn request(args: &RunArgs, command: &[String], console: &Console) -> Result<RunRequest, Failure> {
    let pre = parse_preprocessor(&args.trackers.pre).map_err(Failure::usage)?;
    let registry = Arc::new(Registry::builtin());
    let trackers = trackers(&args.trackers, &registry, console)?;
    let mut sequences = sequences(&args.data, &args.selection, console)?;
    if let Some(name) = &args.selection.gt_ssm {
        fit_truth(&mut sequences, &registry, name)?;
    }
    let ExecutionArgs {
        out,
        force,
        seed,
        threads,
        memory,
        timeout,
        frame_logs,
    } = args.execution.clone();
    // Only what defines the results, so that the file does not depend on threads or places.
    let mut command = recordable(command);
    if args.data.is_empty() {
        command.insert(0, dataset::BUILTIN.into());
    }
    let mut about = Map::new();
    about.insert("frame_gap".into(), args.selection.frame_gap.into());
    about.insert("max_frames".into(), args.selection.max_frames.into());
    about.insert("gt_ssm".into(), args.selection.gt_ssm.clone().into());
    about.insert("command".into(), command.into());
    let mut host = Map::new();
    host.insert("revision".into(), option_env!("MTF_EVAL_REVISION").into());
    let mut request = RunRequest {
        trackers,
        sequences,
        pre,
        seed,
        threads: threads.unwrap_or(0),
        memory: memory.unwrap_or_else(|| machine_memory() / 2),
        out: PathBuf::new(),
        force,
        frame_logs: match frame_logs {
            FrameLogsArg::Csv => FrameLogs::Csv,
            FrameLogsArg::None => FrameLogs::None,
        },
        timeout: timeout.map(Duration::from_secs_f64),
        about,
        host,
    };
    request.out = match out {
        Some(out) => out,
        None => default_out(&request)?,
    };
    Ok(request)
}

/// `results/<UTC date-time>-<hash of what is run>`.
fn default_out(request: &RunRequest) -> Result<PathBuf, Failure> {
    let units = request.units().map_err(failure)?;
    let keys: String = units.iter().map(|unit| unit.key.as_str()).collect();
    let format = time::macros::format_description!("[year][month][day]-[hour][minute][second]");
    let now = time::OffsetDateTime::now_utc()
        .format(&format)
        .map_err(Failure::usage)?;
    let hash = eval::rundir::digest(keys.as_bytes());
    Ok(Path::new("results").join(format!("{now}-{}", &hash[..6])))
}

/// The trackers asked for; combinations that cannot work are told once per reason.
///
/// # Errors
/// Unknown names, bad values, nothing that can work.
pub(super) fn trackers(
    args: &TrackerArgs,
    registry: &Arc<Registry>,
    console: &Console,
) -> Result<Vec<TrackerEntry>, Failure> {
    // Settings with flags of their own are parameters like any other; --set has the last word.
    let common = [
        ("res", args.res.clone()),
        ("max_iters", args.max_iters.map(|n| n.to_string())),
        ("epsilon", args.epsilon.map(|x| x.to_string())),
        ("channels", args.channels.map(|n| n.to_string())),
    ];
    let common = common
        .into_iter()
        .filter_map(|(name, value)| Some((name.to_owned(), value?)));
    let mut selection = Selection {
        sm: args.sm.clone(),
        am: args.am.clone(),
        ssm: args.ssm.clone(),
        ilm: args.ilm.clone(),
        trackers: args.expressions.clone(),
        set: common.chain(args.set.clone()).collect(),
    };
    // Expressions alone are all there is; else what is not named is the default.
    let lists = [&args.sm, &args.am, &args.ssm, &args.ilm];
    if args.expressions.is_empty() || lists.iter().any(|l| !l.is_empty()) {
        for (list, default) in [
            (&mut selection.sm, "esm"),
            (&mut selection.am, "ssd"),
            (&mut selection.ssm, "homography"),
        ] {
            if list.is_empty() {
                list.push(default.into());
            }
        }
    }
    let expansion = registry.expand(&selection).map_err(Failure::usage)?;
    let mut reasons: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for refusal in &expansion.refused {
        reasons.entry(&refusal.reason).or_default().push(&refusal.id);
    }
    for (reason, ids) in reasons {
        match ids[..] {
            [one] => console.warn(&format!("{one} is refused: {reason}")),
            _ => console.warn(&format!(
                "{} and {} more are refused: {reason}",
                ids[0],
                ids.len() - 1
            )),
        }
    }
    let entries = expansion
        .specs
        .iter()
        .map(|spec| TrackerEntry::from_registry(registry, spec));
    entries.collect::<Result<_, _>>().map_err(Failure::usage)
}

/// The sequences of `data` (the embedded ones if empty) that pass the filters, cut to the frames asked for.
fn sequences(data: &[PathBuf], args: &SelectionArgs, console: &Console) -> Result<Vec<Sequence>, Failure> {
    let names = globs(&args.seq)?;
    let mut all = 0;
    let mut chosen = Vec::new();
    let options = LoadOptions {
        on_bad_data: match args.on_bad_data {
            OnBadData::Fail => dataset::OnBadData::Fail,
            OnBadData::Skip => dataset::OnBadData::Skip,
        },
        start: 0,
        frame_gap: args.frame_gap,
        max_frames: args.max_frames,
    };
    let builtin = [PathBuf::from(dataset::BUILTIN)];
    for path in if data.is_empty() { &builtin } else { data } {
        let set = dataset::load(path, &options).map_err(Failure::usage)?;
        for fault in &set.skipped {
            console.warn(&fault.to_string());
        }
        all += set.sequences.len();
        chosen.extend(set.sequences.into_iter().filter(|s| {
            let id = format!("{}/{}", s.dataset(), s.name());
            let named = args.seq.is_empty() || names.is_match(s.name()) || names.is_match(&id);
            let tagged = |tag: &String| s.tags().iter().any(|t| t.eq_ignore_ascii_case(tag));
            named && (args.tag.is_empty() || args.tag.iter().any(tagged))
        }));
    }
    if chosen.is_empty() {
        return Err(Failure::new(
            exit::NOTHING,
            format!("none of {all} sequences passes --seq and --tag"),
        ));
    }
    Ok(chosen)
}

/// Replaces ground truth by what the state space model `name` can follow of it.
fn fit_truth(sequences: &mut [Sequence], registry: &Registry, name: &str) -> Result<(), Failure> {
    let models = registry
        .select_ssms(name)
        .map_err(|e| Failure::usage(format!("--gt-ssm: {e}")))?;
    let [model] = models[..] else {
        return Err(Failure::usage(format!(
            "--gt-ssm {name}: give one state space model"
        )));
    };
    for sequence in sequences {
        let fitted = sequence.with_fitted_truth(|first, corners| ssm::fit_truth(model, first, corners));
        *sequence = fitted.map_err(|(frame, e)| {
            let id = sequence_id(sequence);
            Failure::usage(format!(
                "{id}: --gt-ssm {name} does not fit the ground truth of {frame}: {e}"
            ))
        })?;
    }
    Ok(())
}

fn globs(patterns: &[String]) -> Result<GlobSet, Failure> {
    let mut set = GlobSetBuilder::new();
    for pattern in patterns {
        let glob = GlobBuilder::new(pattern).case_insensitive(true).build();
        set.add(glob.map_err(|e| Failure::usage(format!("--seq: {e}")))?);
    }
    set.build().map_err(Failure::usage)
}

/// Bytes of memory that this process may count on: the machine's, or its control group's if less.
fn machine_memory() -> u64 {
    const FALLBACK: u64 = 8 << 30;
    let info = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let total = info.lines().find_map(|line| {
        let kib = line.strip_prefix("MemTotal:")?.trim().strip_suffix("kB")?;
        Some(kib.trim().parse::<u64>().ok()? << 10)
    });
    let limit = |path: &str| std::fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let group =
        limit("/sys/fs/cgroup/memory.max").or_else(|| limit("/sys/fs/cgroup/memory/memory.limit_in_bytes"));
    total.unwrap_or(FALLBACK).min(group.unwrap_or(u64::MAX))
}
