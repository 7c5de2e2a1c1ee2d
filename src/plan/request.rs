//! What is asked of a run: trackers that can be made, sequences that can be read, how and where.

use super::data_notes::DataNotes;
use super::error::PlanError;
use super::protocol::Protocols;
use super::shard::Shard;
use super::tracker::TrackerEntry;
use super::units::{FrameLogs, Plan, PlannedSequence, PlannedTracker, RUN_FORMAT_VERSION};
use crate::dataset::Sequence;
use crate::metric::MetricSet;
use crate::metric::aggregate::TrackerName;
use mtf::image::{Gaussian, PreProcessor};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Filter of frames that is not asked for otherwise: a Gaussian of 5 x 5 px with a standard deviation of 3 px.
pub const USUAL_FILTER: &str = "gaussian:5:3";

/// Everything that defines a run; see [`RunRequest::builder`].
#[derive(Clone, Debug)]
#[non_exhaustive]
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
    /// What is measured.
    pub metrics: MetricSet,
    /// The part of the units to run; all without.
    pub shard: Option<Shard>,
    /// Worker threads; 0 for one per core. Never changes a result.
    pub threads: usize,
    /// Threads that one tracker may use. Never changes a result.
    pub threads_per_tracker: usize,
    /// Bytes that trackers and their logs may occupy together. A tracker that needs more alone fails; else it never changes a
    /// result.
    pub memory: u64,
    /// The run directory.
    pub out: PathBuf,
    /// Discard what the directory holds from earlier runs.
    pub force: bool,
    /// Keep results that another build of the program left in the directory.
    pub mix_builds: bool,
    /// Where the corners go.
    pub frame_logs: FrameLogs,
    /// The run will be stopped before its end, perhaps: units are to end one by one rather than many at once. Never changes a
    /// result.
    pub hurry: bool,
    /// Longest time the starts and updates of one unit may take together before the unit fails.
    pub timeout: Option<Duration>,
    /// Longest time that units in progress are given to end once the run is asked to stop.
    pub grace: Duration,
    /// Data that was not read as it stands.
    pub data_notes: DataNotes,
    /// What else `run.json` shall say about the data and settings (reproducible).
    pub about: Map<String, Value>,
    /// What else `run.json` shall say about this very execution (command line, revision).
    pub host: Map<String, Value>,
}

/// [`USUAL_FILTER`].
pub fn usual_filter() -> Arc<dyn PreProcessor> {
    Arc::new(Gaussian::default())
}

/// Makes a [`RunRequest`]: trackers, sequences and a run directory are needed, all else has a default.
#[derive(Clone, Debug)]
pub struct RunRequestBuilder {
    request: RunRequest,
}

impl RunRequestBuilder {
    /// The trackers.
    pub fn trackers(mut self, trackers: impl IntoIterator<Item = TrackerEntry>) -> Self {
        self.request.trackers = trackers.into_iter().collect();
        self
    }

    /// The sequences, already cut to the frames that are to be tracked.
    pub fn sequences(mut self, sequences: impl IntoIterator<Item = Sequence>) -> Self {
        self.request.sequences = sequences.into_iter().collect();
        self
    }

    /// The run directory; what it holds of the same units is not run again.
    pub fn out(mut self, directory: impl Into<PathBuf>) -> Self {
        self.request.out = directory.into();
        self
    }

    /// Filter applied to each frame.
    pub fn filter(mut self, filter: Arc<dyn PreProcessor>) -> Self {
        self.request.pre = filter;
        self
    }

    /// Where trackers start, and what happens to them until the end of a sequence.
    pub fn protocol(mut self, protocol: impl Into<Protocols>) -> Self {
        self.request.protocol = protocol.into();
        self
    }

    /// Seed from which each unit derives its own.
    pub fn seed(mut self, seed: u64) -> Self {
        self.request.seed = seed;
        self
    }

    /// What is measured.
    pub fn metrics(mut self, metrics: MetricSet) -> Self {
        self.request.metrics = metrics;
        self
    }

    /// The part of the units to run; `None` for all.
    pub fn shard(mut self, shard: impl Into<Option<Shard>>) -> Self {
        self.request.shard = shard.into();
        self
    }

