//! Samplers of states: moments, calibration, transitions, means, determinism; over every state space model.

use mtf::geom::Corners;
use mtf::params::{ParamValue, Resolution};
use mtf::ssm::{
    Affine, Dynamics, Homography, Increment, Mean, Perturbation, SSMS, SampleUnit, Sampler, SigmaSets,
    Similitude, Sl3, StateSpaceModel, Translation, mean_into, sigma_of_motion,
};
use rand::RngExt;
use rand_distr::StandardNormal;

crate::tests! {
    sigma_sets_as_text;
    parameters_have_the_moments_asked_for;
    corners_have_the_moments_asked_for;
    points_determine_every_warp;
    deviations_of_a_pixel_motion_move_by_it;
    estimated_deviations_follow_their_definition;
    geometric_parameters_and_states_are_the_same_warp;
    geometric_samples_follow_their_law;
    geometric_samples_stay_in_their_group;
    geometric_transitions_follow_their_definitions;
    wrong_numbers_of_deviations_are_refused;
    transitions_follow_their_definitions;
    impossible_transitions_change_nothing;
    means_of_one_and_of_symmetric_samples;
    group_means_are_karcher_means;
}

const RES: Resolution = Resolution { cols: 20, rows: 20 };
const DRAWS: usize = 4000;

fn quad() -> Corners {
    Corners([[101.3, 80.2], [214.7, 71.9], [230.1, 178.4], [95.6, 165.0]])
}

fn started<S: StateSpaceModel>(mut ssm: S) -> S {
    ssm.init(&quad(), RES).unwrap();
    ssm
}

fn all() -> impl Iterator<Item = (&'static str, Box<dyn StateSpaceModel>)> {
    SSMS.iter().map(|e| (e.name, started((e.build)(&[]).unwrap())))
}

fn sets(text: &str) -> SigmaSets {
    SigmaSets::parse(text).unwrap()
}

fn sigma_sets_as_text() {
    let s = sets("6:4|0.03:0.02");
    assert_eq!(s, SigmaSets(vec![vec![6.0, 4.0], vec![0.03, 0.02]]));
    assert_eq!(s.text(), "6:4|0.03:0.02");
    assert_eq!(sets(" 2 ").text(), "2");
    for bad in ["", "a", "1:", "-1", "1|", "nan"] {
        assert!(SigmaSets::parse(bad).is_none(), "{bad}");
    }
    // Ten samples among three sets.
    let three = sets("1|2|3");
    let of: Vec<usize> = (0..10).map(|i| three.set_of(i, 10)).collect();
    assert_eq!(of, [0, 0, 0, 0, 1, 1, 1, 2, 2, 2]);
}

fn parameters_have_the_moments_asked_for() {
    let ssm = started(Homography::new());
    let sigma = [0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08];
    let mut sampler = Sampler::new(
        Perturbation::Params,
        SampleUnit::Pixels,
        SigmaSets(vec![vec![0.5], sigma.to_vec()]),
    );
    sampler.mean = sigma.iter().map(|s| -s).collect();
    sampler.check(&ssm).unwrap();
    let (mut r, mut d) = (crate::common::rng(1), [0.0; 8]);
    let (mut sum, mut square) = ([0.0; 8], [0.0; 8]);
    for _ in 0..DRAWS {
        sampler.draw(1, &ssm, &mut r, &mut d).unwrap();
        for k in 0..8 {
            sum[k] += d[k] / DRAWS as f64;
            square[k] += (d[k] + sigma[k]).powi(2) / DRAWS as f64;
        }
    }
    for k in 0..8 {
        assert!((sum[k] + sigma[k]).abs() < 5.0 * sigma[k] / (DRAWS as f64).sqrt());
        assert!((square[k].sqrt() / sigma[k] - 1.0).abs() < 0.06, "{k}");
    }
    // The first set has one number for all.
    sampler.mean.clear();
    let mut square = 0.0;
    for _ in 0..DRAWS {
        sampler.draw(0, &ssm, &mut r, &mut d).unwrap();
        square += d.iter().map(|v| v * v).sum::<f64>() / (8 * DRAWS) as f64;
    }
    assert!((square.sqrt() / 0.5 - 1.0).abs() < 0.02);
}

