//! Switches: every parameter that is on or off changes what a tracker does, or is refused.

use crate::common::moved;
use mtf::diagnose::Waves;
use mtf::geom::{Corners, Mat3};
use mtf::image::{Frame, Image};
use mtf::registry::{Registry, SpecError, TrackerSpec};

crate::tests! {
    every_switch_of_every_tracker_changes_something_or_is_refused;
    second_order_terms_of_self_hessians_change_the_steps;
}

const SIZE: (usize, usize) = (160, 120);

fn quad() -> Corners {
    Corners::rect(50.0, 35.0, 60.0, 50.0)
}

/// A plane that moves a little, under a light that changes.
fn frames() -> Vec<Frame> {
    let waves = Waves::new(8);
    let frame = |k: usize| {
        let t = k as f64;
        let m = Mat3::new(
            1.0 + 0.004 * t,
            0.003 * t,
            0.9 * t,
            -0.002 * t,
            1.0,
            -0.6 * t,
            0.0,
            0.0,
            1.0,
        );
        let plain = moved(&waves, SIZE, &m);
        let lit = |x: usize, y: usize| {
            let v = f64::from(plain.gray().get(0, x, y));
            (v + 0.12 * t * (v - 100.0) * (v - 30.0) / 256.0) as f32
        };
        Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, lit))
    };
    (0..4).map(frame).collect()
}

/// What a tracker says of each frame, to the bit.
fn answers(registry: &Registry, spec: &TrackerSpec, frames: &[Frame]) -> Vec<[u64; 9]> {
    let mut tracker = registry.build(spec).unwrap();
    tracker.init(&frames[0], &quad()).unwrap();
    if let Some(told) = tracker.needs_truth() {
        told.tell_truth(&quad());
    }
    let mut out = Vec::new();
    for frame in &frames[1..] {
        let similarity = tracker.update(frame).map_or(f64::NAN, |u| u.similarity);
        if let Some(told) = tracker.needs_truth() {
            told.tell_truth(&quad());
        }
        let c = tracker.corners().0.concat();
        out.push(std::array::from_fn(|i| {
            c.get(i).copied().unwrap_or(similarity).to_bits()
        }));
    }
    out
}

fn small(sm: &str) -> &'static str {
    match sm {
        "nn" => "res=12x12,n_samples=60",
        "pf" => "res=12x12,n_particles=40",
        "regression" => "res=12x12,n_samples=60",
        _ => "res=16x16,max_iters=3",
    }
}

fn every_switch_of_every_tracker_changes_something_or_is_refused() {
    let registry = Registry::builtin();
    let frames = frames();
    let (mut changed, mut refused, mut idle) = (0, 0, Vec::new());
    for sm in registry.sms() {
        for am in registry.ams() {
            let id = |more: &str| format!("{}/{}/homography{{{}{more}}}", sm.name, am.name, small(sm.name));
            let plain = registry.parse(&id("")).unwrap();
            let before = registry
                .build(&plain)
                .is_ok()
                .then(|| answers(&registry, &plain, &frames));
            let infos = (sm.params)().into_iter().chain((am.params)());
            for info in infos.filter(|i| i.allowed == "0 or 1") {
                let other = if info.default == "1" { "0" } else { "1" };
                let text = id(&format!(",{}={other}", info.name));
                let spec = match registry.parse(&text) {
                    Ok(spec) => spec,
                    Err(SpecError::Param(e)) => {
                        assert!(e.to_string().contains("changes nothing"), "{text}: {e}");
                        refused += 1;
                        continue;
                    }
                    Err(e) => panic!("{text}: {e}"),
                };
                match (registry.build(&spec), &before) {
                    (Err(_), _) => refused += 1,
                    (Ok(_), None) => changed += 1,
                    (Ok(_), Some(before)) if answers(&registry, &spec, &frames) != *before => changed += 1,
                    _ => idle.push(text),
                }
            }
        }
    }
    assert!(idle.is_empty(), "{idle:#?}");
    assert!(
        changed > 250 && refused > 250,
        "{changed} changed, {refused} refused"
    );
}

/// With models whose gradient does not vanish at alignment; with the others they are refused.
fn second_order_terms_of_self_hessians_change_the_steps() {
    let registry = Registry::builtin();
    let frames = frames();
    let mut seen = 0;
    for sm in registry.sms().iter().filter(|e| e.groups.contains(&"gradient")) {
        for am in ["mi", "ccre", "ngf"] {
            for hess in ["initial_self", "current_self", "sum_of_self"] {
                let id = |more: &str| {
                    format!(
                        "{}/{am}/homography{{centred=0,hess={hess},res=16x16,max_iters=2{more}}}",
                        sm.name
                    )
                };
                let Ok(plain) = registry.parse(&id("")) else {
                    continue;
                };
                let more = registry.parse(&id(",second_order=1")).unwrap();
                let [a, b] = [plain, more].map(|spec| answers(&registry, &spec, &frames));
                assert_ne!(a, b, "{}", id(""));
                seen += 1;
            }
        }
    }
    assert!(seen >= 40, "{seen}");
    let refused = |text: &str| {
        registry
            .build(&registry.parse(text).unwrap())
            .err()
            .map(|e| e.to_string())
    };
    assert_eq!(
        refused("iclk/ncc/affine{second_order=1}").unwrap(),
        "iclk/ncc/affine{second_order=1}: second_order=1: changes nothing: the model's gradient vanishes at alignment, and with \
         it the terms of a self Hessian; try hess=std"
    );
    assert_eq!(
        refused("falk/ncc/affine{chained_warp=0}").unwrap(),
        "falk/ncc/affine{chained_warp=0}: chained_warp=0: changes nothing: falk reads no gradient of the warped image"
    );
    assert!(refused("falk/ncc/affine{chained_warp=0,hess=initial_self}").is_none());
    assert_eq!(
        registry.parse("pf/mi/affine{centred=0}").unwrap_err().to_string(),
        "centred=0: changes nothing that this search method uses"
    );
}
