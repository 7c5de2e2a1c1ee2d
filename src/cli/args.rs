//! Arguments that commands share, as clap takes them from the command line. No logic, no commands.

use super::console::Console;
use super::exit::Failure;
use super::values::{
    assignment, at_least_one, at_least_two, channels, duration, frame_time, non_negative, one_of, positive,
    resolution, size, threads,
};
use crate::dataset::{BoxForm, Depth16, Origin, Reading, TruthRows};
use crate::judge::field::{BENCHMARKS, Benchmark};
use crate::judge::ranking::{Group, Part, Pick, figure, parse_sort};
use crate::metric::MetricSet;
use crate::plan::{Protocols, Shard};
use crate::report::{Format, TableOptions};
use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use mtf::params::Resolution;
use std::path::PathBuf;
use std::time::Duration;

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
    /// Say more on stderr: a line per tracker and sequence
    #[arg(short, long, global = true, action = clap::ArgAction::Count, help_heading = "Messages")]
    pub verbose: u8,
    /// Colours on stderr
    #[arg(
        long,
        global = true,
        hide_short_help = true,
        value_name = "WHEN",
        default_value = "auto",
        help_heading = "Messages"
    )]
    pub color: When,
    /// Progress on stderr: a bar on terminals and lines elsewhere, or always lines, or nothing
    #[arg(
        long,
        global = true,
        hide_short_help = true,
        value_name = "HOW",
        default_value = "auto",
        help_heading = "Messages"
    )]
    pub progress: ProgressMode,
    /// Indent JSON on stdout
    #[arg(long, global = true, help_heading = "Messages", hide_short_help = true)]
    pub pretty: bool,
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
    /// Where trackers start: ope, subseq, reinit, every [default: ope]
    ///
    /// Comma separated: ope, subseq[:n], reinit[:thresh:skip], every[:k]. ope: on the first frame, one pass. subseq: on n
    /// frames (10), a pass from each to the end. reinit: anew, skip frames (5) after an error above thresh px (20) or no
    /// output. every: anew every k frames (10).
    #[arg(long, value_name = "LIST", help_heading = "Frames")]
    pub protocol: Option<Protocols>,
    /// Seed of all randomness [default: 0]
    #[arg(long, value_name = "N", help_heading = "Execution")]
    pub seed: Option<u64>,
    /// Fail a tracker on a sequence when its start and updates take longer than this together, s
    #[arg(long, value_name = "SECONDS", value_parser = positive, help_heading = "Execution", hide_short_help = true)]
    pub timeout: Option<f64>,
    /// Where the corners of each frame go.
    #[command(flatten)]
    pub frame_logs: FrameLogArgs,
}

/// What is kept of each frame.
#[derive(Args, Clone, Debug)]
pub struct FrameLogArgs {
    /// Corners of each frame: a CSV file per tracker and sequence (the default), compressed, or none (the journal keeps the
    /// errors)
    #[arg(long, value_name = "HOW", help_heading = "Execution", hide_short_help = true)]
    pub frame_logs: Option<FrameLogsArg>,
}

/// Which trackers, with which settings.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Trackers")]
pub struct TrackerArgs {
    /// Search methods, comma separated, or `all` [default: esm]
    ///
    /// Names as in `list sm`, or groups: lk, gradient, stochastic, robust, composite.
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
    /// A tracker, such as `iclk/ssd+gb/affine{max_iters=50}`; repeatable
    #[arg(long = "tracker", value_name = "EXPR")]
    pub expressions: Vec<String>,
    /// Only trackers whose id matches, such as `*/ncc/*`; repeatable
    #[arg(long, value_name = "GLOB", hide_short_help = true)]
    pub include: Vec<String>,
    /// No trackers whose id matches; repeatable
    #[arg(long, value_name = "GLOB", hide_short_help = true)]
    pub exclude: Vec<String>,
    /// Set a parameter of `list params`, such as `esm.max_iters=50`; repeatable
    ///
    /// `sm.esm.max_iters=50` where several parts have the same name.
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    pub set: Vec<(String, String)>,
    /// Parameters as published instead of this program's defaults (`list params` shows both); what is set otherwise stays
    #[arg(long, hide_short_help = true)]
    pub paper: bool,
    /// Samples of the template, columns x rows [default: 50x50]
    #[arg(long, value_name = "WxH", value_parser = resolution, hide_short_help = true)]
    pub res: Option<Resolution>,
    /// Most iterations per frame [default: 30]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), hide_short_help = true)]
    pub max_iters: Option<u32>,
    /// Converged when the corners' squared motion, summed over all eight coordinates, falls below this, px² [default: 1e-4]
    #[arg(long, value_name = "PX²", value_parser = non_negative, hide_short_help = true)]
    pub epsilon: Option<f64>,
    /// Image channels to track in: 1 (gray) or 3 [default: 1]
    #[arg(long, value_name = "N", value_parser = channels, hide_short_help = true)]
    pub channels: Option<usize>,
    /// Filter of frames: none, or of `list filters` [default: gaussian:5:3]
    ///
    /// Several are separated by commas: `gaussian[:size[:sigma]]`, `box[:size]`, `median[:size]` and others; sizes and sigma in
    /// px.
    #[arg(long, value_name = "FILTER", hide_short_help = true)]
    pub pre: Option<String>,
}

