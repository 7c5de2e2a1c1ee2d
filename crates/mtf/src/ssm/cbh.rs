//! Corner based homography: `p = (dx0, dy0, ..., dx3, dy3)`, the offsets of the four base corners `(X, Y)` to
//! `(U, V) = (X + dx, Y + dy)`; `M` is the homography between them, scaled to `m22 = 1`.
//!
//! Its entries `h = (m00, ..., m21)` solve `A h = b` with two rows per corner, `[X Y 1 0 0 0 -UX -UY] h = U` and
//! `[0 0 0 X Y 1 -VX -VY] h = V`, so `∂h/∂U_i = s_i A⁻¹[:, 2i]`, `∂h/∂V_i = s_i A⁻¹[:, 2i+1]` with
//! `s_i = m20 X_i + m21 Y_i + 1`; the second derivatives follow from differentiating `A h = b` twice.

use super::MAX_DOF;
use super::frame::BaseFrame;
use super::projective::ProjectiveModel;
use crate::geom::{Corners, Mat3, homography};
use crate::params::NoParams;
use nalgebra::{SMatrix, SVector};

type Matrix8 = SMatrix<f64, 8, 8>;
type Vector8 = SVector<f64, 8>;

/// Algebra of [`super::Cbh`].
#[derive(Clone, Debug)]
pub struct CbhModel {
    base: Corners,
}

impl Default for CbhModel {
    fn default() -> Self {
        CbhModel {
            base: BaseFrame::default().corners,
        }
    }
}

fn entries(h: &Vector8, last: f64) -> Mat3 {
    Mat3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], last)
}

impl CbhModel {
    fn target(&self, p: &[f64]) -> Corners {
        Corners(std::array::from_fn(|i| {
            [self.base.0[i][0] + p[2 * i], self.base.0[i][1] + p[2 * i + 1]]
        }))
    }

    /// `A⁻¹` and `h`; not a number where the corners have no homography.
    fn solve(&self, p: &[f64]) -> (Matrix8, Vector8) {
        let (mut a, mut b) = (Matrix8::zeros(), Vector8::zeros());
        for (i, ([x, y], [u, v])) in self.base.0.into_iter().zip(self.target(p).0).enumerate() {
            let row_u = [x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y];
            let row_v = [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y];
            for k in 0..8 {
                a[(2 * i, k)] = row_u[k];
                a[(2 * i + 1, k)] = row_v[k];
            }
            (b[2 * i], b[2 * i + 1]) = (u, v);
        }
        let inverse = a.try_inverse().unwrap_or_else(|| Matrix8::from_element(f64::NAN));
        (inverse, inverse * b)
    }

    /// `∂h/∂p_k`.
    fn column(&self, inverse: &Matrix8, h: &Vector8, k: usize) -> Vector8 {
        let [x, y] = self.base.0[k / 2];
        inverse.column(k) * (h[6] * x + h[7] * y + 1.0)
    }
}

impl ProjectiveModel for CbhModel {
    type Params = NoParams;
    const NAME: &'static str = "cbh";
    const ALIASES: &'static [&'static str] = &["c8"];
    const SUMMARY: &'static str = "homography by the offsets of its four corners";
    const DOF: usize = 8;
    const MIN_POINTS: usize = 4;

    fn new(_: NoParams) -> Self {
        CbhModel::default()
    }
    fn set_base(&mut self, corners: &Corners) {
        self.base = *corners;
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        if p.iter().all(|v| *v == 0.0) {
            return Mat3::identity();
        }
        homography::from_corners(&self.base, &self.target(p)).unwrap_or_else(|| Mat3::from_element(f64::NAN))
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        for (p, base) in p.chunks_exact_mut(2).zip(&self.base.0) {
            let [u, v] = homography::apply(m, *base);
            p.copy_from_slice(&[u - base[0], v - base[1]]);
        }
        p.iter().all(|v| v.is_finite()).then_some(())
    }
    fn derivative(&self, p: &[f64], k: usize) -> Mat3 {
        let (inverse, h) = self.solve(p);
        entries(&self.column(&inverse, &h, k), 0.0)
    }
    fn derivatives(&self, p: &[f64], out: &mut [Mat3; MAX_DOF]) {
        let (inverse, h) = self.solve(p);
        for (k, out) in out.iter_mut().enumerate() {
            *out = entries(&self.column(&inverse, &h, k), 0.0);
        }
    }
    fn second_derivative(&self, p: &[f64], k: usize, l: usize) -> Option<Mat3> {
        let (inverse, h) = self.solve(p);
        // `∂A/∂p_a · h_b`: only row a is not zero.
        let mut rhs = Vector8::zeros();
        for (a, b) in [(k, l), (l, k)] {
            let ([x, y], column) = (self.base.0[a / 2], self.column(&inverse, &h, b));
            rhs[a] += x * column[6] + y * column[7];
        }
        Some(entries(&(inverse * rhs), 0.0))
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
