//! Search methods that sample, with the parameters and in the places that [`mtf::conformance`] does not try.

use crate::common::{alignment_error, moved, perturbation, rng};
use mtf::diagnose::Waves;
use mtf::geom::{Corners, Mat3, homography};
use mtf::image::{Frame, Image};
use mtf::registry::{Registry, Selection, SpecError};
use mtf::tracker::{TrackError, Tracker};

crate::tests! {
    the_seed_decides_everything;
    standing_still_stays_still;
    set_region_keeps_the_template;
    failures_are_typed_and_leave_the_tracker_usable;
    every_option_tracks;
    geometric_samples_track;
    what_cannot_work_is_refused_with_a_reason;
}

const SIZE: (usize, usize) = (240, 200);
/// Small enough for a test, large enough to track.
const SMALL: [(&str, &str); 4] = [
    ("n_samples", "600"),
    ("n_particles", "250"),
    ("res", "30"),
    ("max_iters", "8"),
];

fn quad() -> Corners {
    Corners([[71.3, 60.2], [164.7, 55.9], [170.1, 140.4], [66.6, 145.0]])
}

fn still(waves: &Waves) -> Frame {
    moved(waves, SIZE, &Mat3::identity())
}

/// Every method that samples with every appearance model or warp of the lists that it accepts.
fn all(am: &str, ssm: &str) -> Vec<(String, Box<dyn Tracker>)> {
    let registry = Registry::builtin();
    let list = |s: &str| vec![s.to_owned()];
    let selection = Selection {
        sm: list("stochastic,learned"),
        am: list(am),
        ssm: list(ssm),
        set: SMALL.map(|(k, v)| (k.to_owned(), v.to_owned())).to_vec(),
        ..Selection::default()
    };
    let specs = registry.expand(&selection).unwrap().specs;
    specs
        .iter()
        .map(|s| (s.to_string(), registry.build(s).unwrap()))
        .collect()
}

fn build(id: &str) -> Box<dyn Tracker> {
    let registry = Registry::builtin();
    registry.build(&registry.parse(id).unwrap()).unwrap()
}

fn the_seed_decides_everything() {
    let waves = Waves::new(4);
    let motion = perturbation(&quad(), 2.0, &mut rng(5));
    let (first, next) = (still(&waves), moved(&waves, SIZE, &motion));
    for (id, mut tracker) in all("ssd", "homography,similitude") {
        let mut run = |seed| {
            tracker.reseed(seed);
            tracker.init(&first, &quad()).unwrap();
            let once = tracker.update(&next).unwrap().corners;
            (once, tracker.update(&first).unwrap().corners)
        };
        let a = run(7);
        assert_eq!(a, run(7), "{id}");
        assert_ne!(a, run(8), "{id}");
    }
}

fn standing_still_stays_still() {
    let waves = Waves::new(3);
    for (id, mut tracker) in all("ssd,ncc,sad", "homography,translation") {
        tracker.init(&still(&waves), &quad()).unwrap();
        for _ in 0..3 {
            tracker.update(&still(&waves)).unwrap();
        }
        let error = alignment_error(&tracker.corners(), &quad());
        assert!(
            error < if id.starts_with("nn") { 1e-6 } else { 0.4 },
            "{id}: {error} px"
        );
    }
}

fn set_region_keeps_the_template() {
    // The object turned by 70 degrees and scaled by 1.2: beyond any search from the old place.
    let waves = Waves::new(8);
    let c = quad().centroid();
    let (s, k) = (70f64.to_radians().sin() * 1.2, 70f64.to_radians().cos() * 1.2);
    let around = |x: f64, y: f64| Mat3::new(1.0, 0.0, x, 0.0, 1.0, y, 0.0, 0.0, 1.0);
    let turn = around(c[0], c[1]) * Mat3::new(k, -s, 0.0, s, k, 0.0, 0.0, 0.0, 1.0) * around(-c[0], -c[1]);
    let truth = homography::apply_corners(&turn, &quad());
    let next = moved(&waves, SIZE, &turn);
    // Translation must take the turned region as a new base, and its samples with it.
    for (id, mut tracker) in all("ncc", "homography,affine,similitude,translation,isometry") {
        tracker.init(&still(&waves), &quad()).unwrap();
        tracker.set_region(&truth.translated(1.7, -1.1)).unwrap();
        let update = tracker.update(&next).unwrap_or_else(|e| panic!("{id}: {e}"));
        let error = alignment_error(&update.corners, &truth);
        assert!(error < 0.8, "{id}: {error} px");
    }
}

