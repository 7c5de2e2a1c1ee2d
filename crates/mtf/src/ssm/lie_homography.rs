//! Homography in sl(3), elementary basis: `A(q) = [q0 q1 q2; q3 q4-q0 q5; q6 q7 -q4]`.

use super::homography::HomographyModel;
use super::lie::LieBasis;
use crate::geom::Mat3;

/// Basis of [`super::LieHomography`].
#[derive(Clone, Debug, Default)]
pub struct LieHomographyBasis;

impl LieBasis for LieHomographyBasis {
    type Group = HomographyModel;
    const NAME: &'static str = "liehomography";
    const ALIASES: &'static [&'static str] = &["lhom", "l8"];
    const SUMMARY: &'static str = "homography as the exponential of sl(3), elementary basis";
    const DOF: usize = 8;
    const UNIT_DETERMINANT: bool = true;

    fn algebra(q: &[f64]) -> Mat3 {
        Mat3::new(q[0], q[1], q[2], q[3], q[4] - q[0], q[5], q[6], q[7], -q[4])
    }
    fn coordinates(l: &Mat3, q: &mut [f64]) {
        q.copy_from_slice(&[
            l[(0, 0)],
            l[(0, 1)],
            l[(0, 2)],
            l[(1, 0)],
            -l[(2, 2)],
            l[(1, 2)],
            l[(2, 0)],
            l[(2, 1)],
        ]);
    }
}
