//! What a run consists of: trackers x sequences x start frames, the identity of each unit and its random seed.

use super::aggregate::TrackerName;
use super::rundir::{RunError, digest};
use crate::dataset::Sequence;
use crate::image::PreProcessor;
use crate::registry::{Registry, SpecError, TrackerSpec};
use crate::tracker::Tracker;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Version of the run directory's formats and of the protocol; part of every unit's key.
pub const SCHEMA_VERSION: u32 = 1;

/// Makes a fresh tracker, or says why it cannot.
pub type Make = dyn Fn() -> Result<Box<dyn Tracker>, String> + Send + Sync;

/// A tracker to be evaluated: what it is called and how to make one.
#[derive(Clone)]
pub struct TrackerEntry {
    /// Canonical id and parts, as tables show them.
    pub name: TrackerName,
    /// Name of the folder of its logs.
    pub slug: String,
    /// Every parameter with its value: two trackers with the same id and parameters must give the same results.
    pub parameters: Value,
    /// Makes one. Called once per sequence.
    pub make: Arc<Make>,
}

impl std::fmt::Debug for TrackerEntry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TrackerEntry({})", self.name.id)
    }
}

impl TrackerEntry {
    /// A tracker of `registry`, which may hold the user's own models.
    ///
    /// # Errors
    /// The registry does not know the tracker.
    pub fn from_registry(registry: &Arc<Registry>, spec: &TrackerSpec) -> Result<TrackerEntry, SpecError> {
        let (sm, am, ssm, ilm) = spec.parts();
        let name = TrackerName {
            id: spec.to_string(),
            sm: sm.to_owned(),
            am: am.to_owned(),
            ssm: ssm.to_owned(),
            ilm: ilm.to_owned(),
        };
        let parameters = registry.describe(spec)?;
        let (registry, slug, spec) = (Arc::clone(registry), spec.slug(), spec.clone());
        let make = Arc::new(move || registry.build(&spec).map_err(|e| e.to_string()));
        Ok(TrackerEntry {
            name,
            slug,
            parameters,
            make,
        })
    }
}

/// Where the corners of each frame go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameLogs {
    /// A CSV file per unit.
    Csv,
    /// Nowhere: the journal keeps the errors, which is all that the aggregated files need.
    None,
}

/// Everything that defines a run.
#[derive(Clone, Debug)]
pub struct RunRequest {
    /// The trackers.
    pub trackers: Vec<TrackerEntry>,
    /// The sequences, already cut to the frames that are to be tracked.
    pub sequences: Vec<Sequence>,
    /// Filter applied to each frame.
    pub pre: Arc<dyn PreProcessor>,
    /// Seed from which each unit derives its own.
    pub seed: u64,
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
    /// What else `run.json` shall say about the data and settings (reproducible).
    pub about: serde_json::Map<String, Value>,
    /// What else `run.json` shall say about this very execution (command line, revision).
    pub host: serde_json::Map<String, Value>,
}

/// One tracker on one sequence from one start frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unit {
    /// Index into the request's trackers.
    pub tracker: usize,
    /// Index into the request's sequences.
    pub sequence: usize,
    /// Frame on which the tracker is initialised.
    pub start: usize,
    /// Hash of everything that can change the result.
    pub key: String,
}

impl RunRequest {
    /// The units in the order of the result files: by tracker id, data set, sequence, start.
    ///
    /// # Errors
    /// Nothing was requested, a sequence has no ground truth to start from, or two sequences share a name.
    pub fn units(&self) -> Result<Vec<Unit>, RunError> {
        if self.trackers.is_empty() {
            return Err(RunError::Nothing("no tracker"));
        }
        if self.sequences.is_empty() {
            return Err(RunError::Nothing("no sequence"));
        }
        let mut trackers: Vec<usize> = (0..self.trackers.len()).collect();
        trackers.sort_by(|&a, &b| self.trackers[a].name.id.cmp(&self.trackers[b].name.id));
        trackers.dedup_by(|a, b| self.trackers[*a].name.id == self.trackers[*b].name.id);
        let mut units = Vec::new();
        let sequences = self.ordered_sequences()?;
        for &tracker in &trackers {
            for &(sequence, start) in &sequences {
                let key = self.key(tracker, sequence, start);
                units.push(Unit {
                    tracker,
                    sequence,
                    start,
                    key,
                });
            }
        }
        Ok(units)
    }

    /// Sequences by data set and name with the frame to start on: the first that has ground truth.
    fn ordered_sequences(&self) -> Result<Vec<(usize, usize)>, RunError> {
        let mut seen: BTreeMap<(&str, &str), usize> = BTreeMap::new();
        for (index, sequence) in self.sequences.iter().enumerate() {
            let first = *seen.entry((sequence.dataset(), sequence.name())).or_insert(index);
            if self.sequences[first].fingerprint() != sequence.fingerprint() {
                return Err(RunError::Ambiguous(sequence_id(sequence)));
            }
        }
        seen.into_values()
            .map(|index| {
                let sequence = &self.sequences[index];
                match (0..sequence.len()).find(|&i| sequence.truth(i).is_some()) {
                    Some(start) => Ok((index, start)),
                    None => Err(RunError::Sequence {
                        sequence: sequence_id(sequence),
                        reason: "no frame has ground truth to start from".into(),
                    }),
                }
            })
            .collect()
    }

    fn key(&self, tracker: usize, sequence: usize, start: usize) -> String {
        let (tracker, sequence) = (&self.trackers[tracker], &self.sequences[sequence]);
        let identity = json!({
            "schema": SCHEMA_VERSION,
            "crate": env!("CARGO_PKG_VERSION"),
            "tracker": tracker.name.id,
            "parameters": tracker.parameters,
            "dataset": sequence.dataset(),
            "sequence": sequence.name(),
            "fingerprint": sequence.fingerprint(),
            "frames": sequence.len(),
            "pre": self.pre.id(),
            "protocol": PROTOCOL,
            "start": start,
            "seed": self.seed,
        });
        digest(identity.to_string().as_bytes())
    }

    /// Seed of a unit's tracker: depends on what is run, never on when, where or beside what.
    pub fn unit_seed(&self, unit: &Unit) -> u64 {
        let sequence = &self.sequences[unit.sequence];
        let mut hash = Sha256::new();
        hash.update(self.seed.to_le_bytes());
        for text in [
            &self.trackers[unit.tracker].name.id,
            sequence.dataset(),
            sequence.name(),
        ] {
            hash.update((text.len() as u64).to_le_bytes());
            hash.update(text.as_bytes());
        }
        hash.update((unit.start as u64).to_le_bytes());
        let bytes = hash.finalize();
        u64::from_le_bytes(std::array::from_fn(|i| bytes[i]))
    }
}

/// The protocol of this runner: one pass from the start frame to the end.
pub const PROTOCOL: &str = "ope";

/// `dataset/sequence`.
pub fn sequence_id(sequence: &Sequence) -> String {
    format!("{}/{}", sequence.dataset(), sequence.name())
}
