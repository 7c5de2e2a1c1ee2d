//! Whole trackers on a moving textured plane, 50x50 samples: microseconds per frame and per iteration, and the ratio
//! of boxed models (as the registry builds them) to static types.
//!
//! `cargo bench --bench trackers`

mod common;

use common::{fastest, row};
use mtf_eval::diagnose::Waves;
use mtf_eval::geom::{Corners, Mat3, homography};
use mtf_eval::prelude::*;

const SIZE: (usize, usize) = (640, 480);

/// Frames of a plane that swings by a few pixels a frame and returns.
fn frames() -> Vec<Frame> {
    let waves = Waves::new(3);
    let centre = [320.0, 240.0];
    (0..12)
        .map(|i| {
            let t = std::f64::consts::TAU * f64::from(i) / 12.0;
            let (dx, dy, turn, zoom) = (
                5.0 * t.sin(),
                4.0 * (t.cos() - 1.0),
                0.02 * t.sin(),
                1.0 + 0.02 * t.sin(),
            );
            let m = Mat3::new(
                zoom * turn.cos(),
                -turn.sin(),
                dx,
                turn.sin(),
                zoom * turn.cos(),
                dy,
                1e-5 * t.sin(),
                0.0,
                1.0,
            );
            let back = m.try_inverse().expect("small motion");
            let value = |x: usize, y: usize| {
                let p = homography::apply(&back, [x as f64 - centre[0], y as f64 - centre[1]]);
                waves.at([p[0] + centre[0], p[1] + centre[1]]) as f32
            };
            Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, value))
        })
        .collect()
}

/// Seconds per frame and mean iterations per frame over one round of the swing.
fn time(tracker: &mut dyn Tracker, frames: &[Frame], start: &Corners) -> (f64, f64) {
    tracker.init(&frames[0], start).expect("textured");
    let mut round = || {
        let updates = frames[1..]
            .iter()
            .chain(&frames[..1])
            .map(|f| tracker.update(f).expect("easy").iterations);
        updates.sum::<u32>()
    };
    let iterations = f64::from(round()) / frames.len() as f64;
    (fastest(&mut round) / frames.len() as f64, iterations)
}

fn main() {
    println!("instruction set: {}", mtf_eval::kernels::simd_level().name());
    let frames = frames();
    let start = Corners([[210.3, 150.1], [430.7, 158.2], [425.4, 332.9], [205.0, 326.3]]);
    let registry = Registry::builtin();
    let mut measured = std::collections::BTreeMap::new();
    for sm in registry.sms() {
        for am in registry.ams() {
            let spec = registry
                .parse(&format!("{}/{}/homography", sm.name, am.name))
                .expect("known names");
            let Ok(mut tracker) = registry.build(&spec) else {
                continue;
            };
            let (seconds, iterations) = time(&mut *tracker, &frames, &start);
            let (us, per) = (seconds * 1e6, seconds * 1e6 / iterations);
            println!(
                "{:28} {us:9.1} us/frame {iterations:6.2} iterations {per:8.2} us/iteration",
                spec.to_string()
            );
            measured.insert(spec.to_string(), seconds);
        }
    }
    let mut esm = Esm::new(Ssd::default(), Homography::new());
    let fixed = time(&mut esm, &frames, &start).0;
    row(
        "esm/ssd/homography, static types",
        fixed,
        "boxed",
        measured["esm/ssd/homography"],
    );
    let mut iclk = Iclk::new(Ssd::default(), Homography::new());
    let fixed = time(&mut iclk, &frames, &start).0;
    row(
        "iclk/ssd/homography, static types",
        fixed,
        "boxed",
        measured["iclk/ssd/homography"],
    );
}
