//! `summary.json`: everything in the CSV files, nested by tracker; written and read back.

use super::{Meta, OutputError};
use crate::metric::aggregate::{CurveRow, Results, SequenceRow, SummaryRow, TrackerName};
use crate::metric::error::Metric;
use crate::metric::score::thresholds;
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::path::Path;

/// Version of `summary.json`; changes when a reader of the former version would misread it.
pub const SCHEMA_VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
struct Document<T> {
    schema_version: u32,
    tool: String,
    version: String,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    title: String,
    /// Thresholds of the curves of each metric.
    thresholds: Thresholds,
    trackers: Vec<T>,
}

/// Thresholds of the success curves of each metric.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // one field per metric
pub struct Thresholds {
    pub al: Vec<f64>,
    pub mcd: Vec<f64>,
    pub cl: Vec<f64>,
    pub jaccard: Vec<f64>,
    pub grid: Vec<f64>,
}

impl Default for Thresholds {
    /// Those of this program.
    fn default() -> Self {
        Thresholds {
            al: thresholds(Metric::Al),
            mcd: thresholds(Metric::Mcd),
            cl: thresholds(Metric::Cl),
            jaccard: thresholds(Metric::Jaccard),
            grid: thresholds(Metric::Grid),
        }
    }
}

/// One tracker; borrowed for writing, owned for reading.
#[derive(Serialize, Deserialize)]
struct Tracker<N, A, S, C> {
    #[serde(flatten)]
    name: N,
    aggregates: Vec<A>,
    sequences: Vec<S>,
    #[serde(default = "Vec::new", skip_serializing_if = "Vec::is_empty")]
    curves: Vec<C>,
}

type Borrowed<'a> = Tracker<&'a TrackerName, &'a SummaryRow, &'a SequenceRow, &'a CurveRow>;
type Owned = Tracker<TrackerName, SummaryRow, SequenceRow, CurveRow>;

/// Rows of `results` by tracker, in the order of `order`.
fn nest<'a>(
    results: &'a Results,
    order: &[&'a TrackerName],
    keep: impl Fn(&CurveRow) -> bool,
) -> Vec<Borrowed<'a>> {
    let mut trackers: Vec<Borrowed> = Vec::new();
    let mut index = std::collections::BTreeMap::new();
    for name in order {
        index.entry(*name).or_insert_with(|| {
            trackers.push(Tracker {
                name,
                aggregates: vec![],
                sequences: vec![],
                curves: vec![],
            });
            trackers.len() - 1
        });
    }
    for row in &results.summary {
        index
            .get(&row.tracker)
            .into_iter()
            .for_each(|&i| trackers[i].aggregates.push(row));
    }
    for row in &results.sequences {
        index
            .get(&row.tracker)
            .into_iter()
            .for_each(|&i| trackers[i].sequences.push(row));
    }
    for row in results.curves.iter().filter(|c| keep(c)) {
        index
            .get(&row.tracker)
            .into_iter()
            .for_each(|&i| trackers[i].curves.push(row));
    }
    trackers
}

fn document<'a>(title: &str, trackers: Vec<Borrowed<'a>>) -> Document<Borrowed<'a>> {
    Document {
        schema_version: SCHEMA_VERSION,
        tool: env!("CARGO_PKG_NAME").to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        title: title.to_owned(),
        thresholds: Thresholds::default(),
        trackers,
    }
}

/// Writes `summary.json` on one line.
pub(super) fn write(out: &mut dyn Write, results: &Results, meta: &Meta) -> io::Result<()> {
    let order: Vec<&TrackerName> = results.summary.iter().map(|r| &r.tracker).collect();
    let trackers = nest(results, &order, |c| meta.sequence_curves || c.is_pooled());
    serde_json::to_writer(&mut *out, &document(&meta.title, trackers))?;
    writeln!(out)
}

/// The document without curves, indented, trackers in the given order: for standard output.
pub fn summary_json(results: &Results, order: &[&TrackerName]) -> String {
    let document = document("", nest(results, order, |_| false));
    // Strings and numbers always serialise; an empty text would only follow from a bug in serde.
    serde_json::to_string_pretty(&document).unwrap_or_default()
}

/// Reads the `summary.json` of a run directory.
///
/// # Errors
/// [`OutputError`] when the file is missing, damaged or of another schema version.
pub fn read_summary(dir: &Path) -> Result<Results, OutputError> {
    Ok(read_with_thresholds(dir)?.0)
}

/// [`read_summary`], and the thresholds that its success rates are of.
///
/// # Errors
/// As [`read_summary`].
pub fn read_with_thresholds(dir: &Path) -> Result<(Results, Thresholds), OutputError> {
    let path = dir.join("summary.json");
    let text = std::fs::read(&path).map_err(|source| OutputError::Io {
        path: path.clone(),
        source,
    })?;
    let wrong = |reason: String| OutputError::Format {
        path: path.clone(),
        reason,
    };
    #[derive(Deserialize)]
    struct Version {
        schema_version: u32,
    }
    let Version { schema_version } = serde_json::from_slice(&text).map_err(|e| wrong(e.to_string()))?;
    if schema_version != SCHEMA_VERSION {
        return Err(wrong(format!(
            "schema version {schema_version}, this program reads version {SCHEMA_VERSION}"
        )));
    }
    let document: Document<Owned> = serde_json::from_slice(&text).map_err(|e| wrong(e.to_string()))?;
    let mut results = Results::default();
    for Tracker {
        name,
        aggregates,
        sequences,
        curves,
    } in document.trackers
    {
        let tracker = || name.clone();
        let summary = aggregates.into_iter();
        results.summary.extend(summary.map(|r| SummaryRow {
            tracker: tracker(),
            score: r.score.after_reading(),
            ..r
        }));
        let sequences = sequences.into_iter();
        results.sequences.extend(sequences.map(|r| SequenceRow {
            tracker: tracker(),
            score: r.score.after_reading(),
            ..r
        }));
        results.curves.extend(curves.into_iter().map(|r| CurveRow {
            tracker: tracker(),
            ..r
        }));
    }
    Ok((results, document.thresholds))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::{aggregate, example};

    #[test]
    fn reads_what_it_wrote() {
        let mut units = example::units();
        units.push(example::unit("nn/mi/affine", "void", &[]));
        let results = aggregate(&units);
        let dir = tempfile::tempdir().unwrap();
        super::super::write_results(dir.path(), &results, &Meta::default()).unwrap();
        assert_eq!(
            format!("{:?}", read_summary(dir.path()).unwrap()),
            format!("{results:?}")
        );
    }

    #[test]
    fn refuses_other_versions_and_damage() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(read_summary(dir.path()), Err(OutputError::Io { .. })));
        std::fs::write(dir.path().join("summary.json"), r#"{"schema_version": 99}"#).unwrap();
        assert!(
            read_summary(dir.path())
                .unwrap_err()
                .to_string()
                .contains("schema version 99")
        );
        std::fs::write(dir.path().join("summary.json"), r#"{"schema_version": 1, "tr"#).unwrap();
        assert!(matches!(
            read_summary(dir.path()),
            Err(OutputError::Format { .. })
        ));
    }

    #[test]
    fn shape() {
        let units = [example::unit("esm/ssd/homography", "wall", &[Some(0.0), None])];
        let results = aggregate(&units);
        let text = summary_json(&results, &[&results.summary[0].tracker]);
        let mut value: serde_json::Value = serde_json::from_str(&text).unwrap();
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
                  "sr_area": 9.494949,
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
                  "sr_area": 9.494949,
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
                  "sr_area": 9.494949,
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
