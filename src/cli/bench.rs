//! `mtf-eval bench`: how fast trackers are.

use super::args::{SelectionArgs, TrackerArgs};
use super::console::{Console, print, write_text};
use super::exit::{self, Failure, Outcome};
use super::experiment::{expand, filter, sequences};
use super::program::Program;
use super::signals::stop_on_signals;
use super::values::{at_least_one, positive};
use crate::files;
use crate::measure::bench::{
    self, BenchReport, BenchRequest, BenchRow, MEASUREMENT_FORMAT_VERSION, MeasuredSequence, Measurement,
};
use crate::measure::machine::Machine;
use crate::report::{Format, bars_svg, json_text, render};
use crate::run::pool;
use std::collections::{BTreeMap, BTreeSet};
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
    /// No further pass for a tracker that has spent as long on a sequence, s
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = positive, help_heading = "Measurement", hide_short_help = true)]
    pub budget: f64,
    /// Threads that a tracker may use: particle filters, nearest neighbours and grids share out their work
    #[arg(long, value_name = "N", default_value = "1", value_parser = at_least_one, help_heading = "Measurement", hide_short_help = true)]
    pub threads_per_tracker: usize,
    /// Seed of all randomness
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        help_heading = "Measurement",
        hide_short_help = true
    )]
    pub seed: u64,
    /// Mark trackers with fewer frames per second, input included
    #[arg(long, value_name = "FPS", value_parser = positive, help_heading = "Measurement")]
    pub target_fps: Option<f64>,
    /// Fail (exit code 10) when an update takes longer on average, us (microseconds)
    #[arg(long, value_name = "US", value_parser = positive, help_heading = "Measurement")]
    pub fail_above: Option<f64>,
    /// Fail (exit code 10) when there are fewer updates per second
    #[arg(long, value_name = "FPS", value_parser = positive, help_heading = "Measurement")]
    pub fail_below: Option<f64>,
    /// Compare with a saved measurement
    ///
    /// Of this program on the same data and filter, or of another program.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub against: Option<PathBuf>,
    /// Save the measurement (JSON)
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub save: Option<PathBuf>,
    /// Draw frames per second as bars (SVG)
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub chart: Option<PathBuf>,
    /// Form of the result: a row per tracker, times in us; json: as --save
    ///
    /// JSON is on one line; --pretty indents it. With --against it has the other measurement's rows under `against`.
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
    selection.choice.max_frames.get_or_insert(MOST_FRAMES);
    let request = BenchRequest {
        trackers,
        sequences: sequences(&args.data, &selection, program)?.sequences,
        pre: filter(&args.trackers)?,
        repeats: args.repeats,
        budget: Duration::from_secs_f64(args.budget),
        seed: args.seed,
        threads: args.threads_per_tracker,
    };
    let data = request.data();
    let settings = request.settings();
    if let (Some(path), Some(other)) = (&args.against, &others) {
        comparable(path, other, &request, &data, console)?;
    }
    let machine = Machine::here();
    if machine.build != "release" {
        console.warn("this is a debug build: its times say nothing");
    }
    if machine.is_loaded() {
        console.warn(&format!(
            "the machine is busy (load {:.1} on {} cores): times are too long; measure again when it is idle",
            machine.load.unwrap_or_default(),
            machine.cores
        ));
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
        lead,
        failed,
    } = pool.install(|| bench::run(&request, &stop, &progress))?;
    let measured = Measurement {
        schema_version: MEASUREMENT_FORMAT_VERSION,
        machine,
        command: program.arguments.clone(),
        data,
        settings: Some(settings),
        preparation,
        rows,
        lead,
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
        Format::Json => console.json(&json(&measured, &groups, args.target_fps)),
        format => Shown {
            measured: &measured,
            compared: others.is_some(),
            target: args.target_fps,
            format,
        }
        .table(&groups, console),
    };
    print(&text)?;
    if let Some(path) = &args.save {
        write_text(path, &json_text(&measured, true))?;
    }
    if let Some(path) = &args.chart {
        let cores = match args.threads_per_tracker {
            1 => "one core".to_owned(),
            n => format!("up to {n} cores"),
        };
        let note = format!(
            "frames per second of update time on {cores}, logarithmic (median error); {}",
            measured.machine.cpu
        );
        let title = format!("Speed of trackers on {}", subject(&measured.data));
        let svg = bars_svg(&groups, &title, &note).map_err(Failure::usage)?;
        write_text(path, &svg)?;
    }
    for (tracker, reason) in &measured.failed {
        console.warn(&format!("{tracker} failed: {reason}"));
    }
    let slow = too_slow(&measured, args);
    for line in &slow {
        console.error(line);
    }
    Ok(ExitCode::from(
        match (slow.is_empty(), measured.failed.is_empty()) {
            (false, _) => exit::CHECK_FAILED,
            (true, false) => exit::FAILED,
            (true, true) => 0,
        },
    ))
}

