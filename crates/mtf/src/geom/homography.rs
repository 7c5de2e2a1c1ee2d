//! Homographies: from four corners, from n points, and applied to points.

use super::{Corners, Mat3};
use nalgebra::{Matrix2, SMatrix, SVector, Vector3};

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

/// Homography through four point pairs, from the two projective frames they span: `H = Σ_i (µ_i/λ_i) b_i (a_j x a_k)ᵀ`.
/// Much faster than [`from_corners`]. `None` for other numbers of pairs, when three points of either side are nearly
/// collinear, and when the pairs are no view of one side of a plane (orientation or order changes).
pub fn from_four(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
    let (a, b): (&[[f64; 2]; 4], &[[f64; 2]; 4]) = (from.try_into().ok()?, to.try_into().ok()?);
    let (l, m) = (frame_weights(a)?, frame_weights(b)?);
    let k: [f64; 4] = std::array::from_fn(|i| m[i] / l[i]);
    // The denominators at the four points must have one sign, and the whole must keep orientation.
    if k.iter().any(|k| k.is_nan() || *k <= 0.0) {
        return None;
    }
    let h = |p: [f64; 2]| Vector3::new(p[0], p[1], 1.0);
    let mut out = Mat3::zeros();
    for i in 0..3 {
        let line = h(a[(i + 1) % 3]).cross(&h(a[(i + 2) % 3]));
        out += h(b[i]) * line.transpose() * k[i];
    }
    let out = out / out[(2, 2)];
    out.iter().all(|v| v.is_finite()).then_some(out)
}

/// Smallest triangle of four points, relative to their square extent, that spans a plane.
const THIN: f64 = 1e-4;

/// `(λ_0, λ_1, λ_2, o)` with `o p_3 = Σ λ_i p_i` and `o` the doubled area of `p_0 p_1 p_2`.
fn frame_weights(p: &[[f64; 2]; 4]) -> Option<[f64; 4]> {
    let area =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let w = [
        area(p[3], p[1], p[2]),
        area(p[0], p[3], p[2]),
        area(p[0], p[1], p[3]),
        area(p[0], p[1], p[2]),
    ];
    let extent = (0..2)
        .map(|c| {
            let (low, high) = p
                .iter()
                .fold((f64::MAX, f64::MIN), |(l, h), q| (l.min(q[c]), h.max(q[c])));
            high - low
        })
        .fold(0.0, f64::max);
    w.iter().all(|w| w.abs() > THIN * extent * extent).then_some(w)
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
    // Blocks `Σ k z zᵀ`, `z = (x, y, 1)`, of `AᵀA` with the rows `(z, 0, -u z)` and `(0, z, -v z)`.
    let [mut one, mut by_u, mut by_v, mut by_size] = [Mat3::zeros(); 4];
    for (p, q) in from.iter().zip(to) {
        let ([x, y], [u, v]) = (apply(&a, *p), apply(&b, *q));
        let z = Vector3::new(x, y, 1.0);
        let zz = z * z.transpose();
        one += zz;
        by_u += zz * u;
        by_v += zz * v;
        by_size += zz * (u * u + v * v);
    }
    let mut system = SMatrix::<f64, 9, 9>::zeros();
    for (r, c, block) in [
        (0, 0, one),
        (3, 3, one),
        (0, 6, -by_u),
        (6, 0, -by_u),
        (3, 6, -by_v),
        (6, 3, -by_v),
        (6, 6, by_size),
    ] {
        system.fixed_view_mut::<3, 3>(r, c).copy_from(&block);
    }
    // Null vector as the eigenvector of the smallest eigenvalue: coordinates are of order one.
    let eigen = system.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let h = eigen.eigenvectors.column(least);
    finish(
        &Mat3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]),
        &a,
        &b,
    )
}

/// Normal equations of the reprojection error `Σ |w(a_i) - b_i|²` in the eight entries of `m` other than `m22 = 1`.
struct Reprojection {
    cost: f64,
    hessian: SMatrix<f64, 8, 8>,
    gradient: SVector<f64, 8>,
}

fn reprojection(m: &Mat3, a: &Mat3, b: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]]) -> Reprojection {
    let [sa, ax, ay] = [a[(0, 0)], a[(0, 2)], a[(1, 2)]];
    let [sb, bx, by] = [b[(0, 0)], b[(0, 2)], b[(1, 2)]];
    let row = |r: usize| [m[(r, 0)], m[(r, 1)], m[(r, 2)]];
    let [m0, m1, m2] = [row(0), row(1), row(2)];
    // Sums of products of `z = (x, y, 1)/D`, alone and with the image point.
    let (mut zz, mut zu, mut zv, mut zs) = ([0.0; 6], [0.0; 5], [0.0; 5], [0.0; 3]);
    let (mut gu, mut gv, mut gp) = ([0.0; 3], [0.0; 3], [0.0; 2]);
    let mut cost = 0.0;
    for (p, q) in from.iter().zip(to) {
        let (x, y) = (sa * p[0] + ax, sa * p[1] + ay);
        let d = 1.0 / (m2[0] * x + m2[1] * y + m2[2]);
        let u = (m0[0] * x + m0[1] * y + m0[2]) * d;
        let v = (m1[0] * x + m1[1] * y + m1[2]) * d;
        let (ru, rv) = (u - sb * q[0] - bx, v - sb * q[1] - by);
        cost += ru * ru + rv * rv;
        let z = [x * d, y * d, d];
        let products = [z[0] * z[0], z[0] * z[1], z[1] * z[1], z[0] * d, z[1] * d, d * d];
        for k in 0..6 {
            zz[k] += products[k];
        }
        for k in 0..5 {
            zu[k] += products[k] * u;
            zv[k] += products[k] * v;
        }
        let (size, along) = (u * u + v * v, u * ru + v * rv);
        for k in 0..3 {
            zs[k] += products[k] * size;
            gu[k] += z[k] * ru;
            gv[k] += z[k] * rv;
        }
        gp[0] -= z[0] * along;
        gp[1] -= z[1] * along;
    }
    let mut h = SMatrix::<f64, 8, 8>::zeros();
    let symmetric = [[0, 1, 3], [1, 2, 4], [3, 4, 5]];
    for r in 0..3 {
        for c in 0..3 {
            h[(r, c)] = zz[symmetric[r][c]];
            h[(r + 3, c + 3)] = zz[symmetric[r][c]];
        }
        for c in 0..2 {
            let (u, v) = (-zu[symmetric[r][c]], -zv[symmetric[r][c]]);
            (h[(r, c + 6)], h[(c + 6, r)]) = (u, u);
            (h[(r + 3, c + 6)], h[(c + 6, r + 3)]) = (v, v);
        }
    }
    for r in 0..2 {
        for c in 0..2 {
            h[(r + 6, c + 6)] = zs[symmetric[r][c]];
        }
    }
    let g = [gu[0], gu[1], gu[2], gv[0], gv[1], gv[2], gp[0], gp[1]];
    Reprojection {
        cost,
        hessian: h,
        gradient: SVector::from(g),
    }
}

