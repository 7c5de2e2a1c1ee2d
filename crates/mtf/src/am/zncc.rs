//! ZNCC, zero-mean normalised cross-correlation: SSD of standardised patches.
//!
//! `Î = (I - µ)/σ`, `σ² = Σ (I - µ)²/n`, the same for `T`; `f = -½ |Î - T̂|² = -n (1 - ncc)`. Each patch's `µ` and `σ`
//! are held fixed while differentiating (Gauss-Newton on the standardised residual): `df/dI = -(Î - T̂)/σ_I`,
//! `df/dT = (Î - T̂)/σ_T`, Hessian of a side `-Id/σ²`. The exact derivatives of the same measure are [`super::Ncc`]'s.
//!
//! With a robust loss or a mask `µ` and `σ` of both patches are weighted, and so are the differences as in SSD: an occluder
//! counts neither as difference nor as brightness or contrast. Weights are estimated twice for each patch: from the
//! differences when it is standardised with `µ` and `σ` of the patch before, then from those with its own, weighted.

use super::robust::{NOISE, Robust, Weights};
use super::ssd::{least_squares, scaled_gram, weigh};
use super::{AppearanceModel, Capabilities, Curvature, Metric, Normal, PatchShape, Side};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Zncc`].
    pub struct ZnccParams {
        /// Loss of single differences: none (squares), huber or tukey (M-estimators, scaled by the median difference).
        robust: Robust = Robust::None;
        /// Likelihood exp(-2 alpha (1 - ncc)): alpha.
        likelihood_alpha: f64 = 50.0, in 0.0..=1e6;
    }
}

/// Patches whose standard deviation is below this are flat: they standardise to zero.
pub(super) const FLAT: f64 = 1e-6;

/// Writes `(x - mean) / deviation` to `out`, zero for a flat patch; returns mean and `1 / deviation` (0 when flat).
pub(super) fn standardise(x: &[f32], out: &mut [f32]) -> (f64, f64) {
    let n = x.len() as f64;
    let mean = kernels::sum(x) / n;
    let deviation = (kernels::rescale(x, mean as f32, 1.0, out) / n).sqrt();
    let inverse = if deviation >= FLAT { 1.0 / deviation } else { 0.0 };
    kernels::rescale(x, mean as f32, inverse as f32, out);
    (mean, inverse)
}

/// A template to correlate many patches with, when only the correlation is wanted: one pass over each.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Correlator {
    mean: f32,
    /// Sum of the standardised template: zero but for rounding, which the distance of the means multiplies.
    sum: f64,
}

impl Correlator {
    /// For the standardised `template`, which had this mean.
    pub fn new(mean: f64, template: &[f32]) -> Self {
        Correlator {
            mean: mean as f32,
            sum: kernels::sum(template),
        }
    }

    /// Correlation coefficient of the patch and the template, and `1/σ` of the patch. None with weights, and where the patch
    /// is so flat, or so much brighter or darker than the template, that sums about the template's mean are too inexact.
    pub fn correlate(self, template: &[f32], weights: &Weights, patch: &[f32]) -> Option<(f64, f64)> {
        if weights.used() {
            return None;
        }
        let n = patch.len() as f64;
        let [sum, squares, product] = kernels::moments(patch, self.mean, template);
        let shift = sum / n;
        let variance = squares / n - shift * shift;
        let exact = variance > 0.1 * shift * shift && variance > FLAT * FLAT;
        exact.then(|| {
            let inverse = 1.0 / variance.sqrt();
            ((product - shift * self.sum) / n * inverse, inverse)
        })
    }
}

/// Zero-mean normalised cross-correlation.
#[derive(Clone, Debug, Default)]
pub struct Zncc {
    params: ZnccParams,
    /// `T̂`, without weights.
    template: Vec<f32>,
    /// `µ` and `1/σ` of it.
    plain_stats: (f64, f64),
    correlator: Correlator,
    /// `T̂` with weights, if there are any.
    weighted: Vec<f32>,
    weights: Weights,
    /// `µ` and `1/σ` of the template and of the current patch.
    template_stats: (f64, f64),
    current_stats: (f64, f64),
    /// `Î - T̂`, weighted if there are weights.
    residual: Vec<f32>,
    /// `-2 f`.
    ssd: f64,
}

impl Zncc {
    fn set_weighted(&mut self, patch: &[f32]) {
        self.weighted.resize(self.template.len(), 0.0);
        let (t, e) = (&mut self.weighted, &mut self.residual);
        self.weights
            .judge(&self.template, patch, self.current_stats, t, e);
        let (mean, inverse) = self.plain_stats;
        let (shift, k) = self.weights.standardise(&self.template, &mut self.weighted);
        self.template_stats = (mean + shift / inverse, inverse * k);
        self.current_stats = self.weights.standardise(patch, &mut self.residual);
        let squares = kernels::subtract_from(&mut self.residual, &self.weighted);
        let floor = NOISE * self.template_stats.1;
        self.ssd = weigh(&mut self.weights, &mut self.residual, squares, floor);
    }
    fn inverse_deviation(&self, side: Side) -> f64 {
        match side {
            Side::Template => self.template_stats.1,
            Side::Current => self.current_stats.1,
        }
    }
    /// Factor of the residual in the gradient of a side.
    fn factor(&self, side: Side) -> f64 {
        match side {
            Side::Template => self.template_stats.1,
            Side::Current => -self.current_stats.1,
        }
    }
}

impl Part for Zncc {
    type Params = ZnccParams;
    const NAME: &'static str = "zncc";
    const SUMMARY: &'static str = "zero-mean normalised cross-correlation: SSD of standardised patches";
    fn new(params: ZnccParams) -> Self {
        Zncc {
            weights: Weights::new(params.robust),
            params,
            ..Zncc::default()
        }
    }
}

impl AppearanceModel for Zncc {
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            derivatives: true,
            symmetric: true,
            metric: Metric::SquaredL2,
            gain_bias_invariant: true,
            masks: true,
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template.clear();
        self.template.resize(shape.len(), 0.0);
        self.residual.clear();
        self.residual.resize(shape.len(), 0.0);
        self.plain_stats = standardise(patch, &mut self.template);
        self.template_stats = self.plain_stats;
        self.correlator = Correlator::new(self.plain_stats.0, &self.template);
        self.weights.reset(shape.len());
        if self.template_stats.1 == 0.0 {
            return Err(TrackError::Template("flat patch"));
        }
        self.current_stats = self.template_stats;
        self.ssd = 0.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        if self.weights.used() {
            return self.set_weighted(patch);
        }
        self.template_stats = self.plain_stats;
        self.current_stats = standardise(patch, &mut self.residual);
        self.ssd = kernels::subtract_from(&mut self.residual, &self.template);
    }
    fn score(&mut self, patch: &[f32]) -> f64 {
        match self.correlator.correlate(&self.template, &self.weights, patch) {
            Some((ncc, _)) => self.ssd = 2.0 * self.template.len() as f64 * (1.0 - ncc),
            None => self.set_current(patch),
        }
        self.similarity()
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
        kernels::combine(self.factor(side) as f32, &self.residual, 0.0, &self.residual, out);
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        scaled_gram(j, &self.weights, -self.inverse_deviation(side).powi(2), h);
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        scaled_gram(j, &self.weights, -self.inverse_deviation(side).powi(2), h);
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
            -self.inverse_deviation(side).powi(2),
            out,
        );
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-self.params.likelihood_alpha * self.ssd / self.template.len() as f64)
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        standardise(patch, out);
    }
    fn reference(&self, template: &[f64], current: &[f64]) -> f64 {
        let ((mt, st), (mi, si)) = (self.template_stats, self.current_stats);
        let e = |t: f64, i: f64| (i - mi) * si - (t - mt) * st;
        -self
            .weights
            .reference(template.iter().zip(current).map(|(&t, &i)| e(t, i)))
    }
    fn memory(&self) -> usize {
        8 * self.template.capacity() + 4 * self.weighted.capacity() + self.weights.memory()
    }
}
