//! NCC, normalised cross-correlation with its exact derivatives (Scandaroli, Meilland & Richa 2012).
//!
//! `u = (T - T̄)/c`, `v = (I - Ī)/b` with `c = |T - T̄|`, `b = |I - Ī|`; `f = u·v` in [-1, 1].
//! `df/dI = (u - f v)/b`, `df/dT = (v - f u)/c`. With `P = Id - 11'/n`:
//! `d²f/dI² = (-f P - v u' - u v' + 3 f v v')/b²`, self Hessian `(-P + v v')/b²`; the template side swaps the roles.

use super::zncc::standardise;
use super::{AmModel, AppearanceModel, Capabilities, Curvature, Metric, Normal, PatchShape, Side};
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Ncc`].
    pub struct NccParams {
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
    /// `1/σ` of the patches; `sqrt(n) σ` are the norms `c` and `b`.
    template_inverse: f64,
    current_inverse: f64,
    ones: Vec<f32>,
    f: f64,
    /// `J'û, J'v̂, J'1` of the last Jacobian, S each.
    sums: Vec<f64>,
}

/// Most parameters a Jacobian may have without allocation in the hot path.
const MAX_DOF: usize = 16;

impl Ncc {
    fn n(&self) -> f64 {
        self.template.len() as f64
    }
    /// `J'J`, and `J'û`, `J'v̂`, `J'1` into `self.sums`.
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

impl AmModel for Ncc {
    type Params = NccParams;
    const NAME: &'static str = "ncc";
    const SUMMARY: &'static str = "normalised cross-correlation, exact derivatives";
    fn new(params: NccParams) -> Self {
        Ncc {
            params,
            ..Ncc::default()
        }
    }
}

impl AppearanceModel for Ncc {
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
        self.template_inverse = standardise(patch, &mut self.template).1;
        if self.template_inverse == 0.0 {
            return Err(TrackError::Template("flat patch"));
        }
        self.current.clone_from(&self.template);
        self.current_inverse = self.template_inverse;
        self.ones.clear();
        self.ones.resize(shape.len(), 1.0);
        self.sums.resize(3 * MAX_DOF, 0.0);
        self.f = 1.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.current_inverse = standardise(patch, &mut self.current).1;
        self.f = kernels::dot(&self.template, &self.current) / self.n();
    }
    fn similarity(&self) -> f64 {
        self.f
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let (own, other, inverse) = match side {
            Side::Template => (&self.template, &self.current, self.template_inverse),
            Side::Current => (&self.current, &self.template, self.current_inverse),
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
    fn likelihood(&self) -> f64 {
        libm::exp(-2.0 * self.params.likelihood_alpha * (1.0 - self.f).max(0.0))
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        standardise(patch, out);
    }
    fn reference(&self, template: &[f64], current: &[f64]) -> f64 {
        let n = template.len() as f64;
        let mean = |x: &[f64]| x.iter().sum::<f64>() / n;
        let (mt, mi) = (mean(template), mean(current));
        let (mut tt, mut ii, mut ti) = (0.0, 0.0, 0.0);
        for (t, i) in template.iter().zip(current) {
            let (t, i) = (t - mt, i - mi);
            (tt, ii, ti) = (tt + t * t, ii + i * i, ti + t * i);
        }
        if tt * ii > 0.0 { ti / (tt * ii).sqrt() } else { 0.0 }
    }
    fn memory(&self) -> usize {
        12 * self.template.capacity()
    }
}
