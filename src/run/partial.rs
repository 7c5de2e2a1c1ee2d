//! The results of a run directory as far as it is: of a run that goes on, was stopped, or has ended.

use crate::metric::{MetricSet, Results};
use crate::plan::{Unit, UnitKeys};
use crate::run::error::RunError;
use crate::run::finish::{Lacking, ResultSource};
use crate::run::pool::pool;
use crate::store::StoreError;
use crate::store::journal::Journal;
use crate::store::rundir::RunDir;
use crate::store::truth;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The results of a run as far as it is.
#[derive(Clone, Debug)]
pub struct Partial {
    /// Of the units that have ended.
    pub results: Results,
    /// Frames per second of update time of each tracker, by id.
    pub speeds: BTreeMap<String, f64>,
    /// Units that the directory is for.
    pub units: usize,
    /// Those that are in the results, failed ones too.
    pub ended: usize,
    /// Trackers that the directory is for.
    pub trackers: usize,
    /// Those all of whose units are in the results.
    pub whole_trackers: usize,
}

/// Reads what the directory `path` holds of a run of `metrics`, whoever writes to it. Nothing is changed.
///
/// # Errors
/// It is no run directory, of other metrics, or its description or truth is damaged.
pub fn partial(path: &Path, metrics: &MetricSet) -> Result<Partial, RunError> {
    let mut dir = RunDir::view(path);
    let recorded = dir.recorded()?;
    let plan = &recorded.plan;
    dir.lay_out(plan);
    if plan.metrics != metrics.added_names() {
        return Err(StoreError::Mismatch {
            path: path.to_path_buf(),
            reason: "it was run with other metrics".into(),
        }
        .into());
    }
    let truth = truth::read(&path.join("truth.csv"), &plan.sequences, &recorded.truth)?;
    let keys = UnitKeys::new(plan);
    // After the description: what it has is of this plan or of an earlier one that this plan goes on with.
    let journal = Journal::read(&dir.journal())?;
    let source = ResultSource {
        dir: &dir,
        plan,
        keys: &keys,
        metrics,
        truth: &truth,
        journal: &journal,
    };
    let units = recorded.units();
    let is_there = |unit: &Unit| journal.status(&keys.of(unit)).is_some();
    let ended: Vec<Unit> = units.iter().copied().filter(is_there).collect();
    let gathered = source.gather(&ended, &pool(0, &|_| ())?, Lacking::LeftOut)?;
    let lacking: BTreeSet<u32> = units
        .iter()
        .filter(|unit| !is_there(unit))
        .map(|unit| unit.tracker)
        .collect();
    let trackers = units
        .iter()
        .map(|unit| unit.tracker)
        .collect::<BTreeSet<_>>()
        .len();
    Ok(Partial {
        ended: gathered.units(),
        speeds: gathered.speeds(plan),
        results: gathered.results,
        units: units.len(),
        trackers,
        whole_trackers: trackers - lacking.len(),
    })
}