fn failures_are_typed_and_leave_the_tracker_usable() {
    let waves = Waves::new(6);
    let flat = || Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, |_, _| 90.0));
    let poisoned = || Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, |_, _| f32::NAN));
    for (id, mut tracker) in all("ssd,ncc,sad", "homography") {
        assert_eq!(
            tracker.update(&still(&waves)).unwrap_err(),
            TrackError::NotInitialised,
            "{id}"
        );
        assert!(matches!(
            tracker.init(&flat(), &quad()),
            Err(TrackError::Template(_))
        ));
        assert!(matches!(
            tracker.init(&poisoned(), &quad()),
            Err(TrackError::NotFinite(_))
        ));
        let away = quad().translated(5000.0, 0.0);
        assert_eq!(
            tracker.init(&still(&waves), &away).unwrap_err(),
            TrackError::Outside
        );
        let tiny = Corners::rect(50.0, 50.0, 0.5, 0.5);
        assert!(matches!(
            tracker.init(&still(&waves), &tiny),
            Err(TrackError::BadRegion(_))
        ));
        tracker.init(&still(&waves), &quad()).unwrap();
        assert!(tracker.update(&poisoned()).is_err(), "{id}");
        let _ = tracker.update(&flat());
        assert!(tracker.corners().is_finite(), "{id}");
        tracker.set_region(&quad()).unwrap();
        let update = tracker.update(&still(&waves)).unwrap();
        assert!(alignment_error(&update.corners, &quad()) < 0.5, "{id}");
    }
}

fn every_option_tracks() {
    let waves = Waves::new(12);
    let motion = perturbation(&quad(), 2.5, &mut rng(3));
    let truth = homography::apply_corners(&motion, &quad());
    let (first, next) = (still(&waves), moved(&waves, SIZE, &motion));
    let mut options: Vec<(String, f64)> = Vec::new();
    for o in [
        "update=additive",
        "dynamics=random_walk",
        "perturb=points",
        "perturb=params,sigma=0.02",
        "pix_sigma=3",
        "pix_sigma=4|2|1,adapt_sets=1",
        "unit=side,sigma=0.02:0.02",
        "sigma=4:4|2:2|1:1,adapt_sets=1",
        "likelihood=am",
        "likelihood=gaussian",
        "mean=best",
        "mean=state",
        "mean=group",
        "resampling=binary,reset_to_mean=0",
        "resampling=linear,reset_to_mean=0",
        "resampling=residual,reset_to_mean=0",
        "resampling=systematic,reset_to_mean=0,adaptive_resampling=0.3",
    ] {
        options.push((
            format!("pf/ncc/homography{{n_particles=400,max_iters=5,res=30,{o}}}"),
            1.2,
        ));
    }
    // Weights that hardly tell particles apart, or that a few soon have all of.
    for o in ["likelihood=reciprocal", "resampling=none,reset_to_mean=0"] {
        options.push((
            format!("pf/ncc/homography{{n_particles=400,max_iters=5,res=30,{o}}}"),
            4.0,
        ));
    }
    for o in [
        "update=additive",
        "index=linear",
        "index=kd",
        "index=gnn",
        "index=fgnn,degree=60",
        "index=kmeans",
        "index=kmeans,centres=gonzales,kmeans_iters=0",
        "index=composite",
        "index=hierarchical,centres=kmeanspp",
        "pix_sigma=0.5|1|2|4",
        "neighbours=40",
        "neighbours=20,index=linear,update=additive",
        "unit=side,sigma=0.03:0.02|0.01:0.005",
        "perturb=points",
    ] {
        let limit = if o.contains("neighbours") { 0.3 } else { 1.2 };
        options.push((format!("nn/ncc/homography{{n_samples=1000,res=30,{o}}}"), limit));
    }
    for o in ["pool=1", "channels=3", "sigma=4:2", "ridge=0.01", "n_samples=200"] {
        options.push((format!("regression/zncc/homography{{n_samples=500,{o}}}"), 0.5));
    }
    for (id, limit) in options {
        let mut tracker = build(&id);
        tracker.init(&first, &quad()).unwrap();
        let update = tracker.update(&next).unwrap_or_else(|e| panic!("{id}: {e}"));
        let error = alignment_error(&update.corners, &truth);
        assert!(error < limit, "{id}: {error} px");
    }
}

