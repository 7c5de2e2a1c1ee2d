//! The part of a plan that one of several processes runs: `slice:i/n` or `hash:i/n`, counted from 1.
//!
//! Both keep trackers of a sequence together, so that each of its frames is decoded once for many of them, and both are
//! functions of the plan alone. *Slices* are consecutive runs of equal cost (frames) of the units ordered by sequence and,
//! within it, by the fractional part of `rank * phi` of the tracker: any stretch of that order is spread evenly over the
//! ids, so that costly families do not gather in one slice. *Hashes* deal out blocks of a sequence and a sixteenth of the
//! trackers; what is added to a plan leaves the rest where it was.

use super::spread::spread;
use super::units::{Plan, Unit};
use sha2::{Digest, Sha256};
use std::fmt;
use std::str::FromStr;

/// Parts that the trackers of a sequence are dealt out in by hash.
const BLOCKS: u8 = 16;

/// How a plan is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Cut {
    /// Runs of equal cost.
    Slice,
    /// Blocks by hash.
    Hash,
}

impl fmt::Display for Cut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Cut::Slice => "slice",
            Cut::Hash => "hash",
        })
    }
}

/// A text that names no shard, or no way to cut a plan.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ShardError {
    /// No shard.
    #[error("'{0}' is no shard; expected slice:i/n or hash:i/n with i from 1 to n")]
    Shard(String),
    /// No way to cut a plan.
    #[error("'{0}' is no way to cut a plan; expected slice or hash")]
    Cut(String),
}

impl FromStr for Cut {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Cut, ShardError> {
        let named = [Cut::Slice, Cut::Hash]
            .into_iter()
            .find(|cut| cut.to_string() == text);
        named.ok_or_else(|| ShardError::Cut(text.to_owned()))
    }
}

/// One of `count` parts of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// How the plan is cut.
    pub cut: Cut,
    /// Which part, from 1.
    pub index: u32,
    /// Number of parts.
    pub count: u32,
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}/{}", self.cut, self.index, self.count)
    }
}

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Shard, ShardError> {
        let parse = || {
            let (cut, part) = text.trim().split_once(':')?;
            let (index, count) = part.split_once('/')?;
            let cut = cut.parse().ok()?;
            let (index, count) = (index.parse().ok()?, count.parse().ok()?);
            (1..=count)
                .contains(&index)
                .then_some(Shard { cut, index, count })
        };
        parse().ok_or_else(|| ShardError::Shard(text.to_owned()))
    }
}

/// Says which part each unit of a plan belongs to.
#[derive(Clone, Debug)]
pub struct Sharding {
    cut: Cut,
    count: u32,
    /// Slice: place of each tracker within a sequence. Hash: its block.
    trackers: Vec<u32>,
    /// Slice: cost of all sequences before this one and of this one, per tracker. Hash: nothing.
    sequences: Vec<(u64, u64)>,
    total: u128,
    /// Names of the sequences, for hashes.
    ids: Vec<[u8; 32]>,
    /// Course, start and frames of the units of a tracker on each sequence.
    passes: Vec<Vec<(u32, u32, u64)>>,
}

impl Sharding {
    /// Cuts `plan` into `count` parts.
    pub fn new(plan: &Plan, cut: Cut, count: u32) -> Sharding {
        let trackers = match cut {
            Cut::Slice => {
                let mut order: Vec<u32> = (0..plan.trackers.len() as u32).collect();
                order.sort_by_key(|&rank| spread(rank.into()));
                let mut place = vec![0; order.len()];
                (0..).zip(&order).for_each(|(k, &rank)| place[rank as usize] = k);
                place
            }
            Cut::Hash => {
                let block = |id: &str| u32::from(Sha256::digest(id)[0] % BLOCKS);
                plan.trackers.iter().map(|t| block(&t.id)).collect()
            }
        };
        let mut passes = vec![Vec::new(); plan.sequences.len()];
        for unit in plan.passes() {
            passes[unit.sequence as usize].push((unit.course, unit.start, plan.unit_frames(&unit)));
        }
        let mut before = 0;
        let sequences = passes.iter().map(|passes| {
            let cost: u64 = passes.iter().map(|(.., frames)| frames).sum();
            before += cost;
            (before - cost, cost)
        });
        let sequences = sequences.collect();
        Sharding {
            cut,
            count: count.max(1),
            trackers,
            sequences,
            total: u128::from(before) * plan.trackers.len() as u128,
            ids: plan
                .sequences
                .iter()
                .map(|s| Sha256::digest(s.id()).into())
                .collect(),
            passes,
        }
    }

