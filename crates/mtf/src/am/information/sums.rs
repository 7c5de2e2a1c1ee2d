//! Polynomials per pixel and sums of Jacobian rows, from the tables of a joint histogram.

use super::joint::products;
use crate::geom::solve::SymMatrix;
use crate::kernels::hist::{self, CELL, SUPPORT, TABLES, TERMS, Window};
use crate::kernels::{self, Jacobian};

/// Scratch of a model.
#[derive(Clone, Debug, Default)]
pub(super) struct Work {
    bins: usize,
    /// Columns of the Jacobian at hand, and padded.
    cols: usize,
    width: usize,
    /// Polynomials of cells or buckets.
    pub table: Vec<f32>,
    half: Vec<f64>,
    /// One number per value.
    pub weights: Vec<f32>,
    /// Power sums of Jacobian rows, and scratch.
    pub sums: Vec<f32>,
    /// `Γ_kl = Σ_i γ_kl[i] J_i` and `Δ_kl`, rows of `width`; `b_l`.
    pub gamma: Vec<f32>,
    pub delta: Vec<f32>,
    pub marginal: Vec<f32>,
    /// Rows and weights whose weighted Gram matrix is a sum of outer products.
    outer: Jacobian,
    outer_weights: Vec<f32>,
    gram: SymMatrix,
    /// Weights of each value in the bins of its support.
    pub left_rows: Vec<f32>,
    pub right_rows: Vec<f32>,
    row: [Vec<f32>; 2],
}

impl Work {
    pub fn resize(&mut self, n: usize, bins: usize) {
        self.bins = bins;
        let buckets = bins - SUPPORT + 1;
        self.table.resize(CELL * buckets * buckets, 0.0);
        self.half.resize(bins * buckets * SUPPORT, 0.0);
        self.weights.resize(n, 0.0);
    }

    /// Room for a Jacobian of `cols` columns; allocates only when that grows.
    pub fn widen(&mut self, cols: usize, powers: usize) {
        let (bins, width) = (self.bins, hist::padded(cols));
        (self.cols, self.width) = (cols, width);
        self.sums
            .resize(TABLES * powers * (bins - SUPPORT + 1) * width, 0.0);
        self.gamma.resize(bins * bins * width, 0.0);
        self.delta.resize(bins * bins * width, 0.0);
        self.marginal.resize(bins * width, 0.0);
        self.row.iter_mut().for_each(|r| r.resize(width, 0.0));
        if self.gram.order() != cols {
            self.gram = SymMatrix::new(cols);
        }
    }

    /// Room for the weights of `n` values in plain Hessians.
    pub fn weigh(&mut self, n: usize) {
        self.left_rows.resize(SUPPORT * n, 0.0);
        self.right_rows.resize(SUPPORT * n, 0.0);
    }

    /// Polynomials `scale Σ_ad left_a(t) right_d(u) value[b + a][c + d]` of all pairs of buckets, `q` coefficients of `u`; with
    /// `tail` also `value` of all bins `k < b` with weight `tail.0`, and `tail.1[c + d]` alone.
    pub fn cell_table(
        &mut self,
        [left, right]: [&Window; 2],
        [p, q]: [usize; 2],
        scale: f64,
        value: impl Fn(usize) -> f64,
        tail: Option<(f64, &dyn Fn(usize) -> f64)>,
    ) {
        let (bins, buckets) = (self.bins, self.bins - SUPPORT + 1);
        // Over the right patch first: `half[k][c][j] = Σ_d value[k][c + d] right_d[j]`.
        for k in 0..bins {
            for c in 0..buckets {
                let to = &mut self.half[(k * buckets + c) * SUPPORT..][..q];
                let v: [f64; SUPPORT] = std::array::from_fn(|d| scale * value(k * bins + c + d));
                for (j, to) in to.iter_mut().enumerate() {
                    *to = (0..SUPPORT).map(|d| v[d] * right[d][j]).sum();
                }
            }
        }
        for c in 0..buckets {
            // Bins below the support of the left patch.
            let mut below = [0.0; SUPPORT];
            if let Some((_, alone)) = tail {
                for (j, below) in below[..q].iter_mut().enumerate() {
                    *below = (0..SUPPORT).map(|d| scale * alone(c + d) * right[d][j]).sum();
                }
            }
            for b in 0..buckets {
                let to = &mut self.table[(b * buckets + c) * CELL..][..p * q];
                let half = |a: usize| &self.half[((b + a) * buckets + c) * SUPPORT..][..q];
                for (i, to) in to.chunks_exact_mut(q).enumerate() {
                    for (j, to) in to.iter_mut().enumerate() {
                        let v: f64 = (0..SUPPORT).map(|a| left[a][i] * half(a)[j]).sum();
                        *to = (v + if i == 0 { below[j] } else { 0.0 }) as f32;
                    }
                }
                if let Some((weight, _)) = tail {
                    (0..q).for_each(|j| below[j] += weight * half(0)[j]);
                }
            }
        }
    }

