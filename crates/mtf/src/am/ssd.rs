//! SSD, sum of squared differences (Hager & Belhumeur 1998; Baker & Matthews 2004).
//!
//! `f = -½ Σ e_i²`, `e = I - T`; `df/dI = -e`, `df/dT = e`, every Hessian `-Id`, so `-J'J` in parameters. With a robust
//! loss or a mask values have weights `w`: `-w e`, `w e`, `-J' diag(w) J`, see [`super::Robust`].

use super::robust::{NOISE, Robust, Weights};
use super::{AppearanceModel, Capabilities, Curvature, Metric, Normal, PatchShape, Side};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Ssd`].
    pub struct SsdParams {
        /// Loss of single differences: none (squares), huber or tukey (M-estimators, scaled by the median difference).
        robust: Robust = Robust::None;
        /// Likelihood exp(-alpha * RMS difference): alpha.
        likelihood_alpha: f64 = 2.0, in 0.0..=1e6;
    }
}

/// Sum of squared differences.
#[derive(Clone, Debug, Default)]
pub struct Ssd {
    params: SsdParams,
    template: Vec<f32>,
    /// `e = I - T`; with weights `w e`.
    residual: Vec<f32>,
    /// `-2 f`.
    ssd: f64,
    weights: Weights,
}

impl Part for Ssd {
    type Params = SsdParams;
    const NAME: &'static str = "ssd";
    const SUMMARY: &'static str = "sum of squared differences";
    fn new(params: SsdParams) -> Self {
        Ssd {
            weights: Weights::new(params.robust),
            params,
            ..Ssd::default()
        }
    }
}

/// `h = factor * J'WJ`.
pub(super) fn scaled_gram(j: &Jacobian, w: &Weights, factor: f64, h: &mut SymMatrix) {
    w.normal_equations(j, &[], h, &mut []);
    h.scale(factor);
}

/// `gradient = factor * J'r`, `hessian = curvature * J'WJ`.
pub(super) fn least_squares(
    j: &Jacobian,
    w: &Weights,
    r: &[f32],
    factor: f64,
    curvature: f64,
    out: &mut Normal,
) {
    w.normal_equations(j, &[r], &mut out.hessian, &mut out.gradient);
    out.hessian.scale(curvature);
    out.gradient.iter_mut().for_each(|g| *g *= factor);
}

/// Replaces the differences by `w e` if there are weights; `squares` is their sum of squares. Returns `-2 f`.
pub(super) fn weigh(w: &mut Weights, e: &mut [f32], squares: f64, floor: f64) -> f64 {
    if !w.used() {
        return squares;
    }
    let loss = w.estimate(e, floor);
    kernels::multiply(w.get().unwrap_or_default(), e);
    loss
}

impl AppearanceModel for Ssd {
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            derivatives: true,
            symmetric: true,
            metric: Metric::SquaredL2,
            gain_bias_invariant: false,
            masks: true,
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template.clear();
        self.template.extend_from_slice(patch);
        self.residual.clear();
        self.residual.resize(shape.len(), 0.0);
        self.ssd = 0.0;
        self.weights.reset(shape.len());
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        let squares = kernels::subtract(patch, &self.template, &mut self.residual);
        self.ssd = weigh(&mut self.weights, &mut self.residual, squares, NOISE);
    }
    fn set_mask(&mut self, mask: &[f32]) {
        self.weights.set_mask(mask);
    }
    fn weighted(&self) -> bool {
        self.weights.used()
    }
    fn similarity(&self) -> f64 {
        -0.5 * self.ssd
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let sign = if side == Side::Current { -1.0 } else { 1.0 };
        kernels::combine(sign, &self.residual, 0.0, &self.residual, out);
    }
    fn hessian_into(&mut self, _side: Side, j: &Jacobian, h: &mut SymMatrix) {
        scaled_gram(j, &self.weights, -1.0, h);
    }
    fn self_hessian_into(&mut self, _side: Side, j: &Jacobian, h: &mut SymMatrix) {
        scaled_gram(j, &self.weights, -1.0, h);
    }
    fn linearise(
        &mut self,
        side: Side,
        _curvature: Curvature,
        j: &Jacobian,
        _scratch: &mut [f32],
        out: &mut Normal,
    ) {
        let sign = if side == Side::Current { -1.0 } else { 1.0 };
        least_squares(j, &self.weights, &self.residual, sign, -1.0, out);
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-self.params.likelihood_alpha * (0.5 * self.ssd / self.template.len() as f64).sqrt())
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        out.copy_from_slice(patch);
    }
    fn reference(&self, template: &[f64], current: &[f64]) -> f64 {
        -self
            .weights
            .reference(template.iter().zip(current).map(|(t, i)| i - t))
    }
    fn memory(&self) -> usize {
        8 * self.template.capacity() + self.weights.memory()
    }
}