fn corners_have_the_moments_asked_for() {
    let mut ssm = started(Homography::new());
    for (unit, scale) in [
        (SampleUnit::Pixels, 1.0),
        (
            SampleUnit::Side,
            std::f64::consts::SQRT_2 * ssm.base().radius / 100.0,
        ),
    ] {
        let text = if unit == SampleUnit::Pixels {
            "3:2"
        } else {
            "0.03:0.02"
        };
        let sampler = Sampler::new(Perturbation::Corners, unit, sets(text));
        let (mut r, mut d) = (crate::common::rng(2), [0.0; 8]);
        let (mut own, mut between) = (0.0, 0.0);
        for _ in 0..DRAWS {
            sampler.draw(0, &ssm, &mut r, &mut d).unwrap();
            ssm.set_state(&d).unwrap();
            let (c, base) = (ssm.corners().to_array(), quad().to_array());
            own += (c[0] - base[0]).powi(2) / DRAWS as f64;
            between += (c[0] - base[0]) * (c[4] - base[4]) / DRAWS as f64;
        }
        // Shift and own disturbance add; corners share the shift.
        assert!((own / (13.0 * scale * scale) - 1.0).abs() < 0.08, "{own}");
        assert!((between / (9.0 * scale * scale) - 1.0).abs() < 0.12, "{between}");
    }
}

fn points_determine_every_warp() {
    for (name, mut ssm) in all() {
        for perturbation in [Perturbation::Corners, Perturbation::Points] {
            let sampler = Sampler::new(perturbation, SampleUnit::Pixels, sets("1.5|2:1"));
            sampler.check(&*ssm).unwrap();
            let (mut r, mut again) = (crate::common::rng(3), crate::common::rng(3));
            let mut d = vec![0.0; ssm.dof()];
            let mut twin = d.clone();
            let mut square = 0.0;
            for i in 0..200 {
                let set = sampler.sigma.set_of(i, 200);
                sampler.draw(set, &*ssm, &mut r, &mut d).unwrap();
                sampler.draw(set, &*ssm, &mut again, &mut twin).unwrap();
                assert_eq!(d, twin, "{name}");
                ssm.set_state(&d)
                    .unwrap_or_else(|e| panic!("{name} {perturbation:?}: {e}"));
                square += ssm.corners().distance_squared(&quad()) / 4.0 / 200.0;
            }
            // A few pixels, whatever the warp makes of them.
            assert!(
                (0.5..9.0).contains(&square.sqrt()),
                "{name} {perturbation:?}: {}",
                square.sqrt()
            );
        }
    }
}

fn deviations_of_a_pixel_motion_move_by_it() {
    for (name, ssm) in all() {
        for pixels in [0.5, 2.0, 8.0] {
            let sampler = Sampler::of_motion(&*ssm, &[1.0, pixels]).unwrap();
            sampler.check(&*ssm).unwrap();
            let mut r = crate::common::rng(77);
            let mut d = vec![0.0; ssm.dof()];
            let (mut square, mut count) = (0.0, 0.0);
            for _ in 0..DRAWS {
                sampler.draw(1, &*ssm, &mut r, &mut d).unwrap();
                let c = ssm.corners_at(&d);
                if c.is_convex() && c.signed_area() > 0.0 {
                    square += c.distance_squared(&quad()) / 4.0;
                    count += 1.0;
                }
            }
            let rms = f64::sqrt(square / count);
            assert!(
                (rms / pixels - 1.0).abs() < 0.06,
                "{name}: {rms} px instead of {pixels}"
            );
        }
        assert_eq!(sigma_of_motion(&*ssm, 0.0).unwrap(), vec![0.0; ssm.dof()]);
    }
    assert!(sigma_of_motion(&Homography::new(), 1.0).is_err());
}

