//! Translation: `p = (tx, ty)`, `M = [1 0 tx; 0 1 ty; 0 0 1]`.

use super::projective::ProjectiveModel;
use crate::geom::Mat3;
use crate::geom::fit::Moments;
use crate::params::NoParams;

/// Algebra of [`super::Translation`].
#[derive(Clone, Debug, Default)]
pub struct TranslationModel;

impl ProjectiveModel for TranslationModel {
    type Params = NoParams;
    const NAME: &'static str = "translation";
    const ALIASES: &'static [&'static str] = &["trans", "2"];
    const SUMMARY: &'static str = "translation: tx, ty";
    const DOF: usize = 2;
    const MIN_POINTS: usize = 1;

    fn new(_: NoParams) -> Self {
        TranslationModel
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        Mat3::new(1.0, 0.0, p[0], 0.0, 1.0, p[1], 0.0, 0.0, 1.0)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        p.copy_from_slice(&[m[(0, 2)], m[(1, 2)]]);
        Some(())
    }
    fn derivative(&self, _: &[f64], k: usize) -> Mat3 {
        let mut d = Mat3::zeros();
        d[(k, 2)] = 1.0;
        d
    }
    fn inverse(&self, p: &[f64]) -> Option<Mat3> {
        Some(self.matrix(&[-p[0], -p[1]]))
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        Moments::new(from, to)?.translation()
    }
}
