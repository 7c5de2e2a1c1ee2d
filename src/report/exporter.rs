//! What a run leaves behind: one exporter per file, in one table.

use crate::metric::Results;
use crate::report::csv::{CurvesCsv, SequencesCsv, SummaryCsv};
use crate::report::json::SummaryJson;
use crate::report::plot::SuccessSvg;
use crate::store::{Durable, FileError, rundir, write_atomic};
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

/// A file that a run leaves behind.
pub trait Exporter: Send + Sync {
    /// Name of the file in the run directory.
    fn file(&self) -> &str;

    /// What it is, in one line.
    fn summary(&self) -> &str;

    /// Writes the file. The same results give the same bytes.
    ///
    /// # Errors
    /// What the system says, as it says it, so that a full disk is told from other failures; other failures as
    /// [`io::Error::other`].
    fn write(&self, results: &Results, about: &About, out: &mut dyn Write) -> io::Result<()>;
}

/// What the files say about the run as a whole.
#[derive(Clone, Debug)]
pub struct About {
    /// Heading of the plot, also in `summary.json`; must not name host, time or path if bytes are to be reproducible.
    pub title: String,
    /// Checksum of what the results were made from; see [`ended_as`](crate::store::held::ended_as).
    pub made_from: String,
    /// Whether the files hold the curves of single sequences and of all metrics, besides the pooled one of the primary metric.
    pub all_curves: bool,
}

impl Default for About {
    fn default() -> Self {
        About {
            title: "Success rate".to_owned(),
            made_from: String::new(),
            all_curves: true,
        }
    }
}

/// The exporters of this program, in the order in which they write.
pub static EXPORTERS: [&dyn Exporter; 5] =
    [&SequencesCsv, &SummaryCsv, &CurvesCsv, &SummaryJson, &SuccessSvg];

/// Why an exporter cannot be added.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExporterError {
    /// Its file has no name, or one with a folder.
    #[error("'{0}' is no name of a file in a run directory")]
    Name(String),
    /// Its file is another's.
    #[error("there is a file '{0}' already")]
    Taken(String),
}

/// The exporters of a run: those of [`EXPORTERS`], and any that a program adds. Cheap to clone.
#[derive(Clone, Default)]
pub struct Exporters {
    added: Vec<Arc<dyn Exporter>>,
}

impl std::fmt::Debug for Exporters {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.files()).finish()
    }
}

impl Exporters {
    /// Those of [`EXPORTERS`].
    pub fn builtin() -> Exporters {
        Exporters::default()
    }

    /// With one more exporter, which writes last.
    ///
    /// # Errors
    /// Its file cannot have that name.
    pub fn with(&self, exporter: impl Exporter + 'static) -> Result<Exporters, ExporterError> {
        let file = exporter.file();
        let hidden = file.starts_with('.') || file.ends_with(".tmp");
        if file.is_empty() || hidden || file.contains(['/', '\\']) {
            return Err(ExporterError::Name(file.to_owned()));
        }
        if rundir::RESERVED.contains(&file) || self.files().any(|taken| taken == file) {
            return Err(ExporterError::Taken(file.to_owned()));
        }
        let mut extended = self.clone();
        extended.added.push(Arc::new(exporter));
        Ok(extended)
    }

    /// All of them, in the order in which they write.
    pub fn iter(&self) -> impl Iterator<Item = &dyn Exporter> {
        let added = self.added.iter().map(|exporter| &**exporter as &dyn Exporter);
        EXPORTERS.into_iter().chain(added)
    }

    /// The names of their files.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.iter().map(Exporter::file)
    }

    /// Writes all files into the directory `dir`, each complete or not at all.
    ///
    /// # Errors
    /// [`FileError`] naming the file that could not be written.
    pub fn write(&self, dir: &Path, results: &Results, about: &About) -> Result<(), FileError> {
        self.iter().try_for_each(|exporter| {
            let path = dir.join(exporter.file());
            let write = |out: &mut dyn Write| exporter.write(results, about, out);
            write_atomic(&path, Durable::Now, write).map_err(|e| FileError::io(&path, e))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::example;
    use crate::store::summary;

    fn write(dir: &Path, results: &Results, about: &About) -> Result<(), FileError> {
        Exporters::builtin().write(dir, results, about)
    }

    #[test]
    fn same_results_same_bytes_and_nothing_else_left() {
        let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let mut units = example::units();
        write(a.path(), &example::of(&units), &About::default()).unwrap();
        units.reverse();
        // Twice: replaces what is there.
        write(b.path(), &Results::default(), &About::default()).unwrap();
        write(b.path(), &example::of(&units), &About::default()).unwrap();
        for exporter in EXPORTERS {
            let bytes = |dir: &tempfile::TempDir| std::fs::read(dir.path().join(exporter.file())).unwrap();
            assert_eq!(bytes(&a), bytes(&b), "{}", exporter.summary());
        }
        assert_eq!(std::fs::read_dir(b.path()).unwrap().count(), EXPORTERS.len());
    }

    #[test]
    fn a_file_in_the_way_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("file"), "").unwrap();
        let error = write(&dir.path().join("file"), &Results::default(), &About::default()).unwrap_err();
        assert!(error.to_string().contains("sequences.csv"), "{error}");
    }

    #[test]
    fn a_curve_per_tracker_only() {
        let dir = tempfile::tempdir().unwrap();
        let about = About {
            all_curves: false,
            ..About::default()
        };
        let results = example::results();
        write(dir.path(), &results, &about).unwrap();
        let curves = std::fs::read_to_string(dir.path().join("curves.csv")).unwrap();
        assert_eq!(curves.lines().count(), 1 + 11 * 3);
        let read = summary::read(dir.path(), &results.metrics).unwrap();
        assert_eq!(read.results.curves.len(), 0);
    }

    struct Named(&'static str);

    impl Exporter for Named {
        fn file(&self) -> &str {
            self.0
        }
        fn summary(&self) -> &str {
            "its name"
        }
        fn write(&self, _: &Results, _: &About, out: &mut dyn Write) -> io::Result<()> {
            out.write_all(self.0.as_bytes())
        }
    }

    #[test]
    fn files_of_a_programs_own() {
        for name in ["", "a/b", "..", ".lock", "a.tmp"] {
            let refused = Exporters::builtin().with(Named(name)).unwrap_err();
            assert_eq!(refused, ExporterError::Name(name.to_owned()));
        }
        for name in ["summary.csv", "run.json", "frames"] {
            let refused = Exporters::builtin().with(Named(name)).unwrap_err();
            assert_eq!(refused, ExporterError::Taken(name.to_owned()));
        }
        let exporters = Exporters::builtin().with(Named("own.txt")).unwrap();
        assert!(exporters.with(Named("own.txt")).is_err());
        let dir = tempfile::tempdir().unwrap();
        exporters
            .write(dir.path(), &example::results(), &About::default())
            .unwrap();
        assert_eq!(
            std::fs::read_to_string(dir.path().join("own.txt")).unwrap(),
            "own.txt"
        );
    }
}
