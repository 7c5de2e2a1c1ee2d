//! NCC, normalised cross-correlation with its exact derivatives (Scandaroli, Meilland & Richa 2012).
//!
//! `u = (T - T̄)/c`, `v = (I - Ī)/b` with `c = |T - T̄|`, `b = |I - Ī|`; `f = u·v` in [-1, 1].
//! `df/dI = (u - f v)/b`, `df/dT = (v - f u)/c`. With `P = Id - 11'/n`:
//! `d²f/dI² = (-f P - v u' - u v' + 3 f v v')/b²`, self Hessian `(-P + v v')/b²`; the template side swaps the roles.
//!
//! With a robust loss or a mask every sum over values is weighted: means, norms, `u·v` and the products with `J`, `n` being
//! the sum of the weights. These belong to the differences of standardised patches, as in [`super::Zncc`], and are held
//! fixed while differentiating.

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
    /// Parameters of [`Ncc`].
    pub struct NccParams {
        /// Loss of single differences: none (squares), huber or tukey (M-estimators, scaled by the median difference).
        robust: Robust = Robust::None;
        /// Likelihood exp(-2 alpha (1 - f)): alpha.
        likelihood_alpha: f64 = 50.0, in 0.0..=1e6;
    }
}

/// Normalised cross-correlation.
#[derive(Clone, Debug, Default)]
pub struct Ncc {
    params: NccParams,
    /// `sqrt(n) u`, `sqrt(n) v`: standardised patches, whose elements are of order one.
    template: Vec<f32>,
    current: Vec<f32>,
    correlator: Correlator,
    /// `1/σ` of the patches; `sqrt(n) σ` are the norms `c` and `b`.
    template_inverse: f64,
    current_inverse: f64,
    /// `Ī`, of the last patch with weights.
    current_mean: f64,
    ones: Vec<f32>,
    weights: Weights,
    /// With weights `w`: `w û`, `w v̂`; the latter's place holds differences while weights are estimated.
    weighted: [Vec<f32>; 2],
    /// `1/σ` of the template without weights, and `Σ w`.
    plain_inverse: f64,
    total: f64,
    f: f64,
    /// `J'û, J'v̂, J'1` of the last Jacobian, S each.
    sums: Vec<f64>,
}

/// Most parameters a Jacobian may have without allocation in the hot path.
const MAX_DOF: usize = 16;

impl Ncc {
    /// `Σ w`, `n` without weights.
    fn n(&self) -> f64 {
        self.total
    }
    /// `w û`, `w v̂`.
    fn patches(&self) -> [&[f32]; 2] {
        if self.weights.used() {
            [&self.weighted[0], &self.weighted[1]]
        } else {
            [&self.template, &self.current]
        }
    }
    /// `J'WJ`, and `J'Wû`, `J'Wv̂`, `J'W1` into `self.sums`.
    fn accumulate(&mut self, j: &Jacobian, h: &mut SymMatrix) {
        let s = j.cols();
        let mut sums = std::mem::take(&mut self.sums);
        if sums.len() < 3 * s {
            sums.resize(3 * s, 0.0);
        }
        let [u, v] = self.patches();
        let ones = self.weights.get().unwrap_or(&self.ones);
        self.weights
            .normal_equations(j, &[u, v, ones], h, &mut sums[..3 * s]);
        self.sums = sums;
    }
    fn set_weighted(&mut self, patch: &[f32]) {
        let n = self.template.len();
        let [template, current] = &mut self.weighted;
        template.resize(n, 0.0);
        current.resize(n, 0.0);
        let last = (self.current_mean, self.current_inverse);
        self.weights.judge(&self.template, patch, last, template, current);
        if self.params.robust != Robust::None {
            let k = self.weights.standardise(&self.template, template).1;
            self.weights.standardise(patch, &mut self.current);
            kernels::subtract(&self.current, template, current);
            self.weights.estimate(current, NOISE * k * self.plain_inverse);
        }
        let k = self.weights.standardise(&self.template, template).1;
        self.template_inverse = k * self.plain_inverse;
        (self.current_mean, self.current_inverse) = self.weights.standardise(patch, &mut self.current);
        let w = self.weights.get().unwrap_or(&self.ones);
        kernels::multiply(w, template);
        kernels::product(w, &self.current, 1.0, current);
        self.total = kernels::sum(w);
        self.f = kernels::dot(template, &self.current) / self.total;
    }
    /// Turns `J'J` in `h` and `self.sums` into a Hessian of one side.
    fn finish(&self, side: Side, curvature: Curvature, h: &mut SymMatrix) {
        let (n, s) = (self.n(), h.order());
        let (ju, rest) = self.sums.split_at(s);
        let (jv, j1) = rest.split_at(s);
        // `own` belongs to the side's patch, `other` to the one it is compared with.
        let (own, other, inverse) = match side {
            Side::Template => (ju, jv, self.template_inverse),
            Side::Current => (jv, ju, self.current_inverse),
        };
        let k = inverse * inverse / n;
        let f = self.f;
        h.fill_from(|a, b, jj| {
            let centred = jj - j1[a] * j1[b] / n;
            let (oo, xo) = (own[a] * own[b] / n, (own[a] * other[b] + other[a] * own[b]) / n);
            match curvature {
                Curvature::SelfHessian => k * (oo - centred),
                Curvature::Standard => k * (3.0 * f * oo - xo - f * centred),
            }
        });
    }
}

