//! Affine: `p = (tx, ty, a, b, c, d)`, `M = [1+a b tx; c 1+d ty; 0 0 1]`.
//!
//! Geometric parameters `(tx, ty, s, θ, r, φ)`: the 2x2 part is `s R(θ) R(-φ) diag(1, r) R(φ)`, a scale `s` along the axis at
//! `-φ`, `s r` across it, then a turn by `θ`. The identity is `(0, 0, 1, 0, 1, 0)`.

use super::Geometric;
use super::projective::ProjectiveModel;
use crate::geom::Mat3;
use crate::geom::fit::Moments;
use crate::params::NoParams;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Algebra of [`super::Affine`].
#[derive(Clone, Debug, Default)]
pub struct AffineModel;

/// Anisotropy below which a scale has no axis, as a share of the scale: rounding alone makes as much.
const ISOTROPIC: f64 = 1e-14;

/// Row and column of `M` that each parameter enters.
const ENTRY: [(usize, usize); 6] = [(0, 2), (1, 2), (0, 0), (0, 1), (1, 0), (1, 1)];

impl ProjectiveModel for AffineModel {
    type Params = NoParams;
    const NAME: &'static str = "affine";
    const ALIASES: &'static [&'static str] = &["aff", "6"];
    const SUMMARY: &'static str = "affine: tx, ty and a 2x2 matrix";
    const DOF: usize = 6;
    const MIN_POINTS: usize = 3;

    fn new(_: NoParams) -> Self {
        AffineModel
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        Mat3::new(1.0 + p[2], p[3], p[0], p[4], 1.0 + p[5], p[1], 0.0, 0.0, 1.0)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        for (p, &(r, c)) in p.iter_mut().zip(&ENTRY) {
            *p = m[(r, c)] - f64::from(u8::from(r == c));
        }
        Some(())
    }
    fn derivative(&self, _: &[f64], k: usize) -> Mat3 {
        let mut d = Mat3::zeros();
        d[ENTRY[k]] = 1.0;
        d
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        Moments::new(from, to)?.affine()
    }
    fn geometric(&self) -> Option<&dyn Geometric> {
        Some(self)
    }
}

impl Geometric for AffineModel {
    /// From the singular values and the angles of both rotations, in closed form. Isotropic scales have no axis: `φ = 0`.
    fn geometric_into(&self, p: &[f64], g: &mut [f64]) {
        let (a, b, c, d) = (1.0 + p[2], p[3], p[4], 1.0 + p[5]);
        let (similar, turn) = (libm::hypot(a + d, c - b) / 2.0, libm::atan2(c - b, a + d));
        let (odd, axis) = (libm::hypot(a - d, c + b) / 2.0, libm::atan2(c + b, a - d));
        let scale = similar + odd;
        let mut phi = if odd > ISOTROPIC * scale {
            (turn - axis) / 2.0
        } else {
            0.0
        };
        if phi > FRAC_PI_2 {
            phi -= PI;
        } else if phi <= -FRAC_PI_2 {
            phi += PI;
        }
        g.copy_from_slice(&[p[0], p[1], scale, turn, (similar - odd) / scale, phi]);
    }

    fn state_into(&self, g: &[f64], p: &mut [f64]) {
        let (s, r) = (g[2], g[4]);
        let (sin, cos) = libm::sincos(g[3] - g[5]);
        let (sin_phi, cos_phi) = libm::sincos(g[5]);
        p.copy_from_slice(&[
            g[0],
            g[1],
            s * (cos * cos_phi - r * sin * sin_phi) - 1.0,
            s * (-cos * sin_phi - r * sin * cos_phi),
            s * (sin * cos_phi + r * cos * sin_phi),
            s * (-sin * sin_phi + r * cos * cos_phi) - 1.0,
        ]);
    }

    fn period(&self, k: usize) -> Option<f64> {
        match k {
            3 => Some(TAU),
            5 => Some(PI),
            _ => None,
        }
    }
}
