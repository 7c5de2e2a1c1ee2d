//! A tracker to be evaluated: its names and parameters, and how to make one.

use crate::metric::aggregate::TrackerName;
use mtf::registry::{Registry, SpecError, TrackerSpec};
use mtf::tracker::Tracker;
use serde_json::Value;
use std::sync::Arc;

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
            make: Arc::new(move || make().map_err(|e| e.to_string())),
        })
    }
}