    /// The part, from 1, that `unit` belongs to.
    pub fn of(&self, unit: &Unit) -> u32 {
        let place = self.trackers[unit.tracker as usize];
        let s = unit.sequence as usize;
        match self.cut {
            Cut::Slice => {
                let (before, cost) = self.sequences[s];
                let mut earlier = 0;
                let mut own = 0;
                for &(course, start, frames) in &self.passes[s] {
                    if (course, start) == (unit.course, unit.start) {
                        own = u128::from(frames);
                        break;
                    }
                    earlier += u128::from(frames);
                }
                let begin = u128::from(before) * self.trackers.len() as u128
                    + u128::from(place) * u128::from(cost)
                    + earlier;
                // A unit belongs where its middle is.
                let twice = 2 * begin + own;
                (twice * u128::from(self.count) / (2 * self.total)) as u32 + 1
            }
            Cut::Hash => {
                let mut hash = Sha256::new();
                hash.update(self.ids[s]);
                hash.update(place.to_le_bytes());
                let bytes = hash.finalize();
                let number = u64::from_le_bytes(std::array::from_fn(|i| bytes[i]));
                (number % u64::from(self.count)) as u32 + 1
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{FrameLogs, PlannedSequence, PlannedTracker, Protocols};
    use serde_json::{Map, Value};
    use std::collections::{BTreeMap, BTreeSet};

    fn plan(trackers: usize, sequences: &[(usize, &[u32])]) -> Plan {
        Plan {
            data: Default::default(),
            schema_version: 1,
            tool: "t".into(),
            version: "1".into(),
            protocol: Protocols::default(),
            seed: 0,
            pre: "none".into(),
            frame_logs: FrameLogs::Csv,
            metrics: Vec::new(),
            about: Map::new(),
            joined: Vec::new(),
            trackers: (0..trackers)
                .map(|k| PlannedTracker {
                    id: format!("t{k:04}"),
                    sm: String::new(),
                    am: String::new(),
                    ssm: String::new(),
                    ilm: String::new(),
                    slug: format!("t{k:04}"),
                    parameters: Value::Null,
                    answers: Default::default(),
                })
                .collect(),
            sequences: (0..)
                .zip(sequences)
                .map(|(k, &(frames, starts))| PlannedSequence {
                    dataset: "d".into(),
                    sequence: format!("s{k}"),
                    frames,
                    starts: vec![starts.to_vec()],
                    fingerprint: String::new(),
                    tags: Vec::new(),
                })
                .collect(),
        }
    }

    #[test]
    fn slices_are_equal_and_change_sequence_seldom() {
        let plan = plan(100, &[(80, &[0]), (1000, &[0, 100, 900]), (60, &[5])]);
        for count in [1, 2, 7, 16, 300] {
            let sharding = Sharding::new(&plan, Cut::Slice, count);
            let mut cost = vec![0; count as usize];
            let mut sequences = vec![BTreeSet::new(); count as usize];
            for unit in plan.units() {
                let part = sharding.of(&unit) as usize - 1;
                cost[part] += plan.unit_frames(&unit);
                sequences[part].insert(unit.sequence);
            }
            let fair = plan.frames() as f64 / f64::from(count);
            assert!(
                cost.iter().all(|&c| (c as f64 - fair).abs() <= 1000.0),
                "{count}: {cost:?}"
            );
            let visits: usize = sequences.iter().map(BTreeSet::len).sum();
            assert!(
                visits < plan.sequences.len() + count as usize,
                "{count}: {visits}"
            );
        }
    }

    #[test]
    fn a_slice_of_a_sequence_is_spread_over_the_trackers() {
        let plan = plan(160, &[(50, &[0])]);
        let sharding = Sharding::new(&plan, Cut::Slice, 8);
        let mut tens: BTreeMap<u32, BTreeMap<u32, usize>> = BTreeMap::new();
        for unit in plan.units() {
            *tens
                .entry(sharding.of(&unit))
                .or_default()
                .entry(unit.tracker / 40)
                .or_default() += 1;
        }
        assert!(
            tens.values()
                .flat_map(|t| t.values())
                .all(|&n| (4..=6).contains(&n)),
            "{tens:?}"
        );
    }

    #[test]
    fn hashes_keep_their_units_when_the_plan_grows() {
        let small = plan(40, &[(50, &[0]), (60, &[0])]);
        let large = plan(60, &[(50, &[0]), (60, &[0]), (70, &[0])]);
        let (a, b) = (
            Sharding::new(&small, Cut::Hash, 5),
            Sharding::new(&large, Cut::Hash, 5),
        );
        for unit in small.units() {
            assert_eq!(a.of(&unit), b.of(&unit));
        }
        let used: BTreeSet<u32> = large.units().map(|unit| b.of(&unit)).collect();
        assert_eq!(used.into_iter().collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    }

    #[test]
    fn names_come_back() {
        for text in ["slice:1/1", "hash:3/16"] {
            assert_eq!(text.parse::<Shard>().unwrap().to_string(), text);
        }
        for bad in [
            "",
            "slice",
            "slice:0/4",
            "slice:5/4",
            "hash:a/b",
            "part:1/2",
            "slice:1",
        ] {
            assert!(bad.parse::<Shard>().is_err(), "{bad}");
        }
    }

    /// The units side by side on a line, each as long as its frames, in the order of slices: cut into parts of one length,
    /// the part that holds the middle of a unit has it.
    #[test]
    fn a_slice_has_the_units_whose_middles_it_holds() {
        let plan = plan(7, &[(80, &[0]), (1000, &[0, 100, 900]), (60, &[5])]);
        let mut units: Vec<Unit> = plan.units().collect();
        units.sort_by_key(|u| (u.sequence, spread(u.tracker.into()), u.start));
        for count in [1, 2, 3, 5, 16, 300] {
            let sharding = Sharding::new(&plan, Cut::Slice, count);
            let mut begin = 0;
            for unit in &units {
                let frames = plan.unit_frames(unit);
                // In halves of a frame.
                let (middle, length) = (2 * begin + frames, 2 * plan.frames());
                let part = (1..=u64::from(count))
                    .rfind(|part| (part - 1) * length <= middle * u64::from(count))
                    .unwrap();
                assert_eq!(u64::from(sharding.of(unit)), part, "{count} {unit:?}");
                begin += frames;
            }
            assert_eq!(begin, plan.frames());
        }
    }

    #[test]
    fn equal_units_are_dealt_out_equally() {
        let plan = plan(6, &[(50, &[0]), (50, &[0])]);
        for count in [1, 2, 3, 4, 6, 12] {
            let sharding = Sharding::new(&plan, Cut::Slice, count);
            let mut held = vec![0; count as usize];
            plan.units()
                .for_each(|unit| held[sharding.of(&unit) as usize - 1] += 1);
            assert_eq!(held, vec![12 / count; count as usize]);
        }
    }
}
