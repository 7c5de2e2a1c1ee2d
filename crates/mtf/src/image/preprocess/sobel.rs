//! Sobel filter: the magnitude of the image gradient.

use super::{PreProcessor, PreProcessorEntry, value, with_scratch};
use crate::image::Image;
use crate::kernels::gradient_row;
use crate::kernels::pad::{pad, padded_len, padded_stride};
use std::sync::Arc;

/// `sqrt(gx² + gy²)` with the Sobel kernels of `size` taps, scaled so that a step from 0 to 255 along an axis gives 255, and
/// cut there. With `normalise` set, the least magnitude of each frame's plane becomes 0 and the largest 255.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sobel {
    size: usize,
    normalise: bool,
}

/// Most taps.
const TAPS: usize = 7;

pub(super) const ENTRY: PreProcessorEntry = PreProcessorEntry {
    name: "sobel",
    usage: "sobel:5:0",
    summary: "magnitude of the gradient: size (3, 5 or 7 px), 1 to stretch each frame to 0-255",
    make: |words| {
        let filter = value(words, 0, 5)
            .zip(value(words, 1, 0))
            .filter(|(_, normalise)| words.len() <= 2 && (0..=1).contains(normalise))
            .and_then(|(size, normalise)| Sobel::new(size, normalise == 1));
        match filter {
            Some(filter) => Ok(Arc::new(filter)),
            None => Err(
                "a parameter is out of range; use `sobel:SIZE:NORMALISE` with size 3, 5 or 7 and 0 or 1"
                    .into(),
            ),
        }
    },
};

impl Sobel {
    /// `size` 3, 5 or 7 pixels. `None` outside that.
    pub fn new(size: usize, normalise: bool) -> Option<Self> {
        matches!(size, 3 | 5 | 7).then_some(Sobel { size, normalise })
    }

    /// Smoothing weights, which add up to 1, and those of the difference, whose positive ones do: binomial coefficients, and
    /// those of two orders less with `-1 0 1`.
    fn kernels(&self) -> [[f32; TAPS]; 2] {
        let binomial = |order: usize| {
            let mut row = [0.0f32; TAPS];
            row[0] = 1.0;
            for k in 0..order {
                for i in (1..=k + 1).rev() {
                    row[i] += row[i - 1];
                }
            }
            row
        };
        let (mut smooth, inner) = (binomial(self.size - 1), binomial(self.size - 3));
        let mut slope = [0.0f32; TAPS];
        for (i, v) in inner.iter().enumerate().take(self.size - 2) {
            slope[i] -= v;
            slope[i + 2] += v;
        }
        let total: f32 = smooth.iter().sum();
        let rise: f32 = slope.iter().filter(|v| **v > 0.0).sum();
        smooth.iter_mut().for_each(|v| *v /= total);
        slope.iter_mut().for_each(|v| *v /= rise);
        [smooth, slope]
    }
}

impl PreProcessor for Sobel {
    fn apply(&self, mut image: Image) -> Image {
        let (width, height, stride) = (image.width(), image.height(), image.stride());
        let radius = self.size / 2;
        let [smooth, slope] = self.kernels();
        let (smooth, slope) = (&smooth[..self.size], &slope[..self.size]);
        let size = padded_len(width, height, radius);
        with_scratch(size + 2 * padded_stride(width, radius), |scratch| {
            let (padded, lines) = scratch.split_at_mut(size);
            for c in 0..image.channels() {
                pad(image.plane(c), width, height, stride, radius, padded);
                let (mut least, mut most) = (f32::INFINITY, 0.0f32);
                for y in 0..height {
                    let row = image.row_mut(c, y);
                    gradient_row(padded, y, smooth, slope, lines, row);
                    for &v in &*row {
                        (least, most) = (least.min(v), most.max(v));
                    }
                }
                let (base, gain) = match self.normalise && most > least {
                    true => (least, 255.0 / (most - least)),
                    false => (0.0, 1.0),
                };
                for y in 0..height {
                    for v in image.row_mut(c, y) {
                        *v = ((*v - base) * gain).min(255.0);
                    }
                }
            }
        });
        image
    }
    fn id(&self) -> String {
        format!("sobel:{}:{}", self.size, u8::from(self.normalise))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{compare, picture, pixels, reflected};
    use super::*;

    const PUBLISHED: [(&str, &[f64], &[f64]); 3] = [
        ("sobel:3", &[1.0, 2.0, 1.0], &[-1.0, 0.0, 1.0]),
        (
            "sobel:5",
            &[1.0, 4.0, 6.0, 4.0, 1.0],
            &[-1.0, -2.0, 0.0, 2.0, 1.0],
        ),
        (
            "sobel:7",
            &[1.0, 6.0, 15.0, 20.0, 15.0, 6.0, 1.0],
            &[-1.0, -4.0, -5.0, 0.0, 5.0, 4.0, 1.0],
        ),
    ];

    #[test]
    fn is_the_magnitude_of_both_differences() {
        for (text, smooth, slope) in PUBLISHED {
            let r = (smooth.len() / 2) as isize;
            let scale: f64 = smooth.iter().sum::<f64>() * slope.iter().filter(|v| **v > 0.0).sum::<f64>();
            compare(text, 1e-3, |image, c, x, y| {
                let (mut gx, mut gy) = (0.0, 0.0);
                for (j, (sj, dj)) in (-r..).zip(smooth.iter().zip(slope)) {
                    for (i, (si, di)) in (-r..).zip(smooth.iter().zip(slope)) {
                        let v = reflected(image, c, x + i, y + j);
                        gx += sj * di * v;
                        gy += dj * si * v;
                    }
                }
                ((gx * gx + gy * gy).sqrt() / scale).min(255.0)
            });
        }
    }

    #[test]
    fn frames_are_stretched_to_the_whole_range() {
        let out = pixels(&Sobel::new(3, true).unwrap().apply(picture(30, 20, 1)));
        let of = |f: fn(f64, f64) -> f64| out.iter().copied().reduce(f).unwrap();
        assert_eq!(of(f64::min), 0.0);
        assert!((of(f64::max) - 255.0).abs() < 1e-3);
        let flat = Image::from_fn(9, 7, |_, _| 80.0);
        assert!(
            pixels(&Sobel::new(3, true).unwrap().apply(flat))
                .iter()
                .all(|v| *v == 0.0)
        );
    }
}
