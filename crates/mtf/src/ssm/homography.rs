//! Homography: `p = (h00-1, h01, h02, h10, h11-1, h12, h20, h21)`, `M = [1+p0 p1 p2; p3 1+p4 p5; p6 p7 1]`.

use super::projective::ProjectiveModel;
use crate::geom::{Mat3, homography};
use crate::params::NoParams;

/// Algebra of [`super::Homography`].
#[derive(Clone, Debug, Default)]
pub struct HomographyModel;

impl ProjectiveModel for HomographyModel {
    type Params = NoParams;
    const NAME: &'static str = "homography";
    const ALIASES: &'static [&'static str] = &["hom", "8"];
    const SUMMARY: &'static str = "homography: the eight free entries of the matrix";
    const DOF: usize = 8;
    const MIN_POINTS: usize = 4;

    fn new(_: NoParams) -> Self {
        HomographyModel
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        Mat3::new(1.0 + p[0], p[1], p[2], p[3], 1.0 + p[4], p[5], p[6], p[7], 1.0)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        let k = m[(2, 2)];
        if k.abs() < 1e-12 {
            return None;
        }
        for (i, p) in p.iter_mut().enumerate() {
            *p = m[(i / 3, i % 3)] / k - f64::from(u8::from(i / 3 == i % 3));
        }
        Some(())
    }
    fn derivative(&self, _: &[f64], k: usize) -> Mat3 {
        let mut d = Mat3::zeros();
        d[(k / 3, k % 3)] = 1.0;
        d
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        homography::from_points(from, to)
    }
    fn minimal(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        homography::from_four(from, to)
    }
    fn refine(&self, m: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], iterations: usize) -> Option<Mat3> {
        homography::refine(m, from, to, iterations)
    }
}
