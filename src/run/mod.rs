//! Runs: from a request to result files. Depends on `plan`, `store`, `measure` and `report`.

pub mod cost;
mod error;
mod finish;
pub mod merge;
mod observer;
mod pass;
mod pool;
pub mod profile;
mod runner;
mod schedule;
mod so_far;
mod watch;

pub use error::RunError;
pub use observer::{Observer, Silent, Work};
pub use pool::pool;
pub use runner::{RunReport, run};
pub use so_far::{SoFar, so_far};

#[cfg(test)]
mod tests;
