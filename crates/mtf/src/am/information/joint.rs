//! Joint histograms of two patches, and of a patch with itself.

use super::Kind;
use crate::kernels::hist::{self, CUMULATIVE, SPLINE, SUPPORT, TABLES, TERMS, Window};
use std::marker::PhantomData;

pub(super) fn window<K: Kind>() -> Window {
    if K::CUMULATIVE { CUMULATIVE } else { SPLINE }
}

/// Products of a window of the one patch and one of the other, as polynomials of a common `τ`.
pub(super) fn products(a: &Window, b: &Window) -> [[[f64; TERMS]; SUPPORT]; SUPPORT] {
    a.map(|a| b.map(|b| hist::product(&a, &b)))
}

/// A joint histogram with what follows from it; `[k * bins + l]`.
#[derive(Clone, Debug, Default)]
pub(super) struct Joint {
    pub bins: usize,
    /// `c_kl` and `L_kl`.
    pub c: Vec<f64>,
    pub l: Vec<f64>,
    /// `C_k`, `S_l`, `q_l`.
    pub row: Vec<f64>,
    pub column: Vec<f64>,
    pub marginal: Vec<f64>,
    /// The measure.
    pub f: f64,
}

impl Joint {
    pub fn resize(&mut self, bins: usize) {
        self.bins = bins;
        for v in [&mut self.c, &mut self.l] {
            v.resize(bins * bins, 0.0);
        }
        for v in [&mut self.row, &mut self.column, &mut self.marginal] {
            v.resize(bins, 0.0);
        }
    }
    pub fn clear(&mut self) {
        self.c.fill(0.0);
        self.marginal.fill(0.0);
    }
    /// Turns counts in `c` and `marginal` into the measure.
    pub fn finish(&mut self, n: usize, seed: f64) {
        let b = self.bins;
        let z = n as f64 + seed * (b * b) as f64;
        self.c.iter_mut().for_each(|c| *c = (*c + seed) / z);
        self.marginal
            .iter_mut()
            .for_each(|q| *q = (*q + seed * b as f64) / z);
        self.column.fill(0.0);
        for (row, c) in self.row.iter_mut().zip(self.c.chunks_exact(b)) {
            *row = c.iter().sum();
            self.column.iter_mut().zip(c).for_each(|(s, c)| *s += c);
        }
        self.f = 0.0;
        for k in 0..b {
            let log = libm::log(self.row[k]);
            for l in 0..b {
                let at = k * b + l;
                self.l[at] = libm::log(self.c[at]) - log;
            }
        }
        for l in 0..b {
            let log = libm::log(self.marginal[l]);
            for k in 0..b {
                let at = k * b + l;
                self.l[at] -= log;
                self.f += self.c[at] * self.l[at];
            }
        }
    }
}

/// A patch in bins.
#[derive(Clone, Debug, Default)]
pub(super) struct Binned {
    pub bucket: Vec<u32>,
    pub tau: Vec<f32>,
    buckets: usize,
    /// Power sums of each bucket, and scratch.
    moments: Vec<f32>,
}

impl Binned {
    fn resize(&mut self, n: usize, buckets: usize) {
        self.buckets = buckets;
        self.bucket.resize(n, 0);
        self.tau.resize(n, 0.0);
        self.moments.resize(TABLES * TERMS * buckets, 0.0);
    }
    fn set(&mut self, patch: &[f32]) {
        hist::bin(patch, self.buckets, &mut self.bucket, &mut self.tau);
    }
    pub fn sum_moments(&mut self) {
        hist::power_moments(&self.bucket, &self.tau, &mut self.moments);
    }
    /// `Σ_{i in b} p(τ_i)`.
    fn total(&self, b: usize, p: &[f64]) -> f64 {
        let m = &self.moments[TERMS * b..TERMS * (b + 1)];
        p.iter().zip(m).map(|(p, &m)| p * f64::from(m)).sum()
    }
    /// Adds the counts of `β` to `out`.
    fn add_marginal(&self, out: &mut [f64]) {
        for b in 0..self.buckets {
            for (d, p) in SPLINE.iter().enumerate() {
                out[b + d] += self.total(b, p);
            }
        }
    }
}

/// Two patches and their joint histogram. Where many templates meet one current patch, that is the one set first.
#[derive(Clone, Debug, Default)]
pub(super) struct Pair<K> {
    buckets: usize,
    pub template: Binned,
    /// Four weights per value of the patch set first: `β` of the template, or `α` of the current patch.
    pub rows: Vec<f32>,
    /// Counts of the template's bins; cumulative histograms have no need of them.
    template_counts: Vec<f64>,
    pub current: Binned,
    /// Pair of buckets of each value.
    pub cell: Vec<u32>,
    sums: Vec<f32>,
    pub joint: Joint,
    kind: PhantomData<K>,
}

impl<K: Kind> Pair<K> {
    /// Cumulative histograms need the counts of the template.
    const ALONE: usize = if K::CUMULATIVE { hist::RIGHT } else { hist::NEITHER };
    /// Numbers per pair of buckets, scratch included.
    pub const SUMS: usize = TABLES * hist::cell_sums(Self::ALONE);

