//! Robust estimation of homographies and smaller warps from noisy pairs with outliers, over many seeds.

use mtf::consensus::{EstimateMethod, Estimator, EstimatorParams};
use mtf::geom::{Corners, homography};
use mtf::params::Resolution;
use mtf::ssm::{SSMS, StateSpaceModel};
use rand::RngExt;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

crate::tests! {
    ransac_is_as_good_as_least_squares_on_the_inliers;
    least_median_is_as_good_as_least_squares_on_the_inliers;
    every_warp_that_a_matrix_describes_is_estimated;
    estimates_repeat_exactly;
}

/// Many for the homography; a sample for each of the other warps.
const SEEDS: u64 = 1000;
const FEW_SEEDS: u64 = 200;
const PAIRS: usize = 100;
const NOISE: f64 = 0.5;
const RES: Resolution = Resolution { cols: 5, rows: 5 };

fn quad() -> Corners {
    Corners([[201.3, 130.2], [434.7, 121.9], [450.1, 348.4], [195.6, 335.0]])
}

/// Pairs with their truth.
struct Case {
    from: Vec<[f64; 2]>,
    to: Vec<[f64; 2]>,
    good: Vec<bool>,
    truth: Corners,
}

/// Points over the region moved by a random state, with noise; outliers anywhere in a frame around it.
fn case(ssm: &mut dyn StateSpaceModel, outliers: f64, r: &mut Pcg64) -> Case {
    ssm.init(&quad(), RES).unwrap();
    let truth = loop {
        let p: Vec<f64> = (0..ssm.dof()).map(|_| r.random_range(-0.15..0.15)).collect();
        if ssm.set_state(&p).is_ok() {
            break ssm.corners();
        }
    };
    let motion = homography::from_corners(&quad(), &truth).unwrap();
    let square = Corners::rect(0.0, 0.0, 1.0, 1.0);
    let inside = homography::from_corners(&square, &quad()).unwrap();
    let spoiled = (outliers * PAIRS as f64).round() as usize;
    let (mut from, mut to, mut good) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..PAIRS {
        let p = homography::apply(&inside, [r.random_range(0.0..1.0), r.random_range(0.0..1.0)]);
        let [u, v] = homography::apply(&motion, p);
        let mut noise = || NOISE * r.sample::<f64, _>(StandardNormal);
        let exact = [u + noise(), v + noise()];
        from.push(p);
        good.push(i >= spoiled);
        to.push(if i < spoiled {
            [r.random_range(100.0..540.0), r.random_range(40.0..440.0)]
        } else {
            exact
        });
    }
    Case {
        from,
        to,
        good,
        truth,
    }
}

fn median(v: &mut [f64]) -> f64 {
    v.sort_unstable_by(f64::total_cmp);
    v[v.len() / 2]
}

fn params(estimator: EstimateMethod) -> EstimatorParams {
    EstimatorParams {
        estimator,
        ..EstimatorParams::default()
    }
}

/// Corner errors over the seeds: of the method, and of least squares on the true inliers.
fn errors(name: &str, method: EstimateMethod, outliers: f64, seeds: u64) -> (Vec<f64>, Vec<f64>) {
    let entry = SSMS.iter().find(|e| e.name == name).unwrap();
    let mut ssm = (entry.build)(&[]).unwrap();
    let (mut robust, mut best) = (Vec::new(), Vec::new());
    for seed in 0..seeds {
        let mut r = crate::common::rng(seed);
        let case = case(&mut *ssm, outliers, &mut r);
        let zero = vec![0.0; ssm.dof()];
        let mut error = |method, from: &[[f64; 2]], to: &[[f64; 2]]| {
            ssm.set_state(&zero).unwrap();
            let mut e = Estimator::new(params(method), seed);
            ssm.estimable()
                .unwrap()
                .estimate(&mut e, from, to)
                .unwrap_or_else(|e| panic!("{name}, seed {seed}: {e}"));
            crate::common::alignment_error(&ssm.corners(), &case.truth)
        };
        robust.push(error(method, &case.from, &case.to));
        let keep = |v: &[[f64; 2]]| -> Vec<[f64; 2]> {
            v.iter()
                .zip(&case.good)
                .filter(|(_, g)| **g)
                .map(|(p, _)| *p)
                .collect()
        };
        let (a, b) = (keep(&case.from), keep(&case.to));
        best.push(error(EstimateMethod::LeastSquares, &a, &b));
    }
    (robust, best)
}

fn check(name: &str, method: EstimateMethod, outliers: f64, seeds: u64) {
    let (mut robust, mut best) = errors(name, method, outliers, seeds);
    let largest = robust.iter().fold(0.0, |a: f64, b| a.max(*b));
    let (m, b) = (median(&mut robust), median(&mut best));
    assert!(
        m <= 1.2 * b,
        "{name} {method:?} {outliers}: {m} px, least squares {b}"
    );
    assert!(
        largest <= 5.0 * b,
        "{name} {method:?} {outliers}: {largest} px, median {b}"
    );
}

fn ransac_is_as_good_as_least_squares_on_the_inliers() {
    for outliers in [0.0, 0.3, 0.45, 0.6] {
        check("homography", EstimateMethod::Ransac, outliers, SEEDS);
    }
}

fn least_median_is_as_good_as_least_squares_on_the_inliers() {
    for outliers in [0.0, 0.3, 0.45] {
        check("homography", EstimateMethod::Lmeds, outliers, SEEDS);
    }
}

fn every_warp_that_a_matrix_describes_is_estimated() {
    for entry in SSMS.iter().filter(|e| !["spline", "tps"].contains(&e.name)) {
        check(entry.name, EstimateMethod::Ransac, 0.45, FEW_SEEDS);
        check(entry.name, EstimateMethod::Lmeds, 0.3, FEW_SEEDS);
    }
}

/// The estimate is a function of the pairs and the seed alone.
fn estimates_repeat_exactly() {
    let entry = SSMS.iter().find(|e| e.name == "homography").unwrap();
    let mut ssm = (entry.build)(&[]).unwrap();
    let c = case(&mut *ssm, 0.45, &mut crate::common::rng(1));
    let mut run = |e: &mut Estimator| {
        ssm.estimable().unwrap().estimate(e, &c.from, &c.to).unwrap();
        ssm.state().to_vec()
    };
    let mut e = Estimator::new(EstimatorParams::default(), 9);
    let first = run(&mut e);
    e.reseed(9);
    assert_eq!(run(&mut e), first);
    assert_eq!(run(&mut Estimator::new(EstimatorParams::default(), 9)), first);
}
