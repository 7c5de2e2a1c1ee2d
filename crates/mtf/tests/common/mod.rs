//! What several integration tests need.
#![allow(dead_code)]

use mtf::diagnose::Waves;
use mtf::geom::{Corners, Mat3, homography};
use mtf::image::{Frame, Image};
use rand::RngExt;
use rand_pcg::Pcg64;

/// A generator for one test case.
pub fn rng(seed: u64) -> Pcg64 {
    rand::SeedableRng::seed_from_u64(seed)
}

/// Frame of the waves after the plane has moved by `m`: `I(m x) = waves(x)`.
pub fn moved(waves: &Waves, (width, height): (usize, usize), m: &Mat3) -> Frame {
    let back = m.try_inverse().expect("invertible motion");
    let value = |x: usize, y: usize| waves.at(homography::apply(&back, [x as f64, y as f64])) as f32;
    Frame::from_gray(Image::from_fn(width, height, value))
}

/// Homography that moves each corner of `c` by up to `distance` px RMS in random directions.
pub fn perturbation(c: &Corners, distance: f64, r: &mut Pcg64) -> Mat3 {
    let mut d: [f64; 8] = std::array::from_fn(|_| r.random_range(-1.0..1.0));
    let rms = (d.iter().map(|v| v * v).sum::<f64>() / 4.0).sqrt();
    d.iter_mut().for_each(|v| *v *= distance / rms);
    let to = Corners(std::array::from_fn(|i| {
        [c.0[i][0] + d[2 * i], c.0[i][1] + d[2 * i + 1]]
    }));
    homography::from_corners(c, &to).expect("convex")
}

/// RMS corner distance, px.
pub fn alignment_error(a: &Corners, b: &Corners) -> f64 {
    (a.distance_squared(b) / 4.0).sqrt()
}
