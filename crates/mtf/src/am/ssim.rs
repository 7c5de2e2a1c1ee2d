//! SSIM, structural similarity of whole patches (Wang, Bovik, Sheikh & Simoncelli 2004; as a tracking measure Loza et
//! al. 2009; derivatives after Avanaki 2009).
//!
//! Means `µ0`, `µ`; `u = T - µ0`, `v = I - µ`; variances and covariance `σ0²`, `σ²`, `σ_x` with divisor `n - 1`;
//! `c1 = (255 k1)²`, `c2 = (255 k2)²`; `A = 2 µ µ0 + c1`, `B = 2 σ_x + c2`, `C = µ² + µ0² + c1`, `D = σ² + σ0² + c2`;
//! `f = A B / (C D)` in [-1, 1].
//!
//! `df/dI = [ (2/n)(µ0 B - µ f D) 1 + (2/(n-1))(A u - f C v) ] / (C D)`. With `a' = (2 µ0/n) 1`, `b' = 2 u/(n-1)`,
//! `C' = (2 µ/n) 1`, `D' = 2 v/(n-1)`, `m' = D C' + C D'`, `g = df/dI` and `P = Id - 11ᵀ/n`:
//!
//! `d²f/dI² = [ a'b'ᵀ + b'a'ᵀ - g m'ᵀ - m' gᵀ - f ( (2 D/n²) 11ᵀ + C'D'ᵀ + D'C'ᵀ + (2 C/(n-1)) P ) ] / (C D)`;
//! self Hessian `-(2/((n-1) D)) P - (2/(n² C)) 11ᵀ` with `C = 2 µ² + c1`, `D = 2 σ² + c2` of one patch. The template
//! side swaps the roles. All of it needs only `J'J` and `J'1`, `J'u`, `J'v`.

use super::{
    AppearanceModel, Curvature, Derivatives, Distances, Metric, Normal, PatchShape, Properties, Reference,
    Side,
};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Ssim`].
    pub struct SsimParams {
        /// Luminance constant as a share of 255 gray levels: c1 = (255 k1)².
        k1: f64 = 0.01, in 1e-6..=10.0;
        /// Contrast constant as a share of 255 gray levels: c2 = (255 k2)².
        k2: f64 = 0.03, in 1e-6..=10.0;
        /// Likelihood exp(-2 alpha (1 - f)): alpha.
        likelihood_alpha: f64 = 50.0, in 0.0..=1e6;
    }
}

/// Mean and variance (divisor `n - 1`) of a patch.
#[derive(Clone, Copy, Debug, Default)]
struct Stats {
    mean: f64,
    variance: f64,
}

/// `f` and its four factors.
#[derive(Clone, Copy, Debug, Default)]
struct Factors {
    a: f64,
    b: f64,
    c: f64,
    d: f64,
    f: f64,
}

/// Structural similarity.
#[derive(Clone, Debug, Default)]
pub struct Ssim {
    params: SsimParams,
    /// `u`, `v`.
    template: Vec<f32>,
    current: Vec<f32>,
    template_stats: Stats,
    current_stats: Stats,
    factors: Factors,
    ones: Vec<f32>,
    /// `J'u`, `J'v`, `J'1` of the last Jacobian, S each.
    sums: Vec<f64>,
}

/// Most parameters a Jacobian may have without allocation in the hot path.
const MAX_DOF: usize = 16;

/// Writes `x - mean` to `out`.
fn centre(x: &[f32], out: &mut [f32]) -> Stats {
    let n = x.len() as f64;
    let mean = kernels::sum(x) / n;
    let squares = kernels::rescale(x, mean as f32, 1.0, out);
    Stats {
        mean,
        variance: squares / (n - 1.0).max(1.0),
    }
}

impl Ssim {
    fn n(&self) -> f64 {
        self.template.len() as f64
    }

    fn constants(&self) -> (f64, f64) {
        ((255.0 * self.params.k1).powi(2), (255.0 * self.params.k2).powi(2))
    }

    fn factors(&self, t: Stats, i: Stats, covariance: f64) -> Factors {
        let (c1, c2) = self.constants();
        let a = 2.0 * t.mean * i.mean + c1;
        let b = 2.0 * covariance + c2;
        let c = t.mean * t.mean + i.mean * i.mean + c1;
        let d = t.variance + i.variance + c2;
        let f = a * b / (c * d);
        Factors { a, b, c, d, f }
    }

    fn stats(&self, side: Side) -> (Stats, Stats) {
        match side {
            Side::Template => (self.template_stats, self.current_stats),
            Side::Current => (self.current_stats, self.template_stats),
        }
    }

    /// The gradient of a side is `one 1 + other x_other + own x_own` with the centred patches.
    fn coefficients(&self, side: Side) -> [f64; 3] {
        let Factors { a, b, c, d, f } = self.factors;
        let (own, other) = self.stats(side);
        let (n, n1) = (self.n(), (self.n() - 1.0).max(1.0));
        let cd = c * d;
        [
            2.0 / n * (other.mean * b - own.mean * f * d) / cd,
            2.0 / n1 * a / cd,
            -2.0 / n1 * f * c / cd,
        ]
    }

    fn accumulate(&mut self, j: &Jacobian, h: &mut SymMatrix) {
        let s = j.cols();
        if self.sums.len() < 3 * s {
            self.sums.resize(3 * s, 0.0);
        }
        kernels::normal_equations(
            j,
            &[&self.template, &self.current, &self.ones],
            h,
            &mut self.sums[..3 * s],
        );
    }

