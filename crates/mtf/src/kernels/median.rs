//! Median of a square window, eight pixels at a time.
//!
//! Forgetful selection: of the first `(n + 3) / 2` of `n` values the least and the largest cannot be the median of all; they
//! are dropped, the next value is taken in, and so on until three are left.

use super::pad::{pad, padded_len, padded_stride};
use super::{Lanes, WIDTH, dispatch};

/// Widest window.
pub const MAX_MEDIAN: usize = 15;
/// Most values that are kept at once.
const KEPT: usize = (MAX_MEDIAN * MAX_MEDIAN).div_ceil(2) + 1;

dispatch! {
    /// Replaces each pixel of the `width x height` image in `plane` (rows `stride` apart) by the median of the `size x size`
    /// window around it, the border reflected. `size` is odd, 3 to [`MAX_MEDIAN`]; `scratch` has
    /// [`padded_len`]`(width, height, size / 2)` elements.
    pub fn median_in_place(plane: &mut [f32], width: usize, height: usize, stride: usize, size: usize, scratch: &mut [f32]) = median_lanes;
}

#[inline(always)]
fn median_lanes<V: Lanes>(
    plane: &mut [f32],
    width: usize,
    height: usize,
    stride: usize,
    size: usize,
    scratch: &mut [f32],
) {
    assert!(
        size % 2 == 1 && (3..=MAX_MEDIAN).contains(&size),
        "size of the window"
    );
    let (radius, count) = (size / 2, size * size);
    let padded = &mut scratch[..padded_len(width, height, radius)];
    pad(plane, width, height, stride, radius, padded);
    let from = padded_stride(width, radius);
    let mut kept = [V::splat(0.0); KEPT];
    for y in 0..height {
        let row = &mut plane[y * stride..y * stride + width];
        for x in (0..width).step_by(WIDTH) {
            let first = &padded[y * from + x..];
            let begin = count.div_ceil(2) + 1;
            for (i, value) in kept[..begin].iter_mut().enumerate() {
                *value = V::load(&first[i / size * from + i % size..]);
            }
            let mut n = begin;
            for i in begin..count {
                to_the_ends(&mut kept[..n]);
                n -= 1;
                kept[0] = V::load(&first[i / size * from + i % size..]);
            }
            to_the_ends(&mut kept[..n]);
            kept[1].store_at(row, x);
        }
    }
}

/// Brings the least value of each lane to the front and the largest to the end.
#[inline(always)]
fn to_the_ends<V: Lanes>(values: &mut [V]) {
    let last = values.len() - 1;
    let (mut least, mut most) = (values[0], values[last]);
    (least, most) = (least.min(most), least.max(most));
    for v in &mut values[1..last] {
        let low = least.min(*v);
        let rest = least.max(*v);
        least = low;
        *v = most.min(rest);
        most = most.max(rest);
    }
    (values[0], values[last]) = (least, most);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use crate::kernels::blur::reflect101;
    use proptest::prelude::*;

    fn slow(values: &[f32], width: usize, height: usize, size: usize) -> Vec<f64> {
        let r = (size / 2) as isize;
        let mut out = Vec::new();
        for y in 0..height as isize {
            for x in 0..width as isize {
                let at = |i: isize, j: isize| {
                    f64::from(values[reflect101(y + j, height) * width + reflect101(x + i, width)])
                };
                let mut window: Vec<f64> = (-r..=r).flat_map(|j| (-r..=r).map(move |i| at(i, j))).collect();
                window.sort_by(f64::total_cmp);
                out.push(window[window.len() / 2]);
            }
        }
        out
    }

    proptest! {
        #[test]
        fn agrees_with_a_sort_and_between_instruction_sets(
            width in 1usize..30, height in 1usize..20, radius in 1usize..=7, gap in 0usize..4, seed in 0u32..1000,
        ) {
            let (size, stride) = (2 * radius + 1, width + gap);
            let value = |i: usize| ((i as u32).wrapping_mul(2_654_435_761).wrapping_add(seed * 40_503) >> 8) % 256;
            let plane: Vec<f32> = (0..stride * height).map(|i| value(i) as f32).collect();
            let values: Vec<f32> = plane.chunks_exact(stride).flat_map(|row| row[..width].to_vec()).collect();
            let mut scratch = vec![f32::NAN; padded_len(width, height, radius)];
            let (mut wide, mut portable) = (plane.clone(), plane.clone());
            median_in_place(&mut wide, width, height, stride, size, &mut scratch);
            median_lanes::<Portable>(&mut portable, width, height, stride, size, &mut scratch);
            prop_assert_eq!(&wide, &portable);
            let exact = slow(&values, width, height, size);
            for y in 0..height {
                for x in 0..stride {
                    let want = if x < width { exact[y * width + x] } else { f64::from(plane[y * stride + x]) };
                    prop_assert_eq!(f64::from(wide[y * stride + x]), want);
                }
            }
        }
    }
}
