//! A small ESM tracker (homography, sum of squared differences) written for these tests alone, so that the dataset is
//! judged by something that shares no code with what it is meant to judge.

use image::RgbImage;
use mtf::geom::{Corners, Mat3};
use nalgebra::{SMatrix, SVector, Vector3};

const N: usize = 50;

/// Grey image, smoothed as trackers do (5x5 Gaussian, sigma 3).
pub struct Gray {
    width: usize,
    height: usize,
    values: Vec<f64>,
}

impl Gray {
    pub fn new(image: &RgbImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let luma =
            |p: &image::Rgb<u8>| 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2]);
        let raw = Gray {
            width,
            height,
            values: image.pixels().map(luma).collect(),
        };
        raw.pass(1, 0).pass(0, 1)
    }

    fn pass(&self, dx: i64, dy: i64) -> Gray {
        let w: Vec<f64> = (-2..=2).map(|k| (-f64::from(k * k) / 18.0).exp()).collect();
        let sum: f64 = w.iter().sum();
        let at = |x: i64, y: i64| {
            let (x, y) = (
                x.clamp(0, self.width as i64 - 1),
                y.clamp(0, self.height as i64 - 1),
            );
            self.values[y as usize * self.width + x as usize]
        };
        let value = |i: usize| {
            let (x, y) = ((i % self.width) as i64, (i / self.width) as i64);
            (0..5)
                .map(|k| w[k as usize] / sum * at(x + dx * (k - 2), y + dy * (k - 2)))
                .sum()
        };
        Gray {
            values: (0..self.values.len()).map(value).collect(),
            ..*self
        }
    }

    fn sample(&self, x: f64, y: f64) -> f64 {
        let x = x.clamp(0.0, self.width as f64 - 1.001);
        let y = y.clamp(0.0, self.height as f64 - 1.001);
        let (i, j) = (x as usize, y as usize);
        let (u, v) = (x - i as f64, y - j as f64);
        let at = |i: usize, j: usize| self.values[j * self.width + i];
        (1.0 - v) * ((1.0 - u) * at(i, j) + u * at(i + 1, j))
            + v * ((1.0 - u) * at(i, j + 1) + u * at(i + 1, j + 1))
    }
}

/// Matrix that takes the square (-0.5..0.5)² to the corners, by the direct linear transform.
pub fn square_to(corners: &Corners) -> Mat3 {
    let square = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
    let (mut a, mut b) = (SMatrix::<f64, 8, 8>::zeros(), SVector::<f64, 8>::zeros());
    for (k, ([x, y], [u, v])) in square.into_iter().zip(corners.0).enumerate() {
        let rows = [
            [x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y],
            [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y],
        ];
        for (r, row) in rows.iter().enumerate() {
            row.iter()
                .enumerate()
                .for_each(|(c, value)| a[(2 * k + r, c)] = *value);
        }
        (b[2 * k], b[2 * k + 1]) = (u, v);
    }
    let h = a.lu().solve(&b).expect("four corners in general position");
    Mat3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0)
}

fn grid(i: usize) -> [f64; 2] {
    [0, 1].map(|k| (if k == 0 { i % N } else { i / N }) as f64 / (N - 1) as f64 - 0.5)
}

fn apply(m: &Mat3, [x, y]: [f64; 2]) -> [f64; 2] {
    let p = m * Vector3::new(x, y, 1.0);
    [p.x / p.z, p.y / p.z]
}

/// The 50 x 50 values of the image inside the corners.
pub fn patch(image: &Gray, corners: &Corners) -> Vec<f64> {
    sampled(image, &square_to(corners))
}

fn sampled(image: &Gray, h: &Mat3) -> Vec<f64> {
    (0..N * N)
        .map(|i| apply(h, grid(i)))
        .map(|[x, y]| image.sample(x, y))
        .collect()
}

/// Zero mean, unit variance.
pub fn standardised(values: &[f64]) -> Vec<f64> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let sigma = (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n)
        .sqrt()
        .max(1e-9);
    values.iter().map(|v| (v - mean) / sigma).collect()
}

/// Correlation coefficient.
pub fn ncc(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (standardised(a), standardised(b));
    a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>() / a.len() as f64
}

/// Gradient of a patch in grid coordinates, per unit of the square.
fn gradient(p: &[f64]) -> Vec<[f64; 2]> {
    let difference = |i: usize, at: usize, step: usize| {
        let (low, high) = (
            if at > 0 { i - step } else { i },
            if at < N - 1 { i + step } else { i },
        );
        (p[high] - p[low]) * (N - 1) as f64 * step as f64 / (high - low) as f64
    };
    (0..N * N)
        .map(|i| [difference(i, i % N, 1), difference(i, i / N, N)])
        .collect()
}

/// Tracks from the first corners through all frames; corners per frame. `normalised`: patches are standardised first
/// (ZNCC instead of SSD). `dof`: 8 for homography, 6 affine, 2 translation. `share`: part of the current image's
/// gradient in the Jacobian (0: the template's alone, as the inverse method; 0.5: ESM; 1: the forward method).
pub fn track(frames: &[Gray], first: &Corners, normalised: bool, dof: usize, share: f64) -> Vec<Corners> {
    let prepare = |v: Vec<f64>| if normalised { standardised(&v) } else { v };
    let mut h = square_to(first);
    let template = prepare(sampled(&frames[0], &h));
    let g0 = gradient(&template);
    let corners_of =
        |h: &Mat3| Corners([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|p| apply(h, p)));
    let mut out = vec![*first];
    for frame in &frames[1..] {
        let start = h;
        for _ in 0..30 {
            let current = prepare(sampled(frame, &h));
            let gt = gradient(&current);
            let (mut a, mut b) = (
                SMatrix::<f64, 8, 8>::identity() * 1e-6,
                SVector::<f64, 8>::zeros(),
            );
            for i in 0..N * N {
                let [x, y] = grid(i);
                let [u, v] = [0, 1].map(|k| g0[i][k] + share * (gt[i][k] - g0[i][k]));
                let w = -(x * u + y * v);
                let full = [u, v, x * u, y * u, x * v, y * v, x * w, y * w];
                let j = SVector::<f64, 8>::from_fn(|k, _| if k < dof { full[k] } else { 0.0 });
                a += j * j.transpose();
                b += j * (template[i] - current[i]);
            }
            let Some(p) = a.cholesky().map(|c| c.solve(&b)) else {
                break;
            };
            let step = Mat3::new(1.0 + p[2], p[3], p[0], p[4], 1.0 + p[5], p[1], p[6], p[7], 1.0);
            let before = corners_of(&h);
            h *= step;
            if !corners_of(&h).is_finite() || !corners_of(&h).is_convex() {
                h = start;
                break;
            }
            if corners_of(&h).distance_squared(&before) < 1e-4 {
                break;
            }
        }
        out.push(corners_of(&h));
    }
    out
}
