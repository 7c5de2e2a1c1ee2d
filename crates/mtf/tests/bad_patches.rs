//! Patches on which nothing can be measured: every appearance model reports them or gives sound numbers. Loops over the
//! table, so a new model is tested by being listed.

use crate::common::{alignment_error, moved};
use mtf::Jacobian;
use mtf::am::{AMS, AppearanceModel, Curvature, Normal, PatchShape, Side, begin_frame};
use mtf::diagnose::Waves;
use mtf::geom::{Corners, Mat3};
use mtf::image::{Frame, Image};
use mtf::params::Resolution;
use mtf::registry::{Registry, Selection};
use mtf::tracker::TrackError;

crate::tests! {
    patches_without_content_are_refused_or_give_sound_numbers;
    a_pixel_that_is_no_number_is_forgotten_with_its_patch;
    trackers_on_bad_frames_and_tiny_grids_fail_or_stay_finite;
}

const SHAPES: [(usize, usize); 5] = [(1, 1), (2, 2), (1, 9), (9, 1), (13, 11)];

fn patches(shape: PatchShape) -> Vec<(&'static str, Vec<f32>)> {
    let waves = Waves::new(4);
    let at = |i: usize| {
        [
            (i % shape.res.cols) as f64 * 4.0,
            (i / shape.res.cols) as f64 * 4.0,
        ]
    };
    let n = shape.len();
    let textured: Vec<f32> = (0..n).map(|i| waves.at(at(i)) as f32).collect();
    let clipped = textured.iter().map(|&v| if v > 128.0 { 255.0 } else { 0.0 });
    let mut speck = vec![0.0; n];
    speck[n / 2] = 255.0;
    vec![
        ("clipped", clipped.collect()),
        ("black", vec![0.0; n]),
        ("gray", vec![77.7; n]),
        ("white", vec![255.0; n]),
        ("speck", speck),
        ("textured", textured),
    ]
}

/// Everything a model can be asked is a number; likelihoods lie between 0 and 1.
fn assert_sound(am: &mut dyn AppearanceModel, shape: PatchShape, patches: &[&[f32]], what: &str) {
    let n = shape.len();
    assert!(am.similarity().is_finite(), "{what}: f = {}", am.similarity());
    let likelihood = am.likelihood();
    assert!(
        (0.0..=1.0 + 1e-6).contains(&likelihood),
        "{what}: likelihood {likelihood}"
    );
    let features: Vec<Vec<f32>> = patches
        .iter()
        .map(|p| {
            let mut f = vec![f32::NAN; am.distances().unwrap().feature_len()];
            am.distances().unwrap().feature_into(p, &mut f);
            assert!(f.iter().all(|v| v.is_finite()), "{what}: feature");
            f
        })
        .collect();
    for f in &features {
        assert!(
            am.distances()
                .unwrap()
                .distance(f, &features[0], f32::INFINITY)
                .is_finite(),
            "{what}: distance"
        );
    }
    if am.derivatives().is_none() {
        return;
    }
    let mut j = Jacobian::new(n, 3);
    for k in 0..3 {
        let value = |(i, v): (usize, &mut f32)| *v = ((i * (k + 2) + k) as f32).sin() * 10.0;
        j.col_mut(k).iter_mut().enumerate().for_each(value);
    }
    for side in [Side::Template, Side::Current] {
        let mut g = vec![f32::NAN; n];
        am.derivatives().unwrap().gradient_into(side, &mut g);
        assert!(g.iter().all(|v| v.is_finite()), "{what}: gradient, {side:?}");
        for curvature in [Curvature::SelfHessian, Curvature::Standard] {
            let mut out = Normal::new(3);
            am.derivatives()
                .unwrap()
                .linearise(side, curvature, &j, &mut g, &mut out);
            let entries = (0..9).map(|i| out.hessian.get(i / 3, i % 3));
            let mut all = entries.chain(out.gradient.iter().copied());
            assert!(
                all.all(f64::is_finite),
                "{what}: {curvature:?}, {side:?}: {out:?}"
            );
        }
    }
}

fn patches_without_content_are_refused_or_give_sound_numbers() {
    for entry in AMS {
        let mut accepted = 0;
        for (cols, rows) in SHAPES {
            for channels in [1, 3] {
                let res = Resolution { cols, rows };
                let shape = PatchShape { res, channels };
                let patches = patches(shape);
                for (template, t) in &patches {
                    let mut am = (entry.build)(&[]).unwrap();
                    match am.set_template(shape, t) {
                        Ok(()) => {}
                        Err(TrackError::Template(_) | TrackError::NotFinite(_)) => continue,
                        Err(e) => panic!("{}: {e}", entry.name),
                    }
                    for (current, c) in &patches {
                        begin_frame(&mut am);
                        am.set_current(c);
                        let what = format!("{}, {res}x{channels}, {template}, {current}", entry.name);
                        assert_sound(&mut *am, shape, &[t, c], &what);
                        accepted += 1;
                    }
                }
            }
        }
        // At least the texture as a template, in gray and in colour, with each patch.
        assert!(accepted >= 12, "{}: {accepted}", entry.name);
    }
}

