//! `mtf-eval plot`: the success plot of one or several runs.

use super::exit::{Failure, Outcome};
use super::program::Program;
use crate::judge::ranking::{Field, together};
use crate::report::{About, success_svg};
use crate::run::{SoFar, pool, so_far};
use crate::store::{Durable, FileError, StoreError, write_atomic};
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `plot`.
#[derive(clap::Args, Debug)]
pub struct PlotArgs {
    /// Run directories, finished or not; of several, trackers are named with their run
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// The picture to write
    #[arg(short, long, value_name = "FILE.svg")]
    pub out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Directories that hold no run; a picture that cannot be drawn or written.
pub fn run(args: &PlotArgs, program: &Program) -> Outcome {
    let (console, metrics) = (&program.console, &program.catalogue.metrics);
    let pool = pool(0, &|text| console.warn(text))?;
    let runs: Vec<SoFar> = args
        .runs
        .iter()
        .map(|dir| Ok(so_far(dir, metrics, &pool)?))
        .collect::<Result<_, Failure>>()?;
    let fields: Vec<Field<'_>> = runs.iter().map(SoFar::field).collect();
    let svg = success_svg(&together(&fields), &About::default().title).map_err(Failure::usage)?;
    let write = |out: &mut dyn Write| out.write_all(svg.as_bytes());
    write_atomic(&args.out, Durable::Now, write)
        .map_err(|e| StoreError::from(FileError::io(&args.out, e)))?;
    runs.iter()
        .filter_map(SoFar::line)
        .for_each(|line| console.note(&line));
    Ok(ExitCode::SUCCESS)
}
