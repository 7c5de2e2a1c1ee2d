//! SSD, sum of squared differences (Hager & Belhumeur 1998; Baker & Matthews 2004), and what makes it NSSD as well.
//!
//! `f = -½ k² Σ e_i²`, `e = I - T`; `df/dI = -k² e`, `df/dT = k² e`, every Hessian `-k² Id`, so `-k² J'J` in parameters.
//! `k` scales intensities: 1 for SSD. With a robust loss or a mask values have weights `w`: `-w e`, `w e`, `-J' diag(w) J`
//! times `k²`, see [`super::Robust`].

use super::weights::{NOISE, Robust, Weights};
use super::{
    AppearanceModel, Curvature, Derivatives, Distances, Masking, Metric, Normal, PatchShape, Properties,
    Reference, Side,
};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::params::Params;
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Ssd`].
    pub struct SsdParams {
        /// Loss of single differences: none (squares), huber or tukey (M-estimators, scaled by the median difference).
        robust: Robust = Robust::None;
        /// Likelihood exp(-alpha sqrt(-f/n)) of n values: alpha, per gray level.
        likelihood_alpha: f64 = 2.0, in 0.0..=1e6;
    }
}

/// Values of the parameters of a model of squared differences.
#[derive(Clone, Copy, Debug)]
pub struct SquaresSettings {
    /// Loss of single differences.
    pub robust: Robust,
    /// `k`: factor of intensities.
    pub scale: f64,
    /// Likelihood `exp(-alpha sqrt(-f/n))` of n values: alpha.
    pub likelihood_alpha: f64,
}

/// What makes a model of squared differences.
pub trait SquaresKind: Clone + Send + 'static {
    /// Its parameters.
    type Params: Params;
    /// Name.
    const NAME: &'static str;
    /// One line.
    const SUMMARY: &'static str;
    /// Values of the parameters.
    fn settings(params: &Self::Params) -> SquaresSettings;
}

/// What makes [`Squares`] SSD: intensities as they are.
#[derive(Clone, Copy, Debug)]
pub struct Unscaled;

impl SquaresKind for Unscaled {
    type Params = SsdParams;
    const NAME: &'static str = "ssd";
    const SUMMARY: &'static str = "sum of squared differences";
    fn settings(p: &SsdParams) -> SquaresSettings {
        SquaresSettings {
            robust: p.robust,
            scale: 1.0,
            likelihood_alpha: p.likelihood_alpha,
        }
    }
}

/// Sum of squared differences.
pub type Ssd = Squares<Unscaled>;

/// Sum of squared differences of scaled patches.
#[derive(Clone, Debug)]
pub struct Squares<K> {
    /// `k`, `k²`.
    scale: f64,
    scale2: f64,
    likelihood_alpha: f64,
    template: Vec<f32>,
    /// `e = I - T`; with weights `w e`.
    residual: Vec<f32>,
    /// `-2 f/k²`.
    ssd: f64,
    weights: Weights,
    kind: std::marker::PhantomData<K>,
}

impl<K: SquaresKind> Default for Squares<K> {
    fn default() -> Self {
        Self::new(K::Params::default())
    }
}

impl<K: SquaresKind> Squares<K> {
    /// Factor of the residual in the gradient of a side.
    fn factor(&self, side: Side) -> f64 {
        match side {
            Side::Template => self.scale2,
            Side::Current => -self.scale2,
        }
    }
}

impl<K: SquaresKind> Part for Squares<K> {
    type Params = K::Params;
    const NAME: &'static str = K::NAME;
    const SUMMARY: &'static str = K::SUMMARY;
    fn new(params: K::Params) -> Self {
        let SquaresSettings {
            robust,
            scale,
            likelihood_alpha,
        } = K::settings(&params);
        Squares {
            scale,
            scale2: scale.powi(2),
            likelihood_alpha,
            template: Vec::new(),
            residual: Vec::new(),
            ssd: 0.0,
            weights: Weights::new(robust),
            kind: std::marker::PhantomData,
        }
    }
}

impl<K: SquaresKind> AppearanceModel for Squares<K> {
    fn properties(&self) -> Properties {
        Properties::default()
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
        self.ssd = self.weights.weigh(&mut self.residual, squares, NOISE);
    }
    fn similarity(&self) -> f64 {
        -0.5 * self.scale2 * self.ssd
    }
    fn likelihood(&self) -> f64 {
        let rms = (0.5 * self.scale2 * self.ssd / self.template.len() as f64).sqrt();
        libm::exp(-self.likelihood_alpha * rms)
    }
    fn memory(&self) -> usize {
        8 * self.template.capacity() + self.weights.memory()
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

impl<K: SquaresKind> Derivatives for Squares<K> {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        kernels::combine(self.factor(side) as f32, &self.residual, 0.0, &self.residual, out);
    }
    fn hessian_into(&mut self, _side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.weights.gram(j, -self.scale2, h);
    }
    fn self_hessian_into(&mut self, _side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.weights.gram(j, -self.scale2, h);
    }
    fn linearise(
        &mut self,
        side: Side,
        _curvature: Curvature,
        j: &Jacobian,
        _scratch: &mut [f32],
        out: &mut Normal,
    ) {
        let (factor, curvature) = (self.factor(side), -self.scale2);
        self.weights
            .least_squares(j, &self.residual, factor, curvature, out);
    }
    fn weighted(&mut self) -> bool {
        self.weights.used()
    }
}

impl<K: SquaresKind> Distances for Squares<K> {
    fn metric(&self) -> Metric {
        Metric::SquaredL2
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        if self.scale == 1.0 {
            out.copy_from_slice(patch);
        } else {
            kernels::combine(self.scale as f32, patch, 0.0, patch, out);
        }
    }
}

impl<K: SquaresKind> Masking for Squares<K> {
    fn set_mask(&mut self, mask: &[f32]) {
        self.weights.set_mask(mask);
    }
}

impl<K: SquaresKind> Reference for Squares<K> {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let differences = template.iter().zip(current).map(|(t, i)| i - t);
        -self.scale2 * self.weights.reference(differences)
    }
}