impl Part for Ncc {
    type Params = NccParams;
    const NAME: &'static str = "ncc";
    const SUMMARY: &'static str = "normalised cross-correlation, exact derivatives";
    fn new(params: NccParams) -> Self {
        Ncc {
            weights: Weights::new(params.robust),
            params,
            ..Ncc::default()
        }
    }
}

impl AppearanceModel for Ncc {
    fn properties(&self) -> Properties {
        Properties {
            gain_bias_invariant: true,
            ..Properties::default()
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template.clear();
        self.template.resize(shape.len(), 0.0);
        (self.current_mean, self.template_inverse) = standardise(patch, &mut self.template);
        if self.template_inverse == 0.0 {
            return Err(TrackError::Template("flat patch"));
        }
        self.correlator = Correlator::new(self.current_mean, &self.template);
        self.current.clone_from(&self.template);
        self.current_inverse = self.template_inverse;
        self.ones.clear();
        self.ones.resize(shape.len(), 1.0);
        self.sums.resize(3 * MAX_DOF, 0.0);
        self.plain_inverse = self.template_inverse;
        self.total = shape.len() as f64;
        self.weights.reset(shape.len());
        if self.weights.used() {
            self.weighted
                .iter_mut()
                .for_each(|w| w.clone_from(&self.template));
        }
        self.f = 1.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        if self.weights.used() {
            return self.set_weighted(patch);
        }
        self.template_inverse = self.plain_inverse;
        self.total = self.template.len() as f64;
        self.current_inverse = standardise(patch, &mut self.current).1;
        self.f = kernels::dot(&self.template, &self.current) / self.n();
    }
    fn score(&mut self, patch: &[f32]) -> f64 {
        if self.weights.used() {
            self.set_current(patch);
            return self.similarity();
        }
        match self.correlator.correlate(&self.template, patch) {
            Some((ncc, inverse)) => (self.f, self.current_inverse) = (ncc, inverse),
            None => self.set_current(patch),
        }
        self.f
    }
    fn similarity(&self) -> f64 {
        self.f
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-2.0 * self.params.likelihood_alpha * (1.0 - self.f).max(0.0))
    }
    fn memory(&self) -> usize {
        12 * self.template.capacity() + 8 * self.weighted[0].capacity() + self.weights.memory()
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

impl Derivatives for Ncc {
    fn weighted(&mut self) -> bool {
        self.weights.used()
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let [u, v] = self.patches();
        let (own, other, inverse) = match side {
            Side::Template => (u, v, self.template_inverse),
            Side::Current => (v, u, self.current_inverse),
        };
        let k = inverse / self.n();
        kernels::combine(k as f32, other, (-self.f * k) as f32, own, out);
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.accumulate(j, h);
        self.finish(side, Curvature::Standard, h);
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.accumulate(j, h);
        self.finish(side, Curvature::SelfHessian, h);
    }
    fn linearise(
        &mut self,
        side: Side,
        curvature: Curvature,
        j: &Jacobian,
        _scratch: &mut [f32],
        out: &mut Normal,
    ) {
        self.accumulate(j, &mut out.hessian);
        self.finish(side, curvature, &mut out.hessian);
        let s = j.cols();
        let (ju, jv) = (&self.sums[..s], &self.sums[s..2 * s]);
        let (own, other, inverse) = match side {
            Side::Template => (ju, jv, self.template_inverse),
            Side::Current => (jv, ju, self.current_inverse),
        };
        for (g, (own, other)) in out.gradient.iter_mut().zip(own.iter().zip(other)) {
            *g = (other - self.f * own) * inverse / self.n();
        }
    }
}

impl Distances for Ncc {
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

impl Masking for Ncc {
    fn set_mask(&mut self, mask: &[f32]) {
        self.weights.set_mask(mask);
    }
}

impl Reference for Ncc {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let w = |i: usize| self.weights.get().map_or(1.0, |w| f64::from(w[i]));
        let mean = |x: &[f64]| x.iter().enumerate().map(|(i, x)| w(i) * x).sum::<f64>() / self.n();
        let (mt, mi) = (mean(template), mean(current));
        let (mut tt, mut ii, mut ti) = (0.0, 0.0, 0.0);
        for (k, (t, i)) in template.iter().zip(current).enumerate() {
            let (t, i) = (t - mt, i - mi);
            (tt, ii, ti) = (tt + w(k) * t * t, ii + w(k) * i * i, ti + w(k) * t * i);
        }
        if tt * ii > 0.0 { ti / (tt * ii).sqrt() } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Resolution;

    /// `2 (1 - f)` is the mean squared difference of the standardised patches: the likelihood is that of Gaussian noise.
    #[test]
    fn the_likelihood_is_that_of_the_standardised_difference() {
        let shape = PatchShape {
            res: Resolution { cols: 9, rows: 7 },
            channels: 1,
        };
        let template: Vec<f32> = (0..63).map(|i| (i * 37 % 101) as f32 + 30.0).collect();
        let noisy = |i: usize, t: &f32| 0.7 * t + 12.0 + ((i * 53 % 17) as f32 - 8.0);
        let current: Vec<f32> = template.iter().enumerate().map(|(i, t)| noisy(i, t)).collect();
        let standard = |x: &[f32]| -> Vec<f64> {
            let n = x.len() as f64;
            let mean = x.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
            let variance = x.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n;
            x.iter()
                .map(|v| (f64::from(*v) - mean) / variance.sqrt())
                .collect()
        };
        let (u, v) = (standard(&template), standard(&current));
        let mean = u.iter().zip(&v).map(|(u, v)| (u - v).powi(2)).sum::<f64>() / 63.0;
        for likelihood_alpha in [50.0, 3.0] {
            let mut am = Ncc::new(NccParams {
                likelihood_alpha,
                ..NccParams::default()
            });
            am.set_template(shape, &template).unwrap();
            assert!((am.likelihood() - 1.0).abs() < 1e-4);
            am.set_current(&current);
            let exact = libm::exp(-likelihood_alpha * mean);
            assert!((0.001..0.9).contains(&exact), "{exact}");
            assert!(
                (am.likelihood() - exact).abs() < 1e-3 * exact,
                "{} {exact}",
                am.likelihood()
            );
        }
    }
}
