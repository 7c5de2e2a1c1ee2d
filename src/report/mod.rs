//! What a run leaves behind and prints: CSV, JSON, the success plot and the table. Depends on [`crate::eval`]'s rows.
//!
//! Every file is written under a temporary name, synced and renamed; the same results give the same bytes.

mod bars;
mod csv;
mod json;
mod junit;
mod plot;
mod table;

pub use bars::bars_svg;
pub use json::{SCHEMA_VERSION, Thresholds, read_summary, read_with_thresholds, summary_json};
pub use junit::junit;
pub use plot::success_svg;
pub use table::{Format, SORT_KEYS, TableOptions, parse_sort, render, table};

use crate::metric::aggregate::Results;
use crate::store::{Durable, write_atomic};
use std::io::{self, Write};
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
    #[error("plot: {0}")]
    Plot(String),
    /// The JUnit report could not be written.
    #[error("JUnit report: {0}")]
    Report(String),
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

/// Writes `summary.csv`, `sequences.csv`, `curves.csv`, `summary.json` and `success.svg` into the directory `dir`.
///
/// # Errors
/// [`OutputError`] naming the file that could not be written.
pub fn write_results(dir: &Path, results: &Results, meta: &Meta) -> Result<(), OutputError> {
    let file = |name: &str, write: &dyn Fn(&mut dyn Write) -> io::Result<()>| {
        let path = dir.join(name);
        write_atomic(&path, Durable::Now, write).map_err(|source| OutputError::Io { path, source })
    };
    file("sequences.csv", &|w| csv::sequences(w, results))?;
    file("summary.csv", &|w| csv::summary(w, &results.summary))?;
    file("curves.csv", &|w| csv::curves(w, results, meta.sequence_curves))?;
    file("summary.json", &|w| json::write(w, results, meta))?;
    let svg = success_svg(results, &meta.title)?;
    file("success.svg", &|w| w.write_all(svg.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::{aggregate, example};

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
    fn a_file_in_the_way_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("file"), "").unwrap();
        let error =
            write_results(&dir.path().join("file"), &Results::default(), &Meta::default()).unwrap_err();
        assert!(error.to_string().contains("sequences.csv"), "{error}");
    }

    #[test]
    fn csv_files() {
        let dir = tempfile::tempdir().unwrap();
        write_results(dir.path(), &aggregate(&example::units()), &Meta::default()).unwrap();
        let read = |f: &str| std::fs::read_to_string(dir.path().join(f)).unwrap();
        insta::assert_snapshot!(read("summary.csv"), @"
        tracker,sm,am,ssm,ilm,average,metric,protocol,sequences,runs,failed_runs,frames,sr_1,sr_2,sr_5,sr_10,sr_20,auc,sr_area,al_mean,al_median,al_tracked,mcd_mean,mcd_median,cl_mean,cl_median,jaccard_mean,jaccard_median,grid_mean,grid_median,failures,frames_per_failure
        esm/ssd/homography,esm,ssd,homography,,pooled,al,ope,2,2,0,6,0.833333,0.833333,1.000000,1.000000,1.000000,0.963333,18.501684,0.808333,0.175000,0.808333,0.808333,0.175000,0.808333,0.175000,0.015643,0.003493,,,0,
        esm/ssd/homography,esm,ssd,homography,,seq_mean,al,ope,2,2,0,6,0.875000,0.875000,1.000000,1.000000,1.000000,0.972500,18.623738,0.618750,0.212500,0.618750,0.618750,0.212500,0.618750,0.212500,0.011982,0.004234,,,0,
        iclk/ssd/affine,iclk,ssd,affine,,pooled,al,ope,2,2,0,6,0.333333,0.500000,0.666667,0.666667,0.666667,0.633333,12.323232,7.400000,2.000000,1.100000,7.400000,2.000000,7.400000,2.000000,0.257976,0.039168,,,2,
        iclk/ssd/affine,iclk,ssd,affine,,seq_mean,al,ope,2,2,0,6,0.500000,0.625000,0.750000,0.750000,0.750000,0.723750,13.989899,5.600000,8.225000,1.100000,5.600000,8.225000,5.600000,8.225000,0.194480,0.129575,,,2,
        nn/mi/affine,nn,mi,affine,,pooled,al,ope,1,1,1,2,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,20.000000,inf,,20.000000,inf,20.000000,inf,1.000000,1.000000,,,2,
        nn/mi/affine,nn,mi,affine,,seq_mean,al,ope,1,1,1,2,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,20.000000,inf,,20.000000,inf,20.000000,inf,1.000000,1.000000,,,2,
        ");
        insta::assert_snapshot!(read("sequences.csv"), @"
        tracker,sm,am,ssm,ilm,dataset,sequence,start,protocol,status,frames,sr_1,sr_2,sr_5,sr_10,sr_20,auc,sr_area,al_mean,al_median,al_tracked,mcd_mean,mcd_median,cl_mean,cl_median,jaccard_mean,jaccard_median,grid_mean,grid_median,failures,frames_per_failure,reason
        esm/ssd/homography,esm,ssd,homography,,builtin,book,0,ope,ok,2,1.000000,1.000000,1.000000,1.000000,1.000000,1.000000,18.989899,0.050000,0.050000,0.050000,0.050000,0.050000,0.050000,0.050000,0.000999,0.000999,,,0,,
        esm/ssd/homography,esm,ssd,homography,,builtin,wall,0,ope,ok,4,0.750000,0.750000,1.000000,1.000000,1.000000,0.945000,18.257576,1.187500,0.375000,1.187500,1.187500,0.375000,1.187500,0.375000,0.022965,0.007469,,,0,,
        iclk/ssd/affine,iclk,ssd,affine,,builtin,book,0,ope,ok,2,1.000000,1.000000,1.000000,1.000000,1.000000,0.995000,18.989899,0.200000,0.200000,0.200000,0.200000,0.200000,0.200000,0.200000,0.003990,0.003990,,,0,,
        iclk/ssd/affine,iclk,ssd,affine,,builtin,wall,0,ope,ok,4,0.000000,0.250000,0.500000,0.500000,0.500000,0.452500,8.989899,11.000000,16.250000,2.000000,11.000000,16.250000,11.000000,16.250000,0.384969,0.255159,,,2,,
        nn/mi/affine,nn,mi,affine,,builtin,wall,0,ope,failed,2,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,0.000000,20.000000,inf,,20.000000,inf,20.000000,inf,1.000000,1.000000,,,2,,panicked at frame 1
        ");
        let curves = read("curves.csv");
        assert_eq!(curves.lines().count(), 1 + 101 * (3 * 4 + 5));
        insta::assert_snapshot!(curves.lines().take(4).collect::<Vec<_>>().join("\n"), @"
        tracker,dataset,sequence,metric,threshold,success_rate,protocol
        esm/ssd/homography,all,pooled,al,0.00,0.333333,ope
        esm/ssd/homography,all,pooled,al,0.20,0.500000,ope
        esm/ssd/homography,all,pooled,al,0.40,0.666667,ope
        ");
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
