//! `mtf-eval merge`: joins the run directories of shards, or of different runs.

use super::args::TableArgs;
use super::exit::{self, Failure, Outcome};
use super::program::Program;
use super::progress::Progress;
use super::run::show;
use super::values::threads;
use crate::run::merge::{MergeRequest, Merged, merge};
use serde_json::Map;
use std::path::PathBuf;

/// Arguments of `merge`.
#[derive(clap::Args, Clone, Debug)]
pub struct MergeArgs {
    /// The run directory to make; what was merged into it before is kept
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// Run directories, in any order: shards of one run, or with --union runs of different trackers, sequences or protocols
    #[arg(value_name = "SHARD", required = true)]
    pub shards: Vec<PathBuf>,
    /// Join finished runs of different trackers, sequences or protocols
    ///
    /// They are of the same settings, seed and filter. Nothing is made up: a tracker has rows for the sequences and protocols
    /// that it was run on. What two runs share must have the same result in both.
    #[arg(long)]
    pub union: bool,
    /// Discard what OUT holds
    #[arg(long)]
    pub force: bool,
    /// Join results of different builds of the program
    #[arg(long)]
    pub mix_builds: bool,
    /// How many missing units (one tracker on one sequence from one start) to name
    #[arg(long, value_name = "N", default_value = "10")]
    pub show: usize,
    /// Worker threads [default: all cores]
    #[arg(short = 'j', long, value_name = "N", value_parser = threads)]
    pub threads: Option<usize>,
    /// How to print the result.
    #[command(flatten)]
    pub table: TableArgs,
}

/// Runs the command.
///
/// # Errors
/// Directories that are no runs, are of different runs, are in use or incomplete.
pub fn run(args: &MergeArgs, program: &Program) -> Outcome {
    let catalogue = &program.catalogue;
    // Before anything is read.
    args.table.options(&catalogue.metrics, &program.console)?;
    let request = MergeRequest {
        parts: args.shards.clone(),
        out: args.out.clone(),
        union: args.union,
        force: args.force,
        mix_builds: args.mix_builds,
        metrics: catalogue.metrics.clone(),
        exporters: catalogue.exporters.clone(),
        threads: args.threads.unwrap_or(0),
        host: Map::new(),
    };
    let progress = Progress::new(&program.console, program.progress);
    match merge(&request, &progress)? {
        Merged::Complete(report) => show(&report, &args.table, program),
        Merged::Incomplete(missing) => {
            let lacking = missing.missing.len();
            let message = format!(
                "incomplete: {lacking} of {} units (one tracker on one sequence each) are missing",
                missing.units
            );
            let mut failure = Failure::new(exit::INCOMPLETE, message);
            let shards = missing
                .shards
                .iter()
                .map(|(shard, count)| format!("{shard} lacks {count}"));
            failure.details.extend(shards);
            let unusable = missing.unusable.iter().take(args.show);
            failure
                .details
                .extend(unusable.map(|path| format!("{}: damaged, gone or cannot be read", path.display())));
            failure
                .details
                .extend(missing.missing.iter().take(args.show).cloned());
            if lacking > args.show {
                failure.details.push(format!("and {} more", lacking - args.show));
            }
            Err(failure)
        }
    }
}
