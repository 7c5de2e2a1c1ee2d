//! Who watches a run: how far it is, and what the user should know.

use crate::store::journal::Entry;
use std::time::Duration;

/// Watches a run. Called from many threads.
pub trait Observer: Sync {
    /// About to track: `pending` of `units` are left to do, `frames` tracker frames in all.
    fn begin(&self, units: usize, pending: usize, frames: u64) {
        let _ = (units, pending, frames);
    }
    /// `count` more tracker frames are done.
    fn frames(&self, count: u64) {
        let _ = count;
    }
    /// A unit has ended.
    fn unit(&self, entry: &Entry) {
        let _ = entry;
    }
    /// Asked to stop; what is in progress has `grace` to end.
    fn stopping(&self, grace: Duration) {
        let _ = grace;
    }
    /// All units have ended, or the run stops early.
    fn end(&self) {}
    /// Something the user should know.
    fn warn(&self, message: &str) {
        let _ = message;
    }
}

/// Watches nothing.
#[derive(Clone, Copy, Debug)]
pub struct Silent;

impl Observer for Silent {}
