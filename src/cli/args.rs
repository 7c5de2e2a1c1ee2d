//! The command line as typed: structures for clap and the little grammars of their values. No logic.

use super::basin::BasinArgs;
use super::bench::BenchArgs;
use super::check::CheckArgs;
use super::compare::CompareArgs;
use super::data::DataArgs;
use super::diagnose::DiagnoseArgs;
use super::merge::MergeArgs;
use super::plan::PlanArgs;
use super::status::StatusArgs;
use super::synth::SynthArgs;
use crate::plan::protocol::Protocols;
use crate::plan::shard::Shard;
use crate::report::Format;
use clap::{Args, Parser, Subcommand, ValueEnum};
use mtf::params::{ParamValue, Resolution};
use std::path::PathBuf;
use std::time::Duration;

/// Evaluates registration-based trackers: every search method x appearance model x state space model, on image
/// sequences with ground-truth corners.
#[derive(Debug, Parser)]
#[command(name = "mtf-eval", version, propagate_version = true, max_term_width = 100)]
#[command(after_help = "\
Exit codes: 0 success, 2 usage or bad input, 4 filters selected nothing, 10 check or diagnose failed, \
11 not comparable, 20 some runs failed (the others are complete), 21 incomplete, 75 stopped early (run again)")]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Messages.
    #[command(flatten)]
    pub messages: Messages,
}

/// How much is said, and how.
#[derive(Args, Clone, Debug)]
pub struct Messages {
    /// Only errors on stderr
    #[arg(
        short,
        long,
        global = true,
        conflicts_with = "verbose",
        help_heading = "Messages"
    )]
    pub quiet: bool,
    /// Say more on stderr (a line per unit)
    #[arg(short, long, global = true, action = clap::ArgAction::Count, help_heading = "Messages")]
    pub verbose: u8,
    /// Colours on stderr
    #[arg(
        long,
        global = true,
        value_name = "WHEN",
        default_value = "auto",
        help_heading = "Messages"
    )]
    pub color: When,
    /// Progress on stderr: a bar on terminals and lines elsewhere, or always lines, or nothing
    #[arg(
        long,
        global = true,
        value_name = "HOW",
        default_value = "auto",
        help_heading = "Messages"
    )]
    pub progress: ProgressMode,
}

/// When to colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum When {
    /// On terminals, unless NO_COLOR is set
    Auto,
    /// Always
    Always,
    /// Never
    Never,
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProgressMode {
    /// A bar on terminals, lines elsewhere
    Auto,
    /// Lines
    Plain,
    /// Nothing
    None,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Track every requested combination over every sequence, write a run directory, print a table
    Run(Box<RunArgs>),
    /// Say what an experiment contains, what it costs and how it is cut into shards
    Plan(Box<PlanArgs>),
    /// Say how far a run directory is: exit 0 complete, 20 some units failed, 21 units missing
    Status(StatusArgs),
    /// Join the run directories of shards into one: exit 21 and nothing written when units are missing
    Merge(MergeArgs),
    /// Compare a run with a recorded baseline: exit 0 or 10
    Check(CheckArgs),
    /// Compare runs: what changed, and whether it is more than chance
    Compare(CompareArgs),
    /// Render an image sequence with exact ground truth, from any image or a texture drawn by code
    Synth(Box<SynthArgs>),
    /// Compare analytic derivatives with central differences: exit 0 or 10
    Diagnose(DiagnoseArgs),
    /// Measure how far from the truth trackers may start
    Basin(BasinArgs),
    /// Measure the speed of trackers on one core
    Bench(Box<BenchArgs>),
    /// What exists: models, trackers, parameters, metrics, data
    List(ListArgs),
    /// Look into data sets and find what is wrong with them
    Data(DataArgs),
    /// Print a completion script for a shell
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page (roff)
    Man,
}

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

