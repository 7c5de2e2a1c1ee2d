//! Appearance models on the embedded dataset: what is plain is tracked closely, and changes of lighting by the models
//! made for them.

use mtf::am::AMS;
use mtf::image::{Frame, parse_preprocessor};
use mtf::registry::{Registry, Selection};
use mtf_eval::dataset;
use rayon::prelude::*;

crate::tests! {
    subspaces_features_and_sums_track_what_is_plain;
    a_sum_tracks_with_every_member_that_tracks_alone;
    measures_of_contrast_ratio_and_tone_are_exact_on_what_is_plain;
    models_made_for_it_follow_a_change_of_lighting;
}

/// Share of frames within 5 px, and the mean error, of each tracker on every `base` sequence with a tag.
fn track(tag: &str, trackers: &[String]) -> Vec<(String, f64, f64)> {
    track_some(tag, trackers, usize::MAX)
}

/// The same of each tracker on `count` of the sequences, which it takes in turn, so that each is tracked by many.
fn track_some(tag: &str, trackers: &[String], count: usize) -> Vec<(String, f64, f64)> {
    let registry = Registry::builtin();
    let sequences = dataset::builtin().unwrap().sequences;
    let tagged: Vec<_> = sequences
        .iter()
        .filter(|s| {
            ["base", tag]
                .iter()
                .all(|word| s.tags().iter().any(|t| t == word))
        })
        .collect();
    assert!(!tagged.is_empty(), "{tag}");
    let runs: Vec<Vec<(String, f64, f64)>> = tagged
        .par_iter()
        .enumerate()
        .map(|(at, sequence)| {
            let n = tagged.len();
            let takes = |k: usize| (at + n - (2 * k) % n) % n < count;
            let trackers = trackers.iter().enumerate().filter(|(k, _)| takes(*k));
            let trackers: Vec<&String> = trackers.map(|(_, id)| id).collect();
            let pre = parse_preprocessor("gaussian:5:3").unwrap();
            let frame = |i: usize| Frame::new(sequence.read(i, false).unwrap(), pre.clone());
            let truth = |i: usize| sequence.truth(i).unwrap();
            let first = frame(0);
            let start = |id: &&String| {
                let mut t = registry.build(&registry.parse(id).unwrap()).unwrap();
                t.init(&first, &truth(0)).unwrap();
                (t, 0.0, 0.0)
            };
            let mut running: Vec<_> = trackers.iter().map(start).collect();
            let n = (sequence.len() - 1) as f64;
            for i in 1..sequence.len() {
                let (frame, truth) = (frame(i), truth(i));
                for (tracker, hits, sum) in &mut running {
                    let _ = tracker.update(&frame);
                    let error = (tracker.corners().distance_squared(&truth) / 4.0).sqrt();
                    *hits += f64::from(u8::from(error <= 5.0));
                    *sum += error.min(20.0);
                }
            }
            let named = trackers.iter().zip(running);
            named
                .map(|(id, (_, hits, sum))| (format!("{id} on {}", sequence.name()), hits / n, sum / n))
                .collect()
        })
        .collect();
    runs.concat()
}

fn subspaces_features_and_sums_track_what_is_plain() {
    let list = |s: &str| vec![s.to_owned()];
    let selection = Selection {
        sm: list("gradient"),
        am: list("pca,dfm,sum"),
        ssm: list("homography"),
        ..Selection::default()
    };
    let expanded = Registry::builtin().expand(&selection).unwrap();
    let ids: Vec<String> = expanded.specs.iter().map(|s| s.to_string()).collect();
    assert!(
        ids.iter().any(|id| id.starts_with("fclk/pca")) && ids.iter().any(|id| id.starts_with("falk/pca"))
    );
    for (id, hits, mean) in track_some("plain", &ids, 2) {
        assert!(
            hits == 1.0 && mean < 0.5,
            "{id}: {hits} within 5 px, mean {mean} px"
        );
    }
}

fn a_sum_tracks_with_every_member_that_tracks_alone() {
    let members = AMS.iter().filter(|e| {
        let mut am = (e.build)(&[]).unwrap();
        e.name != "sum" && am.derivatives().is_some() && am.properties().tracks_alone
    });
    let ids: Vec<String> = members
        .map(|e| format!("fclk/sum/homography{{am1={},am2=zncc}}", e.name))
        .collect();
    for (id, hits, mean) in track_some("plain", &ids, 2) {
        assert!(
            hits == 1.0 && mean < 0.5,
            "{id}: {hits} within 5 px, mean {mean} px"
        );
    }
}

fn measures_of_contrast_ratio_and_tone_are_exact_on_what_is_plain() {
    for (model, bar) in [("lscv", 0.1), ("lrscv", 0.1), ("riu", 0.045), ("spss", 0.06)] {
        let runs = track("plain", &[format!("esm/{model}/homography")]);
        let mean = runs.iter().map(|(_, _, mean)| mean).sum::<f64>() / runs.len() as f64;
        assert!(mean <= bar, "{model}: mean {mean} px");
        assert!(runs.iter().all(|(_, hits, _)| *hits == 1.0), "{runs:?}");
    }
}

fn models_made_for_it_follow_a_change_of_lighting() {
    let models = ["zncc", "ncc", "riu", "scv", "rscv", "lscv", "lrscv", "dfm"];
    let ids: Vec<String> = models.iter().map(|am| format!("esm/{am}/homography")).collect();
    for (id, hits, mean) in track("lighting", &ids) {
        assert!(
            hits == 1.0 && mean < 1.0,
            "{id}: {hits} within 5 px, mean {mean} px"
        );
    }
}