    /// Worker threads; 0 for one per core. Never changes a result.
    pub fn threads(mut self, threads: usize) -> Self {
        self.request.threads = threads;
        self
    }

    /// Threads that one tracker may use. Never changes a result.
    pub fn threads_per_tracker(mut self, threads: usize) -> Self {
        self.request.threads_per_tracker = threads;
        self
    }

    /// Bytes that trackers and their logs may occupy together. Never changes a result.
    pub fn memory(mut self, bytes: u64) -> Self {
        self.request.memory = bytes;
        self
    }

    /// Whether to discard what the directory holds from earlier runs.
    pub fn force(mut self, force: bool) -> Self {
        self.request.force = force;
        self
    }

    /// Whether to keep results that another build of the program left in the directory.
    pub fn mix_builds(mut self, mix: bool) -> Self {
        self.request.mix_builds = mix;
        self
    }

    /// Whether units are to end one by one rather than many at once, because the run may be stopped. Never changes a result.
    pub fn hurry(mut self, hurry: bool) -> Self {
        self.request.hurry = hurry;
        self
    }

    /// Where the corners of each frame go.
    pub fn frame_logs(mut self, frame_logs: FrameLogs) -> Self {
        self.request.frame_logs = frame_logs;
        self
    }

    /// Longest time the updates of one unit may take together before the unit fails; `None` for as long as they take.
    pub fn timeout(mut self, timeout: impl Into<Option<Duration>>) -> Self {
        self.request.timeout = timeout.into();
        self
    }

    /// Longest time that units in progress are given to end once the run is asked to stop.
    pub fn grace(mut self, grace: Duration) -> Self {
        self.request.grace = grace;
        self
    }

    /// Data that was not read as it stands.
    pub fn data_notes(mut self, notes: DataNotes) -> Self {
        self.request.data_notes = notes;
        self
    }

    /// What else `run.json` shall say about the data and settings; must be the same whenever and wherever the run is made.
    pub fn about(mut self, about: Map<String, Value>) -> Self {
        self.request.about = about;
        self
    }

    /// What else `run.json` shall say about this very execution.
    pub fn host(mut self, host: Map<String, Value>) -> Self {
        self.request.host = host;
        self
    }

    /// Trackers and sequences so far.
    pub(crate) fn parts(&self) -> (&[TrackerEntry], &[Sequence]) {
        (&self.request.trackers, &self.request.sequences)
    }

    /// The plan of the request so far, which does not depend on the run directory.
    ///
    /// # Errors
    /// As [`RunRequest::plan`].
    pub fn plan(&self) -> Result<Plan, PlanError> {
        self.request.plan()
    }

    /// The request.
    ///
    /// # Errors
    /// Trackers, sequences or the run directory are missing.
    pub fn build(self) -> Result<RunRequest, PlanError> {
        self.request.check()?;
        match self.request.out.as_os_str().is_empty() {
            true => Err(PlanError::NoDirectory),
            false => Ok(self.request),
        }
    }
}

/// A request brought into the order of its plan.
pub(crate) struct Prepared<'a> {
    pub plan: Plan,
    pub trackers: Vec<&'a TrackerEntry>,
    pub sequences: Vec<&'a Sequence>,
}

impl RunRequest {
    /// Bytes of memory unless told otherwise: more makes nothing faster, as groups of trackers are bounded.
    pub const MEMORY: u64 = 3 << 30;
    /// Time that units in progress are given to end unless told otherwise.
    pub const GRACE: Duration = Duration::from_secs(20);

