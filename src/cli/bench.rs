//! `mtf-eval bench`: how fast trackers are.

use super::args::{SelectionArgs, TrackerArgs};
use super::console::{Console, print};
use super::exit::{self, Failure, Outcome};
use super::experiment::{expand, filter, sequences};
use super::program::Program;
use super::signals::stop_on_signals;
use super::values::{at_least_one, positive};
use crate::files;
use crate::measure::bench::{
    self, BenchReport, BenchRequest, BenchRow, MEASUREMENT_FORMAT_VERSION, Measurement,
};
use crate::measure::machine::Machine;
use crate::plan::sequence_id;
use crate::report::{Format, bars_svg, render};
use crate::run::pool;
use crate::store::{Durable, write_atomic};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Frames of each sequence that are kept in memory unless --max-frames says otherwise.
const MOST_FRAMES: usize = 300;
/// Time between two notes on progress.
const TELL_EVERY: Duration = Duration::from_secs(5);

/// Measure the speed of trackers, on one core each unless told otherwise
///
/// The time of each update alone, over frames that are decoded, filtered and read once beforehand; the least of several
/// passes for each frame, because that is what the machine can do undisturbed. Settings and defaults are those of `run`, but for
/// --max-frames, which is 300. On a machine with other work to do, `taskset -c N` keeps the program on one core.
#[derive(clap::Args, Debug)]
pub struct BenchArgs {
    /// Folders with sequences and ground truth [default: the embedded data set `builtin`]
    #[arg(value_name = "DATA")]
    pub data: Vec<PathBuf>,
    /// Which trackers.
    #[command(flatten)]
    pub trackers: TrackerArgs,
    /// Which frames; 300 of each sequence at most unless --max-frames says otherwise.
    #[command(flatten)]
    pub selection: SelectionArgs,
    /// Timed passes over each sequence, after one to warm up
    #[arg(long, value_name = "N", default_value = "5", value_parser = at_least_one, help_heading = "Measurement")]
    pub repeats: usize,
    /// No further pass for a tracker that has spent as long on a sequence
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = positive, help_heading = "Measurement")]
    pub budget: f64,
    /// Threads that a tracker may use: particle filters, nearest neighbours and grids share out their work
    #[arg(long, value_name = "N", default_value = "1", value_parser = at_least_one, help_heading = "Measurement")]
    pub threads_per_tracker: usize,
    /// Seed of all randomness
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Measurement")]
    pub seed: u64,
    /// Compare with a saved measurement, of this program or another
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub against: Option<PathBuf>,
    /// Save the measurement (JSON)
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub save: Option<PathBuf>,
    /// Draw frames per second as bars (SVG)
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub chart: Option<PathBuf>,
    /// Form of the result on stdout
    #[arg(long, value_name = "FORMAT", default_value = "table", help_heading = "Output")]
    pub format: Format,
}

/// Runs the command.
///
/// # Errors
/// Wrong arguments, unusable data, a measurement that cannot be read or saved, or stopped early.
pub fn run(args: &BenchArgs, program: &Program) -> Outcome {
    let console = &program.console;
    let others = args.against.as_deref().map(read).transpose()?;
    let (trackers, refused) = expand(&args.trackers, program)?;
    let mut selection = args.selection.clone();
    selection.max_frames.get_or_insert(MOST_FRAMES);
    let request = BenchRequest {
        trackers,
        sequences: sequences(&args.data, &selection, program)?.sequences,
        pre: filter(&args.trackers)?,
        repeats: args.repeats,
        budget: Duration::from_secs_f64(args.budget),
        seed: args.seed,
        threads: args.threads_per_tracker,
    };
    let machine = Machine::here();
    if machine.build != "release" {
        console.warn("this is a debug build: its times say nothing");
    }
    let stop = stop_on_signals()?;
    let pool = pool(request.threads, &|text| console.warn(text))?;
    let told = Mutex::new(Instant::now());
    let progress = |share: f64| {
        let mut last = told.lock().unwrap_or_else(|e| e.into_inner());
        if last.elapsed() > TELL_EVERY {
            *last = Instant::now();
            console.note(&format!("{:.0} %", 100.0 * share));
        }
    };
    let BenchReport {
        preparation,
        rows,
        failed,
    } = pool.install(|| bench::run(&request, &stop, &progress))?;
    let measured = Measurement {
        schema_version: MEASUREMENT_FORMAT_VERSION,
        machine,
        command: program.arguments.clone(),
        sequences: request.sequences.iter().map(sequence_id).collect(),
        preparation,
        rows,
        refused: refused.into_iter().map(|r| (r.id, r.reason)).collect(),
        failed,
    };
    let elsewhere = |o: &&Measurement| !o.machine.cpu.is_empty() && o.machine.cpu != measured.machine.cpu;
    if let Some(other) = others.iter().find(elsewhere) {
        console.warn(&format!(
            "the saved measurement is of another machine ({})",
            other.machine.line()
        ));
    }
    let groups = groups(&measured, others.as_ref());
    let text = match args.format {
        Format::Json => json(&measured, &groups),
        format => table(&measured, &groups, others.is_some(), format, console),
    };
    print(&text)?;
    if let Some(path) = &args.save {
        write(path, &pretty(&measured))?;
    }
    if let Some(path) = &args.chart {
        let cores = match args.threads_per_tracker {
            1 => "one core".to_owned(),
            n => format!("up to {n} cores"),
        };
        let note = format!(
            "frames per second of update time on {cores}; {}",
            measured.machine.cpu
        );
        let svg = bars_svg(&groups, "Speed of trackers", &note).map_err(Failure::usage)?;
        write(path, &svg)?;
    }
    for (tracker, reason) in &measured.failed {
        console.warn(&format!("{tracker} failed: {reason}"));
    }
    Ok(ExitCode::from(if measured.failed.is_empty() {
        0
    } else {
        exit::FAILED
    }))
}

