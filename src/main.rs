//! The program `mtf-eval`: the command line with everything that is built in.

mod memory;

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: memory::Checked = memory::Checked;

fn main() -> ExitCode {
    mtf_eval::cli::main(mtf_eval::catalogue::Catalogue::builtin())
}
