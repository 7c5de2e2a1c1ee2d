//! What is asked of a run and what it consists of: requests, experiment files, protocols, units, keys, shards.
//! Depends on `dataset` and `metric`.

pub mod experiment_file;
pub mod plan;
pub mod protocol;
pub mod request;
pub mod shard;

pub use plan::{FrameLogs, Plan, Unit};
pub use protocol::{Protocol, Protocols};
pub use request::{RunRequest, TrackerEntry};
pub use shard::{Cut, Shard};
