//! What stands behind the lines of a baseline in a run: how long each took, and on which frames it went wrong.

use crate::files::{self, Kind};
use crate::judge::change::Subject;
use crate::metric::MetricSet;
use crate::plan::{Plan, Protocol, Unit, UnitKeys};
use crate::store::StoreError;
use crate::store::framelog::frame_errors;
use crate::store::journal::{Entry, Journal};
use crate::store::rundir::RunDir;
use crate::store::truth::{self, KeptTruth};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A tracker on a sequence from a start.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Case {
    /// Time of its starts and updates, s.
    pub seconds: f64,
    /// Why it has no result.
    pub reason: Option<String>,
    /// Number and error (that of the primary metric; infinite without output) of each evaluated frame, in their order. Empty
    /// unless asked for, and where the run does not say which frames its errors are of.
    pub frames: Vec<(usize, f64)>,
}

/// The cases of the run in `path` by subject, with the frames of those in `wanted`. Nothing where the directory holds result
/// files alone.
///
/// # Errors
/// The directory cannot be read, or is damaged.
pub fn cases(
    path: &Path,
    metrics: &MetricSet,
    wanted: &BTreeSet<&Subject>,
) -> Result<BTreeMap<Subject, Case>, StoreError> {
    let mut found: BTreeMap<Subject, Case> = BTreeMap::new();
    if !path.join("run.json").exists() {
        return Ok(found);
    }
    let mut dir = RunDir::view(path);
    let recorded = dir.recorded()?;
    let plan = &recorded.plan;
    dir.lay_out(plan);
    let (journal, keys) = (Journal::read(&dir.journal())?, UnitKeys::new(plan));
    let truth = truth::read(&path.join("truth.csv"), &plan.sequences, &recorded.truth)?;
    for unit in recorded.units() {
        let Some(entry) = journal.get(&keys.of(&unit))? else {
            continue;
        };
        let sequence = &plan.sequences[unit.sequence as usize];
        for (index, protocol) in plan.protocol.iter().enumerate() {
            if !plan.belongs(&unit, index) {
                continue;
            }
            let subject = Subject {
                tracker: plan.trackers[unit.tracker as usize].id.clone(),
                dataset: sequence.dataset.clone(),
                sequence: sequence.sequence.clone(),
                start: unit.start as usize,
                protocol: protocol.to_string(),
            };
            let seconds = entry.time.init_seconds + entry.time.seconds;
            let frames = match wanted.contains(&subject) {
                true => frames(&dir, plan, &unit, &entry, &truth[unit.sequence as usize], metrics)?,
                false => Vec::new(),
            };
            let reason = entry.reason.clone();
            found.insert(
                subject,
                Case {
                    seconds,
                    reason,
                    frames,
                },
            );
        }
    }
    Ok(found)
}

/// The errors of the frames of a unit that has a result.
fn frames(
    dir: &RunDir,
    plan: &Plan,
    unit: &Unit,
    entry: &Entry,
    truth: &KeptTruth,
    metrics: &MetricSet,
) -> Result<Vec<(usize, f64)>, StoreError> {
    let annotated = |i: usize| truth.at(i).is_some();
    if entry.log.is_some() {
        let path = dir.log(plan, unit);
        let bytes = files::read(&path, Kind::RESULTS).map_err(|e| StoreError::io(&path, e))?;
        return files::unpack(bytes)
            .and_then(|text| frame_errors(metrics, &text, annotated))
            .map_err(|reason| StoreError::Damaged { path, reason });
    }
    let errors = entry.errors.as_deref().unwrap_or_default();
    let (start, all) = (unit.start as usize, plan.sequences[unit.sequence as usize].frames);
    let numbers: Vec<usize> = (start + 1..all).filter(|i| annotated(*i)).collect();
    // Which frames count depends on what happened where a tracker is started anew.
    if plan.course(unit) != Protocol::Ope || numbers.len() != errors.len() {
        return Ok(Vec::new());
    }
    // The primary metric is the first.
    let error = |values: &Option<Vec<f64>>| {
        values
            .as_ref()
            .map_or(f64::INFINITY, |v| v.first().copied().unwrap_or(f64::NAN))
    };
    Ok(numbers.into_iter().zip(errors.iter().map(error)).collect())
}
