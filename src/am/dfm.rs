//! DFM, SSD of feature maps (deep feature maps in Singh & Jagersand 2018; feature-based SSD: Antonakos, Alabort-i-Medina,
//! Tzimiropoulos & Zafeiriou 2015).
//!
//! A [`PatchFeatures`] turns a patch into maps `F_k`; each is standardised, `F̂_k = (F_k - µ_k)/σ_k`, unless told not
//! to; `f = -½ Σ_k |F̂_k(I) - F̂_k(T)|²`. As in ZNCC, `µ_k` and `σ_k` of each patch are held fixed while differentiating:
//! with `e_k` the residual of a map and `B_k = dF_k/dI`, `df/dI = -Σ_k B_kᵀ e_k/σ_k`, `df/dT = Σ_k B_kᵀ e_k/σ_k`
//! (with the derivatives and deviations of that side's patch), Hessians `-Σ_k (B_k J)ᵀ(B_k J)/σ_k²`: first order in the
//! features, exact for linear ones.
//!
//! The features used are [`OrientedBank`], derivative-of-Gaussian filters.

use super::bank::OrientedBank;
use super::{AmModel, AppearanceModel, Capabilities, Curvature, Metric, Normal, PatchShape, Side};
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

/// Features of a patch: a number of maps of equal length, differentiable with respect to the patch's values.
pub trait PatchFeatures: Send {
    /// Prepares for patches of a shape. Fails when they are too small.
    fn prepare(&mut self, shape: PatchShape) -> Result<(), TrackError>;
    /// Number of maps.
    fn maps(&self) -> usize;
    /// Values per map.
    fn map_len(&self) -> usize;
    /// All maps of a patch, one after the other.
    fn evaluate(&self, patch: &[f32], out: &mut [f32]);
    /// Change of all maps along a direction: `B d` at `patch`.
    fn derivative(&self, patch: &[f32], direction: &[f32], out: &mut [f32]);
    /// `Bᵀ w` at `patch`, for one number per feature.
    fn transposed(&self, patch: &[f32], weights: &[f32], out: &mut [f32]);
    /// Slow `f64` definition of [`evaluate`](Self::evaluate).
    fn reference(&self, patch: &[f64]) -> Vec<f64>;
    /// Bytes kept.
    fn memory(&self) -> usize;
}

crate::params! {
    /// Parameters of [`Dfm`].
    pub struct DfmParams {
        /// Feature maps: of each channel the first so many of the filter bank (first derivatives before second ones).
        n_maps: usize = 4, in 1..=10;
        /// Each map is standardised.
        zncc: bool = true;
        /// Likelihood exp(-alpha * mean squared difference of features): alpha.
        likelihood_alpha: f64 = 5.0, in 0.0..=1e6;
    }
}

/// Maps whose standard deviation is below this are flat: they standardise to zero.
const FLAT: f64 = 1e-4;

/// Features of one patch.
#[derive(Clone, Debug, Default)]
struct Maps {
    patch: Vec<f32>,
    /// `F̂`.
    values: Vec<f32>,
    /// `(µ, 1/σ)` of each map.
    stats: Vec<(f64, f64)>,
}

/// SSD of feature maps.
pub struct Dfm {
    params: DfmParams,
    features: Box<dyn PatchFeatures>,
    template: Maps,
    current: Maps,
    /// `F̂(I) - F̂(T)`.
    residual: Vec<f32>,
    ssd: f64,
    /// Scaled residual, weights of the features, and their derivatives along the columns of a Jacobian.
    scaled: Vec<f32>,
    weights: Vec<f32>,
    jacobian: Jacobian,
}

/// Most parameters a Jacobian may have without allocation in the hot path.
const MAX_DOF: usize = 16;

impl Dfm {
    /// With features of the caller's.
    pub fn with_features(params: DfmParams, features: Box<dyn PatchFeatures>) -> Self {
        Dfm {
            params,
            features,
            template: Maps::default(),
            current: Maps::default(),
            residual: Vec::new(),
            ssd: 0.0,
            scaled: Vec::new(),
            weights: Vec::new(),
            jacobian: Jacobian::default(),
        }
    }

    /// Standardises the maps in `values`.
    fn standardise(&self, values: &mut [f32], mut stats: impl FnMut(usize, (f64, f64))) {
        let n = self.features.map_len();
        for (k, map) in values.chunks_exact_mut(n).enumerate() {
            let (mean, inverse) = if self.params.zncc {
                let mean = kernels::sum(map) / n as f64;
                let squares: f64 = map.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum();
                let deviation = (squares / n as f64).sqrt();
                (mean, if deviation >= FLAT { 1.0 / deviation } else { 0.0 })
            } else {
                (0.0, 1.0)
            };
            for v in map.iter_mut() {
                *v = ((f64::from(*v) - mean) * inverse) as f32;
            }
            stats(k, (mean, inverse));
        }
    }

    /// Features of a patch into `maps`.
    fn evaluate(&self, patch: &[f32], maps: &mut Maps) {
        maps.patch.copy_from_slice(patch);
        self.features.evaluate(patch, &mut maps.values);
        let stats = &mut maps.stats;
        self.standardise(&mut maps.values, |k, s| stats[k] = s);
    }

