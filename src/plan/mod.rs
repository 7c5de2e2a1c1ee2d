//! What is asked of a run and what it consists of: requests, experiment files, protocols, units, keys, seeds, shards.
//! Depends on `dataset` and `metric`.

mod data_notes;
mod error;
mod experiment_file;
mod keys;
mod protocol;
mod remaining;
mod replay;
mod request;
mod seed;
mod shard;
mod spread;
mod tracker;
mod union;
mod units;

pub use data_notes::{DataNote, DataNotes};
pub use error::PlanError;
pub use experiment_file::{ExperimentFile, ExperimentFileError, Located};
pub use keys::{UnitKey, UnitKeys};
pub use protocol::{Protocol, ProtocolError, Protocols};
pub use remaining::Remaining;
pub(crate) use request::Prepared;
pub use request::{RunRequest, RunRequestBuilder, USUAL_FILTER, sequence_id, usual_filter};
pub use seed::derived_seed;
pub use shard::{Cut, Shard, ShardError, Sharding};
pub(crate) use spread::spread;
pub use tracker::{Answers, Job, Make, TrackerEntry};
pub use union::Joined;
pub use units::{FrameLogs, Plan, PlannedSequence, PlannedTracker, RUN_FORMAT_VERSION, Unit};
