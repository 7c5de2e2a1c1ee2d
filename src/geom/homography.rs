//! Homographies: from four corners, from n points, and applied to points.

use super::{Corners, Mat3};
use nalgebra::{DMatrix, Matrix2, SMatrix, SVector, Vector3};

/// Image of `p` under `m`; not finite where the denominator vanishes.
pub fn apply(m: &Mat3, p: [f64; 2]) -> [f64; 2] {
    let h = m * Vector3::new(p[0], p[1], 1.0);
    [h[0] / h[2], h[1] / h[2]]
}

/// Images of four corners.
pub fn apply_corners(m: &Mat3, c: &Corners) -> Corners {
    Corners(c.0.map(|p| apply(m, p)))
}

/// Similarity that moves the centroid of `points` to the origin and scales their RMS distance from it to `√2`.
fn normalisation(points: &[[f64; 2]]) -> Option<Mat3> {
    let n = points.len() as f64;
    let (cx, cy) = points
        .iter()
        .fold((0.0, 0.0), |s, p| (s.0 + p[0] / n, s.1 + p[1] / n));
    let spread = (points
        .iter()
        .map(|p| (p[0] - cx).powi(2) + (p[1] - cy).powi(2))
        .sum::<f64>()
        / n)
        .sqrt();
    if spread.is_nan() || spread <= 0.0 || spread.is_infinite() {
        return None;
    }
    let s = std::f64::consts::SQRT_2 / spread;
    Some(Mat3::new(s, 0.0, -s * cx, 0.0, s, -s * cy, 0.0, 0.0, 1.0))
}

/// Homography that takes the corners `from` to the corners `to` exactly, scaled to `m22 = 1`.
/// `None` when either quadrilateral is degenerate.
pub fn from_corners(from: &Corners, to: &Corners) -> Option<Mat3> {
    let (a, b) = (normalisation(&from.0)?, normalisation(&to.0)?);
    let (from, to) = (apply_corners(&a, from), apply_corners(&b, to));
    let mut system = SMatrix::<f64, 8, 8>::zeros();
    let mut rhs = SVector::<f64, 8>::zeros();
    for i in 0..4 {
        let ([x, y], [u, v]) = (from.0[i], to.0[i]);
        for (k, w) in [x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y].into_iter().enumerate() {
            system[(2 * i, k)] = w;
        }
        for (k, w) in [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y].into_iter().enumerate() {
            system[(2 * i + 1, k)] = w;
        }
        (rhs[2 * i], rhs[2 * i + 1]) = (u, v);
    }
    let h = system.lu().solve(&rhs)?;
    finish(
        &Mat3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0),
        &a,
        &b,
    )
}

/// Least-squares homography of point pairs by the normalised DLT (Hartley 1997), scaled to `m22 = 1`. At least four
/// pairs; `None` when they do not determine one.
pub fn from_points(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
    let n = from.len();
    if n < 4 || to.len() != n {
        return None;
    }
    if let (4, Ok(f), Ok(t)) = (n, from.try_into(), to.try_into()) {
        return from_corners(&Corners(f), &Corners(t));
    }
    let (a, b) = (normalisation(from)?, normalisation(to)?);
    let mut rows = DMatrix::<f64>::zeros(2 * n, 9);
    for i in 0..n {
        let ([x, y], [u, v]) = (apply(&a, from[i]), apply(&b, to[i]));
        let row_u = [x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y, -u];
        let row_v = [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y, -v];
        for k in 0..9 {
            rows[(2 * i, k)] = row_u[k];
            rows[(2 * i + 1, k)] = row_v[k];
        }
    }
    // Null vector as the eigenvector of the smallest eigenvalue: coordinates are of order one.
    let eigen = (rows.transpose() * &rows).symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let h = eigen.eigenvectors.column(least);
    finish(
        &Mat3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]),
        &a,
        &b,
    )
}

fn finish(h: &Mat3, a: &Mat3, b: &Mat3) -> Option<Mat3> {
    let m = b.try_inverse()? * h * a;
    let m = m / m[(2, 2)];
    (m.iter().all(|v| v.is_finite()) && m.determinant().abs() > 1e-12).then_some(m)
}

/// `w_x = dw/dx` and the second derivatives `Ω_c = d²w_c/dx²` of the homography `m` at the point `x0`.
pub fn spatial_derivatives(m: &Mat3, x0: [f64; 2]) -> (Matrix2<f64>, [Matrix2<f64>; 2]) {
    let h = m * Vector3::new(x0[0], x0[1], 1.0);
    let (d, w) = (h[2], [h[0] / h[2], h[1] / h[2]]);
    let wx = Matrix2::from_fn(|c, k| (m[(c, k)] - m[(2, k)] * w[c]) / d);
    let omega = std::array::from_fn(|c| {
        Matrix2::from_fn(|k, l| -(m[(2, k)] * wx[(c, l)] + m[(2, l)] * wx[(c, k)]) / d)
    });
    (wx, omega)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn corners_and_points_recover_the_matrix(p in prop::array::uniform8(-0.1f64..0.1)) {
            let m = Mat3::new(1.0 + p[0], p[1], 300.0 * p[2], p[3], 1.0 + p[4], 300.0 * p[5], 3e-3 * p[6], 3e-3 * p[7], 1.0);
            let from = Corners::rect(40.0, 30.0, 120.0, 90.0);
            let got = from_corners(&from, &apply_corners(&m, &from)).unwrap();
            prop_assert!((got - m).abs().max() < 1e-8, "{got} {m}");
            let grid: Vec<[f64; 2]> = (0..25).map(|i| [40.0 + 30.0 * (i % 5) as f64, 30.0 + 20.0 * (i / 5) as f64]).collect();
            let images: Vec<[f64; 2]> = grid.iter().map(|&q| apply(&m, q)).collect();
            let got = from_points(&grid, &images).unwrap();
            prop_assert!((got - m).abs().max() < 1e-6, "{got} {m}");
        }
    }

    #[test]
    fn degenerate_input_has_no_homography() {
        let c = Corners::rect(0.0, 0.0, 10.0, 10.0);
        let line = Corners([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]);
        assert!(from_corners(&line, &c).is_none());
        assert!(from_corners(&c, &Corners([[5.0, 5.0]; 4])).is_none());
        assert!(from_points(&c.0[..3], &c.0[..3]).is_none());
    }
}
