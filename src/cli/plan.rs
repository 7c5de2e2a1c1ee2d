//! `mtf-eval plan`: what an experiment contains, what it costs, how it is cut.

use super::args::ExperimentArgs;
use super::console::print;
use super::exit::Outcome;
use super::experiment::{experiment, refused};
use super::program::Program;
use crate::plan::{Cut, Plan, Shard, Sharding};
use crate::report::{Format, render};
use crate::run::cost::{self, Cost};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::process::ExitCode;

/// Arguments of `plan`.
#[derive(clap::Args, Clone, Debug)]
pub struct PlanArgs {
    /// What would be run.
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    /// Estimate core-hours from N units (one tracker on one sequence), tracked for a few frames each
    #[arg(long, value_name = "N", default_value = "0", help_heading = "Plan")]
    pub measure: usize,
    /// Show how it would be cut: `N` or `slice:N` (equal cost), `hash:N` (stable when the plan grows)
    #[arg(long, value_name = "CUT", value_parser = cut, help_heading = "Plan")]
    pub shards: Option<(Cut, u32)>,
    /// List the trackers, too
    #[arg(long, help_heading = "Plan")]
    pub list: bool,
    /// List the combinations that cannot work, with the reason of each, and nothing else
    #[arg(long, help_heading = "Plan", conflicts_with_all = ["measure", "shards", "list"])]
    pub refused: bool,
    /// Form of the totals, and of the shards (--shards) and trackers (--list) below them
    ///
    /// json: one object with the same under `shards` and `list` (an array with --refused), on one line; --pretty indents it.
    #[arg(long, value_name = "FORMAT", default_value = "table", help_heading = "Plan")]
    pub format: Format,
}

/// How to cut a plan: `N`, `slice:N` or `hash:N`.
fn cut(text: &str) -> Result<(Cut, u32), String> {
    let (name, count) = text.trim().split_once(':').unwrap_or(("slice", text.trim()));
    let cut: Option<Cut> = name.parse().ok();
    cut.zip(count.parse().ok().filter(|n| (1..=1_000_000).contains(n)))
        .ok_or_else(|| "expected a number of shards: N, slice:N or hash:N".into())
}

/// One part of a plan.
#[derive(Clone, Default)]
struct Part {
    units: usize,
    frames: u64,
    sequences: BTreeSet<u32>,
}

