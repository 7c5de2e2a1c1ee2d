//! Evaluation: errors of frames, figures of sets of frames, their aggregation and the regression gate; plans and
//! their execution into a run directory.

pub mod aggregate;
pub mod baseline;
pub mod basin;
pub mod error;
pub mod framelog;
pub mod gate;
pub mod journal;
mod lanes;
pub mod panics;
pub mod plan;
pub mod rundir;
pub mod runner;
pub mod score;

pub use plan::{FrameLogs, RunRequest, TrackerEntry, Unit};
pub use rundir::RunError;
pub use runner::{Observer, RunReport, Silent, run};

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
