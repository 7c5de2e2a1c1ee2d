//! Weighted Gram matrices `J' diag(w) J`.

use super::{Jacobian, Lanes, WIDTH, dispatch};
use crate::geom::solve::SymMatrix;

dispatch! {
    /// `h = Σ_i w_i J_i J_i'`; weights may have any sign.
    pub fn weighted_gram(j: &Jacobian, w: &[f32], h: &mut SymMatrix) = weighted_lanes;
}

/// Side of the register tile.
const TILE: usize = 3;
/// Tiles whose accumulators are kept across blocks.
const BATCH: usize = 12;
/// Rows per block, so that the columns stay in the first-level cache.
const BLOCK: usize = 256;

#[inline(always)]
fn weighted_lanes<V: Lanes>(j: &Jacobian, w: &[f32], h: &mut SymMatrix) {
    let (n, s) = (j.rows(), j.cols());
    let w = &w[..n];
    let side = s.div_ceil(TILE);
    let tiles = || (0..side).flat_map(move |a| (a..side).map(move |b| (a, b)));
    let count = tiles().count();
    let mut done = 0;
    while done < count {
        let mut acc = [[[V::splat(0.0); TILE]; TILE]; BATCH];
        let mut start = 0;
        while start < n {
            let end = (start + BLOCK).min(n);
            for ((a, b), acc) in tiles().skip(done).zip(acc.iter_mut()) {
                let columns = |t: usize| -> [&[f32]; TILE] {
                    std::array::from_fn(|k| &j.col((TILE * t + k).min(s - 1))[start..end])
                };
                *acc = tile(&w[start..end], columns(a), columns(b), *acc);
            }
            start = end;
        }
        for ((a, b), acc) in tiles().skip(done).zip(&acc) {
            for (p, row) in acc.iter().enumerate() {
                for (q, v) in row.iter().enumerate() {
                    let (r, c) = (TILE * a + p, TILE * b + q);
                    if r <= c && c < s {
                        h.set(r, c, v.sum());
                    }
                }
            }
        }
        done += BATCH;
    }
}

#[inline(always)]
fn tile<V: Lanes>(
    w: &[f32],
    rows: [&[f32]; TILE],
    cols: [&[f32]; TILE],
    mut acc: [[V; TILE]; TILE],
) -> [[V; TILE]; TILE] {
    let n = w.len();
    let (rows, cols) = (rows.map(|r| &r[..n]), cols.map(|c| &c[..n]));
    let mut i = 0;
    while i < n {
        let k = V::load_at(w, i);
        let a = rows.map(|r| V::load_at(r, i).mul(k));
        let b = cols.map(|c| V::load_at(c, i));
        for p in 0..TILE {
            for q in 0..TILE {
                acc[p][q] = a[p].mul_add(b[q], acc[p][q]);
            }
        }
        i += WIDTH;
    }
    acc
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_f64_and_between_instruction_sets(n in 1usize..600, s in 1usize..12, seed in 0u32..1000) {
            let value = |i: usize, k: usize| {
                let v = (i as u32).wrapping_mul(2654435761).wrapping_add((k as u32 + seed).wrapping_mul(40503)) >> 8;
                (v % 2001) as f32 / 1000.0 - 1.0
            };
            let mut j = Jacobian::new(n, s);
            for k in 0..s {
                j.col_mut(k).iter_mut().enumerate().for_each(|(i, v)| *v = value(i, k));
            }
            let w: Vec<f32> = (0..n).map(|i| value(i, 77)).collect();
            let (mut h, mut portable) = (SymMatrix::new(s), SymMatrix::new(s));
            weighted_gram(&j, &w, &mut h);
            weighted_lanes::<Portable>(&j, &w, &mut portable);
            prop_assert_eq!(&h, &portable);
            for a in 0..s {
                for b in 0..s {
                    let exact: f64 = (0..n)
                        .map(|i| f64::from(w[i]) * f64::from(j.col(a)[i]) * f64::from(j.col(b)[i]))
                        .sum();
                    prop_assert!((h.get(a, b) - exact).abs() < 1e-6 * n as f64);
                }
            }
        }
    }
}
