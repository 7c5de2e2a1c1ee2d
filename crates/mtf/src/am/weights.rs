//! Weights of single values: M-estimators (Huber 1964; Beaton & Tukey 1974) and masks, for models that are sums over
//! values.
//!
//! A robust model maximises `f = -Σ_i m_i s² ρ(e_i/s)` instead of `-½ Σ_i e_i²`, by iteratively re-weighted least squares:
//! `w_i = m_i ψ(e_i/s)/(e_i/s)`, `df/de = -w e`, Hessian `-Jᵀ diag(w) J` (also where `ρ` is not convex). The scale is
//! `s = 1.4826 median |e|`, estimated anew from each patch and held fixed while differentiating: at least half of the values
//! then keep most of their weight, however bad the patch. `k = 1.345` (Huber) and `c = 4.685` (Tukey) give 95 % of the
//! efficiency of least squares on Gaussian noise. A mask sets `m_i` to 0, and to `n/kept` elsewhere, so that `f` of
//! different masks compares.

use super::Normal;
use super::standard;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::params::param_enum;

param_enum! {
    /// Loss of single differences.
    pub enum Robust {
        /// Squares.
        None = "none",
        /// Squares for small, absolute values for large differences.
        Huber = "huber",
        /// Squares for small differences, a constant for large ones, which then have no influence.
        Tukey = "tukey",
    }
}

/// Huber's `k`, Tukey's `c`.
const HUBER: f32 = 1.345;
const TUKEY: f32 = 4.685;
/// Noise below which a robust loss sees no outliers: a gray level.
pub(super) const NOISE: f64 = 1.0;
/// Standard deviation over median absolute value, of Gaussian noise.
const MAD: f64 = 1.4826;

/// Least scale: standardised flat patches do not differ at all.
const LEAST_SCALE: f64 = 1e-6;

/// Weights of the values of a patch.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    loss: Robust,
    /// `m`, empty without a mask.
    mask: Vec<f32>,
    /// `w`; empty until needed.
    w: Vec<f32>,
    sizes: Vec<f32>,
    /// `s`.
    scale: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Weights::new(Robust::None)
    }
}

impl Weights {
    pub fn new(loss: Robust) -> Self {
        Weights {
            loss,
            mask: Vec::new(),
            w: Vec::new(),
            sizes: Vec::new(),
            scale: 1.0,
        }
    }

    /// All weights 1, for patches of `n` values.
    pub fn reset(&mut self, n: usize) {
        self.mask.clear();
        self.w.clear();
        if self.loss != Robust::None {
            self.w.resize(n, 1.0);
        }
    }

    /// Sets the mask, of 0 and 1. Allocates the first time.
    pub fn set_mask(&mut self, mask: &[f32]) {
        let share = (mask.len() as f64 / kernels::sum(mask)) as f32;
        self.mask.clear();
        self.mask.extend(mask.iter().map(|m| m * share));
        if self.loss == Robust::None {
            self.w.clone_from(&self.mask);
            return;
        }
        // What a mask admits again must be able to gain weight.
        for (w, m) in self.w.iter_mut().zip(&self.mask) {
            *w = if *m == 0.0 { 0.0 } else { w.max(1e-2) };
        }
    }

    /// Whether there are any but equal weights.
    pub fn used(&self) -> bool {
        !self.w.is_empty()
    }

    /// `w`, if used.
    pub fn get(&self) -> Option<&[f32]> {
        self.used().then_some(&self.w[..])
    }

    /// Computes the weights of the differences `e`, whose scale is at least `floor`; returns `2 Σ_i m_i s² ρ(e_i/s)`.
    pub fn estimate(&mut self, e: &[f32], floor: f64) -> f64 {
        if self.mask.is_empty() {
            self.w.fill(1.0);
        } else {
            self.w.copy_from_slice(&self.mask);
        }
        if self.loss == Robust::None {
            return kernels::weighted_squares(&self.w, e);
        }
        self.sizes.clear();
        let kept = e.iter().zip(&self.w).filter(|(_, w)| **w > 0.0);
        self.sizes.extend(kept.map(|(e, _)| e.abs()));
        let middle = self.sizes.len() / 2;
        let (_, median, _) = self.sizes.select_nth_unstable_by(middle, f32::total_cmp);
        self.scale = (MAD * f64::from(*median)).max(floor).max(LEAST_SCALE);
        let inverse = (1.0 / self.scale) as f32;
        let loss = match self.loss {
            Robust::Tukey => kernels::tukey(e, inverse, TUKEY, &mut self.w),
            _ => kernels::huber(e, inverse, HUBER, &mut self.w),
        };
        2.0 * self.scale * self.scale * loss
    }

