//! How much worse a figure may get before the regression gate fails: one rule for all, and others for some trackers or
//! sequences.

use crate::files;
use crate::judge::baseline::gated;
use crate::judge::change::Subject;
use crate::metric::{Figure, MetricSet};
use crate::store::FileError;
use globset::{GlobBuilder, GlobMatcher};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// By how much a figure may get worse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// In the unit of the figure: `0.01`.
    Absolute(f64),
    /// As a fraction of the baseline's value: `"2%"` is 0.02.
    Relative(f64),
}

impl Tolerance {
    /// The limit in the figure's unit where the baseline has `value`; 0 for a fraction of what is not finite.
    pub fn limit(self, value: f64) -> f64 {
        match self {
            Tolerance::Absolute(limit) => limit,
            Tolerance::Relative(part) if value.is_finite() => part * value.abs(),
            Tolerance::Relative(_) => 0.0,
        }
    }
}

impl fmt::Display for Tolerance {
    /// As it is read: `0.01` or `2%`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Tolerance::Absolute(limit) => write!(f, "{limit}"),
            // Twelve digits, so that what was divided by 100 comes back as it was typed.
            Tolerance::Relative(part) => write!(f, "{}%", (part * 1e14).round() / 1e12),
        }
    }
}

impl FromStr for Tolerance {
    type Err = String;

    /// Reads `0.01` or `2%`.
    fn from_str(text: &str) -> Result<Tolerance, String> {
        let (number, relative) = match text.strip_suffix('%') {
            Some(number) => (number, true),
            None => (text, false),
        };
        match number.trim().parse::<f64>() {
            Ok(v) if v >= 0.0 && !relative => Ok(Tolerance::Absolute(v)),
            Ok(v) if v >= 0.0 => Ok(Tolerance::Relative(v / 100.0)),
            _ => Err(
                "a tolerance is a number >= 0, or a percentage of the baseline's value as in \"2%\""
                    .to_owned(),
            ),
        }
    }
}

impl Serialize for Tolerance {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Tolerance::Absolute(limit) => serializer.serialize_f64(*limit),
            Tolerance::Relative(_) => serializer.collect_str(self),
        }
    }
}

impl<'de> Deserialize<'de> for Tolerance {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Tolerance, D::Error> {
        #[derive(Deserialize)]
        #[serde(
            untagged,
            expecting = "a tolerance is a number >= 0, or a percentage as in \"2%\""
        )]
        enum Written {
            Number(f64),
            Text(String),
        }
        let text = match Written::deserialize(deserializer)? {
            Written::Number(number) => number.to_string(),
            Written::Text(text) => text,
        };
        text.parse().map_err(serde::de::Error::custom)
    }
}

/// How much worse a figure may get: for each figure that the gate looks at the largest fall, or the largest rise where
/// smaller is better.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerances {
    /// By figure, in the order of columns.
    figures: Vec<(String, Tolerance)>,
    /// Every difference fails, for better or worse.
    pub exact: bool,
    /// Other tolerances for some trackers or sequences; of those that fit, the last that names a figure holds.
    pub overrides: Vec<Override>,
}

/// Tolerances of the trackers and sequences that fit its patterns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Override {
    /// Which trackers: an id with `*` and `?`; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracker: Option<Pattern>,
    /// Which sequences: a name or `dataset/name`, or `pooled`, with `*` and `?`; all and the pooled figures by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sequence: Option<Pattern>,
    /// By figure.
    #[serde(flatten)]
    pub figures: BTreeMap<String, Tolerance>,
}

impl Override {
    fn fits(&self, subject: &Subject) -> bool {
        let tracker = self.tracker.as_ref().is_none_or(|p| p.fits(&subject.tracker));
        let place = |p: &Pattern| p.fits(&subject.place()) || p.fits(&subject.sequence);
        tracker && self.sequence.as_ref().is_none_or(place)
    }
}

