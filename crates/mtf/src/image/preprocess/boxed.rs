//! Box filter: the mean of a square window.

use super::{PreProcessor, PreProcessorEntry, value, with_scratch};
use crate::image::Image;
use crate::kernels::blur::{MAX_TAPS, scratch_len, separable_in_place};
use std::sync::Arc;

/// Mean of the `size x size` window around each pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Boxed {
    size: usize,
}

pub(super) const ENTRY: PreProcessorEntry = PreProcessorEntry {
    name: "box",
    usage: "box:5",
    summary: "mean of a window: size (odd, 3 to 31 px)",
    make: |words| {
        let size = value(words, 0, Boxed::default().size).filter(|_| words.len() <= 1);
        match size.and_then(Boxed::new) {
            Some(filter) => Ok(Arc::new(filter)),
            None => Err("size is out of range; use `box:SIZE` with an odd size from 3 to 31".into()),
        }
    },
};

impl Boxed {
    /// `size` odd, 3 to 31 pixels. `None` outside that.
    pub fn new(size: usize) -> Option<Self> {
        (size % 2 == 1 && (3..=MAX_TAPS).contains(&size)).then_some(Boxed { size })
    }
}

impl Default for Boxed {
    /// 5 x 5.
    fn default() -> Self {
        Boxed { size: 5 }
    }
}

impl PreProcessor for Boxed {
    fn apply(&self, mut image: Image) -> Image {
        let (width, height, stride) = (image.width(), image.height(), image.stride());
        let weights = &[1.0 / self.size as f32; MAX_TAPS][..self.size];
        with_scratch(scratch_len(width, self.size), |scratch| {
            for c in 0..image.channels() {
                separable_in_place(image.plane_mut(c), width, height, stride, weights, scratch);
            }
        });
        image
    }
    fn id(&self) -> String {
        format!("box:{}", self.size)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{compare, reflected};

    #[test]
    fn is_the_mean_of_the_window() {
        for r in [1, 2, 4] {
            compare(&format!("box:{}", 2 * r + 1), 1e-3, |image, c, x, y| {
                let window = (-r..=r).flat_map(|j| (-r..=r).map(move |i| (i, j)));
                let sum: f64 = window.map(|(i, j)| reflected(image, c, x + i, y + j)).sum();
                sum / ((2 * r + 1) * (2 * r + 1)) as f64
            });
        }
    }
}
