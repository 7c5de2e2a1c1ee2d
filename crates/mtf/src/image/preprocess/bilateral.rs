//! Bilateral filter: smooths, and keeps edges (Tomasi & Manduchi 1998).

use super::{PreProcessor, PreProcessorEntry, value, with_scratch};
use crate::image::Image;
use crate::kernels::pad::{pad, padded_len};
use crate::kernels::{Falloff, Tap, bilateral_row};
use std::sync::Arc;

/// Mean of the pixels `q` within `diameter / 2` of each pixel `p`, weighted by
/// `exp(-|q - p|² / (2 sigma_space²)) exp(-d² / (2 sigma_colour²))`, `d = Σ_c |I_c(q) - I_c(p)|` over the planes: all planes of
/// a colour image have the same weights.
#[derive(Clone, Debug)]
pub struct Bilateral {
    diameter: usize,
    sigma_colour: f64,
    sigma_space: f64,
    taps: Vec<Tap>,
    tone: Falloff,
}

/// Widest window, px.
const MAX_DIAMETER: usize = 31;

pub(super) const ENTRY: PreProcessorEntry = PreProcessorEntry {
    name: "bilateral",
    usage: "bilateral:5:15:15",
    summary: "bilateral filter: diameter (odd, 3 to 31 px), sigma of intensities (gray levels), sigma of places (px)",
    make: |words| {
        let filter = value(words, 0, 5)
            .zip(value(words, 1, 15.0).zip(value(words, 2, 15.0)))
            .filter(|_| words.len() <= 3)
            .and_then(|(diameter, (colour, space))| Bilateral::new(diameter, colour, space));
        match filter {
            Some(filter) => Ok(Arc::new(filter)),
            None => Err(
                "a parameter is out of range; use `bilateral:DIAMETER:SIGMA_COLOUR:SIGMA_SPACE` with an odd \
                 diameter from 3 to 31 and sigmas from 0.01 to 10000"
                    .into(),
            ),
        }
    },
};

impl Bilateral {
    /// `diameter` odd, 3 to 31 pixels; `sigma_colour` in gray levels and `sigma_space` in pixels, 0.01 to 10000. `None` outside
    /// that.
    pub fn new(diameter: usize, sigma_colour: f64, sigma_space: f64) -> Option<Self> {
        let sigmas = [sigma_colour, sigma_space]
            .iter()
            .all(|s| (0.01..=1e4).contains(s));
        if diameter.is_multiple_of(2) || !(3..=MAX_DIAMETER).contains(&diameter) || !sigmas {
            return None;
        }
        let r = (diameter / 2) as f64;
        let places = (0..diameter * diameter).map(|i| (i % diameter, i / diameter));
        let taps = places.filter_map(|(x, y)| {
            let squared = (x as f64 - r).powi(2) + (y as f64 - r).powi(2);
            let weight = libm::exp(-squared / (2.0 * sigma_space * sigma_space)) as f32;
            (squared <= r * r).then_some(Tap { x, y, weight })
        });
        Some(Bilateral {
            diameter,
            sigma_colour,
            sigma_space,
            taps: taps.collect(),
            tone: Falloff::new(),
        })
    }
}

impl PreProcessor for Bilateral {
    fn apply(&self, mut image: Image) -> Image {
        let (width, height, stride) = (image.width(), image.height(), image.stride());
        let (channels, radius) = (image.channels(), self.diameter / 2);
        let size = padded_len(width, height, radius);
        let scale = (1.0 / (std::f64::consts::SQRT_2 * self.sigma_colour)) as f32;
        with_scratch(channels * size + (channels + 1) * width, |scratch| {
            let (planes, sums) = scratch.split_at_mut(channels * size);
            for (c, plane) in planes.chunks_exact_mut(size).enumerate() {
                pad(image.plane(c), width, height, stride, radius, plane);
            }
            for y in 0..height {
                bilateral_row(
                    planes, channels, width, radius, y, &self.taps, &self.tone, scale, sums,
                );
                let (totals, weighted) = sums.split_at(width);
                for (c, weighted) in weighted.chunks_exact(width).enumerate() {
                    let row = image.row_mut(c, y).iter_mut();
                    for ((v, w), t) in row.zip(weighted).zip(totals) {
                        // The pixel itself has weight 1.
                        *v = w / t;
                    }
                }
            }
        });
        image
    }
    fn id(&self) -> String {
        format!(
            "bilateral:{}:{}:{}",
            self.diameter, self.sigma_colour, self.sigma_space
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{compare, reflected};

    #[test]
    fn is_the_weighted_mean() {
        for (diameter, colour, space) in [(5, 15.0, 15.0), (3, 40.0, 0.8), (9, 3.0, 2.0)] {
            compare(
                &format!("bilateral:{diameter}:{colour}:{space}"),
                1e-3,
                |image, c, x, y| {
                    let r = diameter / 2;
                    let (mut total, mut sum) = (0.0, 0.0);
                    for (i, j) in (-r..=r).flat_map(|j| (-r..=r).map(move |i| (i, j))) {
                        if i * i + j * j > r * r {
                            continue;
                        }
                        let apart = |c| (reflected(image, c, x + i, y + j) - reflected(image, c, x, y)).abs();
                        let d: f64 = (0..image.channels()).map(apart).sum();
                        let far = (i * i + j * j) as f64;
                        let w = (-far / (2.0 * space * space) - d * d / (2.0 * colour * colour)).exp();
                        total += w;
                        sum += w * reflected(image, c, x + i, y + j);
                    }
                    sum / total
                },
            );
        }
    }
}
