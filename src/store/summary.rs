//! `summary.json`: every figure in the result files of a run, nested by tracker; written and read back.

use crate::files::{self, Kind};
use crate::metric::aggregate::{Average, Results, SequenceRow, SummaryRow, TrackerName, UnitStatus};
use crate::metric::{MetricSet, Score};
pub use crate::store::file::FileError;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

/// Name of the file in a run directory.
pub const FILE: &str = "summary.json";

/// Version of the file; changes when a reader of the former version would misread it.
pub const SUMMARY_FORMAT_VERSION: u32 = 1;

/// The thresholds of the success curves of each metric, by its name.
pub type Thresholds = Map<String, Value>;

/// The thresholds of `metrics`.
pub fn thresholds(metrics: &MetricSet) -> Thresholds {
    let metrics = metrics.metrics().iter();
    metrics
        .map(|m| (m.name.to_owned(), m.thresholds().into()))
        .collect()
}

#[derive(Serialize)]
struct Document<'a> {
    schema_version: u32,
    tool: &'static str,
    version: &'static str,
    #[serde(skip_serializing_if = "str::is_empty")]
    title: &'a str,
    #[serde(skip_serializing_if = "str::is_empty")]
    made_from: &'a str,
    thresholds: Thresholds,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    tags: &'a BTreeMap<String, Vec<String>>,
    trackers: Vec<Tracker<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    groups: Option<Value>,
}

/// Rows of one tracker.
#[derive(Serialize)]
struct Tracker<'a> {
    #[serde(flatten)]
    name: &'a TrackerName,
    aggregates: Vec<&'a SummaryRow>,
    sequences: Vec<&'a SequenceRow>,
}

impl<'a> Document<'a> {
    /// Rows of `results` by tracker, in the order of `order`.
    fn new(results: &'a Results, order: &[&'a TrackerName]) -> Document<'a> {
        let mut trackers: Vec<Tracker> = Vec::new();
        let mut places: BTreeMap<&TrackerName, usize> = BTreeMap::new();
        for &name in order {
            places.entry(name).or_insert_with(|| {
                trackers.push(Tracker {
                    name,
                    aggregates: vec![],
                    sequences: vec![],
                });
                trackers.len() - 1
            });
        }
        for row in &results.summary {
            if let Some(&at) = places.get(&row.tracker) {
                trackers[at].aggregates.push(row);
            }
        }
        for row in &results.sequences {
            if let Some(&at) = places.get(&row.tracker) {
                trackers[at].sequences.push(row);
            }
        }
        Document {
            schema_version: SUMMARY_FORMAT_VERSION,
            tool: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            title: "",
            made_from: "",
            thresholds: thresholds(&results.metrics),
            tags: &results.tags,
            trackers,
            groups: None,
        }
    }
}

/// What `summary.json` says about the run as a whole.
#[derive(Clone, Copy, Debug)]
pub struct Heading<'a> {
    /// Heading of the run's plot.
    pub title: &'a str,
    /// [Checksum](crate::store::held::ended_as) of what the results were made from.
    pub made_from: &'a str,
}

/// Writes the file, on one line.
///
/// # Errors
/// What the system says.
pub fn write(out: &mut dyn Write, results: &Results, heading: Heading<'_>) -> io::Result<()> {
    let order: Vec<&TrackerName> = results.summary.iter().map(|r| &r.tracker).collect();
    let document = Document {
        title: heading.title,
        made_from: heading.made_from,
        ..Document::new(results, &order)
    };
    serde_json::to_writer(&mut *out, &document)?;
    writeln!(out)
}

/// The document without curves, trackers in the given order: for standard output. `groups`: figures by group.
pub fn document<'a>(
    results: &'a Results,
    order: &[&'a TrackerName],
    groups: Option<Value>,
) -> impl Serialize + 'a {
    Document {
        groups,
        ..Document::new(results, order)
    }
}

/// What a `summary.json` says.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Its rows.
    pub results: Results,
    /// The thresholds that its success rates and curves are of.
    pub thresholds: Thresholds,
    /// [Checksum](crate::store::held::ended_as) of what they were made from, if it says.
    pub made_from: Option<String>,
}