/// Which sequences and frames.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Frames")]
pub struct SelectionArgs {
    /// Which of them.
    #[command(flatten)]
    pub choice: ChoiceArgs,
    /// How images with 16 bits per channel become 8: scale (v / 257), minmax (least to greatest value of each image), shift:N
    /// (v >> N, of data with 8 + N bits) [default: scale]
    #[arg(long, value_name = "RULE", hide_short_help = true)]
    pub depth16: Option<Depth16>,
    /// How ground truth is read.
    #[command(flatten)]
    pub truth: TruthArgs,
}

/// Which sequences and frames, whatever is read of them.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Frames")]
pub struct ChoiceArgs {
    /// Only sequences of this name, or data set/name; repeatable
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
    /// Fit the ground truth with this warp (translation, isometry, ...) from each start, to judge trackers of few degrees of
    /// freedom by what they can follow
    #[arg(long, value_name = "SSM", hide_short_help = true)]
    pub gt_ssm: Option<String>,
    /// What to do with a sequence whose data is faulty [default: fail]
    #[arg(long, value_name = "WHAT", hide_short_help = true)]
    pub on_bad_data: Option<OnBadData>,
}

/// How ground truth is read.
#[derive(Args, Clone, Copy, Debug, Default)]
#[command(next_help_heading = "Frames")]
pub struct TruthArgs {
    /// Coordinate that the ground truth gives to the centre of the first pixel, px: 0, 0.5 (its corner is at 0), 1 or 1.5 (the
    /// same counted from 1) [default: `origin` in meta.json, else what the format has; `data info` shows it]
    #[arg(long, value_name = "N", hide_short_help = true)]
    pub origin: Option<Origin>,
    /// The four numbers of boxes: xywh, xyxy (two corners) or cxcywh (centre) [default: `box` in meta.json, else xywh]
    #[arg(long = "box", value_name = "FORM", hide_short_help = true)]
    pub boxes: Option<BoxForm>,
    /// The first row of ground truth is for the frame of this number (in its name, or counted from 1 where names have none)
    /// [default: `truth_start` in meta.json, else the first frame]
    #[arg(long, value_name = "N", hide_short_help = true)]
    pub truth_start: Option<u64>,
    /// Frames from a row of ground truth to the next, in these numbers [default: `truth_step` in meta.json, else 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), hide_short_help = true)]
    pub truth_step: Option<u64>,
    /// Read masks, and polygons of more than four points, as the smallest rectangle around them, instead of refusing them
    #[arg(long, hide_short_help = true)]
    pub fit_masks: bool,
    /// Refuse a start that lies partly outside the image, instead of tracking it with a warning
    #[arg(long, hide_short_help = true)]
    pub strict: bool,
}

impl TruthArgs {
    /// What is asked for.
    pub fn reading(&self) -> Reading {
        Reading {
            origin: self.origin,
            boxes: self.boxes,
            rows: TruthRows {
                start: self.truth_start,
                step: self.truth_step,
            },
            fit_masks: self.fit_masks,
        }
    }
}