impl Serialize for Tolerances {
    /// As in the file.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (name, tolerance) in &self.figures {
            map.serialize_entry(name, tolerance)?;
        }
        if !self.overrides.is_empty() {
            map.serialize_entry("override", &self.overrides)?;
        }
        map.end()
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

/// The file as it is written.
#[derive(Deserialize)]
struct Recorded {
    #[serde(rename = "override", default)]
    overrides: Vec<Override>,
    #[serde(flatten)]
    figures: BTreeMap<String, Tolerance>,
}

impl Tolerances {
    /// Those of the tables of metrics and figures.
    pub fn of(metrics: &MetricSet) -> Tolerances {
        Tolerances::with(metrics, |f| f.tolerance.unwrap_or(0.0))
    }

    /// Every change counts.
    pub fn none(metrics: &MetricSet) -> Tolerances {
        Tolerances::with(metrics, |_| 0.0)
    }

    /// Every change fails, for better or worse.
    pub fn exact(metrics: &MetricSet) -> Tolerances {
        Tolerances {
            exact: true,
            ..Tolerances::none(metrics)
        }
    }

    fn with(metrics: &MetricSet, tolerance: impl Fn(&Figure) -> f64) -> Tolerances {
        Tolerances {
            figures: gated(metrics)
                .map(|f| (f.name.clone(), Tolerance::Absolute(tolerance(f))))
                .collect(),
            exact: false,
            overrides: Vec::new(),
        }
    }

    /// Reads a TOML file: gated figures (`sr_5 = 0.01`, `al_median = "5%"`, ...) and tables `[[override]]`; what is not named keeps its default.
    ///
    /// # Errors
    /// [`FileError`] when it is missing, not TOML, has other keys or a tolerance is not a number `>= 0`.
    pub fn read(path: &Path, metrics: &MetricSet) -> Result<Tolerances, FileError> {
        let text = files::read_text(path, files::Kind::SETTINGS).map_err(|e| FileError::io(path, e))?;
        Tolerances::parse(&text, metrics).map_err(|reason| FileError::format(path, reason))
    }

    fn parse(text: &str, metrics: &MetricSet) -> Result<Tolerances, String> {
        let recorded: Recorded = toml::from_str(text).map_err(|e| {
            let line = |until: usize| 1 + text.bytes().take(until).filter(|b| *b == b'\n').count();
            // A wrong value has that of the whole text, which says nothing.
            let part = e.span().filter(|span| span.start > 0);
            match part {
                Some(span) => format!("line {}: {}", line(span.start), e.message()),
                None => e.message().to_owned(),
            }
        })?;
        let mut tolerances = Tolerances::of(metrics);
        let special = recorded.overrides.iter().flat_map(|o| &o.figures);
        for (name, _) in recorded.figures.iter().chain(special) {
            if tolerances.general(name).is_none() {
                let names: Vec<&str> = tolerances.figures.iter().map(|(name, _)| name.as_str()).collect();
                return Err(format!(
                    "there is no tolerance '{name}' (one of {})",
                    names.join(", ")
                ));
            }
        }
        for (name, tolerance) in &recorded.figures {
            tolerances.set(name, *tolerance);
        }
        tolerances.overrides = recorded.overrides;
        Ok(tolerances)
    }

    /// Sets the tolerance of a gated figure where no override fits.
    pub fn set(&mut self, figure: &str, tolerance: Tolerance) {
        for (_, value) in self.figures.iter_mut().filter(|(name, _)| name == figure) {
            *value = tolerance;
        }
    }

    /// The gated figures with their tolerances where no override fits, in the order of columns.
    pub fn figures(&self) -> impl Iterator<Item = (&str, Tolerance)> {
        self.figures
            .iter()
            .map(|(name, tolerance)| (name.as_str(), *tolerance))
    }

    /// The tolerance of a figure where no override fits; `None` for one that is not gated.
    pub fn general(&self, figure: &str) -> Option<Tolerance> {
        self.figures()
            .find(|(name, _)| *name == figure)
            .map(|(_, tolerance)| tolerance)
    }

