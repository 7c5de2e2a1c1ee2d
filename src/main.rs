//! The program `mtf-eval`: the command line with everything that is built in.

use std::process::ExitCode;

fn main() -> ExitCode {
    mtf_eval::cli::main(mtf_eval::catalogue::Catalogue::builtin())
}
