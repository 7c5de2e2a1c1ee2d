//! Sums, products and element-wise combinations of patches.

use super::{Lanes, WIDTH, dispatch};

dispatch! {
    /// `Σ x_i`.
    pub fn sum(x: &[f32]) -> f64 = sum_lanes;
    /// `Σ x_i y_i`.
    pub fn dot(x: &[f32], y: &[f32]) -> f64 = dot_lanes;
    /// `out_i = x_i - y_i`; returns `Σ out_i²`.
    pub fn subtract(x: &[f32], y: &[f32], out: &mut [f32]) -> f64 = subtract_lanes;
    /// `x_i <- x_i - y_i`; returns the sum of the squared results.
    pub fn subtract_from(x: &mut [f32], y: &[f32]) -> f64 = subtract_from_lanes;
    /// `out_i = (x_i - shift) * scale`; returns `Σ out_i²`.
    pub fn rescale(x: &[f32], shift: f32, scale: f32, out: &mut [f32]) -> f64 = rescale_lanes;
    /// `out_i = a x_i + b y_i`.
    pub fn combine(a: f32, x: &[f32], b: f32, y: &[f32], out: &mut [f32]) = combine_lanes;
    /// `out_i += a x_i`.
    pub fn add_scaled(a: f32, x: &[f32], out: &mut [f32]) = add_scaled_lanes;
    /// `[Σ d_i, Σ d_i², Σ d_i y_i]` with `d_i = x_i - pivot`.
    pub fn moments(x: &[f32], pivot: f32, y: &[f32]) -> [f64; 3] = moments_lanes;
    /// `Σ (x_i - y_i)²`, or any larger number than `bound` as soon as the sum exceeds it.
    pub fn squared_distance(x: &[f32], y: &[f32], bound: f32) -> f32 = squared_distance_lanes;
}

/// Elements summed in `f32` before the partial sum is widened: keeps the error of long sums near that of one block.
const BLOCK: usize = 32 * WIDTH;

#[inline(always)]
fn blocked<V: Lanes>(n: usize, mut term: impl FnMut(usize, V) -> V) -> f64 {
    let mut total = 0.0;
    let mut start = 0;
    while start < n {
        let end = (start + BLOCK).min(n);
        let mut acc = V::splat(0.0);
        let mut i = start;
        while i < end {
            acc = term(i, acc);
            i += WIDTH;
        }
        total += acc.sum();
        start = end;
    }
    total
}

#[inline(always)]
fn sum_lanes<V: Lanes>(x: &[f32]) -> f64 {
    blocked::<V>(x.len(), |i, acc| acc.add(V::load_at(x, i)))
}

#[inline(always)]
fn dot_lanes<V: Lanes>(x: &[f32], y: &[f32]) -> f64 {
    let y = &y[..x.len()];
    blocked::<V>(x.len(), |i, acc| V::load_at(x, i).mul_add(V::load_at(y, i), acc))
}

#[inline(always)]
fn subtract_lanes<V: Lanes>(x: &[f32], y: &[f32], out: &mut [f32]) -> f64 {
    let (y, out) = (&y[..x.len()], &mut out[..x.len()]);
    blocked::<V>(x.len(), |i, acc| {
        let d = V::load_at(x, i).sub(V::load_at(y, i));
        d.store_at(out, i);
        d.mul_add(d, acc)
    })
}

#[inline(always)]
fn subtract_from_lanes<V: Lanes>(x: &mut [f32], y: &[f32]) -> f64 {
    let y = &y[..x.len()];
    blocked::<V>(x.len(), |i, acc| {
        let d = V::load_at(x, i).sub(V::load_at(y, i));
        d.store_at(x, i);
        d.mul_add(d, acc)
    })
}

#[inline(always)]
fn rescale_lanes<V: Lanes>(x: &[f32], shift: f32, scale: f32, out: &mut [f32]) -> f64 {
    let out = &mut out[..x.len()];
    let (shift, scale) = (V::splat(shift), V::splat(scale));
    let tail = x.len() % WIDTH;
    let whole = x.len() - tail;
    let (mut total, mut start) = (0.0, 0);
    while start < whole {
        let end = (start + BLOCK).min(whole);
        let mut acc = V::splat(0.0);
        let groups = x[start..end].chunks_exact(WIDTH);
        for (x, out) in groups.zip(out[start..end].chunks_exact_mut(WIDTH)) {
            let d = V::load(x).sub(shift).mul(scale);
            d.store(out);
            acc = d.mul_add(d, acc);
        }
        total += acc.sum();
        start = end;
    }
    // The padding lanes of a partial load are not zero after the shift, so the tail is added up apart.
    if tail > 0 {
        let at = x.len() - tail;
        V::load_partial(&x[at..])
            .sub(shift)
            .mul(scale)
            .store_partial(&mut out[at..]);
        total += out[at..]
            .iter()
            .map(|&v| f64::from(v) * f64::from(v))
            .sum::<f64>();
    }
    total
}

