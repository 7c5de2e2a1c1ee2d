//! Normal equations: `J'J` and `J'r` over struct-of-arrays Jacobians.

use super::{Jacobian, Lanes, WIDTH, dispatch};
use crate::geom::solve::SymMatrix;
use crate::interrupt;
use std::ops::Range;

dispatch! {
    /// `out_k = Σ_i r_i J_ik` for each of the S columns.
    pub fn project(j: &Jacobian, r: &[f32], out: &mut [f64]) = project_lanes;
    /// `h = J'J` and `out[m * S + k] = Σ_i rhs[m]_i J_ik`, all in one sweep over blocks that stay in the first-level cache.
    /// Interrupted, the rest of a large system is left as it was.
    pub fn normal_equations(j: &Jacobian, rhs: &[&[f32]], h: &mut SymMatrix, out: &mut [f64]) = normal_lanes;
    /// `h = J' diag(w) J` with weights of any sign, and `out[m * S + k] = Σ_i rhs[m]_i J_ik`: the right-hand sides are
    /// not weighted.
    pub fn weighted_normal_equations(
        j: &Jacobian, w: &[f32], rhs: &[&[f32]], h: &mut SymMatrix, out: &mut [f64],
    ) = weighted_lanes;
    /// `h = J'J` over rows `first..last` alone.
    pub fn block_gram(j: &Jacobian, first: usize, last: usize, h: &mut SymMatrix) = block_lanes;
}

/// Columns handled together when projecting.
const GROUP: usize = 8;

#[inline(always)]
fn project_lanes<V: Lanes>(j: &Jacobian, r: &[f32], out: &mut [f64]) {
    let n = j.rows;
    let r = &r[..n];
    let mut first = 0;
    while first < j.cols {
        let count = GROUP.min(j.cols - first);
        let cols: [&[f32]; GROUP] = std::array::from_fn(|k| j.col(first + k.min(count - 1)));
        let mut acc = [V::splat(0.0); GROUP];
        let mut i = 0;
        while i + WIDTH <= n {
            let v = V::load(&r[i..i + WIDTH]);
            for k in 0..GROUP {
                acc[k] = V::load(&cols[k][i..i + WIDTH]).mul_add(v, acc[k]);
            }
            i += WIDTH;
        }
        if i < n {
            let v = V::load_partial(&r[i..]);
            for k in 0..GROUP {
                acc[k] = V::load_partial(&cols[k][i..]).mul_add(v, acc[k]);
            }
        }
        for k in 0..count {
            out[first + k] = acc[k].sum();
        }
        first += GROUP;
    }
}

/// Side of the register tile: 9 accumulators and 6 operands fit the 16 vector registers.
const TILE: usize = 3;
/// Tiles whose accumulators are kept across blocks.
const BATCH: usize = 12;
/// Points per block: 12 columns of 256 points are 12 KiB.
const BLOCK: usize = 256;

#[inline(always)]
fn normal_lanes<V: Lanes>(j: &Jacobian, rhs: &[&[f32]], h: &mut SymMatrix, out: &mut [f64]) {
    // As many right-hand sides as the last tile has room for.
    let room = (j.cols.next_multiple_of(TILE) - j.cols).min(rhs.len());
    system::<V, false>(j, 0..j.rows, &[], &rhs[..room], h, out);
    for (rhs, out) in rhs.iter().zip(out.chunks_exact_mut(j.cols)).skip(room) {
        project_lanes::<V>(j, rhs, out);
    }
}

#[inline(always)]
fn block_lanes<V: Lanes>(j: &Jacobian, first: usize, last: usize, h: &mut SymMatrix) {
    system::<V, false>(j, first..last, &[], &[], h, &mut []);
}

#[inline(always)]
fn weighted_lanes<V: Lanes>(j: &Jacobian, w: &[f32], rhs: &[&[f32]], h: &mut SymMatrix, out: &mut [f64]) {
    system::<V, true>(j, 0..j.rows, &w[..j.rows], &[], h, &mut []);
    for (rhs, out) in rhs.iter().zip(out.chunks_exact_mut(j.cols)) {
        project_lanes::<V>(j, rhs, out);
    }
}

