//! What every state space model must satisfy: the algebra battery is instantiated for each model's type, the rest
//! loops over the table.

use mtf::diagnose;
use mtf::entry::Part;
use mtf::geom::{Corners, Mat3, homography};
use mtf::params::Resolution;
use mtf::ssm::{
    Affine, Asrt, Ast, Cbh, Homography, Increment, Isometry, Ist, LieAffine, LieHomography, LieIsometry,
    Projective, ProjectiveModel, SSMS, Similitude, Sl3, Spline, SsmEntry, StateSpaceModel, Tps, Translation,
    fit_truth,
};
use rand::RngExt;
use rand_pcg::Pcg64;

crate::tests! {
    algebra_and_derivatives;
    any_quadrilateral_is_represented_exactly;
    jacobians_and_pixel_hessians_agree_with_central_differences;
    bad_regions_and_states_are_refused_and_change_nothing;
    rebasing_keeps_the_grid_on_the_object;
    names_of_old_are_aliases;
    truth_of_few_parameters;
}

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

/// Factor between `a c` and `b`, which are equal up to scale.
fn scale(a: &Mat3, b: &Mat3, c: &Mat3) -> f64 {
    (a * c)[(2, 2)] / b[(2, 2)]
}

/// Laws of the algebra and derivatives of one projective model.
fn battery<W: ProjectiveModel>() {
    let mut r = crate::common::rng(7);
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
        let inverse = model.inverse(&p).unwrap();
        close(&(mp * inverse), &Mat3::identity(), 1e-10, W::NAME);
        ssm.set_state(&p).unwrap();
        ssm.update(Increment::Compositional, &q).unwrap();
        if W::GROUP {
            close(&compose(&mp, &mq), &(mp * mq), 1e-10, W::NAME);
            let (left, right) = (compose(&compose(&mp, &mq), &ms), compose(&mp, &compose(&mq, &ms)));
            close(&left, &right, 1e-10, W::NAME);
            close(&compose(&mp, &inverse), &Mat3::identity(), 1e-10, W::NAME);
            // Updates through the interface.
            close(ssm.matrix(), &(mp * mq), 1e-10, W::NAME);
            ssm.update(Increment::InverseCompositional, &q).unwrap();
            close(ssm.matrix(), &mp, 1e-10, W::NAME);
        } else {
            // The product is projected: no member in another direction is nearer.
            let product = mp * mq;
            let near = |s: &[f64]| (model.matrix(s) - product).norm_squared();
            let best = near(ssm.state());
            assert!(best > 0.0);
            for k in 0..W::DOF {
                for step in [-1e-3, 1e-3] {
                    let mut moved = ssm.state().to_vec();
                    moved[k] += step;
                    assert!(near(&moved) > best, "{}", W::NAME);
                }
            }
            ssm.set_state(&p).unwrap();
            ssm.update(Increment::InverseCompositional, &q).unwrap();
            close(
                ssm.matrix(),
                &compose(&mp, &model.inverse(&q).unwrap()),
                1e-10,
                W::NAME,
            );
            ssm.set_state(&p).unwrap();
        }
        let mut step = vec![0.0; W::DOF];
        ssm.relative_into(&p, &q, &mut step).unwrap();
        assert!(
            !W::GROUP
                || (mp * model.matrix(&step) - mq * scale(&mp, &mq, &model.matrix(&step)))
                    .abs()
                    .max()
                    < 1e-10
        );
        ssm.update(Increment::Additive, &q).unwrap();
        for (k, v) in ssm.state().iter().enumerate() {
            assert!((v - p[k] - q[k]).abs() < 1e-10, "{}", W::NAME);
        }
        let caps = ssm.capabilities();
        assert_eq!((caps.group, caps.min_points), (W::GROUP, W::MIN_POINTS));
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
        assert_eq!(ssm.corners_at(&p), corners);
        let (base, mut fitted) = (ssm.base_corners(), vec![0.0; W::DOF]);
        ssm.fit_into(&base.0, &corners.0, &mut fitted).unwrap();
        for (a, b) in fitted.iter().zip(&p) {
            assert!((a - b).abs() < 1e-8, "{}: {fitted:?} {p:?}", W::NAME);
        }
        assert!(ssm.fit_corners(&corners).unwrap() < 1e-8);
        assert!(crate::common::alignment_error(&ssm.corners(), &corners) < 1e-8);
    }
    let mut p = vec![0.0; W::DOF];
    assert!(model.fit(&[], &[], &mut p).is_none());
}

