//! `mtf-eval data`: looks into datasets and finds what is wrong with them.

use super::args::{SelectionArgs, TruthArgs};
use super::console::print;
use super::exit::{self, Failure};
use super::experiment::{sequences, warn_of};
use super::program::Program;
use super::values::one_of;
use crate::dataset::convert::{self, TARGETS, Target};
use crate::dataset::{self, Dataset, LoadOptions, Severity};
use crate::report::{Format, render, text::one_line};
use anyhow::Result;
use clap::builder::PossibleValue;
use clap::{Args, Subcommand, ValueEnum};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Find what is wrong with datasets, or show what they hold
#[derive(Args, Clone, Debug)]
pub struct DataArgs {
    #[command(subcommand)]
    command: DataCommand,
}

#[derive(Clone, Debug, Subcommand)]
enum DataCommand {
    /// Find every fault: one line `path:line: what; remedy` each. Exit code 2 when there are any
    Check {
        /// Datasets: folders, or `builtin` for the embedded one
        #[arg(value_name = "DATA", default_value = dataset::BUILTIN)]
        paths: Vec<PathBuf>,
        /// How ground truth is read.
        #[command(flatten)]
        truth: TruthArgs,
    },
    /// Write a dataset in the form of another; frames are copied as they are. Says what the form has no place for
    Convert {
        /// Dataset: a folder, or `builtin` for the embedded one
        #[arg(value_name = "DATA")]
        path: PathBuf,
        /// The form
        #[arg(long, value_name = "FORM", value_parser = one_of(TARGETS.iter().map(|t| PossibleValue::new(t.name()).help(t.summary())), target))]
        to: &'static dyn Target,
        /// The folder to make
        #[arg(value_name = "OUT")]
        out: PathBuf,
        /// Which sequences and frames.
        #[command(flatten)]
        selection: SelectionArgs,
    },
    /// Show sequences with their format, frames, size, tags and fingerprint
    Info {
        /// Datasets: folders, or `builtin` for the embedded one
        #[arg(value_name = "DATA", default_value = dataset::BUILTIN)]
        paths: Vec<PathBuf>,
        /// Form of the list: table, or json: a document with a row per sequence (one line; --pretty indents it)
        #[arg(long, value_enum, default_value_t)]
        format: InfoFormat,
        /// Decode every frame and cover its pixels in the fingerprint
        #[arg(long)]
        paranoid: bool,
        /// How ground truth is read.
        #[command(flatten)]
        truth: TruthArgs,
    },
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum InfoFormat {
    #[default]
    Table,
    Json,
}

/// Runs `data`. Results go to stdout, messages to stderr.
pub fn run(args: &DataArgs, program: &Program) -> Result<ExitCode> {
    match &args.command {
        DataCommand::Check { paths, truth } => check(paths, &options(truth, program), program),
        DataCommand::Convert {
            path,
            to,
            out,
            selection,
        } => Ok(convert(path, *to, out, selection, program)?),
        DataCommand::Info {
            paths,
            format,
            paranoid,
            truth,
        } => info(paths, *format, *paranoid, &options(truth, program), program),
    }
}

fn target(name: &str) -> Option<&'static dyn Target> {
    TARGETS.into_iter().find(|target| target.name() == name)
}

fn convert(
    path: &Path,
    target: &dyn Target,
    out: &Path,
    selection: &SelectionArgs,
    program: &Program,
) -> Result<ExitCode, Failure> {
    let chosen = sequences(&[path.to_path_buf()], selection, program)?;
    let done = convert::convert(&chosen.sequences, target, out).map_err(Failure::usage)?;
    let mut by_loss: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    done.lost
        .iter()
        .for_each(|(sequence, lost)| by_loss.entry(lost).or_default().push(sequence));
    for (lost, sequences) in by_loss {
        let more = match sequences.len() {
            1 => String::new(),
            n => format!(" and {} more", n - 1),
        };
        program.console.warn(&format!("{}{more}: {lost}", sequences[0]));
    }
    let plural = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let (sequences, frames) = (plural(done.sequences, "sequence"), plural(done.frames, "frame"));
    program.console.note(&format!(
        "{sequences}, {frames} in {} as {}",
        out.display(),
        target.name()
    ));
    Ok(ExitCode::SUCCESS)
}

