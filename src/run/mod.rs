//! Runs: from a request to result files. Depends on `plan`, `store`, `measure` and `report`.

pub mod cost;
mod error;
mod finish;
pub mod merge;
mod observer;
mod partial;
mod pass;
mod pool;
pub mod profile;
mod runner;
mod schedule;
mod watch;

pub use error::RunError;
pub use observer::{Observer, Silent, Work};
pub use partial::{Partial, partial};
pub use pool::pool;
pub use runner::{RunReport, run};

#[cfg(test)]
mod tests;
