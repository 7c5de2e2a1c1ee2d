//! Several runs as one: what each of them was of, in a plan that has the trackers, protocols and sequences of all.

use super::protocol::{Protocol, Protocols};
use super::units::{Plan, PlannedSequence, PlannedTracker};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// A run that is part of a union: its trackers on its sequences under its protocols.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Joined {
    /// Indices into the plan's trackers, ascending.
    pub trackers: Vec<u32>,
    /// Indices into the plan's protocols, ascending.
    pub protocols: Vec<u32>,
    /// Indices into the plan's sequences, ascending.
    pub sequences: Vec<u32>,
    /// What the run records about its data and settings.
    #[serde(flatten)]
    pub about: Map<String, Value>,
}

impl Joined {
    /// Whether the run had the tracker, sequence and protocol of these indices.
    pub(super) fn has(&self, tracker: u32, sequence: u32, protocol: u32) -> bool {
        let among = |list: &[u32], index: u32| list.binary_search(&index).is_ok();
        among(&self.protocols, protocol) && among(&self.sequences, sequence) && among(&self.trackers, tracker)
    }

    fn order(&self) -> (&[u32], &[u32], &[u32], String) {
        let about = Value::Object(self.about.clone()).to_string();
        (&self.trackers, &self.protocols, &self.sequences, about)
    }
}

impl Plan {
    /// The runs that the plan is of: itself where it is no union.
    fn runs(&self) -> Vec<Joined> {
        if !self.joined.is_empty() {
            return self.joined.clone();
        }
        let all = |n: usize| (0..n as u32).collect();
        vec![Joined {
            trackers: all(self.trackers.len()),
            protocols: all(self.protocol.len()),
            sequences: all(self.sequences.len()),
            about: self.about.clone(),
        }]
    }

    /// A plan with the units of both and no others; the same whichever comes first.
    ///
    /// # Errors
    /// What makes units of the two differ that go by the same names: settings, parameters of a tracker, or frames or
    /// ground truth of a sequence.
    pub fn union(&self, other: &Plan) -> Result<Plan, String> {
        let settings = |p: &Plan| {
            let logs = ("frame logs", p.frame_logs.extension().to_owned());
            p.settings().into_iter().chain([logs])
        };
        for ((what, a), (_, b)) in settings(self).zip(settings(other)) {
            if a != b {
                let word = |text: String| if text.is_empty() { "none".to_owned() } else { text };
                return Err(format!("{what} {} against {}", word(a), word(b)));
            }
        }
        let mut trackers: BTreeMap<&str, &PlannedTracker> = BTreeMap::new();
        let mut sequences: BTreeMap<(&str, &str), &PlannedSequence> = BTreeMap::new();
        for plan in [self, other] {
            for tracker in &plan.trackers {
                if *trackers.entry(&tracker.id).or_insert(tracker) != tracker {
                    return Err(format!("other parameters of {}", tracker.id));
                }
            }
            for sequence in &plan.sequences {
                let key = (sequence.dataset.as_str(), sequence.sequence.as_str());
                let known = sequences.entry(key).or_insert(sequence);
                if (&known.fingerprint, known.frames) != (&sequence.fingerprint, sequence.frames) {
                    return Err(format!("other frames or ground truth of {}", sequence.id()));
                }
            }
        }
        let protocols = self.protocol.iter().chain(other.protocol.iter());
        let mut union = Plan {
            protocol: Protocols::new(protocols.copied()),
            trackers: trackers.into_values().cloned().collect(),
            sequences: sequences.into_values().cloned().collect(),
            ..self.clone()
        };
        for sequence in &mut union.sequences {
            // Where neither run has the sequence under the protocol, it has no starts.
            let starts = |protocol: &Protocol| {
                let of = |plan: &Plan| {
                    let index = plan.protocol.iter().position(|p| p == protocol)?;
                    let own = plan.sequences.iter().find(|s| s.id() == sequence.id())?;
                    Some(own.starts[index].clone()).filter(|starts| !starts.is_empty())
                };
                of(self).or_else(|| of(other)).unwrap_or_default()
            };
            sequence.starts = union.protocol.iter().map(starts).collect();
        }
        union.data.join(&other.data);
        union.joined = [self, other]
            .iter()
            .flat_map(|plan| moved(plan, &union))
            .collect();
        union.joined.sort_by(|a, b| a.order().cmp(&b.order()));
        union.joined.dedup();
        // What all of them say.
        let mut runs = union.joined.iter();
        union.about = runs.next().map(|run| run.about.clone()).unwrap_or_default();
        for run in runs {
            union.about.retain(|key, value| run.about.get(key) == Some(value));
        }
        if union.joined.len() == 1 {
            union.joined.clear();
        }
        Ok(union)
    }
}

/// The runs of `plan` with the indices of `union`, which has all that they have.
fn moved(plan: &Plan, union: &Plan) -> Vec<Joined> {
    fn places<T>(from: &[T], to: &[T], same: impl Fn(&T, &T) -> bool) -> Vec<u32> {
        let place = |one: &T| to.iter().position(|other| same(one, other)).unwrap_or_default();
        from.iter().map(|one| place(one) as u32).collect()
    }
    let ids: BTreeMap<&str, u32> = (0..)
        .zip(&union.trackers)
        .map(|(k, t)| (t.id.as_str(), k))
        .collect();
    let trackers: Vec<u32> = plan.trackers.iter().map(|t| ids[t.id.as_str()]).collect();
    let sequences = places(&plan.sequences, &union.sequences, |a, b| a.id() == b.id());
    let protocols = places(&plan.protocol, &union.protocol, |a, b| a == b);
    let through = |indices: &[u32], places: &[u32]| {
        // Both are sorted alike, so that they stay ascending.
        indices.iter().map(|k| places[*k as usize]).collect()
    };
    let runs = plan.runs().into_iter().map(|run| Joined {
        trackers: through(&run.trackers, &trackers),
        protocols: through(&run.protocols, &protocols),
        sequences: through(&run.sequences, &sequences),
        about: run.about,
    });
    runs.collect()
}
