//! `mtf-eval list`: what exists.

use super::args::ListArgs;
use super::{Console, Outcome};

/// Prints what `args` asks for.
pub fn run(_args: &ListArgs, _console: &Console) -> Outcome {
    Ok(0)
}
