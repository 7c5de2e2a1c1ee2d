//! Affine in aff(2): `A(q) = [q0+q1 q3-q2 q4; q2+q3 q0-q1 q5; 0 0 0]`.

use super::affine::AffineModel;
use super::lie::LieBasis;
use crate::geom::Mat3;

/// Basis of [`super::LieAffine`].
#[derive(Clone, Debug, Default)]
pub struct LieAffineBasis;

impl LieBasis for LieAffineBasis {
    type Group = AffineModel;
    const NAME: &'static str = "lieaffine";
    const ALIASES: &'static [&'static str] = &["laff", "l6"];
    const SUMMARY: &'static str = "affine as the exponential of its Lie algebra";
    const DOF: usize = 6;
    const UNIT_DETERMINANT: bool = false;

    fn algebra(q: &[f64]) -> Mat3 {
        Mat3::new(
            q[0] + q[1],
            q[3] - q[2],
            q[4],
            q[2] + q[3],
            q[0] - q[1],
            q[5],
            0.0,
            0.0,
            0.0,
        )
    }
    fn coordinates(l: &Mat3, q: &mut [f64]) {
        let half = |a: f64| a / 2.0;
        q.copy_from_slice(&[
            half(l[(0, 0)] + l[(1, 1)]),
            half(l[(0, 0)] - l[(1, 1)]),
            half(l[(1, 0)] - l[(0, 1)]),
            half(l[(1, 0)] + l[(0, 1)]),
            l[(0, 2)],
            l[(1, 2)],
        ]);
    }
}
