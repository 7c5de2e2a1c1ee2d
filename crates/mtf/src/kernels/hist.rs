//! B-spline Parzen histograms and everything that is accumulated per bin: joint histograms, polynomials of the
//! position within a bin, sums of Jacobian rows.
//!
//! Raw values in `[0, 256)` are spread over `buckets` unit intervals, `v = raw * buckets / 256`; a value in bucket `b`
//! has weights in the `buckets + 3` bins `b .. b + 3` only, and they sum to 1 (partition of unity). Within a bucket every
//! weight, and every product of weights, is a polynomial of `τ = v - b - ½ ∈ [-½, ½]`; so a sum over pixels of any such
//! product is a fixed combination of the bucket's power sums `Σ τ^d`, and no pixel writes to more than its own bucket.

use super::{Jacobian, Lanes, WIDTH, dispatch};

/// Bins that a value has weight in.
pub const SUPPORT: usize = 4;
/// Coefficients of the polynomials of a bucket: degree 7.
pub const TERMS: usize = 8;
/// Coefficients reserved for the polynomial of a pair of buckets.
pub const CELL: usize = 16;

/// Weights in the four bins of the support as polynomials of `τ`, coefficients by rising degree.
pub type Window = [[f64; 5]; SUPPORT];

/// Cubic B-spline `β(k - v)`.
pub const SPLINE: Window = [
    [1.0 / 48.0, -1.0 / 8.0, 1.0 / 4.0, -1.0 / 6.0, 0.0],
    [23.0 / 48.0, -5.0 / 8.0, -1.0 / 4.0, 1.0 / 2.0, 0.0],
    [23.0 / 48.0, 5.0 / 8.0, -1.0 / 4.0, -1.0 / 2.0, 0.0],
    [1.0 / 48.0, 1.0 / 8.0, 1.0 / 4.0, 1.0 / 6.0, 0.0],
];

/// Its integral `Φ(k - v) = ∫_{k-v}^∞ β`, a smooth `[v > k]`; 1 in the bins below the support.
pub const CUMULATIVE: Window = [
    [383.0 / 384.0, 1.0 / 48.0, -1.0 / 16.0, 1.0 / 12.0, -1.0 / 24.0],
    [307.0 / 384.0, 23.0 / 48.0, -5.0 / 16.0, -1.0 / 12.0, 1.0 / 8.0],
    [77.0 / 384.0, 23.0 / 48.0, 5.0 / 16.0, -1.0 / 12.0, -1.0 / 8.0],
    [1.0 / 384.0, 1.0 / 48.0, 1.0 / 16.0, 1.0 / 12.0, 1.0 / 24.0],
];

/// Derivative of a window with respect to `v`.
pub fn derivative(window: &Window) -> Window {
    window.map(|p| std::array::from_fn(|d| if d < 4 { (d + 1) as f64 * p[d + 1] } else { 0.0 }))
}

/// Window in single precision.
pub fn narrow(window: &Window) -> [[f32; 5]; SUPPORT] {
    window.map(|p| p.map(|c| c as f32))
}

/// Product of two polynomials of at most seventh degree in all.
pub fn product(a: &[f64; 5], b: &[f64; 5]) -> [f64; TERMS] {
    let mut out = [0.0; TERMS];
    for (i, a) in a.iter().enumerate() {
        for (k, b) in b.iter().enumerate().filter(|(k, _)| i + k < TERMS) {
            out[i + k] += a * b;
        }
    }
    out
}

/// Tables that sums go to in turn: neighbouring pixels mostly share a bucket, and need not wait for one another.
pub const TABLES: usize = 4;

/// [`joint_histogram`] sums up products of weights only.
pub const NEITHER: usize = 0;
/// [`joint_histogram`] also sums up the weights of the left patch alone.
pub const LEFT: usize = 1;
/// [`joint_histogram`] also sums up the weights of the right patch alone.
pub const RIGHT: usize = 2;

/// Numbers per cell of [`joint_histogram`]: 16 products, and the four weights of one patch twice.
pub const fn cell_sums(alone: usize) -> usize {
    if alone == NEITHER { 2 * WIDTH } else { 3 * WIDTH }
}

/// Columns of a Jacobian, padded for whole lanes: the length of a row in the sums below.
pub fn padded(cols: usize) -> usize {
    cols.next_multiple_of(WIDTH)
}

