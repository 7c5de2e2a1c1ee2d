//! Tone maps: the mean of one patch given the other, in bins of intensity or as a line, globally or in windows whose
//! maps are blended.
//!
//! A map is kept as a *shift*: `m(v) = v + d(v)`. With `a` the patch whose tones are mapped and `b` the other one, the
//! shift of a bin is the mean of `b - a` over the bin, so equal patches have no shift at all.

use super::{Lanes, WIDTH, dispatch};

/// Part of a patch: `cols x rows` points from `(x, y)` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub cols: usize,
    /// Rows.
    pub rows: usize,
}

impl Window {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.cols * self.rows
    }
    fn centre(&self) -> [f32; 2] {
        [
            self.x as f32 + 0.5 * (self.cols as f32 - 1.0),
            self.y as f32 + 0.5 * (self.rows as f32 - 1.0),
        ]
    }
    /// Index ranges of its rows in a patch of `stride` columns.
    fn ranges(self, stride: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
        (self.y..self.y + self.rows).map(move |y| y * stride + self.x..y * stride + self.x + self.cols)
    }
}

dispatch! {
    /// Bin of each value: `floor(a_i * per_level)`, held to `0..=last`.
    pub fn tone_bins(a: &[f32], per_level: f32, last: u8, out: &mut [u8]) = bins_lanes;
    /// `[Σ c, Σ c², Σ δ, Σ c δ, Σ δ²]` with `c = a - pivot`, `δ = b - a` over a window of patches of `stride` columns.
    pub fn line_sums(a: &[f32], b: &[f32], pivot: f32, stride: usize, window: Window) -> [f64; 5] = line_sums_lanes;
    /// Shift `d` of each value, constant within a bin: `tables[w * bins + bin]` for window `w`, blended with the windows'
    /// [`blend_weights`]. `slope`, when not empty, receives `dm/dv` from the neighbouring bins.
    pub fn step_shift(
        indices: &[u8], per_level: f32, tables: &[f32], weights: &[f32], out: &mut [f32], slope: &mut [f32],
    ) = step_lanes;
    /// The same, interpolated between the centres of the bins.
    pub fn linear_shift(
        a: &[f32], per_level: f32, tables: &[f32], weights: &[f32], out: &mut [f32], slope: &mut [f32],
    ) = linear_lanes;
    /// The same with a line `d = lines[w][0] + lines[w][1] (v - pivot)` for each window.
    pub fn line_shift(
        a: &[f32], pivot: f32, lines: &[[f32; 2]], weights: &[f32], out: &mut [f32], slope: &mut [f32],
    ) = line_lanes;
    /// `out_i = a_i + shift_i - b_i`; returns `Σ out_i²`.
    pub fn shifted_residual(a: &[f32], shift: &[f32], b: &[f32], out: &mut [f32]) -> f64 = residual_lanes;
}

/// Adds `[count, Σ δ, Σ c, Σ c²]` of each bin over a window of patches of `stride` columns, `c = a - pivot` and
/// `δ = b - a`.
pub fn tone_sums(
    bins: &[u8],
    a: &[f32],
    b: &[f32],
    pivot: f32,
    stride: usize,
    window: Window,
    sums: &mut [[f64; 4]; 256],
) {
    for range in window.ranges(stride) {
        let (bins, a, b) = (&bins[range.clone()], &a[range.clone()], &b[range]);
        for ((&k, &a), &b) in bins.iter().zip(a).zip(b) {
            let c = f64::from(a - pivot);
            let add = [1.0, f64::from(b - a), c, c * c];
            for (s, v) in sums[usize::from(k)].iter_mut().zip(add) {
                *s += v;
            }
        }
    }
}

#[inline(always)]
fn bins_lanes<V: Lanes>(a: &[f32], per_level: f32, last: u8, out: &mut [u8]) {
    let out = &mut out[..a.len()];
    let (scale, top) = (V::splat(per_level), V::splat(f32::from(last)));
    for i in (0..a.len()).step_by(WIDTH) {
        let v = V::load_at(a, i).mul(scale).max(V::splat(0.0)).min(top).to_array();
        for (o, v) in out[i..].iter_mut().zip(v) {
            *o = v as u8;
        }
    }
}