#[inline(always)]
fn system<V: Lanes, const WEIGHTED: bool>(
    j: &Jacobian,
    rows: Range<usize>,
    w: &[f32],
    rhs: &[&[f32]],
    h: &mut SymMatrix,
    out: &mut [f64],
) {
    let s = j.cols;
    let total = s + rhs.len();
    let side = total.div_ceil(TILE);
    // Upper triangle of tiles whose rows hold at least one parameter.
    let mut tiles = (0..s.div_ceil(TILE)).flat_map(|a| (a..side).map(move |b| (a, b)));
    loop {
        let mut batch = [(0, 0); BATCH];
        let mut count = 0;
        for (slot, tile) in batch.iter_mut().zip(&mut tiles) {
            *slot = tile;
            count += 1;
        }
        if count == 0 {
            break;
        }
        let batch = &batch[..count];
        let mut acc = [[[V::splat(0.0); TILE]; TILE]; BATCH];
        let mut start = rows.start;
        while start < rows.end {
            let block = start..(start + BLOCK).min(rows.end);
            for (&(a, b), acc) in batch.iter().zip(acc.iter_mut()) {
                let left = columns(j, rhs, TILE * a, &block);
                let w = if WEIGHTED { &w[block.clone()] } else { w };
                *acc = if a == b {
                    diagonal_tile::<V, WEIGHTED>(left, w, *acc)
                } else {
                    tile::<V, WEIGHTED>(left, columns(j, rhs, TILE * b, &block), w, *acc)
                };
            }
            start = block.end;
        }
        for (&(a, b), acc) in batch.iter().zip(&acc) {
            for (p, row) in acc.iter().enumerate() {
                for (q, v) in row.iter().enumerate() {
                    let (r, c) = (TILE * a + p, TILE * b + q);
                    if r < s && r <= c && c < s {
                        h.set(r, c, v.sum());
                    } else if r < s && c >= s && c < total {
                        out[(c - s) * s + r] = v.sum();
                    }
                }
            }
        }
        // Systems of one batch, those of most warps, do not ask.
        if count == BATCH && interrupt::requested() {
            break;
        }
    }
}

/// Rows `block` of the columns `first..first + 3`, parameters before right-hand sides, the last one repeated beyond the end.
#[inline(always)]
fn columns<'a>(j: &'a Jacobian, rhs: &[&'a [f32]], first: usize, block: &Range<usize>) -> [&'a [f32]; TILE] {
    let (s, last) = (j.cols, j.cols + rhs.len() - 1);
    let mut out: [&[f32]; TILE] = [&[]; TILE];
    for (k, out) in out.iter_mut().enumerate() {
        let k = (first + k).min(last);
        *out = if k < s {
            &j.data[k * j.stride..][block.clone()]
        } else {
            &rhs[k - s][block.clone()]
        };
    }
    out
}

#[inline(always)]
fn tile<V: Lanes, const WEIGHTED: bool>(
    [a0, a1, a2]: [&[f32]; TILE],
    [b0, b1, b2]: [&[f32]; TILE],
    w: &[f32],
    mut acc: [[V; TILE]; TILE],
) -> [[V; TILE]; TILE] {
    let n = a0.len();
    let (a1, a2, b0, b1, b2) = (&a1[..n], &a2[..n], &b0[..n], &b1[..n], &b2[..n]);
    let w = if WEIGHTED { &w[..n] } else { w };
    let mut i = 0;
    while i < n {
        let a = [V::load_at(a0, i), V::load_at(a1, i), V::load_at(a2, i)];
        let mut b = [V::load_at(b0, i), V::load_at(b1, i), V::load_at(b2, i)];
        if WEIGHTED {
            let w = V::load_at(w, i);
            for b in &mut b {
                *b = b.mul(w);
            }
        }
        for p in 0..TILE {
            for q in 0..TILE {
                acc[p][q] = a[p].mul_add(b[q], acc[p][q]);
            }
        }
        i += WIDTH;
    }
    acc
}

