//! Warps with a state in a matrix Lie algebra: `M(p) = exp(A(p))`, `A` linear in `p`.
//!
//! The state of a matrix is its principal real logarithm. Around a half turn there is none (two eigenvalues are negative)
//! and the derivative of `exp` loses rank, so matrices that turn by more than 0.9 π belong to a second chart: the half
//! turn `F = diag(-1, -1, 1)` is split off, `M(p) = F exp(A(p) - 3π J)`, `J` the generator of rotations, recognised by a
//! rotation part beyond 1.5 π. For pure rotations this is still `exp(A(p))`.

use super::projective::ProjectiveModel;
use crate::geom::{Mat3, lie};
use crate::params::NoParams;
use std::f64::consts::PI;

/// Coordinates of a Lie algebra of 3x3 matrices.
pub trait LieBasis: Clone + Default + Send + 'static {
    /// The same warps in other parameters: their matrices are fitted to points alike.
    type Group: ProjectiveModel;
    /// Name of the model.
    const NAME: &'static str;
    /// Other names.
    const ALIASES: &'static [&'static str];
    /// One line for `list ssm`.
    const SUMMARY: &'static str;
    /// Dimension S.
    const DOF: usize;
    /// True when matrices are known up to scale and normalised to determinant 1 before the logarithm.
    const UNIT_DETERMINANT: bool;

    /// `A(p)`.
    fn algebra(p: &[f64]) -> Mat3;
    /// Coordinates of a matrix of the algebra.
    fn coordinates(l: &Mat3, p: &mut [f64]);
}

/// The projective model of a basis.
#[derive(Clone, Debug, Default)]
pub struct LieModel<B>(B);

fn generator<B: LieBasis>(k: usize) -> Mat3 {
    let mut unit = [0.0; super::MAX_DOF];
    unit[k] = 1.0;
    B::algebra(&unit[..B::DOF])
}

/// Rotation part of a matrix of the algebra: its coefficient along `J`.
fn rotation(a: &Mat3) -> f64 {
    (a[(1, 0)] - a[(0, 1)]) / 2.0
}

/// `a + angle J`.
fn turned(a: &Mat3, angle: f64) -> Mat3 {
    let mut out = *a;
    out[(1, 0)] += angle;
    out[(0, 1)] -= angle;
    out
}

/// `F m`.
fn half_turn(m: &Mat3) -> Mat3 {
    let mut out = *m;
    for c in 0..3 {
        out[(0, c)] = -out[(0, c)];
        out[(1, c)] = -out[(1, c)];
    }
    out
}

/// Largest rotation part within a chart.
const LARGEST: f64 = 0.9 * PI;

impl<B: LieBasis> LieModel<B> {
    /// Matrix of the algebra within the chart of `p`, and whether that is the second one.
    fn chart(p: &[f64]) -> (Mat3, bool) {
        let a = B::algebra(p);
        let angle = rotation(&a);
        if angle.abs() <= 1.5 * PI {
            (a, false)
        } else {
            (turned(&a, -3.0 * PI * angle.signum()), true)
        }
    }

    fn in_chart(m: Mat3, second: bool) -> Mat3 {
        if second { half_turn(&m) } else { m }
    }
}

