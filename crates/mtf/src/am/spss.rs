//! SPSS, sum of pixelwise structural similarity (Singh & Jagersand 2018): SSIM of single pixels, added up.
//!
//! `c = (255 k)²`, `D_i = T_i² + I_i² + c`, `f_i = (2 T_i I_i + c)/D_i`, `f = Σ f_i` with maximum `n`;
//! `df/dI_i = g_i = 2 (T_i - f_i I_i)/D_i`, the Hessians are diagonal: `-2 (f_i + 2 I_i g_i)/D_i`, self
//! `-2/(2 I_i² + c)`. Symmetric. The weight of a pixel falls with the square of its intensity down to about `sqrt(c)`, so
//! a small `k` (the original's is 0.01) lets the noise of dark pixels decide; hence its default.
//! Losses `1 - f_i = (T_i - I_i)²/D_i` are kept instead of `f_i`: they lose no digits near alignment.

use super::{
    AppearanceModel, Curvature, Derivatives, Distances, Metric, Normal, PatchShape, Properties, Reference,
    Side,
};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Spss`].
    pub struct SpssParams {
        /// Stabilising constant as a share of 255 gray levels: c = (255 k)².
        k: f64 = 0.2, in 1e-6..=10.0, paper 0.01 => "dark pixels count less: ESM on 12 real sequences AUC .980 against .975 (embedded data .844 against .847)";
        /// Likelihood exp(-alpha (1 - f/n)): alpha.
        likelihood_alpha: f64 = 100.0, in 0.0..=1e6;
    }
}

/// Sum of pixelwise structural similarity.
#[derive(Clone, Debug, Default)]
pub struct Spss {
    params: SpssParams,
    template: Vec<f32>,
    current: Vec<f32>,
    /// `1 - f_i`.
    losses: Vec<f32>,
    /// Their sum.
    loss: f64,
    /// Diagonal of a Hessian.
    weights: Vec<f32>,
}

impl Spss {
    fn c(&self) -> f32 {
        (255.0 * self.params.k).powi(2) as f32
    }

    /// Patch of a side and the other one.
    fn patches(&self, side: Side) -> (&[f32], &[f32]) {
        match side {
            Side::Template => (&self.template, &self.current),
            Side::Current => (&self.current, &self.template),
        }
    }

    /// Diagonal of the Hessian of a side, into `self.weights`.
    fn weigh(&mut self, side: Side, curvature: Curvature) {
        let c = self.c();
        let mut weights = std::mem::take(&mut self.weights);
        let (own, other) = self.patches(side);
        match curvature {
            Curvature::SelfHessian => kernels::spss_self(own, c, &mut weights),
            Curvature::Standard => kernels::spss_curvature(own, other, &self.losses, c, &mut weights),
        }
        self.weights = weights;
    }
}

impl Part for Spss {
    type Params = SpssParams;
    const NAME: &'static str = "spss";
    const SUMMARY: &'static str = "sum of pixelwise structural similarity";
    fn new(params: SpssParams) -> Self {
        Spss {
            params,
            ..Spss::default()
        }
    }
}

impl AppearanceModel for Spss {
    fn properties(&self) -> Properties {
        Properties::default()
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template.clear();
        self.template.extend_from_slice(patch);
        self.current.clone_from(&self.template);
        for buffer in [&mut self.losses, &mut self.weights] {
            buffer.clear();
            buffer.resize(shape.len(), 0.0);
        }
        self.loss = 0.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.current.copy_from_slice(patch);
        let c = self.c();
        self.loss = kernels::spss_losses(&self.template, &self.current, c, &mut self.losses);
    }
    fn similarity(&self) -> f64 {
        self.template.len() as f64 - self.loss
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-self.params.likelihood_alpha * self.loss / self.template.len() as f64)
    }
    fn memory(&self) -> usize {
        16 * self.template.capacity()
    }
    fn derivatives(&mut self) -> Option<&mut dyn Derivatives> {
        Some(self)
    }
    fn distances(&self) -> Option<&dyn Distances> {
        Some(self)
    }
    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }
}

impl Derivatives for Spss {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let (own, other) = self.patches(side);
        kernels::spss_gradient(own, other, &self.losses, self.c(), out);
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.weigh(side, Curvature::Standard);
        kernels::weighted_normal_equations(j, &self.weights, &[], h, &mut []);
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.weigh(side, Curvature::SelfHessian);
        kernels::weighted_normal_equations(j, &self.weights, &[], h, &mut []);
    }
    fn linearise(
        &mut self,
        side: Side,
        curvature: Curvature,
        j: &Jacobian,
        scratch: &mut [f32],
        out: &mut Normal,
    ) {
        self.gradient_into(side, scratch);
        self.weigh(side, curvature);
        kernels::weighted_normal_equations(j, &self.weights, &[scratch], &mut out.hessian, &mut out.gradient);
    }
}

impl Distances for Spss {
    fn metric(&self) -> Metric {
        Metric::Other
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        out.copy_from_slice(patch);
    }
    /// `n - f`.
    fn distance(&self, query: &[f32], stored: &[f32], bound: f32) -> f32 {
        kernels::spss_distance(query, stored, self.c(), bound)
    }
}

impl Reference for Spss {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let c = (255.0 * self.params.k).powi(2);
        template
            .iter()
            .zip(current)
            .map(|(t, i)| (2.0 * t * i + c) / (t * t + i * i + c))
            .sum()
    }
}
