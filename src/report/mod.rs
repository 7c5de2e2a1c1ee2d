//! What a run leaves behind and prints: CSV, JSON, the success plot and tables; the gate's findings as JUnit XML and for
//! GitLab; speeds as bars; basins of convergence as curves. Depends on `metric`, `judge`, `measure` and `store`.
//!
//! [`EXPORTERS`] is the table of the files that a run leaves behind. Every file is written under a temporary name, synced
//! and renamed; the same results give the same bytes.

mod bars;
mod basin;
mod code_quality;
mod csv;
mod exporter;
mod field;
mod json;
mod junit;
mod plot;
mod problems;
mod standings;
mod table;
pub mod text;

pub use bars::bars_svg;
pub use basin::basin_svg;
pub use code_quality::code_quality;
pub use exporter::{About, EXPORTERS, Exporter, ExporterError, Exporters};
pub use field::field_table;
pub use junit::junit;
pub use plot::{NamedCurve, curves_svg, success_curves, success_subject, success_svg};
pub use problems::with_frames;
pub use standings::top;
pub use table::{Format, TableOptions, json_text, render, table};

/// A picture or report could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The plot could not be drawn.
    #[error("plot: {0}")]
    Plot(String),
    /// The JUnit report could not be written.
    #[error("JUnit report: {0}")]
    Junit(String),
}
