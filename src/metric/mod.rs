//! Metrics: errors of frames, figures of sets of frames, and their aggregation. Depends on `mtf::geom` alone.

pub mod aggregate;
pub mod error;
pub mod score;
