//! Warps with a state in a matrix Lie algebra: `M(p) = exp(A(p))`, `A` linear in `p`; inverse `M(-p)`.
//!
//! The state of a matrix is its principal real logarithm, which exists while no eigenvalue is on the negative axis
//! (rotations below a half turn, moderate perspective).

use super::projective::ProjectiveModel;
use crate::geom::{Mat3, lie};
use crate::params::NoParams;

/// Coordinates of a Lie algebra of 3x3 matrices.
pub trait LieBasis: Clone + Default + Send + 'static {
    /// Name of the model.
    const NAME: &'static str;
    /// Other names.
    const ALIASES: &'static [&'static str];
    /// One line for `list ssm`.
    const SUMMARY: &'static str;
    /// Dimension S.
    const DOF: usize;
    /// Point pairs that determine a state.
    const MIN_POINTS: usize;
    /// True when matrices are known up to scale and normalised to determinant 1 before the logarithm.
    const UNIT_DETERMINANT: bool;

    /// `A(p)`.
    fn algebra(p: &[f64]) -> Mat3;
    /// Coordinates of a matrix of the algebra.
    fn coordinates(l: &Mat3, p: &mut [f64]);
    /// Least-squares matrix of the group for point pairs.
    fn fit(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3>;
    /// The same for `MIN_POINTS` pairs.
    fn minimal(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        Self::fit(from, to)
    }
    /// Least-squares reprojection error from a start.
    fn refine(_m: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], _iterations: usize) -> Option<Mat3> {
        Self::fit(from, to)
    }
}

/// The projective model of a basis.
#[derive(Clone, Debug, Default)]
pub struct LieModel<B>(B);

fn generator<B: LieBasis>(k: usize) -> Mat3 {
    let mut unit = [0.0; super::MAX_DOF];
    unit[k] = 1.0;
    B::algebra(&unit[..B::DOF])
}

impl<B: LieBasis> ProjectiveModel for LieModel<B> {
    type Params = NoParams;
    const NAME: &'static str = B::NAME;
    const ALIASES: &'static [&'static str] = B::ALIASES;
    const SUMMARY: &'static str = B::SUMMARY;
    const DOF: usize = B::DOF;
    const MIN_POINTS: usize = B::MIN_POINTS;

    fn new(_: NoParams) -> Self {
        LieModel::default()
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        lie::exp(&B::algebra(p))
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        let unit = if B::UNIT_DETERMINANT {
            m / libm::cbrt(m.determinant())
        } else {
            *m
        };
        B::coordinates(&lie::log(&unit)?, p);
        Some(())
    }
    fn derivative(&self, p: &[f64], k: usize) -> Mat3 {
        let direction = generator::<B>(k);
        if p.iter().all(|v| *v == 0.0) {
            return direction;
        }
        lie::exp_derivative(&B::algebra(p), &direction)
    }
    fn second_derivative(&self, p: &[f64], k: usize, l: usize) -> Option<Mat3> {
        let (e, f) = (generator::<B>(k), generator::<B>(l));
        Some(lie::exp_second_derivative(&B::algebra(p), &e, &f))
    }
    fn inverse(&self, p: &[f64]) -> Option<Mat3> {
        Some(lie::exp(&-B::algebra(p)))
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        B::fit(from, to)
    }
    fn minimal(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        B::minimal(from, to)
    }
    fn refine(&self, m: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], iterations: usize) -> Option<Mat3> {
        B::refine(m, from, to, iterations)
    }
}