/// The upper triangle of a tile of columns with themselves.
#[inline(always)]
fn diagonal_tile<V: Lanes, const WEIGHTED: bool>(
    [a0, a1, a2]: [&[f32]; TILE],
    w: &[f32],
    mut acc: [[V; TILE]; TILE],
) -> [[V; TILE]; TILE] {
    let n = a0.len();
    let (a1, a2) = (&a1[..n], &a2[..n]);
    let w = if WEIGHTED { &w[..n] } else { w };
    let mut i = 0;
    while i < n {
        let a = [V::load_at(a0, i), V::load_at(a1, i), V::load_at(a2, i)];
        let mut b = a;
        if WEIGHTED {
            let w = V::load_at(w, i);
            for b in &mut b {
                *b = b.mul(w);
            }
        }
        for p in 0..TILE {
            for q in p..TILE {
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
        fn agree_with_f64_and_between_instruction_sets(
            n in 1usize..700, s in 1usize..20, m in 0usize..4, seed in 0u32..1000,
        ) {
            let value = |i: usize, k: usize| {
                let v = (i as u32).wrapping_mul(2654435761).wrapping_add((k as u32 + seed).wrapping_mul(40503)) >> 8;
                (v % 2001) as f32 / 1000.0 - 1.0
            };
            let mut j = Jacobian::new(n, s);
            for k in 0..s {
                for (i, v) in j.col_mut(k).iter_mut().enumerate() {
                    *v = value(i, k);
                }
            }
            let rhs: Vec<Vec<f32>> = (0..m).map(|k| (0..n).map(|i| value(i, 100 + k)).collect()).collect();
            let rhs: Vec<&[f32]> = rhs.iter().map(|r| &r[..]).collect();
            let (mut h, mut out) = (SymMatrix::new(s), vec![0.0; m * s]);
            normal_equations(&j, &rhs, &mut h, &mut out);
            let exact = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(&x, &y)| f64::from(x) * f64::from(y)).sum::<f64>();
            for a in 0..s {
                for b in 0..s {
                    prop_assert!((h.get(a, b) - exact(j.col(a), j.col(b))).abs() < 1e-6 * n as f64);
                }
                for (k, r) in rhs.iter().enumerate() {
                    prop_assert!((out[k * s + a] - exact(j.col(a), r)).abs() < 1e-6 * n as f64);
                }
            }
            let (mut hp, mut outp) = (SymMatrix::new(s), vec![0.0; m * s]);
            normal_lanes::<Portable>(&j, &rhs, &mut hp, &mut outp);
            prop_assert_eq!((&h, &out), (&hp, &outp));
            let (first, last) = (n / 3, n - n / 4);
            let (mut hb, mut hbp) = (SymMatrix::new(s), SymMatrix::new(s));
            block_gram(&j, first, last, &mut hb);
            for a in 0..s {
                for b in 0..s {
                    let want = exact(&j.col(a)[first..last], &j.col(b)[first..last]);
                    prop_assert!((hb.get(a, b) - want).abs() < 1e-6 * n as f64);
                }
            }
            block_lanes::<Portable>(&j, first, last, &mut hbp);
            prop_assert_eq!(&hb, &hbp);
            let w: Vec<f32> = (0..n).map(|i| value(i, 200)).collect();
            let (mut hw, mut outw) = (SymMatrix::new(s), vec![0.0; m * s]);
            weighted_normal_equations(&j, &w, &rhs, &mut hw, &mut outw);
            prop_assert_eq!(&outw, &out);
            for a in 0..s {
                for b in 0..s {
                    let wb: Vec<f32> = j.col(b).iter().zip(&w).map(|(x, w)| x * w).collect();
                    prop_assert!((hw.get(a, b) - exact(j.col(a), &wb)).abs() < 1e-6 * n as f64);
                }
            }
            weighted_lanes::<Portable>(&j, &w, &rhs, &mut hp, &mut outp);
            prop_assert_eq!((&hw, &outw), (&hp, &outp));
            if let Some(r) = rhs.first() {
                let (mut a, mut b) = (vec![0.0; s], vec![0.0; s]);
                project(&j, r, &mut a);
                project_lanes::<Portable>(&j, r, &mut b);
                prop_assert_eq!(&a, &b);
                for k in 0..s {
                    prop_assert!((a[k] - exact(j.col(k), r)).abs() < 1e-6 * n as f64);
                }
            }
        }
    }
}
