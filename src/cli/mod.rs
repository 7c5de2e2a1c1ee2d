//! The command line: arguments, what each command does with the library, messages and exit codes. Depends on everything;
//! nothing depends on it.
//!
//! A command is a file with its arguments and a function `run`, a variant of `Command` and a line of `dispatch` in
//! `command`. Arguments that commands share are in `args`, the grammars of their values in `values`.

mod args;
mod basin;
mod bench;
mod check;
mod command;
mod compare;
mod console;
mod data;
mod diagnose;
mod exit;
mod experiment;
mod list;
mod merge;
mod plan;
mod plot;
mod program;
mod progress;
mod recorded;
mod run;
mod score;
mod signals;
mod status;
pub mod synth;
mod top;
mod values;

use crate::catalogue::Catalogue;
use crate::panics;
use crate::report::text;
use clap::Parser;
use command::{Cli, dispatch};
use console::Console;
use program::Program;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

/// The whole program: parses the arguments of this process, does what they say with what `catalogue` holds, prints
/// results and messages, and returns the exit code. A panic is one line on stderr and exit code 101.
///
/// A program with models of its own is this and a registry:
///
/// ```no_run
/// fn main() -> std::process::ExitCode {
///     let registry = mtf::registry::Registry::builtin();
///     // registry.add_am::<MyModel>();
///     mtf_eval::cli::main(registry)
/// }
/// ```
pub fn main(catalogue: impl Into<Catalogue>) -> ExitCode {
    panics::install_hook();
    signals::limits_are_errors();
    let catalogue = catalogue.into();
    // The hook has said what happened, in one line.
    catch_unwind(AssertUnwindSafe(|| run_process(catalogue))).unwrap_or(ExitCode::from(exit::INTERNAL))
}

/// Ends the process because there is no more memory, with the exit code of a run that was stopped.
pub fn end_for_lack_of_memory() -> ! {
    std::process::exit(i32::from(exit::STOPPED))
}

fn run_process(catalogue: Catalogue) -> ExitCode {
    let words: Vec<_> = std::env::args_os().collect();
    let cli = match Cli::try_parse_from(&words) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version come as errors, too; clap knows which stream and code they take.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { exit::USAGE } else { 0 });
        }
    };
    let typed = words.iter().skip(1);
    let program = Program {
        catalogue,
        console: Console::new(&cli.messages),
        progress: cli.messages.progress,
        arguments: typed.map(|word| word.to_string_lossy().into_owned()).collect(),
    };
    match dispatch(cli.command, &program) {
        Ok(code) => code,
        Err(failure) => {
            program.console.error(&failure.to_string());
            for line in &failure.details {
                program.console.line(&format!("  {}", text::one_line(line)));
            }
            ExitCode::from(failure.code)
        }
    }
}