/// What to run: flags, over what a file says.
#[derive(Args, Clone, Debug)]
pub struct ExperimentArgs {
    /// Folders with sequences and ground truth [default: the embedded data set `builtin`]
    #[arg(value_name = "DATA")]
    pub data: Vec<PathBuf>,
    /// Take the experiment from a file (TOML); flags override what it says
    #[arg(long, value_name = "FILE")]
    pub grid: Option<PathBuf>,
    /// Which trackers.
    #[command(flatten)]
    pub trackers: TrackerArgs,
    /// Which frames.
    #[command(flatten)]
    pub selection: SelectionArgs,
    /// Where trackers start, comma separated: ope (the first frame, one pass), subseq[:n] (n frames, a pass from each to the
    /// end; 10), reinit[:thresh:skip] (anew skip frames after an error above thresh px or no output; 20:5), every[:k] (anew
    /// every k frames; 10) [default: ope]
    #[arg(long, value_name = "LIST", help_heading = "Frames")]
    pub protocol: Option<Protocols>,
    /// Seed of all randomness [default: 0]
    #[arg(long, value_name = "N", help_heading = "Execution")]
    pub seed: Option<u64>,
    /// Fail a unit whose updates take longer than this together
    #[arg(long, value_name = "SECONDS", value_parser = positive, help_heading = "Execution")]
    pub timeout: Option<f64>,
    /// Corners of each frame: a CSV file per unit (the default), compressed, or none (the journal keeps the errors)
    #[arg(long, value_name = "HOW", help_heading = "Execution")]
    pub frame_logs: Option<FrameLogsArg>,
}

/// Which trackers, with which settings.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Trackers")]
pub struct TrackerArgs {
    /// Search methods: names, groups (lk, gradient, stochastic, robust, composite) or `all`, comma separated
    /// [default: esm]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub sm: Vec<String>,
    /// Appearance models [default: ssd]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub am: Vec<String>,
    /// State space models [default: homography]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub ssm: Vec<String>,
    /// Illumination models: gb, pgb, rbf, none or `all` [default: none]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub ilm: Vec<String>,
    /// A tracker by expression, such as `iclk/ssd+gb/affine{max_iters=50}`; repeatable
    #[arg(long = "tracker", value_name = "EXPR")]
    pub expressions: Vec<String>,
    /// Only trackers whose id matches, such as `*/ncc/*`; repeatable
    #[arg(long, value_name = "GLOB")]
    pub include: Vec<String>,
    /// No trackers whose id matches; repeatable
    #[arg(long, value_name = "GLOB")]
    pub exclude: Vec<String>,
    /// Set a parameter: `esm.max_iters=50` or `sm.esm.max_iters=50`; repeatable (see `list params`)
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    pub set: Vec<(String, String)>,
    /// Samples of the template, columns x rows [default: 50x50]
    #[arg(long, value_name = "WxH", value_parser = resolution)]
    pub res: Option<String>,
    /// Most iterations per frame [default: 30]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub max_iters: Option<u32>,
    /// Corner movement below which the search has converged [default: 1e-4]
    #[arg(long, value_name = "X", value_parser = non_negative)]
    pub epsilon: Option<f64>,
    /// Image channels to track in: 1 (gray) or 3 [default: 1]
    #[arg(long, value_name = "N", value_parser = channels)]
    pub channels: Option<usize>,
    /// Filter applied to each frame: `none`, `gaussian[:size[:sigma]]` [default: gaussian:5:3]
    #[arg(long, value_name = "FILTER")]
    pub pre: Option<String>,
}

/// Which sequences and frames.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Frames")]
pub struct SelectionArgs {
    /// Only sequences whose name or data set/name matches; repeatable
    #[arg(long, value_name = "GLOB", value_delimiter = ',')]
    pub seq: Vec<String>,
    /// Only sequences with this tag; repeatable (any of them)
    #[arg(long, value_name = "TAG", value_delimiter = ',')]
    pub tag: Vec<String>,
    /// Only the first N frames of each sequence (after --frame-gap)
    #[arg(long, value_name = "N", value_parser = at_least_two)]
    pub max_frames: Option<usize>,
    /// Only every K-th frame [default: 1]
    #[arg(long, value_name = "K", value_parser = at_least_one)]
    pub frame_gap: Option<usize>,
    /// Fit the ground truth with this warp first (translation, isometry, ...), to judge trackers of few degrees of freedom
    /// by what they can follow
    #[arg(long, value_name = "SSM")]
    pub gt_ssm: Option<String>,
    /// What to do with a sequence whose data is faulty [default: fail]
    #[arg(long, value_name = "WHAT")]
    pub on_bad_data: Option<OnBadData>,
}

