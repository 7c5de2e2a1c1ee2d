//! Runs: from a request to result files. Depends on everything but `cli`.

pub mod cost;
mod error;
mod finish;
pub mod merge;
mod pass;
pub mod profile;
pub mod runner;
mod schedule;

pub use error::RunError;
pub use runner::{Observer, RunReport, Silent, run};

#[cfg(test)]
mod tests;
