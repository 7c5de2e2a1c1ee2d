//! Homography in sl(3), geometric basis (Benhimane & Malis 2007; Kwon 2013):
//! `A(q) = [q0 q3-q2 q4; q3+q2 -q0-q1 q5; q6 q7 q1]`.

use super::homography::HomographyModel;
use super::lie::LieBasis;
use crate::geom::Mat3;

/// Basis of [`super::Sl3`].
#[derive(Clone, Debug, Default)]
pub struct Sl3Basis;

impl LieBasis for Sl3Basis {
    type Group = HomographyModel;
    const NAME: &'static str = "sl3";
    const ALIASES: &'static [&'static str] = &[];
    const SUMMARY: &'static str = "homography as the exponential of sl(3), geometric basis";
    const DOF: usize = 8;
    const UNIT_DETERMINANT: bool = true;

    fn algebra(q: &[f64]) -> Mat3 {
        Mat3::new(
            q[0],
            q[3] - q[2],
            q[4],
            q[3] + q[2],
            -q[0] - q[1],
            q[5],
            q[6],
            q[7],
            q[1],
        )
    }
    fn coordinates(l: &Mat3, q: &mut [f64]) {
        q.copy_from_slice(&[
            l[(0, 0)],
            l[(2, 2)],
            (l[(1, 0)] - l[(0, 1)]) / 2.0,
            (l[(1, 0)] + l[(0, 1)]) / 2.0,
            l[(0, 2)],
            l[(1, 2)],
            l[(2, 0)],
            l[(2, 1)],
        ]);
    }
}
