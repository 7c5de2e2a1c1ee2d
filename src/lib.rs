//! Registration-based tracking, decomposed into search method x appearance model x state space model, and its
//! evaluation on image sequences with ground truth.
#![deny(missing_docs)]

pub mod am;
pub mod dataset;
pub mod diagnose;
pub mod estimate;
pub mod eval;
pub mod geom;
pub mod image;
pub mod kernels;
pub mod output;
pub mod params;
pub mod registry;
pub mod sm;
pub mod ssm;
pub mod synth;
pub mod tracker;
