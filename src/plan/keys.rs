//! The identity of a unit: a hash of all that its result depends on, by which a run directory knows what it holds.

use super::protocol::Protocol;
use super::units::{Plan, PlannedSequence, PlannedTracker, Unit};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

/// Identity of a unit: 128 bits of a SHA-256 over everything that can change the result.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct UnitKey(pub [u8; 16]);

impl std::fmt::Display for UnitKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&hex::encode(self.0))
    }
}

impl std::fmt::Debug for UnitKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "UnitKey({self})")
    }
}

impl Serialize for UnitKey {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for UnitKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<UnitKey, D::Error> {
        let text = std::borrow::Cow::<str>::deserialize(deserializer)?;
        let mut key = [0; 16];
        hex::decode_to_slice(text.as_ref(), &mut key)
            .map_err(|_| serde::de::Error::custom("expected 32 hexadecimal digits"))?;
        Ok(UnitKey(key))
    }
}

/// Makes the keys of a plan's units.
#[derive(Clone, Debug)]
pub struct UnitKeys {
    run: [u8; 32],
    trackers: Vec<[u8; 32]>,
    sequences: Vec<[u8; 32]>,
    courses: Vec<String>,
}

impl UnitKeys {
    /// For the units of `plan`.
    pub fn new(plan: &Plan) -> UnitKeys {
        let hash = |value: Value| -> [u8; 32] { Sha256::digest(value.to_string()).into() };
        let tracker = |t: &PlannedTracker| hash(json!({"id": t.id, "parameters": t.parameters}));
        // One pass to the end has no name of its own: its units are as old as the program.
        let course = |p: &Protocol| match p.course() {
            Protocol::Ope => String::new(),
            other => other.to_string(),
        };
        let sequence = |s: &PlannedSequence| {
            hash(json!({
                "dataset": s.dataset,
                "sequence": s.sequence,
                "fingerprint": s.fingerprint,
                "frames": s.frames,
            }))
        };
        let mut run = json!({
            "schema": plan.schema_version,
            "crate": plan.version,
            "pre": plan.pre,
            "seed": plan.seed,
        });
        // What is kept of a frame depends on them.
        if !plan.metrics.is_empty() {
            run["metrics"] = plan.metrics.as_slice().into();
        }
        UnitKeys {
            run: hash(run),
            trackers: plan.trackers.iter().map(tracker).collect(),
            sequences: plan.sequences.iter().map(sequence).collect(),
            courses: plan.protocol.iter().map(course).collect(),
        }
    }

    /// The key of one.
    pub fn of(&self, unit: &Unit) -> UnitKey {
        let mut hash = Sha256::new();
        hash.update(self.run);
        hash.update(self.trackers[unit.tracker as usize]);
        hash.update(self.sequences[unit.sequence as usize]);
        hash.update(unit.start.to_le_bytes());
        hash.update(&self.courses[unit.course as usize]);
        let bytes = hash.finalize();
        UnitKey(std::array::from_fn(|i| bytes[i]))
    }
}