/// What to do with faulty data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OnBadData {
    /// Stop before tracking
    Fail,
    /// Leave the sequence out, with a warning; of one that is usable but for some rows, only these
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
    /// Keep results in --out that another build of the program made
    #[arg(long, hide_short_help = true)]
    pub mix_builds: bool,
    /// Run a part only, to be joined by `merge`: slice:i/n (equal cost) or hash:i/n, i from 1
    #[arg(long, value_name = "PART", hide_short_help = true)]
    pub shard: Option<Shard>,
    /// Worker threads [default: SLURM_CPUS_PER_TASK, else all cores]
    ///
    /// Never changes a result.
    #[arg(short = 'j', long, value_name = "N", value_parser = threads)]
    pub threads: Option<usize>,
    /// Threads that a single tracker may use: particle filters, nearest neighbours and grids share out their work (never
    /// changes a result)
    #[arg(long, value_name = "N", default_value = "1", value_parser = threads, hide_short_help = true)]
    pub threads_per_tracker: usize,
    /// Memory for trackers, bytes or such as 4G (GiB): one that needs more fails, others run in turn [default: half of the
    /// machine's or the Slurm job's, at most 3G]
    #[arg(long, value_name = "SIZE", value_parser = size, hide_short_help = true)]
    pub memory: Option<u64>,
    /// Stop after this time, s or such as 15m, 2h: exit 75; run again to go on
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub max_time: Option<Duration>,
    /// Time for what is being tracked to end after SIGTERM, SIGINT, SIGUSR1 or --max-time, s or such as 2m; a second signal
    /// ends at once
    #[arg(long, value_name = "TIME", default_value = "20s", value_parser = duration, hide_short_help = true)]
    pub grace: Duration,
}

/// Where frame logs go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FrameLogsArg {
    /// A CSV file per tracker and sequence
    Csv,
    /// The same, compressed (Zstandard)
    Zst,
    /// Nowhere
    None,
}

/// How a table is printed.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
pub struct TableArgs {
    /// Form of the result: a row per tracker; json: sequences, too
    ///
    /// table and md: the --top trackers, success rates as shares of frames, errors in px. csv: the rows of summary.csv, all
    /// trackers. json: the document of summary.json without curves, all trackers, on one line; --pretty indents it.
    #[arg(long, value_name = "FORMAT", default_value = "table")]
    pub format: Format,
    /// Column to sort by, best first: auc, fps, tracker, ...
    ///
    /// All of them are in `list metrics`.
    #[arg(long, value_name = "COLUMN", default_value = "auc")]
    pub sort: String,
    /// How many trackers to show (0: all)
    #[arg(long, value_name = "N", default_value = "20")]
    pub top: usize,
    /// Which trackers, and numbers by group.
    #[command(flatten)]
    pub pick: PickArgs,
    /// Print the figures of a benchmark instead, made from the frame logs
    #[arg(long, value_name = "BENCHMARK", value_parser = one_of(BENCHMARKS.iter().map(|b| PossibleValue::new(b.name).help(b.source)), Benchmark::named),
        hide_short_help = true)]
    pub report_as: Option<&'static Benchmark>,
    /// With --report-as: the benchmark's published figures below ours
    #[arg(long, requires = "report_as", hide_short_help = true)]
    pub with_published: bool,
}

/// Which trackers of a table, and figures by group.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
pub struct PickArgs {
    /// The numbers by group besides: by tag or sequence a table of trackers x groups, and the best tracker of each group
    #[arg(long, value_name = "GROUP", hide_short_help = true)]
    pub by: Option<Group>,
    /// Only the best tracker of each search method, appearance model, ...
    #[arg(long, value_name = "PART", hide_short_help = true)]
    pub best_per: Option<Part>,
    /// Only trackers that no other beats in both accuracy and speed
    #[arg(long, value_name = "SPEED", hide_short_help = true)]
    pub pareto: Option<Speed>,
    /// Only trackers whose mean time per frame is below this, such as 2ms or 60fps
    #[arg(long, value_name = "TIME", value_parser = frame_time, hide_short_help = true)]
    pub under: Option<f64>,
}

/// A figure of speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Speed {
    /// Frames per second, without reading frames
    Fps,
}

impl PickArgs {
    /// What is asked for of a table of `metrics` that is sorted by `sort`.
    ///
    /// # Errors
    /// Its figure cannot be had by group.
    pub fn pick(&self, metrics: &MetricSet, sort: &str) -> Result<Pick, Failure> {
        if let Some((by, figure)) = self.by.zip(figure(metrics, sort)) {
            by.takes(figure)
                .map_err(|e| Failure::usage(format!("--by {}: {e}", by.word())))?;
        }
        Ok(Pick {
            best_per: self.best_per,
            pareto: self.pareto.is_some(),
            under: self.under,
            by: self.by,
        })
    }
}

impl TableArgs {
    /// How to print a table of `metrics`.
    ///
    /// # Errors
    /// There is no such column to sort by.
    pub fn options(&self, metrics: &MetricSet, console: &Console) -> Result<TableOptions, Failure> {
        let sort = parse_sort(metrics, &self.sort).map_err(|e| Failure::usage(format!("--sort: {e}")))?;
        Ok(TableOptions {
            format: self.format,
            top: self.top,
            colour: console.table_colour,
            pretty: console.pretty,
            pick: self.pick.pick(metrics, &sort)?,
            sort,
        })
    }
}
