//! Who watches a run: how far it is, and what the user should know.

use crate::metric::Errors;
use crate::plan::{Plan, Unit};
use crate::store::journal::Entry;
use std::time::Duration;

/// What a run begins with.
#[derive(Clone, Copy, Debug)]
pub struct Work<'a> {
    /// The whole plan.
    pub plan: &'a Plan,
    /// Units that the run is for.
    pub units: usize,
    /// Those that are left to track.
    pub pending: &'a [Unit],
}

/// Watches a run. Called from many threads.
pub trait Observer: Sync {
    /// About to track.
    fn begin(&self, work: &Work<'_>) {
        let _ = work;
    }
    /// The tracker of this number in the plan is done with `count` more frames; starts and updates took `seconds`. Told
    /// several times a second.
    fn frames(&self, tracker: u32, count: u64, seconds: f64) {
        let _ = (tracker, count, seconds);
    }
    /// A unit has ended. `errors` computes those of its frames.
    fn unit(&self, entry: &Entry, errors: &dyn Fn() -> Errors) {
        let _ = (entry, errors);
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
