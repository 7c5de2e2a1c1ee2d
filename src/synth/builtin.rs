//! The embedded dataset: the commands that make it, one per line in `datasets/builtin/commands.txt`.

use super::selection::Recipe;
use super::spec::{SynthError, SynthSpec};
use super::write::{Written, write_sequence};
use std::path::Path;

/// The recorded commands, one per line; lines that begin with `#` are comments.
pub fn builtin_commands() -> &'static str {
    include_str!("../../datasets/builtin/commands.txt")
}

/// Name and making of every embedded sequence, in the order of the commands.
///
/// # Errors
/// Those of [`Recipe::parse_command`].
pub fn builtin_recipes() -> Result<Vec<(String, Recipe)>, SynthError> {
    let lines = builtin_commands()
        .lines()
        .map(str::trim)
        .filter(|l| !l.is_empty() && !l.starts_with('#'));
    lines.map(Recipe::parse_command).collect()
}

/// Specification of the embedded sequence called `name`; `None` if there is none with frames of its own.
pub fn builtin_spec(name: &str) -> Option<SynthSpec> {
    let all = builtin_recipes().ok()?;
    match all.into_iter().find(|(n, _)| n == name)?.1 {
        Recipe::Rendered(spec) => Some(*spec),
        Recipe::Selected(_) => None,
    }
}

/// Writes every sequence of the embedded dataset into a folder of its own below `dir`, and `commands.txt`. Calls `done`
/// after each, with what was rendered; nothing is for one that takes another's frames.
///
/// # Errors
/// Those of [`write_sequence`].
pub fn write_builtin(
    dir: &Path,
    force: bool,
    mut done: impl FnMut(&str, Option<&Written>),
) -> Result<(), SynthError> {
    for (name, recipe) in builtin_recipes()? {
        let out = dir.join(&name);
        match recipe {
            Recipe::Rendered(spec) => done(&name, Some(&write_sequence(&spec, &out, force)?)),
            Recipe::Selected(selection) => {
                selection.write(&out, force)?;
                done(&name, None);
            }
        }
    }
    let path = dir.join("commands.txt");
    let written = std::fs::write(&path, builtin_commands());
    written.map_err(|e| SynthError::Write {
        path,
        reason: e.to_string(),
    })
}
