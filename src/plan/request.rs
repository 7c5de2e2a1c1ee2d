//! What is asked of a run: trackers that can be made, sequences that can be read, how and where.

use super::error::PlanError;
use super::protocol::Protocols;
use super::shard::Shard;
use super::tracker::TrackerEntry;
use super::units::{FrameLogs, Plan, PlannedSequence, PlannedTracker, RUN_FORMAT_VERSION};
use crate::dataset::Sequence;
use crate::metric::aggregate::TrackerName;
use mtf::image::PreProcessor;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Everything that defines a run.
#[derive(Clone, Debug)]
pub struct RunRequest {
    /// The trackers.
    pub trackers: Vec<TrackerEntry>,
    /// The sequences, already cut to the frames that are to be tracked.
    pub sequences: Vec<Sequence>,
    /// Filter applied to each frame.
    pub pre: Arc<dyn PreProcessor>,
    /// Where trackers start, and what happens to them until the end of a sequence.
    pub protocol: Protocols,
    /// Seed from which each unit derives its own.
    pub seed: u64,
    /// The part of the units to run; all without.
    pub shard: Option<Shard>,
    /// Worker threads; 0 for one per core. Never changes a result.
    pub threads: usize,
    /// Threads that one tracker may use. Never changes a result.
    pub threads_per_tracker: usize,
    /// Bytes that trackers and their logs may occupy together. Never changes a result.
    pub memory: u64,
    /// The run directory.
    pub out: PathBuf,
    /// Discard what the directory holds from earlier runs.
    pub force: bool,
    /// Where the corners go.
    pub frame_logs: FrameLogs,
    /// Longest time the updates of one unit may take together before the unit fails.
    pub timeout: Option<Duration>,
    /// Longest time that units in progress are given to end once the run is asked to stop.
    pub grace: Duration,
    /// What else `run.json` shall say about the data and settings (reproducible).
    pub about: Map<String, Value>,
    /// What else `run.json` shall say about this very execution (command line, revision).
    pub host: Map<String, Value>,
}

/// A request brought into the order of its plan.
pub(crate) struct Prepared<'a> {
    pub plan: Plan,
    pub trackers: Vec<&'a TrackerEntry>,
    pub sequences: Vec<&'a Sequence>,
}

impl RunRequest {
    /// The plan of this request, whether run in shards or not.
    ///
    /// # Errors
    /// Nothing was requested, a sequence has no ground truth to start from, or two sequences share a name.
    pub fn plan(&self) -> Result<Plan, PlanError> {
        self.prepare().map(|prepared| prepared.plan)
    }

    pub(crate) fn prepare(&self) -> Result<Prepared<'_>, PlanError> {
        if self.trackers.is_empty() {
            return Err(PlanError::Nothing("no tracker"));
        }
        if self.sequences.is_empty() {
            return Err(PlanError::Nothing("no sequence"));
        }
        let mut trackers: Vec<&TrackerEntry> = self.trackers.iter().collect();
        trackers.sort_by(|a, b| a.name.id.cmp(&b.name.id));
        trackers.dedup_by(|a, b| a.name.id == b.name.id);
        let mut seen: BTreeMap<(&str, &str), (&Sequence, String)> = BTreeMap::new();
        for sequence in &self.sequences {
            let fingerprint = sequence.fingerprint();
            let (_, first) = seen
                .entry((sequence.dataset(), sequence.name()))
                .or_insert((sequence, fingerprint.clone()));
            if *first != fingerprint {
                return Err(PlanError::Ambiguous(sequence_id(sequence)));
            }
        }
        let mut planned = Vec::new();
        let mut sequences = Vec::new();
        for (sequence, fingerprint) in seen.into_values() {
            let starts = self.protocol.iter();
            let starts = starts.map(|p| p.starts(sequence.len(), |i| sequence.truth(i).is_some()));
            let starts: Vec<Vec<u32>> = starts.collect();
            if starts.iter().any(Vec::is_empty) {
                return Err(PlanError::Sequence {
                    sequence: sequence_id(sequence),
                    reason: "no frame has ground truth to start from".into(),
                });
            }
            planned.push(PlannedSequence {
                dataset: sequence.dataset().to_owned(),
                sequence: sequence.name().to_owned(),
                frames: sequence.len(),
                starts,
                fingerprint,
            });
            sequences.push(sequence);
        }
        let describe = |t: &&TrackerEntry| {
            let TrackerName { id, sm, am, ssm, ilm } = t.name.clone();
            let (slug, parameters) = (t.slug.clone(), t.parameters.clone());
            PlannedTracker {
                id,
                sm,
                am,
                ssm,
                ilm,
                slug,
                parameters,
            }
        };
        let plan = Plan {
            schema_version: RUN_FORMAT_VERSION,
            tool: env!("CARGO_PKG_NAME").to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            protocol: self.protocol.clone(),
            seed: self.seed,
            pre: self.pre.id(),
            frame_logs: self.frame_logs,
            about: self.about.clone(),
            trackers: trackers.iter().map(describe).collect(),
            sequences: planned,
        };
        Ok(Prepared {
            plan,
            trackers,
            sequences,
        })
    }
}

/// `dataset/sequence`.
pub fn sequence_id(sequence: &Sequence) -> String {
    format!("{}/{}", sequence.dataset(), sequence.name())
}
