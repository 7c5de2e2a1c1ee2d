//! The command line program: parse, run, exit code.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    mtf_eval::eval::panics::install_hook();
    // The hook has said what happened, in one line.
    std::panic::catch_unwind(cli::main).unwrap_or(ExitCode::from(101))
}
