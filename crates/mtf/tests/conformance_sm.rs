//! Search methods that follow gradients, with the parameters and in the places that [`mtf::conformance`] does not try.

use crate::common::{alignment_error, moved, perturbation};
use mtf::am::AppearanceModel;
use mtf::diagnose::Waves;
use mtf::geom::{Corners, Mat3, homography};
use mtf::registry::{Registry, Selection};
use mtf::tracker::{Stop, TrackError, Tracker};

crate::tests! {
    every_hessian_and_option_recovers_small_motion;
    steepest_ascent_gets_there;
    hessian_after_convergence_needs_the_truth;
    standing_still_stays_still_and_repeats_exactly;
    levenberg_marquardt_never_ends_below_its_start;
    set_region_keeps_the_template;
}

const SIZE: (usize, usize) = (240, 200);

/// Steepest ascent approaches so slowly that it is tested on its own.
const SLOW: &str = "fcsd";

fn quad() -> Corners {
    Corners([[71.3, 60.2], [164.7, 55.9], [170.1, 140.4], [66.6, 145.0]])
}

/// The appearance model of a tracker, with its defaults.
fn model(id: &str) -> Box<dyn AppearanceModel> {
    let registry = Registry::builtin();
    let spec = registry.parse(id).unwrap();
    let entry = registry.ams().iter().find(|e| e.name == spec.parts().1).unwrap();
    (entry.build)(&[]).unwrap()
}

fn all(extra: &[(&str, &str)]) -> Vec<(String, Box<dyn Tracker>)> {
    let registry = Registry::builtin();
    let list = |s: &str| vec![s.to_owned()];
    let set = extra
        .iter()
        .map(|(k, v)| (k.to_string(), v.to_string()))
        .collect();
    let selection = Selection {
        sm: list("gradient"),
        am: list("all"),
        ssm: list("homography"),
        set,
        ..Default::default()
    };
    let specs = registry.expand(&selection).unwrap().specs;
    specs
        .iter()
        .map(|s| (s.to_string(), registry.build(s).unwrap()))
        .collect()
}

fn still(waves: &Waves) -> mtf::image::Frame {
    moved(waves, SIZE, &Mat3::identity())
}

fn every_hessian_and_option_recovers_small_motion() {
    let waves = Waves::new(21);
    let motion = perturbation(&quad(), 1.5, &mut crate::common::rng(2));
    let truth = homography::apply_corners(&motion, &quad());
    let (first, next) = (still(&waves), moved(&waves, SIZE, &motion));
    let registry = Registry::builtin();
    let methods = registry.sms().iter().filter(|e| e.groups.contains(&"gradient"));
    let (mut tracked, mut refused) = (0, 0);
    for sm in methods.filter(|e| e.name != SLOW) {
        for hess in [
            "initial_self",
            "current_self",
            "sum_of_self",
            "original",
            "sum_of_std",
            "std",
        ] {
            for options in [
                "",
                ",second_order=1",
                ",leven_marq=1",
                ",second_order=1,leven_marq=1",
                ",channels=3",
                ",chained_warp=0",
                ",chained_warp=0,second_order=1",
            ] {
                for am in ["ssd", "zncc", "ncc", "mi", "ccre", "ngf"] {
                    // Far from the maximum the template-side Hessian of NCC is indefinite under the inverse additive method.
                    if (sm.name, am, hess) == ("ialk", "ncc", "std") {
                        continue;
                    }
                    let id = format!(
                        "{}/{am}/homography{{hess={hess},max_iters=100,epsilon=1e-9{options}}}",
                        sm.name
                    );
                    // Refused where a method does not have that Hessian.
                    let Ok(spec) = registry.parse(&id) else { continue };
                    // So is a switch that would change nothing.
                    let mut tracker = match registry.build(&spec) {
                        Ok(tracker) => tracker,
                        Err(e) => {
                            assert!(
                                !options.is_empty() && e.to_string().contains("changes nothing"),
                                "{e}"
                            );
                            refused += 1;
                            continue;
                        }
                    };
                    tracker.init(&first, &quad()).unwrap();
                    let update = tracker.update(&next).unwrap_or_else(|e| panic!("{id}: {e}"));
                    let error = alignment_error(&update.corners, &truth);
                    assert!(error < 0.02, "{id}: {error} px after {}", update.iterations);
                    tracked += 1;
                }
            }
        }
    }
    assert!(tracked > 400 && refused > 100, "{tracked}, {refused} refused");
}

