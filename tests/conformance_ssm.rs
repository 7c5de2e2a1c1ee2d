//! What every state space model must satisfy: the algebra battery is instantiated for each model's type, the rest
//! loops over the table.

mod common;

use mtf_eval::diagnose;
use mtf_eval::geom::{Corners, Mat3, homography};
use mtf_eval::params::Resolution;
use mtf_eval::ssm::{
    Affine, Homography, Increment, Isometry, Projective, ProjectiveModel, SSMS, Similitude, SsmModel,
    StateSpaceModel, Translation,
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

#[test]
fn jacobians_and_pixel_hessians_agree_with_central_differences() {
    for entry in SSMS {
        for (seed, size) in [(1, 0.0), (2, 0.1), (3, 0.1)] {
            for c in diagnose::warp(entry, &quad(), RES, size, seed).unwrap() {
                assert!(c.passed(), "state of size {size}: {c:?}");
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
