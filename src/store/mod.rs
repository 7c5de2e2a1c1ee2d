//! A run directory on disk: lock, journal, frame logs, truth, atomic files. Depends on `plan`.

pub mod atomic;
mod error;
pub mod framelog;
pub mod journal;
pub mod lock;
pub mod rundir;
pub mod status;
pub mod truth;

pub use atomic::{Durable, write_atomic};
pub use error::StoreError;

/// The time now, UTC, RFC 3339 to the second.
pub(crate) fn utc_now() -> String {
    let now = time::OffsetDateTime::now_utc();
    now.replace_nanosecond(0)
        .unwrap_or(now)
        .format(&time::format_description::well_known::Rfc3339)
        .unwrap_or_default()
}