dispatch! {
    /// Bucket and `τ` of each raw value. Values outside `[0, 256)` count as the nearest inside; a NaN keeps a bucket, and
    /// its `τ` is NaN.
    pub fn bin(x: &[f32], buckets: usize, bucket: &mut [u32], tau: &mut [f32]) = bin_lanes;
    /// `rows[4 i + a] = window_a(τ_i)`.
    pub fn window_rows(window: &[[f32; 5]; SUPPORT], tau: &[f32], rows: &mut [f32]) = window_lanes;
    /// Sums of `left_a(τ_i) right_i[d]` (4 x 4 numbers) for each pair of buckets `cell = left bucket * buckets + right
    /// bucket`, then (twice) those of `right_i[d]` or `left_a(τ_i)` if `ALONE` is [`RIGHT`] or [`LEFT`]: [`cell_sums`] numbers
    /// per cell in the first of the [`TABLES`] tables of `sums`; the rest is scratch. Also writes each value's cell.
    pub fn joint_histogram<const ALONE: usize>(
        left: &[[f32; 5]; SUPPORT], bucket: &[u32], tau: &[f32], right_bucket: &[u32], right_rows: &[f32],
        buckets: usize, cell: &mut [u32], sums: &mut [f32],
    ) = joint_lanes;
    /// Power sums of each bucket, `sums[8 b + d] = Σ_{i in b} τ_i^d`, in the first of the [`TABLES`] tables of `sums`; the
    /// rest is scratch.
    pub fn power_moments(bucket: &[u32], tau: &[f32], sums: &mut [f32]) = moments_lanes;
    /// Power sums of Jacobian rows, `sums[(R b + d) * padded + s] = Σ_{i in b} τ_i^d J_is`, in the first of the [`TABLES`] tables
    /// of `sums`; the rest is scratch.
    pub fn power_sums<const R: usize>(bucket: &[u32], tau: &[f32], j: &Jacobian, sums: &mut [f32]) = power_lanes;
    /// Sums of Jacobian rows over pairs of bins: `sums[((row_i + a) bins + col_i + d) * padded + s] += left_i[a] right_i[d] J_is`
    /// for `a < L`, `d < 4`.
    pub fn outer_sums<const L: usize>(
        row: &[u32], left: &[f32], col: &[u32], right: &[f32], bins: usize, j: &Jacobian, sums: &mut [f32],
    ) = outer_lanes;
    /// `out_i = Σ_d table[8 bucket_i + d] τ_i^d`.
    pub fn bucket_polynomials(bucket: &[u32], tau: &[f32], table: &[f32], out: &mut [f32]) = bucket_polynomial_lanes;
    /// `out_i = Σ_{p < P, q < Q} table[16 cell_i + Q p + q] t_i^p u_i^q`.
    pub fn cell_polynomials<const P: usize, const Q: usize>(
        cell: &[u32], t: &[f32], u: &[f32], table: &[f32], out: &mut [f32],
    ) = cell_polynomial_lanes;
}

/// Value of a polynomial with coefficients by rising degree.
#[inline(always)]
fn horner<V: Lanes, const N: usize>(c: &[V; N], t: V) -> V {
    let mut v = c[N - 1];
    for k in (0..N - 1).rev() {
        v = v.mul_add(t, c[k]);
    }
    v
}

/// A window for eight values at once.
#[inline(always)]
fn windows<V: Lanes>(window: &[[f32; 5]; SUPPORT]) -> [[V; 5]; SUPPORT] {
    let [a, b, c, d] = *window;
    [
        V::splat_each(a),
        V::splat_each(b),
        V::splat_each(c),
        V::splat_each(d),
    ]
}

/// The four weights of each of eight values, twice over.
#[inline(always)]
fn twice<V: Lanes>(w: &[[V; 5]; SUPPORT], t: V) -> [V; WIDTH] {
    let (a, b, c, d) = (
        horner(&w[0], t),
        horner(&w[1], t),
        horner(&w[2], t),
        horner(&w[3], t),
    );
    V::transpose([a, b, c, d, a, b, c, d])
}

