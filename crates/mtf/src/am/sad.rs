//! SAD, sum of absolute differences: `f = -Σ |I_i - T_i|`.
//!
//! Without derivatives (`f` has none where a difference is zero), so for sampling methods only. Likelihood
//! `exp(alpha f/n)`; the distance is the L1 norm.

use super::{AppearanceModel, Distances, Metric, PatchShape, Properties, Reference};
use crate::entry::Part;
use crate::kernels;
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Sad`].
    pub struct SadParams {
        /// Likelihood exp(-alpha * mean absolute difference): alpha, per gray level.
        likelihood_alpha: f64 = 2.0, in 0.0..=1e6;
    }
}

/// Sum of absolute differences.
#[derive(Clone, Debug, Default)]
pub struct Sad {
    params: SadParams,
    template: Vec<f32>,
    sad: f64,
}

impl Part for Sad {
    type Params = SadParams;
    const NAME: &'static str = "sad";
    const SUMMARY: &'static str = "sum of absolute differences; no derivatives";
    fn new(params: SadParams) -> Self {
        Sad {
            params,
            ..Sad::default()
        }
    }
}

impl AppearanceModel for Sad {
    fn properties(&self) -> Properties {
        Properties::default()
    }
    fn set_template(&mut self, _shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template.clear();
        self.template.extend_from_slice(patch);
        self.sad = 0.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.sad = kernels::absolute_distance(patch, &self.template, f64::INFINITY);
    }
    fn similarity(&self) -> f64 {
        -self.sad
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-self.params.likelihood_alpha * self.sad / self.template.len() as f64)
    }
    fn memory(&self) -> usize {
        4 * self.template.capacity()
    }
    fn distances(&self) -> Option<&dyn Distances> {
        Some(self)
    }
    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }
}

impl Distances for Sad {
    fn metric(&self) -> Metric {
        Metric::L1
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        out.copy_from_slice(patch);
    }
    fn distance(&self, query: &[f32], stored: &[f32], bound: f32) -> f32 {
        kernels::absolute_distance(query, stored, bound.into()) as f32
    }
}

impl Reference for Sad {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        -template
            .iter()
            .zip(current)
            .map(|(t, i)| (i - t).abs())
            .sum::<f64>()
    }
}
