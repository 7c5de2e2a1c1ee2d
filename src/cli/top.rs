//! `mtf-eval top`: the best trackers of one or several runs.

use super::args::PickArgs;
use super::console::{print, print_data_line};
use super::exit::{self, Failure, Outcome};
use super::program::Program;
use super::values::threads;
use crate::judge::ranking::{Entrant, FPS, Field, parse_sort, ranked};
use crate::report::{Format, TableOptions, top};
use crate::run::{SoFar, pool, so_far};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

/// The best trackers of one or several runs, finished or not
///
/// Trackers of all runs are ranked together by a column over all frames, each with the 95 % interval of that over
/// sequences and its speed. `=` stands where a tracker is not told apart from the first. `--by tag` prints the numbers by
/// tag and the best tracker of each tag; `--best-per am` keeps the best tracker of each appearance model; `--pareto fps`
/// keeps those that no other beats in both accuracy and speed; `--under 2ms` those that are fast enough. Of a run that has
/// not got to its end, what has ended counts.
#[derive(clap::Args, Debug)]
pub struct TopArgs {
    /// Run directories
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// Which trackers.
    #[command(flatten)]
    pub pick: PickArgs,
    /// Column to rank by, best first: auc, sr_5, al_median, fps, ...
    #[arg(long, visible_alias = "metric", value_name = "COLUMN", default_value = "auc")]
    pub sort: String,
    /// How many trackers to print, in every format (0: all)
    #[arg(short = 'n', long = "top", value_name = "N", default_value = "20")]
    pub count: usize,
    /// Form of the result: a row per tracker; csv is one table: with --by, that of the groups
    #[arg(long, value_name = "FORMAT", default_value = "table")]
    pub format: Format,
    /// Worker threads [default: all cores]
    #[arg(short = 'j', long, value_name = "N", value_parser = threads)]
    pub threads: Option<usize>,
}

/// Runs the command.
///
/// # Errors
/// Directories that hold no run; nothing that passes.
pub fn run(args: &TopArgs, program: &Program) -> Outcome {
    let (console, metrics) = (&program.console, &program.catalogue.metrics);
    let sort = parse_sort(metrics, &args.sort).map_err(|e| Failure::usage(format!("--sort: {e}")))?;
    let options = TableOptions {
        format: args.format,
        top: args.count,
        colour: console.table_colour,
        pretty: console.pretty,
        pick: args.pick.pick(metrics, &sort)?,
        sort,
    };
    let pool = pool(args.threads.unwrap_or(0), &|text| console.warn(text))?;
    let runs: Vec<SoFar> = args
        .runs
        .iter()
        .map(|dir| Ok(so_far(dir, metrics, &pool)?))
        .collect::<Result<_, Failure>>()?;
    let fields: Vec<Field<'_>> = runs.iter().map(SoFar::field).collect();
    let entrants = ranked(&fields, &options.sort, &options.pick);
    if entrants.is_empty() {
        return Err(nothing(&fields, &options));
    }
    let other = other_data(&runs);
    let lines: Vec<String> = runs.iter().filter_map(SoFar::line).chain(other).collect();
    print(&pool.install(|| top(&entrants, &options, &lines)))?;
    for line in &lines {
        print_data_line(Some(line), args.format, console)?;
    }
    for run in &runs {
        let line = run.data.line().map(|line| format!("{}: {line}", run.name));
        print_data_line(line.as_deref(), args.format, console)?;
    }
    let by_speed = options.pick.is_by_speed() || options.sort == FPS;
    if by_speed && runs.iter().any(|run| run.disturbed) {
        console.note(
            "speeds are of trackers that ran beside each other; `mtf-eval bench` and `run -j 1` measure each alone",
        );
    }
    Ok(ExitCode::SUCCESS)
}

/// Why no tracker is left.
fn nothing(fields: &[Field<'_>], options: &TableOptions) -> Failure {
    let all = ranked(fields, FPS, &Default::default());
    let message = match (all.first(), options.pick.under) {
        (None, _) => "no unit has ended".to_owned(),
        (Some(Entrant { fps, .. }), _) if fps.is_nan() => "no tracker has a speed".to_owned(),
        (Some(first), Some(limit)) => format!(
            "no tracker takes less than {:.3} ms; the fastest, {}, takes {:.3} ms",
            1000.0 * limit,
            first.row.tracker.id,
            1000.0 / first.fps
        ),
        (Some(_), None) => "no tracker has the figure".to_owned(),
    };
    Failure::new(exit::NOTHING, message)
}

/// What is to be known where runs have other frames or ground truth of the same sequence.
fn other_data(runs: &[SoFar]) -> Option<String> {
    let mut known: BTreeMap<&str, (&str, &str)> = BTreeMap::new();
    for run in runs {
        for (sequence, print) in &run.fingerprints {
            let (first, name) = known.entry(sequence).or_insert((print, &run.name));
            if first != print {
                return Some(format!(
                    "{name} and {} have other frames or ground truth of {sequence}: their figures do not compare",
                    run.name
                ));
            }
        }
    }
    None
}
