//! Separable symmetric filters of a float plane, in place, border reflected without repeating the edge pixel
//! (`… 2 1 | 0 1 2 …`).

use super::{Lanes, WIDTH, dispatch};

/// Longest filter.
pub const MAX_TAPS: usize = 31;

/// Elements of the scratch slice that [`separable_in_place`] needs for an image `width` pixels wide.
pub fn scratch_len(width: usize, taps: usize) -> usize {
    let taps = compiled_taps(taps);
    (taps + 1) * width.next_multiple_of(WIDTH) + taps - 1
}

/// The kernel is compiled for these lengths; others are filled up with zero weights at both ends.
fn compiled_taps(taps: usize) -> usize {
    [3, 5, 7, 11, 17]
        .into_iter()
        .find(|&n| taps <= n)
        .unwrap_or(MAX_TAPS)
}

/// Position `i` reflected into `0..n` about the first and last element, as often as needed.
pub fn reflect101(i: isize, n: usize) -> usize {
    if n == 1 {
        return 0;
    }
    let period = 2 * (n as isize - 1);
    let i = i.rem_euclid(period);
    i.min(period - i) as usize
}

dispatch! {
    /// Filters the `width x height` image in `plane` (rows `stride` apart) with `weights` along rows, then along
    /// columns: `out(x, y) = sum_j w_j sum_i w_i in(x + i - r, y + j - r)`, `r = (taps - 1) / 2`.
    ///
    /// One pass over memory: the last `taps` row-filtered rows live in `scratch` ([`scratch_len`] elements).
    /// `weights` has an odd number of taps, at most [`MAX_TAPS`]. Elements between `width` and `stride` stay as they
    /// are.
    pub fn separable_in_place(plane: &mut [f32], width: usize, height: usize, stride: usize, weights: &[f32], scratch: &mut [f32]) = separable;
}

#[inline(always)]
fn separable<L: Lanes>(
    plane: &mut [f32],
    width: usize,
    height: usize,
    stride: usize,
    weights: &[f32],
    scratch: &mut [f32],
) {
    assert!(
        weights.len() % 2 == 1 && weights.len() <= MAX_TAPS,
        "odd number of taps"
    );
    match compiled_taps(weights.len()) {
        3 => separable_taps::<L, 3>(plane, width, height, stride, weights, scratch),
        5 => separable_taps::<L, 5>(plane, width, height, stride, weights, scratch),
        7 => separable_taps::<L, 7>(plane, width, height, stride, weights, scratch),
        11 => separable_taps::<L, 11>(plane, width, height, stride, weights, scratch),
        17 => separable_taps::<L, 17>(plane, width, height, stride, weights, scratch),
        _ => separable_taps::<L, MAX_TAPS>(plane, width, height, stride, weights, scratch),
    }
}

#[inline(always)]
fn separable_taps<L: Lanes, const N: usize>(
    plane: &mut [f32],
    width: usize,
    height: usize,
    stride: usize,
    weights: &[f32],
    scratch: &mut [f32],
) {
    if width == 0 || height == 0 {
        return;
    }
    let radius = N / 2;
    let mut taps = [0.0; N];
    taps[(N - weights.len()) / 2..][..weights.len()].copy_from_slice(weights);
    let taps = L::splat_each(taps);
    let padded = width.next_multiple_of(WIDTH);
    let (ring, line) = scratch[..scratch_len(width, N)].split_at_mut(N * padded);
    line.fill(0.0);

    let mut done = 0; // rows 0..done are filtered along x; the last N of them are in the ring
    for y in 0..height {
        while done < height.min(y + radius + 1) {
            let row = &plane[done * stride..done * stride + width];
            line[radius..radius + width].copy_from_slice(row);
            for i in 1..=radius {
                line[radius - i] = row[reflect101(-(i as isize), width)];
                line[radius + width - 1 + i] = row[reflect101((width - 1 + i) as isize, width)];
            }
            let slot = done % N;
            filter_line(line, &taps, &mut ring[slot * padded..(slot + 1) * padded]);
            done += 1;
        }
        // A loop, as in `combine_rows`: closures are left without the wide instructions.
        let mut rows: [&[f32]; N] = [&[]; N];
        for k in 0..N {
            let slot = reflect101((y + k) as isize - radius as isize, height) % N;
            rows[k] = &ring[slot * padded..(slot + 1) * padded];
        }
        combine_rows(rows, &taps, &mut plane[y * stride..y * stride + width]);
    }
}

/// `out[x] = sum_k taps[k] line[x + k]`; `out` is a whole number of lanes.
#[inline(always)]
fn filter_line<L: Lanes, const N: usize>(line: &[f32], taps: &[L; N], out: &mut [f32]) {
    for (i, o) in out.chunks_exact_mut(WIDTH).enumerate() {
        let from = &line[i * WIDTH..i * WIDTH + WIDTH + N - 1];
        let mut sum = L::load(&from[..WIDTH]).mul(taps[0]);
        for k in 1..N {
            sum = L::load(&from[k..k + WIDTH]).mul_add(taps[k], sum);
        }
        sum.store(o);
    }
}

/// `sum_k taps[k] rows[k][x..]`.
#[inline(always)]
fn weighted_at<L: Lanes, const N: usize>(rows: &[&[f32]; N], taps: &[L; N], x: usize) -> L {
    let mut sum = L::load(&rows[0][x..x + WIDTH]).mul(taps[0]);
    for k in 1..N {
        sum = L::load(&rows[k][x..x + WIDTH]).mul_add(taps[k], sum);
    }
    sum
}