    pub fn resize(&mut self, n: usize, bins: usize) {
        self.buckets = bins - SUPPORT + 1;
        self.template.resize(n, self.buckets);
        self.current.resize(n, self.buckets);
        self.rows.resize(SUPPORT * n, 0.0);
        self.template_counts.resize(bins, 0.0);
        self.cell.resize(n, 0);
        let cells = self.buckets * self.buckets;
        self.sums.resize(Self::SUMS * cells, 0.0);
        self.joint.resize(bins);
    }

    pub fn set_template(&mut self, patch: &[f32]) {
        self.template.set(patch);
        hist::window_rows(&hist::narrow(&SPLINE), &self.template.tau, &mut self.rows);
        // Cumulative histograms have these as a by-product.
        if !K::CUMULATIVE {
            self.template.sum_moments();
            self.template_counts.fill(0.0);
            self.template.add_marginal(&mut self.template_counts);
        }
    }

    pub fn set_current(&mut self, patch: &[f32], seed: f64) {
        self.current.set(patch);
        let run = if K::CUMULATIVE {
            hist::joint_histogram::<{ hist::RIGHT }>
        } else {
            hist::joint_histogram::<{ hist::NEITHER }>
        };
        run(
            &hist::narrow(&window::<K>()),
            &self.current.bucket,
            &self.current.tau,
            &self.template.bucket,
            &self.rows,
            self.buckets,
            &mut self.cell,
            &mut self.sums,
        );
        self.joint.clear();
        if !K::CUMULATIVE {
            self.joint.marginal.copy_from_slice(&self.template_counts);
        }
        self.collect::<false>();
        self.joint.finish(patch.len(), seed);
    }

    /// The current patch that many templates will meet ([`meet`](Self::meet)). For cumulative histograms; others are the
    /// same with the patches exchanged.
    pub fn expect(&mut self, patch: &[f32]) {
        self.current.set(patch);
        hist::window_rows(&hist::narrow(&window::<K>()), &self.current.tau, &mut self.rows);
    }

    /// Joint histogram with the current patch set by [`expect`](Self::expect).
    pub fn meet(&mut self, template: &[f32], seed: f64) {
        self.template.set(template);
        hist::joint_histogram::<{ hist::LEFT }>(
            &hist::narrow(&SPLINE),
            &self.template.bucket,
            &self.template.tau,
            &self.current.bucket,
            &self.rows,
            self.buckets,
            &mut self.cell,
            &mut self.sums,
        );
        self.joint.clear();
        self.collect::<true>();
        self.joint.finish(template.len(), seed);
    }

    /// Adds the sums over pairs of buckets to the counts. The template's bucket counts first in a cell, and its bin first within
    /// the cell's sums, or the current patch's.
    fn collect<const TEMPLATE_FIRST: bool>(&mut self) {
        let buckets = self.buckets;
        let [[of_b, of_t], [of_a, of_d]] = if TEMPLATE_FIRST {
            [[1, buckets], [1, SUPPORT]]
        } else {
            [[buckets, 1], [SUPPORT, 1]]
        };
        let (bins, stride) = (self.joint.bins, hist::cell_sums(Self::ALONE));
        let Joint { c, marginal, .. } = &mut self.joint;
        for (b, t) in (0..buckets).flat_map(|b| (0..buckets).map(move |t| (b, t))) {
            let sums = &self.sums[(of_b * b + of_t * t) * stride..][..stride];
            for a in 0..SUPPORT {
                let row = &mut c[(b + a) * bins + t..][..SUPPORT];
                for (d, c) in row.iter_mut().enumerate() {
                    *c += f64::from(sums[of_a * a + of_d * d]);
                }
            }
            if K::CUMULATIVE {
                let counts = &sums[SUPPORT * SUPPORT..][..SUPPORT];
                let add = |row: &mut [f64]| row.iter_mut().zip(counts).for_each(|(c, &v)| *c += f64::from(v));
                add(&mut marginal[t..]);
                (0..b).for_each(|k| add(&mut c[k * bins + t..]));
            }
        }
    }
}

/// Joint histogram of a patch with itself.
pub(super) fn self_joint<K: Kind>(patch: &Binned, n: usize, seed: f64, out: &mut Joint) {
    let (bins, buckets) = (out.bins, patch.buckets);
    let pairs = products(&window::<K>(), &SPLINE);
    out.clear();
    patch.add_marginal(&mut out.marginal);
    for b in 0..buckets {
        for d in 0..SUPPORT {
            for (a, row) in pairs.iter().enumerate() {
                out.c[(b + a) * bins + b + d] += patch.total(b, &row[d]);
            }
            if K::CUMULATIVE {
                let count = patch.total(b, &SPLINE[d]);
                (0..b).for_each(|k| out.c[k * bins + b + d] += count);
            }
        }
    }
    out.finish(n, seed);
}