#[inline(always)]
fn line_sums_lanes<V: Lanes>(a: &[f32], b: &[f32], pivot: f32, stride: usize, window: Window) -> [f64; 5] {
    // Vectors summed in `f32` before they are widened.
    const RUN: usize = 64;
    let pivot = V::splat(pivot);
    let ramp = V::from_array(std::array::from_fn(|l| l as f32));
    let (mut total, mut acc, mut run) = ([0.0; 5], [V::splat(0.0); 5], 0);
    for range in window.ranges(stride) {
        let (a, b) = (&a[range.clone()], &b[range]);
        let mut i = 0;
        while i < a.len() {
            let (v, o) = (V::load_at(a, i), V::load_at(b, i));
            let (mut c, d) = (v.sub(pivot), o.sub(v));
            if i + WIDTH > a.len() {
                c = c.mul(ramp.less(V::splat((a.len() - i) as f32)));
            }
            acc[0] = acc[0].add(c);
            acc[1] = c.mul_add(c, acc[1]);
            acc[2] = acc[2].add(d);
            acc[3] = c.mul_add(d, acc[3]);
            acc[4] = d.mul_add(d, acc[4]);
            i += WIDTH;
            run += 1;
            if run == RUN {
                widen(&mut acc, &mut total);
                run = 0;
            }
        }
    }
    widen(&mut acc, &mut total);
    total
}

#[inline(always)]
fn widen<V: Lanes>(acc: &mut [V; 5], total: &mut [f64; 5]) {
    for (t, s) in total.iter_mut().zip(acc) {
        *t += s.sum();
        *s = V::splat(0.0);
    }
}

/// Weights with which the maps of windows are blended at each point of a patch, window after window:
/// `1 / (1 + |x - centre|²)`, normalised to a sum of one. Empty where one window has all the weight.
pub fn blend_weights(windows: &[Window], cols: usize, rows: usize) -> Vec<f32> {
    if windows.len() == 1 {
        return Vec::new();
    }
    let n = cols * rows;
    let mut out = vec![0.0; windows.len() * n];
    for i in 0..n {
        let (x, y) = ((i % cols) as f32, (i / cols) as f32);
        let raw = |w: &Window| {
            let [cx, cy] = w.centre();
            1.0 / (1.0 + (x - cx).powi(2) + (y - cy).powi(2))
        };
        let sum: f32 = windows.iter().map(raw).sum();
        for (k, w) in windows.iter().enumerate() {
            out[k * n + i] = raw(w) / sum;
        }
    }
    out
}

/// A map per window. A trait with always inlined methods, not a closure, so that it takes part in the caller's
/// instruction set.
trait Maps<V>: Copy {
    /// Shift and slope minus one of window `w` at the points from `i` on.
    fn at(self, w: usize, i: usize, sloped: bool) -> [V; 2];
}

/// Blends the windows' maps at each point.
#[inline(always)]
fn blend<V: Lanes>(weights: &[f32], maps: impl Maps<V>, out: &mut [f32], slope: &mut [f32]) {
    let n = out.len();
    let sloped = !slope.is_empty();
    let one = V::splat(1.0);
    let mut i = 0;
    while i < n {
        let [mut shift, mut extra] = [V::splat(0.0); 2];
        if weights.is_empty() {
            [shift, extra] = maps.at(0, i, sloped);
        }
        for (k, weights) in weights.chunks_exact(n).enumerate() {
            let ([d, s], w) = (maps.at(k, i, sloped), V::load_at(weights, i));
            shift = w.mul_add(d, shift);
            extra = w.mul_add(s, extra);
        }
        shift.store_at(out, i);
        if sloped {
            extra.add(one).store_at(slope, i);
        }
        i += WIDTH;
    }
}

#[derive(Clone, Copy)]
struct Steps<'a> {
    indices: &'a [u8],
    per_level: f32,
    tables: &'a [f32],
    bins: usize,
}

