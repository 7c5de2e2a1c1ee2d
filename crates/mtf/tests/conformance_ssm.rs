//! State space models by name: aliases, truth within a family, states that show the back of the plane.

use mtf::geom::{Corners, homography};
use mtf::params::Resolution;
use mtf::ssm::{Homography, SSMS, SsmEntry, StateSpaceModel, fit_truth};

crate::tests! {
    names_of_old_are_aliases;
    truth_of_few_parameters;
    a_plane_behind_the_camera_is_refused;
}

const RES: Resolution = Resolution { cols: 7, rows: 6 };

fn quad() -> Corners {
    Corners([[101.3, 80.2], [214.7, 71.9], [230.1, 178.4], [95.6, 165.0]])
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

fn a_plane_behind_the_camera_is_refused() {
    let mut h = Homography::new();
    h.init(&quad(), RES).unwrap();
    assert!(h.set_state(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0]).is_err());
    assert!(
        h.set_state(&[-0.999, 0.0, 0.0, 0.0, -0.999, 0.0, 0.0, 0.0])
            .is_err()
    );
}