/// `σ_k` is inversely proportional to the mean motion of the grid per unit of parameter `k`, by central differences.
fn estimated_deviations_follow_their_definition() {
    for (name, mut ssm) in all() {
        let sigma = sigma_of_motion(&*ssm, 2.0).unwrap();
        let h = 1e-5;
        let mut motions = Vec::new();
        for k in 0..ssm.dof() {
            let mut ends = [1.0, -1.0].map(|sign| {
                let mut p = vec![0.0; ssm.dof()];
                p[k] = sign * h;
                ssm.set_state(&p).unwrap();
                let reference = ssm.reference().unwrap();
                (0..RES.len()).map(|i| reference.point(i)).collect::<Vec<_>>()
            });
            let [to, from] = &mut ends;
            let moved = to.iter().zip(from).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
            motions.push(sigma[k] * moved.sum::<f64>() / (2.0 * h * RES.len() as f64));
        }
        let all = motions.iter().sum::<f64>() / motions.len() as f64;
        for (k, motion) in motions.iter().enumerate() {
            assert!(
                (motion / all - 1.0).abs() < 1e-3,
                "{name}, parameter {k}: {motion} of {all}"
            );
        }
        // A shift moves corners and grid alike: by `σ√2` (RMS over both directions).
        if name == "translation" {
            let pixels = 2.0_f64.sqrt() * sigma[0] * ssm.base().radius;
            assert!((pixels / 2.0 - 1.0).abs() < 0.03, "{pixels}");
        }
    }
}

/// A 2x2 matrix by its definition: `s R(θ) R(-φ) diag(1, r) R(φ)`.
fn geometric_matrix(s: f64, theta: f64, r: f64, phi: f64) -> [[f64; 2]; 2] {
    let turn = |a: f64| [[a.cos(), -a.sin()], [a.sin(), a.cos()]];
    let times = |a: [[f64; 2]; 2], b: [[f64; 2]; 2]| {
        std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
    };
    let m = times(
        times(turn(theta), turn(-phi)),
        times([[1.0, 0.0], [0.0, r]], turn(phi)),
    );
    m.map(|row: [f64; 2]| row.map(|v| s * v))
}

fn affine_state(tx: f64, ty: f64, m: [[f64; 2]; 2]) -> [f64; 6] {
    [tx, ty, m[0][0] - 1.0, m[0][1], m[1][0], m[1][1] - 1.0]
}

fn close(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < tolerance)
}

fn geometric_parameters_and_states_are_the_same_warp() {
    let (affine, similitude) = (started(Affine::new()), started(Similitude::new()));
    let (affine, similitude) = (affine.geometric().unwrap(), similitude.geometric().unwrap());
    let (mut g, mut p, mut again) = ([0.0; 6], [0.0; 6], [0.0; 6]);
    affine.geometric_into(&[0.0; 6], &mut g);
    assert_eq!(g, [0.0, 0.0, 1.0, 0.0, 1.0, 0.0]);
    // Turned and scaled alike in all directions: no axis.
    let same = affine_state(0.1, -0.2, geometric_matrix(1.3, 2.5, 1.0, 0.0));
    affine.geometric_into(&same, &mut g);
    assert!(close(&g, &[0.1, -0.2, 1.3, 2.5, 1.0, 0.0], 1e-7), "{g:?}");
    let mut random = crate::common::rng(31);
    for _ in 0..500 {
        let mut draw = |from: f64, to: f64| from + (to - from) * random.random::<f64>();
        let (s, theta) = (draw(0.3, 3.0), draw(-3.1, 3.1));
        let (r, phi) = (draw(0.2, 0.95), draw(-1.5, 1.5));
        let want = [draw(-1.0, 1.0), draw(-1.0, 1.0), s, theta, r, phi];
        affine.state_into(&want, &mut p);
        let by_definition = affine_state(want[0], want[1], geometric_matrix(s, theta, r, phi));
        assert!(close(&p, &by_definition, 1e-12), "{want:?}: {p:?}");
        affine.geometric_into(&p, &mut g);
        assert!(close(&g, &want, 1e-9), "{want:?}: {g:?}");
        // A ratio above 1 is that of the other axis.
        affine.state_into(&[0.0, 0.0, s, theta, 1.0 / r, phi], &mut p);
        affine.geometric_into(&p, &mut g);
        assert!(g[4] <= 1.0 && g[5].abs() <= std::f64::consts::FRAC_PI_2);
        affine.state_into(&g, &mut again);
        assert!(close(&p, &again, 1e-9));
        let (mut small, mut back) = ([0.0; 4], [0.0; 4]);
        similitude.state_into(&[0.3, 0.4, theta, s - 1.0], &mut small);
        assert!(close(
            &small[2..],
            &[s * theta.cos() - 1.0, s * theta.sin()],
            1e-12
        ));
        similitude.geometric_into(&small, &mut back);
        assert!(close(&back, &[0.3, 0.4, theta, s - 1.0], 1e-12));
    }
    assert!(started(Homography::new()).geometric().is_none());
}