impl<V: Lanes> Maps<V> for Steps<'_> {
    #[inline(always)]
    fn at(self, w: usize, i: usize, sloped: bool) -> [V; 2] {
        let table = &self.tables[w * self.bins..(w + 1) * self.bins];
        let end = (i + WIDTH).min(self.indices.len());
        let indices = &self.indices[i..end];
        let (mut shift, mut rise) = ([0.0; WIDTH], [0.0; WIDTH]);
        for (l, &k) in indices.iter().enumerate() {
            let k = usize::from(k).min(self.bins - 1);
            shift[l] = table[k];
            if sloped {
                let (low, high) = (k.saturating_sub(1), (k + 1).min(self.bins - 1));
                rise[l] = (table[high] - table[low]) / (high - low).max(1) as f32;
            }
        }
        let rise = V::from_array(rise).mul(V::splat(self.per_level));
        [V::from_array(shift), rise]
    }
}

#[inline(always)]
fn step_lanes<V: Lanes>(
    indices: &[u8],
    per_level: f32,
    tables: &[f32],
    weights: &[f32],
    out: &mut [f32],
    slope: &mut [f32],
) {
    let bins = tables.len() / (weights.len() / out.len()).max(1);
    let maps = Steps {
        indices,
        per_level,
        tables,
        bins,
    };
    blend::<V>(weights, maps, out, slope);
}

#[derive(Clone, Copy)]
struct Polylines<'a> {
    a: &'a [f32],
    per_level: f32,
    tables: &'a [f32],
    bins: usize,
}

impl<V: Lanes> Maps<V> for Polylines<'_> {
    #[inline(always)]
    fn at(self, w: usize, i: usize, _sloped: bool) -> [V; 2] {
        let table = &self.tables[w * self.bins..(w + 1) * self.bins];
        let v = V::load_at(self.a, i).mul_add(V::splat(self.per_level), V::splat(-0.5));
        let position = v.max(V::splat(0.0)).min(V::splat((self.bins - 1) as f32));
        let low = position.floor();
        let (mut start, mut end) = ([0.0; WIDTH], [0.0; WIDTH]);
        for (l, k) in low.to_array().into_iter().enumerate() {
            // Through i32, which converts in one instruction; the value is a small whole number.
            let k = (k as i32 as usize).min(self.bins - 1);
            start[l] = table[k];
            end[l] = table[(k + 1).min(self.bins - 1)];
        }
        let start = V::from_array(start);
        let rise = V::from_array(end).sub(start);
        let shift = position.sub(low).mul_add(rise, start);
        [shift, rise.mul(V::splat(self.per_level))]
    }
}

#[inline(always)]
fn linear_lanes<V: Lanes>(
    a: &[f32],
    per_level: f32,
    tables: &[f32],
    weights: &[f32],
    out: &mut [f32],
    slope: &mut [f32],
) {
    let bins = tables.len() / (weights.len() / out.len()).max(1);
    let maps = Polylines {
        a,
        per_level,
        tables,
        bins,
    };
    blend::<V>(weights, maps, out, slope);
}

#[derive(Clone, Copy)]
struct Lines<'a> {
    a: &'a [f32],
    pivot: f32,
    lines: &'a [[f32; 2]],
}

impl<V: Lanes> Maps<V> for Lines<'_> {
    #[inline(always)]
    fn at(self, w: usize, i: usize, _sloped: bool) -> [V; 2] {
        let [offset, gain] = self.lines[w];
        let v = V::load_at(self.a, i).sub(V::splat(self.pivot));
        [v.mul_add(V::splat(gain), V::splat(offset)), V::splat(gain)]
    }
}

#[inline(always)]
fn line_lanes<V: Lanes>(
    a: &[f32],
    pivot: f32,
    lines: &[[f32; 2]],
    weights: &[f32],
    out: &mut [f32],
    slope: &mut [f32],
) {
    blend::<V>(weights, Lines { a, pivot, lines }, out, slope);
}