#[inline(always)]
fn bin_lanes<V: Lanes>(x: &[f32], buckets: usize, bucket: &mut [u32], tau: &mut [f32]) {
    let n = x.len();
    let (bucket, tau) = (&mut bucket[..n], &mut tau[..n]);
    let scale = V::splat(buckets as f32 / 256.0);
    let last = V::splat((buckets - 1) as f32);
    let (zero, half) = (V::splat(0.0), V::splat(0.5));
    let mut i = 0;
    while i < n {
        let raw = V::load_at(x, i);
        // The order of the operands turns a NaN into bucket 0 but leaves it in `τ`.
        let b = raw.mul(scale).floor().max(zero).min(last);
        let t = raw.mul_add(scale, zero.sub(b)).sub(half);
        let t = zero.sub(half).max(half.min(t));
        let count = WIDTH.min(n - i);
        bucket[i..i + count].copy_from_slice(&b.to_indices()[..count]);
        t.store_at(tau, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn window_lanes<V: Lanes>(window: &[[f32; 5]; SUPPORT], tau: &[f32], rows: &mut [f32]) {
    let n = tau.len();
    let w = windows::<V>(window);
    let mut i = 0;
    while i < n {
        let t = V::load_at(tau, i);
        let pixels = twice(&w, t);
        for (row, pixel) in rows[4 * i..4 * n].chunks_exact_mut(4).zip(pixels) {
            pixel.store_partial(row);
        }
        i += WIDTH;
    }
}

#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn joint_lanes<V: Lanes, const ALONE: usize>(
    left: &[[f32; 5]; SUPPORT],
    bucket: &[u32],
    tau: &[f32],
    right_bucket: &[u32],
    right_rows: &[f32],
    buckets: usize,
    cell: &mut [u32],
    sums: &mut [f32],
) {
    let n = tau.len();
    let (bucket, right_bucket, cell) = (&bucket[..n], &right_bucket[..n], &mut cell[..n]);
    let stride = cell_sums(ALONE);
    let size = buckets * buckets * stride;
    let sums = &mut sums[..TABLES * size];
    sums.fill(0.0);
    let w = windows::<V>(left);
    let mut i = 0;
    while i < n {
        let pixels = twice(&w, V::load_at(tau, i));
        let count = WIDTH.min(n - i);
        let at = i..i + count;
        let (bucket, right_bucket) = (&bucket[at.clone()], &right_bucket[at.clone()]);
        let (rows, cell) = (&right_rows[4 * i..4 * (i + count)], &mut cell[at]);
        // Unrolled where there are eight, so that their weights stay in registers.
        if count == WIDTH {
            add_pixels::<V, ALONE>(WIDTH, pixels, [bucket, right_bucket], rows, buckets, cell, sums);
        } else {
            add_pixels::<V, ALONE>(count, pixels, [bucket, right_bucket], rows, buckets, cell, sums);
        }
        i += WIDTH;
    }
    fold_tables::<V>(sums);
}

/// Adds `count` pixels with the weights `pixels` to the tables in turn.
#[inline(always)]
fn add_pixels<V: Lanes, const ALONE: usize>(
    count: usize,
    pixels: [V; WIDTH],
    [left, right]: [&[u32]; 2],
    right_rows: &[f32],
    buckets: usize,
    cell: &mut [u32],
    sums: &mut [f32],
) {
    let (left, right, cell) = (&left[..count], &right[..count], &mut cell[..count]);
    let right_rows = &right_rows[..4 * count];
    let stride = cell_sums(ALONE);
    let size = buckets * buckets * stride;
    for p in 0..count {
        let at = left[p] as usize * buckets + right[p] as usize;
        cell[p] = at as u32;
        let sums = &mut sums[(p % TABLES) * size + at * stride..][..stride];
        let b = V::load_twice(&right_rows[4 * p..4 * p + 4]);
        let [low, high] = pixels[p].spread();
        low.mul_add(b, V::load(&sums[..8])).store(&mut sums[..8]);
        high.mul_add(b, V::load(&sums[8..16])).store(&mut sums[8..16]);
        if ALONE != NEITHER {
            let alone = if ALONE == LEFT { pixels[p] } else { b };
            alone.add(V::load(&sums[16..24])).store(&mut sums[16..24]);
        }
    }
}

/// The sum of all tables, in the first.
#[inline(always)]
fn fold_tables<V: Lanes>(sums: &mut [f32]) {
    let (first, others) = sums.split_at_mut(sums.len() / TABLES);
    if !first.is_empty() {
        // A loop: the compiler may leave closures without the instruction set.
        for other in others.chunks_exact(first.len()) {
            fold::<V>(first, other);
        }
    }
}

/// `a += b`.
#[inline(always)]
fn fold<V: Lanes>(a: &mut [f32], b: &[f32]) {
    let mut i = 0;
    while i < a.len() {
        V::load_at(a, i).add(V::load_at(b, i)).store_at(a, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn moments_lanes<V: Lanes>(bucket: &[u32], tau: &[f32], sums: &mut [f32]) {
    let n = tau.len();
    let bucket = &bucket[..n];
    let size = sums.len() / TABLES;
    sums.fill(0.0);
    let mut i = 0;
    while i < n {
        let t = V::load_at(tau, i);
        let mut powers = [V::splat(1.0); TERMS];
        for d in 1..TERMS {
            powers[d] = powers[d - 1].mul(t);
        }
        let pixels = V::transpose(powers);
        for p in 0..WIDTH.min(n - i) {
            let at = (p % TABLES) * size + bucket[i + p] as usize * TERMS;
            let sums = &mut sums[at..at + TERMS];
            V::load(sums).add(pixels[p]).store(sums);
        }
        i += WIDTH;
    }
    fold_tables::<V>(sums);
}

/// Rows `i .. i + 8` of the columns `first .. first + 8` of `j`; zero beyond its edges.
#[inline(always)]
fn rows<V: Lanes>(j: &Jacobian, first: usize, i: usize) -> [V; WIDTH] {
    let count = WIDTH.min(j.cols() - first);
    let mut rows = [V::splat(0.0); WIDTH];
    for (k, row) in rows.iter_mut().enumerate().take(count) {
        *row = V::load_at(j.col(first + k), i);
    }
    V::transpose(rows)
}

#[inline(always)]
fn power_lanes<V: Lanes, const R: usize>(bucket: &[u32], tau: &[f32], j: &Jacobian, sums: &mut [f32]) {
    let n = j.rows();
    let (bucket, tau) = (&bucket[..n], &tau[..n]);
    let width = padded(j.cols());
    let size = sums.len() / TABLES;
    sums.fill(0.0);
    for first in (0..j.cols()).step_by(WIDTH) {
        let mut i = 0;
        while i < n {
            let pixels = rows::<V>(j, first, i);
            for p in 0..WIDTH.min(n - i) {
                let at = (p % TABLES) * size + bucket[i + p] as usize * R * width + first;
                let sums = &mut sums[at..at + (R - 1) * width + WIDTH];
                let t = V::splat(tau[i + p]);
                let mut v = pixels[p];
                for d in 0..R {
                    let to = &mut sums[d * width..d * width + WIDTH];
                    V::load(to).add(v).store(to);
                    v = v.mul(t);
                }
            }
            i += WIDTH;
        }
    }
    fold_tables::<V>(sums);
}

#[inline(always)]
fn outer_lanes<V: Lanes, const L: usize>(
    row: &[u32],
    left: &[f32],
    col: &[u32],
    right: &[f32],
    bins: usize,
    j: &Jacobian,
    sums: &mut [f32],
) {
    let n = j.rows();
    let (row, col, left, right) = (&row[..n], &col[..n], &left[..L * n], &right[..SUPPORT * n]);
    let width = padded(j.cols());
    sums.fill(0.0);
    for first in (0..j.cols()).step_by(WIDTH) {
        let mut i = 0;
        while i < n {
            let pixels = rows::<V>(j, first, i);
            for p in 0..WIDTH.min(n - i) {
                let (r, c) = (row[i + p] as usize, col[i + p] as usize);
                for a in 0..L {
                    let v = pixels[p].mul(V::splat(left[L * (i + p) + a]));
                    for d in 0..SUPPORT {
                        let at = ((r + a) * bins + c + d) * width + first;
                        let to = &mut sums[at..at + WIDTH];
                        v.mul_add(V::splat(right[SUPPORT * (i + p) + d]), V::load(to))
                            .store(to);
                    }
                }
            }
            i += WIDTH;
        }
    }
}

/// Coefficients of eight pixels: element `k` of the result holds `table[start_p + k]` in lane `p`.
#[inline(always)]
fn look_up<V: Lanes>(table: &[f32], start: [usize; WIDTH]) -> [V; WIDTH] {
    let mut rows = [V::splat(0.0); WIDTH];
    for (row, k) in rows.iter_mut().zip(start) {
        *row = V::load(&table[k..k + WIDTH]);
    }
    V::transpose(rows)
}

/// Elements `i .. i + 8` of `index` times `stride`; the last one repeated beyond the end.
#[inline(always)]
fn starts(index: &[u32], i: usize, stride: usize) -> [usize; WIDTH] {
    if i + WIDTH <= index.len() {
        let index = &index[i..i + WIDTH];
        std::array::from_fn(|p| index[p] as usize * stride)
    } else {
        std::array::from_fn(|p| index[(i + p).min(index.len() - 1)] as usize * stride)
    }
}

#[inline(always)]
fn bucket_polynomial_lanes<V: Lanes>(bucket: &[u32], tau: &[f32], table: &[f32], out: &mut [f32]) {
    let n = tau.len();
    let (bucket, out) = (&bucket[..n], &mut out[..n]);
    let mut i = 0;
    while i < n {
        let c = look_up::<V>(table, starts(bucket, i, TERMS));
        horner(&c, V::load_at(tau, i)).store_at(out, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn cell_polynomial_lanes<V: Lanes, const P: usize, const Q: usize>(
    cell: &[u32],
    t: &[f32],
    u: &[f32],
    table: &[f32],
    out: &mut [f32],
) {
    let n = t.len();
    let (cell, u, out) = (&cell[..n], &u[..n], &mut out[..n]);
    let mut i = 0;
    while i < n {
        let start = starts(cell, i, CELL);
        let (low, high) = (
            look_up::<V>(table, start),
            look_up::<V>(table, start.map(|k| k + WIDTH)),
        );
        let (tv, uv) = (V::load_at(t, i), V::load_at(u, i));
        let mut v = V::splat(0.0);
        for p in (0..P).rev() {
            let mut row = V::splat(0.0);
            for q in (0..Q).rev() {
                let k = p * Q + q;
                let c = if k < WIDTH { low[k] } else { high[k - WIDTH] };
                row = row.mul_add(uv, c);
            }
            v = v.mul_add(tv, row);
        }
        v.store_at(out, i);
        i += WIDTH;
    }
}

/// Cubic B-spline at any distance, from its definition.
pub fn spline_reference(x: f64) -> f64 {
    let a = x.abs();
    if a < 1.0 {
        2.0 / 3.0 - a * a + a * a * a / 2.0
    } else if a < 2.0 {
        (2.0 - a).powi(3) / 6.0
    } else {
        0.0
    }
}

/// Its integral from `x` to infinity, from its definition.
pub fn cumulative_reference(x: f64) -> f64 {
    let middle = 0.5 - 2.0 * x / 3.0 + x.powi(3) / 3.0;
    if x <= -2.0 {
        1.0
    } else if x <= -1.0 {
        1.0 - (2.0 + x).powi(4) / 24.0
    } else if x <= 0.0 {
        middle + x.powi(4) / 8.0
    } else if x <= 1.0 {
        middle - x.powi(4) / 8.0
    } else if x < 2.0 {
        (2.0 - x).powi(4) / 24.0
    } else {
        0.0
    }
}

/// Bucket and position `v` of a raw value, in `f64`.
pub fn bin_reference(raw: f64, buckets: usize) -> (usize, f64) {
    let v = (raw * buckets as f64 / 256.0).clamp(0.0, buckets as f64);
    ((v.max(0.0) as usize).min(buckets - 1), v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    fn polynomial(c: &[f64], t: f64) -> f64 {
        c.iter().rev().fold(0.0, |v, c| v * t + c)
    }

    #[test]
    fn windows_are_the_spline_and_its_integral() {
        for step in 0..=40 {
            let tau = f64::from(step) / 40.0 - 0.5;
            for a in 0..SUPPORT {
                // Bin `b + a - 1` counted from the bucket's lower edge.
                let x = a as f64 - 1.0 - (tau + 0.5);
                assert!((polynomial(&SPLINE[a], tau) - spline_reference(x)).abs() < 1e-14);
                assert!((polynomial(&CUMULATIVE[a], tau) - cumulative_reference(x)).abs() < 1e-14);
                assert!((polynomial(&derivative(&CUMULATIVE)[a], tau) - spline_reference(x)).abs() < 1e-14);
                let p = product(&CUMULATIVE[a], &SPLINE[3 - a]);
                let exact = polynomial(&CUMULATIVE[a], tau) * polynomial(&SPLINE[3 - a], tau);
                assert!((polynomial(&p, tau) - exact).abs() < 1e-14);
            }
            let unity: f64 = SPLINE.iter().map(|p| polynomial(p, tau)).sum();
            assert!((unity - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn values_out_of_range_are_held_and_nan_stays() {
        let x = [
            -3.0,
            0.0,
            255.0,
            255.999,
            256.0,
            900.0,
            f32::NAN,
            f32::INFINITY,
            36.5,
        ];
        let (mut bucket, mut tau) = ([0; 9], [0.0; 9]);
        bin(&x, 7, &mut bucket, &mut tau);
        assert_eq!(bucket, [0, 0, 6, 6, 6, 6, 0, 6, 0]);
        assert_eq!((tau[0], tau[1], tau[5], tau[7]), (-0.5, -0.5, 0.5, 0.5));
        assert!(tau[6].is_nan() && (tau[8] - (36.5 * 7.0 / 256.0 - 0.5)).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn accumulators_agree_with_f64_and_between_instruction_sets(
            v in prop::collection::vec((0f32..256.0, 0f32..256.0), 1..200),
            buckets in 1usize..9, s in 1usize..11, seed in 0u32..1000,
        ) {
            let n = v.len();
            let (x, y): (Vec<f32>, Vec<f32>) = v.into_iter().unzip();
            let binned = |x: &[f32]| {
                let (mut b, mut t) = (vec![0; n], vec![0.0; n]);
                bin(x, buckets, &mut b, &mut t);
                let (mut bp, mut tp) = (vec![0; n], vec![0.0; n]);
                bin_lanes::<Portable>(x, buckets, &mut bp, &mut tp);
                assert_eq!((&b, &t), (&bp, &tp));
                (b, t)
            };
            let ((bx, tx), (by, ty)) = (binned(&x), binned(&y));
            for i in 0..n {
                let (b, v) = bin_reference(x[i].into(), buckets);
                prop_assert!(bx[i] as usize == b && (f64::from(tx[i]) + 0.5 + b as f64 - v).abs() < 1e-6);
            }
            let mut rows = vec![0.0; 4 * n];
            window_rows(&narrow(&SPLINE), &ty, &mut rows);
            let (left, w) = (narrow(&CUMULATIVE), |p: &Window, a: usize, t: f32| polynomial(&p[a], t.into()));
            for i in 0..n {
                for a in 0..SUPPORT {
                    prop_assert!((f64::from(rows[4 * i + a]) - w(&SPLINE, a, ty[i])).abs() < 1e-6);
                }
            }
            let mut cell = vec![0; n];
            let mut sums = vec![0.0; TABLES * cell_sums(RIGHT) * buckets * buckets];
            joint_histogram::<RIGHT>(&left, &bx, &tx, &by, &rows, buckets, &mut cell, &mut sums);
            let mut portable = vec![0.0; sums.len()];
            joint_lanes::<Portable, RIGHT>(&left, &bx, &tx, &by, &rows, buckets, &mut cell, &mut portable);
            prop_assert_eq!(&sums, &portable);
            let mut other = vec![0.0; sums.len()];
            joint_histogram::<LEFT>(&left, &bx, &tx, &by, &rows, buckets, &mut cell, &mut other);
            let mut exact = vec![0.0; 24 * buckets * buckets];
            let mut alone = vec![0.0; 24 * buckets * buckets];
            for i in 0..n {
                let at = 24 * (bx[i] as usize * buckets + by[i] as usize);
                for d in 0..SUPPORT {
                    for a in 0..SUPPORT {
                        exact[at + 4 * a + d] += w(&CUMULATIVE, a, tx[i]) * w(&SPLINE, d, ty[i]);
                    }
                    exact[at + 16 + d] += w(&SPLINE, d, ty[i]);
                    exact[at + 20 + d] += w(&SPLINE, d, ty[i]);
                    alone[at + 16 + d] += w(&CUMULATIVE, d, tx[i]);
                }
            }
            for (a, b) in sums.iter().zip(&exact) {
                prop_assert!((f64::from(*a) - b).abs() < 1e-5 * (1.0 + b));
            }

            for (k, b) in alone.iter().enumerate() {
                match k % 24 {
                    16..20 => prop_assert!((f64::from(other[k]) - b).abs() < 1e-5 * (1.0 + b)),
                    20..24 => prop_assert_eq!(other[k], other[k - 4]),
                    _ => prop_assert_eq!(other[k], sums[k]),
                }
            }

            let mut moments = vec![0.0; TABLES * TERMS * buckets];
            power_moments(&bx, &tx, &mut moments);
            let value = |i: usize, k: usize| {
                let v = (i as u32).wrapping_mul(2654435761).wrapping_add((k as u32 + seed).wrapping_mul(40503)) >> 8;
                (v % 2001) as f32 / 1000.0 - 1.0
            };
            let mut j = Jacobian::new(n, s);
            for k in 0..s {
                j.col_mut(k).iter_mut().enumerate().for_each(|(i, v)| *v = value(i, k));
            }
            let width = padded(s);
            let mut power = vec![0.0; TABLES * 7 * width * buckets];
            power_sums::<7>(&bx, &tx, &j, &mut power);
            let mut portable = vec![0.0; power.len()];
            power_lanes::<Portable, 7>(&bx, &tx, &j, &mut portable);
            prop_assert_eq!(&power, &portable);
            let bins = buckets + 3;
            let mut outer = vec![0.0; bins * bins * width];
            outer_sums::<4>(&bx, &rows, &by, &rows, bins, &j, &mut outer);
            let mut exact = vec![0.0; outer.len()];
            for i in 0..n {
                for (a, d) in (0..4).flat_map(|a| (0..4).map(move |d| (a, d))) {
                    let to = &mut exact[((bx[i] as usize + a) * bins + by[i] as usize + d) * width..];
                    for k in 0..s {
                        to[k] += f64::from(rows[4 * i + a]) * f64::from(rows[4 * i + d]) * f64::from(value(i, k));
                    }
                }
            }
            for (a, b) in outer.iter().zip(&exact) {
                prop_assert!((f64::from(*a) - b).abs() < 1e-4);
            }
            for b in 0..buckets {
                for d in 0..7 {
                    let here = || (0..n).filter(|&i| bx[i] as usize == b).map(|i| (i, f64::from(tx[i]).powi(d as i32)));
                    prop_assert!((f64::from(moments[TERMS * b + d]) - here().map(|h| h.1).sum::<f64>()).abs() < 1e-4);
                    for k in 0..s {
                        let exact: f64 = here().map(|(i, t)| t * f64::from(value(i, k))).sum();
                        prop_assert!((f64::from(power[(7 * b + d) * width + k]) - exact).abs() < 1e-4);
                    }
                }
            }

            let table: Vec<f32> = (0..CELL * buckets * buckets).map(|k| value(k, 50)).collect();
            let (mut out, mut portable) = (vec![0.0; n], vec![0.0; n]);
            cell_polynomials::<5, 3>(&cell, &tx, &ty, &table, &mut out);
            cell_polynomial_lanes::<Portable, 5, 3>(&cell, &tx, &ty, &table, &mut portable);
            prop_assert_eq!(&out, &portable);
            for i in 0..n {
                let c = &table[CELL * cell[i] as usize..];
                let exact: f64 = (0..15)
                    .map(|k| f64::from(c[k]) * f64::from(tx[i]).powi(k as i32 / 3) * f64::from(ty[i]).powi(k as i32 % 3))
                    .sum();
                prop_assert!((f64::from(out[i]) - exact).abs() < 1e-5);
            }
            bucket_polynomials(&bx, &tx, &table, &mut out);
            for i in 0..n {
                let c = &table[TERMS * bx[i] as usize..];
                let exact: f64 = (0..TERMS).map(|k| f64::from(c[k]) * f64::from(tx[i]).powi(k as i32)).sum();
                prop_assert!((f64::from(out[i]) - exact).abs() < 1e-5);
            }
        }
    }
}
