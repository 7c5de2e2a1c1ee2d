//! NSSD, SSD of patches scaled to another range of intensities.
//!
//! `x̃ = norm_min + k x`, `k = (norm_max - norm_min)/255`; `f = -½ Σ (Ĩ_i - T̃_i)² = k²` times that of [`super::Ssd`], and
//! so are all its derivatives. The optimum and every step of a search are SSD's; likelihoods, damping and sums of
//! models see the range.

use super::robust::{NOISE, Robust, Weights};
use super::ssd::{least_squares, scaled_gram, weigh};
use super::{AppearanceModel, Capabilities, Curvature, Metric, Normal, PatchShape, Side};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Nssd`].
    pub struct NssdParams {
        /// Loss of single differences: none (squares), huber or tukey (M-estimators, scaled by the median difference).
        robust: Robust = Robust::None;
        /// What intensity 0 becomes.
        norm_min: f64 = 0.0, in -1e4..=0.0;
        /// What intensity 255 becomes.
        norm_max: f64 = 1.0, in 1e-3..=1e4;
        /// Likelihood exp(-alpha * RMS difference of the scaled patches): alpha.
        likelihood_alpha: f64 = 500.0, in 0.0..=1e6;
    }
}

/// Sum of squared differences of scaled patches.
#[derive(Clone, Debug, Default)]
pub struct Nssd {
    params: NssdParams,
    template: Vec<f32>,
    /// `I - T`, raw; weighted if there are weights.
    residual: Vec<f32>,
    /// `-2 f/k²`.
    ssd: f64,
    weights: Weights,
}

impl Nssd {
    fn k2(&self) -> f64 {
        ((self.params.norm_max - self.params.norm_min) / 255.0).powi(2)
    }

    /// Factor of the raw residual in the gradient of a side.
    fn factor(&self, side: Side) -> f64 {
        match side {
            Side::Template => self.k2(),
            Side::Current => -self.k2(),
        }
    }
}

impl Part for Nssd {
    type Params = NssdParams;
    const NAME: &'static str = "nssd";
    const SUMMARY: &'static str = "sum of squared differences of patches scaled to a range";
    fn new(params: NssdParams) -> Self {
        Nssd {
            weights: Weights::new(params.robust),
            params,
            ..Nssd::default()
        }
    }
}

impl AppearanceModel for Nssd {
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
        -0.5 * self.k2() * self.ssd
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        kernels::combine(self.factor(side) as f32, &self.residual, 0.0, &self.residual, out);
    }
    fn hessian_into(&mut self, _side: Side, j: &Jacobian, h: &mut SymMatrix) {
        scaled_gram(j, &self.weights, -self.k2(), h);
    }
    fn self_hessian_into(&mut self, _side: Side, j: &Jacobian, h: &mut SymMatrix) {
        scaled_gram(j, &self.weights, -self.k2(), h);
    }
    fn linearise(
        &mut self,
        side: Side,
        _curvature: Curvature,
        j: &Jacobian,
        _scratch: &mut [f32],
        out: &mut Normal,
    ) {
        least_squares(
            j,
            &self.weights,
            &self.residual,
            self.factor(side),
            -self.k2(),
            out,
        );
    }
    fn likelihood(&self) -> f64 {
        let rms = (0.5 * self.k2() * self.ssd / self.template.len() as f64).sqrt();
        libm::exp(-self.params.likelihood_alpha * rms)
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        let k = self.k2().sqrt() as f32;
        kernels::combine(k, patch, 0.0, patch, out);
    }
    fn reference(&self, template: &[f64], current: &[f64]) -> f64 {
        let differences = template.iter().zip(current).map(|(t, i)| i - t);
        -self.k2() * self.weights.reference(differences)
    }
    fn memory(&self) -> usize {
        8 * self.template.capacity() + self.weights.memory()
    }
}
