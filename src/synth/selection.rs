//! Sequences that are every K-th frame of another: a folder with nothing but `meta.json` (`frames_of`, `step`, `tags`), which
//! the dataset layer reads.

use super::options::{Command, quoted, tags};
use super::spec::{SynthError, SynthSpec};
use super::write::make_folder;
use std::path::Path;

/// Every `step`-th frame of the sequence `of` in the same folder.
#[derive(Clone, Debug, PartialEq)]
pub struct Selection {
    /// Name of the other sequence.
    pub of: String,
    /// Frames of the other from one frame to the next.
    pub step: usize,
    /// What is hard about the sequence.
    pub tags: Vec<String>,
}

/// What a recorded command makes.
#[derive(Clone, Debug, PartialEq)]
pub enum Recipe {
    /// A sequence with frames of its own.
    Rendered(Box<SynthSpec>),
    /// One with another's.
    Selected(Selection),
}

impl Recipe {
    /// Reads a command written by [`SynthSpec::command`] or [`Selection::command`]: the output folder and what is put there.
    ///
    /// # Errors
    /// Those of [`SynthSpec::parse_command`] and [`Selection::new`].
    pub fn parse_command(line: &str) -> Result<(String, Recipe), SynthError> {
        let command = Command::parse(line)?;
        let Some(of) = command.value("frames-of") else {
            let (out, spec) = SynthSpec::parse_command(line)?;
            return Ok((out, Recipe::Rendered(Box::new(spec))));
        };
        let [step, tags] = ["step", "tags"].map(|name| command.value(name));
        if command.options.len() != 1 + usize::from(step.is_some()) + usize::from(tags.is_some()) {
            return Err(SynthError::BadCommand(line.into()));
        }
        let selection = Selection::new(of, step, tags)?;
        Ok((command.out, Recipe::Selected(selection)))
    }

    /// Words that say what is hard about it.
    pub fn tags(&self) -> &[String] {
        match self {
            Recipe::Rendered(spec) => &spec.tags,
            Recipe::Selected(selection) => &selection.tags,
        }
    }
}

impl Selection {
    /// The selection that the options `--frames-of`, `--step` (1 unless given) and `--tags` describe.
    ///
    /// # Errors
    /// [`SynthError::BadValue`].
    pub fn new(of: &str, step: Option<&str>, words: Option<&str>) -> Result<Self, SynthError> {
        let bad = |option, value: &str, reason: &str| SynthError::BadValue {
            option,
            value: value.into(),
            reason: reason.into(),
        };
        if of.is_empty() || of.contains(['/', '\\']) || of.starts_with('.') {
            return Err(bad(
                "frames-of",
                of,
                "the name of a sequence in the same folder, not a path",
            ));
        }
        let step = step.unwrap_or("1");
        let number = step.parse().ok().filter(|n| *n > 0);
        let number = number.ok_or_else(|| bad("step", step, "a whole number from 1 on"))?;
        let words = words.unwrap_or_default();
        Ok(Selection {
            of: of.into(),
            step: number,
            tags: tags(words).map_err(|reason| bad("tags", words, &reason))?,
        })
    }

    /// The command that makes this sequence in `out`.
    pub fn command(&self, out: &str) -> String {
        let mut text = format!("mtf-eval synth {} --frames-of {}", quoted(out), quoted(&self.of));
        if self.step > 1 {
            text += &format!(" --step {}", self.step);
        }
        if !self.tags.is_empty() {
            text += &format!(" --tags {}", quoted(&self.tags.join(",")));
        }
        text
    }

    /// Text of `meta.json` for a sequence called `name`.
    pub fn metadata(&self, name: &str) -> String {
        let meta = serde_json::json!({
            "frames_of": self.of,
            "step": self.step,
            "tags": self.tags,
            "command": self.command(name),
        });
        format!("{meta:#}\n")
    }

    /// Writes `meta.json` into the folder `dir` (made when missing), and gives its length in bytes.
    ///
    /// # Errors
    /// [`SynthError::NotEmpty`] when `dir` holds anything and `force` is false, [`SynthError::Write`].
    pub fn write(&self, dir: &Path, force: bool) -> Result<u64, SynthError> {
        let name = make_folder(dir, force)?;
        let (path, text) = (dir.join("meta.json"), self.metadata(&name));
        let written = std::fs::write(&path, &text);
        written.map_err(|e| SynthError::Write {
            path,
            reason: e.to_string(),
        })?;
        Ok(text.len() as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read_back() {
        let line = "mtf-eval synth fast-2 --frames-of fast --step 2 --tags fast,level-2";
        let (out, recipe) = Recipe::parse_command(line).unwrap();
        let Recipe::Selected(selection) = &recipe else {
            panic!("{recipe:?}")
        };
        assert_eq!(
            (out.as_str(), selection.command("fast-2").as_str()),
            ("fast-2", line)
        );
        assert_eq!(
            (selection.step, recipe.tags()),
            (2, &["fast".to_string(), "level-2".into()][..])
        );
        for bad in ["--step 0", "--step x", "--noise 3", "--tags 'a b'"] {
            assert!(
                Recipe::parse_command(&format!("mtf-eval synth a --frames-of b {bad}")).is_err(),
                "{bad}"
            );
        }
        assert!(Recipe::parse_command("mtf-eval synth a --frames-of ../b").is_err());
        let plain = "mtf-eval synth a --texture rock --noise 3";
        assert!(matches!(
            Recipe::parse_command(plain).unwrap().1,
            Recipe::Rendered(_)
        ));
    }
}