    fn side(&self, side: Side) -> &Maps {
        match side {
            Side::Template => &self.template,
            Side::Current => &self.current,
        }
    }

    fn sign(side: Side) -> f32 {
        match side {
            Side::Template => 1.0,
            Side::Current => -1.0,
        }
    }

    /// `±e/σ` of a side into `self.scaled`.
    fn scale_residual(&mut self, side: Side) {
        let mut scaled = std::mem::take(&mut self.scaled);
        let n = self.features.map_len();
        for (k, &(_, inverse)) in self.side(side).stats.iter().enumerate() {
            let at = k * n..(k + 1) * n;
            let (e, out) = (&self.residual[at.clone()], &mut scaled[at]);
            kernels::combine(Self::sign(side) * inverse as f32, e, 0.0, e, out);
        }
        self.scaled = scaled;
    }

    /// Features' derivatives along the columns of `j`, and their weights.
    fn push(&mut self, side: Side, j: &Jacobian) {
        let (mut jacobian, mut weights) = (
            std::mem::take(&mut self.jacobian),
            std::mem::take(&mut self.weights),
        );
        jacobian.resize(self.residual.len(), j.cols());
        let maps = self.side(side);
        for k in 0..j.cols() {
            self.features
                .derivative(&maps.patch, j.col(k), jacobian.col_mut(k));
        }
        let n = self.features.map_len();
        for (w, (_, inverse)) in weights.chunks_exact_mut(n).zip(&maps.stats) {
            w.fill(-(inverse * inverse) as f32);
        }
        (self.jacobian, self.weights) = (jacobian, weights);
    }
}

impl AmModel for Dfm {
    type Params = DfmParams;
    const NAME: &'static str = "dfm";
    const SUMMARY: &'static str = "SSD of standardised feature maps (oriented derivative filters)";
    fn new(params: DfmParams) -> Self {
        let bank = OrientedBank::new(params.n_maps);
        Dfm::with_features(params, Box::new(bank))
    }
}

impl AppearanceModel for Dfm {
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            derivatives: true,
            symmetric: true,
            metric: Metric::SquaredL2,
            gain_bias_invariant: false,
            masks: false,
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.features.prepare(shape)?;
        let (maps, n) = (self.features.maps(), self.features.map_len());
        for m in [&mut self.template, &mut self.current] {
            m.patch.resize(shape.len(), 0.0);
            m.values.resize(maps * n, 0.0);
            m.stats.resize(maps, (0.0, 0.0));
        }
        for buffer in [&mut self.residual, &mut self.scaled, &mut self.weights] {
            buffer.clear();
            buffer.resize(maps * n, 0.0);
        }
        self.jacobian.resize(maps * n, MAX_DOF);
        let mut template = std::mem::take(&mut self.template);
        self.evaluate(patch, &mut template);
        self.template = template;
        if self.template.stats.iter().all(|s| s.1 == 0.0) {
            return Err(TrackError::Template("flat patch"));
        }
        self.set_current(patch);
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        let mut current = std::mem::take(&mut self.current);
        self.evaluate(patch, &mut current);
        self.ssd = kernels::subtract(&current.values, &self.template.values, &mut self.residual);
        self.current = current;
    }
    fn similarity(&self) -> f64 {
        -0.5 * self.ssd
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        self.scale_residual(side);
        self.features
            .transposed(&self.side(side).patch, &self.scaled, out);
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.push(side, j);
        kernels::weighted_normal_equations(&self.jacobian, &self.weights, &[], h, &mut []);
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.hessian_into(side, j, h);
    }
    fn linearise(
        &mut self,
        side: Side,
        _curvature: Curvature,
        j: &Jacobian,
        _scratch: &mut [f32],
        out: &mut Normal,
    ) {
        self.push(side, j);
        self.scale_residual(side);
        kernels::weighted_normal_equations(
            &self.jacobian,
            &self.weights,
            &[&self.scaled],
            &mut out.hessian,
            &mut out.gradient,
        );
    }
    fn likelihood(&self) -> f64 {
        (-self.params.likelihood_alpha * self.ssd / self.residual.len() as f64).exp()
    }
    fn feature_len(&self) -> usize {
        self.residual.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        self.features.evaluate(patch, out);
        self.standardise(out, |_, _| ());
    }
    fn reference(&self, template: &[f64], current: &[f64]) -> f64 {
        let n = self.features.map_len();
        let (t, i) = (
            self.features.reference(template),
            self.features.reference(current),
        );
        let squares = (0..t.len()).map(|k| {
            let ((mt, st), (mi, si)) = (self.template.stats[k / n], self.current.stats[k / n]);
            ((i[k] - mi) * si - (t[k] - mt) * st).powi(2)
        });
        -0.5 * squares.sum::<f64>()
    }
    fn memory(&self) -> usize {
        let n = self.residual.capacity();
        4 * (5 * n + 2 * self.template.patch.capacity()) + self.jacobian.memory() + self.features.memory()
    }
}
