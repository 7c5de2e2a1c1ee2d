//! Weights, Jacobians, fits and limits of the non-rigid warps.

use super::*;
use crate::ssm::{SplineBasis, TpsBasis};
use approx::assert_abs_diff_eq;

const RES: Resolution = Resolution { cols: 30, rows: 24 };

fn quad() -> Corners {
    Corners([[101.3, 80.2], [214.7, 71.9], [230.1, 178.4], [95.6, 165.0]])
}

fn bent<B: Basis>() -> FreeForm<B> {
    let mut f = FreeForm::<B>::new();
    f.init(&quad(), RES).unwrap();
    let p: Vec<f64> = (0..f.dof())
        .map(|k| 0.04 * ((k * 7919 % 13) as f64 - 6.0) / 6.0)
        .collect();
    f.set_state(&p).unwrap();
    f
}

fn weights_are_right<B: Basis>() {
    let f = bent::<B>();
    let n = f.basis.control().len();
    let [mut at, mut up, mut down] = std::array::from_fn(|_| vec![Weight::default(); n]);
    for i in (0..RES.len()).step_by(11) {
        let x = f.frame.grid_point(i);
        f.basis.weights_into(x, &mut at);
        // They sum to 1.
        assert_abs_diff_eq!(at.iter().map(|w| w.w).sum::<f64>(), 1.0, epsilon = 1e-9);
        let e = 1e-6;
        for (c, step) in [[e, 0.0], [0.0, e]].into_iter().enumerate() {
            f.basis.weights_into([x[0] + step[0], x[1] + step[1]], &mut up);
            f.basis.weights_into([x[0] - step[0], x[1] - step[1]], &mut down);
            for k in 0..n {
                let numeric = (up[k].w - down[k].w) / (2.0 * e);
                let analytic = if c == 0 { at[k].dx } else { at[k].dy };
                assert_abs_diff_eq!(analytic, numeric, epsilon = 1e-5);
            }
        }
    }
    // The net of a parallelogram under an affine motion: exact everywhere.
    let mut f = FreeForm::<B>::new();
    let region = Corners([[20.0, 30.0], [140.0, 45.0], [125.0, 135.0], [5.0, 120.0]]);
    f.init(&region, RES).unwrap();
    let m = Mat3::new(1.1, -0.2, 0.3, 0.15, 0.9, -0.1, 0.0, 0.0, 1.0);
    let p: Vec<f64> = f.carried(&m).flatten().collect();
    f.set_state(&p).unwrap();
    for i in 0..RES.len() {
        let u = f
            .frame
            .point_to_image(homography::apply(&m, f.frame.grid_point(i)));
        let w = f.point(i);
        assert_abs_diff_eq!(u[0], w[0], epsilon = 1e-4);
        assert_abs_diff_eq!(u[1], w[1], epsilon = 1e-4);
    }
}

/// Pulled back by `w_x`, a gradient at the warped points gives the same row as at the template.
fn approximate_undoes_warped<B: Basis>() {
    let f = bent::<B>();
    let n = RES.len();
    let gx: Vec<f32> = (0..n).map(|i| (i % 17) as f32 - 8.0).collect();
    let gy: Vec<f32> = (0..n).map(|i| (i % 23) as f32 - 11.0).collect();
    let (x, y) = (vec![0.0; n], vec![0.0; n]);
    let points = Points { x: &x, y: &y };
    let mut w: [Vec<f32>; 6] = std::array::from_fn(|_| vec![0.0; n]);
    f.spatial(&mut w);
    let (mut tx, mut ty) = (vec![0.0; n], vec![0.0; n]);
    let r = f.base().radius as f32;
    kernels::row_times(&gx, &gy, [&w[0], &w[1], &w[2], &w[3]], false, r, &mut tx, &mut ty);
    let [mut additive, mut approximate, mut warped, mut template] =
        std::array::from_fn(|_| Jacobian::new(n, f.dof()));
    let image = Gradient { x: &gx, y: &gy };
    let base = Gradient { x: &tx, y: &ty };
    f.jacobian_into(JacobianKind::Additive, image, points, 0, &mut additive);
    f.jacobian_into(JacobianKind::Approximate, base, points, 0, &mut approximate);
    f.jacobian_into(JacobianKind::Warped, image, points, 0, &mut warped);
    f.jacobian_into(JacobianKind::Template, base, points, 0, &mut template);
    for k in 0..f.dof() {
        for i in 0..n {
            assert_abs_diff_eq!(additive.col(k)[i], approximate.col(k)[i], epsilon = 0.02);
            assert_abs_diff_eq!(warped.col(k)[i], template.col(k)[i], epsilon = 0.02);
        }
    }
}