/// Samples of shift, scale and angles find a motion of that kind.
fn geometric_samples_track() {
    let waves = Waves::new(5);
    let [cx, cy] = quad().centroid();
    let (sin, cos) = (1.03 * 0.03_f64.sin(), 1.03 * 0.03_f64.cos());
    let (tx, ty) = (cx + 2.0 - cos * cx + sin * cy, cy - 1.5 - sin * cx - cos * cy);
    let motion = Mat3::new(cos, -sin, tx, sin, cos, ty, 0.0, 0.0, 1.0);
    let truth = homography::apply_corners(&motion, &quad());
    let (first, next) = (still(&waves), moved(&waves, SIZE, &motion));
    for id in [
        "pf/ncc/similitude{perturb=geometric,sigma=2:2:0.03:0.03,max_iters=5,res=30}",
        "pf/ncc/similitude{perturb=geometric,sigma=2:2:0.03:0.03,max_iters=5,res=30,update=additive}",
        "pf/ncc/affine{perturb=geometric,sigma=2:2:0.03:0.03:0.02:0.5,max_iters=5,res=30,update=additive}",
        "nn/ncc/affine{perturb=geometric,sigma=2:2:0.03:0.03:0.02:0.5|0.5:0.5:0.01:0.01:0.005:0.5,res=30}",
        "nn/ncc/similitude{perturb=geometric,sigma=2:2:0.03:0.03|0.5:0.5:0.01:0.01,res=30}",
    ] {
        let mut tracker = build(id);
        tracker.init(&first, &quad()).unwrap();
        let update = tracker.update(&next).unwrap_or_else(|e| panic!("{id}: {e}"));
        let error = alignment_error(&update.corners, &truth);
        assert!(error < 1.0, "{id}: {error} px");
    }
}

fn what_cannot_work_is_refused_with_a_reason() {
    let registry = Registry::builtin();
    let refused = |id: &str| match registry.build(&registry.parse(id).unwrap()) {
        Err(SpecError::Refused { reason, .. }) => reason,
        _ => panic!("{id} was built"),
    };
    for (id, words) in [
        ("regression/mi/homography", "no features with Euclidean distances"),
        ("regression/ssd/spline", "does not compose"),
        (
            "nn/mi/homography{index=kd}",
            "auto, linear, hierarchical, gnn, fgnn",
        ),
        ("nn/mi/homography{index=kmeans}", "not those of vectors"),
        (
            "nn/sad/homography{index=composite}",
            "auto, linear, kd, hierarchical, gnn, fgnn with an appearance model whose distances are sums of",
        ),
        ("kmn/mi/homography", "index=kmeans"),
        (
            "pf/ssd/homography{perturb=geometric,sigma=1:1:1:1:1:1:1:1}",
            "no geometric parameters",
        ),
        (
            "nn/ssd/affine{perturb=geometric}",
            "6 numbers in each set with perturb=geometric",
        ),
        ("pf/ssd/homography{sigma=1:2:3}", "1 or 2 or 8 numbers"),
        ("pf/ssd/affine{pix_sigma=2,perturb=points}", "leave out one"),
        ("nn/ssd/affine{pix_sigma=1:2}", "one number"),
        ("pf/ssd/affine{pix_sigma=2,adapt_sets=1}", "single set"),
        (
            "nn/ssim/homography{neighbours=5}",
            "whose distances are not those of vectors",
        ),
    ] {
        let reason = refused(id);
        assert!(reason.contains(words), "{id}: {reason}");
    }
    // Some warps have their parameters, whose number deviations must fit, only when they start.
    let mut tracker = build("pf/ssd/spline{perturb=params,sigma=1:2:3}");
    assert!(tracker.init(&still(&Waves::new(1)), &quad()).is_err());
}
