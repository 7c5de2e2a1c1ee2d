//! Baseline files of the regression gate: for every tracker, the gated figures of each sequence and pooled (`sr_5`, `auc`,
//! `al_median` and what added metrics give), and the command that made them. [`crate::judge::gate`] compares them.

use crate::files::{self, Kind};
use crate::judge::change::Subject;
use crate::metric::aggregate::{Average, Results};
use crate::metric::{Figure, MetricSet, Score};
use crate::store::summary::check_version;
use crate::store::{Durable, FileError, write_atomic};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the baseline file; changes when a reader of the former version would misread it.
pub const BASELINE_FORMAT_VERSION: u32 = 1;

/// The figures that the gate looks at: those with a tolerance.
pub fn gated(metrics: &MetricSet) -> impl Iterator<Item = &Figure> {
    metrics.figures().iter().filter(|f| f.tolerance.is_some())
}

/// Figures of one tracker on one sequence (or pooled).
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// What the figures are of.
    pub subject: Subject,
    /// Evaluated frames.
    pub frames: usize,
    /// True when the run died.
    pub failed: bool,
    /// Gated figures by name. NaN: undefined, without frames.
    pub figures: Vec<(String, f64)>,
}

/// A line as it is written. `null`: undefined without frames, else what no output counts as.
#[derive(Serialize, Deserialize)]
struct RecordedLine {
    #[serde(flatten)]
    subject: Subject,
    frames: usize,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    failed: bool,
    #[serde(flatten)]
    figures: Map<String, Value>,
}

/// The file but for its version.
#[derive(Deserialize)]
struct Recorded {
    version: String,
    command: Vec<String>,
    #[serde(default)]
    data: BTreeMap<String, String>,
    figures: Vec<RecordedLine>,
}

/// Strings and numbers always serialise.
fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

/// What stands for a figure that is undefined: with frames, what no output counts as.
fn or_lost(figure: Option<&Figure>, value: f64, frames: usize) -> f64 {
    match figure {
        Some(figure) if value.is_nan() && frames > 0 => figure.without_output,
        _ => value,
    }
}

impl Line {
    fn new(subject: Subject, score: &Score, failed: bool, metrics: &MetricSet) -> Line {
        let frames = score.frames();
        // Not one frame that was tracked is as bad as can be.
        let value = |f: &Figure| or_lost(Some(f), score.get(&f.name).unwrap_or(f64::NAN), frames);
        Line {
            subject,
            frames,
            failed,
            figures: gated(metrics).map(|f| (f.name.clone(), value(f))).collect(),
        }
    }

    fn read(line: RecordedLine, metrics: &MetricSet) -> Line {
        let frames = line.frames;
        let value = |(name, value): (String, Value)| {
            let number = value.as_f64().unwrap_or(f64::NAN);
            let number = or_lost(metrics.figure(&name), number, frames);
            (name, number)
        };
        Line {
            subject: line.subject,
            frames,
            failed: line.failed,
            figures: line.figures.into_iter().map(value).collect(),
        }
    }

    fn recorded(&self) -> RecordedLine {
        RecordedLine {
            subject: self.subject.clone(),
            frames: self.frames,
            failed: self.failed,
            figures: self
                .figures
                .iter()
                .map(|(name, value)| (name.clone(), Value::from(*value)))
                .collect(),
        }
    }

    /// The figure called `name`, if the line has it.
    pub fn get(&self, name: &str) -> Option<f64> {
        let mut figures = self.figures.iter();
        figures
            .find(|(figure, _)| figure == name)
            .map(|(_, value)| *value)
    }
}

/// A recorded state of all gated figures.
#[derive(Clone, Debug, PartialEq)]
pub struct Baseline {
    /// The metrics that say which way figures get better.
    pub metrics: MetricSet,
    /// Version of the program that recorded it.
    pub version: String,
    /// Arguments of `mtf-eval run` that make a comparable run; empty when unknown.
    pub command: Vec<String>,
    /// Fingerprint of the data of each sequence, by `dataset/sequence`, as far as known.
    pub data: BTreeMap<String, String>,
    /// Sorted by tracker and sequence, the pooled line of each tracker first.
    pub lines: Vec<Line>,
}