    /// Polynomials `scale Σ_ad left_a right_d value[b + a][b + d]` of all buckets.
    pub fn bucket_table(&mut self, [left, right]: [&Window; 2], scale: f64, value: &[f64]) {
        let bins = self.bins;
        let pairs = products(left, right);
        for b in 0..bins - SUPPORT + 1 {
            let mut out = [0.0; TERMS];
            for (a, row) in pairs.iter().enumerate() {
                for (d, p) in row.iter().enumerate() {
                    let v = scale * value[(b + a) * bins + b + d];
                    out.iter_mut().zip(p).for_each(|(o, p)| *o += v * p);
                }
            }
            for (to, v) in self.table[TERMS * b..].iter_mut().zip(out) {
                *to = v as f32;
            }
        }
    }

    /// `Γ_kl` of a patch with itself from its power sums: rows of `left_a right_d J` in bins `(b + a, b + d)`.
    pub fn expand_gamma(&mut self, left: &Window, right: &Window, powers: usize) {
        expand(
            &mut self.gamma,
            &self.sums,
            [left, right],
            powers,
            self.bins,
            self.width,
        );
    }

    /// `Δ_kl` likewise and `b_l`, the rows of `right_d J` in bin `b + d`; with `cumulative` each value counts once more in
    /// all rows `k < b`.
    pub fn expand_delta(&mut self, left: &Window, right: &Window, powers: usize, cumulative: bool) {
        expand(
            &mut self.delta,
            &self.sums,
            [left, right],
            powers,
            self.bins,
            self.width,
        );
        let (bins, width) = (self.bins, self.width);
        self.marginal.fill(0.0);
        for k in (0..bins).rev() {
            // `marginal` holds the rows of the values in buckets above `k`.
            if cumulative {
                add(
                    &mut self.delta[k * bins * width..][..bins * width],
                    &self.marginal,
                );
            }
            if k <= bins - SUPPORT {
                for (d, p) in right.iter().enumerate() {
                    let to = &mut self.marginal[(k + d) * width..][..width];
                    let sums = &self.sums[powers * k * width..];
                    for (c, from) in p.iter().zip(sums.chunks_exact(width)) {
                        scaled_add(to, *c as f32, from);
                    }
                }
            }
        }
    }

    /// `b_l` from sums per (bucket, bin) in `gamma`, and with `cumulative` the rows of `delta` below each bucket.
    pub fn add_tail(&mut self, cumulative: bool) {
        let size = self.bins * self.width;
        self.marginal.fill(0.0);
        for k in (0..self.bins).rev() {
            if cumulative {
                add(&mut self.delta[k * size..][..size], &self.marginal);
            }
            add(&mut self.marginal, &self.gamma[k * size..][..size]);
        }
    }

    /// Starts a sum of at most `rows` outer products.
    pub fn start_outer(&mut self, rows: usize) {
        self.outer.resize(rows, self.cols);
        self.outer_weights.clear();
    }

    fn push(&mut self, which: usize, weight: f64) {
        let at = self.outer_weights.len();
        for s in 0..self.cols {
            self.outer.col_mut(s)[at] = self.row[which][s];
        }
        self.outer_weights.push(weight as f32);
    }

    /// Adds `Σ_kl Γ_kl Γ_kl' / c_kl` (or of `Δ`).
    pub fn push_squares(&mut self, of_delta: bool, c: &[f64]) {
        let width = self.width;
        for (kl, &c) in c.iter().enumerate() {
            let from = if of_delta { &self.delta } else { &self.gamma };
            self.row[0].copy_from_slice(&from[kl * width..][..width]);
            self.push(0, 1.0 / c);
        }
    }

    /// Adds `Σ_kl sym(Γ_kl Δ_kl') / c_kl`.
    pub fn push_products(&mut self, c: &[f64]) {
        let width = self.width;
        for (kl, &c) in c.iter().enumerate() {
            let at = kl * width..(kl + 1) * width;
            self.row[0].copy_from_slice(&self.gamma[at.clone()]);
            self.row[1].copy_from_slice(&self.delta[at]);
            self.push_symmetric(1.0 / c);
        }
    }

