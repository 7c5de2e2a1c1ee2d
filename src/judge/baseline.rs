//! Baseline files of the regression gate: for every tracker, `sr_5`, `auc` and `al_median` of each sequence and
//! pooled, and the command that made them. [`crate::judge::gate`] compares them.

use crate::metric::aggregate::{ALL_DATASETS, Average, POOLED, Results};
use crate::metric::score::Score;
use crate::report::OutputError;
use crate::store::{Durable, write_atomic};
use serde::{Deserialize, Deserializer, Serialize};
use std::path::Path;

/// Version of the baseline file; changes when a reader of the former version would misread it.
pub const SCHEMA_VERSION: u32 = 1;

/// A baseline or tolerance file could not be used.
#[derive(Debug, thiserror::Error)]
pub enum BaselineError {
    /// Reading or writing failed.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The file has another schema version.
    #[error("{path}: schema version {found}, this program reads version {SCHEMA_VERSION}")]
    Version {
        /// The file.
        path: String,
        /// Its version.
        found: u32,
    },
}

/// What is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Figure {
    /// Fraction of the frames within 5 px; larger is better.
    Sr5,
    /// Area under the success curve; larger is better.
    Auc,
    /// Median alignment error, px; smaller is better.
    AlMedian,
}

impl Figure {
    /// All figures, in the order of files.
    pub const ALL: [Figure; 3] = [Figure::Sr5, Figure::Auc, Figure::AlMedian];

    /// Column name in result files.
    pub fn name(self) -> &'static str {
        match self {
            Figure::Sr5 => "sr_5",
            Figure::Auc => "auc",
            Figure::AlMedian => "al_median",
        }
    }
}

/// What a line of a baseline is about. `all`, `pooled` is the tracker's average over all frames.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Key {
    /// Tracker id.
    pub tracker: String,
    /// Data set.
    pub dataset: String,
    /// Sequence.
    pub sequence: String,
    /// Index of the initial frame.
    pub start: usize,
    /// Protocol.
    pub protocol: String,
}

impl Key {
    /// True for the average over all frames.
    pub fn is_pooled(&self) -> bool {
        self.dataset == ALL_DATASETS && self.sequence == POOLED
    }

    /// `dataset/sequence[@start]`, or `pooled`.
    pub fn place(&self) -> String {
        match self.start {
            _ if self.is_pooled() => POOLED.to_owned(),
            0 => format!("{}/{}", self.dataset, self.sequence),
            start => format!("{}/{}@{start}", self.dataset, self.sequence),
        }
    }
}

/// Figures of one tracker on one sequence (or pooled). `null` in JSON: undefined without frames, else an infinite
/// median.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// What the figures are of.
    #[serde(flatten)]
    pub key: Key,
    /// Scored frames.
    pub frames: usize,
    /// True when the run died.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub failed: bool,
    /// Fraction of the frames within 5 px.
    #[serde(deserialize_with = "undefined")]
    pub sr_5: f64,
    /// Area under the success curve.
    #[serde(deserialize_with = "undefined")]
    pub auc: f64,
    /// Median alignment error, px.
    #[serde(deserialize_with = "infinite")]
    pub al_median: f64,
}

/// Strings and numbers always serialise.
fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

fn undefined<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(d)?.unwrap_or(f64::NAN))
}

fn infinite<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(d)?.unwrap_or(f64::INFINITY))
}

impl Line {
    /// One figure.
    pub fn get(&self, figure: Figure) -> f64 {
        match figure {
            Figure::Sr5 => self.sr_5,
            Figure::Auc => self.auc,
            Figure::AlMedian => self.al_median,
        }
    }
}

/// A recorded state of all figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Baseline {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Version of the program that recorded it.
    pub version: String,
    /// Arguments of `mtf-eval run` that make a comparable run; empty when unknown.
    pub command: Vec<String>,
    /// Sorted by tracker and sequence, the pooled line of each tracker first.
    pub figures: Vec<Line>,
}

impl Baseline {
    /// Records `results`, made by `mtf-eval run` with the arguments `command`.
    pub fn new(results: &Results, command: Vec<String>) -> Baseline {
        let line = |key, score: &Score, failed| Line {
            key,
            frames: score.frames,
            failed,
            sr_5: score.sr_5,
            auc: score.auc,
            // Not one frame that was tracked is as bad as can be.
            al_median: match score.al_median.is_nan() && score.frames > 0 {
                true => f64::INFINITY,
                false => score.al_median,
            },
        };
        let pooled = results
            .summary
            .iter()
            .filter(|r| r.average == Average::Pooled)
            .map(|r| {
                let key = Key {
                    tracker: r.tracker.id.clone(),
                    dataset: ALL_DATASETS.to_owned(),
                    sequence: POOLED.to_owned(),
                    start: 0,
                    protocol: r.protocol.clone(),
                };
                line(key, &r.score, false)
            });
        let sequences = results.sequences.iter().map(|r| {
            let key = Key {
                tracker: r.tracker.id.clone(),
                dataset: r.dataset.clone(),
                sequence: r.sequence.clone(),
                start: r.start,
                protocol: r.protocol.clone(),
            };
            line(key, &r.score, r.status.is_failed())
        });
        let mut figures: Vec<Line> = pooled.chain(sequences).collect();
        figures.sort_by_cached_key(|l| {
            (
                l.key.tracker.clone(),
                l.key.protocol.clone(),
                !l.key.is_pooled(),
                l.key.clone(),
            )
        });
        Baseline {
            schema_version: SCHEMA_VERSION,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            command,
            figures,
        }
    }