impl<B: LieBasis> ProjectiveModel for LieModel<B> {
    type Params = NoParams;
    const NAME: &'static str = B::NAME;
    const ALIASES: &'static [&'static str] = B::ALIASES;
    const SUMMARY: &'static str = B::SUMMARY;
    const DOF: usize = B::DOF;
    const MIN_POINTS: usize = B::Group::MIN_POINTS;

    fn new(_: NoParams) -> Self {
        LieModel::default()
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        let (a, second) = Self::chart(p);
        Self::in_chart(lie::exp(&a), second)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        let unit = if B::UNIT_DETERMINANT {
            m / libm::cbrt(m.determinant())
        } else {
            *m
        };
        let first = lie::log(&unit);
        let l = match first {
            Some(l) if rotation(&l).abs() <= LARGEST => l,
            _ => lie::log(&half_turn(&unit))
                .map(|l| turned(&l, 3.0 * PI))
                .or(first)?,
        };
        B::coordinates(&l, p);
        Some(())
    }
    fn canonical(&self, p: &mut [f64]) {
        if rotation(&Self::chart(p).0).abs() > LARGEST {
            let m = self.matrix(p);
            // Without another chart the state stays in this one.
            let _ = self.state(&m, p);
        }
    }
    fn derivative(&self, p: &[f64], k: usize) -> Mat3 {
        let direction = generator::<B>(k);
        if p.iter().all(|v| *v == 0.0) {
            return direction;
        }
        let (a, second) = Self::chart(p);
        Self::in_chart(lie::exp_derivative(&a, &direction), second)
    }
    fn second_derivative(&self, p: &[f64], k: usize, l: usize) -> Option<Mat3> {
        let (e, f) = (generator::<B>(k), generator::<B>(l));
        let (a, second) = Self::chart(p);
        Some(Self::in_chart(lie::exp_second_derivative(&a, &e, &f), second))
    }
    fn inverse(&self, p: &[f64]) -> Option<Mat3> {
        let (a, second) = Self::chart(p);
        let inverse = lie::exp(&-a);
        // `(F E)⁻¹ = E⁻¹ F`, F its own inverse.
        Some(if second {
            half_turn(&inverse.transpose()).transpose()
        } else {
            inverse
        })
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        B::Group::default().fit_matrix(from, to)
    }
    fn minimal(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        B::Group::default().minimal(from, to)
    }
    fn refine(&self, m: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], iterations: usize) -> Option<Mat3> {
        B::Group::default().refine(m, from, to, iterations)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ssm::{LieAffineBasis, LieHomographyBasis, LieIsometryBasis, Sl3Basis};
    use proptest::prelude::*;

    /// A matrix turned by any angle has a state, gives itself back, and its derivatives have full rank.
    fn all_the_way_round<B: LieBasis>(q: &[f64; 8], angle: f64) {
        let model = LieModel::<B>::default();
        let turn = lie::exp(&turned(&Mat3::zeros(), angle));
        let m = lie::exp(&B::algebra(&q[..B::DOF])) * turn;
        let mut p = [0.0; 8];
        let p = &mut p[..B::DOF];
        model.state(&m, p).unwrap();
        assert!((model.matrix(p) - m).abs().max() < 1e-8, "{} {angle}", B::NAME);
        assert!((model.inverse(p).unwrap() * m - Mat3::identity()).abs().max() < 1e-8);
        let rows: Vec<f64> = (0..B::DOF)
            .flat_map(|k| model.derivative(p, k).iter().copied().collect::<Vec<_>>())
            .collect();
        let j = nalgebra::DMatrix::from_row_slice(B::DOF, 9, &rows);
        let smallest = j.singular_values().min();
        assert!(smallest > 0.05, "{} {angle}: {smallest}", B::NAME);
        // An additive step that leaves the chart is carried into the other.
        let before = model.matrix(p);
        model.canonical(p);
        assert!((model.matrix(p) - before).abs().max() < 1e-8);
    }

    proptest! {
        #[test]
        fn states_of_all_rotations(q in prop::array::uniform8(-0.12f64..0.12), angle in -9.0f64..9.0) {
            all_the_way_round::<LieIsometryBasis>(&q, angle);
            all_the_way_round::<LieAffineBasis>(&q, angle);
            all_the_way_round::<LieHomographyBasis>(&q, angle);
            all_the_way_round::<Sl3Basis>(&q, angle);
        }
    }

    #[test]
    fn small_states_are_plain_exponentials() {
        let model = LieModel::<Sl3Basis>::default();
        let p = [0.1, -0.2, 2.5, 0.1, 0.3, -0.1, 0.05, -0.02];
        assert_eq!(model.matrix(&p), lie::exp(&Sl3Basis::algebra(&p)));
        let pure = [0.0, 0.0, 3.0 * PI - 0.3, 0.0, 0.0, 0.0, 0.0, 0.0];
        let plain = lie::exp(&Sl3Basis::algebra(&pure));
        assert!((model.matrix(&pure) - plain).abs().max() < 1e-12);
    }
}