fn steepest_ascent_gets_there() {
    let waves = Waves::new(4);
    let motion = perturbation(&quad(), 2.0, &mut crate::common::rng(7));
    let truth = homography::apply_corners(&motion, &quad());
    let registry = Registry::builtin();
    for am in ["ssd", "ncc"] {
        for options in ["", ",hess=initial_self", ",hess=std", ",learning_rate=0.5"] {
            let id = format!("fcsd/{am}/homography{{max_iters=1000,epsilon=1e-10{options}}}");
            let mut tracker = registry.build(&registry.parse(&id).unwrap()).unwrap();
            tracker.init(&still(&waves), &quad()).unwrap();
            let update = tracker.update(&moved(&waves, SIZE, &motion)).unwrap();
            let error = alignment_error(&update.corners, &truth);
            assert!(error < 0.1, "{id}: {error} px after {}", update.iterations);
        }
    }
}

fn hessian_after_convergence_needs_the_truth() {
    let waves = Waves::new(4);
    let motion = perturbation(&quad(), 2.0, &mut crate::common::rng(7));
    let truth = homography::apply_corners(&motion, &quad());
    let registry = Registry::builtin();
    for hess in ["current_self", "std"] {
        let spec = registry
            .parse(&format!(
                "haclk/ncc/homography{{hess={hess},max_iters=100,epsilon=1e-9}}"
            ))
            .unwrap();
        let mut tracker = registry.build(&spec).unwrap();
        assert!(tracker.needs_truth().is_some());
        tracker.init(&still(&waves), &quad()).unwrap();
        let next = moved(&waves, SIZE, &motion);
        assert_eq!(tracker.update(&next).unwrap_err(), TrackError::NoTruth);
        tracker.needs_truth().unwrap().tell_truth(&truth);
        let update = tracker.update(&next).unwrap();
        assert!(alignment_error(&update.corners, &truth) < 0.01);
        // The truth of one frame says nothing about the next.
        assert_eq!(tracker.update(&next).unwrap_err(), TrackError::NoTruth);
    }
    let all = Selection {
        sm: vec!["all".into()],
        am: vec!["ssd".into()],
        ssm: vec!["homography".into()],
        ..Selection::default()
    };
    let specs = registry.expand(&all).unwrap().specs;
    assert!(specs.iter().all(|s| s.parts().0 != "haclk"));
}

fn standing_still_stays_still_and_repeats_exactly() {
    let waves = Waves::new(3);
    let motion = perturbation(&quad(), 2.0, &mut crate::common::rng(9));
    let next = moved(&waves, SIZE, &motion);
    for (id, mut tracker) in all(&[]) {
        tracker.init(&still(&waves), &quad()).unwrap();
        let update = tracker.update(&still(&waves)).unwrap();
        assert!(alignment_error(&update.corners, &quad()) < 1e-3, "{id}");
        let searches = if id.starts_with("hesm") { 2 } else { 1 };
        assert_eq!(
            (update.stop, update.iterations),
            (Stop::Converged, searches),
            "{id}"
        );
        let first = tracker.update(&next).unwrap();
        tracker.init(&still(&waves), &quad()).unwrap();
        tracker.update(&still(&waves)).unwrap();
        assert_eq!(tracker.update(&next).unwrap().corners, first.corners, "{id}");
    }
}

