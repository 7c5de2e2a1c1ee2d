//! `mtf-eval run`: from the arguments to a request for the runner, and from its report to the table.

use super::args::{Cli, Command, ExecutionArgs, ProgressMode, RunArgs, TableArgs};
use super::experiment::experiment;
use super::progress::Progress;
use super::{Console, Failure, Outcome, exit, print};
use crate::plan::request::RunRequest;
use crate::report::{TableOptions, table};
use crate::run::runner::RunReport;
use crate::store::rundir::RunError;
use clap::Parser;
use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Memory for trackers that nobody asked for: more makes nothing faster, as groups of trackers are bounded.
const MOST_MEMORY: u64 = 3 << 30;

/// Failed units named on stderr; the rest is in the files.
const FAILURES_SHOWN: usize = 5;

/// Runs the command.
///
/// # Errors
/// Wrong arguments, unusable data or output directory, nothing selected, or stopped early.
pub fn run(args: &RunArgs, progress: ProgressMode, console: &Console) -> Outcome {
    let command: Vec<String> = std::env::args().collect();
    let report = track(args, &command, progress, console)?;
    if let Some(shard) = args.execution.shard {
        console.note(&format!(
            "{shard}: {} units; join the shards with `mtf-eval merge`",
            report.units
        ));
    }
    show(&report, &args.table, console)
}

/// Prints the table of a finished run; its exit code.
///
/// # Errors
/// Stdout cannot be written to.
pub(super) fn show(report: &RunReport, args: &TableArgs, console: &Console) -> Outcome {
    let options = TableOptions {
        format: args.format,
        sort: args.sort.clone(),
        top: args.top,
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
    if let Some(profile) = &report.profile {
        console.note(&profile.to_string());
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
    if let Some(limit) = args.execution.max_time {
        let stop = Arc::clone(&stop);
        std::thread::spawn(move || {
            std::thread::sleep(limit);
            stop.store(true, Ordering::Relaxed);
        });
    }
    crate::run::run(&request, &Progress::new(console, progress), &stop).map_err(failure)
}

/// Set by an interrupt, a request to terminate or SIGUSR1 (what batch systems send before time is up).
///
/// # Errors
/// The system refuses.
pub(super) fn stop_on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGUSR1] {
        // A second signal ends the process at once: a killed run is resumed all the same.
        signal_hook::flag::register_conditional_default(signal, Arc::clone(&stop))
            .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&stop)))
            .map_err(|e| Failure::usage(format!("cannot handle signals: {e}")))?;
    }
    Ok(stop)
}

/// What an error of a run means to the caller.
pub(super) fn failure(error: RunError) -> Failure {
    let code = match &error {
        RunError::Locked { .. } | RunError::Interrupted { .. } | RunError::DiskFull(_) => exit::STOPPED,
        RunError::Nothing(_) => exit::NOTHING,
        RunError::Mismatch { .. } => exit::NOT_COMPARABLE,
        _ => exit::USAGE,
    };
    Failure::new(code, error)
}

/// The request that the arguments describe.
fn request(args: &RunArgs, command: &[String], console: &Console) -> Result<RunRequest, Failure> {
    let mut request = experiment(&args.experiment, command, console)?;
    let ExecutionArgs {
        out,
        force,
        shard,
        threads,
        threads_per_tracker,
        memory,
        max_time: _,
        grace,
    } = args.execution.clone();
    request
        .host
        .insert("revision".into(), option_env!("MTF_EVAL_REVISION").into());
    request.threads_per_tracker = threads_per_tracker;
    request.threads = threads.or_else(slurm_cpus).unwrap_or(0);
    request.memory = memory.unwrap_or_else(|| (machine_memory() / 2).min(MOST_MEMORY));
    request.shard = shard;
    request.force = force;
    request.grace = grace;
    request.out = match out {
        Some(out) => out,
        None => default_out(&request)?,
    };
    Ok(request)
}

/// `results/<UTC date-time>-<hash of what is run>`.
fn default_out(request: &RunRequest) -> Result<PathBuf, Failure> {
    let plan = request.plan().map_err(failure)?;
    let plan = serde_json::to_vec(&plan).map_err(Failure::usage)?;
    let format = time::macros::format_description!("[year][month][day]-[hour][minute][second]");
    let now = time::OffsetDateTime::now_utc()
        .format(&format)
        .map_err(Failure::usage)?;
    let hash = crate::store::rundir::digest(&plan);
    Ok(Path::new("results").join(format!("{now}-{}", &hash[..6])))
}

/// Bytes of memory that this process may count on: the machine's, or its control group's or Slurm job's if less.
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
    let megabytes = |name: &str| Some(std::env::var(name).ok()?.parse::<u64>().ok()? << 20);
    let slurm = megabytes("SLURM_MEM_PER_NODE")
        .or_else(|| Some(megabytes("SLURM_MEM_PER_CPU")? * slurm_cpus().unwrap_or(1) as u64));
    let limits = [group, slurm.filter(|m| *m > 0)];
    limits
        .into_iter()
        .flatten()
        .fold(total.unwrap_or(FALLBACK), u64::min)
}

/// Cores that a Slurm job has been given.
fn slurm_cpus() -> Option<usize> {
    std::env::var("SLURM_CPUS_PER_TASK")
        .ok()?
        .parse()
        .ok()
        .filter(|n| *n > 0)
}
