//! Gaussian smoothing.

use super::{PreProcessor, PreProcessorEntry, value, with_scratch};
use crate::image::Image;
use crate::kernels::blur::{MAX_TAPS, scratch_len, separable_in_place};
use std::sync::Arc;

/// Gaussian filter `size x size` with weights `exp(-(k - r)² / (2 sigma²))`, `r = (size - 1) / 2`, normalised to 1 along
/// each axis; the border is reflected without repeating the edge pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    size: usize,
    sigma: f64,
}

pub(super) const ENTRY: PreProcessorEntry = PreProcessorEntry {
    name: "gaussian",
    usage: "gaussian:5:3",
    summary: "Gaussian filter: size (odd, 3 to 31 px), sigma (px)",
    make: |words| {
        let remedy = "use `gaussian:SIZE:SIGMA` with an odd size from 3 to 31 and a sigma above 0";
        let default = Gaussian::default();
        let filter = value(words, 0, default.size)
            .zip(value(words, 1, default.sigma))
            .filter(|_| words.len() <= 2)
            .and_then(|(size, sigma)| Gaussian::new(size, sigma));
        match filter {
            Some(filter) => Ok(Arc::new(filter)),
            None => Err(format!("size or sigma is out of range; {remedy}")),
        }
    },
};

impl Gaussian {
    /// `size` odd, 3 to 31 pixels; `sigma` finite and above 0, pixels. `None` outside that.
    pub fn new(size: usize, sigma: f64) -> Option<Self> {
        let fits = size % 2 == 1 && (3..=MAX_TAPS).contains(&size) && sigma.is_finite() && sigma > 0.0;
        fits.then_some(Gaussian { size, sigma })
    }

    /// Writes the normalised weights along one axis, as many as the size.
    fn weights_into(&self, out: &mut [f32]) {
        let r = (self.size / 2) as f64;
        let raw = |k: usize| libm::exp(-(k as f64 - r).powi(2) / (2.0 * self.sigma * self.sigma));
        let sum: f64 = (0..self.size).map(raw).sum();
        for (k, w) in out.iter_mut().enumerate() {
            *w = (raw(k) / sum) as f32;
        }
    }
}

impl Default for Gaussian {
    /// 5 x 5, sigma 3.
    fn default() -> Self {
        Gaussian { size: 5, sigma: 3.0 }
    }
}

impl PreProcessor for Gaussian {
    fn apply(&self, mut image: Image) -> Image {
        let (width, height, stride) = (image.width(), image.height(), image.stride());
        let mut weights = [0.0; MAX_TAPS];
        let weights = &mut weights[..self.size];
        self.weights_into(weights);
        with_scratch(scratch_len(width, self.size), |scratch| {
            for c in 0..image.channels() {
                separable_in_place(image.plane_mut(c), width, height, stride, weights, scratch);
            }
        });
        image
    }
    fn id(&self) -> String {
        format!("gaussian:{}:{}", self.size, self.sigma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_weights() {
        let mut w = [0.0; 5];
        Gaussian::default().weights_into(&mut w);
        for (a, b) in w.iter().zip([0.1782, 0.2105, 0.2225, 0.2105, 0.1782]) {
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn tiny_sigma_is_the_identity() {
        let image = Image::from_fn(13, 9, |x, y| (x * 17 + y * 5) as f32);
        assert_eq!(Gaussian::new(5, 1e-3).unwrap().apply(image.clone()), image);
    }

    #[test]
    fn every_plane_is_filtered_alone() {
        let mut image = Image::new(6, 4, 3);
        image.row_mut(1, 2)[3] = 255.0;
        let out = Gaussian::default().apply(image);
        let sum = |c| (0..4).flat_map(|y| out.row(c, y)).sum::<f32>();
        assert!(sum(0) == 0.0 && sum(2) == 0.0 && sum(1) > 0.0);
    }
}
