//! `mtf-eval status`: how far run directories are.

use super::console::{print, print_data_line};
use super::exit::{self, Failure, Outcome};
use super::program::Program;
use crate::report::{Format, render};
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
    /// Form of the result: a row per directory; json: an array of objects (one line; --pretty indents it)
    #[arg(long, value_name = "FORMAT", default_value = "table")]
    pub format: Format,
}

/// Runs the command.
///
/// # Errors
/// A directory that is no run directory, or cannot be read.
pub fn run(args: &StatusArgs, program: &Program) -> Outcome {
    let console = &program.console;
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
    match args.format {
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
        print_data_line(line.as_deref(), args.format, console)?;
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

/// Hours, minutes and seconds.
fn clock(seconds: f64) -> String {
    let s = seconds.round() as u64;
    match s {
        3600.. => format!("{} h {:02} min", s / 3600, s % 3600 / 60),
        60.. => format!("{} min {:02} s", s / 60, s % 60),
        _ => format!("{s} s"),
    }
}