    /// `Σ_i m_i s² ρ(e_i/s)` with the present scale: the slow definition.
    pub fn reference(&self, e: impl Iterator<Item = f64>) -> f64 {
        let rho = |x: f64| {
            let (k, c) = (f64::from(HUBER), f64::from(TUKEY));
            match self.loss {
                Robust::None => 0.5 * x * x,
                Robust::Huber if x.abs() <= k => 0.5 * x * x,
                Robust::Huber => k * (x.abs() - 0.5 * k),
                Robust::Tukey => c * c / 6.0 * (1.0 - (1.0 - (x / c).powi(2)).max(0.0).powi(3)),
            }
        };
        let m = |i: usize| self.mask.get(i).map_or(1.0, |m| f64::from(*m));
        let s = if self.loss == Robust::None {
            1.0
        } else {
            self.scale
        };
        e.enumerate().map(|(i, e)| m(i) * s * s * rho(e / s)).sum()
    }

    /// `h = Jᵀ diag(w) J` and `out[m * S + k] = Σ_i rhs[m]_i J_ik`.
    pub fn normal_equations(&self, j: &Jacobian, rhs: &[&[f32]], h: &mut SymMatrix, out: &mut [f64]) {
        match self.get() {
            Some(w) => kernels::weighted_normal_equations(j, w, rhs, h, out),
            None => kernels::normal_equations(j, rhs, h, out),
        }
    }

    /// `h = factor Jᵀ diag(w) J`.
    pub fn gram(&self, j: &Jacobian, factor: f64, h: &mut SymMatrix) {
        self.normal_equations(j, &[], h, &mut []);
        h.scale(factor);
    }

    /// `gradient = factor Jᵀ r`, `hessian = curvature Jᵀ diag(w) J`.
    pub fn least_squares(&self, j: &Jacobian, r: &[f32], factor: f64, curvature: f64, out: &mut Normal) {
        self.normal_equations(j, &[r], &mut out.hessian, &mut out.gradient);
        out.hessian.scale(curvature);
        out.gradient.iter_mut().for_each(|g| *g *= factor);
    }

    /// Replaces the differences by `w e` if there are weights; `squares` is their sum of squares. Returns `-2 f`.
    pub fn weigh(&mut self, e: &mut [f32], squares: f64, floor: f64) -> f64 {
        if !self.used() {
            return squares;
        }
        let loss = self.estimate(e, floor);
        kernels::multiply(&self.w, e);
        loss
    }

    /// As [`standardise`](standard::standardise), mean and deviation weighted.
    pub fn standardise(&self, x: &[f32], out: &mut [f32]) -> (f64, f64) {
        let Some(w) = self.get() else {
            return standard::standardise(x, out);
        };
        let total = kernels::sum(w);
        let mean = kernels::dot(w, x) / total;
        kernels::rescale(x, mean as f32, 1.0, out);
        let deviation = (kernels::weighted_squares(w, out) / total).sqrt();
        let inverse = if deviation >= standard::FLAT {
            1.0 / deviation
        } else {
            0.0
        };
        kernels::rescale(x, mean as f32, inverse as f32, out);
        (mean, inverse)
    }

    /// With a robust loss: first weights for a patch, from its differences to the (standardised) template when it is
    /// standardised by mean and inverse deviation of the patch before, so that whatever has newly come into view stands out.
    pub fn judge(&mut self, template: &[f32], patch: &[f32], last: (f64, f64), t: &mut [f32], e: &mut [f32]) {
        if self.loss != Robust::None {
            self.standardise(template, t);
            kernels::rescale(patch, last.0 as f32, last.1 as f32, e);
            kernels::subtract_from(e, t);
            self.estimate(e, NOISE * last.1);
        }
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        4 * (self.mask.capacity() + self.w.capacity() + self.sizes.capacity())
    }
}
