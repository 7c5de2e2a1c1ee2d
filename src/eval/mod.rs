//! Evaluation: errors of frames, figures of sets of frames, their aggregation and the regression gate.

pub mod aggregate;
pub mod baseline;
pub mod error;
pub mod gate;
pub mod score;
