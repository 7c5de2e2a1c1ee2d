//! ZNCC, zero-mean normalised cross-correlation: SSD of standardised patches.
//!
//! `Î = (I - µ)/σ`, `σ² = Σ (I - µ)²/n`, the same for `T`; `f = -½ |Î - T̂|² = -n (1 - ncc)`. Each patch's `µ` and `σ`
//! are held fixed while differentiating (Gauss-Newton on the standardised residual): `df/dI = -(Î - T̂)/σ_I`,
//! `df/dT = (Î - T̂)/σ_T`, Hessian of a side `-Id/σ²`. The exact derivatives of the same measure are [`super::Ncc`]'s.
//!
//! With a robust loss or a mask `µ` and `σ` of both patches are weighted, and so are the differences as in SSD: an occluder
//! counts neither as difference nor as brightness or contrast. Weights are estimated twice for each patch: from the
//! differences when it is standardised with `µ` and `σ` of the patch before, then from those with its own, weighted.

use super::standard::{Correlator, standardise};
use super::weights::{NOISE, Robust, Weights};
use super::{
    AppearanceModel, Curvature, Derivatives, Distances, Masking, Metric, Normal, PatchShape, Properties,
    Reference, Side,
};
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
        self.ssd = self.weights.weigh(&mut self.residual, squares, floor);
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
    fn properties(&self) -> Properties {
        Properties {
            gain_bias_invariant: true,
            ..Properties::default()
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
        if self.weights.used() {
            self.set_current(patch);
            return self.similarity();
        }
        match self.correlator.correlate(&self.template, patch) {
            Some((ncc, _)) => self.ssd = 2.0 * self.template.len() as f64 * (1.0 - ncc),
            None => self.set_current(patch),
        }
        self.similarity()
    }
    fn similarity(&self) -> f64 {
        -0.5 * self.ssd
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-self.params.likelihood_alpha * self.ssd / self.template.len() as f64)
    }
    fn memory(&self) -> usize {
        8 * self.template.capacity() + 4 * self.weighted.capacity() + self.weights.memory()
    }
    fn derivatives(&mut self) -> Option<&mut dyn Derivatives> {
        Some(self)
    }
    fn distances(&self) -> Option<&dyn Distances> {
        Some(self)
    }
    fn masking(&mut self) -> Option<&mut dyn Masking> {
        Some(self)
    }
    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }
}

impl Derivatives for Zncc {
    fn weighted(&mut self) -> bool {
        self.weights.used()
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        kernels::combine(self.factor(side) as f32, &self.residual, 0.0, &self.residual, out);
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.weights.gram(j, -self.inverse_deviation(side).powi(2), h);
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.weights.gram(j, -self.inverse_deviation(side).powi(2), h);
    }
    fn linearise(
        &mut self,
        side: Side,
        _curvature: Curvature,
        j: &Jacobian,
        _scratch: &mut [f32],
        out: &mut Normal,
    ) {
        self.weights.least_squares(
            j,
            &self.residual,
            self.factor(side),
            -self.inverse_deviation(side).powi(2),
            out,
        );
    }
}

impl Distances for Zncc {
    fn metric(&self) -> Metric {
        Metric::SquaredL2
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        standardise(patch, out);
    }
}

impl Masking for Zncc {
    fn set_mask(&mut self, mask: &[f32]) {
        self.weights.set_mask(mask);
    }
}

impl Reference for Zncc {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let ((mt, st), (mi, si)) = (self.template_stats, self.current_stats);
        let e = |t: f64, i: f64| (i - mi) * si - (t - mt) * st;
        -self
            .weights
            .reference(template.iter().zip(current).map(|(&t, &i)| e(t, i)))
    }
}