fn geometric_samples_follow_their_law() {
    let ssm = started(Affine::new());
    let radius = ssm.base().radius;
    let sigma = [9.0, 5.0, 0.04, 0.06, 0.05, 0.3];
    let text = sigma.map(|s| s.to_string()).join(":");
    let mut sampler = Sampler::new(Perturbation::Geometric, SampleUnit::Pixels, sets(&text));
    sampler.check(&ssm).unwrap();
    sampler.mean = vec![0.0, 0.0, 0.0, 0.1, -0.2, 0.0];
    let (mut r, mut twin) = (crate::common::rng(12), crate::common::rng(12));
    let mut p = [0.0; 6];
    let (mut sum, mut square) = ([0.0; 4], [0.0; 4]);
    for _ in 0..DRAWS {
        sampler.draw(0, &ssm, &mut r, &mut p).unwrap();
        // The same numbers, put together by definition.
        let d: [f64; 6] = std::array::from_fn(|k| {
            let z: f64 = twin.sample(StandardNormal);
            sampler.mean[k] + sigma[k] * z
        });
        let m = geometric_matrix(1.0 + d[2], d[3], 1.0 + d[4], d[5]);
        assert!(close(&p, &affine_state(d[0] / radius, d[1] / radius, m), 1e-12));
        // What can be told from the warp: shift, turn, area.
        let turn = (p[4] - p[3]).atan2(2.0 + p[2] + p[5]);
        let area = (1.0 + p[2]) * (1.0 + p[5]) - p[3] * p[4];
        for (k, v) in [p[0] * radius, p[1] * radius, turn, area].into_iter().enumerate() {
            sum[k] += v / DRAWS as f64;
            square[k] += v * v / DRAWS as f64;
        }
    }
    // Area: s² r, of independent s and r.
    let (second, fourth) = (
        1.0 + 0.04_f64.powi(2),
        1.0 + 6.0 * 0.04_f64.powi(2) + 3.0 * 0.04_f64.powi(4),
    );
    let (mean, deviation) = (
        0.8 * second,
        (fourth * (0.64 + 0.0025) - (0.8 * second).powi(2)).sqrt(),
    );
    for (k, (mean, deviation)) in [(0.0, 9.0), (0.0, 5.0), (0.1, 0.06), (mean, deviation)]
        .into_iter()
        .enumerate()
    {
        let error = deviation / (DRAWS as f64).sqrt();
        assert!((sum[k] - mean).abs() < 5.0 * error, "{k}: {} not {mean}", sum[k]);
        let spread = (square[k] - sum[k] * sum[k]).sqrt();
        assert!(
            (spread / deviation - 1.0).abs() < 0.06,
            "{k}: {spread} not {deviation}"
        );
    }
    // In sides of the region as a square, √2 r.
    sampler.unit = SampleUnit::Side;
    let mut other = [0.0; 6];
    sampler
        .draw(0, &ssm, &mut crate::common::rng(1), &mut other)
        .unwrap();
    sampler.unit = SampleUnit::Pixels;
    sampler.draw(0, &ssm, &mut crate::common::rng(1), &mut p).unwrap();
    let side = 2.0_f64.sqrt() * radius;
    assert!((other[0] / p[0] / side - 1.0).abs() < 1e-12 && other[2..] == p[2..]);
}

fn geometric_samples_stay_in_their_group() {
    let mut ssm = started(Similitude::new());
    let lengths = |c: &Corners| {
        let side = |i: usize, j: usize| (c.0[i][0] - c.0[j][0]).hypot(c.0[i][1] - c.0[j][1]);
        [
            side(0, 1),
            side(1, 2),
            side(2, 3),
            side(3, 0),
            side(0, 2),
            side(1, 3),
        ]
    };
    let base = lengths(&quad());
    let mut r = crate::common::rng(14);
    // All four at random, then the turn alone, which keeps lengths and centre.
    for (text, rigid) in [("9:9:0.3:0.1", false), ("0:0:0.3:0", true)] {
        let mut sampler = Sampler::new(Perturbation::Geometric, SampleUnit::Pixels, sets(text));
        let (mut p, mut last) = (vec![0.0; 4], vec![0.0; 4]);
        for how in [Increment::Compositional, Increment::Additive] {
            for _ in 0..50 {
                sampler
                    .transition(0, &mut ssm, Dynamics::RandomWalk, how, &mut r, &mut p, &mut last)
                    .unwrap();
                let now = lengths(&ssm.corners());
                let scale = if rigid { 1.0 } else { now[0] / base[0] };
                assert!(
                    now.iter()
                        .zip(base)
                        .all(|(n, b)| (n / (scale * b) - 1.0).abs() < 1e-9)
                );
                if rigid {
                    let (c, b) = (ssm.corners().centroid(), quad().centroid());
                    assert!(close(&c, &b, 1e-9));
                }
            }
            p.fill(0.0);
        }
    }
}

