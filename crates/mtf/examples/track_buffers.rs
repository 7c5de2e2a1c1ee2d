//! Tracks a planar object through raw camera buffers, with the tracking library alone. The buffers are what camera drivers
//! deliver: blue, green, red bytes, each row padded.
//!
//! `cargo run --release -p mtf --example track_buffers`

use mtf::image::{PixelView, Samples};
use mtf::prelude::*;
use std::error::Error;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// Bytes between the starts of two rows.
const STRIDE: usize = 3 * WIDTH + 32;

/// What the camera sees when the object has moved by `(dx, dy)` px.
fn camera(dx: f64, dy: f64) -> Vec<u8> {
    let mut buffer = vec![0; STRIDE * HEIGHT];
    for (y, row) in buffer.chunks_exact_mut(STRIDE).enumerate() {
        for (x, pixel) in row[..3 * WIDTH].chunks_exact_mut(3).enumerate() {
            let (x, y) = (x as f64 - dx, y as f64 - dy);
            let wave = |a: f64, b: f64, c: f64| 128.0 + 60.0 * ((a * x + c).sin() + (b * y - c).cos());
            let [blue, green, red] = [
                wave(0.11, 0.17, 0.4),
                wave(0.23, 0.09, 1.7),
                wave(0.07, 0.21, 2.9),
            ];
            pixel.copy_from_slice(&[blue as u8, green as u8, red as u8]);
        }
    }
    buffer
}

fn main() -> Result<(), Box<dyn Error>> {
    let registry = Registry::builtin();
    let mut tracker = registry.build(&registry.parse("esm/zncc/homography")?)?;
    let blur = parse_preprocessor("gaussian:5:3")?;
    let start = Corners::rect(90.0, 80.0, 120.0, 90.0);
    for i in 0..=20 {
        let (dx, dy) = (1.5 * f64::from(i), -0.8 * f64::from(i));
        let buffer = camera(dx, dy);
        let view = PixelView::new(WIDTH, HEIGHT, STRIDE, Samples::Bgr8(&buffer))?;
        let frame = Frame::from_view(&view, blur.clone());
        if i == 0 {
            tracker.init(&frame, &start)?;
            continue;
        }
        let corners = tracker.update(&frame)?.corners;
        let error = corners.mean_distance(&start.translated(dx, dy));
        println!(
            "frame {i:2}: upper left corner at {:.2?}, {error:.3} px off",
            corners.0[0]
        );
        if error > 0.5 {
            return Err("the object is lost".into());
        }
    }
    Ok(())
}