fn fits_give_the_state_back<B: Basis>() {
    let f = bent::<B>();
    let truth = f.state().to_vec();
    let from: Vec<[f64; 2]> = (0..RES.len())
        .map(|i| f.frame.point_to_image(f.frame.grid_point(i)))
        .collect();
    let mut to: Vec<[f64; 2]> = (0..RES.len()).map(|i| f.point(i)).collect();
    let rms = |f: &FreeForm<B>, to: &[[f64; 2]]| {
        let sum: f64 = (0..RES.len())
            .map(|i| (f.point(i)[0] - to[i][0]).powi(2) + (f.point(i)[1] - to[i][1]).powi(2))
            .sum();
        (sum / RES.len() as f64).sqrt()
    };
    let mut g = f.clone();
    let mut p = vec![0.0; f.dof()];
    g.fit_into(&from, &to, &mut p).unwrap();
    g.set_state(&p).unwrap();
    // The penalty on bending costs a little; this state bends as nothing real does.
    assert!(rms(&g, &to) < 0.2, "{}", rms(&g, &to));
    let exact = to.clone();
    for u in to.iter_mut().step_by(4) {
        u[0] += 35.0;
    }
    let mut estimator = Estimator::new(Default::default(), 5);
    g.set_state(&vec![0.0; f.dof()]).unwrap();
    g.estimate(&mut estimator, &from, &to).unwrap();
    assert!(rms(&g, &exact) < 0.3, "{}", rms(&g, &exact));
    let spoiled = |i: usize| i.is_multiple_of(4);
    assert!(
        estimator
            .inliers()
            .iter()
            .enumerate()
            .all(|(i, k)| !*k || !spoiled(i))
    );
    // Corners alone: the bend stays, and corners of its own change nothing.
    g.set_state(&truth).unwrap();
    let corners = g.corners();
    assert!(g.fit_corners(&corners).unwrap() < 1e-9);
    for (a, b) in g.state().iter().zip(&truth) {
        assert_abs_diff_eq!(a, b, epsilon = 1e-9);
    }
    let moved = corners.translated(7.0, -3.0);
    assert!(g.fit_corners(&moved).unwrap() < 1e-9);
}

#[test]
fn spline() {
    weights_are_right::<SplineBasis>();
    approximate_undoes_warped::<SplineBasis>();
    fits_give_the_state_back::<SplineBasis>();
}

#[test]
fn thin_plate() {
    weights_are_right::<TpsBasis>();
    approximate_undoes_warped::<TpsBasis>();
    fits_give_the_state_back::<TpsBasis>();
}

#[test]
fn bending_spares_the_plane_and_only_it() {
    let net = Resolution { cols: 4, rows: 3 };
    let r = bending_energy(net);
    let energy = |d: &dyn Fn(f64, f64) -> f64| {
        let v: Vec<f64> = (0..12).map(|k| d((k % 4) as f64, (k / 4) as f64)).collect();
        (0..144)
            .map(|i| r.get(i / 12, i % 12) * v[i / 12] * v[i % 12])
            .sum::<f64>()
    };
    assert_abs_diff_eq!(energy(&|x, y| 3.0 + 2.0 * x - y), 0.0, epsilon = 1e-12);
    assert!(energy(&|x, _| x * x) > 1.0 && energy(&|x, y| x * y) > 1.0 && energy(&|_, y| y * y) > 1.0);
}

#[test]
fn folded_nets_are_refused() {
    let mut f = FreeForm::<TpsBasis>::new();
    f.init(&quad(), RES).unwrap();
    let mut p = vec![0.0; f.dof()];
    // The control point in the middle beyond its neighbour.
    p[f.dof() / 2] = 3.0;
    assert!(matches!(f.set_state(&p), Err(TrackError::Degenerate(_))));
    assert!(f.update(Increment::Compositional, &p).is_err());
    assert!(f.state().iter().all(|v| *v == 0.0));
}
