//! What every search asks of its template and its models: a patch that can be tracked, a base frame to keep, learning.

use crate::am::AppearanceModel;
use crate::params::param_enum;
use crate::tracker::TrackError;

param_enum! {
    /// Whether the appearance model learns from tracked frames.
    pub enum Learning {
        /// If the model is of little use without.
        Auto = "auto",
        /// No.
        Off = "0",
        /// Yes.
        On = "1",
    }
}

impl Learning {
    /// Whether `am` is to learn.
    pub(in crate::sm) fn wanted<A: AppearanceModel>(self, am: &mut A) -> bool {
        match self {
            Learning::Auto => am.learner().is_some_and(|model| model.needs_learning()),
            Learning::Off => false,
            Learning::On => true,
        }
    }
}

/// Largest RMS misfit, px, at which `set_region` keeps the base frame.
pub(in crate::sm) const KEEP_BASE: f64 = 0.5;

/// Refuses patches on which nothing can be tracked.
pub(in crate::sm) fn check_template(values: &[f32]) -> Result<(), TrackError> {
    if values.iter().any(|v| !v.is_finite()) {
        return Err(TrackError::NotFinite("template"));
    }
    let (low, high) = values
        .iter()
        .fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
    if high - low < 1e-3 {
        return Err(TrackError::Template("flat patch"));
    }
    Ok(())
}
