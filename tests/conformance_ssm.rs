//! What every state space model must satisfy: the algebra battery is instantiated for each model's type, the rest
//! loops over the table.

mod common;

use mtf_eval::geom::solve::SymMatrix;
use mtf_eval::geom::{Corners, Mat3, homography};
use mtf_eval::kernels::Jacobian;
use mtf_eval::params::Resolution;
use mtf_eval::ssm::{
    Affine, Gradient, Homography, ImageHessian, Increment, Isometry, JacobianKind, Points, Projective,
    ProjectiveModel, SSMS, Similitude, SsmModel, StateSpaceModel, Translation,
};
use rand::RngExt;
use rand_pcg::Pcg64;

const RES: Resolution = Resolution { cols: 7, rows: 6 };

fn quad() -> Corners {
    Corners([[101.3, 80.2], [214.7, 71.9], [230.1, 178.4], [95.6, 165.0]])
}

fn random_state(dof: usize, size: f64, r: &mut Pcg64) -> Vec<f64> {
    (0..dof).map(|_| r.random_range(-size..size)).collect()
}

fn close(a: &Mat3, b: &Mat3, tolerance: f64, what: &str) {
    let (a, b) = (a / a[(2, 2)], b / b[(2, 2)]);
    assert!((a - b).abs().max() < tolerance, "{what}: {a} {b}");
}

/// Laws of the algebra and derivatives of one projective model.
fn battery<W: ProjectiveModel>() {
    let mut r = common::rng(7);
    let mut ssm = Projective::<W>::new();
    ssm.init(&quad(), RES).unwrap();
    let model = ssm.model().clone();
    let state = |m: &Mat3| {
        let mut p = vec![0.0; W::DOF];
        model.state(m, &mut p).unwrap();
        p
    };
    assert!((model.matrix(&vec![0.0; W::DOF]) - Mat3::identity()).abs().max() < 1e-15);
    for _ in 0..50 {
        let [p, q, s]: [Vec<f64>; 3] = std::array::from_fn(|_| random_state(W::DOF, 0.15, &mut r));
        let (mp, mq, ms) = (model.matrix(&p), model.matrix(&q), model.matrix(&s));
        // State of a matrix, closure, associativity, identity, inverse.
        for (a, b) in state(&mp).iter().zip(&p) {
            assert!((a - b).abs() < 1e-10, "{}", W::NAME);
        }
        let compose = |a: &Mat3, b: &Mat3| model.matrix(&state(&(a * b)));
        close(&compose(&mp, &mq), &(mp * mq), 1e-10, W::NAME);
        close(
            &compose(&compose(&mp, &mq), &ms),
            &compose(&mp, &compose(&mq, &ms)),
            1e-10,
            W::NAME,
        );
        close(
            &compose(&mp, &model.inverse(&p).unwrap()),
            &Mat3::identity(),
            1e-10,
            W::NAME,
        );
        // Updates through the interface.
        ssm.set_state(&p).unwrap();
        ssm.update(Increment::Compositional, &q).unwrap();
        close(ssm.matrix(), &(mp * mq), 1e-10, W::NAME);
        ssm.update(Increment::InverseCompositional, &q).unwrap();
        close(ssm.matrix(), &mp, 1e-10, W::NAME);
        ssm.update(Increment::Additive, &q).unwrap();
        for (k, v) in ssm.state().iter().enumerate() {
            assert!((v - p[k] - q[k]).abs() < 1e-10, "{}", W::NAME);
        }
        // First and second derivatives of the warp.
        let x0 = [r.random_range(-1.0..1.0), r.random_range(-1.0..1.0)];
        for at in [vec![0.0; W::DOF], p.clone()] {
            let nudged = |k: usize, h: f64| {
                let mut q = at.clone();
                q[k] += h;
                q
            };
            let jacobian = ssm.warp_jacobian(&at, x0);
            for k in 0..W::DOF {
                let h = 1e-5;
                let w = |h: f64| homography::apply(&model.matrix(&nudged(k, h)), x0);
                for c in 0..2 {
                    let numeric = (w(h)[c] - w(-h)[c]) / (2.0 * h);
                    assert!(
                        (jacobian[c][k] - numeric).abs() < 1e-8 * (1.0 + numeric.abs()),
                        "{} {k}",
                        W::NAME
                    );
                }
                for l in 0..W::DOF {
                    let (up, down) = (
                        ssm.warp_jacobian(&nudged(l, h), x0),
                        ssm.warp_jacobian(&nudged(l, -h), x0),
                    );
                    let second = ssm.warp_hessian(&at, x0, k, l);
                    for c in 0..2 {
                        let numeric = (up[c][k] - down[c][k]) / (2.0 * h);
                        assert!(
                            (second[c] - numeric).abs() < 1e-7 * (1.0 + numeric.abs()),
                            "{} {k} {l}",
                            W::NAME
                        );
                    }
                }
            }
        }
        // Fits give the state back, from the corners and from many points.
        let points: Vec<[f64; 2]> = (0..12)
            .map(|_| [r.random_range(-1.0..1.0), r.random_range(-1.0..1.0)])
            .collect();
        let images: Vec<[f64; 2]> = points.iter().map(|&x| homography::apply(&mp, x)).collect();
        for n in [W::MIN_POINTS.max(4), 12] {
            let mut fitted = vec![0.0; W::DOF];
            model.fit(&points[..n], &images[..n], &mut fitted).unwrap();
            for (a, b) in fitted.iter().zip(&p) {
                assert!((a - b).abs() < 1e-8, "{} {n}: {fitted:?} {p:?}", W::NAME);
            }
        }
        ssm.set_state(&p).unwrap();
        let corners = ssm.corners();
        ssm.set_state(&q).unwrap();
        assert!(ssm.fit_corners(&corners).unwrap() < 1e-8);
        assert!(common::alignment_error(&ssm.corners(), &corners) < 1e-8);
    }
    let mut p = vec![0.0; W::DOF];
    assert!(model.fit(&[], &[], &mut p).is_none());
}

