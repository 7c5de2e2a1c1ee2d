//! One-dimensional filters along the rows or columns of a patch, and their adjoints.

use super::{Lanes, WIDTH, dispatch};

/// Direction and sense of a filter pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pass {
    /// Along rows: `out[y][x] = Σ_k taps[r + k] in[y][x + k]`, `k = -r..=r`, zero within `r` of the left and right border.
    Rows,
    /// Along columns, zero within `r` of the upper and lower border.
    Columns,
    /// Transpose of `Rows`.
    RowsAdjoint,
    /// Transpose of `Columns`.
    ColumnsAdjoint,
}

dispatch! {
    /// Filters a patch of `cols` columns with an odd number `2 r + 1` of taps; see [`Pass`]. A patch that is smaller than
    /// the filter gives zeros.
    pub fn filter_pass(x: &[f32], cols: usize, taps: &[f32], pass: Pass, out: &mut [f32]) = filter_lanes;
    /// `out_i = x_i - Σ_k c_k U_ik` with the columns of `u`; returns `Σ out_i²`.
    pub fn subtract_combination(x: &[f32], u: &super::Jacobian, c: &[f32], out: &mut [f32]) -> f64 = combination_lanes;
}

/// Points that are filtered at once.
const CHUNK: usize = 4 * WIDTH;

/// `y += c x` for two stretches of equal length.
#[inline(always)]
fn add_scaled<V: Lanes>(c: V, x: &[f32], y: &mut [f32]) {
    let n = x.len();
    for i in (0..n).step_by(WIDTH) {
        c.mul_add(V::load_at(x, i), V::load_at(y, i))
            .store_at(&mut y[..n], i);
    }
}

#[inline(always)]
fn filter_lanes<V: Lanes>(x: &[f32], cols: usize, taps: &[f32], pass: Pass, out: &mut [f32]) {
    let (rows, r) = (x.len() / cols, taps.len() / 2);
    let out = &mut out[..x.len()];
    let along_rows = matches!(pass, Pass::Rows | Pass::RowsAdjoint);
    let adjoint = matches!(pass, Pass::RowsAdjoint | Pass::ColumnsAdjoint);
    if (if along_rows { cols } else { rows }) < taps.len() {
        return out.fill(0.0);
    }
    let step = if along_rows { 1 } else { cols };
    if !adjoint {
        // One stretch over all rows: what reaches across the left and right border is put out afterwards.
        let n = x.len() - 2 * r * step;
        let (before, rest) = out.split_at_mut(r * step);
        let (inner, after) = rest.split_at_mut(n);
        before.fill(0.0);
        after.fill(0.0);
        let whole = n - n % CHUNK;
        for i in (0..whole).step_by(CHUNK) {
            let mut acc = [V::splat(0.0); CHUNK / WIDTH];
            for (k, &tap) in taps.iter().enumerate() {
                let x = &x[k * step + i..][..CHUNK];
                for (acc, x) in acc.iter_mut().zip(x.chunks_exact(WIDTH)) {
                    *acc = V::splat(tap).mul_add(V::load(x), *acc);
                }
            }
            let to = inner[i..i + CHUNK].chunks_exact_mut(WIDTH);
            for (acc, to) in acc.into_iter().zip(to) {
                acc.store(to);
            }
        }
        for i in (whole..n).step_by(WIDTH) {
            let mut acc = V::splat(0.0);
            for (k, &tap) in taps.iter().enumerate() {
                acc = V::splat(tap).mul_add(V::load_at(&x[k * step..][..n], i), acc);
            }
            acc.store_at(inner, i);
        }
        if along_rows {
            for row in out.chunks_exact_mut(cols) {
                row[..r].fill(0.0);
                row[cols - r..].fill(0.0);
            }
        }
        return;
    }
    // Points whose whole support lies in the patch spread over it.
    out.fill(0.0);
    if along_rows {
        let n = cols - 2 * r;
        for y in 0..rows {
            for (k, &tap) in taps.iter().enumerate() {
                let (from, to) = (y * cols + r, y * cols + k);
                add_scaled(V::splat(tap), &x[from..from + n], &mut out[to..to + n]);
            }
        }
    } else {
        let n = x.len() - 2 * r * cols;
        for (k, &tap) in taps.iter().enumerate() {
            let (from, to) = (r * cols, k * cols);
            add_scaled(V::splat(tap), &x[from..from + n], &mut out[to..to + n]);
        }
    }
}

