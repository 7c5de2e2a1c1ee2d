//! Evaluation: errors of frames, figures of sets of frames, their aggregation and the regression gate; plans and
//! their execution into a run directory.

pub mod aggregate;
pub mod baseline;
pub mod basin;
pub mod bench;
pub mod compare;
pub mod error;
pub mod estimate;
mod finish;
pub mod framelog;
pub mod gate;
pub mod grid;
pub mod journal;
mod lanes;
pub mod lock;
pub mod machine;
pub mod merge;
pub mod panics;
mod pass;
pub mod plan;
pub mod profile;
pub mod protocol;
pub mod request;
pub mod rundir;
pub mod runner;
pub mod score;
pub mod shard;
pub mod stats;
pub mod status;
pub mod tolerances;
mod truth;

pub use plan::{FrameLogs, Plan, Unit};
pub use protocol::{Protocol, Protocols};
pub use request::{RunRequest, TrackerEntry};
pub use rundir::RunError;
pub use runner::{Observer, RunReport, Silent, run};
pub use shard::{Cut, Shard};

/// The time now, UTC, RFC 3339 to the second.
pub(crate) fn utc_now() -> String {
    let now = time::OffsetDateTime::now_utc();
    now.replace_nanosecond(0)
        .unwrap_or(now)
        .format(&time::format_description::well_known::Rfc3339)
        .unwrap_or_default()
}

#[cfg(test)]
mod tests;