/// What holds for warps that are linear in their state and do not compose.
fn linear_battery<S: StateSpaceModel + Part + Default>() {
    let mut r = crate::common::rng(7);
    let mut ssm = S::default();
    ssm.init(&quad(), RES).unwrap();
    let s = ssm.dof();
    let caps = ssm.capabilities();
    assert!(!caps.compositional && !caps.invertible && !caps.group && caps.estimable);
    let at = |ssm: &mut S, p: &[f64]| -> Vec<[f64; 2]> {
        ssm.set_state(p).unwrap();
        (0..RES.len()).map(|i| ssm.point(i)).collect()
    };
    let base = at(&mut ssm, &vec![0.0; s]);
    for _ in 0..20 {
        let [p, q] = [(); 2].map(|_| random_state(s, 0.05, &mut r));
        let sum: Vec<f64> = p.iter().zip(&q).map(|(a, b)| a + b).collect();
        let (wp, wq, both) = (at(&mut ssm, &p), at(&mut ssm, &q), at(&mut ssm, &sum));
        for i in 0..RES.len() {
            for c in 0..2 {
                let expected = wp[i][c] + wq[i][c] - base[i][c];
                assert!((both[i][c] - expected).abs() < 1e-9, "{}", S::NAME);
            }
        }
        ssm.set_state(&p).unwrap();
        ssm.update(Increment::Additive, &q).unwrap();
        assert!(ssm.state().iter().zip(&sum).all(|(a, b)| (a - b).abs() < 1e-15));
        for how in [Increment::Compositional, Increment::InverseCompositional] {
            assert!(ssm.update(how, &q).is_err());
        }
        let mut step = vec![0.0; s];
        ssm.relative_into(&p, &sum, &mut step).unwrap();
        assert!(step.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-15));
        // Corners of its own leave the bend alone.
        let corners = ssm.corners();
        assert!(ssm.fit_corners(&corners).unwrap() < 1e-9);
        assert!(ssm.state().iter().zip(&sum).all(|(a, b)| (a - b).abs() < 1e-10));
        assert_eq!(ssm.corners_at(&p), {
            ssm.set_state(&p).unwrap();
            ssm.corners()
        });
    }
}

/// The names the batteries cover; the table may hold no others.
const COVERED: [(&str, fn()); 15] = [
    (Translation::NAME, battery::<mtf::ssm::TranslationModel>),
    (Isometry::NAME, battery::<mtf::ssm::IsometryModel>),
    (Ist::NAME, battery::<mtf::ssm::IstModel>),
    (Ast::NAME, battery::<mtf::ssm::AstModel>),
    (Similitude::NAME, battery::<mtf::ssm::SimilitudeModel>),
    (Asrt::NAME, battery::<mtf::ssm::AsrtModel>),
    (Affine::NAME, battery::<mtf::ssm::AffineModel>),
    (Homography::NAME, battery::<mtf::ssm::HomographyModel>),
    (Cbh::NAME, battery::<mtf::ssm::CbhModel>),
    (
        LieIsometry::NAME,
        battery::<mtf::ssm::LieModel<mtf::ssm::LieIsometryBasis>>,
    ),
    (
        LieAffine::NAME,
        battery::<mtf::ssm::LieModel<mtf::ssm::LieAffineBasis>>,
    ),
    (
        LieHomography::NAME,
        battery::<mtf::ssm::LieModel<mtf::ssm::LieHomographyBasis>>,
    ),
    (Sl3::NAME, battery::<mtf::ssm::LieModel<mtf::ssm::Sl3Basis>>),
    (Spline::NAME, linear_battery::<Spline>),
    (Tps::NAME, linear_battery::<Tps>),
];