#[inline(always)]
fn combination_lanes<V: Lanes>(x: &[f32], u: &super::Jacobian, c: &[f32], out: &mut [f32]) -> f64 {
    let n = x.len();
    let out = &mut out[..n];
    out.copy_from_slice(x);
    for (k, &c) in c.iter().enumerate().take(u.cols()) {
        add_scaled(V::splat(-c), u.col(k), out);
    }
    let (mut total, mut start) = (0.0, 0);
    while start < n {
        let end = (start + 32 * WIDTH).min(n);
        let mut acc = V::splat(0.0);
        for i in (start..end).step_by(WIDTH) {
            let v = V::load_at(out, i);
            acc = v.mul_add(v, acc);
        }
        total += acc.sum();
        start = end;
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{Jacobian, Portable, dot};
    use proptest::prelude::*;

    fn value(i: usize, seed: u32) -> f32 {
        let v = (i as u32)
            .wrapping_mul(2654435761)
            .wrapping_add(seed.wrapping_mul(40503))
            >> 8;
        (v % 2001) as f32 / 1000.0 - 1.0
    }

    proptest! {
        #[test]
        fn agree_with_f64_and_adjoints_are_transposes(
            cols in 1usize..30, rows in 1usize..20, r in 0usize..5, seed in 0u32..1000,
        ) {
            let n = cols * rows;
            let x: Vec<f32> = (0..n).map(|i| value(i, seed)).collect();
            let z: Vec<f32> = (0..n).map(|i| value(i, seed + 1)).collect();
            let taps: Vec<f32> = (0..2 * r + 1).map(|i| value(i, seed + 2)).collect();
            let (mut out, mut portable, mut back) = (vec![9.0; n], vec![9.0; n], vec![9.0; n]);
            for (pass, adjoint, step, length) in [
                (Pass::Rows, Pass::RowsAdjoint, 1, cols), (Pass::Columns, Pass::ColumnsAdjoint, cols, rows),
            ] {
                let along_rows = pass == Pass::Rows;
                filter_pass(&x, cols, &taps, pass, &mut out);
                filter_lanes::<Portable>(&x, cols, &taps, pass, &mut portable);
                prop_assert_eq!(&out, &portable);
                for i in 0..n {
                    let at = if along_rows { i % cols } else { i / cols };
                    let inside = at >= r && at + r < length;
                    let exact: f64 = if inside {
                        (0..2 * r + 1).map(|k| f64::from(taps[k]) * f64::from(x[i + k * step - r * step])).sum()
                    } else {
                        0.0
                    };
                    prop_assert!((f64::from(out[i]) - exact).abs() < 1e-5);
                }
                filter_pass(&z, cols, &taps, adjoint, &mut back);
                filter_lanes::<Portable>(&z, cols, &taps, adjoint, &mut portable);
                prop_assert_eq!(&back, &portable);
                prop_assert!((dot(&out, &z) - dot(&x, &back)).abs() < 1e-4 * n as f64);
            }
            let mut u = Jacobian::new(n, 3);
            for k in 0..3 {
                u.col_mut(k).iter_mut().enumerate().for_each(|(i, v)| *v = value(i, seed + 10 + k as u32));
            }
            let c = [0.3, -1.2, 2.0];
            let total = subtract_combination(&x, &u, &c, &mut out);
            prop_assert_eq!(total, combination_lanes::<Portable>(&x, &u, &c, &mut portable));
            prop_assert_eq!(&out, &portable);
            for i in 0..n {
                let exact = f64::from(x[i]) - (0..3).map(|k| f64::from(c[k]) * f64::from(u.col(k)[i])).sum::<f64>();
                prop_assert!((f64::from(out[i]) - exact).abs() < 1e-5);
            }
        }
    }
}