#[inline(always)]
fn residual_lanes<V: Lanes>(a: &[f32], shift: &[f32], b: &[f32], out: &mut [f32]) -> f64 {
    let n = a.len();
    let (shift, b, out) = (&shift[..n], &b[..n], &mut out[..n]);
    let (mut total, mut start) = (0.0, 0);
    while start < n {
        let end = (start + 32 * WIDTH).min(n);
        let mut acc = V::splat(0.0);
        for i in (start..end).step_by(WIDTH) {
            // Difference first: the shift is of its size.
            let e = V::load_at(a, i).sub(V::load_at(b, i)).add(V::load_at(shift, i));
            e.store_at(out, i);
            acc = e.mul_add(e, acc);
        }
        total += acc.sum();
        start = end;
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    const BINS: usize = 16;
    const PER_LEVEL: f32 = BINS as f32 / 256.0;

    fn windows(cols: usize, rows: usize) -> Vec<Window> {
        let (w, h) = (cols.div_ceil(2), rows.div_ceil(2));
        let at = |x, y| Window {
            x,
            y,
            cols: w,
            rows: h,
        };
        vec![at(0, 0), at(cols - w, 0), at(0, rows - h), at(cols - w, rows - h)]
    }

    /// Blended value at point `i` of one number per window.
    fn blended(windows: &[Window], cols: usize, i: usize, value: impl Fn(usize) -> f64) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (k, w) in windows.iter().enumerate() {
            let [cx, cy] = w.centre().map(f64::from);
            let weight = 1.0 / (1.0 + ((i % cols) as f64 - cx).powi(2) + ((i / cols) as f64 - cy).powi(2));
            sum += weight * value(k);
            weights += weight;
        }
        sum / weights
    }

    proptest! {
        #[test]
        fn agree_with_f64_loops_and_between_instruction_sets(
            cols in 2usize..40, rows in 2usize..12, seed in 0u32..1000, local: bool,
        ) {
            let n = cols * rows;
            let value = |i: usize, k: u32| {
                let v = (i as u32).wrapping_mul(2654435761).wrapping_add((k + seed).wrapping_mul(40503)) >> 8;
                (v % 25501) as f32 / 100.0
            };
            let a: Vec<f32> = (0..n).map(|i| value(i, 1)).collect();
            let b: Vec<f32> = (0..n).map(|i| value(i, 2)).collect();
            let whole = Window { x: 0, y: 0, cols, rows };
            let windows = if local { windows(cols, rows) } else { vec![whole] };

            let mut bins = vec![0u8; n];
            tone_bins(&a, PER_LEVEL, (BINS - 1) as u8, &mut bins);
            for (k, a) in bins.iter().zip(&a) {
                prop_assert_eq!(usize::from(*k), ((a / 16.0) as usize).min(BINS - 1));
            }
            let mut sums = [[0.0; 4]; 256];
            let window = *windows.last().unwrap();
            tone_sums(&bins, &a, &b, 100.0, cols, window, &mut sums);
            prop_assert_eq!(sums.iter().map(|s| s[0]).sum::<f64>(), window.len() as f64);
            let expected: Vec<[f64; 2]> = window
                .ranges(cols)
                .flatten()
                .map(|i| [f64::from(a[i]) - 100.0, f64::from(b[i]) - f64::from(a[i])])
                .collect();
            let total = |f: &dyn Fn(&[f64; 2]) -> f64| expected.iter().map(f).sum::<f64>();
            for (k, e) in [(1, total(&|e| e[1])), (2, total(&|e| e[0])), (3, total(&|e| e[0] * e[0]))] {
                prop_assert!((sums.iter().map(|s| s[k]).sum::<f64>() - e).abs() < 1e-6 * 65025.0 * n as f64);
            }
            let line = line_sums(&a, &b, 100.0, cols, window);
            prop_assert_eq!(line, line_sums_lanes::<Portable>(&a, &b, 100.0, cols, window));
            let exact = [
                total(&|e| e[0]), total(&|e| e[0] * e[0]), total(&|e| e[1]), total(&|e| e[0] * e[1]),
                total(&|e| e[1] * e[1]),
            ];
            for (l, e) in line.iter().zip(exact) {
                prop_assert!((l - e).abs() < 1e-6 * 65025.0 * n as f64);
            }

            let tables: Vec<f32> = (0..windows.len() * BINS).map(|i| value(i, 3) - 128.0).collect();
            let lines: Vec<[f32; 2]> = (0..windows.len()).map(|i| [value(i, 4), value(i, 5) / 255.0 - 0.5]).collect();
            let weights = blend_weights(&windows, cols, rows);
            let new = || (vec![0.0; n], vec![0.0; n]);
            let ((mut d, mut s), (mut dp, mut sp)) = (new(), new());
            step_shift(&bins, PER_LEVEL, &tables, &weights, &mut d, &mut s);
            step_lanes::<Portable>(&bins, PER_LEVEL, &tables, &weights, &mut dp, &mut sp);
            prop_assert_eq!((&d, &s), (&dp, &sp));
            for i in 0..n {
                let k = usize::from(bins[i]);
                let e = blended(&windows, cols, i, |w| tables[w * BINS + k].into());
                prop_assert!((f64::from(d[i]) - e).abs() < 1e-3);
                let (low, high) = (k.saturating_sub(1), (k + 1).min(BINS - 1));
                let rise = |w: usize| f64::from(tables[w * BINS + high]) - f64::from(tables[w * BINS + low]);
                let e = 1.0 + blended(&windows, cols, i, rise) / (16.0 * (high - low) as f64);
                prop_assert!((f64::from(s[i]) - e).abs() < 1e-3);
            }
            step_shift(&bins, PER_LEVEL, &tables, &weights, &mut dp, &mut []);
            prop_assert_eq!(&d, &dp);
            linear_shift(&a, PER_LEVEL, &tables, &weights, &mut d, &mut s);
            linear_lanes::<Portable>(&a, PER_LEVEL, &tables, &weights, &mut dp, &mut sp);
            prop_assert_eq!((&d, &s), (&dp, &sp));
            for i in 0..n {
                let p = (f64::from(a[i]) / 16.0 - 0.5).clamp(0.0, (BINS - 1) as f64);
                let (k, t) = (p.floor() as usize, p.fract());
                let at = |w: usize, k: usize| f64::from(tables[w * BINS + k.min(BINS - 1)]);
                let e = blended(&windows, cols, i, |w| at(w, k) + t * (at(w, k + 1) - at(w, k)));
                prop_assert!((f64::from(d[i]) - e).abs() < 1e-2);
            }
            line_shift(&a, 100.0, &lines, &weights, &mut d, &mut s);
            line_lanes::<Portable>(&a, 100.0, &lines, &weights, &mut dp, &mut sp);
            prop_assert_eq!((&d, &s), (&dp, &sp));
            for i in 0..n {
                let v = f64::from(a[i]) - 100.0;
                let e = blended(&windows, cols, i, |w| f64::from(lines[w][0]) + v * f64::from(lines[w][1]));
                prop_assert!((f64::from(d[i]) - e).abs() < 1e-2);
                let e = 1.0 + blended(&windows, cols, i, |w| lines[w][1].into());
                prop_assert!((f64::from(s[i]) - e).abs() < 1e-4);
            }
            let total = shifted_residual(&a, &d, &b, &mut s);
            prop_assert_eq!(total, residual_lanes::<Portable>(&a, &d, &b, &mut sp));
            let e: f64 = (0..n).map(|i| (f64::from(a[i]) + f64::from(d[i]) - f64::from(b[i])).powi(2)).sum();
            prop_assert!((total - e).abs() < 1e-5 * e + 1e-6);
        }
    }

    #[test]
    fn numbers_outside_the_range_land_in_the_outer_bins() {
        let mut bins = [9u8; 5];
        tone_bins(&[-3.0, 0.0, 255.0, 300.0, f32::NAN], 0.25, 63, &mut bins);
        assert_eq!(bins, [0, 0, 63, 63, 0]);
    }
}