/// `out[x] = sum_k taps[k] rows[k][x]`; rows are whole numbers of lanes, `out.len()` rounded up.
#[inline(always)]
fn combine_rows<L: Lanes, const N: usize>(mut rows: [&[f32]; N], taps: &[L; N], out: &mut [f32]) {
    for row in &mut rows {
        *row = &row[..out.len().next_multiple_of(WIDTH)];
    }
    let whole = out.len() - out.len() % WIDTH;
    let mut x = 0;
    while x < whole {
        weighted_at(&rows, taps, x).store(&mut out[x..x + WIDTH]);
        x += WIDTH;
    }
    if x < out.len() {
        weighted_at(&rows, taps, x).store_partial(&mut out[x..]);
    }
}

/// Slow versions in `f64`.
#[cfg(test)]
pub mod reference {
    use super::reflect101;

    /// The filter of [`separable_in_place`](super::separable_in_place) as a double sum over row-major `values`.
    pub fn separable(values: &[f64], width: usize, height: usize, weights: &[f64]) -> Vec<f64> {
        let r = (weights.len() / 2) as isize;
        let mut out = Vec::with_capacity(values.len());
        for y in 0..height as isize {
            for x in 0..width as isize {
                let mut sum = 0.0;
                for (j, wy) in (-r..).zip(weights) {
                    for (i, wx) in (-r..).zip(weights) {
                        sum += wx * wy * values[reflect101(y + j, height) * width + reflect101(x + i, width)];
                    }
                }
                out.push(sum);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};

    type Kernel = fn(&mut [f32], usize, usize, usize, &[f32], &mut [f32]);

    fn weights(taps: usize) -> Vec<f64> {
        let raw: Vec<f64> = (0..taps).map(|k| 1.0 + (k.min(taps - 1 - k)) as f64).collect();
        let sum: f64 = raw.iter().sum();
        raw.iter().map(|w| w / sum).collect()
    }

    fn noise(n: usize, seed: u64) -> Vec<f32> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        (0..n).map(|_| rng.random_range(0.0f32..255.0)).collect()
    }

    /// Runs one compilation of the kernel on a plane whose rows have `gap` spare elements.
    fn run(kernel: Kernel, values: &[f32], width: usize, gap: usize, weights: &[f64]) -> Vec<f32> {
        let (height, stride) = (values.len() / width, width + gap);
        let mut plane = vec![7.5; stride * height];
        for (p, v) in plane.chunks_exact_mut(stride).zip(values.chunks_exact(width)) {
            p[..width].copy_from_slice(v);
        }
        let w: Vec<f32> = weights.iter().map(|&w| w as f32).collect();
        let mut scratch = vec![f32::NAN; scratch_len(width, w.len())];
        kernel(&mut plane, width, height, stride, &w, &mut scratch);
        assert!(
            plane
                .chunks_exact(stride)
                .all(|p| p[width..].iter().all(|&v| v == 7.5)),
            "spare elements"
        );
        plane
            .chunks_exact(stride)
            .flat_map(|p| p[..width].iter().copied())
            .collect()
    }

    #[test]
    fn reflection_never_repeats_the_edge() {
        let at: Vec<usize> = (-4..8).map(|i| reflect101(i, 4)).collect();
        assert_eq!(at, [2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1]);
        assert_eq!(reflect101(-9, 1), 0);
        assert_eq!((reflect101(-1, 2), reflect101(2, 2)), (1, 0));
    }

    #[test]
    fn a_constant_stays_constant() {
        let out = run(separable::<Portable>, &[42.0; 35], 7, 3, &weights(5));
        assert!(out.iter().all(|v| (v - 42.0).abs() < 1e-4));
    }

    proptest! {
        #[test]
        fn agrees_with_the_reference_and_between_instruction_sets(
            width in 1usize..40, height in 1usize..40, radius in 0usize..=15, gap in 0usize..4, seed: u64
        ) {
            let (values, w) = (noise(width * height, seed), weights(2 * radius + 1));
            let fast = run(separable_in_place, &values, width, gap, &w);
            let portable = run(separable::<Portable>, &values, width, gap, &w);
            prop_assert!(fast.iter().zip(&portable).all(|(a, b)| a.to_bits() == b.to_bits()));
            let exact: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
            for (a, b) in fast.iter().zip(reference::separable(&exact, width, height, &w)) {
                prop_assert!((f64::from(*a) - b).abs() < 1e-3, "{} {}", a, b);
            }
        }
    }

    /// Prints the time of the default filter on a 640x480 plane: `cargo test --release -- --ignored --nocapture blur`.
    #[test]
    #[ignore = "prints a time"]
    fn time_of_640x480() {
        let mut plane = noise(648 * 480, 1);
        let w: Vec<f32> = weights(5).iter().map(|&w| w as f32).collect();
        let mut scratch = vec![0.0; scratch_len(640, 5)];
        for (name, kernel) in [
            ("dispatched", separable_in_place as Kernel),
            ("portable", separable::<Portable>),
        ] {
            let best = (0..200)
                .map(|_| {
                    let start = std::time::Instant::now();
                    kernel(&mut plane, 640, 480, 648, &w, &mut scratch);
                    start.elapsed()
                })
                .min();
            println!("5 taps, 640x480, {name}: {best:?}");
        }
    }
}
