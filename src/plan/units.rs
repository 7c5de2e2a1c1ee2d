//! What a run consists of: trackers x courses x sequences x start frames.
//!
//! A [`Plan`] is what `run.json` records: enough to know every unit of the run, its key and its seed without trackers or
//! data.

use super::data_notes::DataNotes;
use super::keys::{UnitKey, UnitKeys};
use super::protocol::{Protocol, Protocols};
use super::seed::derived_seed;
use super::tracker::Answers;
use super::union::Joined;
use crate::metric::aggregate::TrackerName;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet, HashSet};

/// Version of the run directory's formats and of the protocols; part of every unit's key.
pub const RUN_FORMAT_VERSION: u32 = 2;

/// Where the corners of each frame go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum FrameLogs {
    /// A CSV file per unit.
    #[default]
    Csv,
    /// A CSV file per unit, compressed (Zstandard).
    Zst,
    /// Nowhere: the journal keeps the errors, which is all that the aggregated files need.
    None,
}

impl FrameLogs {
    /// How the names of the files end.
    pub fn extension(self) -> &'static str {
        match self {
            FrameLogs::Csv => "csv",
            FrameLogs::Zst => "csv.zst",
            FrameLogs::None => "",
        }
    }
}

/// One tracker on one sequence from one start frame. Protocols of the same [course](Protocol::course) share units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit {
    /// Index into the plan's trackers.
    pub tracker: u32,
    /// Index into the plan's protocols: the first with the unit's course.
    pub course: u32,
    /// Index into the plan's sequences.
    pub sequence: u32,
    /// Frame on which the tracker is initialised.
    pub start: u32,
}

/// A tracker of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedTracker {
    /// Canonical id.
    pub id: String,
    /// Search method.
    pub sm: String,
    /// Appearance model.
    pub am: String,
    /// State space model.
    pub ssm: String,
    /// Illumination model.
    pub ilm: String,
    /// Name of the folder of its logs.
    pub slug: String,
    /// Every parameter with its value.
    pub parameters: Value,
    /// What its answers are.
    #[serde(default, skip_serializing_if = "Answers::are_corners")]
    pub answers: Answers,
}

impl PlannedTracker {
    /// Id and parts, as tables show them.
    pub fn name(&self) -> TrackerName {
        TrackerName {
            id: self.id.clone(),
            sm: self.sm.clone(),
            am: self.am.clone(),
            ssm: self.ssm.clone(),
            ilm: self.ilm.clone(),
        }
    }
}

/// A sequence of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedSequence {
    /// Data set.
    pub dataset: String,
    /// Name in the data set.
    pub sequence: String,
    /// Number of frames.
    pub frames: usize,
    /// Frames on which trackers start, ascending, for each protocol.
    pub starts: Vec<Vec<u32>>,
    /// Hash of ground truth, names and contents of the frames.
    pub fingerprint: String,
    /// What it is said to be hard by.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tags: Vec<String>,
}

impl PlannedSequence {
    /// `dataset/sequence`.
    pub fn id(&self) -> String {
        format!("{}/{}", self.dataset, self.sequence)
    }
}

/// A run without the means to run it: every unit and what its result depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of the formats.
    pub schema_version: u32,
    /// This program.
    pub tool: String,
    /// Its version.
    pub version: String,
    /// Protocols.
    pub protocol: Protocols,
    /// Seed of the run.
    pub seed: u64,
    /// Filter applied to each frame.
    pub pre: String,
    /// Where the corners go.
    pub frame_logs: FrameLogs,
    /// Names of the metrics that the program adds to its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// Data that was not read as it stands.
    #[serde(flatten)]
    pub data: DataNotes,
    /// What else is recorded about data and settings; says nothing about results that the rest does not.
    #[serde(flatten)]
    pub about: Map<String, Value>,
    /// The runs that it is a [union](Self::union) of; empty when every tracker is run on every sequence under every protocol.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joined: Vec<Joined>,
    /// By id.
    pub trackers: Vec<PlannedTracker>,
    /// By data set and name.
    pub sequences: Vec<PlannedSequence>,
}