    /// Reads a baseline file.
    ///
    /// # Errors
    /// [`BaselineError`] when it is missing, damaged or of another version.
    pub fn read(path: &Path) -> Result<Baseline, BaselineError> {
        #[derive(Deserialize)]
        struct Version {
            schema_version: u32,
        }
        let text = std::fs::read(path).map_err(|source| OutputError::Io {
            path: path.to_owned(),
            source,
        })?;
        let wrong = |e: serde_json::Error| OutputError::Format {
            path: path.to_owned(),
            reason: e.to_string(),
        };
        let Version {
            schema_version: found,
        } = serde_json::from_slice(&text).map_err(wrong)?;
        if found != SCHEMA_VERSION {
            return Err(BaselineError::Version {
                path: path.display().to_string(),
                found,
            });
        }
        Ok(serde_json::from_slice(&text).map_err(wrong)?)
    }

    /// The file's text: one line per tracker and sequence, so that version control shows what changed.
    pub fn to_json(&self) -> String {
        let lines: Vec<String> = self.figures.iter().map(|l| format!("    {}", json(l))).collect();
        format!(
            "{{\n  \"schema_version\": {},\n  \"version\": {},\n  \"command\": {},\n  \"figures\": [\n{}\n  ]\n}}\n",
            self.schema_version,
            json(&self.version),
            json(&self.command),
            lines.join(",\n"),
        )
    }

    /// Writes the file: complete or not at all.
    ///
    /// # Errors
    /// [`BaselineError`] naming the file.
    pub fn write(&self, path: &Path) -> Result<(), BaselineError> {
        let text = self.to_json();
        let at = |source| OutputError::Io {
            path: path.to_owned(),
            source,
        };
        Ok(write_atomic(path, Durable::Now, |w| w.write_all(text.as_bytes())).map_err(at)?)
    }
}

/// The command that made the run directory `dir`, from the array `command` in its `run.json`; `None` when it is
/// not recorded.
pub fn recorded_command(dir: &Path) -> Option<Vec<String>> {
    #[derive(Deserialize)]
    struct Run {
        command: Vec<String>,
    }
    let text = std::fs::read(dir.join("run.json")).ok()?;
    let run: Run = serde_json::from_slice(&text).ok()?;
    Some(run.command)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::{aggregate, example};

    #[test]
    fn file() {
        let command = ["builtin", "--sm", "esm,iclk"].map(str::to_owned).to_vec();
        let recorded = Baseline::new(&aggregate(&example::units()), command);
        insta::assert_snapshot!(recorded.to_json(), @r#"
        {
          "schema_version": 1,
          "version": "0.1.0",
          "command": ["builtin","--sm","esm,iclk"],
          "figures": [
            {"tracker":"esm/ssd/homography","dataset":"all","sequence":"pooled","start":0,"protocol":"ope","frames":6,"sr_5":1.0,"auc":0.963333,"al_median":0.175},
            {"tracker":"esm/ssd/homography","dataset":"builtin","sequence":"book","start":0,"protocol":"ope","frames":2,"sr_5":1.0,"auc":1.0,"al_median":0.05},
            {"tracker":"esm/ssd/homography","dataset":"builtin","sequence":"wall","start":0,"protocol":"ope","frames":4,"sr_5":1.0,"auc":0.945,"al_median":0.375},
            {"tracker":"iclk/ssd/affine","dataset":"all","sequence":"pooled","start":0,"protocol":"ope","frames":6,"sr_5":0.666667,"auc":0.633333,"al_median":2.0},
            {"tracker":"iclk/ssd/affine","dataset":"builtin","sequence":"book","start":0,"protocol":"ope","frames":2,"sr_5":1.0,"auc":0.995,"al_median":0.2},
            {"tracker":"iclk/ssd/affine","dataset":"builtin","sequence":"wall","start":0,"protocol":"ope","frames":4,"sr_5":0.5,"auc":0.4525,"al_median":16.25},
            {"tracker":"nn/mi/affine","dataset":"all","sequence":"pooled","start":0,"protocol":"ope","frames":2,"sr_5":0.0,"auc":0.0,"al_median":null},
            {"tracker":"nn/mi/affine","dataset":"builtin","sequence":"wall","start":0,"protocol":"ope","frames":2,"failed":true,"sr_5":0.0,"auc":0.0,"al_median":null}
          ]
        }
        "#);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("baseline.json");
        recorded.write(&path).unwrap();
        assert_eq!(Baseline::read(&path).unwrap(), recorded);
        std::fs::write(&path, r#"{"schema_version": 7}"#).unwrap();
        assert!(matches!(
            Baseline::read(&path),
            Err(BaselineError::Version { found: 7, .. })
        ));
        std::fs::write(&path, "[").unwrap();
        assert!(
            Baseline::read(&path)
                .unwrap_err()
                .to_string()
                .contains("baseline.json")
        );
    }

    #[test]
    fn recorded_commands_are_read() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(recorded_command(dir.path()), None);
        std::fs::write(
            dir.path().join("run.json"),
            r#"{"seed": 1, "command": ["builtin"]}"#,
        )
        .unwrap();
        assert_eq!(recorded_command(dir.path()), Some(vec!["builtin".to_owned()]));
    }
}
