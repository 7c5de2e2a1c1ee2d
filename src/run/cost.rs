//! What a plan will cost, from a few of its units tracked for a few frames.
//!
//! Units are taken evenly over trackers and sequences. With mean time `i` to start and `u` per update, a plan of `U` units
//! and `F` frames takes `U i + (F - U) u` of one core.

use crate::plan::{FrameLogs, PlanError, Protocol, RunRequestBuilder, UnitKeys, spread};
use crate::report::Exporters;
use crate::run::error::RunError;
use crate::run::observer::Silent;
use crate::run::runner::run;
use crate::store::StoreError;
use crate::store::journal::Journal;
use std::sync::atomic::AtomicBool;

/// Frames that a unit is tracked for after the first.
const UPDATES: usize = 10;

/// Mean times of the measured units.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    /// Units measured.
    pub units: usize,
    /// Time to start a unit, s.
    pub init: f64,
    /// Time of an update, s.
    pub update: f64,
    /// Variance of the time of a measured unit over that of its square mean.
    relative_variance: f64,
}

impl Cost {
    /// Time of one core for `units` units of `frames` frames together, s.
    pub fn seconds(&self, units: f64, frames: f64) -> f64 {
        units * self.init + (frames - units).max(0.0) * self.update
    }

    /// Standard error of [`seconds`](Self::seconds), as a share of it.
    pub fn relative_error(&self) -> f64 {
        (self.relative_variance / self.units.max(1) as f64).sqrt()
    }
}

/// Tracks `count` units of `request` for a few frames each, on one thread, in a temporary directory.
///
/// # Errors
/// As a run; [`PlanError::Nothing`] when none of them could be tracked.
pub fn measure(request: &RunRequestBuilder, count: usize) -> Result<Cost, RunError> {
    let plan = request.plan()?;
    let temporary =
        tempfile::tempdir().map_err(|e| StoreError::io(std::path::Path::new("temporary folder"), e))?;
    let place = |k: usize, len: usize| ((u128::from(spread(k as u64)) * len as u128) >> 64) as usize;
    let (trackers, sequences) = request.parts();
    let mut times = Vec::new();
    let mut seen = std::collections::BTreeSet::new();
    for k in 0..count.min(trackers.len() * sequences.len()) {
        // Trackers are filled evenly, sequences come in turn.
        let (tracker, sequence) = (place(k + 1, trackers.len()), k % sequences.len());
        if !seen.insert((tracker, sequence)) {
            continue;
        }
        let one = request
            .clone()
            .trackers([trackers[tracker].clone()])
            .sequences([sequences[sequence].truncated(UPDATES + 1)])
            .threads(1)
            .out(temporary.path().join(k.to_string()))
            .protocol(Protocol::Ope)
            .frame_logs(FrameLogs::None)
            .build()?;
        let plan = one.plan()?;
        let report = run(&one, &Exporters::builtin(), &Silent, &AtomicBool::new(false))?;
        if !report.failed.is_empty() {
            continue;
        }
        let journal = Journal::read(&one.out.join("journal.jsonl"))?;
        for unit in plan.units() {
            if let Some(entry) = journal
                .get(&UnitKeys::new(&plan).of(&unit))?
                .filter(|e| e.time.updates > 0)
            {
                let update = entry.time.seconds / entry.time.updates as f64;
                times.push((entry.time.init_seconds, update));
            }
        }
    }
    if times.is_empty() {
        return Err(PlanError::Nothing("none of the measured units could be tracked").into());
    }
    let n = times.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| times.iter().map(f).sum::<f64>() / n;
    let (init, update) = (mean(|t| t.0), mean(|t| t.1));
    let per_unit = plan.frames() as f64 / plan.len().max(1) as f64 - 1.0;
    let whole = |t: &(f64, f64)| t.0 + per_unit * t.1;
    let average = whole(&(init, update)).max(f64::MIN_POSITIVE);
    let variance = times.iter().map(|t| (whole(t) - average).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    Ok(Cost {
        units: times.len(),
        init,
        update,
        relative_variance: variance / average.powi(2),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimates_have_a_standard_error() {
        let cost = |units: usize, relative_variance: f64| Cost {
            units,
            init: 0.5,
            update: 0.25,
            relative_variance,
        };
        // Of the mean of 9 times with a deviation of 0.6 of it.
        assert_eq!(cost(9, 0.36).relative_error(), 0.2);
        assert_eq!(cost(4, 0.0).relative_error(), 0.0);
        // 3 units of 5 frames: 3 starts and 12 updates.
        assert_eq!(cost(9, 0.36).seconds(3.0, 15.0), 4.5);
        assert_eq!(cost(9, 0.36).seconds(3.0, 3.0), 1.5);
        assert_eq!(cost(9, 0.36).seconds(3.0, 0.0), 1.5);
    }
}
