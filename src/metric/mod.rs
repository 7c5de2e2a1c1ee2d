//! What is measured: metrics of a frame, figures of a set of frames, and their aggregation over frames and sequences.
//! Depends on [`mtf::geom`] alone.
//!
//! Two tables say everything: [`METRICS`] (one row per metric, each in a file of its own) and
//! [`FIGURES`](figure::FIGURES) (what is made of the errors of a set of frames). A [`MetricSet`] holds the metrics of a
//! run: those of the table, and any that a program adds. Columns of result files and frame logs, curves, comparison,
//! gates and `list metrics` follow from it.

pub mod aggregate;
pub mod al;
pub mod best_rotation;
pub mod cl;
pub mod direction;
pub mod errors;
pub mod figure;
pub mod grid;
pub mod hd;
pub mod jaccard;
pub mod mcd;
pub mod normalised_cl;
pub mod quantile;
pub mod relative_al;
pub mod sample;
pub mod score;
pub mod set;

pub use aggregate::Results;
pub use direction::Direction;
pub use errors::Errors;
pub use figure::Figure;
pub use sample::Sample;
pub use score::Score;
pub use set::{Definition, Metric, MetricError, MetricSet};

/// The metrics of this program, in the order in which files list them. The first is the one that success rates,
/// failures and rankings are of.
pub static METRICS: [Metric; 5] = [al::METRIC, mcd::METRIC, cl::METRIC, jaccard::METRIC, grid::METRIC];

/// Metrics of the field that are not measured in every run: figures of benchmarks are made of them
/// ([`judge::field`](crate::judge::field)), and a program may add them to its own with [`MetricSet::with`].
pub static MORE_METRICS: [Metric; 4] = [
    hd::METRIC,
    best_rotation::METRIC,
    relative_al::METRIC,
    normalised_cl::METRIC,
];