#[inline(always)]
fn combine_lanes<V: Lanes>(a: f32, x: &[f32], b: f32, y: &[f32], out: &mut [f32]) {
    let (y, out) = (&y[..x.len()], &mut out[..x.len()]);
    let (a, b) = (V::splat(a), V::splat(b));
    let mut i = 0;
    while i < x.len() {
        V::load_at(x, i)
            .mul_add(a, V::load_at(y, i).mul(b))
            .store_at(out, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn add_scaled_lanes<V: Lanes>(a: f32, x: &[f32], out: &mut [f32]) {
    let out = &mut out[..x.len()];
    let a = V::splat(a);
    let mut i = 0;
    while i < x.len() {
        V::load_at(x, i).mul_add(a, V::load_at(out, i)).store_at(out, i);
        i += WIDTH;
    }
}

/// Adds what eight values contribute to [`moments`].
#[inline(always)]
fn add_moments<V: Lanes>([a, b, c]: [V; 3], d: V, y: V) -> [V; 3] {
    [a.add(d), d.mul_add(d, b), d.mul_add(y, c)]
}

#[inline(always)]
fn moments_lanes<V: Lanes>(x: &[f32], pivot: f32, y: &[f32]) -> [f64; 3] {
    let y = &y[..x.len()];
    let (p, whole) = (V::splat(pivot), x.len() - x.len() % WIDTH);
    // Lanes beyond the end count as the pivot.
    let mut tail = [pivot; WIDTH];
    tail[..x.len() - whole].copy_from_slice(&x[whole..]);
    let last = add_moments(
        [V::splat(0.0); 3],
        V::from_array(tail).sub(p),
        V::load_partial(&y[whole..]),
    );
    let mut totals = last.map(V::sum);
    let mut start = 0;
    while start < whole {
        let end = (start + BLOCK).min(whole);
        let mut sums = [V::splat(0.0); 3];
        let mut i = start;
        while i < end {
            sums = add_moments(sums, V::load(&x[i..i + WIDTH]).sub(p), V::load(&y[i..i + WIDTH]));
            i += WIDTH;
        }
        for (total, sum) in totals.iter_mut().zip(sums) {
            *total += sum.sum();
        }
        start = end;
    }
    totals
}

#[inline(always)]
fn squared_distance_lanes<V: Lanes>(x: &[f32], y: &[f32], bound: f32) -> f32 {
    let y = &y[..x.len()];
    let mut total = 0.0;
    let mut start = 0;
    while start < x.len() && total <= bound {
        let end = (start + BLOCK).min(x.len());
        let mut acc = V::splat(0.0);
        let mut i = start;
        while i < end {
            let d = V::load_at(x, i).sub(V::load_at(y, i));
            acc = d.mul_add(d, acc);
            i += WIDTH;
        }
        total += acc.sum() as f32;
        start = end;
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agree_with_f64_loops_and_between_instruction_sets(
            v in prop::collection::vec((0f32..255.0, 0f32..255.0), 0..700)
        ) {
            let (x, y): (Vec<f32>, Vec<f32>) = v.into_iter().unzip();
            let wide = |s: &[f32]| s.iter().map(|&a| f64::from(a)).collect::<Vec<_>>();
            let (xd, yd) = (wide(&x), wide(&y));
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b.abs() + 1e-9;
            prop_assert!(near(sum(&x), xd.iter().sum()));
            prop_assert!(near(dot(&x, &y), xd.iter().zip(&yd).map(|(a, b)| a * b).sum()));
            let mut out = vec![0.0; x.len()];
            let ssd: f64 = x.iter().zip(&y).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            prop_assert!(near(subtract(&x, &y, &mut out), ssd));
            prop_assert!(near(f64::from(squared_distance(&x, &y, f32::INFINITY)), ssd));
            prop_assert!(f64::from(squared_distance(&x, &y, 10.0)) <= ssd * 1.000001);
            let scaled: f64 = xd.iter().map(|a| ((a - 100.0) * 0.25).powi(2)).sum();
            prop_assert!((rescale(&x, 100.0, 0.25, &mut out) - scaled).abs() <= 1e-5 * scaled + 1e-9);
            let got = moments(&x, 100.0, &y);
            let want = xd.iter().zip(&yd).fold([0.0; 3], |[a, b, c], (x, y)| {
                let d = x - 100.0;
                [a + d, b + d * d, c + d * y]
            });
            // To as much as the largest terms there can be.
            for ((got, want), most) in got.into_iter().zip(want).zip([155.0, 155.0 * 155.0, 155.0 * 255.0]) {
                prop_assert!((got - want).abs() <= 1e-6 * most * x.len() as f64 + 1e-9, "{} {}", got, want);
            }
            prop_assert_eq!(got, moments_lanes::<Portable>(&x, 100.0, &y));
            prop_assert_eq!(sum(&x), sum_lanes::<Portable>(&x));
            prop_assert_eq!(dot(&x, &y), dot_lanes::<Portable>(&x, &y));
            combine(2.0, &x, -0.5, &y, &mut out);
            for i in 0..x.len() {
                prop_assert!((f64::from(out[i]) - (2.0 * xd[i] - 0.5 * yd[i])).abs() < 1e-4);
            }
            let before = out.clone();
            add_scaled(-0.5, &x, &mut out);
            for i in 0..x.len() {
                prop_assert!((out[i] - (before[i] - 0.5 * x[i])).abs() < 1e-4);
            }
        }
    }
}