impl Baseline {
    /// Records `results`, made by `mtf-eval run` with the arguments `command`.
    pub fn new(results: &Results, command: Vec<String>) -> Baseline {
        let metrics = &results.metrics;
        let pooled = results
            .summary
            .iter()
            .filter(|r| r.average == Average::Pooled)
            .map(|r| {
                let subject = Subject::pooled(&r.tracker.id, &r.protocol);
                Line::new(subject, &r.score, false, metrics)
            });
        let sequences = results.sequences.iter().map(|r| {
            let subject = Subject {
                tracker: r.tracker.id.clone(),
                dataset: r.dataset.clone(),
                sequence: r.sequence.clone(),
                start: r.start,
                protocol: r.protocol.clone(),
            };
            Line::new(subject, &r.score, r.status.is_failed(), metrics)
        });
        let mut lines: Vec<Line> = pooled.chain(sequences).collect();
        lines.sort_by_cached_key(|l| {
            (
                l.subject.tracker.clone(),
                l.subject.protocol.clone(),
                !l.subject.is_pooled(),
                l.subject.clone(),
            )
        });
        Baseline {
            metrics: metrics.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            command,
            data: BTreeMap::new(),
            lines,
        }
    }

    /// The same of data with these fingerprints.
    pub fn with_data(mut self, data: BTreeMap<String, String>) -> Baseline {
        self.data = data;
        self
    }

    /// Reads a baseline file for a program with `metrics`.
    ///
    /// # Errors
    /// [`FileError`] when it is missing, damaged or of another version.
    pub fn read(path: &Path, metrics: &MetricSet) -> Result<Baseline, FileError> {
        let text = files::read(path, files::Kind::RESULTS).map_err(|e| FileError::io(path, e))?;
        check_version(path, &text, BASELINE_FORMAT_VERSION)?;
        let recorded: Recorded = serde_json::from_slice(&text).map_err(|e| FileError::format(path, e))?;
        let lines = recorded.figures.into_iter();
        Ok(Baseline {
            metrics: metrics.clone(),
            version: recorded.version,
            command: recorded.command,
            data: recorded.data,
            lines: lines.map(|line| Line::read(line, metrics)).collect(),
        })
    }

    /// The file's text: one line per tracker and sequence, so that version control shows what changed.
    pub fn to_json(&self) -> String {
        let line = |line: &Line| format!("    {}", json(&line.recorded()));
        let lines: Vec<String> = self.lines.iter().map(line).collect();
        let data = self
            .data
            .iter()
            .map(|(id, print)| format!("    {}: {}", json(id), json(print)));
        let data = match data.collect::<Vec<_>>() {
            data if data.is_empty() => String::new(),
            data => format!("  \"data\": {{\n{}\n  }},\n", data.join(",\n")),
        };
        format!(
            "{{\n  \"schema_version\": {BASELINE_FORMAT_VERSION},\n  \"version\": {},\n  \"command\": {},\n{data}  \"figures\": [\n{}\n  ]\n}}\n",
            json(&self.version),
            json(&self.command),
            lines.join(",\n"),
        )
    }

    /// Writes the file: complete or not at all.
    ///
    /// # Errors
    /// [`FileError`] naming the file.
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        let text = self.to_json();
        write_atomic(path, Durable::Now, |w| w.write_all(text.as_bytes())).map_err(|e| FileError::io(path, e))
    }
}

/// The command that made the run directory `dir`, from the array `command` in its `run.json`; `None` when it is
/// not recorded.
pub fn recorded_command(dir: &Path) -> Option<Vec<String>> {
    #[derive(Deserialize)]
    struct Run {
        command: Vec<String>,
    }
    let text = files::read(&dir.join("run.json"), Kind::RESULTS).ok()?;
    let run: Run = serde_json::from_slice(&text).ok()?;
    Some(run.command)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::example;

    #[test]
    fn file() {
        let command = ["builtin", "--sm", "esm,iclk"].map(str::to_owned).to_vec();
        let prints =
            [("builtin/book", "1b"), ("builtin/wall", "a5")].map(|(id, print)| (id.into(), print.into()));
        let recorded = Baseline::new(&example::results(), command).with_data(prints.into());
        insta::assert_snapshot!(recorded.to_json(), @r#"
        {
          "schema_version": 1,
          "version": "0.1.0",
          "command": ["builtin","--sm","esm,iclk"],
          "data": {
            "builtin/book": "1b",
            "builtin/wall": "a5"
          },
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
        let read = || Baseline::read(&path, &MetricSet::builtin());
        assert_eq!(read().unwrap(), recorded);
        std::fs::write(&path, r#"{"schema_version": 7}"#).unwrap();
        assert!(read().unwrap_err().to_string().contains("schema version 7"));
        std::fs::write(&path, "[").unwrap();
        assert!(read().unwrap_err().to_string().contains("baseline.json"));
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