fn geometric_transitions_follow_their_definitions() {
    let ssms: [(Box<dyn StateSpaceModel>, &str, [f64; 6]); 2] = [
        (
            Box::new(started(Affine::new())),
            "3:3:0.03:0.03:0.03:0.2",
            [0.1, -0.1, 1.1, 3.1, 0.8, 1.5],
        ),
        (
            Box::new(started(Similitude::new())),
            "3:3:0.03:0.03",
            [0.1, -0.1, 3.1, 0.2, 0.0, 0.0],
        ),
    ];
    for (mut ssm, text, at) in ssms {
        let s = ssm.dof();
        let radius = ssm.base().radius;
        let mut sampler = Sampler::new(Perturbation::Geometric, SampleUnit::Pixels, sets(text));
        let sigma = sampler.sigma.0[0].clone();
        let mut start = vec![0.0; s];
        ssm.geometric().unwrap().state_into(&at[..s], &mut start);
        // A turn that crosses half a turn, and back.
        let motion: Vec<f64> = (0..s).map(|k| 0.02 + 0.01 * k as f64).collect();
        let (mut p, mut last) = (start.clone(), motion.clone());
        let (dynamics, how) = (Dynamics::Ar1, Increment::Additive);
        let mut stream = crate::common::rng(5);
        sampler
            .transition(0, &mut *ssm, dynamics, how, &mut stream, &mut p, &mut last)
            .unwrap();
        let mut twin = crate::common::rng(5);
        let steps: Vec<f64> = (0..s)
            .map(|k| {
                let z: f64 = twin.sample(StandardNormal);
                motion[k] + sigma[k] * z / if k < 2 { radius } else { 1.0 }
            })
            .collect();
        let g: Vec<f64> = at.iter().zip(&steps).map(|(a, d)| a + d).collect();
        let mut want = vec![0.0; s];
        ssm.geometric().unwrap().state_into(&g, &mut want);
        assert!(close(&p, &want, 1e-9), "{p:?} {want:?}");
        // The factor is 0.5; angles have gone the short way round.
        let damped: Vec<f64> = steps.iter().map(|d| 0.5 * d).collect();
        assert!(close(&last, &damped, 1e-9), "{last:?} {damped:?}");
        let mut seen = vec![0.0; s];
        sampler.motion_into(&*ssm, how, &start, &p, &mut seen).unwrap();
        assert!(close(&seen, &steps, 1e-9));
        // Composed: with the warp of the steps from the identity.
        let (mut p, mut unused) = (start.clone(), vec![0.0; s]);
        let how = Increment::Compositional;
        sampler
            .transition(
                0,
                &mut *ssm,
                Dynamics::RandomWalk,
                how,
                &mut crate::common::rng(6),
                &mut p,
                &mut unused,
            )
            .unwrap();
        let mut delta = vec![0.0; s];
        sampler
            .draw(0, &*ssm, &mut crate::common::rng(6), &mut delta)
            .unwrap();
        ssm.set_state(&start).unwrap();
        ssm.update(how, &delta).unwrap();
        assert_eq!(ssm.state(), p);
    }
}

