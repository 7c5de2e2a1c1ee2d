//! Illumination models and robust losses on the embedded sequences made for them.

use mtf::image::{Frame, parse_preprocessor};
use mtf_eval::dataset;
use mtf_eval::prelude::*;

crate::tests! {
    under_changing_light_ssd_is_lost_and_the_models_for_it_track;
    under_occlusion_zncc_is_lost_and_its_robust_form_tracks;
}

/// Fraction of frames of an embedded sequence with an alignment error of at most five pixels.
fn success(sequence: &str, ids: &[&str]) -> Vec<f64> {
    let data = dataset::builtin().unwrap();
    let sequence = data.sequences.iter().find(|s| s.name() == sequence).unwrap();
    let pre = parse_preprocessor("gaussian:5:3").unwrap();
    let registry = Registry::builtin();
    let build = |id: &&str| registry.build(&registry.parse(id).unwrap()).unwrap();
    let mut trackers: Vec<_> = ids.iter().map(build).collect();
    let mut good = vec![0; ids.len()];
    for i in 0..sequence.len() {
        let frame = Frame::new(sequence.read(i, false).unwrap(), pre.clone());
        let truth = sequence.truth(i).unwrap();
        for (tracker, good) in trackers.iter_mut().zip(&mut good) {
            if i == 0 {
                tracker.init(&frame, &truth).unwrap();
            } else if let Ok(update) = tracker.update(&frame) {
                *good += usize::from(alignment_error(&update.corners, &truth) <= 5.0);
            }
        }
    }
    good.iter()
        .map(|g| *g as f64 / (sequence.len() - 1) as f64)
        .collect()
}

fn under_changing_light_ssd_is_lost_and_the_models_for_it_track() {
    let ids = [
        "esm/ssd/homography",
        "esm/ssd+gb/homography",
        "esm/ssd+pgb/homography",
        "esm/ssd+rbf/homography",
        "iclk/ssd+gb/homography",
        "fclk/ssd+pgb/homography",
        "esm/ncc/homography",
        "esm/zncc/homography",
        "esm/mi/homography",
        "esm/scv/homography",
        "esm/ssim/homography",
    ];
    let rates = success("lighting", &ids);
    assert!(rates[0] < 0.95, "{ids:?}: {rates:?}");
    assert!(rates[1..].iter().all(|r| *r >= 0.95), "{ids:?}: {rates:?}");
}

fn under_occlusion_zncc_is_lost_and_its_robust_form_tracks() {
    let ids = [
        "esm/zncc/homography",
        "esm/zncc/homography{robust=tukey}",
        "esm/ncc/homography{robust=tukey}",
        "iclk/zncc/homography{robust=tukey}",
    ];
    let rates = success("occlusion", &ids);
    assert!(rates[0] < 0.95, "{ids:?}: {rates:?}");
    assert!(rates[1..].iter().all(|r| *r >= 0.95), "{ids:?}: {rates:?}");
}