/// The names the battery below covers; the table may hold no others.
const COVERED: [(&str, fn()); 5] = [
    (Translation::NAME, battery::<mtf_eval::ssm::TranslationModel>),
    (Isometry::NAME, battery::<mtf_eval::ssm::IsometryModel>),
    (Similitude::NAME, battery::<mtf_eval::ssm::SimilitudeModel>),
    (Affine::NAME, battery::<mtf_eval::ssm::AffineModel>),
    (Homography::NAME, battery::<mtf_eval::ssm::HomographyModel>),
];

#[test]
fn algebra_and_derivatives() {
    let mut names: Vec<_> = COVERED.iter().map(|c| c.0).collect();
    let mut listed: Vec<_> = SSMS.iter().map(|e| e.name).collect();
    names.sort_unstable();
    listed.sort_unstable();
    assert_eq!(names, listed);
    COVERED.iter().for_each(|(_, battery)| battery());
}

#[test]
fn any_quadrilateral_is_represented_exactly() {
    for entry in SSMS {
        let mut ssm = (entry.build)(&[]).unwrap();
        ssm.init(&quad(), RES).unwrap();
        assert!(common::alignment_error(&ssm.corners(), &quad()) < 1e-10);
        let (mut x, mut y) = (vec![0.0; RES.len()], vec![0.0; RES.len()]);
        ssm.warp_into(&mut x, &mut y);
        for (i, at) in [0, RES.cols - 1, RES.len() - 1, RES.len() - RES.cols]
            .into_iter()
            .enumerate()
        {
            let [cx, cy] = quad().0[i];
            assert!(
                (f64::from(x[at]) - cx).abs() < 1e-4 && (f64::from(y[at]) - cy).abs() < 1e-4,
                "{}",
                entry.name
            );
        }
    }
}

