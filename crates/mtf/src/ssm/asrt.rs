//! Anisotropic scale, rotation-like and translation: `p = (tx, ty, a, b, c)`, `M = [1+a -b tx; b 1+c ty; 0 0 1]`.
//!
//! Not a group: the product of two such matrices generally has `m01 != -m10`. The state of a matrix is that of the
//! nearest member in the Frobenius norm, which keeps `m02, m12, m00, m11` and takes `b = (m10 - m01)/2`. Additive methods
//! and forward steps are exact, inverse ones approximate. (The original goes on with the unprojected product, which is no
//! member of the family: its figures for compositional methods are those of another warp.)

use super::projective::ProjectiveModel;
use crate::geom::Mat3;
use crate::geom::fit::Moments;
use crate::params::NoParams;

/// Algebra of [`super::Asrt`].
#[derive(Clone, Debug, Default)]
pub struct AsrtModel;

impl ProjectiveModel for AsrtModel {
    type Params = NoParams;
    const NAME: &'static str = "asrt";
    const ALIASES: &'static [&'static str] = &["5"];
    const SUMMARY: &'static str = "scales along both axes, rotation-like and translation: tx, ty, a, b, c";
    const DOF: usize = 5;
    const MIN_POINTS: usize = 3;
    const GROUP: bool = false;

    fn new(_: NoParams) -> Self {
        AsrtModel
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        Mat3::new(1.0 + p[2], -p[3], p[0], p[3], 1.0 + p[4], p[1], 0.0, 0.0, 1.0)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        p.copy_from_slice(&[
            m[(0, 2)],
            m[(1, 2)],
            m[(0, 0)] - 1.0,
            (m[(1, 0)] - m[(0, 1)]) / 2.0,
            m[(1, 1)] - 1.0,
        ]);
        Some(())
    }
    fn derivative(&self, _: &[f64], k: usize) -> Mat3 {
        let mut d = Mat3::zeros();
        match k {
            2 => d[(0, 0)] = 1.0,
            3 => (d[(0, 1)], d[(1, 0)]) = (-1.0, 1.0),
            4 => d[(1, 1)] = 1.0,
            _ => d[(k, 2)] = 1.0,
        }
        d
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        Moments::new(from, to)?.scales_and_rotation()
    }
}
