//! ZNCC, zero-mean normalised cross-correlation: SSD of standardised patches.
//!
//! `Î = (I - µ)/σ`, `σ² = Σ (I - µ)²/n`, the same for `T`; `f = -½ |Î - T̂|² = -n (1 - ncc)`. Each patch's `µ` and `σ`
//! are held fixed while differentiating (Gauss-Newton on the standardised residual): `df/dI = -(Î - T̂)/σ_I`,
//! `df/dT = (Î - T̂)/σ_T`, Hessian of a side `-Id/σ²`. The exact derivatives of the same measure are [`super::Ncc`]'s.

use super::ssd::{least_squares, scaled_gram};
use super::{AmModel, AppearanceModel, Capabilities, Curvature, Metric, Normal, PatchShape, Side};
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Zncc`].
    pub struct ZnccParams {
        /// Likelihood exp(-2 alpha (1 - ncc)): alpha.
        likelihood_alpha: f64 = 50.0, in 0.0..=1e6;
    }
}

/// Patches whose standard deviation is below this are flat: they standardise to zero.
const FLAT: f64 = 1e-6;

/// Writes `(x - mean) / deviation` to `out`, zero for a flat patch; returns mean and `1 / deviation` (0 when flat).
pub(super) fn standardise(x: &[f32], out: &mut [f32]) -> (f64, f64) {
    let n = x.len() as f64;
    let mean = kernels::sum(x) / n;
    let deviation = (kernels::rescale(x, mean as f32, 1.0, out) / n).sqrt();
    let inverse = if deviation >= FLAT { 1.0 / deviation } else { 0.0 };
    kernels::rescale(x, mean as f32, inverse as f32, out);
    (mean, inverse)
}

/// Zero-mean normalised cross-correlation.
#[derive(Clone, Debug, Default)]
pub struct Zncc {
    params: ZnccParams,
    /// `T̂`.
    template: Vec<f32>,
    /// `µ` and `1/σ` of the template and of the current patch.
    template_stats: (f64, f64),
    current_stats: (f64, f64),
    /// `Î - T̂`.
    residual: Vec<f32>,
    ssd: f64,
}

impl Zncc {
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

impl AmModel for Zncc {
    type Params = ZnccParams;
    const NAME: &'static str = "zncc";
    const SUMMARY: &'static str = "zero-mean normalised cross-correlation: SSD of standardised patches";
    fn new(params: ZnccParams) -> Self {
        Zncc {
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
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template.clear();
        self.template.resize(shape.len(), 0.0);
        self.residual.clear();
        self.residual.resize(shape.len(), 0.0);
        self.template_stats = standardise(patch, &mut self.template);
        if self.template_stats.1 == 0.0 {
            return Err(TrackError::Template("flat patch"));
        }
        self.current_stats = self.template_stats;
        self.ssd = 0.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.current_stats = standardise(patch, &mut self.residual);
        self.ssd = kernels::subtract_from(&mut self.residual, &self.template);
    }
    fn similarity(&self) -> f64 {
        -0.5 * self.ssd
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        kernels::combine(self.factor(side) as f32, &self.residual, 0.0, &self.residual, out);
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        scaled_gram(j, -self.inverse_deviation(side).powi(2), h);
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        scaled_gram(j, -self.inverse_deviation(side).powi(2), h);
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
        -0.5 * template
            .iter()
            .zip(current)
            .map(|(&t, &i)| e(t, i).powi(2))
            .sum::<f64>()
    }
    fn memory(&self) -> usize {
        8 * self.template.capacity()
    }
}
