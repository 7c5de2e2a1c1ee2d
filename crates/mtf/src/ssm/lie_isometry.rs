//! Isometry in se(2): `A(q) = [0 -q2 q0; q2 0 q1; 0 0 0]`, `q2` the angle in radians, below a half turn.

use super::isometry::IsometryModel;
use super::lie::LieBasis;
use crate::geom::Mat3;

/// Basis of [`super::LieIsometry`].
#[derive(Clone, Debug, Default)]
pub struct LieIsometryBasis;

impl LieBasis for LieIsometryBasis {
    type Group = IsometryModel;
    const NAME: &'static str = "lieisometry";
    const ALIASES: &'static [&'static str] = &["liso", "l3"];
    const SUMMARY: &'static str = "isometry as the exponential of se(2)";
    const DOF: usize = 3;
    const UNIT_DETERMINANT: bool = false;

    fn algebra(q: &[f64]) -> Mat3 {
        Mat3::new(0.0, -q[2], q[0], q[2], 0.0, q[1], 0.0, 0.0, 0.0)
    }
    fn coordinates(l: &Mat3, q: &mut [f64]) {
        q.copy_from_slice(&[l[(0, 2)], l[(1, 2)], (l[(1, 0)] - l[(0, 1)]) / 2.0]);
    }
}
