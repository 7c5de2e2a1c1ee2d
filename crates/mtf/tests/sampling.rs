//! Samplers of states: moments, calibration, transitions, means, determinism; over every state space model.

use mtf::geom::Corners;
use mtf::params::{ParamValue, Resolution};
use mtf::ssm::{
    Dynamics, Homography, Increment, Mean, Perturbation, SSMS, SampleUnit, Sampler, SigmaSets, Sl3,
    StateSpaceModel, Translation, mean_into, sigma_of_motion,
};

crate::tests! {
    sigma_sets_as_text;
    parameters_have_the_moments_asked_for;
    corners_have_the_moments_asked_for;
    points_determine_every_warp;
    deviations_of_a_pixel_motion_move_by_it;
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

fn wrong_numbers_of_deviations_are_refused() {
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