/// Refuses a saved measurement of other data, frames or filter; warns where it holds none of the trackers and of other
/// settings.
fn comparable(
    path: &Path,
    other: &Measurement,
    request: &BenchRequest,
    data: &[MeasuredSequence],
    console: &Console,
) -> Result<(), Failure> {
    let file = path.display();
    if let Some(why) = other.other_than(data, &request.pre.id()) {
        let mut failure = Failure::new(
            exit::NOT_COMPARABLE,
            format!("{file} is no measurement of the same: {why}; measure the same, or leave out --against"),
        );
        if !other.command.is_empty() {
            failure
                .details
                .push(format!("it was made by: mtf-eval {}", other.command.join(" ")));
        }
        return Err(failure);
    }
    let known = |id: &str| other.rows.iter().any(|r| r.tracker == id);
    if !request.trackers.iter().any(|t| known(&t.name.id)) {
        console.warn(&format!(
            "{file} has no row of the trackers measured here; name them as its rows do, settings included"
        ));
    }
    if let Some(theirs) = &other.settings {
        let ours = request.settings();
        let settings = [
            (
                "--threads-per-tracker",
                theirs.threads_per_tracker as u64,
                ours.threads_per_tracker as u64,
            ),
            ("--seed", theirs.seed, ours.seed),
            ("--repeats", theirs.repeats as u64, ours.repeats as u64),
        ];
        for (name, theirs, ours) in settings.iter().filter(|(_, theirs, ours)| theirs != ours) {
            console.warn(&format!(
                "{file} was measured with {name} {theirs}, this with {ours}"
            ));
        }
    }
    Ok(())
}

/// `builtin: 3 sequences, 180 frames`
fn subject(data: &[MeasuredSequence]) -> String {
    let dataset = |s: &MeasuredSequence| s.sequence.rsplit_once('/').map_or("", |(d, _)| d).to_owned();
    let datasets: BTreeSet<String> = data.iter().map(dataset).collect();
    let names: Vec<&str> = datasets.iter().map(String::as_str).collect();
    let frames: usize = data.iter().map(|s| s.frames).sum();
    let sequences = match data.len() {
        1 => "1 sequence".to_owned(),
        n => format!("{n} sequences"),
    };
    format!("{}: {sequences}, {frames} frames", names.join(", "))
}

/// What breaks `--fail-above` and `--fail-below`, a line each.
fn too_slow(measured: &Measurement, args: &BenchArgs) -> Vec<String> {
    let mut lines = Vec::new();
    for row in &measured.rows {
        let (id, us, fps) = (&row.tracker, row.us_per_frame, row.fps);
        if let Some(most) = args.fail_above.filter(|most| us > *most) {
            lines.push(format!(
                "{id}: {us:.1} us per update, more than --fail-above {most}"
            ));
        }
        if let Some(least) = args.fail_below.filter(|least| fps < *least) {
            lines.push(format!(
                "{id}: {fps:.0} updates per second, fewer than --fail-below {least}"
            ));
        }
    }
    lines
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

/// Each row of ours, then the rows of the other measurement about the same tracker.
fn groups<'a>(measured: &'a Measurement, others: Option<&'a Measurement>) -> Vec<Vec<&'a BenchRow>> {
    let like = |ours: &'a BenchRow| {
        let rows = others.into_iter().flat_map(|o| &o.rows);
        std::iter::once(ours).chain(rows.filter(|r| r.tracker == ours.tracker))
    };
    measured.rows.iter().map(|ours| like(ours).collect()).collect()
}

/// Whether a row reaches `target` frames per second with input; `None` where that is not known.
fn reaches(row: &BenchRow, target: f64) -> Option<bool> {
    row.fps_with_input.map(|fps| fps >= target)
}

/// Ids of the trackers that do not reach the target.
fn below(measured: &Measurement, target: f64) -> Vec<&str> {
    let rows = measured.rows.iter();
    rows.filter(|row| reaches(row, target) == Some(false))
        .map(|row| row.tracker.as_str())
        .collect()
}

fn json(measured: &Measurement, groups: &[Vec<&BenchRow>], target: Option<f64>) -> serde_json::Value {
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
    if let Some(target) = target {
        value["target_fps"] = target.into();
        value["below_target"] = below(measured, target).into();
    }
    value
}

/// What a table is made of.
struct Shown<'a> {
    measured: &'a Measurement,
    /// Whether rows of another measurement stand below ours.
    compared: bool,
    target: Option<f64>,
    format: Format,
}