impl Plan {
    /// The units of a tracker that is run on everything (the first), in the order of [`units`](Self::units).
    pub fn passes(&self) -> Vec<Unit> {
        let mut passes = Vec::new();
        for course in 0..self.protocol.len() {
            for (sequence, planned) in (0u32..).zip(&self.sequences) {
                let same = planned.starts.iter().enumerate();
                let same = same.filter(|(k, _)| self.protocol.course(*k) == course);
                let mut starts: Vec<u32> = same.flat_map(|(_, starts)| starts).copied().collect();
                starts.sort_unstable();
                starts.dedup();
                passes.extend(starts.into_iter().map(|start| Unit {
                    tracker: 0,
                    course: course as u32,
                    sequence,
                    start,
                }));
            }
        }
        passes
    }

    /// Number of units.
    pub fn len(&self) -> usize {
        match self.joined.is_empty() {
            true => self.trackers.len() * self.passes().len(),
            false => self.units().count(),
        }
    }

    /// No units.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Frames that all units go through together.
    pub fn frames(&self) -> u64 {
        let frames = |units: &mut dyn Iterator<Item = Unit>| units.map(|unit| self.unit_frames(&unit)).sum();
        match self.joined.is_empty() {
            true => self.trackers.len() as u64 * frames(&mut self.passes().into_iter()),
            false => frames(&mut self.units()),
        }
    }

    /// The units: by tracker id, course, data set, sequence, start.
    pub fn units(&self) -> impl Iterator<Item = Unit> {
        let passes = std::rc::Rc::new(self.passes());
        let all = (0..self.trackers.len() as u32).flat_map(move |tracker| {
            let passes = std::rc::Rc::clone(&passes);
            (0..passes.len()).map(move |k| Unit { tracker, ..passes[k] })
        });
        let protocols = 0..self.protocol.len();
        all.filter(move |unit| {
            self.joined.is_empty() || protocols.clone().any(|index| self.belongs(unit, index))
        })
    }

    /// Whether the unit belongs to protocol number `index`.
    pub fn belongs(&self, unit: &Unit, index: usize) -> bool {
        let starts = &self.sequences[unit.sequence as usize].starts[index];
        let planned =
            self.protocol.course(index) == unit.course as usize && starts.binary_search(&unit.start).is_ok();
        let run = |joined: &Joined| joined.has(unit.tracker, unit.sequence, index as u32);
        planned && (self.joined.is_empty() || self.joined.iter().any(run))
    }

    /// What happens to the unit's tracker after its start.
    pub fn course(&self, unit: &Unit) -> Protocol {
        self.protocol[unit.course as usize].course()
    }

    /// Name of the unit's course, where it is not one pass to the end.
    pub fn course_name(&self, unit: &Unit) -> Option<String> {
        let course = self.course(unit);
        (course != Protocol::Ope).then(|| course.to_string())
    }

    /// `tracker on dataset/sequence`, with the start frame unless it is the first and the course unless it is one pass.
    pub fn describe(&self, unit: &Unit) -> String {
        let start = match unit.start {
            0 => String::new(),
            start => format!("@{start}"),
        };
        let course = match self.course_name(unit) {
            None => String::new(),
            Some(name) => format!(" ({name})"),
        };
        let sequence = &self.sequences[unit.sequence as usize];
        format!(
            "{} on {}{start}{course}",
            self.trackers[unit.tracker as usize].id,
            sequence.id()
        )
    }

    /// Frames that the unit goes through.
    pub fn unit_frames(&self, unit: &Unit) -> u64 {
        self.sequences[unit.sequence as usize].frames as u64 - u64::from(unit.start)
    }

    /// Seed of a unit's tracker when it starts on frame `start`: depends on what is run, never on when, where, beside what,
    /// or on what the tracker did before.
    pub fn seed_at(&self, unit: &Unit, start: u32) -> u64 {
        let tracker = &self.trackers[unit.tracker as usize];
        let sequence = &self.sequences[unit.sequence as usize];
        let names = [&tracker.id, &sequence.dataset, &sequence.sequence].map(String::as_str);
        derived_seed(self.seed, &names, Some(u64::from(start)))
    }