/// `d/dp I(w(x; p))` in all four senses, on an analytic image, against central differences.
#[test]
fn jacobians_and_curvatures_agree_with_central_differences() {
    let waves = common::Waves::new(2);
    for entry in SSMS {
        let mut r = common::rng(11);
        for round in 0..3 {
            let mut ssm = (entry.build)(&[]).unwrap();
            ssm.init(&quad(), RES).unwrap();
            let s = ssm.dof();
            let p = random_state(s, if round == 0 { 1e-12 } else { 0.1 }, &mut r);
            let n = RES.len();
            let points = |ssm: &dyn StateSpaceModel| {
                let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
                ssm.warp_into(&mut x, &mut y);
                (x, y)
            };
            // Exact derivatives of the analytic image at the template points and at the current points.
            let derivatives = |x: &[f32], y: &[f32], scale: f64| {
                let d = |fx: f64, fy: f64, k: usize| {
                    let h = 1e-3;
                    let f = |a: f64, b: f64| waves.at(fx + a * h, fy + b * h);
                    match k {
                        0 => (f(1.0, 0.0) - f(-1.0, 0.0)) / (2.0 * h) * scale,
                        1 => (f(0.0, 1.0) - f(0.0, -1.0)) / (2.0 * h) * scale,
                        2 => (f(1.0, 0.0) + f(-1.0, 0.0) - 2.0 * f(0.0, 0.0)) / (h * h) * scale * scale,
                        3 => {
                            (f(1.0, 1.0) + f(-1.0, -1.0) - f(1.0, -1.0) - f(-1.0, 1.0)) / (4.0 * h * h)
                                * scale
                                * scale
                        }
                        _ => (f(0.0, 1.0) + f(0.0, -1.0) - 2.0 * f(0.0, 0.0)) / (h * h) * scale * scale,
                    }
                };
                let column = |k: usize| {
                    (0..n)
                        .map(|i| d(x[i].into(), y[i].into(), k) as f32)
                        .collect::<Vec<f32>>()
                };
                std::array::from_fn::<_, 5, _>(column)
            };
            let (x0, y0) = points(&*ssm);
            let template = derivatives(&x0, &y0, ssm.radius());
            ssm.set_state(&p).unwrap();
            let (x, y) = points(&*ssm);
            let current = derivatives(&x, &y, 1.0);
            let weights: Vec<f32> = (0..n).map(|_| r.random_range(-1.0..1.0)).collect();
            for kind in [
                JacobianKind::Template,
                JacobianKind::Warped,
                JacobianKind::Additive,
                JacobianKind::Approximate,
            ] {
                let d = if kind.of_template() { &template } else { &current };
                let mut j = Jacobian::new(n, s);
                let gradient = Gradient { x: &d[0], y: &d[1] };
                ssm.jacobian_into(kind, gradient, Points { x: &x, y: &y }, 0, &mut j);
                let mut h = SymMatrix::new(s);
                let hessian = ImageHessian {
                    xx: &d[2],
                    xy: &d[3],
                    yy: &d[4],
                };
                ssm.curvature_into(kind, &weights, gradient, hessian, &mut h);
                // The function of Δ whose derivatives these are, at one grid point.
                let mut moving = (entry.build)(&[]).unwrap();
                moving.init(&quad(), RES).unwrap();
                let mut image = |delta: &[f64]| -> Vec<f64> {
                    // Template kinds see the template image moved rigidly with the present warp.
                    let (state, how): (&[f64], _) = match kind {
                        JacobianKind::Template => (&vec![0.0; s], Increment::Compositional),
                        JacobianKind::Warped => (&p, Increment::Compositional),
                        JacobianKind::Additive | JacobianKind::Approximate => (&p, Increment::Additive),
                    };
                    moving.set_state(state).unwrap();
                    let before = (kind == JacobianKind::Approximate).then(|| moving.corners());
                    moving.update(how, delta).unwrap();
                    let (corners, base) = (moving.corners(), quad());
                    let total = homography::from_corners(&base, &corners).unwrap();
                    let back = before.map(|b| homography::from_corners(&b, &base).unwrap());
                    (0..n)
                        .map(|i| {
                            let u = homography::apply(&total, [x0[i].into(), y0[i].into()]);
                            let u = back.map_or(u, |b| homography::apply(&b, u));
                            waves.at(u[0], u[1])
                        })
                        .collect()
                };
                let nudge = |steps: &[(usize, f64)]| {
                    let mut d = vec![0.0; s];
                    steps.iter().for_each(|&(k, h)| d[k] += h);
                    d
                };
                for k in 0..s {
                    let e = 1e-5;
                    let (up, down) = (image(&nudge(&[(k, e)])), image(&nudge(&[(k, -e)])));
                    let numeric: Vec<f64> = up.iter().zip(&down).map(|(a, b)| (a - b) / (2.0 * e)).collect();
                    let size = numeric.iter().map(|v| v * v).sum::<f64>().sqrt();
                    let diff: f64 = numeric
                        .iter()
                        .zip(j.col(k))
                        .map(|(a, &b)| (a - f64::from(b)).powi(2))
                        .sum::<f64>()
                        .sqrt();
                    // Single-precision points carry 1e-5 px into the gradients of the image.
                    assert!(
                        diff < 1e-5 * size,
                        "{} {kind:?} {k}: {:e}",
                        entry.name,
                        diff / size
                    );
                }
                let e = 1e-3;
                let weighted = |v: Vec<f64>| {
                    v.iter()
                        .zip(&weights)
                        .map(|(a, &w)| a * f64::from(w))
                        .sum::<f64>()
                };
                let mut worst: f64 = 0.0;
                let mut size: f64 = 0.0;
                for k in 0..s {
                    for l in 0..s {
                        let mut at = |a: f64, b: f64| weighted(image(&nudge(&[(k, a * e), (l, b * e)])));
                        let numeric =
                            (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0)) / (4.0 * e * e);
                        // Composition is differentiated at Δ = 0 along straight lines in Δ, as the expressions are.
                        worst = worst.max((numeric - h.get(k, l)).abs());
                        size = size.max(numeric.abs());
                    }
                }
                assert!(worst < 1e-3 * size, "{} {kind:?}: {:e}", entry.name, worst / size);
            }
        }
    }
}