/// The file as it is read: figures and metrics go by their names.
#[derive(Deserialize)]
struct Recorded {
    thresholds: Thresholds,
    #[serde(default)]
    made_from: Option<String>,
    #[serde(default)]
    tags: BTreeMap<String, Vec<String>>,
    trackers: Vec<RecordedTracker>,
}

#[derive(Deserialize)]
struct RecordedTracker {
    #[serde(flatten)]
    name: TrackerName,
    aggregates: Vec<RecordedAggregate>,
    sequences: Vec<RecordedSequence>,
}

#[derive(Deserialize)]
struct RecordedAggregate {
    average: Average,
    metric: String,
    protocol: String,
    sequences: usize,
    runs: usize,
    failed_runs: usize,
    #[serde(flatten)]
    figures: Map<String, Value>,
}

#[derive(Deserialize)]
struct RecordedSequence {
    dataset: String,
    sequence: String,
    start: usize,
    protocol: String,
    #[serde(flatten)]
    status: UnitStatus,
    #[serde(flatten)]
    figures: Map<String, Value>,
}

/// Reads the `summary.json` of the run directory `dir` as a run of `metrics`. Figures that it lacks are undefined; figures
/// of other metrics are left out. There are no curves.
///
/// # Errors
/// [`FileError`] when the file is missing, damaged or of another version.
pub fn read(dir: &Path, metrics: &MetricSet) -> Result<Summary, FileError> {
    let path = dir.join(FILE);
    let text = files::read(&path, Kind::RESULTS).map_err(|e| FileError::io(&path, e))?;
    check_version(&path, &text, SUMMARY_FORMAT_VERSION)?;
    let recorded: Recorded = serde_json::from_slice(&text).map_err(|e| FileError::format(&path, e))?;
    let mut results = Results::new(metrics);
    results.tags = recorded.tags;
    for RecordedTracker {
        name,
        aggregates,
        sequences,
    } in recorded.trackers
    {
        for row in aggregates {
            let metric = metrics.metric(&row.metric);
            let metric = metric.ok_or_else(|| {
                FileError::format(
                    &path,
                    format!("success rates of the unknown metric '{}'", row.metric),
                )
            })?;
            results.summary.push(SummaryRow {
                tracker: name.clone(),
                average: row.average,
                metric: *metric,
                protocol: row.protocol,
                sequences: row.sequences,
                runs: row.runs,
                failed_runs: row.failed_runs,
                score: Score::from_json(metrics, &row.figures),
            });
        }
        results
            .sequences
            .extend(sequences.into_iter().map(|row| SequenceRow {
                tracker: name.clone(),
                dataset: row.dataset,
                sequence: row.sequence,
                start: row.start,
                protocol: row.protocol,
                status: row.status,
                score: Score::from_json(metrics, &row.figures),
            }));
    }
    Ok(Summary {
        results,
        thresholds: recorded.thresholds,
        made_from: recorded.made_from,
    })
}

