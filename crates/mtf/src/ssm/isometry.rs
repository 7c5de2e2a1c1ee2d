//! Isometry: `p = (tx, ty, θ)`, `M = [cosθ -sinθ tx; sinθ cosθ ty; 0 0 1]`, θ in radians.

use super::projective::ProjectiveModel;
use crate::geom::Mat3;
use crate::geom::fit::Moments;
use crate::params::NoParams;
use nalgebra::{Matrix2, Vector2};

/// Algebra of [`super::Isometry`].
#[derive(Clone, Debug, Default)]
pub struct IsometryModel;

fn rotation(theta: f64) -> Matrix2<f64> {
    let (s, c) = libm::sincos(theta);
    Matrix2::new(c, -s, s, c)
}

impl ProjectiveModel for IsometryModel {
    type Params = NoParams;
    const NAME: &'static str = "isometry";
    const ALIASES: &'static [&'static str] = &["iso", "3"];
    const SUMMARY: &'static str = "rotation and translation: tx, ty, theta";
    const DOF: usize = 3;
    const MIN_POINTS: usize = 2;

    fn new(_: NoParams) -> Self {
        IsometryModel
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        let (s, c) = libm::sincos(p[2]);
        Mat3::new(c, -s, p[0], s, c, p[1], 0.0, 0.0, 1.0)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        p.copy_from_slice(&[m[(0, 2)], m[(1, 2)], libm::atan2(m[(1, 0)], m[(0, 0)])]);
        Some(())
    }
    fn derivative(&self, p: &[f64], k: usize) -> Mat3 {
        let mut d = Mat3::zeros();
        if k < 2 {
            d[(k, 2)] = 1.0;
        } else {
            let (s, c) = libm::sincos(p[2]);
            d = Mat3::new(-s, -c, 0.0, c, -s, 0.0, 0.0, 0.0, 0.0);
        }
        d
    }
    fn second_derivative(&self, p: &[f64], k: usize, l: usize) -> Option<Mat3> {
        (k == 2 && l == 2).then(|| {
            let (s, c) = libm::sincos(p[2]);
            Mat3::new(-c, s, 0.0, -s, -c, 0.0, 0.0, 0.0, 0.0)
        })
    }
    fn inverse(&self, p: &[f64]) -> Option<Mat3> {
        let t = rotation(-p[2]) * Vector2::new(p[0], p[1]);
        Some(self.matrix(&[-t[0], -t[1], -p[2]]))
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        Moments::new(from, to)?.isometry()
    }
}
