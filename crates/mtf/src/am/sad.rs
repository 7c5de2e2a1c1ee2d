//! SAD, sum of absolute differences: `f = -Σ |I_i - T_i|`.
//!
//! Without derivatives (`f` has none where a difference is zero), so for sampling methods only. Likelihood
//! `exp(alpha f/n)`; the distance is the L1 norm.

use super::{AppearanceModel, Capabilities, Metric, PatchShape, Side};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Sad`].
    pub struct SadParams {
        /// Likelihood exp(-alpha * mean absolute difference): alpha.
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
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            derivatives: false,
            symmetric: true,
            metric: Metric::L1,
            gain_bias_invariant: false,
            masks: false,
        }
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
    /// Zero: there is no gradient.
    fn gradient_into(&mut self, _side: Side, out: &mut [f32]) {
        out.fill(0.0);
    }
    /// Zero: there is no Hessian.
    fn hessian_into(&mut self, _side: Side, _j: &Jacobian, h: &mut SymMatrix) {
        h.fill(|_, _| 0.0);
    }
    /// Zero: there is no Hessian.
    fn self_hessian_into(&mut self, _side: Side, _j: &Jacobian, h: &mut SymMatrix) {
        h.fill(|_, _| 0.0);
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-self.params.likelihood_alpha * self.sad / self.template.len() as f64)
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
    fn reference(&self, template: &[f64], current: &[f64]) -> f64 {
        -template
            .iter()
            .zip(current)
            .map(|(t, i)| (i - t).abs())
            .sum::<f64>()
    }
    fn memory(&self) -> usize {
        4 * self.template.capacity()
    }
}
