//! A run directory on disk: lock, journal, frame logs, truth, `summary.json`, atomic files. Depends on `metric` and
//! `plan`.

pub mod atomic;
mod error;
pub mod file;
pub mod framelog;
pub mod held;
pub mod host;
pub mod journal;
pub mod lock;
pub mod packed;
pub mod rundir;
pub mod status;
pub mod summary;
pub mod truth;

pub use atomic::{Durable, write_atomic};
pub use error::{StoreError, is_full};
pub use file::FileError;
