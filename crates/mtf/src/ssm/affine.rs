//! Affine: `p = (tx, ty, a, b, c, d)`, `M = [1+a b tx; c 1+d ty; 0 0 1]`.

use super::projective::ProjectiveModel;
use crate::geom::Mat3;
use crate::geom::fit::Moments;
use crate::params::NoParams;

/// Algebra of [`super::Affine`].
#[derive(Clone, Debug, Default)]
pub struct AffineModel;

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
}