fn options(truth: &TruthArgs, program: &Program) -> LoadOptions {
    LoadOptions {
        formats: program.catalogue.formats.clone(),
        reading: truth.reading(),
        strict: truth.strict,
        ..LoadOptions::default()
    }
}

fn check(paths: &[PathBuf], options: &LoadOptions, program: &Program) -> Result<ExitCode> {
    let (mut sequences, mut frames, mut errors, mut warnings) = (0, 0, 0, 0);
    for path in paths {
        let checked = dataset::check(path, options);
        sequences += checked.sequences;
        frames += checked.frames;
        for fault in &checked.faults {
            match fault.severity {
                Severity::Error => errors += 1,
                Severity::Warning => warnings += 1,
            }
            print(&format!("{}\n", one_line(&fault.to_string())))?;
        }
    }
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    program.console.note(&format!(
        "{}, {}: {}, {}",
        count(sequences, "sequence"),
        count(frames, "frame"),
        count(errors, "error"),
        count(warnings, "warning")
    ));
    Ok(if errors == 0 {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(exit::USAGE)
    })
}

fn info(
    paths: &[PathBuf],
    format: InfoFormat,
    paranoid: bool,
    options: &LoadOptions,
    program: &Program,
) -> Result<ExitCode> {
    let mut sets = Vec::new();
    for path in paths {
        let set = dataset::load(path, options)?;
        warn_of(&set, &program.console);
        let rows = rows(&set, paranoid)?;
        sets.push((set.name, rows));
    }
    match format {
        InfoFormat::Json => {
            let sets: Vec<Value> = sets
                .iter()
                .map(|(name, rows)| json!({ "name": name, "sequences": rows }))
                .collect();
            let document = json!({ "schema_version": 1, "datasets": sets });
            print(&program.console.json(&document))?;
        }
        InfoFormat::Table => print(&table(&sets, program.console.table_colour))?,
    }
    Ok(ExitCode::SUCCESS)
}

fn rows(set: &Dataset, paranoid: bool) -> Result<Vec<Value>> {
    let row = |s: &dataset::Sequence| -> Result<Value> {
        Ok(json!({
            "dataset": s.dataset(),
            "sequence": s.name(),
            "format": s.format(),
            "frames": s.len(),
            "annotated": s.annotated(),
            "absent": s.absent(),
            "origin": s.origin(),
            "box": s.boxes(),
            "width": s.width(),
            "height": s.height(),
            "tags": s.tags(),
            "fingerprint": if paranoid { s.fingerprint_of_pixels()? } else { s.fingerprint() },
        }))
    };
    set.sequences.iter().map(row).collect()
}

fn table(sets: &[(String, Vec<Value>)], colour: bool) -> String {
    let header = [
        "dataset",
        "sequence",
        "format",
        "frames",
        "annotated",
        "absent",
        "origin",
        "box",
        "size",
        "fingerprint",
        "tags",
    ];
    let text = |v: &Value| v.as_str().map_or_else(|| v.to_string(), String::from);
    let cells = |row: &Value| {
        let tags: Vec<String> = row["tags"].as_array().into_iter().flatten().map(text).collect();
        vec![
            text(&row["dataset"]),
            text(&row["sequence"]),
            text(&row["format"]),
            text(&row["frames"]),
            text(&row["annotated"]),
            text(&row["absent"]),
            text(&row["origin"]),
            row["box"].as_str().unwrap_or("-").into(),
            format!("{}x{}", row["width"], row["height"]),
            // Enough to tell data apart at a glance; JSON has all of it.
            text(&row["fingerprint"]).chars().take(12).collect(),
            tags.join(" "),
        ]
    };
    let rows: Vec<Vec<String>> = sets.iter().flat_map(|(_, rows)| rows).map(cells).collect();
    render(&header, &rows, Format::Table, colour)
}
