//! Starts and updates end early when they are interrupted, whatever the tracker.

use crate::common::moved;
use mtf::diagnose::Waves;
use mtf::geom::{Corners, Mat3};
use mtf::image::Frame;
use mtf::interrupt::{self, Interrupted, Token};
use mtf::registry::Registry;
use mtf::tracker::{TrackError, Tracker};
use std::time::Duration;

crate::tests! {
    no_update_goes_on;
    long_starts_end;
    a_tracker_starts_anew_after_an_interruption;
}

const INTERRUPTED: TrackError = TrackError::Interrupted(Interrupted);
const REGION: Corners = Corners([[50.0, 40.0], [150.0, 44.0], [146.0, 120.0], [48.0, 118.0]]);

fn frame(dx: f64) -> Frame {
    let shift = Mat3::new(1.0, 0.0, dx, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    moved(&Waves::new(3), (200, 160), &shift)
}

fn build(text: &str) -> Box<dyn Tracker> {
    let registry = Registry::builtin();
    let spec = registry.parse(text).unwrap_or_else(|e| panic!("{text}: {e}"));
    let mut tracker = registry.build(&spec).unwrap_or_else(|e| panic!("{text}: {e}"));
    tracker.reseed(1);
    tracker
}

fn set() -> Token {
    let token = Token::default();
    token.interrupt();
    token
}

/// Trackers of every kind.
fn kinds() -> Vec<String> {
    let registry = Registry::builtin();
    let sms = registry.sms().iter().map(|e| e.name);
    let short = registry.short().iter().map(|e| e.name);
    let singles = sms.chain(short).map(|sm| format!("{sm}/ssd/homography"));
    let composites = [
        "best",
        "feature",
        "flow",
        "grid(flow)",
        "grid(iclk/ssd/translation)",
        "line(iclk/ssd/translation)",
        "pyramid(esm/ssd/homography)",
        "cascade(esm/ssd/homography, nn/ssd/homography)",
        "parallel(esm/ssd/homography, iclk/ssd/homography)",
        "guard(esm/ssd/homography, feature)",
        "rklt(flow, esm/ssd/homography)",
    ];
    singles.chain(composites.map(str::to_owned)).collect()
}

fn no_update_goes_on() {
    let (first, second) = (frame(0.0), frame(3.0));
    for text in kinds() {
        for threads in [1, 2] {
            let mut tracker = build(&text);
            tracker.set_threads(threads);
            tracker
                .init(&first, &REGION)
                .unwrap_or_else(|e| panic!("{text}: {e}"));
            if let Some(analysis) = tracker.needs_truth() {
                analysis.tell_truth(&REGION);
            }
            let update = interrupt::with(&set(), || tracker.update(&second));
            assert_eq!(update.err(), Some(INTERRUPTED), "{text}, {threads} threads");
        }
    }
}

fn long_starts_end() {
    let first = frame(0.0);
    // Each takes seconds.
    for text in [
        "nn/ssd/homography{n_samples=300000,res=10x10}",
        "nn/mi/homography{n_samples=20000,res=10x10,index=gnn}",
        "nn/mi/homography{n_samples=20000,res=10x10,index=hierarchical,trees=10}",
        "nn/ssd/homography{n_samples=50000,res=20x20,index=kmeans,branching=200}",
        "regression/ssd/homography{n_samples=200000,res=20x20}",
        "grid(esm/ssd/affine; size=200x200)",
        "grid(flow{klt_window=101}; size=300x300)",
        "grid(grid(iclk/ssd/translation{res=9x9}; size=30x30); size=30x30)",
        "pyramid(grid(nn/ssd/affine{n_samples=500,res=10x10}; size=30x30))",
        "cascade(nn/ssd/homography{n_samples=300000,res=10x10}, esm/ssd/homography)",
        "parallel(esm/ssd/homography, grid(esm/ssd/affine; size=200x200))",
        "guard(grid(esm/ssd/affine; size=200x200))",
        "rklt(flow, nn/ssd/homography{n_samples=300000,res=10x10})",
    ] {
        for threads in [1, 2] {
            let (mut tracker, token) = (build(text), Token::default());
            tracker.set_threads(threads);
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    std::thread::sleep(Duration::from_millis(30));
                    token.interrupt();
                });
                let started = interrupt::with(&token, || tracker.init(&first, &REGION));
                assert_eq!(started, Err(INTERRUPTED), "{text}, {threads} threads");
            });
        }
    }
}

fn a_tracker_starts_anew_after_an_interruption() {
    let (first, second) = (frame(0.0), frame(3.0));
    for text in kinds() {
        let track = |tracker: &mut Box<dyn Tracker>| {
            tracker.init(&first, &REGION)?;
            if let Some(analysis) = tracker.needs_truth() {
                analysis.tell_truth(&REGION);
            }
            tracker.update(&second).map(|update| update.corners)
        };
        let mut tracker = build(&text);
        assert!(interrupt::with(&set(), || track(&mut tracker)).is_err(), "{text}");
        assert_eq!(track(&mut tracker), track(&mut build(&text)), "{text}");
    }
}
