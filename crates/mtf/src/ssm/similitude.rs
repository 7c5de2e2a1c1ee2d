//! Similitude: `p = (tx, ty, a, b)`, `M = [1+a -b tx; b 1+a ty; 0 0 1]`.
//!
//! Geometric parameters `(tx, ty, θ, s)`: a turn by `θ` and a scale `1 + s`. The identity is `0`.

use super::Geometric;
use super::projective::ProjectiveModel;
use crate::geom::Mat3;
use crate::geom::fit::Moments;
use crate::params::NoParams;

/// Algebra of [`super::Similitude`].
#[derive(Clone, Debug, Default)]
pub struct SimilitudeModel;

impl ProjectiveModel for SimilitudeModel {
    type Params = NoParams;
    const NAME: &'static str = "similitude";
    const ALIASES: &'static [&'static str] = &["sim", "similarity", "4"];
    const SUMMARY: &'static str = "rotation, isotropic scale and translation: tx, ty, a, b";
    const DOF: usize = 4;
    const MIN_POINTS: usize = 2;

    fn new(_: NoParams) -> Self {
        SimilitudeModel
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        Mat3::new(1.0 + p[2], -p[3], p[0], p[3], 1.0 + p[2], p[1], 0.0, 0.0, 1.0)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        p.copy_from_slice(&[m[(0, 2)], m[(1, 2)], m[(0, 0)] - 1.0, m[(1, 0)]]);
        Some(())
    }
    fn derivative(&self, _: &[f64], k: usize) -> Mat3 {
        let mut d = Mat3::zeros();
        match k {
            2 => (d[(0, 0)], d[(1, 1)]) = (1.0, 1.0),
            3 => (d[(0, 1)], d[(1, 0)]) = (-1.0, 1.0),
            _ => d[(k, 2)] = 1.0,
        }
        d
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        Moments::new(from, to)?.similarity()
    }
    fn geometric(&self) -> Option<&dyn Geometric> {
        Some(self)
    }
}

impl Geometric for SimilitudeModel {
    fn geometric_into(&self, p: &[f64], g: &mut [f64]) {
        let (a, b) = (1.0 + p[2], p[3]);
        g.copy_from_slice(&[p[0], p[1], libm::atan2(b, a), libm::hypot(a, b) - 1.0]);
    }

    fn state_into(&self, g: &[f64], p: &mut [f64]) {
        let (sin, cos) = libm::sincos(g[2]);
        let scale = 1.0 + g[3];
        p.copy_from_slice(&[g[0], g[1], scale * cos - 1.0, scale * sin]);
    }

    fn period(&self, k: usize) -> Option<f64> {
        (k == 2).then_some(std::f64::consts::TAU)
    }
}
