//! How much worse a figure may get before the regression gate fails: one rule for all, and others for some trackers or
//! sequences.

use crate::judge::baseline::{BaselineError, Figure, Key};
use crate::report::OutputError;
use globset::{GlobBuilder, GlobMatcher};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How much worse a figure may get.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tolerances {
    /// Largest fall of `sr_5`.
    pub sr_5: f64,
    /// Largest fall of `auc`.
    pub auc: f64,
    /// Largest rise of `al_median`, px.
    pub al_median: f64,
    /// Other tolerances for some trackers or sequences; of those that fit, the last that names a figure holds.
    #[serde(rename = "override", skip_serializing_if = "Vec::is_empty")]
    pub overrides: Vec<Override>,
}

impl Default for Tolerances {
    fn default() -> Self {
        Tolerances {
            sr_5: 0.01,
            auc: 0.005,
            al_median: 0.05,
            overrides: Vec::new(),
        }
    }
}

/// Tolerances of the trackers and sequences that fit its patterns.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Override {
    /// Which trackers: an id with `*` and `?`; all by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tracker: Option<Pattern>,
    /// Which sequences: a name or `dataset/name`, or `pooled`, with `*` and `?`; all and the pooled figures by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sequence: Option<Pattern>,
    /// Largest fall of `sr_5`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sr_5: Option<f64>,
    /// Largest fall of `auc`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub auc: Option<f64>,
    /// Largest rise of `al_median`, px.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub al_median: Option<f64>,
}

impl Override {
    fn of(&self, figure: Figure) -> Option<f64> {
        match figure {
            Figure::Sr5 => self.sr_5,
            Figure::Auc => self.auc,
            Figure::AlMedian => self.al_median,
        }
    }

    fn fits(&self, key: &Key) -> bool {
        let tracker = self.tracker.as_ref().is_none_or(|p| p.fits(&key.tracker));
        let place = |p: &Pattern| p.fits(&key.place()) || p.fits(&key.sequence);
        tracker && self.sequence.as_ref().is_none_or(place)
    }
}

/// A name with `*` for any characters and `?` for any one; all else stands for itself, so that a tracker's id with its
/// braces is a pattern, too.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Pattern {
    text: String,
    glob: GlobMatcher,
}

impl Pattern {
    fn fits(&self, name: &str) -> bool {
        self.glob.is_match(name)
    }
}

impl PartialEq for Pattern {
    fn eq(&self, other: &Pattern) -> bool {
        self.text == other.text
    }
}

impl TryFrom<String> for Pattern {
    type Error = globset::Error;

    fn try_from(text: String) -> Result<Pattern, globset::Error> {
        let plain = |c: char| match c {
            '{' | '}' | '[' | ']' | '\\' => format!("[{c}]"),
            c => c.to_string(),
        };
        let glob: String = text.chars().map(plain).collect();
        let glob = GlobBuilder::new(&glob).backslash_escape(false).build()?;
        Ok(Pattern {
            text,
            glob: glob.compile_matcher(),
        })
    }
}

impl From<Pattern> for String {
    fn from(pattern: Pattern) -> String {
        pattern.text
    }
}

impl Tolerances {
    /// Every change counts.
    pub const NONE: Tolerances = Tolerances {
        sr_5: 0.0,
        auc: 0.0,
        al_median: 0.0,
        overrides: Vec::new(),
    };

    /// Reads a TOML file with any of the keys `sr_5`, `auc`, `al_median` and tables `[[override]]`; what is not named
    /// keeps its default.
    ///
    /// # Errors
    /// [`BaselineError`] when it is missing, not TOML, has other keys or a tolerance is not a number `>= 0`.
    pub fn read(path: &Path) -> Result<Tolerances, BaselineError> {
        let text = std::fs::read_to_string(path).map_err(|source| OutputError::Io {
            path: path.to_owned(),
            source,
        })?;
        let wrong = |reason| OutputError::Format {
            path: path.to_owned(),
            reason,
        };
        let read: Tolerances = toml::from_str(&text).map_err(|e| wrong(e.to_string()))?;
        let general = Figure::ALL.map(|f| read.general(f));
        let special = read
            .overrides
            .iter()
            .flat_map(|o| Figure::ALL.into_iter().filter_map(|f| o.of(f)));
        if general.into_iter().chain(special).any(|t| t.is_nan() || t < 0.0) {
            return Err(wrong("a tolerance is a number >= 0".to_owned()).into());
        }
        Ok(read)
    }

    /// The tolerance of a figure where no override fits.
    pub fn general(&self, figure: Figure) -> f64 {
        match figure {
            Figure::Sr5 => self.sr_5,
            Figure::Auc => self.auc,
            Figure::AlMedian => self.al_median,
        }
    }

    /// The tolerance of a figure of one tracker on one sequence.
    pub fn of(&self, key: &Key, figure: Figure) -> f64 {
        let fitting = self.overrides.iter().rev().filter(|o| o.fits(key));
        fitting
            .filter_map(|o| o.of(figure))
            .next()
            .unwrap_or_else(|| self.general(figure))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Tolerances, BaselineError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("check.toml");
        std::fs::write(&path, text).unwrap();
        Tolerances::read(&path)
    }

    #[test]
    fn file() {
        let expected = Tolerances {
            auc: 0.1,
            ..Tolerances::default()
        };
        assert_eq!(read("auc = 0.1").unwrap(), expected);
        assert!(read("aucc = 0.1").unwrap_err().to_string().contains("aucc"));
        for wrong in [
            "auc = -1.0",
            "auc = nan",
            "[[override]]\nauc = -1.0",
            "[[override]]\nx = 1",
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_last_override_that_fits_holds() {
        let text = r#"
            auc = 0.1
            [[override]]
            tracker = "pf/*"
            auc = 0.2
            sr_5 = 0.3
            [[override]]
            tracker = "pf/ssd/affine{max_iters=5}"
            sequence = "fast*"
            auc = 0.4
        "#;
        let read = read(text).unwrap();
        let of = |tracker: &str, sequence: &str, figure| {
            let key = Key {
                tracker: tracker.to_owned(),
                dataset: "d".to_owned(),
                sequence: sequence.to_owned(),
                start: 0,
                protocol: "ope".to_owned(),
            };
            read.of(&key, figure)
        };
        assert_eq!(of("esm/ssd/affine", "fast1", Figure::Auc), 0.1);
        assert_eq!(of("pf/ssd/affine", "fast1", Figure::Auc), 0.2);
        assert_eq!(of("pf/ssd/affine{max_iters=5}", "fast1", Figure::Auc), 0.4);
        assert_eq!(of("pf/ssd/affine{max_iters=5}", "slow", Figure::Auc), 0.2);
        assert_eq!(of("pf/ssd/affine{max_iters=5}", "fast1", Figure::Sr5), 0.3);
        assert_eq!(of("pf/ssd/affine", "x", Figure::AlMedian), 0.05);
        let again: Tolerances = toml::from_str(&toml::to_string(&read).unwrap()).unwrap();
        assert_eq!(again, read);
    }
}