fn algebra_and_derivatives() {
    let mut names: Vec<_> = COVERED.iter().map(|c| c.0).collect();
    let mut listed: Vec<_> = SSMS.iter().map(|e| e.name).collect();
    names.sort_unstable();
    listed.sort_unstable();
    assert_eq!(names, listed);
    COVERED.iter().for_each(|(_, battery)| battery());
}

fn any_quadrilateral_is_represented_exactly() {
    for entry in SSMS {
        let mut ssm = (entry.build)(&[]).unwrap();
        ssm.init(&quad(), RES).unwrap();
        assert!(crate::common::alignment_error(&ssm.corners(), &quad()) < 1e-10);
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

fn jacobians_and_pixel_hessians_agree_with_central_differences() {
    for entry in SSMS {
        for (seed, size) in [(1, 0.0), (2, 0.1), (3, 0.1)] {
            for c in diagnose::warp(entry, &quad(), RES, size, seed).unwrap() {
                assert!(c.passed(), "state of size {size}: {c:?}");
            }
        }
    }
}

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

fn rebasing_keeps_the_grid_on_the_object() {
    for entry in SSMS {
        let mut r = crate::common::rng(5);
        let mut ssm = (entry.build)(&[]).unwrap();
        ssm.init(&quad(), RES).unwrap();
        let old: Vec<[f64; 2]> = ssm
            .grid()
            .x
            .iter()
            .zip(ssm.grid().y)
            .map(|(&x, &y)| [f64::from(x), f64::from(y)])
            .collect();
        let moved = homography::apply_corners(&crate::common::perturbation(&quad(), 12.0, &mut r), &quad());
        let from_new = ssm.rebase(&moved).unwrap();
        assert!(crate::common::alignment_error(&ssm.corners(), &moved) < 1e-9);
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

fn entry(name: &str) -> &'static SsmEntry {
    SSMS.iter().find(|e| e.name == name).unwrap()
}

fn names_of_old_are_aliases() {
    for (name, alias) in [
        ("translation", "2"),
        ("isometry", "3"),
        ("ist", "3s"),
        ("ast", "4s"),
        ("similitude", "4"),
        ("asrt", "5"),
        ("affine", "6"),
        ("lieaffine", "l6"),
        ("homography", "8"),
        ("liehomography", "l8"),
        ("cbh", "c8"),
        ("spline", "spl"),
    ] {
        assert!(entry(name).aliases.contains(&alias), "{name}");
    }
}

fn truth_of_few_parameters() {
    let mut r = crate::common::rng(11);
    let moved = homography::apply_corners(&crate::common::perturbation(&quad(), 9.0, &mut r), &quad());
    // The error of the best fit grows as parameters are taken away.
    let error = |name: &str| {
        let fitted = fit_truth(entry(name), &quad(), &moved).unwrap();
        crate::common::alignment_error(&fitted, &moved)
    };
    for chain in [
        &["homography", "affine", "similitude", "isometry", "translation"][..],
        &["cbh", "lieaffine", "asrt", "ast", "ist", "translation"],
        &["sl3", "affine", "similitude", "ist"],
        &["liehomography", "asrt", "similitude", "lieisometry"],
    ] {
        for pair in chain.windows(2) {
            assert!(error(pair[0]) <= error(pair[1]) + 1e-9, "{pair:?}");
        }
    }
    for name in ["homography", "cbh", "sl3", "liehomography"] {
        assert!(error(name) < 1e-9, "{name}");
    }
    let c = quad().centroid();
    let shifted = fit_truth(entry("translation"), &quad(), &moved)
        .unwrap()
        .centroid();
    let wanted = moved.centroid();
    assert!((shifted[0] - wanted[0]).abs() + (shifted[1] - wanted[1]).abs() < 1e-9 && shifted != c);
    let line = Corners([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]);
    assert!(fit_truth(entry("affine"), &line, &moved).is_err());
    assert!(fit_truth(entry("homography"), &quad(), &line).is_err());
}
