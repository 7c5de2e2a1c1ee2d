//! DFM, SSD of feature maps (deep feature maps in Singh & Jagersand 2018; feature-based SSD: Antonakos, Alabort-i-Medina,
//! Tzimiropoulos & Zafeiriou 2015).
//!
//! A [`PatchFeatures`] turns a patch into maps `F_k`; each is standardised, `F̂_k = (F_k - µ_k)/σ_k`, unless told not
//! to; `f = -½ Σ_k |F̂_k(I) - F̂_k(T)|²`. As in ZNCC, `µ_k` and `σ_k` of each patch are held fixed while differentiating:
//! with `e_k` the residual of a map and `B_k = dF_k/dI`, `df/dI = -Σ_k B_kᵀ e_k/σ_k`, `df/dT = Σ_k B_kᵀ e_k/σ_k`
//! (with the derivatives and deviations of that side's patch), Hessians `-Σ_k (B_k J)ᵀ(B_k J)/σ_k²`: first order in the
//! features, exact for linear ones.
//!
//! The features are those of a network read from a file ([`Network`]) or, without one, of [`OrientedBank`],
//! derivative-of-Gaussian filters. Where only differences tell the derivative of the features, gradients come from the
//! features' changes along the columns of the Jacobian, `f_p = ∓Σ_k (B_k J)ᵀ e_k/σ_k`: two evaluations a parameter
//! instead of two a pixel. Those of the template are kept.

use super::bank::OrientedBank;
use super::network::Network;
use super::patch_features::PatchFeatures;
use super::{
    AppearanceModel, Curvature, Derivatives, Distances, Metric, Normal, PatchShape, Properties, Reference,
    Side,
};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Dfm`].
    pub struct DfmParams {
        /// File of a network in ONNX format that computes the feature maps; none: a bank of derivative filters.
        model: Network = Network::default();
        /// Feature maps: the first so many of the network, or of the ten filters for each channel (first derivatives before second ones).
        n_maps: usize = 4, in 1..=4096;
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
#[derive(Clone)]
pub struct Dfm {
    params: DfmParams,
    features: Box<dyn PatchFeatures>,
    template: Maps,
    current: Maps,
    /// `F̂(I) - F̂(T)`.
    residual: Vec<f32>,
    ssd: f64,
    /// Scaled residual, and weights of the features.
    scaled: Vec<f32>,
    weights: Vec<f32>,
    /// Derivatives of the features along the columns of a Jacobian, for each side.
    pushed: [Jacobian; 2],
    /// The Jacobian that those of the template belong to; no columns when they are out of date.
    of_template: Jacobian,
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
            pushed: Default::default(),
            of_template: Jacobian::default(),
        }
    }

    /// Standardises the maps in `values`.
    fn standardise(&self, values: &mut [f32], mut stats: impl FnMut(usize, (f64, f64))) {
        let n = self.features.map_len();
        for (k, map) in values.chunks_exact_mut(n).enumerate() {
            if !self.params.zncc {
                stats(k, (0.0, 1.0));
                continue;
            }
            let mean = kernels::sum(map) / n as f64;
            kernels::scale_shift(1.0, -mean as f32, map);
            let deviation = (kernels::dot(map, map) / n as f64).sqrt();
            let inverse = if deviation >= FLAT { 1.0 / deviation } else { 0.0 };
            kernels::scale_shift(inverse as f32, 0.0, map);
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

    /// Features' derivatives along the columns of `j`, into `self.pushed`.
    fn push(&mut self, side: Side, j: &Jacobian) {
        if side == Side::Template {
            if self.of_template == *j {
                return;
            }
            self.of_template.copy_from(j);
        }
        let mut pushed = std::mem::take(&mut self.pushed[side as usize]);
        pushed.resize(self.residual.len(), j.cols());
        let patch = &self.side(side).patch;
        for k in 0..j.cols() {
            self.features.derivative(patch, j.col(k), pushed.col_mut(k));
        }
        self.pushed[side as usize] = pushed;
    }

    /// `-1/σ²` of each feature of a side into `self.weights`.
    fn weigh(&mut self, side: Side) {
        let mut weights = std::mem::take(&mut self.weights);
        let n = self.features.map_len();
        for (w, (_, inverse)) in weights.chunks_exact_mut(n).zip(&self.side(side).stats) {
            w.fill(-(inverse * inverse) as f32);
        }
        self.weights = weights;
    }
}

impl Part for Dfm {
    type Params = DfmParams;
    const NAME: &'static str = "dfm";
    const SUMMARY: &'static str = "SSD of standardised feature maps, of derivative filters or a network";
    fn new(params: DfmParams) -> Self {
        let network = params.model.features(params.n_maps);
        let features = network.unwrap_or_else(|| Box::new(OrientedBank::new(params.n_maps)));
        Dfm::with_features(params, features)
    }
}

impl AppearanceModel for Dfm {
    fn properties(&self) -> Properties {
        Properties::default()
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
        self.pushed.iter_mut().for_each(|j| j.resize(maps * n, MAX_DOF));
        self.of_template.resize(shape.len(), MAX_DOF);
        self.of_template.resize(0, 0);
        let mut template = std::mem::take(&mut self.template);
        self.evaluate(patch, &mut template);
        self.template = template;
        if self.template.values.iter().any(|v| !v.is_finite()) {
            return Err(TrackError::NotFinite("features of the template"));
        }
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
    fn likelihood(&self) -> f64 {
        libm::exp(-self.params.likelihood_alpha * self.ssd / self.residual.len() as f64)
    }
    fn memory(&self) -> usize {
        let n = self.residual.capacity();
        let jacobians = self.pushed.iter().chain([&self.of_template]);
        4 * (5 * n + 2 * self.template.patch.capacity())
            + jacobians.map(Jacobian::memory).sum::<usize>()
            + self.features.memory()
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

impl Derivatives for Dfm {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        self.scale_residual(side);
        self.features
            .transposed(&self.side(side).patch, &self.scaled, out);
    }
    fn project_gradient(&mut self, side: Side, j: &Jacobian, scratch: &mut [f32], out: &mut [f64]) {
        if self.features.has_transpose() {
            self.gradient_into(side, scratch);
            kernels::project(j, scratch, out);
        } else {
            self.push(side, j);
            self.scale_residual(side);
            kernels::project(&self.pushed[side as usize], &self.scaled, out);
        }
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.push(side, j);
        self.weigh(side);
        let pushed = &self.pushed[side as usize];
        kernels::weighted_normal_equations(pushed, &self.weights, &[], h, &mut []);
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
        self.weigh(side);
        self.scale_residual(side);
        kernels::weighted_normal_equations(
            &self.pushed[side as usize],
            &self.weights,
            &[&self.scaled],
            &mut out.hessian,
            &mut out.gradient,
        );
    }
}

impl Distances for Dfm {
    fn metric(&self) -> Metric {
        Metric::SquaredL2
    }
    fn feature_len(&self) -> usize {
        self.residual.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        self.features.evaluate(patch, out);
        self.standardise(out, |_, _| ());
    }
}

impl Reference for Dfm {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
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
}
