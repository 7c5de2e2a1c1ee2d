//! Histogram equalisation.

use super::{PreProcessor, PreProcessorEntry};
use crate::image::Image;
use std::sync::Arc;

/// Spreads the intensities of each frame over the whole range, so that each has as many pixels as any other. With `h_k` the
/// count of pixels that round to level `k` and `m` the darkest level there is, level `k` becomes
/// `255 Σ_{m < i <= k} h_i / Σ_{i > m} h_i`, rounded; what lies between two levels is interpolated. A flat image stays as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Equalised;

/// Gray levels.
const LEVELS: usize = 256;

pub(super) const ENTRY: PreProcessorEntry = PreProcessorEntry {
    name: "histeq",
    usage: "histeq",
    summary: "histogram equalisation of each frame",
    make: |words| match words {
        [] => Ok(Arc::new(Equalised)),
        _ => Err("`histeq` takes no parameters; use `histeq`".into()),
    },
};

impl PreProcessor for Equalised {
    fn apply(&self, mut image: Image) -> Image {
        let top = (LEVELS - 1) as f32;
        for c in 0..image.channels() {
            let mut counts = [0u32; LEVELS];
            for y in 0..image.height() {
                for v in image.row(c, y) {
                    counts[v.clamp(0.0, top).round() as usize] += 1;
                }
            }
            let darkest = counts.iter().position(|n| *n > 0).unwrap_or(0);
            let rest: u32 = counts[darkest + 1..].iter().sum();
            if rest == 0 {
                continue;
            }
            let mut map = [0.0f32; LEVELS];
            let mut sum = 0u32;
            for (level, count) in map.iter_mut().zip(counts).skip(darkest + 1) {
                sum += count;
                *level = (f64::from(top) * f64::from(sum) / f64::from(rest)).round() as f32;
            }
            for y in 0..image.height() {
                for v in image.row_mut(c, y) {
                    let at = v.clamp(0.0, top);
                    let k = (at as usize).min(LEVELS - 2);
                    *v = map[k] + (at - k as f32) * (map[k + 1] - map[k]);
                }
            }
        }
        image
    }
    fn id(&self) -> String {
        "histeq".into()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{compare, pixels};
    use super::*;

    #[test]
    fn is_the_share_of_darker_pixels() {
        compare("histeq", 1e-3, |image, c, x, y| {
            let all: Vec<f64> = pixels(image);
            let count = image.width() * image.height();
            let plane = &all[c * count..(c + 1) * count];
            let here = f64::from(image.get(c, x as usize, y as usize));
            let darkest = plane.iter().copied().fold(f64::INFINITY, f64::min);
            let among = |keep: &dyn Fn(f64) -> bool| plane.iter().filter(|v| keep(**v)).count() as f64;
            let rest = among(&|v| v > darkest);
            if rest == 0.0 {
                return here;
            }
            (255.0 * among(&|v| v > darkest && v <= here) / rest).round()
        });
    }

    #[test]
    fn order_is_kept_between_levels_and_flat_images_stay() {
        let ramp = Image::from_fn(200, 3, |x, y| 40.0 + 0.37 * x as f32 + 0.1 * y as f32);
        let out = Equalised.apply(ramp);
        assert!(out.row(0, 1).windows(2).all(|w| w[0] <= w[1]));
        assert!(out.row(0, 1)[199] > 250.0 && out.row(0, 1)[0] < 5.0);
        let flat = Image::from_fn(5, 5, |_, _| 77.0);
        assert_eq!(Equalised.apply(flat.clone()), flat);
    }
}
