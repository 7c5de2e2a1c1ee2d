//! What every command has to work with.

use super::args::ProgressMode;
use super::console::Console;
use crate::catalogue::Catalogue;

/// The program as it was started.
pub struct Program {
    /// What it can look up.
    pub catalogue: Catalogue,
    /// Where its messages go.
    pub console: Console,
    /// How it shows progress.
    pub progress: ProgressMode,
    /// Its arguments as they were typed, without its name.
    pub arguments: Vec<String>,
}