    /// `weight (a b' + b a')/2` of the two rows at hand: `((a + b)(a + b)' - (a - b)(a - b)')/4`.
    fn push_symmetric(&mut self, weight: f64) {
        for s in 0..self.width {
            let (a, b) = (self.row[0][s], self.row[1][s]);
            (self.row[0][s], self.row[1][s]) = (a + b, a - b);
        }
        self.push(0, 0.25 * weight);
        self.push(1, -0.25 * weight);
    }

    /// Adds `-Σ_k γ_k γ_k' / C_k`, `γ_k = Σ_l Γ_kl`.
    pub fn push_rows(&mut self, row: &[f64]) {
        for (k, &c) in row.iter().enumerate() {
            self.row[0].fill(0.0);
            for from in self.gamma[k * self.bins * self.width..]
                .chunks_exact(self.width)
                .take(self.bins)
            {
                add(&mut self.row[0], from);
            }
            self.push(0, -1.0 / c);
        }
    }

    /// Sum over `k` of `Γ_kl` or `Δ_kl` into the first row at hand, `b_l` into the second.
    fn column(&mut self, of_delta: bool, l: usize) {
        let (bins, width) = (self.bins, self.width);
        self.row[0].fill(0.0);
        let from = if of_delta { &self.delta } else { &self.gamma };
        for k in 0..bins {
            add(&mut self.row[0], &from[(k * bins + l) * width..][..width]);
        }
        self.row[1].copy_from_slice(&self.marginal[l * width..][..width]);
    }

    /// Adds `-Σ_l factor sym(x_l b_l') / q_l`, `x_l` the sum over `k` of `Γ_kl` (or of `Δ_kl`).
    pub fn push_columns(&mut self, of_delta: bool, factor: f64, marginal: &[f64]) {
        for (l, &q) in marginal.iter().enumerate() {
            self.column(of_delta, l);
            self.push_symmetric(-factor / q);
        }
    }

    /// Adds `Σ_l S_l b_l b_l' / q_l²`.
    pub fn push_marginals(&mut self, column: &[f64], marginal: &[f64]) {
        for (l, (&s, &q)) in column.iter().zip(marginal).enumerate() {
            self.row[0].copy_from_slice(&self.marginal[l * self.width..][..self.width]);
            self.push(0, s / (q * q));
        }
    }

    /// `h = sign (Σ_i weights_i J_i J_i' + scale x the sum of outer products)`.
    pub fn finish(&mut self, j: &Jacobian, sign: f64, scale: f64, h: &mut SymMatrix) {
        // Rows that were reserved but not used count for nothing.
        self.outer_weights.resize(self.outer.rows(), 0.0);
        kernels::weighted_normal_equations(&self.outer, &self.outer_weights, &[], &mut self.gram, &mut []);
        kernels::weighted_normal_equations(j, &self.weights, &[], h, &mut []);
        h.blend(sign, sign * scale, &self.gram);
    }

    /// Bytes of storage.
    pub fn memory(&self) -> usize {
        let floats = [
            &self.table,
            &self.weights,
            &self.sums,
            &self.gamma,
            &self.delta,
            &self.left_rows,
            &self.right_rows,
        ];
        4 * floats.iter().map(|v| v.capacity()).sum::<usize>()
            + 8 * self.half.capacity()
            + self.outer.memory()
    }
}

/// `to += from`.
fn add(to: &mut [f32], from: &[f32]) {
    to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
}

/// `to += k from`.
fn scaled_add(to: &mut [f32], k: f32, from: &[f32]) {
    to.iter_mut().zip(from).for_each(|(t, f)| *t += k * f);
}

/// `out[(b + a, b + d)] += Σ_r (left_a right_d)_r sums[b, r]`, rows of `width`.
fn expand(
    out: &mut [f32],
    sums: &[f32],
    [left, right]: [&Window; 2],
    powers: usize,
    bins: usize,
    width: usize,
) {
    let pairs = products(left, right);
    out.fill(0.0);
    for b in 0..bins - SUPPORT + 1 {
        let sums = &sums[powers * b * width..][..powers * width];
        for (a, row) in pairs.iter().enumerate() {
            for (d, p) in row.iter().enumerate() {
                let to = &mut out[((b + a) * bins + b + d) * width..][..width];
                for (c, from) in p.iter().zip(sums.chunks_exact(width)) {
                    scaled_add(to, *c as f32, from);
                }
            }
        }
    }
}