    /// A request of trackers, sequences and a run directory, with the program's defaults for everything else: one pass
    /// over each sequence, filtered by [`USUAL_FILTER`], seed 0, all cores, one thread per tracker, a frame log in CSV
    /// per unit, no timeout, and what the directory holds already is kept.
    ///
    /// ```no_run
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use mtf_eval::plan::{Protocol, RunRequest, TrackerEntry};
    /// use std::sync::{Arc, atomic::AtomicBool};
    ///
    /// let registry = Arc::new(mtf::registry::Registry::builtin());
    /// let spec = registry.parse("esm/ssd/homography")?;
    /// let request = RunRequest::builder()
    ///     .trackers([TrackerEntry::from_registry(&registry, &spec)?])
    ///     .sequences(mtf_eval::dataset::builtin()?.sequences)
    ///     .out("results/first")
    ///     .protocol(Protocol::Subseq(10))
    ///     .build()?;
    /// let files = mtf_eval::report::Exporters::builtin();
    /// let report = mtf_eval::run::run(&request, &files, &mtf_eval::run::Silent, &AtomicBool::new(false))?;
    /// println!("{} units in {}", report.units, report.path.display());
    /// # Ok(())
    /// # }
    /// ```
    pub fn builder() -> RunRequestBuilder {
        RunRequestBuilder {
            request: RunRequest {
                trackers: Vec::new(),
                sequences: Vec::new(),
                pre: usual_filter(),
                protocol: Protocols::default(),
                seed: 0,
                metrics: MetricSet::builtin(),
                shard: None,
                threads: 0,
                threads_per_tracker: 1,
                memory: RunRequest::MEMORY,
                out: PathBuf::new(),
                force: false,
                mix_builds: false,
                frame_logs: FrameLogs::default(),
                hurry: false,
                timeout: None,
                grace: RunRequest::GRACE,
                data_notes: DataNotes::default(),
                about: Map::new(),
                host: Map::new(),
            },
        }
    }

    /// The plan of this request, whether run in shards or not.
    ///
    /// # Errors
    /// Nothing was requested, a sequence has no ground truth to start from, or two sequences share a name.
    pub fn plan(&self) -> Result<Plan, PlanError> {
        self.prepare().map(|prepared| prepared.plan)
    }

    /// Whether there is something to run.
    fn check(&self) -> Result<(), PlanError> {
        if self.trackers.is_empty() {
            return Err(PlanError::Nothing("no tracker"));
        }
        if self.sequences.is_empty() {
            return Err(PlanError::Nothing("no sequence"));
        }
        Ok(())
    }

    pub(crate) fn prepare(&self) -> Result<Prepared<'_>, PlanError> {
        self.check()?;
        let mut trackers: Vec<&TrackerEntry> = self.trackers.iter().collect();
        trackers.sort_by(|a, b| a.name.id.cmp(&b.name.id));
        trackers.dedup_by(|a, b| a.name.id == b.name.id);
        let mut seen: BTreeMap<(&str, &str), (&Sequence, String)> = BTreeMap::new();
        for sequence in &self.sequences {
            let fingerprint = sequence.fingerprint();
            let (other, first) = seen
                .entry((sequence.dataset(), sequence.name()))
                .or_insert((sequence, fingerprint.clone()));
            let places = [other.path(), sequence.path()];
            if places.iter().any(|p| p.to_str().is_none()) && !same_place(places) {
                let [first, second] = places.map(|p| format!("{p:?}"));
                return Err(PlanError::SameText { first, second });
            }
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
                tags: sequence.tags().to_vec(),
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
                answers: t.answers,
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
            metrics: self.metrics.added_names(),
            data: self.data_notes.clone(),
            about: self.about.clone(),
            joined: Vec::new(),
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

/// Whether two paths lead to one folder.
fn same_place([a, b]: [&Path; 2]) -> bool {
    a == b || matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_filter_has_its_name() {
        assert_eq!(usual_filter().id(), USUAL_FILTER);
    }

    #[test]
    fn what_a_run_cannot_do_without_is_asked_for() {
        let said = |builder: RunRequestBuilder| builder.build().unwrap_err().to_string();
        assert_eq!(said(RunRequest::builder()), "nothing to run: no tracker");
        let registry = Arc::new(mtf::registry::Registry::builtin());
        let spec = registry.parse("esm/ssd/affine").unwrap();
        let builder =
            RunRequest::builder().trackers([TrackerEntry::from_registry(&registry, &spec).unwrap()]);
        assert_eq!(said(builder.clone()), "nothing to run: no sequence");
        let builder = builder.sequences(crate::dataset::builtin().unwrap().sequences);
        assert_eq!(said(builder.clone()), "no run directory to write to");
        let request = builder.out("somewhere").seed(3).build().unwrap();
        assert_eq!(
            (request.seed, request.threads_per_tracker, request.force),
            (3, 1, false)
        );
    }
}
