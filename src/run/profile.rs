//! Where the time of a run goes.

use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// What a worker does.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Activity {
    Reading,
    Filtering,
    Tracking,
    Writing,
}

/// Time spent with each activity, by all threads together.
#[derive(Debug, Default)]
pub(crate) struct Spent([AtomicU64; 4]);

impl Spent {
    /// Does it and adds the time it takes.
    pub fn on<R>(&self, activity: Activity, act: impl FnOnce() -> R) -> R {
        let begin = Instant::now();
        let result = act();
        self.0[activity as usize].fetch_add(begin.elapsed().as_nanos() as u64, Ordering::Relaxed);
        result
    }

    /// Time of reading and filtering relative to that of tracking.
    pub fn reading_share(&self) -> f64 {
        let seconds = |a: Activity| self.0[a as usize].load(Ordering::Relaxed) as f64;
        (seconds(Activity::Reading) + seconds(Activity::Filtering)) / seconds(Activity::Tracking).max(1.0)
    }

    /// The account of a run that took `wall` seconds on `threads` threads.
    pub fn profile(&self, wall: f64, threads: usize) -> Profile {
        let seconds = |a: Activity| self.0[a as usize].load(Ordering::Relaxed) as f64 * 1e-9;
        Profile {
            wall,
            threads,
            reading: seconds(Activity::Reading),
            filtering: seconds(Activity::Filtering),
            tracking: seconds(Activity::Tracking),
            writing: seconds(Activity::Writing),
        }
    }
}

/// Seconds that a run's threads spent, summed over them. A thread that helps another tracker while it waits for its own
/// counts for both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// From the first unit to the last, by the clock.
    pub wall: f64,
    /// Worker threads.
    pub threads: usize,
    /// Reading and decoding frames.
    pub reading: f64,
    /// Converting and filtering them.
    pub filtering: f64,
    /// In trackers.
    pub tracking: f64,
    /// Scoring and writing logs.
    pub writing: f64,
}

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = self.wall * self.threads as f64;
        let share = |seconds: f64| 100.0 * seconds / all.max(1e-9);
        let known = self.reading + self.filtering + self.tracking + self.writing;
        write!(
            f,
            "{:.1} s on {} threads: reading {:.1} %, filtering {:.1} %, tracking {:.1} %, writing {:.1} %, waiting {:.1} %",
            self.wall,
            self.threads,
            share(self.reading),
            share(self.filtering),
            share(self.tracking),
            share(self.writing),
            share((all - known).max(0.0)),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_of_all_threads() {
        let profile = Profile {
            wall: 10.0,
            threads: 2,
            reading: 4.0,
            filtering: 1.0,
            tracking: 12.0,
            writing: 1.0,
        };
        assert_eq!(
            profile.to_string(),
            "10.0 s on 2 threads: reading 20.0 %, filtering 5.0 %, tracking 60.0 %, writing 5.0 %, waiting 10.0 %"
        );
        let spent = Spent::default();
        assert_eq!(spent.on(Activity::Tracking, || 7), 7);
        assert_eq!(spent.profile(1.0, 1).reading, 0.0);
        assert_eq!(spent.reading_share(), 0.0);
    }
}