    /// The tolerance of a gated figure of one tracker on one sequence; 0 for others.
    pub fn at(&self, subject: &Subject, figure: &str) -> Tolerance {
        let fitting = self.overrides.iter().rev().filter(|o| o.fits(subject));
        let special = fitting.filter_map(|o| o.figures.get(figure).copied()).next();
        let tolerance = special.or_else(|| self.general(figure));
        tolerance.unwrap_or(Tolerance::Absolute(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Tolerances, FileError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("check.toml");
        std::fs::write(&path, text).unwrap();
        Tolerances::read(&path, &MetricSet::builtin())
    }

    #[test]
    fn file() {
        let mut expected = Tolerances::of(&MetricSet::builtin());
        let shown: Vec<(&str, Tolerance)> = expected.figures().collect();
        let usual = [("sr_5", 0.01), ("auc", 0.005), ("al_median", 0.05)];
        assert_eq!(
            shown,
            usual.map(|(name, limit)| (name, Tolerance::Absolute(limit)))
        );
        expected.set("auc", Tolerance::Absolute(0.1));
        assert_eq!(read("auc = 0.1").unwrap(), expected);
        assert!(read("aucc = 0.1").unwrap_err().to_string().contains("aucc"));
        for wrong in [
            "auc = -1.0",
            "auc = nan",
            "[[override]]\nauc = -1.0",
            "[[override]]\nx = 1",
            "auc = \"-2%\"",
            "auc = \"two\"",
            "auc = true",
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        let why = read("auc = \"two\"").unwrap_err().to_string();
        // Where it is is not known.
        assert!(why.contains("2%") && !why.contains("line 1"), "{why}");
        let why = read("sr_5 = 1\n\nauc = = 2\n").unwrap_err().to_string();
        assert!(why.contains("line 3:"), "{why}");
    }

    #[test]
    fn tolerances_are_absolute_or_relative() {
        let read = read("sr_5 = 1\nauc = \"0.7%\"\nal_median = \"20 %\"").unwrap();
        let limit = |figure: &str, value: f64| read.general(figure).unwrap().limit(value);
        assert_eq!((limit("sr_5", 0.5), limit("al_median", 0.5)), (1.0, 0.1));
        assert!((limit("auc", 0.5) - 0.0035).abs() < 1e-12);
        assert_eq!(limit("al_median", f64::INFINITY), 0.0);
        let shown: Vec<String> = read.figures().map(|(_, t)| t.to_string()).collect();
        assert_eq!(shown, ["1", "0.7%", "20%"]);
        let text = toml::to_string(&read).unwrap();
        assert_eq!(Tolerances::parse(&text, &MetricSet::builtin()), Ok(read));
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
        let of = |tracker: &str, sequence: &str, figure: &str| {
            let subject = Subject {
                tracker: tracker.to_owned(),
                dataset: "d".to_owned(),
                sequence: sequence.to_owned(),
                start: 0,
                protocol: "ope".to_owned(),
            };
            read.at(&subject, figure).limit(1.0)
        };
        assert_eq!(of("esm/ssd/affine", "fast1", "auc"), 0.1);
        assert_eq!(of("pf/ssd/affine", "fast1", "auc"), 0.2);
        assert_eq!(of("pf/ssd/affine{max_iters=5}", "fast1", "auc"), 0.4);
        assert_eq!(of("pf/ssd/affine{max_iters=5}", "slow", "auc"), 0.2);
        assert_eq!(of("pf/ssd/affine{max_iters=5}", "fast1", "sr_5"), 0.3);
        assert_eq!(of("pf/ssd/affine", "x", "al_median"), 0.05);
        let text = toml::to_string(&read).unwrap();
        assert_eq!(Tolerances::parse(&text, &MetricSet::builtin()), Ok(read));
    }
}