fn wrong_numbers_of_deviations_are_refused() {
    for (ssm, text) in [("affine", "1"), ("affine", "1:1"), ("similitude", "1:1:1:1:1:1")] {
        let entry = SSMS.iter().find(|e| e.name == ssm).unwrap();
        let ssm = started((entry.build)(&[]).unwrap());
        let s = Sampler::new(Perturbation::Geometric, SampleUnit::Pixels, sets(text));
        assert!(s.check(&*ssm).is_err(), "{text}");
    }
    let eight = Sampler::new(
        Perturbation::Geometric,
        SampleUnit::Pixels,
        sets("1:1:1:1:1:1:1:1"),
    );
    let plain = started(Homography::new());
    assert!(eight.check(&plain).is_err());
    assert!(
        eight
            .draw(0, &plain, &mut crate::common::rng(0), &mut [0.0; 8])
            .is_err()
    );
    let ssm = started(Homography::new());
    for (perturbation, text, sound) in [
        (Perturbation::Params, "1", true),
        (Perturbation::Params, "1:2", false),
        (Perturbation::Corners, "1:2", true),
        (Perturbation::Corners, "1:2:3", false),
        (Perturbation::Points, "1:1:1:1:1:1:1:1", true),
        (Perturbation::Points, "1|1:1:1", false),
    ] {
        let s = Sampler::new(perturbation, SampleUnit::Pixels, sets(text));
        assert_eq!(s.check(&ssm).is_ok(), sound, "{perturbation:?} {text}");
    }
    let mut s = Sampler::default();
    s.mean = vec![0.0; 3];
    assert!(s.check(&ssm).is_err());
    assert!(
        s.draw(7, &ssm, &mut crate::common::rng(0), &mut [0.0; 8])
            .is_err()
    );
}

fn transitions_follow_their_definitions() {
    for (name, mut ssm) in all() {
        let composes = ssm.capabilities().compositional;
        let mut sampler = Sampler::of_motion(&*ssm, &[1.0]).unwrap();
        let s = ssm.dof();
        let start: Vec<f64> = (0..s).map(|k| 0.02 * ((k * 5 % 7) as f64 - 3.0) / 3.0).collect();
        let motion: Vec<f64> = (0..s).map(|k| 0.01 * ((k * 3 % 5) as f64 - 2.0)).collect();
        for how in [Increment::Additive, Increment::Compositional] {
            for dynamics in [Dynamics::RandomWalk, Dynamics::Ar1] {
                let (mut p, mut last) = (start.clone(), motion.clone());
                let mut delta = vec![0.0; s];
                sampler
                    .draw(0, &*ssm, &mut crate::common::rng(5), &mut delta)
                    .unwrap();
                sampler
                    .transition(
                        0,
                        &mut *ssm,
                        dynamics,
                        how,
                        &mut crate::common::rng(5),
                        &mut p,
                        &mut last,
                    )
                    .unwrap();
                let step = if composes { how } else { Increment::Additive };
                ssm.set_state(&start).unwrap();
                if dynamics == Dynamics::Ar1 {
                    ssm.update(step, &motion).unwrap();
                }
                ssm.update(step, &delta).unwrap();
                assert_eq!(ssm.state(), p, "{name}");
                if dynamics == Dynamics::RandomWalk {
                    assert_eq!(last, motion, "{name}");
                } else {
                    let mut made = vec![0.0; s];
                    if step == Increment::Additive {
                        made.iter_mut()
                            .zip(&p)
                            .zip(&start)
                            .for_each(|((m, p), s)| *m = p - s);
                    } else {
                        ssm.relative_into(&start, &p, &mut made).unwrap();
                    }
                    for (l, m) in last.iter().zip(&made) {
                        assert!((l - 0.5 * m).abs() < 1e-12, "{name}");
                    }
                }
            }
        }
    }
    // Without disturbance a motion decays by the factor.
    let mut ssm = started(Translation::new());
    let mut sampler = Sampler::new(Perturbation::Params, SampleUnit::Pixels, SigmaSets::single(0.0));
    sampler.ar_factor = 0.8;
    let (mut p, mut last) = (vec![0.0, 0.0], vec![0.1, -0.05]);
    for _ in 0..3 {
        sampler
            .transition(
                0,
                &mut ssm,
                Dynamics::Ar1,
                Increment::Compositional,
                &mut crate::common::rng(0),
                &mut p,
                &mut last,
            )
            .unwrap();
    }
    assert!((p[0] - 0.1 * (1.0 + 0.8 + 0.64)).abs() < 1e-12 && (last[1] + 0.05 * 0.512).abs() < 1e-12);
}

fn impossible_transitions_change_nothing() {
    let mut ssm = started(Homography::new());
    let mut sampler = Sampler::new(Perturbation::Params, SampleUnit::Pixels, SigmaSets::single(1e9));
    let (mut p, mut last) = (vec![0.01; 8], vec![0.0; 8]);
    let result = sampler.transition(
        0,
        &mut ssm,
        Dynamics::RandomWalk,
        Increment::Additive,
        &mut crate::common::rng(1),
        &mut p,
        &mut last,
    );
    assert!(result.is_err());
    assert_eq!(p, vec![0.01; 8]);
}

