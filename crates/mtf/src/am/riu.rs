//! RIU, ratio image uniformity (Woods, Mazziotta & Cherry 1993).
//!
//! `r = (κ + I)/(κ + T)`, `m` its mean, `q = r - m`; `f = -(Σ q²/n)/m`: zero when the ratio is the same everywhere, so
//! a global gain has (for intensities well above `κ`) no effect. Not symmetric.
//!
//! `df/dr = ρ = -(f + 2 q)/(n m)`; `R = d²f/dr² = -(2/(n m)) P + (2/(n² m²)) (q1ᵀ + 1qᵀ) + (2 f/(n² m²)) 11ᵀ`,
//! `P = Id - 11ᵀ/n`. With `s = dr/dI = 1/(κ + T)` on the current side and `s = dr/dT = -r/(κ + T)` on the template's:
//! gradient `ρ s`, Hessian `diag(s) R diag(s)`, plus `diag(2 ρ r/(κ + T)²)` on the template side; self Hessian of a
//! patch `X` `-(2/n) diag(w) P diag(w)`, `w = 1/(κ + X)`.
//!
//! Dark pixels weigh most, so a small `κ` makes them, and their noise, decide; hence its default (the original's is 1).

use super::{
    AppearanceModel, Curvature, Derivatives, Distances, Metric, Normal, PatchShape, Properties, Reference,
    Side,
};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Riu`].
    pub struct RiuParams {
        /// Offset of both terms of the ratio, gray levels.
        kappa: f64 = 61.0, in 0.01..=1e4, paper 1.0 => "dark pixels and their noise decide otherwise: ESM on 12 real sequences AUC .977 against .792 (embedded data .842 against .843)";
        /// Likelihood exp(alpha f): alpha.
        likelihood_alpha: f64 = 100.0, in 0.0..=1e6;
    }
}

/// Ratio image uniformity.
#[derive(Clone, Debug, Default)]
pub struct Riu {
    params: RiuParams,
    template: Vec<f32>,
    current: Vec<f32>,
    /// `1/(κ + T)`.
    inverse: Vec<f32>,
    /// `r - 1 = (I - T)/(κ + T)`.
    ratio: Vec<f32>,
    /// `q`.
    deviation: Vec<f32>,
    mean: f64,
    f: f64,
    scratch: Scratch,
}

#[derive(Clone, Debug, Default)]
struct Scratch {
    /// `s` of the template, `q s` or `ρ s`, `1/(κ + X)`, diagonal of the Hessian's Gram part.
    slope: Vec<f32>,
    product: Vec<f32>,
    own: Vec<f32>,
    weights: Vec<f32>,
    /// Products of the Jacobian with two of these, S each.
    sums: Vec<f64>,
}

/// Most parameters a Jacobian may have without allocation in the hot path.
const MAX_DOF: usize = 16;

impl Riu {
    fn n(&self) -> f64 {
        self.template.len() as f64
    }

    /// `s` of a side; `space` holds the template's.
    fn slope<'a>(&'a self, side: Side, space: &'a mut [f32]) -> &'a [f32] {
        match side {
            Side::Current => &self.inverse,
            Side::Template => {
                kernels::affine_product(-1.0, -1.0, &self.ratio, &self.inverse, space);
                space
            }
        }
    }

    /// `ρ s` of a side, `ρ_i = a + b q_i`.
    fn slope_of_f(&self, slope: &[f32], out: &mut [f32]) {
        let k = -1.0 / (self.n() * self.mean);
        kernels::affine_product((k * self.f) as f32, (2.0 * k) as f32, &self.deviation, slope, out);
    }

    /// Hessian of a side and, where asked for, the gradient.
    fn accumulate(
        &mut self,
        side: Side,
        curvature: Curvature,
        j: &Jacobian,
        h: &mut SymMatrix,
        gradient: Option<&mut [f64]>,
    ) {
        let mut scratch = std::mem::take(&mut self.scratch);
        let t = &mut scratch;
        let cols = j.cols();
        if t.sums.len() < 2 * cols {
            t.sums.resize(2 * cols, 0.0);
        }
        let slope = self.slope(side, &mut t.slope);
        let (n, m, f) = (self.n(), self.mean, self.f);
        match curvature {
            Curvature::SelfHessian => {
                let own = match side {
                    Side::Template => &self.template,
                    Side::Current => &self.current,
                };
                kernels::reciprocal(self.params.kappa as f32, own, &mut t.own);
                kernels::affine_product(0.0, 1.0, &t.own, &t.own, &mut t.weights);
                self.slope_of_f(slope, &mut t.product);
                let rhs = [&t.own[..], &t.product];
                let rhs = &rhs[..1 + usize::from(gradient.is_some())];
                kernels::weighted_normal_equations(j, &t.weights, rhs, h, &mut t.sums[..rhs.len() * cols]);
                let (w, g) = t.sums.split_at(cols);
                h.fill_from(|p, q, jj| -2.0 / n * (jj - w[p] * w[q] / n));
                if let Some(gradient) = gradient {
                    gradient.copy_from_slice(&g[..cols]);
                }
            }
            Curvature::Standard => {
                // Weights of the Gram part over -2/(n m): s², and on the template side -n m ρ r/(κ + T)².
                match side {
                    Side::Current => {
                        kernels::affine_product(0.0, 1.0, slope, slope, &mut t.weights);
                    }
                    Side::Template => {
                        // s² - n m ρ r/(κ + T)² = -s/(κ + T) (r + f + 2 q) = -s/(κ + T) (m + f + 3 q).
                        kernels::affine_product(0.0, -1.0, &self.inverse, slope, &mut t.own);
                        kernels::affine_product((m + f) as f32, 3.0, &self.deviation, &t.own, &mut t.weights);
                    }
                }
                kernels::affine_product(0.0, 1.0, &self.deviation, slope, &mut t.product);
                let rhs = [slope, &t.product];
                kernels::weighted_normal_equations(j, &t.weights, &rhs, h, &mut t.sums[..2 * cols]);
                let (s, qs) = t.sums.split_at(cols);
                let k = 2.0 / (n * m);
                h.fill_from(|a, b, jj| {
                    let outer = s[a] * s[b];
                    -k * (jj - outer / n) + k / (n * m) * (qs[a] * s[b] + s[a] * qs[b] + f * outer)
                });
                if let Some(gradient) = gradient {
                    for (g, (s, qs)) in gradient.iter_mut().zip(s.iter().zip(qs)) {
                        *g = -k * (0.5 * f * s + qs);
                    }
                }
            }
        }
        self.scratch = scratch;
    }
}

/// `Σ q²/(n m)` of a ratio `1 + x_i` given `x`, with `q` left in `deviation`; also returns `m`.
fn uniformity(sum: f64, ratio: &[f32], deviation: &mut [f32]) -> (f64, f64) {
    let n = ratio.len() as f64;
    let shift = sum / n;
    let mean = 1.0 + shift;
    let squares = kernels::rescale(ratio, shift as f32, 1.0, deviation);
    (squares / (n * mean), mean)
}

impl Part for Riu {
    type Params = RiuParams;
    const NAME: &'static str = "riu";
    const SUMMARY: &'static str = "ratio image uniformity";
    fn new(params: RiuParams) -> Self {
        Riu {
            params,
            ..Riu::default()
        }
    }
}

impl AppearanceModel for Riu {
    fn properties(&self) -> Properties {
        Properties {
            symmetric: false,
            gain_bias_invariant: true,
            ..Properties::default()
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template.clear();
        self.template.extend_from_slice(patch);
        self.current.clone_from(&self.template);
        let t = &mut self.scratch;
        let buffers = [&mut self.inverse, &mut self.ratio, &mut self.deviation];
        for buffer in buffers
            .into_iter()
            .chain([&mut t.slope, &mut t.product, &mut t.own, &mut t.weights])
        {
            buffer.clear();
            buffer.resize(shape.len(), 0.0);
        }
        t.sums.resize(2 * MAX_DOF, 0.0);
        kernels::reciprocal(self.params.kappa as f32, patch, &mut self.inverse);
        self.mean = 1.0;
        self.f = 0.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.current.copy_from_slice(patch);
        let sum = kernels::weighted_difference(patch, &self.template, &self.inverse, &mut self.ratio);
        let (loss, mean) = uniformity(sum, &self.ratio, &mut self.deviation);
        self.mean = mean;
        self.f = -loss;
    }
    fn similarity(&self) -> f64 {
        self.f
    }
    fn likelihood(&self) -> f64 {
        libm::exp(self.params.likelihood_alpha * self.f)
    }
    fn memory(&self) -> usize {
        9 * 4 * self.template.capacity()
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

impl Derivatives for Riu {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let mut space = std::mem::take(&mut self.scratch.slope);
        self.slope_of_f(self.slope(side, &mut space), out);
        self.scratch.slope = space;
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.accumulate(side, Curvature::Standard, j, h, None);
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.accumulate(side, Curvature::SelfHessian, j, h, None);
    }
    fn linearise(
        &mut self,
        side: Side,
        curvature: Curvature,
        j: &Jacobian,
        _scratch: &mut [f32],
        out: &mut Normal,
    ) {
        self.accumulate(side, curvature, j, &mut out.hessian, Some(&mut out.gradient));
    }
}

impl Distances for Riu {
    fn metric(&self) -> Metric {
        Metric::Other
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        out.copy_from_slice(patch);
    }
    /// `-f` with the stored patch as template.
    fn distance(&self, query: &[f32], stored: &[f32], _bound: f32) -> f32 {
        kernels::ratio_variation(query, stored, self.params.kappa as f32) as f32
    }
}

impl Reference for Riu {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let (n, k) = (template.len() as f64, self.params.kappa);
        let ratio: Vec<f64> = template
            .iter()
            .zip(current)
            .map(|(t, i)| (k + i) / (k + t))
            .collect();
        let m = ratio.iter().sum::<f64>() / n;
        -ratio.iter().map(|r| (r - m).powi(2)).sum::<f64>() / n / m
    }
}