/// Reads a saved measurement.
fn read(path: &Path) -> Result<Measurement, Failure> {
    let wrong = |e: &dyn std::fmt::Display| Failure::usage(format!("{}: {e}", path.display()));
    let text = files::read(path, files::Kind::RESULTS).map_err(|e| wrong(&e))?;
    let read: Measurement = serde_json::from_slice(&text).map_err(|e| wrong(&e))?;
    if read.schema_version == MEASUREMENT_FORMAT_VERSION {
        Ok(read)
    } else {
        let version = read.schema_version;
        Err(wrong(&format!(
            "version {version}, this program reads version {MEASUREMENT_FORMAT_VERSION}"
        )))
    }
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    write_atomic(path, Durable::Now, |w| w.write_all(text.as_bytes())).map_err(Failure::usage)
}

fn pretty(value: &impl serde::Serialize) -> String {
    // Strings and numbers always serialise.
    serde_json::to_string_pretty(value).unwrap_or_default() + "\n"
}

/// Each row of ours, then the rows of the other measurement about the same tracker.
fn groups<'a>(measured: &'a Measurement, others: Option<&'a Measurement>) -> Vec<Vec<&'a BenchRow>> {
    let like = |ours: &'a BenchRow| {
        let rows = others.into_iter().flat_map(|o| &o.rows);
        std::iter::once(ours).chain(rows.filter(|r| r.tracker == ours.tracker))
    };
    measured.rows.iter().map(|ours| like(ours).collect()).collect()
}

fn json(measured: &Measurement, groups: &[Vec<&BenchRow>]) -> String {
    let mut value = serde_json::to_value(measured).unwrap_or_default();
    let compared: Vec<serde_json::Value> = groups
        .iter()
        .flat_map(|group| {
            group[1..].iter().map(|other| {
                let (frame, iteration) = other.times(group[0]);
                serde_json::json!({
                    "tracker": group[0].tracker, "row": other,
                    "times_per_frame": frame, "times_per_iteration": iteration,
                })
            })
        })
        .collect();
    if !compared.is_empty() {
        value["against"] = compared.into();
    }
    pretty(&value)
}

fn table(
    measured: &Measurement,
    groups: &[Vec<&BenchRow>],
    compared: bool,
    format: Format,
    console: &Console,
) -> String {
    let mut header = vec![
        "tracker",
        "us/iteration",
        "iterations",
        "us/frame",
        "median",
        "p95",
        "fps",
        "SR@5",
        "AL median",
        "frames",
    ];
    if compared {
        header.insert(1, "program");
        header.extend(["times, frame", "times, iteration"]);
    }
    let number = |v: Option<f64>, decimals: usize| match v {
        Some(v) => format!("{v:.decimals$}"),
        // A machine reads an empty cell as no number.
        None if format == Format::Csv => String::new(),
        None => "-".to_owned(),
    };
    let cells = |ours: &BenchRow, row: &BenchRow| {
        let mut cells = vec![
            row.tracker.clone(),
            number(row.us_per_iteration, 2),
            number(row.iterations, 2),
            format!("{:.1}", row.us_per_frame),
            format!("{:.1}", row.us_median),
            format!("{:.1}", row.us_p95),
            format!("{:.0}", row.fps),
            number(row.sr_5, 3),
            number(row.al_median, 3),
            row.frames.to_string(),
        ];
        if compared {
            cells.insert(1, row.program.clone());
            let (frame, iteration) = row.times(ours);
            let own = std::ptr::eq(ours, row);
            cells.push(number((!own).then_some(frame), 1));
            cells.push(number(iteration.filter(|_| !own), 1));
        }
        cells
    };
    let rows: Vec<Vec<String>> = groups
        .iter()
        .flat_map(|group| group.iter().map(|row| cells(group[0], row)))
        .collect();
    let mut text = render(&header, &rows, format, console.table_colour);
    if format == Format::Csv {
        return text;
    }
    let mut reasons: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (id, reason) in &measured.refused {
        reasons.entry(reason).or_default().push(id);
    }
    if !reasons.is_empty() {
        text.push('\n');
    }
    for (reason, ids) in reasons {
        text += &format!("refused: {}: {reason}\n", ids.join(", "));
    }
    let lost: Vec<&str> = measured
        .rows
        .iter()
        .filter(|r| r.sr_5.is_some_and(|sr| sr < 0.5))
        .map(|r| r.tracker.as_str())
        .collect();
    if !lost.is_empty() {
        text += &format!(
            "\nlost the object in more than half of the frames: {}\n",
            lost.join(", ")
        );
    }
    let made = &measured.preparation;
    format!(
        "{text}\nbefore the updates, a frame: filter {} {:.0} us, pyramid {:.0} us\n{}\n",
        made.filter,
        made.us_filter,
        made.us_pyramid,
        measured.machine.line()
    )
}
