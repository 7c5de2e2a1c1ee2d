//! The embedded dataset: the commands that make it, one per line in `datasets/builtin/commands.txt`.

use super::spec::{SynthError, SynthSpec};
use super::write::{Written, write_sequence};
use std::path::Path;

/// The recorded commands, one per line; lines that begin with `#` are comments.
pub fn builtin_commands() -> &'static str {
    include_str!("../../datasets/builtin/commands.txt")
}

fn specs() -> impl Iterator<Item = Result<(String, SynthSpec), SynthError>> {
    let lines = builtin_commands()
        .lines()
        .map(str::trim)
        .filter(|l| !l.is_empty() && !l.starts_with('#'));
    lines.map(SynthSpec::parse_command)
}

/// Specification of the embedded sequence called `name`; `None` if there is none.
pub fn builtin_spec(name: &str) -> Option<SynthSpec> {
    specs()
        .filter_map(Result::ok)
        .find(|(n, _)| n == name)
        .map(|(_, spec)| spec)
}

/// Renders every sequence of the embedded dataset into a folder of its own below `dir`, and `commands.txt`. Calls
/// `done` after each.
///
/// # Errors
/// Those of [`write_sequence`].
pub fn write_builtin(
    dir: &Path,
    force: bool,
    mut done: impl FnMut(&str, &Written),
) -> Result<(), SynthError> {
    for item in specs() {
        let (name, spec) = item?;
        done(&name, &write_sequence(&spec, &dir.join(&name), force)?);
    }
    let path = dir.join("commands.txt");
    let written = std::fs::write(&path, builtin_commands());
    written.map_err(|e| SynthError::Write {
        path,
        reason: e.to_string(),
    })
}