impl Shown<'_> {
    fn table(&self, groups: &[Vec<&BenchRow>], console: &Console) -> String {
        let mut header: Vec<String> = [
            "tracker",
            "us/iteration",
            "iterations",
            "us/frame",
            "median us",
            "p95 us",
            "fps",
            "fps with input",
            "SR@5",
            "AL median px",
            "frames",
        ]
        .map(str::to_owned)
        .into();
        if self.compared {
            header.insert(1, "program".to_owned());
            header.extend(["times, frame", "times, iteration"].map(str::to_owned));
        }
        if let Some(target) = self.target {
            header.push(format!("{target} fps"));
        }
        let rows: Vec<Vec<String>> = groups
            .iter()
            .flat_map(|group| group.iter().map(|row| self.cells(group[0], row)))
            .collect();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        let text = render(&header, &rows, self.format, console.table_colour);
        match self.format {
            Format::Csv => text,
            _ => text + &self.notes(groups),
        }
    }

    /// A number; a machine reads an empty cell as none.
    fn number(&self, value: Option<f64>, decimals: usize) -> String {
        match value {
            Some(v) => format!("{v:.decimals$}"),
            None if self.format == Format::Csv => String::new(),
            None => "-".to_owned(),
        }
    }

    fn cells(&self, ours: &BenchRow, row: &BenchRow) -> Vec<String> {
        let mut cells = vec![
            row.tracker.clone(),
            self.number(row.us_per_iteration, 2),
            self.number(row.iterations, 2),
            format!("{:.1}", row.us_per_frame),
            format!("{:.1}", row.us_median),
            format!("{:.1}", row.us_p95),
            format!("{:.0}", row.fps),
            self.number(row.fps_with_input, 0),
            self.number(row.sr_5, 3),
            self.number(row.al_median, 3),
            row.frames.to_string(),
        ];
        if self.compared {
            cells.insert(1, row.program.clone());
            let (frame, iteration) = row.times(ours);
            let own = std::ptr::eq(ours, row);
            cells.push(self.number((!own).then_some(frame), 1));
            cells.push(self.number(iteration.filter(|_| !own), 1));
        }
        if let Some(target) = self.target {
            cells.push(match reaches(row, target) {
                Some(true) => "yes".to_owned(),
                Some(false) => "no".to_owned(),
                None => self.number(None, 0),
            });
        }
        cells
    }

    /// What stands below the table.
    fn notes(&self, groups: &[Vec<&BenchRow>]) -> String {
        let measured = self.measured;
        let mut text = String::new();
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
        text += &frame_counts(groups);
        if let Some(target) = self.target {
            let below = below(measured, target);
            if !below.is_empty() {
                text += &format!(
                    "\nfewer than {target} frames per second with input: {}\n",
                    below.join(", ")
                );
            }
        }
        let made = &measured.preparation;
        text += &format!(
            "\nbefore the updates, a frame: decoding {:.0} us, filter {} {:.0} us, pyramid {:.0} us\n{}\n",
            made.us_decode,
            made.filter,
            made.us_filter,
            made.us_pyramid,
            measured.machine.line()
        );
        if let Some(lead) = &measured.lead {
            let [low, high] = lead.interval;
            text += &format!(
                "\n{} is {:.2} times (95 % interval {low:.2} to {high:.2}) faster than {}\n",
                lead.fastest, lead.times, lead.next
            );
        }
        text
    }
}

/// Why rows differ in their number of frames; nothing where they do not.
fn frame_counts(groups: &[Vec<&BenchRow>]) -> String {
    let mut rows = groups.iter().flatten();
    let first = rows.next().map(|r| r.frames);
    if rows.all(|r| Some(r.frames) == first) {
        return String::new();
    }
    let name = |ours: &BenchRow, row: &BenchRow| match std::ptr::eq(ours, row) {
        true => row.tracker.clone(),
        false => format!("{} ({})", row.tracker, row.program),
    };
    let lost: Vec<String> = groups
        .iter()
        .flat_map(|group| group.iter().map(|row| (group[0], *row)))
        .filter(|(_, row)| row.lost > 0)
        .map(|(ours, row)| format!("{} {} of {}", name(ours, row), row.lost, row.lost + row.frames))
        .collect();
    let why = match lost.is_empty() {
        true => "other programs count the frames that they say".to_owned(),
        false => format!("updates without a result have no time: {}", lost.join(", ")),
    };
    format!("\nthe numbers of frames differ: {why}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_say_what_they_are_of() {
        let one = |sequence: &str, frames: usize| MeasuredSequence {
            sequence: sequence.to_owned(),
            frames,
            ..MeasuredSequence::default()
        };
        assert_eq!(subject(&[one("tmt/book", 60)]), "tmt: 1 sequence, 60 frames");
        let two = [one("tmt/book", 60), one("builtin/wall", 30)];
        assert_eq!(subject(&two), "builtin, tmt: 2 sequences, 90 frames");
    }

    #[test]
    fn numbers_of_frames_are_explained() {
        let row = |tracker: &str, frames: usize, lost: usize| BenchRow {
            tracker: tracker.to_owned(),
            program: "Other 1.0".to_owned(),
            frames,
            lost,
            ..BenchRow::default()
        };
        let (all, some, theirs) = (row("a", 9, 0), row("b", 7, 2), row("a", 8, 0));
        assert_eq!(frame_counts(&[vec![&all]]), "");
        assert_eq!(
            frame_counts(&[vec![&all], vec![&some]]),
            "\nthe numbers of frames differ: updates without a result have no time: b 2 of 9\n"
        );
        let text = frame_counts(&[vec![&all, &theirs]]);
        assert!(text.contains("other programs count"), "{text}");
        let lost = row("a", 5, 4);
        let text = frame_counts(&[vec![&all, &lost]]);
        assert!(text.contains("a (Other 1.0) 4 of 9"), "{text}");
    }
}
