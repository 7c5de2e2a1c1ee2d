//! `mtf-eval run`: from the arguments to a request for the runner, and from its report to the table.

use super::args::{ExecutionArgs, ExperimentArgs, Messages, TableArgs};
use super::console::{print, print_data_line};
use super::exit::{self, Failure, Outcome};
use super::experiment::experiment;
use super::program::Program;
use super::progress::Progress;
use super::recorded::recorded;
use super::signals::stop_on_signals;
use crate::judge::field;
use crate::plan::{RunRequest, RunRequestBuilder};
use crate::report::{field_table, table};
use crate::run::RunReport;
use clap::{Args, Parser};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// A `--max-time` in which few units end, perhaps.
const SHORT: Duration = Duration::from_secs(60);
/// Failed units named on stderr; the rest is in the files.
const FAILURES_SHOWN: usize = 5;

/// Arguments of `run`.
#[derive(Args, Clone, Debug)]
pub struct RunArgs {
    /// What to run.
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    /// How to run.
    #[command(flatten)]
    pub execution: ExecutionArgs,
    /// How to print the result.
    #[command(flatten)]
    pub table: TableArgs,
}

/// The arguments of a `run` without the program.
#[derive(Parser)]
#[command(name = "mtf-eval run", no_binary_name = true)]
struct Repeated {
    #[command(flatten)]
    run: RunArgs,
    #[command(flatten)]
    _messages: Messages,
}

/// Runs the command.
///
/// # Errors
/// Wrong arguments, unusable data or output directory, nothing selected, or stopped early.
pub fn run(args: &RunArgs, program: &Program) -> Outcome {
    let typed = &program.arguments;
    // Before the command there are but flags of messages, none of which has this value.
    let own = typed.iter().position(|word| word == "run").map_or(0, |at| at + 1);
    // Before anything runs.
    args.table.options(&program.catalogue.metrics, &program.console)?;
    let report = track(args, &typed[own..], program)?;
    if let Some(shard) = args.execution.shard {
        program.console.note(&format!(
            "{shard}: {} units (one tracker on one sequence each); join the shards with `mtf-eval merge`",
            report.units
        ));
    }
    show(&report, &args.table, program)
}

/// Prints the table of a finished run; its exit code.
///
/// # Errors
/// Wrong arguments, or stdout cannot be written to.
pub fn show(report: &RunReport, args: &TableArgs, program: &Program) -> Outcome {
    let console = &program.console;
    let options = args.options(&program.catalogue.metrics, console)?;
    match args.report_as {
        Some(benchmark) => {
            let rows = field::report(&report.path, benchmark).map_err(Failure::usage)?;
            print(&field_table(&rows, benchmark, args.with_published, &options))?;
        }
        None => print(&table(&report.results, &report.speeds, &options))?,
    }
    print_data_line(report.data.line().as_deref(), options.format, console)?;
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
    if !report.failed.is_empty() {
        return Ok(ExitCode::from(exit::FAILED));
    }
    let evaluated: usize = report.results.sequences.iter().map(|r| r.score.frames()).sum();
    if evaluated == 0 && !report.results.sequences.is_empty() {
        return Err(Failure::new(
            exit::NOTHING,
            "no frame was evaluated: none after the start of a tracker has ground truth; annotate more frames or select \
             others",
        ));
    }
    Ok(ExitCode::SUCCESS)
}

/// Runs the arguments of another `run`, as a baseline records them; returns the run directory.
///
/// # Errors
/// As [`run`].
pub fn repeat(words: &[String], program: &Program) -> Result<PathBuf, Failure> {
    let parsed = Repeated::try_parse_from(words).map_err(|error| {
        let text = error.to_string();
        // The rest is the usage.
        let first = text.lines().next().unwrap_or_default();
        Failure::usage(first.trim_start_matches("error: "))
    })?;
    Ok(track(&parsed.run, words, program)?.path)
}

/// Tracks what `args` ask for. `words` is how they were typed.
fn track(args: &RunArgs, words: &[String], program: &Program) -> Result<RunReport, Failure> {
    let request = request(args, words, program)?;
    let stop = stop_on_signals()?;
    if let Some(limit) = args.execution.max_time {
        let stop = Arc::clone(&stop);
        let wait = move || {
            std::thread::sleep(limit);
            stop.store(true, Ordering::Relaxed);
        };
        std::thread::Builder::new()
            .spawn(wait)
            .map_err(|e| Failure::new(exit::STOPPED, format!("cannot keep --max-time: no thread ({e})")))?;
    }
    let progress = Progress::new(&program.console, program.progress);
    let exporters = &program.catalogue.exporters;
    Ok(crate::run::run(&request, exporters, &progress, &stop)?)
}

/// The request that the arguments describe.
fn request(args: &RunArgs, words: &[String], program: &Program) -> Result<RunRequest, Failure> {
    let ExecutionArgs {
        out,
        force,
        mix_builds,
        shard,
        threads,
        threads_per_tracker,
        memory,
        max_time,
        grace,
    } = args.execution.clone();
    let host = [("revision".to_owned(), option_env!("MTF_EVAL_REVISION").into())];
    let request = experiment(&args.experiment, recorded(words), program)?
        .threads_per_tracker(threads_per_tracker)
        .threads(threads.or_else(slurm_cpus).unwrap_or(0))
        .memory(memory.unwrap_or_else(|| (machine_memory() / 2).min(RunRequest::MEMORY)))
        .shard(shard)
        .force(force)
        .mix_builds(mix_builds)
        .hurry(max_time.is_some_and(|limit| limit <= SHORT))
        .grace(grace)
        .host(host.into_iter().collect());
    let out = match out {
        Some(out) => out,
        None => default_out(&request)?,
    };
    Ok(request.out(out).build()?)
}

/// `results/<UTC date-time>-<hash of what is run>`.
///
/// # Errors
/// There is nothing to run.
pub fn default_out(request: &RunRequestBuilder) -> Result<PathBuf, Failure> {
    let plan = request.plan()?;
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
