//! A run directory on disk: lock, journal, frame logs, truth, atomic files. Depends on `plan`.

pub mod atomic;
mod error;
pub mod framelog;
pub(crate) mod host;
pub mod journal;
pub mod lock;
pub mod rundir;
pub mod status;
pub mod truth;

pub use atomic::{Durable, write_atomic};
pub use error::StoreError;
