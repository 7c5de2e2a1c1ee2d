//! What several integration tests need.
#![allow(dead_code)]

use mtf_eval::geom::{Corners, Mat3, homography};
use mtf_eval::image::{Frame, Image};
use rand::RngExt;
use rand_pcg::Pcg64;

/// A generator for one test case.
pub fn rng(seed: u64) -> Pcg64 {
    rand::SeedableRng::seed_from_u64(seed)
}

/// Smooth image made of a dozen waves of 15 to 60 px, amplitude about 100 around 128.
pub struct Waves(Vec<[f64; 4]>);

impl Waves {
    /// Random waves.
    pub fn new(seed: u64) -> Self {
        let mut r = rng(seed);
        Waves(
            (0..12)
                .map(|_| {
                    let (length, angle) = (
                        r.random_range(15.0..60.0),
                        r.random_range(0.0..std::f64::consts::TAU),
                    );
                    let k = std::f64::consts::TAU / length;
                    [
                        k * f64::cos(angle),
                        k * f64::sin(angle),
                        r.random_range(0.0..6.0),
                        r.random_range(6.0..14.0),
                    ]
                })
                .collect(),
        )
    }
    /// Intensity at a point.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        128.0
            + self
                .0
                .iter()
                .map(|[kx, ky, phase, a]| a * (kx * x + ky * y + phase).sin())
                .sum::<f64>()
    }
    /// The image after the plane has moved by `m`: `I(m x) = waves(x)`.
    pub fn moved(&self, width: usize, height: usize, m: &Mat3) -> Frame {
        let back = m.try_inverse().expect("invertible motion");
        Frame::from_gray(Image::from_fn(width, height, |x, y| {
            let [x, y] = homography::apply(&back, [x as f64, y as f64]);
            self.at(x, y) as f32
        }))
    }
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