/// What to do with faulty data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OnBadData {
    /// Stop before tracking
    Fail,
    /// Leave the sequence out, with a warning
    Skip,
}

/// How and where to run.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Execution")]
pub struct ExecutionArgs {
    /// The run directory; an existing one is resumed [default: results/<UTC date-time>-<hash>]
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Discard what --out holds and start afresh
    #[arg(long)]
    pub force: bool,
    /// Run a part only, to be joined by `merge`: slice:i/n (equal cost) or hash:i/n, i from 1
    #[arg(long, value_name = "PART")]
    pub shard: Option<Shard>,
    /// Worker threads (never changes a result) [default: SLURM_CPUS_PER_TASK, else all cores]
    #[arg(short = 'j', long, value_name = "N", value_parser = at_least_one)]
    pub threads: Option<usize>,
    /// Threads that a single tracker may use: particle filters, nearest neighbours and grids share out their work (never
    /// changes a result)
    #[arg(long, value_name = "N", default_value = "1", value_parser = at_least_one)]
    pub threads_per_tracker: usize,
    /// Memory for trackers, such as 4G (never changes a result) [default: half of the
    /// machine's or the Slurm job's, at most 3G]
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub memory: Option<u64>,
    /// Stop after this time (90, 90s, 15m, 2h) as by a signal: exit 75, run again to go on
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub max_time: Option<Duration>,
    /// Time for units in progress to end after SIGTERM, SIGINT, SIGUSR1 or --max-time; a second signal ends at once
    #[arg(long, value_name = "TIME", default_value = "20s", value_parser = duration)]
    pub grace: Duration,
}

/// Where frame logs go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FrameLogsArg {
    /// A CSV file per unit
    Csv,
    /// A CSV file per unit, compressed (Zstandard)
    Zst,
    /// Nowhere
    None,
}

/// How a table is printed.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
pub struct TableArgs {
    /// Format of the result on stdout
    #[arg(long, value_name = "FORMAT", default_value = "table")]
    pub format: Format,
    /// Column to sort by, best first
    #[arg(long, value_name = "COLUMN", default_value = "auc", value_parser = crate::report::parse_sort)]
    pub sort: String,
    /// How many trackers to show (0: all)
    #[arg(long, value_name = "N", default_value = "20")]
    pub top: usize,
}

/// Arguments of `list`.
#[derive(Args, Clone, Debug)]
pub struct ListArgs {
    /// What to list [default: an overview]
    pub what: Option<ListWhat>,
    /// Format on stdout
    #[arg(long, value_name = "FORMAT", default_value = "table")]
    pub format: Format,
    /// Data to list, with `list data` [default: the embedded data set]
    #[arg(long = "data", value_name = "DIR")]
    pub data: Vec<PathBuf>,
}

/// What can be listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ListWhat {
    /// Search methods
    Sm,
    /// Appearance models
    Am,
    /// State space models
    Ssm,
    /// Illumination models
    Ilm,
    /// Every valid single-layer combination, and why the others are refused
    Trackers,
    /// Every parameter with default and range
    Params,
    /// Error metrics and figures
    Metrics,
    /// Sequences
    Data,
}

fn assignment(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
            Ok((name.trim().to_string(), value.trim().to_string()))
        }
        _ => Err("expected NAME=VALUE, such as esm.max_iters=50".into()),
    }
}

fn resolution(text: &str) -> Result<String, String> {
    let grid = Resolution::parse(&text.trim().to_ascii_lowercase());
    grid.map(|r| r.to_string())
        .ok_or_else(|| format!("expected {}", Resolution::allowed()))
}

