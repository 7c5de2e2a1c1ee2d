//! Anisotropic diffusion: smooths along edges, not across them (Perona & Malik 1990).

use super::{PreProcessor, PreProcessorEntry, value, with_scratch};
use crate::image::Image;
use crate::kernels::pad::{pad, padded_len};
use crate::kernels::{Falloff, diffuse_row};
use std::sync::Arc;

/// Steps of `I <- I + lambda Σ_i w_i exp(-(d_i / kappa)²) d_i` over the eight neighbours, `d_i = I_i - I`, `w_i` 1 beside and
/// above, ½ at corners.
#[derive(Clone, Debug)]
pub struct Anisotropic {
    lambda: f64,
    kappa: f64,
    steps: usize,
    tone: Falloff,
}

pub(super) const ENTRY: PreProcessorEntry = PreProcessorEntry {
    name: "aniso",
    usage: "aniso:0.142857:30:15",
    summary: "anisotropic diffusion: rate (up to 1/6), kappa (gray levels), steps (1 to 100)",
    make: |words| {
        // The rate is 1/7.
        let filter = value(words, 0, 0.142857)
            .zip(value(words, 1, 30.0).zip(value(words, 2, 15)))
            .filter(|_| words.len() <= 3)
            .and_then(|(lambda, (kappa, steps))| Anisotropic::new(lambda, kappa, steps));
        match filter {
            Some(filter) => Ok(Arc::new(filter)),
            None => Err(
                "a parameter is out of range; use `aniso:RATE:KAPPA:STEPS` with a rate above 0 and up to 1/6, \
                 kappa from 0.01 to 10000 and 1 to 100 steps"
                    .into(),
            ),
        }
    },
};

impl Anisotropic {
    /// `lambda` above 0 and at most 1/6, beyond which intensities may overshoot; `kappa` 0.01 to 10000 gray levels; 1 to 100
    /// `steps`. `None` outside that.
    pub fn new(lambda: f64, kappa: f64, steps: usize) -> Option<Self> {
        let fits = lambda > 0.0 && lambda <= 1.0 / 6.0 && (0.01..=1e4).contains(&kappa);
        (fits && (1..=100).contains(&steps)).then(|| Anisotropic {
            lambda,
            kappa,
            steps,
            tone: Falloff::new(),
        })
    }
}

impl PreProcessor for Anisotropic {
    fn apply(&self, mut image: Image) -> Image {
        let (width, height, stride) = (image.width(), image.height(), image.stride());
        let (rate, scale) = (self.lambda as f32, (1.0 / self.kappa) as f32);
        with_scratch(padded_len(width, height, 1), |padded| {
            for c in 0..image.channels() {
                for _ in 0..self.steps {
                    pad(image.plane(c), width, height, stride, 1, padded);
                    for y in 0..height {
                        diffuse_row(padded, y, rate, &self.tone, scale, image.row_mut(c, y));
                    }
                }
            }
        });
        image
    }
    fn id(&self) -> String {
        format!("aniso:{}:{}:{}", self.lambda, self.kappa, self.steps)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{compare, reflected};
    use crate::image::Image;

    /// A step in `f64`.
    fn step(image: &Image, c: usize, x: isize, y: isize, lambda: f64, kappa: f64) -> f64 {
        let here = reflected(image, c, x, y);
        let around = (-1..=1).flat_map(|j| (-1..=1).map(move |i: isize| (i, j)));
        let flow: f64 = around
            .map(|(i, j): (isize, isize)| {
                let d = reflected(image, c, x + i, y + j) - here;
                let w = if i != 0 && j != 0 { 0.5 } else { 1.0 };
                w * (-(d / kappa).powi(2)).exp() * d
            })
            .sum();
        here + lambda * flow
    }

    #[test]
    fn is_the_explicit_scheme() {
        compare("aniso:0.1:25:1", 1e-3, |image, c, x, y| {
            step(image, c, x, y, 0.1, 25.0)
        });
        compare("aniso:0.15:60:3", 2e-3, |image, c, x, y| {
            let mut image = image.clone();
            for _ in 0..2 {
                let before = image.clone();
                for j in 0..image.height() {
                    for (i, v) in image.row_mut(c, j).iter_mut().enumerate() {
                        *v = step(&before, c, i as isize, j as isize, 0.15, 60.0) as f32;
                    }
                }
            }
            step(&image, c, x, y, 0.15, 60.0)
        });
    }
}
