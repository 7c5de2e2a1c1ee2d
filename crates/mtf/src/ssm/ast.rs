//! Scales along both axes and translation: `p = (tx, ty, sx, sy)`, `M = [1+sx 0 tx; 0 1+sy ty; 0 0 1]`.

use super::projective::ProjectiveModel;
use crate::geom::Mat3;
use crate::geom::fit::Moments;
use crate::params::NoParams;

/// Algebra of [`super::Ast`].
#[derive(Clone, Debug, Default)]
pub struct AstModel;

impl ProjectiveModel for AstModel {
    type Params = NoParams;
    const NAME: &'static str = "ast";
    const ALIASES: &'static [&'static str] = &["4s"];
    const SUMMARY: &'static str = "scales along both axes and translation: tx, ty, sx, sy";
    const DOF: usize = 4;
    const MIN_POINTS: usize = 2;

    fn new(_: NoParams) -> Self {
        AstModel
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        Mat3::new(1.0 + p[2], 0.0, p[0], 0.0, 1.0 + p[3], p[1], 0.0, 0.0, 1.0)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        p.copy_from_slice(&[m[(0, 2)], m[(1, 2)], m[(0, 0)] - 1.0, m[(1, 1)] - 1.0]);
        Some(())
    }
    fn derivative(&self, _: &[f64], k: usize) -> Mat3 {
        let mut d = Mat3::zeros();
        match k {
            2 => d[(0, 0)] = 1.0,
            3 => d[(1, 1)] = 1.0,
            _ => d[(k, 2)] = 1.0,
        }
        d
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        Moments::new(from, to)?.axis_scales()
    }
}