fn levenberg_marquardt_never_ends_below_its_start() {
    let waves = Waves::new(5);
    let (mut tried, mut judged) = (0, 0);
    for seed in 0..6 {
        // Far beyond the basin: the search fails, but not downwards.
        let motion = perturbation(&quad(), 25.0, &mut crate::common::rng(seed));
        let next = moved(&waves, SIZE, &motion);
        for (id, mut tracker) in all(&[("leven_marq", "1")]) {
            if !model(&id).derivatives().is_none_or(|d| d.similarity_is_merit()) {
                continue;
            }
            tried += 1;
            tracker.init(&still(&waves), &quad()).unwrap();
            let mut stuck = Registry::builtin()
                .build(
                    &Registry::builtin()
                        .parse(
                            // Hierarchical ESM evaluates its second search's start.
                            &id.replace("hesm", "esm")
                                .replace("leven_marq=1", "max_iters=1,epsilon=1e6"),
                        )
                        .unwrap(),
                )
                .unwrap();
            stuck.init(&still(&waves), &quad()).unwrap();
            // One iteration without LM evaluates the similarity at the start.
            let start = stuck.update(&next).map(|u| u.similarity);
            if let (Ok(u), Ok(start)) = (tracker.update(&next), start) {
                tracker.init(&still(&waves), &quad()).unwrap();
                tracker.set_region(&u.corners).unwrap();
                stuck.init(&still(&waves), &quad()).unwrap();
                stuck.set_region(&u.corners).unwrap();
                let end = stuck.update(&next).map_or(f64::NEG_INFINITY, |u| u.similarity);
                assert!(end >= start - 1e-4 * start.abs(), "{id}: {start} -> {end}");
                judged += 1;
            }
        }
    }
    assert!(tried > 300 && 2 * judged > tried, "{judged} of {tried}");
}

fn set_region_keeps_the_template() {
    // The object turned by 70 degrees, scaled by 1.2 and placed 2.3 px off: beyond any search from the old place.
    let waves = Waves::new(8);
    let c = quad().centroid();
    let (s, k) = (70f64.to_radians().sin() * 1.2, 70f64.to_radians().cos() * 1.2);
    let around = |x: f64, y: f64| Mat3::new(1.0, 0.0, x, 0.0, 1.0, y, 0.0, 0.0, 1.0);
    let turn = around(c[0], c[1]) * Mat3::new(k, -s, 0.0, s, k, 0.0, 0.0, 0.0, 1.0) * around(-c[0], -c[1]);
    let truth = homography::apply_corners(&turn, &quad());
    let start = homography::apply_corners(&perturbation(&truth, 2.3, &mut crate::common::rng(4)), &truth);
    let next = moved(&waves, SIZE, &turn);
    let registry = Registry::builtin();
    for sm in ["falk", "ialk", "fclk", "iclk", "esm", "aesm", "hesm"] {
        for ssm in ["homography", "affine", "similitude"] {
            let spec = registry
                .parse(&format!("{sm}/ssd/{ssm}{{epsilon=1e-9,max_iters=60}}"))
                .unwrap();
            let mut tracker = registry.build(&spec).unwrap();
            tracker.init(&still(&waves), &quad()).unwrap();
            // A model that cannot represent the start re-bases; its template gradient must turn with it.
            tracker.set_region(&start).unwrap();
            if ssm == "homography" {
                let update = tracker.update(&next).unwrap();
                assert!(alignment_error(&update.corners, &truth) < 0.01, "{spec}");
            } else {
                assert!(alignment_error(&tracker.corners(), &start) < 0.5, "{spec}");
            }
        }
        // The same with a model of few parameters whose start is the truth moved inside the model.
        let spec = registry
            .parse(&format!("{sm}/ssd/translation{{epsilon=1e-9,max_iters=60}}"))
            .unwrap();
        let mut tracker = registry.build(&spec).unwrap();
        tracker.init(&still(&waves), &quad()).unwrap();
        tracker.set_region(&truth.translated(1.7, -1.1)).unwrap();
        let update = tracker.update(&next).unwrap();
        assert!(
            alignment_error(&update.corners, &truth) < 0.02,
            "{spec}: {}",
            alignment_error(&update.corners, &truth)
        );
    }
}