/// Homography of least reprojection error `Σ |w(a_i) - b_i|²` near `m`, by at most `iterations` Levenberg-Marquardt
/// steps. At least four pairs; `None` for fewer or when the error is not finite.
pub fn refine(m: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], iterations: usize) -> Option<Mat3> {
    if from.len() < 4 || from.len() != to.len() {
        return None;
    }
    let (a, b) = (normalisation(from)?, normalisation(to)?);
    let mut m = b * m * a.try_inverse()?;
    m /= m[(2, 2)];
    let mut at = reprojection(&m, &a, &b, from, to);
    if !at.cost.is_finite() {
        return None;
    }
    let mut lambda = 1e-5;
    for _ in 0..iterations {
        let mut damped = at.hessian;
        for k in 0..8 {
            damped[(k, k)] *= 1.0 + lambda;
        }
        let Some(step) = damped.cholesky().map(|c| c.solve(&at.gradient)) else {
            break;
        };
        let d = Mat3::new(
            step[0], step[1], step[2], step[3], step[4], step[5], step[6], step[7], 0.0,
        );
        let next = reprojection(&(m - d), &a, &b, from, to);
        let gain = at.cost - next.cost;
        if gain >= 0.0 {
            m -= d;
            at = next;
            lambda = (lambda * 0.1).max(1e-12);
        } else {
            lambda *= 10.0;
        }
        // Coordinates are of order one.
        if step.amax() < 1e-10 || (0.0..1e-9 * at.cost).contains(&gain) {
            break;
        }
    }
    finish(&m, &a, &b)
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
            let four = [0, 4, 22, 15].map(|i| (grid[i], images[i]));
            let got = from_four(&four.map(|f| f.0), &four.map(|f| f.1)).unwrap();
            prop_assert!((got - m).abs().max() < 1e-7, "{got} {m}");
        }

        #[test]
        fn refinement_finds_the_least_reprojection_error(
            p in prop::array::uniform8(-0.1f64..0.1),
            noise in prop::collection::vec(prop::array::uniform2(-1.0f64..1.0), 25),
        ) {
            let m = Mat3::new(1.0 + p[0], p[1], 300.0 * p[2], p[3], 1.0 + p[4], 300.0 * p[5], 3e-3 * p[6], 3e-3 * p[7], 1.0);
            let from: Vec<[f64; 2]> = (0..25).map(|i| [40.0 + 30.0 * (i % 5) as f64, 30.0 + 20.0 * (i / 5) as f64]).collect();
            let to: Vec<[f64; 2]> = from.iter().zip(&noise).map(|(&q, d)| {
                let u = apply(&m, q);
                [u[0] + d[0], u[1] + d[1]]
            }).collect();
            let cost = |m: &Mat3| -> f64 {
                from.iter().zip(&to).map(|(&q, u)| (apply(m, q)[0] - u[0]).powi(2) + (apply(m, q)[1] - u[1]).powi(2)).sum()
            };
            let best = refine(&m, &from, &to, 20).unwrap();
            // The same from another start, and no neighbour is better.
            let again = refine(&from_points(&from, &to).unwrap(), &from, &to, 20).unwrap();
            prop_assert!((cost(&best) - cost(&again)).abs() < 1e-7 * cost(&best));
            for k in 0..8 {
                for step in [-1e-5, 1e-5] {
                    let mut near = best;
                    near[(k / 3, k % 3)] *= 1.0 + step;
                    prop_assert!(cost(&near) >= cost(&best) * (1.0 - 1e-8));
                }
            }
        }
    }

    #[test]
    fn degenerate_input_has_no_homography() {
        let c = Corners::rect(0.0, 0.0, 10.0, 10.0);
        let line = Corners([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]);
        assert!(from_corners(&line, &c).is_none());
        assert!(from_corners(&c, &Corners([[5.0, 5.0]; 4])).is_none());
        assert!(from_points(&c.0[..3], &c.0[..3]).is_none());
        assert!(from_four(&line.0, &c.0).is_none() && from_four(&c.0, &line.0).is_none());
        // Mirrored, and folded.
        let [p, q, r, s] = c.0;
        assert!(from_four(&c.0, &[q, p, s, r]).is_none());
        assert!(from_four(&c.0, &[p, r, q, s]).is_none());
    }
}
