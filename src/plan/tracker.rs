//! A tracker to be evaluated: its names and parameters, and how to make one.

use crate::dataset::Sequence;
use crate::metric::aggregate::TrackerName;
use mtf::registry::{Registry, SpecError, TrackerSpec};
use mtf::tracker::Tracker;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::sync::Arc;

/// What a tracker is made for.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The sequence it is to follow; `None` where it is to find single warps.
    pub sequence: Option<&'a Sequence>,
    /// The frame of it that the tracker will be started on.
    pub start: usize,
}

/// Makes a fresh tracker, or says why it cannot.
pub type Make = dyn Fn(Job<'_>) -> Result<Box<dyn Tracker>, String> + Send + Sync;

/// What a tracker's answers are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Answers {
    /// The corners of the object.
    #[default]
    Corners,
    /// Upright boxes around it: only metrics that are [of boxes](crate::metric::Metric::of_boxes) mean something.
    Boxes,
}

impl Answers {
    /// Whether they are corners.
    pub fn are_corners(&self) -> bool {
        *self == Answers::Corners
    }
}

/// A tracker to be evaluated: what it is called and how to make one.
#[derive(Clone)]
pub struct TrackerEntry {
    /// Canonical id and parts, as tables show them.
    pub name: TrackerName,
    /// Name of the folder of its logs.
    pub slug: String,
    /// Every parameter with its value: two trackers with the same id and parameters must give the same results.
    pub parameters: Value,
    /// What its answers are.
    pub answers: Answers,
    /// Makes one. Called for each start.
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
    pub fn from_registry(registry: &Registry, spec: &TrackerSpec) -> Result<TrackerEntry, SpecError> {
        let (sm, am, ssm, ilm) = spec.parts();
        let name = TrackerName {
            id: spec.to_string(),
            sm: sm.to_owned(),
            am: am.to_owned(),
            ssm: ssm.to_owned(),
            ilm: ilm.to_owned(),
        };
        let parameters = registry.describe(spec)?;
        let make = registry.prepare(spec)?;
        Ok(TrackerEntry {
            name,
            slug: spec.slug(),
            parameters,
            answers: Answers::Corners,
            make: Arc::new(move |_| make().map_err(|e| e.to_string())),
        })
    }
}
