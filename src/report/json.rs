//! `summary.json`: everything in the CSV files, nested by tracker.

use crate::metric::Results;
use crate::report::{About, Exporter};
use crate::store::summary::{self, Heading};
use std::io::{self, Write};

/// `summary.json`, which [`summary::read`] reads back.
pub(super) struct SummaryJson;

impl Exporter for SummaryJson {
    fn file(&self) -> &str {
        summary::FILE
    }

    fn summary(&self) -> &str {
        "all figures, nested by tracker"
    }

    fn write(&self, results: &Results, about: &About, out: &mut dyn Write) -> io::Result<()> {
        let heading = Heading {
            title: &about.title,
            made_from: &about.made_from,
        };
        summary::write(out, results, heading)
    }
}