/// Checks the field `schema_version` of a JSON file before the rest of it is understood.
///
/// # Errors
/// It is missing or another than `expected`.
pub fn check_version(path: &Path, text: &[u8], expected: u32) -> Result<(), FileError> {
    #[derive(Deserialize)]
    struct Version {
        schema_version: u32,
    }
    let version: Version = serde_json::from_slice(text).map_err(|e| FileError::format(path, e))?;
    match version.schema_version {
        found if found == expected => Ok(()),
        found => Err(FileError::format(
            path,
            format!("schema version {found}, this program reads version {expected}"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::example;

    #[test]
    fn reads_what_it_wrote() {
        let mut units = example::units();
        units.push(example::unit("nn/mi/affine", "void", &[]));
        let mut results = example::of(&units);
        results.tags.insert("builtin/wall".into(), vec!["flat".into()]);
        let dir = tempfile::tempdir().unwrap();
        let mut text = Vec::new();
        let heading = Heading {
            title: "",
            made_from: "0123",
        };
        write(&mut text, &results, heading).unwrap();
        std::fs::write(dir.path().join(FILE), text).unwrap();
        let read = read(dir.path(), &results.metrics).unwrap();
        // They are in a file of their own.
        results.curves.clear();
        assert_eq!(format!("{:?}", read.results), format!("{results:?}"));
        assert_eq!(read.thresholds, thresholds(&results.metrics));
        assert_eq!(read.made_from.as_deref(), Some("0123"));
    }

    #[test]
    fn refuses_other_versions_and_damage() {
        let dir = tempfile::tempdir().unwrap();
        let read = || read(dir.path(), &MetricSet::builtin());
        assert!(matches!(read(), Err(FileError::Io { .. })));
        std::fs::write(dir.path().join("summary.json"), r#"{"schema_version": 99}"#).unwrap();
        assert!(read().unwrap_err().to_string().contains("schema version 99"));
        std::fs::write(dir.path().join("summary.json"), r#"{"schema_version": 1, "tr"#).unwrap();
        assert!(matches!(read(), Err(FileError::Format { .. })));
    }

    #[test]
    fn shape() {
        let units = [example::unit("esm/ssd/homography", "wall", &[Some(0.0), None])];
        let results = example::of(&units);
        let order = [&results.summary[0].tracker];
        let mut value = serde_json::to_value(document(&results, &order, None)).unwrap();
        assert_eq!(value["thresholds"]["al"].as_array().unwrap().len(), 101);
        value["thresholds"] = "...".into();
        insta::assert_snapshot!(serde_json::to_string_pretty(&value).unwrap(), @r#"
        {
          "schema_version": 1,
          "tool": "mtf-eval",
          "version": "0.1.0",
          "thresholds": "...",
          "trackers": [
            {
              "tracker": "esm/ssd/homography",
              "sm": "esm",
              "am": "ssd",
              "ssm": "homography",
              "ilm": "",
              "aggregates": [
                {
                  "average": "pooled",
                  "metric": "al",
                  "protocol": "ope",
                  "sequences": 1,
                  "runs": 1,
                  "failed_runs": 0,
                  "frames": 2,
                  "sr_1": 0.5,
                  "sr_2": 0.5,
                  "sr_5": 0.5,
                  "sr_10": 0.5,
                  "sr_20": 0.5,
                  "auc": 0.5,
                  "sr_area": 9.5,
                  "al_mean": 10.0,
                  "al_median": null,
                  "al_tracked": 0.0,
                  "mcd_mean": 10.0,
                  "mcd_median": null,
                  "cl_mean": 10.0,
                  "cl_median": null,
                  "jaccard_mean": 0.5,
                  "jaccard_median": 0.5,
                  "grid_mean": null,
                  "grid_median": null,
                  "failures": 1,
                  "frames_per_failure": null
                },
                {
                  "average": "seq_mean",
                  "metric": "al",
                  "protocol": "ope",
                  "sequences": 1,
                  "runs": 1,
                  "failed_runs": 0,
                  "frames": 2,
                  "sr_1": 0.5,
                  "sr_2": 0.5,
                  "sr_5": 0.5,
                  "sr_10": 0.5,
                  "sr_20": 0.5,
                  "auc": 0.5,
                  "sr_area": 9.5,
                  "al_mean": 10.0,
                  "al_median": null,
                  "al_tracked": 0.0,
                  "mcd_mean": 10.0,
                  "mcd_median": null,
                  "cl_mean": 10.0,
                  "cl_median": null,
                  "jaccard_mean": 0.5,
                  "jaccard_median": 0.5,
                  "grid_mean": null,
                  "grid_median": null,
                  "failures": 1,
                  "frames_per_failure": null
                }
              ],
              "sequences": [
                {
                  "dataset": "builtin",
                  "sequence": "wall",
                  "start": 0,
                  "protocol": "ope",
                  "status": "ok",
                  "frames": 2,
                  "sr_1": 0.5,
                  "sr_2": 0.5,
                  "sr_5": 0.5,
                  "sr_10": 0.5,
                  "sr_20": 0.5,
                  "auc": 0.5,
                  "sr_area": 9.5,
                  "al_mean": 10.0,
                  "al_median": null,
                  "al_tracked": 0.0,
                  "mcd_mean": 10.0,
                  "mcd_median": null,
                  "cl_mean": 10.0,
                  "cl_median": null,
                  "jaccard_mean": 0.5,
                  "jaccard_median": 0.5,
                  "grid_mean": null,
                  "grid_median": null,
                  "failures": 1,
                  "frames_per_failure": null
                }
              ]
            }
          ]
        }
        "#);
    }
}
