//! Half-size images: binomial low-pass and decimation by two (Burt & Adelson 1983).

use super::blur::reflect101;
use super::{Lanes, WIDTH, dispatch};

/// Elements of the scratch slice that [`halve`] needs for an image `width` pixels wide.
pub fn halve_scratch_len(width: usize) -> usize {
    width.next_multiple_of(2 * WIDTH) + 3 * WIDTH
}

dispatch! {
    /// `out(x, y) = Σ_j Σ_i w_i w_j in(2x + i, 2y + j)`, `w = [1 4 6 4 1]/16`, `i, j = -2..=2`, border reflected without
    /// repeating the edge pixel. `out` has `⌈width/2⌉ x ⌈height/2⌉` pixels in rows `out_stride` apart; `scratch` has
    /// [`halve_scratch_len`] elements.
    pub fn halve(
        plane: &[f32], width: usize, height: usize, stride: usize, out: &mut [f32], out_stride: usize, scratch: &mut [f32],
    ) = halve_lanes;
}

/// `(a + e + 4 (b + d) + 6 c) / 16`.
#[inline(always)]
fn binomial<V: Lanes>(a: V, b: V, c: V, d: V, e: V) -> V {
    let sum = b.add(d).mul_add(V::splat(4.0), a.add(e));
    c.mul_add(V::splat(6.0), sum).mul(V::splat(1.0 / 16.0))
}

/// Even and odd ones of the first sixteen elements.
#[inline(always)]
fn pairs<V: Lanes>(s: &[f32]) -> (V, V) {
    let s = &s[..2 * WIDTH];
    V::unzip(V::load(&s[..WIDTH]), V::load(&s[WIDTH..]))
}

#[inline(always)]
fn halve_lanes<V: Lanes>(
    plane: &[f32],
    width: usize,
    height: usize,
    stride: usize,
    out: &mut [f32],
    out_stride: usize,
    scratch: &mut [f32],
) {
    let half = width.div_ceil(2);
    // The line starts eight elements in, so that its left border fits before it.
    let line = &mut scratch[..halve_scratch_len(width)];
    line.fill(0.0);
    for y in 0..height.div_ceil(2) {
        let row = |j: isize| {
            let at = reflect101(2 * y as isize + j, height) * stride;
            &plane[at..at + width]
        };
        let (a, b, c, d, e) = (row(-2), row(-1), row(0), row(1), row(2));
        let mut x = 0;
        while x < width {
            let v = binomial(
                V::load_at(a, x),
                V::load_at(b, x),
                V::load_at(c, x),
                V::load_at(d, x),
                V::load_at(e, x),
            );
            v.store(&mut line[WIDTH + x..2 * WIDTH + x]);
            x += WIDTH;
        }
        for i in 1..=2 {
            line[WIDTH - i] = line[WIDTH + reflect101(-(i as isize), width)];
            line[WIDTH + width + i - 1] = line[WIDTH + reflect101((width + i - 1) as isize, width)];
        }
        let out = &mut out[y * out_stride..y * out_stride + half];
        let mut x = 0;
        while x < half {
            let from = WIDTH + 2 * x;
            let (a, b) = pairs::<V>(&line[from - 2..]);
            let (c, d) = pairs::<V>(&line[from..]);
            let (e, _) = pairs::<V>(&line[from + 2..]);
            binomial(a, b, c, d, e).store_at(out, x);
            x += WIDTH;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    fn run(
        kernel: fn(&[f32], usize, usize, usize, &mut [f32], usize, &mut [f32]),
        values: &[f32],
        width: usize,
    ) -> Vec<f32> {
        let height = values.len() / width;
        let (w, h) = (width.div_ceil(2), height.div_ceil(2));
        let mut out = vec![0.0; w * h];
        let mut scratch = vec![f32::NAN; halve_scratch_len(width)];
        kernel(values, width, height, width, &mut out, w, &mut scratch);
        out
    }

    proptest! {
        #[test]
        fn agrees_with_f64_and_between_instruction_sets(width in 1usize..50, height in 1usize..20, seed in 0u32..1000) {
            let values: Vec<f32> = (0..width * height)
                .map(|i| (((i as u32 + seed).wrapping_mul(2_654_435_761)) >> 24) as f32)
                .collect();
            let got = run(halve, &values, width);
            prop_assert_eq!(&got, &run(halve_lanes::<Portable>, &values, width));
            let w = [1.0, 4.0, 6.0, 4.0, 1.0].map(|v: f64| v / 16.0);
            for (k, v) in got.iter().enumerate() {
                let (x, y) = (k % width.div_ceil(2), k / width.div_ceil(2));
                let mut sum = 0.0;
                for (j, wj) in w.iter().enumerate() {
                    for (i, wi) in w.iter().enumerate() {
                        let sx = reflect101((2 * x + i) as isize - 2, width);
                        let sy = reflect101((2 * y + j) as isize - 2, height);
                        sum += wi * wj * f64::from(values[sy * width + sx]);
                    }
                }
                prop_assert!((f64::from(*v) - sum).abs() < 1e-3, "{} {}", v, sum);
            }
        }
    }
}
