//! A run directory as it stands, whoever works on it: the figures of the units that have ended.

use crate::judge::ranking::{Field, Speeds};
use crate::metric::{MetricSet, Results};
use crate::plan::{DataNotes, Unit, UnitKeys};
use crate::run::error::RunError;
use crate::run::finish::{Lacking, ResultSource};
use crate::store::StoreError;
use crate::store::held::{Finished, Held, finished, held};
use crate::store::journal::Journal;
use crate::store::rundir::RunDir;
use crate::store::truth;
use rayon::ThreadPool;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::Path;

/// What a run directory has.
#[derive(Clone, Debug)]
pub struct SoFar {
    /// The directory, as given.
    pub name: String,
    /// Figures of the units that have ended.
    pub results: Results,
    /// Frames per second of update time of each tracker, by id.
    pub speeds: Speeds,
    /// Whether trackers ran beside each other, which slows each of them down.
    pub disturbed: bool,
    /// Units of the run, or of its shard.
    pub units: usize,
    /// Those that have ended.
    pub ended: usize,
    /// Trackers of the run.
    pub trackers: usize,
    /// Those all of whose units have ended.
    pub whole_trackers: usize,
    /// Data that was not read as it stands.
    pub data: DataNotes,
    /// Fingerprint of the data of each sequence, by `dataset/sequence`.
    pub fingerprints: BTreeMap<String, String>,
}

impl SoFar {
    /// To be ranked.
    pub fn field(&self) -> Field<'_> {
        Field {
            name: &self.name,
            results: &self.results,
            speeds: &self.speeds,
        }
    }

    /// What is to be said beside figures of a run that has not got to its end.
    pub fn line(&self) -> Option<String> {
        (self.ended < self.units).then(|| {
            format!(
                "{}: {} of {} units have ended; figures are of those",
                self.name, self.ended, self.units
            )
        })
    }
}

/// What tells units apart.
fn key(unit: &Unit) -> (u32, u32, u32, u32) {
    (unit.tracker, unit.course, unit.sequence, unit.start)
}

/// Reads the run directory `dir` as a run of `metrics` without touching it. A directory that holds nothing but a
/// `summary.json` has no speeds.
///
/// # Errors
/// It is no run directory, cannot be read, or is of other metrics.
pub fn so_far(dir: &Path, metrics: &MetricSet, pool: &ThreadPool) -> Result<SoFar, RunError> {
    let name = dir.display().to_string();
    if !dir.join("run.json").exists() {
        let Finished { summary, data, .. } = finished(dir, metrics)?;
        let units = summary.results.sequences.len();
        let trackers = summary.results.ranking().len();
        return Ok(SoFar {
            name,
            results: summary.results,
            speeds: Speeds::new(),
            disturbed: false,
            units,
            ended: units,
            trackers,
            whole_trackers: trackers,
            data,
            fingerprints: BTreeMap::new(),
        });
    }
    let mut place = RunDir::view(dir);
    let recorded = place.recorded()?;
    let plan = &recorded.plan;
    if plan.metrics != metrics.added_names() {
        return Err(StoreError::Mismatch {
            path: dir.to_path_buf(),
            reason: "it was run with other metrics".into(),
        }
        .into());
    }
    place.lay_out(plan);
    let (keys, units) = (UnitKeys::new(plan), recorded.units());
    let journal = Journal::read(&place.journal())?;
    let ended: Vec<Unit> = pool.install(|| {
        let has_ended = |unit: &&Unit| {
            let found = held(&place, plan, unit, &journal, &keys.of(unit));
            matches!(found, Held::Result(_) | Held::Failed(_))
        };
        units.par_iter().filter(has_ended).copied().collect()
    });
    let truth = truth::read(&dir.join("truth.csv"), &plan.sequences, &recorded.truth)?;
    let source = ResultSource {
        dir: &place,
        plan,
        keys: &keys,
        metrics,
        truth: &truth,
        journal: &journal,
    };
    // What is damaged will be tracked again.
    let gathered = source.gather(&ended, pool, Lacking::LeftOut)?;
    let trackers = |units: &[Unit]| units.iter().map(|unit| unit.tracker).collect::<BTreeSet<u32>>();
    let has_ended: HashSet<(u32, u32, u32, u32)> = ended.iter().map(key).collect();
    let lacking: Vec<Unit> = units
        .iter()
        .copied()
        .filter(|unit| !has_ended.contains(&key(unit)))
        .collect();
    let all = trackers(&units).len();
    Ok(SoFar {
        name,
        speeds: gathered.speeds(plan),
        disturbed: gathered.times.iter().any(|(_, time)| time.threads > 1),
        units: units.len(),
        ended: gathered.units(),
        trackers: all,
        whole_trackers: all - trackers(&lacking).len(),
        results: gathered.results,
        data: plan.data.clone(),
        fingerprints: plan
            .sequences
            .iter()
            .map(|s| (s.id(), s.fingerprint.clone()))
            .collect(),
    })
}