/// Runs the command.
///
/// # Errors
/// Wrong arguments or experiment file, unusable data, nothing selected.
pub fn run(args: &PlanArgs, program: &Program) -> Outcome {
    if args.refused {
        let refused = refused(&args.experiment, program)?;
        if args.format == Format::Json {
            let one = |(id, reason)| json!({"combination": id, "reason": reason});
            let all: Value = refused.into_iter().map(one).collect();
            print(&format!("{all:#}\n"))?;
            return Ok(ExitCode::SUCCESS);
        }
        let rows: Vec<Vec<String>> = refused.into_iter().map(|(id, why)| vec![id, why]).collect();
        let header = ["combination", "reason"];
        print(&render(&header, &rows, args.format, program.console.table_colour))?;
        return Ok(ExitCode::SUCCESS);
    }
    let request = experiment(&args.experiment, Vec::new(), program)?;
    let plan = request.plan()?;
    let cost = match args.measure {
        0 => None,
        n => Some(cost::measure(&request, n)?),
    };
    let parts = args.shards.map(|(cut, count)| {
        let sharding = Sharding::new(&plan, cut, count);
        let mut parts = vec![Part::default(); count as usize];
        for unit in plan.units() {
            let part = &mut parts[sharding.of(&unit) as usize - 1];
            part.units += 1;
            part.frames += plan.unit_frames(&unit);
            part.sequences.insert(unit.sequence);
        }
        let name = move |k: usize| Shard {
            cut,
            index: k as u32 + 1,
            count,
        };
        (0..).map(name).zip(parts).collect::<Vec<_>>()
    });
    let parts = parts.unwrap_or_default();
    let hours = |frames: u64, units: usize| {
        cost.as_ref()
            .map(|e| e.seconds(units as f64, frames as f64) / 3600.0)
    };
    let totals = totals(&plan, cost.as_ref());
    if args.format == Format::Json {
        let mut value: Map<String, Value> = totals.into_iter().map(|(k, v, _)| (k.into(), v)).collect();
        let shard = |(shard, part): &(Shard, Part)| {
            json!({
                "shard": shard.to_string(), "units": part.units, "frames": part.frames,
                "sequences": part.sequences.len(), "core_hours": hours(part.frames, part.units),
            })
        };
        value.insert("shards".into(), parts.iter().map(shard).collect());
        if args.list {
            value.insert(
                "list".into(),
                plan.trackers.iter().map(|t| t.id.clone()).collect(),
            );
        }
        print(&program.console.json(&value))?;
        return Ok(ExitCode::SUCCESS);
    }
    let table = |header: &[&str], rows: &[Vec<String>]| {
        render(header, rows, args.format, program.console.table_colour)
    };
    let rows: Vec<Vec<String>> = totals
        .into_iter()
        .map(|(k, _, text)| vec![k.replace('_', " "), text])
        .collect();
    let mut text = table(&["plan", ""], &rows);
    if !parts.is_empty() {
        let row = |(shard, part): &(Shard, Part)| {
            vec![
                shard.to_string(),
                part.units.to_string(),
                part.frames.to_string(),
                part.sequences.len().to_string(),
                hours(part.frames, part.units).map_or(String::new(), |h| format!("{h:.2}")),
            ]
        };
        let rows: Vec<Vec<String>> = parts.iter().map(row).collect();
        text += "\n";
        text += &table(&["shard", "units", "frames", "sequences", "core-hours"], &rows);
    }
    if args.list {
        text += "\n";
        let rows: Vec<Vec<String>> = plan.trackers.iter().map(|t| vec![t.id.clone()]).collect();
        text += &table(&["tracker"], &rows);
    }
    print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// Figures of the whole plan: name, value, text.
fn totals(plan: &Plan, cost: Option<&Cost>) -> Vec<(&'static str, Value, String)> {
    let plain = |name, value: u64| (name, Value::from(value), value.to_string());
    let datasets: BTreeSet<&str> = plan.sequences.iter().map(|s| s.dataset.as_str()).collect();
    let mut rows = vec![
        plain("trackers", plan.trackers.len() as u64),
        plain("datasets", datasets.len() as u64),
        plain("sequences", plan.sequences.len() as u64),
        (
            "protocol",
            plan.protocol.to_string().into(),
            plan.protocol.to_string(),
        ),
        plain("starts", plan.passes().len() as u64),
        plain("units", plan.len() as u64),
        plain("frames", plan.frames()),
    ];
    if let Some(e) = cost {
        let hours = e.seconds(plan.len() as f64, plan.frames() as f64) / 3600.0;
        let error = e.relative_error() * hours;
        rows.push(plain("measured_units", e.units as u64));
        rows.push((
            "core_hours",
            json!({"estimate": hours, "standard_error": error}),
            format!("{hours:.3} +- {error:.3}"),
        ));
        rows.push((
            "init_ms",
            (1e3 * e.init).into(),
            format!("{:.2} per unit", 1e3 * e.init),
        ));
        rows.push((
            "update_ms",
            (1e3 * e.update).into(),
            format!("{:.3} per frame", 1e3 * e.update),
        ));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cuts_are_named() {
        assert_eq!(cut("16"), Ok((Cut::Slice, 16)));
        assert_eq!(cut("hash:3"), Ok((Cut::Hash, 3)));
        assert!(["", "0", "x:3", "hash:"].iter().all(|s| cut(s).is_err()));
    }
}
