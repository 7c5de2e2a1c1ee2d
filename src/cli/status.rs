//! `mtf-eval status`: how far run directories are.

use super::args::TableArgs;
use super::console::{clock, print, print_data_line};
use super::exit::{self, Failure, Outcome};
use super::program::Program;
use crate::report::{Format, render, table};
use crate::run::{SoFar, pool, so_far};
use crate::store::status::{Activity, Status, status};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `status`.
#[derive(clap::Args, Clone, Debug)]
pub struct StatusArgs {
    /// Run directories
    #[arg(value_name = "DIR", required = true)]
    pub dirs: Vec<PathBuf>,
    /// How many missing and failed units (one tracker on one sequence from one start) to name
    #[arg(long, value_name = "N", default_value = "0")]
    pub show: usize,
    /// Print the results so far instead, of a run that goes on, was stopped or has ended (of one directory)
    #[arg(long)]
    pub table: bool,
    /// How to print.
    #[command(flatten)]
    pub form: TableArgs,
}

/// Runs the command.
///
/// # Errors
/// A directory that is no run directory, or cannot be read.
pub fn run(args: &StatusArgs, program: &Program) -> Outcome {
    let console = &program.console;
    if args.table {
        return results_so_far(args, program);
    }
    let format = args.form.format;
    let all: Vec<(String, Status)> = args
        .dirs
        .iter()
        .map(|dir| Ok((dir.display().to_string(), status(dir)?)))
        .collect::<Result<_, Failure>>()?;
    let header = [
        "directory",
        "state",
        "shard",
        "units",
        "done",
        "failed",
        "damaged",
        "missing",
        "frames",
        "left",
        "last unit",
    ];
    let rows: Vec<Vec<String>> = all.iter().map(|(dir, s)| row(dir, s)).collect();
    match format {
        Format::Json => {
            let value = |(dir, s): &(String, Status)| {
                let mut value = serde_json::to_value(s).map_err(Failure::usage)?;
                value["directory"] = dir.as_str().into();
                Ok(value)
            };
            let list: Vec<serde_json::Value> = all.iter().map(value).collect::<Result<_, Failure>>()?;
            print(&console.json(&list))?;
        }
        format => print(&render(&header, &rows, format, console.table_colour))?,
    }
    for (dir, s) in &all {
        let line = s.data.line().map(|line| format!("{dir}: {line}"));
        print_data_line(line.as_deref(), format, console)?;
        for path in &s.altered {
            console.error(&format!(
                "{}: not as the run wrote it; run its command again to make it anew",
                path.display()
            ));
        }
        let holder = s.holder.as_deref().unwrap_or_default();
        match s.activity {
            Activity::Idle => {}
            Activity::Running => console.note(&format!("{dir}: held by {holder}")),
            Activity::Elsewhere => console.note(&format!(
                "{dir}: held by {holder}, which cannot be seen from here"
            )),
            Activity::Dead => console.note(&format!("{dir}: {holder} was killed; run again to go on")),
        }
        for path in s.unusable.iter().take(args.show.max(1)) {
            console.warn(&format!(
                "{}: damaged or gone, its unit will be tracked again",
                path.display()
            ));
        }
        for unit in s.missing_units.iter().take(args.show) {
            console.note(&format!("missing: {unit}"));
        }
        for (unit, reason) in s.failures.iter().take(args.show) {
            console.note(&format!("failed: {unit}: {reason}"));
        }
    }
    let any = |count: fn(&Status) -> usize| all.iter().any(|(_, s)| count(s) > 0);
    Ok(ExitCode::from(
        match (any(|s| s.missing + s.altered.len()), any(|s| s.failed)) {
            (true, _) => exit::INCOMPLETE,
            (false, true) => exit::FAILED,
            (false, false) => 0,
        },
    ))
}

/// Prints the table of what has ended, and how much of the run that is.
fn results_so_far(args: &StatusArgs, program: &Program) -> Outcome {
    let (metrics, console) = (&program.catalogue.metrics, &program.console);
    let [dir] = &args.dirs[..] else {
        return Err(Failure::usage("--table takes one run directory"));
    };
    let options = args.form.options(metrics, console)?;
    let pool = pool(0, &|text| console.warn(text))?;
    let so_far = so_far(dir, metrics, &pool)?;
    print(&table(&so_far.results, &so_far.speeds, &options))?;
    print_data_line(Some(&extent(&so_far)), options.format, console)?;
    Ok(ExitCode::from(match so_far.ended < so_far.units {
        true => exit::INCOMPLETE,
        false if so_far.results.failed_runs() > 0 => exit::FAILED,
        false => 0,
    }))
}

/// How much of a run is in its table.
fn extent(so_far: &SoFar) -> String {
    let SoFar {
        units,
        ended,
        trackers,
        whole_trackers,
        ..
    } = so_far;
    match ended < units {
        true => format!(
            "partial: {ended} of {units} units are in it, all units of {whole_trackers} of {trackers} trackers; ranks may \
             change"
        ),
        false => format!("complete: all {units} units are in it"),
    }
}

fn row(dir: &str, s: &Status) -> Vec<String> {
    let state = match (s.activity, s.missing) {
        (Activity::Running, _) => "running",
        (Activity::Elsewhere, _) => "elsewhere",
        (Activity::Dead, _) => "dead",
        (Activity::Idle, 0) => "complete",
        (Activity::Idle, _) => "stopped",
    };
    let percent = 100.0 * s.frames_done as f64 / s.frames.max(1) as f64;
    vec![
        dir.to_owned(),
        state.to_owned(),
        s.shard.clone().unwrap_or_default(),
        s.units.to_string(),
        s.done.to_string(),
        s.failed.to_string(),
        s.damaged.to_string(),
        s.missing.to_string(),
        format!("{percent:.1} %"),
        s.left_seconds.map_or(String::new(), clock),
        s.last.clone().unwrap_or_default(),
    ]
}
