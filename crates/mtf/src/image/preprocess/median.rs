//! Median filter.

use super::{PreProcessor, PreProcessorEntry, value, with_scratch};
use crate::image::Image;
use crate::kernels::pad::padded_len;
use crate::kernels::{MAX_MEDIAN, median_in_place};
use std::sync::Arc;

/// Median of the `size x size` window around each pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Median {
    size: usize,
}

pub(super) const ENTRY: PreProcessorEntry = PreProcessorEntry {
    name: "median",
    usage: "median:5",
    summary: "median of a window: size (odd, 3 to 15 px)",
    make: |words| {
        let size = value(words, 0, Median::default().size).filter(|_| words.len() <= 1);
        match size.and_then(Median::new) {
            Some(filter) => Ok(Arc::new(filter)),
            None => Err("size is out of range; use `median:SIZE` with an odd size from 3 to 15".into()),
        }
    },
};

impl Median {
    /// `size` odd, 3 to 15 pixels. `None` outside that.
    pub fn new(size: usize) -> Option<Self> {
        (size % 2 == 1 && (3..=MAX_MEDIAN).contains(&size)).then_some(Median { size })
    }
}

impl Default for Median {
    /// 5 x 5.
    fn default() -> Self {
        Median { size: 5 }
    }
}

impl PreProcessor for Median {
    fn apply(&self, mut image: Image) -> Image {
        let (width, height, stride) = (image.width(), image.height(), image.stride());
        with_scratch(padded_len(width, height, self.size / 2), |scratch| {
            for c in 0..image.channels() {
                median_in_place(image.plane_mut(c), width, height, stride, self.size, scratch);
            }
        });
        image
    }
    fn id(&self) -> String {
        format!("median:{}", self.size)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{compare, reflected};

    #[test]
    fn is_the_median_of_the_window() {
        for r in [1, 2, 5] {
            compare(&format!("median:{}", 2 * r + 1), 1e-9, |image, c, x, y| {
                let window = (-r..=r).flat_map(|j| (-r..=r).map(move |i| (i, j)));
                let mut values: Vec<f64> = window.map(|(i, j)| reflected(image, c, x + i, y + j)).collect();
                values.sort_by(f64::total_cmp);
                values[values.len() / 2]
            });
        }
    }
}
