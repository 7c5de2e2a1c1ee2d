//! The tracker `best` on the embedded dataset.

use mtf_eval::dataset;
use mtf_eval::image::{Frame, parse_preprocessor};
use mtf_eval::registry::Registry;

/// Share of the frames within 5 px (RMS corner distance), and the mean distance, px.
fn run(name: &str) -> (f64, f64) {
    let registry = Registry::builtin();
    let mut tracker = registry.build(&registry.parse("best").unwrap()).unwrap();
    let data = dataset::builtin().unwrap();
    let sequence = data.sequences.iter().find(|s| s.name() == name).unwrap();
    let smooth = parse_preprocessor("gaussian:5:3").unwrap();
    let frame = |i| Frame::new(sequence.read(i, false).unwrap(), smooth.clone());
    tracker.init(&frame(0), &sequence.truth(0).unwrap()).unwrap();
    let errors: Vec<f64> = (1..sequence.len())
        .map(|i| {
            let update = tracker.update(&frame(i)).unwrap();
            assert!((0.0..=1.0).contains(&update.similarity));
            (update.corners.distance_squared(&sequence.truth(i).unwrap()) / 4.0).sqrt()
        })
        .collect();
    let n = errors.len() as f64;
    let near = errors.iter().filter(|e| **e <= 5.0).count() as f64;
    (near / n, errors.iter().sum::<f64>() / n)
}

/// Every sequence but `bending`, whose sheet is no plane.
#[test]
fn planes_are_tracked_whatever_is_hard_about_them() {
    let data = dataset::builtin().unwrap();
    let names = data
        .sequences
        .iter()
        .map(|s| s.name())
        .filter(|n| *n != "bending");
    let mut count = 0;
    for name in names {
        let (near, mean) = run(name);
        println!("{name} {near} {mean}");
        assert!(
            near >= 0.95 && mean < 1.0,
            "{name}: {near} of the frames, mean error {mean}"
        );
        count += 1;
    }
    assert!(count >= 12);
}

#[test]
fn runs_repeat() {
    assert_eq!(run("occlusion"), run("occlusion"));
}