fn channels(text: &str) -> Result<usize, String> {
    match text.trim() {
        "1" => Ok(1),
        "3" => Ok(3),
        _ => Err("expected 1 or 3".into()),
    }
}

fn non_negative(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok();
    value
        .filter(|v: &f64| v.is_finite() && *v >= 0.0)
        .ok_or_else(|| "expected a number, 0 or more".into())
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok();
    let value = value.filter(|v: &f64| *v > 0.0 && *v < 1e12);
    value.ok_or_else(|| "expected a number above 0".into())
}

/// A time: seconds, or a number with s, m, h or d.
fn duration(text: &str) -> Result<Duration, String> {
    let text = text.trim();
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match &text[number.len()..] {
        "" | "s" => Some(1.0),
        "m" | "min" => Some(60.0),
        "h" => Some(3600.0),
        "d" => Some(86400.0),
        _ => None,
    };
    let number: Option<f64> = number.parse().ok().filter(|v: &f64| (0.0..1e9).contains(v));
    match (number, unit) {
        (Some(number), Some(unit)) => Ok(Duration::from_secs_f64(number * unit)),
        _ => Err("expected a time such as 90, 90s, 15m or 2h".into()),
    }
}

fn at_least(least: usize, text: &str) -> Result<usize, String> {
    let value = text.trim().parse().ok();
    value
        .filter(|&n| n >= least)
        .ok_or_else(|| format!("expected a whole number, {least} or more"))
}

pub(super) fn at_least_one(text: &str) -> Result<usize, String> {
    at_least(1, text)
}

pub(super) fn at_least_two(text: &str) -> Result<usize, String> {
    at_least(2, text)
}

/// Bytes: a number with an optional K, M, G or T (powers of 1024), optionally followed by B or iB.
fn size(text: &str) -> Result<u64, String> {
    let upper = text.trim().to_ascii_uppercase();
    let digits = upper.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let shift = match &upper[digits.len()..] {
        "" | "B" => Some(0),
        "K" | "KB" | "KIB" => Some(10),
        "M" | "MB" | "MIB" => Some(20),
        "G" | "GB" | "GIB" => Some(30),
        "T" | "TB" | "TIB" => Some(40),
        _ => None,
    };
    let number: Option<f64> = digits.trim().parse().ok().filter(|v: &f64| *v > 0.0 && *v < 1e9);
    match (number, shift) {
        (Some(number), Some(shift)) => Ok((number * (1u64 << shift) as f64) as u64),
        _ => Err("expected a size such as 4G or 512M".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn values_are_checked() {
        assert_eq!(size("4G"), Ok(4 << 30));
        assert_eq!(size("1.5 MiB"), Ok(3 << 19));
        assert_eq!(size("100"), Ok(100));
        assert!(["", "G", "-1G", "4X", "nan"].iter().all(|s| size(s).is_err()));
        assert_eq!(resolution("50x40"), Ok("50x40".into()));
        assert_eq!(resolution("25"), Ok("25x25".into()));
        assert!(
            ["", "x", "0x5", "5x", "50x50x50"]
                .iter()
                .all(|s| resolution(s).is_err())
        );
        assert_eq!(
            assignment("esm.max_iters = 5"),
            Ok(("esm.max_iters".into(), "5".into()))
        );
        assert_eq!(duration("1.5m"), Ok(Duration::from_secs(90)));
        assert!(["", "m", "-1", "3w"].iter().all(|s| duration(s).is_err()));
        assert!(["x", "=", "x=", "=5"].iter().all(|s| assignment(s).is_err()));
    }

    #[test]
    fn lists_may_be_joined_or_repeated() {
        let cli = Cli::parse_from(["mtf-eval", "run", "--sm", "esm,fclk", "--sm", "nn", "data"]);
        let Command::Run(args) = cli.command else { panic!() };
        assert_eq!(args.experiment.trackers.sm, ["esm", "fclk", "nn"]);
        assert_eq!(args.experiment.data, [PathBuf::from("data")]);
    }
}
