//! The command line program: parse, run, exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    mtf_eval::panics::install_hook();
    // The hook has said what happened, in one line.
    std::panic::catch_unwind(mtf_eval::cli::main).unwrap_or(ExitCode::from(101))
}
