//! Draws what a tracker found: a frame of an embedded sequence with the sampling grid's outline (red), the ground truth
//! (green), and the template beside the patch it was matched with.
//!
//! `cargo run --release --example overlay -- plain-painting 45 docs/tracked.png`

use image::{Rgb, RgbImage, imageops};
use mtf::diagnose::patch;
use mtf::params::Resolution;
use mtf_eval::prelude::*;

/// Pixels per image pixel.
const ZOOM: u32 = 2;
/// Side of the drawn patches.
const PATCH: usize = 160;

fn line(canvas: &mut RgbImage, a: [f64; 2], b: [f64; 2], colour: Rgb<u8>) {
    let steps = 4.0 * f64::hypot(b[0] - a[0], b[1] - a[1]) * f64::from(ZOOM);
    for k in 0..=steps as u32 {
        let t = f64::from(k) / steps;
        let at = |i: usize| (a[i] + t * (b[i] - a[i]) + 0.5) * f64::from(ZOOM);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (x, y) = (at(0) - 0.5 + dx, at(1) - 0.5 + dy);
            if x >= 0.0 && y >= 0.0 && x < f64::from(canvas.width()) && y < f64::from(canvas.height()) {
                canvas.put_pixel(x as u32, y as u32, colour);
            }
        }
    }
}

fn outline(canvas: &mut RgbImage, c: &Corners, colour: Rgb<u8>) {
    (0..4).for_each(|i| line(canvas, c.0[i], c.0[(i + 1) % 4], colour));
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args = std::env::args_os()
        .skip(1)
        .map(|word| word.to_string_lossy().into_owned());
    let args: Vec<String> = args.collect();
    let [name, last, out] = &args[..] else {
        return Err("usage: overlay SEQUENCE FRAME OUT.png".into());
    };
    let last: usize = last.parse()?;
    let data = dataset::builtin()?;
    let sequence = data
        .sequences
        .iter()
        .find(|s| s.name() == name)
        .ok_or("no such sequence")?;
    let blur = parse_preprocessor("gaussian:5:3")?;
    let frame = |i| Ok::<_, dataset::DatasetError>(Frame::new(sequence.read(i, true)?, blur.clone()));
    let start = sequence.truth(0).ok_or("the first frame is not annotated")?;
    let mut tracker = Esm::new(Ssd::default(), Homography::new());
    let first = frame(0)?;
    tracker.init(&first, &start)?;
    for i in 1..=last {
        tracker.update(&frame(i)?)?;
    }
    let shown = frame(last)?;
    let (w, h) = (shown.width() as u32, shown.height() as u32);
    let rgb = shown.decoded().rgb().ok_or("not a colour frame")?.to_vec();
    let photo = RgbImage::from_raw(w, h, rgb).ok_or("incomplete frame")?;
    let mut canvas = RgbImage::from_pixel(w * ZOOM + PATCH as u32 + 16, h * ZOOM, Rgb([255; 3]));
    imageops::replace(
        &mut canvas,
        &imageops::resize(&photo, w * ZOOM, h * ZOOM, imageops::FilterType::CatmullRom),
        0,
        0,
    );
    if let Some(truth) = sequence.truth(last) {
        outline(&mut canvas, &truth, Rgb([40, 200, 80]));
    }
    outline(&mut canvas, &tracker.corners(), Rgb([230, 40, 40]));
    let res = Resolution {
        cols: PATCH,
        rows: PATCH,
    };
    for (image, corners, top) in [(first.gray(), start, 40), (shown.gray(), tracker.corners(), 240)] {
        for (i, v) in patch(image, &corners, res)?.into_iter().enumerate() {
            let (x, y) = (w * ZOOM + 8 + (i % PATCH) as u32, top + (i / PATCH) as u32);
            canvas.put_pixel(x, y, Rgb([v.round().clamp(0.0, 255.0) as u8; 3]));
        }
    }
    canvas.save(out)?;
    Ok(())
}