#[test]
fn bad_regions_and_states_are_refused_and_change_nothing() {
    for entry in SSMS {
        let mut ssm = (entry.build)(&[]).unwrap();
        for bad in [
            Corners([[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]]),
            Corners([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [30.0, 0.0]]),
            Corners::rect(5.0, 5.0, 0.1, 0.1),
            Corners::rect(f64::NAN, 0.0, 10.0, 10.0),
        ] {
            assert!(ssm.init(&bad, RES).is_err(), "{}", entry.name);
        }
        ssm.init(&quad(), RES).unwrap();
        let before = ssm.corners();
        assert!(
            ssm.update(Increment::Additive, &vec![f64::NAN; ssm.dof()])
                .is_err()
        );
        assert!(
            ssm.update(Increment::Compositional, &vec![f64::INFINITY; ssm.dof()])
                .is_err()
        );
        assert!(ssm.set_state(&vec![f64::NAN; ssm.dof()]).is_err());
        assert_eq!(ssm.corners(), before, "{}", entry.name);
    }
    let mut h = Homography::new();
    h.init(&quad(), RES).unwrap();
    assert!(h.set_state(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0]).is_err());
    assert!(
        h.set_state(&[-0.999, 0.0, 0.0, 0.0, -0.999, 0.0, 0.0, 0.0])
            .is_err()
    );
}

#[test]
fn rebasing_keeps_the_grid_on_the_object() {
    for entry in SSMS {
        let mut r = common::rng(5);
        let mut ssm = (entry.build)(&[]).unwrap();
        ssm.init(&quad(), RES).unwrap();
        let old: Vec<[f64; 2]> = ssm
            .grid()
            .x
            .iter()
            .zip(ssm.grid().y)
            .map(|(&x, &y)| [f64::from(x), f64::from(y)])
            .collect();
        let moved = homography::apply_corners(&common::perturbation(&quad(), 12.0, &mut r), &quad());
        let from_new = ssm.rebase(&moved).unwrap();
        assert!(common::alignment_error(&ssm.corners(), &moved) < 1e-9);
        for (i, p) in old.iter().enumerate() {
            let q = homography::apply(&from_new, [ssm.grid().x[i].into(), ssm.grid().y[i].into()]);
            assert!(
                (q[0] - p[0]).abs() < 1e-6 && (q[1] - p[1]).abs() < 1e-6,
                "{}",
                entry.name
            );
        }
    }
}