/// A pixel that is no number spoils the patch it is in, and nothing after it.
fn a_pixel_that_is_no_number_is_forgotten_with_its_patch() {
    let res = Resolution { cols: 13, rows: 11 };
    let shape = PatchShape { res, channels: 1 };
    let (_, textured) = patches(shape).pop().unwrap();
    let other: Vec<f32> = textured.iter().map(|v| 0.8 * v + 20.0 + (v % 7.0)).collect();
    for entry in AMS {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut spoilt = other.clone();
            spoilt[70] = bad;
            let [mut am, mut fresh] = [0; 2].map(|_| (entry.build)(&[]).unwrap());
            am.set_template(shape, &textured).unwrap();
            fresh.set_template(shape, &textured).unwrap();
            am.set_current(&spoilt);
            let _ = (am.similarity(), am.likelihood());
            if let Some(model) = am.learner() {
                model.learn(&spoilt);
            }
            let mut feature = vec![0.0; am.distances().unwrap().feature_len()];
            am.distances().unwrap().feature_into(&spoilt, &mut feature);
            let _ = am
                .distances()
                .unwrap()
                .distance(&feature, &feature, f32::INFINITY);
            if am.derivatives().is_some() {
                let mut g = vec![0.0; shape.len()];
                am.derivatives().unwrap().gradient_into(Side::Current, &mut g);
            }
            begin_frame(&mut am);
            am.set_current(&other);
            begin_frame(&mut fresh);
            fresh.set_current(&other);
            assert_sound(&mut *am, shape, &[&textured, &other], entry.name);
            assert_eq!(am.similarity(), fresh.similarity(), "{} after {bad}", entry.name);
        }
    }
}

fn trackers_on_bad_frames_and_tiny_grids_fail_or_stay_finite() {
    const SIZE: (usize, usize) = (120, 100);
    let quad = Corners([[31.3, 30.2], [84.7, 25.9], [90.1, 70.4], [26.6, 75.0]]);
    let waves = Waves::new(5);
    let still = moved(&waves, SIZE, &Mat3::identity());
    let value = |f: &dyn Fn(f32) -> f32| {
        let at = |x: usize, y: usize| f(waves.at([x as f64, y as f64]) as f32);
        Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, at))
    };
    let bad = [
        value(&|_| 0.0),
        value(&|_| 255.0),
        value(&|v| if v > 128.0 { 255.0 } else { 0.0 }),
        value(&|v| if v > 200.0 { f32::NAN } else { v }),
        value(&|_| f32::NAN),
        value(&|_| f32::INFINITY),
    ];
    let registry = Registry::builtin();
    let list = |s: &str| vec![s.to_owned()];
    let (mut started, mut answers) = (0, 0);
    for res in ["2x2", "2x30", "30x2", "20x20"] {
        let selection = Selection {
            sm: list("all"),
            am: list("all"),
            ssm: list("translation,homography"),
            set: vec![("res".to_owned(), res.to_owned())],
            ..Selection::default()
        };
        for spec in registry.expand(&selection).unwrap().specs {
            let mut tracker = registry.build(&spec).unwrap();
            for frame in &bad {
                if tracker.init(frame, &quad).is_ok() {
                    assert!(tracker.corners().is_finite(), "{spec}");
                }
            }
            if tracker.init(&still, &quad).is_err() {
                continue;
            }
            started += 1;
            for frame in bad.iter().chain([&still]) {
                if let Ok(update) = tracker.update(frame) {
                    answers += 1;
                    assert!(update.similarity.is_finite(), "{spec}");
                    assert!(update.corners.is_finite(), "{spec}");
                }
                assert!(tracker.corners().is_finite(), "{spec}");
            }
            // A search by samples may end anywhere with a model that tells few of them apart.
            let precise = registry
                .sms()
                .iter()
                .any(|e| e.name == spec.parts().0 && e.groups.contains(&"gradient"));
            if res == "20x20" && precise {
                tracker.set_region(&quad).unwrap();
                let update = tracker.update(&still).unwrap_or_else(|e| panic!("{spec}: {e}"));
                assert!(alignment_error(&update.corners, &quad) < 1.0, "{spec}");
            }
        }
    }
    assert!(started > 300 && answers > started, "{answers} of {started}");
    let one = registry.parse("esm/ssd/homography{res=1x1}");
    let message = one.unwrap_err().to_string();
    assert!(message.starts_with("res=1x1: expected "), "{message}");
}
