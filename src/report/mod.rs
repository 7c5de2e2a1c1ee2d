//! What a run leaves behind and prints: CSV, JSON, the success plot and tables; the gate's findings as JUnit XML; speeds as
//! bars; basins of convergence as curves. Depends on `metric`, `judge`, `measure` and `store`.
//!
//! [`EXPORTERS`] is the table of the files that a run leaves behind. Every file is written under a temporary name, synced
//! and renamed; the same results give the same bytes.

mod bars;
mod basin;
mod csv;
mod exporter;
mod json;
mod junit;
mod plot;
mod table;
pub mod text;

pub use bars::bars_svg;
pub use basin::basin_svg;
pub use exporter::{About, EXPORTERS, Exporter, ExporterError, Exporters};
pub use junit::junit;
pub use plot::success_svg;
pub use table::{Format, TableOptions, parse_sort, render, sort_keys, table};

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