    /// What every unit depends on: name and value.
    pub(super) fn settings(&self) -> [(&'static str, String); 5] {
        [
            ("schema version", self.schema_version.to_string()),
            ("version", self.version.clone()),
            ("seed", self.seed.to_string()),
            ("filter", self.pre.clone()),
            ("added metrics", self.metrics.join(",")),
        ]
    }

    /// What keeps `later` from being of the same experiment as a run of this plan, which it may widen or be a part of: settings
    /// that differ; protocols, trackers and sequences that it lacks while it has units of others; and data that differs unless it was
    /// [asked for](Self::about) alike (files that changed in place).
    pub fn departures(&self, later: &Plan) -> Vec<String> {
        let mut found = Vec::new();
        for ((what, a), (_, b)) in self.settings().into_iter().zip(later.settings()) {
            if a != b {
                found.push(format!("{what} {a} against {b}"));
            }
        }
        let lacking = self.lacking(later);
        if !lacking.is_empty() && later.adds_to(self) {
            found.extend(
                lacking
                    .into_iter()
                    .map(|what| format!("{what} is not in the new one")),
            );
        }
        let parameters: BTreeMap<&str, &Value> = later
            .trackers
            .iter()
            .map(|t| (t.id.as_str(), &t.parameters))
            .collect();
        let other = |t: &&PlannedTracker| parameters.get(t.id.as_str()).is_some_and(|p| **p != t.parameters);
        let other = self.trackers.iter().filter(other);
        found.extend(other.map(|tracker| format!("other parameters of {}", tracker.id)));
        let changed = self.changed(later);
        if !changed.is_empty() && self.about != later.about {
            let reasons = later
                .about
                .iter()
                .filter(|(key, _)| *key != "command")
                .filter_map(|(key, value)| {
                    let old = self.about.get(key).unwrap_or(&Value::Null);
                    (old != value).then(|| format!("{key} {old} against {value}"))
                });
            found.extend(reasons);
            found.extend(
                changed
                    .into_iter()
                    .map(|id| format!("other frames or ground truth of {id}")),
            );
        }
        found
    }

    /// Whether it has units that `other` lacks.
    fn adds_to(&self, other: &Plan) -> bool {
        let keys = UnitKeys::new(other);
        let there: HashSet<UnitKey> = other.units().map(|unit| keys.of(&unit)).collect();
        let keys = UnitKeys::new(self);
        self.units().any(|unit| !there.contains(&keys.of(&unit)))
    }

    /// Protocols, trackers and sequences that `other` lacks.
    pub fn lacking(&self, other: &Plan) -> Vec<String> {
        fn parts(plan: &Plan) -> impl Iterator<Item = String> {
            let protocols = plan.protocol.iter().map(|p| format!("protocol {p}"));
            let trackers = plan.trackers.iter().map(|t| format!("tracker {}", t.id));
            let sequences = plan.sequences.iter().map(|s| format!("sequence {}", s.id()));
            protocols.chain(trackers).chain(sequences)
        }
        let there: BTreeSet<String> = parts(other).collect();
        parts(self).filter(|part| !there.contains(part)).collect()
    }

    /// Sequences of which `later` has other frames or ground truth.
    pub fn changed(&self, later: &Plan) -> Vec<String> {
        let prints: BTreeMap<String, &str> = later
            .sequences
            .iter()
            .map(|s| (s.id(), s.fingerprint.as_str()))
            .collect();
        let ids = self.sequences.iter().map(|s| (s.id(), s.fingerprint.as_str()));
        let changed = ids.filter(|(id, print)| prints.get(id).is_some_and(|other| other != print));
        changed.map(|(id, _)| id).collect()
    }

    /// The first thing in which `other` asks for other results than `self`; the way of asking does not count.
    pub fn difference(&self, other: &Plan) -> Option<String> {
        let settings = |p: &Plan| {
            let own = [
                ("protocol", p.protocol.to_string()),
                ("frame logs", p.frame_logs.extension().to_owned()),
            ];
            p.settings().into_iter().chain(own)
        };
        for ((what, a), (_, b)) in settings(self).zip(settings(other)) {
            if a != b {
                return Some(format!("{what} {a} against {b}"));
            }
        }
        fn by<'a, T: PartialEq + 'a>(
            what: &str,
            a: impl Iterator<Item = (String, &'a T)>,
            b: impl Iterator<Item = (String, &'a T)>,
        ) -> Option<String> {
            let (a, b): (BTreeMap<_, _>, BTreeMap<_, _>) = (a.collect(), b.collect());
            let alone = |a: &BTreeMap<String, &T>, b: &BTreeMap<String, &T>| {
                a.keys()
                    .find(|k| !b.contains_key(*k))
                    .map(|k| format!("{what} {k} is in one only"))
            };
            let changed = || {
                let (name, _) = a.iter().find(|(k, v)| b.get(*k) != Some(*v))?;
                Some(format!("{what} {name} is not the same"))
            };
            alone(&a, &b).or_else(|| alone(&b, &a)).or_else(changed)
        }
        fn trackers(p: &Plan) -> impl Iterator<Item = (String, &PlannedTracker)> {
            p.trackers.iter().map(|t| (t.id.clone(), t))
        }
        fn sequences(p: &Plan) -> impl Iterator<Item = (String, &PlannedSequence)> {
            p.sequences.iter().map(|s| (s.id(), s))
        }
        by("tracker", trackers(self), trackers(other))
            .or_else(|| by("sequence", sequences(self), sequences(other)))
            .or_else(|| (self.joined != other.joined).then(|| "a union of other runs".to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sha2::{Digest, Sha256};

    fn plan(seed: u64) -> Plan {
        let tracker = |id: &str| PlannedTracker {
            id: id.into(),
            sm: String::new(),
            am: String::new(),
            ssm: String::new(),
            ilm: String::new(),
            slug: id.into(),
            parameters: Value::Null,
            answers: Default::default(),
        };
        let sequence = |[dataset, sequence]: [&str; 2]| PlannedSequence {
            dataset: dataset.into(),
            sequence: sequence.into(),
            frames: 40,
            starts: vec![vec![0, 10, 20]],
            fingerprint: String::new(),
            tags: Vec::new(),
        };
        Plan {
            schema_version: 1,
            tool: "t".into(),
            version: "1".into(),
            protocol: Protocols::default(),
            seed,
            pre: "none".into(),
            frame_logs: FrameLogs::Csv,
            metrics: Vec::new(),
            data: DataNotes::default(),
            about: Map::new(),
            joined: Vec::new(),
            trackers: ["a", "b"].map(tracker).to_vec(),
            sequences: [["d", "s"], ["d", "t"], ["e", "s"]].map(sequence).to_vec(),
        }
    }

    #[test]
    fn the_seed_of_a_start_is_that_of_its_names_and_frame() {
        let mut seen = std::collections::BTreeSet::new();
        let mut count = 0;
        for seed in [0, 7] {
            let plan = plan(seed);
            for unit in plan.units() {
                // Of the bytes that the documentation of seeds names.
                let sequence = &plan.sequences[unit.sequence as usize];
                let id = &plan.trackers[unit.tracker as usize].id;
                let mut bytes = seed.to_le_bytes().to_vec();
                for name in [id, &sequence.dataset, &sequence.sequence] {
                    bytes.extend((name.len() as u64).to_le_bytes());
                    bytes.extend(name.bytes());
                }
                bytes.extend(u64::from(unit.start).to_le_bytes());
                let hash = Sha256::digest(&bytes);
                let expected = hash[..8].iter().rev().fold(0, |n, &b| (n << 8) | u64::from(b));
                assert_eq!(plan.seed_at(&unit, unit.start), expected);
                seen.insert(expected);
                count += 1;
            }
        }
        assert_eq!((seen.len(), count), (36, 36));
    }

    #[test]
    fn seeds_do_not_depend_on_what_else_is_run() {
        let (all, mut few) = (plan(3), plan(3));
        few.trackers.remove(0);
        few.sequences.reverse();
        let named = |plan: &Plan| -> BTreeMap<String, u64> {
            let seeds = plan
                .units()
                .map(|u| (plan.describe(&u), plan.seed_at(&u, u.start)));
            seeds.collect()
        };
        let (all, few) = (named(&all), named(&few));
        assert!(few.len() == 9 && few.iter().all(|(name, seed)| all[name] == *seed));
    }
}
