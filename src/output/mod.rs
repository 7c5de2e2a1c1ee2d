//! What a run leaves behind and prints: CSV, JSON, the success plot and the table. Depends on [`crate::eval`]'s rows.
//!
//! Every file is written under a temporary name, synced and renamed; the same results give the same bytes.

mod atomic;
mod csv;
mod json;
mod plot;
mod table;

pub use atomic::write_atomic;
pub use json::{SCHEMA_VERSION, read_summary, summary_json};
pub use plot::success_svg;
pub use table::{Format, SORT_KEYS, TableOptions, parse_sort, render, table};

use crate::eval::aggregate::Results;
use std::path::{Path, PathBuf};

/// A result file could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// Reading, writing, syncing or renaming failed.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not what its name promises.
    #[error("{path}: {reason}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The plot could not be drawn.
    #[error("success plot: {0}")]
    Plot(String),
}

/// What the files say about the run as a whole.
#[derive(Clone, Debug)]
pub struct Meta {
    /// Heading of the plot, also in `summary.json`; must not name host, time or path if bytes are to be reproducible.
    pub title: String,
    /// Whether `curves.csv` and `summary.json` hold the curves of single sequences (100 lines each) besides the pooled
    /// ones.
    pub sequence_curves: bool,
}

impl Default for Meta {
    fn default() -> Self {
        Meta {
            title: "Success rate".to_owned(),
            sequence_curves: true,
        }
    }
}

/// Writes `summary.csv`, `sequences.csv`, `curves.csv`, `summary.json` and `success.svg` into the existing directory
/// `dir`.
///
/// # Errors
/// [`OutputError`] naming the file that could not be written.
pub fn write_results(dir: &Path, results: &Results, meta: &Meta) -> Result<(), OutputError> {
    write_atomic(&dir.join("sequences.csv"), |w| csv::sequences(w, results))?;
    write_atomic(&dir.join("summary.csv"), |w| csv::summary(w, &results.summary))?;
    write_atomic(&dir.join("curves.csv"), |w| {
        csv::curves(w, results, meta.sequence_curves)
    })?;
    write_atomic(&dir.join("summary.json"), |w| json::write(w, results, meta))?;
    let svg = success_svg(results, &meta.title)?;
    write_atomic(&dir.join("success.svg"), |w| w.write_all(svg.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::aggregate::{aggregate, example};

    const FILES: [&str; 5] = [
        "summary.csv",
        "sequences.csv",
        "curves.csv",
        "summary.json",
        "success.svg",
    ];

    #[test]
    fn same_results_same_bytes_and_nothing_else_left() {
        let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let mut units = example::units();
        write_results(a.path(), &aggregate(&units), &Meta::default()).unwrap();
        units.reverse();
        // Twice: replaces what is there.
        write_results(b.path(), &Results::default(), &Meta::default()).unwrap();
        write_results(b.path(), &aggregate(&units), &Meta::default()).unwrap();
        for file in FILES {
            assert_eq!(
                std::fs::read(a.path().join(file)).unwrap(),
                std::fs::read(b.path().join(file)).unwrap()
            );
        }
        assert_eq!(std::fs::read_dir(b.path()).unwrap().count(), FILES.len());
    }

    #[test]
    fn missing_directory_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let error = write_results(&dir.path().join("no"), &Results::default(), &Meta::default()).unwrap_err();
        assert!(error.to_string().contains("sequences.csv"), "{error}");
    }

    #[test]
    fn csv_files() {
        let dir = tempfile::tempdir().unwrap();
        write_results(dir.path(), &aggregate(&example::units()), &Meta::default()).unwrap();
        let read = |f: &str| std::fs::read_to_string(dir.path().join(f)).unwrap();
        insta::assert_snapshot!(read("summary.csv"), @"");
        insta::assert_snapshot!(read("sequences.csv"), @"");
        let curves = read("curves.csv");
        assert_eq!(curves.lines().count(), 1 + 101 * (3 * 4 + 5));
        insta::assert_snapshot!(curves.lines().take(4).collect::<Vec<_>>().join("\n"), @"");
    }

    #[test]
    fn pooled_curves_only() {
        let dir = tempfile::tempdir().unwrap();
        let meta = Meta {
            sequence_curves: false,
            ..Meta::default()
        };
        write_results(dir.path(), &aggregate(&example::units()), &meta).unwrap();
        let curves = std::fs::read_to_string(dir.path().join("curves.csv")).unwrap();
        assert_eq!(curves.lines().count(), 1 + 101 * 3 * 4);
        assert_eq!(read_summary(dir.path()).unwrap().curves.len(), 3 * 4);
    }
}
