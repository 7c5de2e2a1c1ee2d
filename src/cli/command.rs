//! The program's arguments as a whole: its commands, and what each of them calls.

use super::args::Messages;
use super::console::print;
use super::exit::{self, Failure, Outcome};
use super::program::Program;
use super::{
    basin, bench, check, compare, data, diagnose, list, merge, plan, plot, run, score, status, synth, top,
};
use clap::{CommandFactory, Parser, Subcommand};
use std::process::ExitCode;

/// Evaluates registration-based trackers: every search method x appearance model x state space model, on image
/// sequences with ground-truth corners.
#[derive(Debug, Parser)]
#[command(name = "mtf-eval", version, propagate_version = true, max_term_width = 100)]
#[command(after_help = exit::help())]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Messages.
    #[command(flatten)]
    pub messages: Messages,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Track every requested combination over every sequence, write a run directory, print a table
    Run(Box<run::RunArgs>),
    /// Say what an experiment contains, what it costs and how it is cut into shards
    Plan(Box<plan::PlanArgs>),
    /// Say how far a run directory is: exit 0 complete, 20 something failed, 21 something is missing
    Status(status::StatusArgs),
    /// Join the run directories of shards, or of different runs, into one: exit 21 and nothing written when one is incomplete
    Merge(merge::MergeArgs),
    /// The best trackers of one or several runs, finished or not
    Top(top::TopArgs),
    /// Draw the success plot of one or several runs
    Plot(plot::PlotArgs),
    /// Compare a run with a recorded baseline: exit 0 or 10
    Check(check::CheckArgs),
    /// Score what other programs have recorded, with the tables and files of a run
    Score(Box<score::ScoreArgs>),
    /// Compare runs: what changed, and whether it is more than chance
    Compare(compare::CompareArgs),
    /// Render an image sequence with exact ground truth, from any image or a texture drawn by code
    Synth(Box<synth::SynthArgs>),
    /// Compare analytic derivatives with central differences: exit 0 or 10
    Diagnose(diagnose::DiagnoseArgs),
    /// Measure how far from the truth trackers may start
    Basin(basin::BasinArgs),
    /// Measure the speed of trackers on one core
    Bench(Box<bench::BenchArgs>),
    /// What exists: models, trackers, parameters, metrics, data
    List(list::ListArgs),
    /// Look into data sets and find what is wrong with them
    Data(data::DataArgs),
    /// Print a completion script for a shell
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page (roff)
    Man,
}

/// Does what the command says.
///
/// # Errors
/// What keeps it from that, with its exit code.
pub fn dispatch(command: Command, program: &Program) -> Outcome {
    match command {
        Command::Run(args) => run::run(&args, program),
        Command::Plan(args) => plan::run(&args, program),
        Command::Status(args) => status::run(&args, program),
        Command::Merge(args) => merge::run(&args, program),
        Command::Top(args) => top::run(&args, program),
        Command::Plot(args) => plot::run(&args, program),
        Command::List(args) => list::run(&args, program),
        Command::Data(args) => data::run(&args, program).or_else(exit::of_chain),
        Command::Check(args) => {
            let again = |words: &[String]| Ok(run::repeat(words, program)?);
            check::run(&args, &program.catalogue.metrics, &program.console, &again).or_else(exit::of_chain)
        }
        Command::Score(args) => score::run(&args, program),
        Command::Compare(args) => compare::run(&args, program),
        Command::Synth(args) => synth::run(&args, &|line| program.console.line(line)).or_else(exit::of_chain),
        Command::Diagnose(args) => diagnose::run(&args, program),
        Command::Basin(args) => basin::run(&args, program),
        Command::Bench(args) => bench::run(&args, program),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "mtf-eval", &mut script);
            print(&String::from_utf8_lossy(&script)).map(|()| ExitCode::SUCCESS)
        }
        Command::Man => print(&manual()?).map(|()| ExitCode::SUCCESS),
    }
}

/// The manual page: the program, then each subcommand.
fn manual() -> Result<String, Failure> {
    let mut command = Cli::command();
    command.build();
    let mut roff = Vec::new();
    let pages = std::iter::once(command.clone()).chain(command.get_subcommands().cloned());
    for page in pages.filter(|page| page.get_name() != "help") {
        clap_mangen::Man::new(page)
            .render(&mut roff)
            .map_err(Failure::usage)?;
    }
    Ok(String::from_utf8_lossy(&roff).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    /// Names of values that are no counts, and so have a unit.
    const MEASURED: [&str; 8] = ["X", "F", "SIGMA", "RATE|%", "AREA|%", "RATE", "TIME", "SECONDS"];
    /// Units, and words of numbers that have none.
    const UNITS: [&str; 11] = [
        "px",
        "gray level",
        "share",
        "factor",
        ", s",
        "degrees",
        "us (",
        "plain number",
        "0 to 1",
        "at most 1",
        "distance from",
    ];

    #[test]
    fn numbers_have_units() {
        let mut program = Cli::command();
        program.build();
        for command in program.get_subcommands() {
            let takes_values = |arg: &&clap::Arg| arg.get_action().takes_values();
            for arg in command.get_arguments().filter(takes_values) {
                let name = arg
                    .get_value_names()
                    .and_then(|names| names.first())
                    .map_or("", |n| n.as_str());
                let help = arg.get_help().map_or(String::new(), ToString::to_string);
                let told = !MEASURED.contains(&name) || UNITS.iter().any(|unit| help.contains(unit));
                assert!(told, "{} --{}: {help}", command.get_name(), arg.get_id());
            }
        }
    }

    #[test]
    fn lists_may_be_joined_or_repeated() {
        let cli = Cli::parse_from(["mtf-eval", "run", "--sm", "esm,fclk", "--sm", "nn", "data"]);
        let Command::Run(args) = cli.command else { panic!() };
        assert_eq!(args.experiment.trackers.sm, ["esm", "fclk", "nn"]);
        assert_eq!(args.experiment.data, [PathBuf::from("data")]);
    }
}
