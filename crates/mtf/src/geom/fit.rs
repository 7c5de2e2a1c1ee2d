//! Least-squares warps of point pairs, in closed form from their moments.
//!
//! Every fit minimises `Σ |M a_i - b_i|²` over a family of 3x3 matrices and is `None` where the pairs do not determine
//! one. Points are centred first: sums of raw coordinates would lose digits. Homographies are in [`super::homography`].

use super::Mat3;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// Means and second moments of point pairs `a_i -> b_i`.
#[derive(Clone, Copy, Debug)]
pub struct Moments {
    from: Vector2<f64>,
    to: Vector2<f64>,
    /// `Σ (a - ā)(a - ā)ᵀ`.
    xx: Matrix2<f64>,
    /// `Σ (b - b̄)(a - ā)ᵀ`.
    ux: Matrix2<f64>,
}

/// Smallest spread across the narrowest direction, relative to the widest, that counts as two-dimensional.
const FLAT: f64 = 1e-12;

impl Moments {
    /// Moments of the pairs; `None` without any, or when the two lists differ in length.
    pub fn new(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Self> {
        if from.is_empty() || from.len() != to.len() {
            return None;
        }
        let n = from.len() as f64;
        let mean = |s: &[[f64; 2]]| {
            let sum = s.iter().fold([0.0; 2], |m, p| [m[0] + p[0], m[1] + p[1]]);
            Vector2::new(sum[0] / n, sum[1] / n)
        };
        let (mean_from, mean_to) = (mean(from), mean(to));
        let (mut xx, mut ux) = (Matrix2::zeros(), Matrix2::zeros());
        for (a, b) in from.iter().zip(to) {
            let (x, u) = (Vector2::from(*a) - mean_from, Vector2::from(*b) - mean_to);
            xx += x * x.transpose();
            ux += u * x.transpose();
        }
        Some(Moments {
            from: mean_from,
            to: mean_to,
            xx,
            ux,
        })
    }

    /// The affine matrix with linear part `a` that takes one mean to the other.
    fn with_linear(&self, a: &Matrix2<f64>) -> Option<Mat3> {
        let t = self.to - a * self.from;
        let m = Mat3::new(
            a[(0, 0)],
            a[(0, 1)],
            t[0],
            a[(1, 0)],
            a[(1, 1)],
            t[1],
            0.0,
            0.0,
            1.0,
        );
        m.iter().all(|v| v.is_finite()).then_some(m)
    }

    /// Translation; one pair suffices.
    pub fn translation(&self) -> Option<Mat3> {
        self.with_linear(&Matrix2::identity())
    }

    /// `(c, s)` of the similarity `[c -s; s c]`.
    fn similarity_parts(&self) -> Option<(f64, f64)> {
        let size = self.xx.trace();
        let c = self.ux.trace() / size;
        let s = (self.ux[(1, 0)] - self.ux[(0, 1)]) / size;
        (size > 0.0).then_some((c, s))
    }

    /// Rotation and translation; two pairs.
    pub fn isometry(&self) -> Option<Mat3> {
        let (c, s) = self.similarity_parts()?;
        let norm = libm::hypot(c, s);
        let (c, s) = (c / norm, s / norm);
        self.with_linear(&Matrix2::new(c, -s, s, c))
    }

    /// Isotropic scale and translation; two pairs.
    pub fn isotropic_scale(&self) -> Option<Mat3> {
        let (c, _) = self.similarity_parts()?;
        self.with_linear(&Matrix2::new(c, 0.0, 0.0, c))
    }

    /// Scales along both axes and translation; two pairs that differ in both coordinates.
    pub fn axis_scales(&self) -> Option<Mat3> {
        let (xx, yy) = (self.xx[(0, 0)], self.xx[(1, 1)]);
        let flat = xx.min(yy) <= FLAT * xx.max(yy);
        let (sx, sy) = (self.ux[(0, 0)] / xx, self.ux[(1, 1)] / yy);
        (!flat).then(|| self.with_linear(&Matrix2::new(sx, 0.0, 0.0, sy)))?
    }

    /// Rotation, isotropic scale and translation; two pairs.
    pub fn similarity(&self) -> Option<Mat3> {
        let (c, s) = self.similarity_parts()?;
        self.with_linear(&Matrix2::new(c, -s, s, c))
    }

    /// True when the points lie on a line.
    fn collinear(&self) -> bool {
        let size = self.xx.trace();
        self.xx.determinant().is_nan() || self.xx.determinant() <= FLAT * size * size
    }

    /// Linear part `[a -b; b c]` and translation; three pairs.
    pub fn scales_and_rotation(&self) -> Option<Mat3> {
        if self.collinear() {
            return None;
        }
        let (xx, xy, yy) = (self.xx[(0, 0)], self.xx[(0, 1)], self.xx[(1, 1)]);
        let h = Matrix3::new(xx, -xy, 0.0, -xy, xx + yy, xy, 0.0, xy, yy);
        let rhs = Vector3::new(
            self.ux[(0, 0)],
            self.ux[(1, 0)] - self.ux[(0, 1)],
            self.ux[(1, 1)],
        );
        let [a, b, c] = (h.try_inverse()? * rhs).into();
        self.with_linear(&Matrix2::new(a, -b, b, c))
    }

    /// Affine; three pairs.
    pub fn affine(&self) -> Option<Mat3> {
        if self.collinear() {
            return None;
        }
        self.with_linear(&(self.ux * self.xx.try_inverse()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::homography::apply;
    use proptest::prelude::*;

    type Fit = fn(&Moments) -> Option<Mat3>;

    /// Each family with a member of given parameters.
    fn families(q: [f64; 6]) -> [(Fit, Mat3); 7] {
        let [a, b, c, d, tx, ty] = q;
        let m = |l: [f64; 4]| Mat3::new(l[0], l[1], tx, l[2], l[3], ty, 0.0, 0.0, 1.0);
        [
            (Moments::translation, m([1.0, 0.0, 0.0, 1.0])),
            (Moments::isometry, m([b.cos(), -b.sin(), b.sin(), b.cos()])),
            (Moments::isotropic_scale, m([1.0 + a, 0.0, 0.0, 1.0 + a])),
            (Moments::axis_scales, m([1.0 + a, 0.0, 0.0, 1.0 + d])),
            (Moments::similarity, m([1.0 + a, -b, b, 1.0 + a])),
            (Moments::scales_and_rotation, m([1.0 + a, -b, b, 1.0 + d])),
            (Moments::affine, m([1.0 + a, b, c, 1.0 + d])),
        ]
    }

    proptest! {
        #[test]
        fn members_are_recovered_and_noise_is_fitted_best(
            q in prop::array::uniform6(-0.4f64..0.4),
            points in prop::collection::vec(prop::array::uniform2(0.0f64..600.0), 6..20),
            noise in prop::collection::vec(prop::array::uniform2(-1.0f64..1.0), 20),
        ) {
            for (k, (fit, m)) in families(q).into_iter().enumerate() {
                let exact: Vec<[f64; 2]> = points.iter().map(|&x| apply(&m, x)).collect();
                let got = fit(&Moments::new(&points, &exact).unwrap());
                prop_assume!(got.is_some());
                prop_assert!((got.unwrap() - m).abs().max() < 1e-8, "{k}");
                let noisy: Vec<[f64; 2]> = exact.iter().zip(&noise).map(|(p, d)| [p[0] + d[0], p[1] + d[1]]).collect();
                let best = fit(&Moments::new(&points, &noisy).unwrap()).unwrap();
                let cost = |m: &Mat3| -> f64 {
                    points.iter().zip(&noisy).map(|(&x, u)| {
                        let w = apply(m, x);
                        (w[0] - u[0]).powi(2) + (w[1] - u[1]).powi(2)
                    }).sum()
                };
                // No neighbour within the family is better.
                for i in 0..6 {
                    for step in [-1e-3, 1e-3] {
                        let mut d = [0.0; 6];
                        d[i] = step;
                        let near = families(d)[k].1 * best;
                        let inside = k != 5 || (near[(0, 1)] + near[(1, 0)]).abs() < 1e-9;
                        prop_assert!(!inside || cost(&near) >= cost(&best) - 1e-7, "{k} {i}");
                    }
                }
            }
        }
    }

    #[test]
    fn degenerate_pairs_determine_nothing() {
        let line = [[1.0, 1.0], [2.0, 2.0], [3.0, 3.0], [4.0, 4.0]];
        let m = Moments::new(&line, &line).unwrap();
        assert!(m.affine().is_none() && m.scales_and_rotation().is_none());
        assert!(m.similarity().is_some());
        let same = Moments::new(&[[1.0, 2.0]; 3], &[[3.0, 4.0]; 3]).unwrap();
        assert!(same.similarity().is_none() && same.isometry().is_none() && same.axis_scales().is_none());
        assert_eq!(same.translation().unwrap()[(0, 2)], 2.0);
        assert!(Moments::new(&[], &[]).is_none() && Moments::new(&line, &line[..2]).is_none());
    }
}
