//! Affine: `p = (tx, ty, a, b, c, d)`, `M = [1+a b tx; c 1+d ty; 0 0 1]`.

use super::projective::{Centred, ProjectiveModel};
use crate::geom::Mat3;
use crate::params::NoParams;
use nalgebra::{Matrix2, Vector2};

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
    fn fit(&self, from: &[[f64; 2]], to: &[[f64; 2]], p: &mut [f64]) -> Option<()> {
        let centred = Centred::new(from, to)?;
        let (mut xx, mut ux) = (Matrix2::zeros(), Matrix2::zeros());
        for &(x, u) in &centred.pairs {
            let (x, u) = (Vector2::from(x), Vector2::from(u));
            xx += x * x.transpose();
            ux += u * x.transpose();
        }
        // Collinear points leave one direction open.
        if xx.determinant() <= 1e-12 * xx.trace().powi(2) {
            return None;
        }
        let a = ux * xx.try_inverse()?;
        let [tx, ty] = centred.translation(&a);
        p.copy_from_slice(&[tx, ty, a[(0, 0)] - 1.0, a[(0, 1)], a[(1, 0)], a[(1, 1)] - 1.0]);
        Some(())
    }
}