    /// `J'x_own`, `J'x_other`, `J'1`.
    fn sums(&self, side: Side, s: usize) -> [&[f64]; 3] {
        let (ju, jv, j1) = (&self.sums[..s], &self.sums[s..2 * s], &self.sums[2 * s..3 * s]);
        match side {
            Side::Template => [ju, jv, j1],
            Side::Current => [jv, ju, j1],
        }
    }

    /// Turns `J'J` in `h` and `self.sums` into a Hessian of one side.
    fn finish(&self, side: Side, curvature: Curvature, h: &mut SymMatrix) {
        let [own, other, one] = self.sums(side, h.order());
        let (own_stats, other_stats) = self.stats(side);
        let (n, n1) = (self.n(), (self.n() - 1.0).max(1.0));
        match curvature {
            Curvature::SelfHessian => {
                let (c1, c2) = self.constants();
                let c = 2.0 * own_stats.mean.powi(2) + c1;
                let d = 2.0 * own_stats.variance + c2;
                h.fill_from(|p, q, jj| {
                    let ones = one[p] * one[q];
                    -2.0 / (n1 * d) * (jj - ones / n) - 2.0 / (n * n * c) * ones
                });
            }
            Curvature::Standard => {
                let Factors { c, d, f, .. } = self.factors;
                let [g1, gx, go] = self.coefficients(side);
                let g = |p: usize| g1 * one[p] + gx * other[p] + go * own[p];
                let da = |p: usize| 2.0 * other_stats.mean / n * one[p];
                let db = |p: usize| 2.0 / n1 * other[p];
                let dc = |p: usize| 2.0 * own_stats.mean / n * one[p];
                let dd = |p: usize| 2.0 / n1 * own[p];
                let dm = |p: usize| d * dc(p) + c * dd(p);
                h.fill_from(|p, q, jj| {
                    let ones = one[p] * one[q];
                    let second = 2.0 * d / (n * n) * ones
                        + dc(p) * dd(q)
                        + dd(p) * dc(q)
                        + 2.0 * c / n1 * (jj - ones / n);
                    (da(p) * db(q) + db(p) * da(q) - g(p) * dm(q) - dm(p) * g(q) - f * second) / (c * d)
                });
            }
        }
    }
}

impl Part for Ssim {
    type Params = SsimParams;
    const NAME: &'static str = "ssim";
    const SUMMARY: &'static str = "structural similarity of whole patches";
    fn new(params: SsimParams) -> Self {
        Ssim {
            params,
            ..Ssim::default()
        }
    }
}

impl AppearanceModel for Ssim {
    fn properties(&self) -> Properties {
        Properties::default()
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template.clear();
        self.template.resize(shape.len(), 0.0);
        self.template_stats = centre(patch, &mut self.template);
        self.current.clone_from(&self.template);
        self.current_stats = self.template_stats;
        self.factors = self.factors(
            self.template_stats,
            self.template_stats,
            self.template_stats.variance,
        );
        self.ones.clear();
        self.ones.resize(shape.len(), 1.0);
        self.sums.resize(3 * MAX_DOF, 0.0);
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.current_stats = centre(patch, &mut self.current);
        let covariance = kernels::dot(&self.template, &self.current) / (self.n() - 1.0).max(1.0);
        self.factors = self.factors(self.template_stats, self.current_stats, covariance);
    }
    fn similarity(&self) -> f64 {
        self.factors.f
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-2.0 * self.params.likelihood_alpha * (1.0 - self.factors.f).max(0.0))
    }
    fn memory(&self) -> usize {
        12 * self.template.capacity()
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

impl Derivatives for Ssim {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let [one, other, own] = self.coefficients(side);
        let (own_patch, other_patch) = match side {
            Side::Template => (&self.template, &self.current),
            Side::Current => (&self.current, &self.template),
        };
        kernels::combine(other as f32, other_patch, own as f32, own_patch, out);
        out.iter_mut().for_each(|v| *v += one as f32);
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
        let [one, other, own] = self.coefficients(side);
        let [own_sums, other_sums, one_sums] = self.sums(side, j.cols());
        for (k, g) in out.gradient.iter_mut().enumerate() {
            *g = one * one_sums[k] + other * other_sums[k] + own * own_sums[k];
        }
    }
}

impl Distances for Ssim {
    fn metric(&self) -> Metric {
        Metric::Other
    }
    /// Centred patch, mean, variance.
    fn feature_len(&self) -> usize {
        self.template.len() + 2
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        let (values, stats) = out.split_at_mut(patch.len());
        let Stats { mean, variance } = centre(patch, values);
        stats.copy_from_slice(&[mean as f32, variance as f32]);
    }
    /// `-f`.
    fn distance(&self, query: &[f32], stored: &[f32], _bound: f32) -> f32 {
        let n = query.len() - 2;
        let stats = |x: &[f32]| Stats {
            mean: x[n].into(),
            variance: x[n + 1].into(),
        };
        let covariance = kernels::dot(&query[..n], &stored[..n]) / (n as f64 - 1.0).max(1.0);
        -self.factors(stats(stored), stats(query), covariance).f as f32
    }
}

impl Reference for Ssim {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let n = template.len() as f64;
        let stats = |x: &[f64]| {
            let mean = x.iter().sum::<f64>() / n;
            Stats {
                mean,
                variance: x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0),
            }
        };
        let (t, i) = (stats(template), stats(current));
        let products = template
            .iter()
            .zip(current)
            .map(|(a, b)| (a - t.mean) * (b - i.mean));
        self.factors(t, i, products.sum::<f64>() / (n - 1.0).max(1.0)).f
    }
}
