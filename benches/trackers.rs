//! Whole trackers on a moving textured plane, 50x50 samples: microseconds per frame and per iteration; what an iteration
//! of ESM costs with each appearance model, as a multiple of SSD's; and the ratio of boxed models (as the registry builds
//! them) to static types.
//!
//! `cargo bench --bench trackers`

mod common;

use common::{fastest, row};
use mtf::diagnose::Waves;
use mtf::geom::{Corners, Mat3, homography};
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

/// What a tracker takes.
#[derive(Clone, Copy)]
struct Time {
    /// Seconds per frame.
    frame: f64,
    /// Mean iterations per frame.
    iterations: f64,
}

impl Time {
    fn us_per_iteration(&self) -> f64 {
        self.frame * 1e6 / self.iterations
    }
}

/// Times one round of the swing; fails where the tracker does.
fn time(tracker: &mut dyn Tracker, frames: &[Frame], start: &Corners) -> Result<Time, TrackError> {
    tracker.init(&frames[0], start)?;
    let mut round = || -> Result<u32, TrackError> {
        let order = frames[1..].iter().chain(&frames[..1]);
        order.map(|f| Ok(tracker.update(f)?.iterations)).sum()
    };
    let n = frames.len() as f64;
    Ok(Time {
        iterations: f64::from(round()?) / n,
        frame: fastest(&mut round) / n,
    })
}

/// Builds and times a tracker; why not, where that does not go.
fn time_by_name(registry: &Registry, id: &str, frames: &[Frame], start: &Corners) -> Result<Time, String> {
    let spec = registry.parse(id).map_err(|e| e.to_string())?;
    let mut tracker = registry.build(&spec).map_err(|e| e.to_string())?;
    time(&mut *tracker, frames, start).map_err(|e| format!("{id}: {e}"))
}

fn main() {
    println!("instruction set: {}", mtf::simd_level().name());
    let frames = frames();
    let start = Corners([[210.3, 150.1], [430.7, 158.2], [425.4, 332.9], [205.0, 326.3]]);
    let registry = Registry::builtin();
    let mut measured = std::collections::BTreeMap::new();
    for sm in registry.sms() {
        for am in registry.ams() {
            let id = format!("{}/{}/homography", sm.name, am.name);
            match time_by_name(&registry, &id, &frames, &start) {
                Ok(t) => {
                    let (us, per) = (t.frame * 1e6, t.us_per_iteration());
                    let count = t.iterations;
                    println!("{id:28} {us:9.1} us/frame {count:6.2} iterations {per:8.2} us/iteration");
                    measured.insert(id, t);
                }
                Err(why) => println!("{id:28} skipped: {why}"),
            }
        }
    }
    let esm = |am: &str| measured.get(&format!("esm/{am}/homography"));
    if let Some(ssd) = esm("ssd") {
        println!("an iteration of ESM, homography:");
        for am in registry.ams() {
            match esm(am.name) {
                Some(t) => {
                    let (us, times) = (
                        t.us_per_iteration(),
                        t.us_per_iteration() / ssd.us_per_iteration(),
                    );
                    println!("{:8} {us:9.2} us {times:8.2} x ssd", am.name);
                }
                None => println!("{:8} skipped: see above", am.name),
            }
        }
    }
    let fixed = [
        (
            "esm/ssd/homography",
            time(&mut Esm::new(Ssd::default(), Homography::new()), &frames, &start),
        ),
        (
            "iclk/ssd/homography",
            time(&mut Iclk::new(Ssd::default(), Homography::new()), &frames, &start),
        ),
    ];
    for (id, fixed) in fixed {
        if let (Ok(fixed), Some(boxed)) = (fixed, measured.get(id)) {
            row(&format!("{id}, static types"), fixed.frame, "boxed", boxed.frame);
        }
    }
}