fn means_of_one_and_of_symmetric_samples() {
    for (name, mut ssm) in all() {
        let s = ssm.dof();
        let p: Vec<f64> = (0..s).map(|k| 0.05 * ((k * 5 % 7) as f64 - 3.0) / 3.0).collect();
        for kind in [Mean::State, Mean::Corners, Mean::Group] {
            let mut out = vec![0.0; s];
            if kind != Mean::Corners || ssm.capabilities().compositional {
                mean_into(kind, &*ssm, &p, &[0.3], &mut out).unwrap();
                for (a, b) in out.iter().zip(&p) {
                    assert!((a - b).abs() < 1e-9, "{name} {kind:?}");
                }
            }
            // Weights count: twice the weight is the sample twice.
            let q: Vec<f64> = p.iter().map(|v| -0.4 * v).collect();
            let (two, three) = (
                [p.clone(), q.clone()].concat(),
                [p.clone(), p.clone(), q].concat(),
            );
            let mut other = vec![0.0; s];
            mean_into(kind, &*ssm, &two, &[2.0, 1.0], &mut out).unwrap();
            mean_into(kind, &*ssm, &three, &[1.0; 3], &mut other).unwrap();
            // Four corners leave most of a non-rigid state to its penalty: an ill-conditioned fit.
            let tolerance = if ssm.capabilities().compositional {
                1e-9
            } else {
                1e-6
            };
            for (a, b) in out.iter().zip(&other) {
                assert!((a - b).abs() < tolerance, "{name} {kind:?}");
            }
            assert!(mean_into(kind, &*ssm, &[], &[], &mut out).is_err());
            assert!(mean_into(kind, &*ssm, &p, &[f64::NAN], &mut out).is_err());
        }
        // Steps of a group in opposite directions cancel in its own mean.
        if ssm.capabilities().group {
            let mut states = Vec::new();
            for sign in [1.0, -1.0] {
                let step: Vec<f64> = p.iter().rev().map(|v| sign * v).collect();
                ssm.set_state(&p).unwrap();
                let how = if sign > 0.0 {
                    Increment::Compositional
                } else {
                    Increment::InverseCompositional
                };
                ssm.update(how, &step.iter().map(|v| sign * v).collect::<Vec<_>>())
                    .unwrap();
                states.extend_from_slice(ssm.state());
            }
            let mut out = vec![0.0; s];
            mean_into(Mean::Group, &*ssm, &states, &[1.0, 1.0], &mut out).unwrap();
            for (a, b) in out.iter().zip(&p) {
                assert!((a - b).abs() < 1e-8, "{name}: {out:?} {p:?}");
            }
        }
    }
}

/// The first-order condition of the Karcher mean: the logarithms of the samples, seen from it, cancel.
fn group_means_are_karcher_means() {
    let ssm = started(Sl3::new());
    let mut r = crate::common::rng(8);
    let sampler = Sampler::new(Perturbation::Params, SampleUnit::Pixels, SigmaSets::single(0.1));
    let weights: Vec<f64> = (0..30).map(|i| 1.0 + (i % 4) as f64).collect();
    let mut states = vec![0.0; 30 * 8];
    for p in states.chunks_exact_mut(8) {
        sampler.draw(0, &ssm, &mut r, p).unwrap();
    }
    let mut mean = [0.0; 8];
    mean_into(Mean::Group, &ssm, &states, &weights, &mut mean).unwrap();
    let mut sum = [0.0; 8];
    for (p, w) in states.chunks_exact(8).zip(&weights) {
        let mut step = [0.0; 8];
        ssm.relative_into(&mean, p, &mut step).unwrap();
        sum.iter_mut().zip(step).for_each(|(s, v)| *s += w * v);
    }
    assert!(sum.iter().all(|v| v.abs() < 1e-6), "{sum:?}");
    // Two samples: halfway along the geodesic between them.
    let pair = [[0.0; 8], [0.2, -0.1, 0.3, 0.1, 0.05, -0.2, 0.1, 0.02]].concat();
    mean_into(Mean::Group, &ssm, &pair, &[1.0, 1.0], &mut mean).unwrap();
    for (m, p) in mean.iter().zip(&pair[8..]) {
        assert!((m - 0.5 * p).abs() < 1e-9);
    }
}
