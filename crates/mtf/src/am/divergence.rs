//! Kullback-Leibler divergence between the histograms of two patches, over the whole patch or summed over overlapping
//! regions: what KLD and LKLD have in common (Kullback & Leibler 1951).
//!
//! In each region of `n` values, with the cubic B-spline `β`, seed `s`, `n_b` bins and `Z = n + s n_b`:
//! `p_k = (Σ_i β(k - I_i) + s)/Z`, `q_k` the same of `T`, `f = -Σ_k p_k ln(p_k/q_k)`, which is at most 0 and 0 for equal
//! histograms. With a dash for the derivative with respect to the patch:
//! `df/dI_i = -Σ_k p'_ki (1 + ln(p_k/q_k))`, `df/dT_i = Σ_k q'_ki p_k/q_k`,
//! `d²f/dI² = -diag(Σ_k p''_ki (1 + ln(p_k/q_k))) - Σ_k p'_k p'_k'/p_k`,
//! `d²f/dT² = diag(Σ_k q''_ki p_k/q_k) - Σ_k q'_k q'_k' p_k/q_k²`, self Hessian `-Σ_k p'_k p'_k'/p_k`.
//!
//! A histogram does not see where its values are: the self Hessian has rank `n_b - 1` at most per region, and many warps of a
//! patch keep its histogram. Every Hessian is therefore damped by `-damping c J'J`, `c` the mean over the values of the self
//! Hessian's diagonal: directions that the histograms do not determine stay where they are. Such a model does not track a
//! homography alone ([`Properties::tracks_alone`]).
//!
//! Pixels are counted once, in the tiles into which the regions' borders divide the patch.

use super::{AppearanceModel, Derivatives, Distances, Metric, PatchShape, Properties, Reference, Side};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::hist::{self, SPLINE, SUPPORT, TABLES, TERMS, Window};
use crate::kernels::{self, Jacobian};
use crate::params::{Assignment, Params};
use crate::tracker::TrackError;
use std::cell::RefCell;
use std::ops::Range;

/// Values of the parameters of a divergence model.
#[derive(Clone, Copy, Debug, Default)]
pub struct DivergenceSettings {
    /// Histogram bins.
    pub bins: usize,
    /// Count added to every bin.
    pub seed: f64,
    /// Damping of the Hessians.
    pub damping: f64,
    /// Likelihood `exp(alpha f / regions)`: alpha.
    pub likelihood_alpha: f64,
    /// Regions along each side of the patch.
    pub regions: usize,
    /// Samples from one region to the next.
    pub spacing: usize,
}

/// What makes a divergence model.
pub trait DivergenceKind: Clone + Default + Send + 'static {
    /// Its parameters.
    type Params: Params;
    /// Name.
    const NAME: &'static str;
    /// One line.
    const SUMMARY: &'static str;
    /// Values of the parameters.
    fn settings(params: &Self::Params) -> DivergenceSettings;
}

/// A region: the tiles in it, and the number of its values.
#[derive(Clone, Debug)]
struct Region {
    tiles: Vec<usize>,
    n: usize,
}

/// How a patch is divided.
#[derive(Clone, Debug, Default)]
struct Layout {
    bins: usize,
    buckets: usize,
    seed: f64,
    tiles: usize,
    /// First bucket of each value's tile.
    offset: Vec<u32>,
    regions: Vec<Region>,
}

/// Regions along one side of `length` samples: `count` of them, `spacing` apart, as large as fits.
fn side(length: usize, count: usize, spacing: usize) -> Vec<Range<usize>> {
    // On small grids the regions move together, so that each keeps its share.
    let spacing = spacing.min(length / (count + 1));
    let width = length - (count - 1) * spacing;
    let mut out: Vec<_> = (0..count).map(|r| r * spacing..r * spacing + width).collect();
    out.dedup();
    out
}

/// Borders of all regions in order: between two of them lies a tile.
fn borders(regions: &[Range<usize>]) -> Vec<usize> {
    let mut out: Vec<usize> = regions.iter().flat_map(|r| [r.start, r.end]).collect();
    out.sort_unstable();
    out.dedup();
    out
}

impl Layout {
    fn new(shape: PatchShape, s: &DivergenceSettings) -> Self {
        let across = side(shape.res.cols, s.regions, s.spacing);
        let down = side(shape.res.rows, s.regions, s.spacing);
        let (xs, ys) = (borders(&across), borders(&down));
        let columns = xs.len() - 1;
        let buckets = s.bins - SUPPORT + 1;
        let tile = |x: usize, y: usize| {
            let find = |b: &[usize], v: usize| b.partition_point(|&e| e <= v) - 1;
            find(&ys, y) * columns + find(&xs, x)
        };
        let points = shape.res.len();
        let offset = (0..shape.len())
            .map(|i| (tile(i % points % shape.res.cols, i % points / shape.res.cols) * buckets) as u32)
            .collect();
        let inside = |b: &[usize], r: &Range<usize>| -> Vec<usize> {
            (0..b.len() - 1).filter(|&k| r.contains(&b[k])).collect()
        };
        let region = |x: &Range<usize>, y: &Range<usize>| Region {
            tiles: inside(&ys, y)
                .iter()
                .flat_map(|&row| inside(&xs, x).into_iter().map(move |c| row * columns + c))
                .collect(),
            n: x.len() * y.len() * shape.channels,
        };
        Layout {
            bins: s.bins,
            buckets,
            seed: s.seed,
            tiles: columns * (ys.len() - 1),
            offset,
            regions: down
                .iter()
                .flat_map(|y| across.iter().map(move |x| (x, y)))
                .map(|(x, y)| region(x, y))
                .collect(),
        }
    }
    fn z(&self, r: &Region) -> f64 {
        r.n as f64 + self.seed * self.bins as f64
    }
    /// Bins per gray level.
    fn slope(&self) -> f64 {
        self.buckets as f64 / 256.0
    }
}

/// A patch in bins, and the histograms of its regions.
#[derive(Clone, Debug, Default)]
struct Histogram {
    /// Bucket of each value within its tile's.
    bucket: Vec<u32>,
    tau: Vec<f32>,
    /// Power sums of each bucket, and scratch.
    moments: Vec<f32>,
    /// `p_k`, region after region.
    p: Vec<f64>,
}

impl Histogram {
    fn resize(&mut self, layout: &Layout) {
        let n = layout.offset.len();
        self.bucket.resize(n, 0);
        self.tau.resize(n, 0.0);
        self.moments
            .resize(TABLES * TERMS * layout.tiles * layout.buckets, 0.0);
        self.p.resize(layout.regions.len() * layout.bins, 0.0);
    }
    /// `Σ_{i in bucket} polynomial(τ_i)`.
    fn total(&self, bucket: usize, polynomial: &[f64]) -> f64 {
        let m = &self.moments[TERMS * bucket..TERMS * (bucket + 1)];
        polynomial.iter().zip(m).map(|(p, &m)| p * f64::from(m)).sum()
    }
    fn set(&mut self, layout: &Layout, patch: &[f32]) {
        hist::bin(patch, layout.buckets, &mut self.bucket, &mut self.tau);
        self.bucket
            .iter_mut()
            .zip(&layout.offset)
            .for_each(|(b, o)| *b += o);
        hist::power_moments(&self.bucket, &self.tau, &mut self.moments);
        let mut p = std::mem::take(&mut self.p);
        for (region, p) in layout.regions.iter().zip(p.chunks_exact_mut(layout.bins)) {
            p.fill(layout.seed);
            for tile in &region.tiles {
                for b in 0..layout.buckets {
                    for (a, polynomial) in SPLINE.iter().enumerate() {
                        p[b + a] += self.total(tile * layout.buckets + b, polynomial);
                    }
                }
            }
            let z = layout.z(region);
            p.iter_mut().for_each(|p| *p /= z);
        }
        self.p = p;
    }
}

/// `-Σ p ln(p/q)`.
fn similarity(p: &[f64], q: &[f64]) -> f64 {
    -p.iter().zip(q).map(|(p, q)| p * libm::log(p / q)).sum::<f64>()
}

/// Divergence of histograms.
#[derive(Clone, Debug, Default)]
pub struct Divergence<K> {
    settings: DivergenceSettings,
    layout: Layout,
    template: Histogram,
    current: Histogram,
    f: f64,
    /// Factor of each bin's derivative; polynomials of the buckets.
    factors: Vec<f64>,
    sum: Vec<f64>,
    table: Vec<f32>,
    weights: Vec<f32>,
    power: Vec<f32>,
    outer: Jacobian,
    outer_weights: Vec<f32>,
    gram: SymMatrix,
    other: RefCell<Histogram>,
    kind: std::marker::PhantomData<K>,
}

impl<K: DivergenceKind> Divergence<K> {
    fn own(&self, side: Side) -> &Histogram {
        match side {
            Side::Template => &self.template,
            Side::Current => &self.current,
        }
    }

    /// Factors of the first and second derivatives of a side's bins: `-(1 + ln(p/q))` or `p/q`.
    fn bin_factors(&mut self, side: Side) {
        let ratios = self.current.p.iter().zip(&self.template.p).map(|(p, q)| p / q);
        self.factors.clear();
        self.factors.extend(ratios.map(|r| match side {
            Side::Template => r,
            Side::Current => -(1.0 + libm::log(r)),
        }));
    }

    /// Polynomials `Σ_regions slope^order / Z Σ_a window_a factor[b + a]` of all buckets.
    fn bucket_table(&mut self, window: &Window, order: i32) {
        let layout = &self.layout;
        self.sum.clear();
        self.sum.resize(TERMS * layout.tiles * layout.buckets, 0.0);
        for (region, factors) in layout.regions.iter().zip(self.factors.chunks_exact(layout.bins)) {
            let scale = layout.slope().powi(order) / layout.z(region);
            for b in 0..layout.buckets {
                let mut polynomial = [0.0; 5];
                for (w, factor) in window.iter().zip(&factors[b..]) {
                    for (p, w) in polynomial.iter_mut().zip(w) {
                        *p += scale * factor * w;
                    }
                }
                for tile in &region.tiles {
                    let to = &mut self.sum[TERMS * (tile * layout.buckets + b)..];
                    to.iter_mut().zip(polynomial).for_each(|(t, p)| *t += p);
                }
            }
        }
        self.table.clear();
        self.table.extend(self.sum.iter().map(|&v| v as f32));
    }

    /// Factors of the outer products in a side's standard Hessian.
    fn outer_factors(&mut self, side: Side) {
        let bins = self.current.p.iter().zip(&self.template.p);
        self.factors.clear();
        self.factors.extend(bins.map(|(p, q)| match side {
            Side::Template => -p / (q * q),
            Side::Current => -1.0 / p,
        }));
    }

    /// `h = Σ_regions Σ_k factor_k P_k P_k'` with `P_k = Σ_i p'_ki J_i`, damped.
    fn outer_hessian(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        let (bins, buckets) = (self.layout.bins, self.layout.buckets);
        let width = hist::padded(j.cols());
        let window = hist::derivative(&SPLINE);
        self.power
            .resize(TABLES * 3 * self.layout.tiles * buckets * width, 0.0);
        let mut power = std::mem::take(&mut self.power);
        let own = self.own(side);
        hist::power_sums::<3>(&own.bucket, &own.tau, j, &mut power);
        let regions = &self.layout.regions;
        self.outer.resize(regions.len() * bins, j.cols());
        self.outer_weights.resize(regions.len() * bins, 0.0);
        for s in 0..j.cols() {
            let column = self.outer.col_mut(s);
            column.fill(0.0);
            for (region, column) in regions.iter().zip(column.chunks_exact_mut(bins)) {
                for tile in &region.tiles {
                    for b in 0..buckets {
                        let at = 3 * (tile * buckets + b) * width + s;
                        let sums = [power[at], power[at + width], power[at + 2 * width]];
                        for (to, w) in column[b..].iter_mut().zip(&window) {
                            let v: f64 = w.iter().zip(sums).map(|(w, s)| w * f64::from(s)).sum();
                            *to += v as f32;
                        }
                    }
                }
            }
        }
        for (r, region) in regions.iter().enumerate() {
            let scale = (self.layout.slope() / self.layout.z(region)).powi(2);
            for k in r * bins..(r + 1) * bins {
                self.outer_weights[k] = (scale * self.factors[k]) as f32;
            }
        }
        self.power = power;
        kernels::weighted_normal_equations(&self.outer, &self.outer_weights, &[], h, &mut []);
        if self.gram.order() != j.cols() {
            self.gram = SymMatrix::new(j.cols());
        }
        if self.settings.damping > 0.0 {
            kernels::normal_equations(j, &[], &mut self.gram, &mut []);
            h.blend(
                1.0,
                -self.settings.damping * self.mean_curvature(side),
                &self.gram,
            );
        }
    }

    /// Mean over the values of `Σ_regions Σ_k p'_ki²/p_k`.
    fn mean_curvature(&self, side: Side) -> f64 {
        let (layout, own) = (&self.layout, self.own(side));
        let squares = hist::derivative(&SPLINE).map(|p| hist::product(&p, &p));
        let mut sum = 0.0;
        for (region, p) in layout.regions.iter().zip(own.p.chunks_exact(layout.bins)) {
            let scale = (layout.slope() / layout.z(region)).powi(2);
            for tile in &region.tiles {
                for b in 0..layout.buckets {
                    for (square, p) in squares.iter().zip(&p[b..]) {
                        sum += scale * own.total(tile * layout.buckets + b, square) / p;
                    }
                }
            }
        }
        sum / layout.offset.len() as f64
    }
}

impl<K: DivergenceKind> Part for Divergence<K> {
    type Params = K::Params;
    const NAME: &'static str = K::NAME;
    const SUMMARY: &'static str = K::SUMMARY;
    fn new(params: K::Params) -> Self {
        Divergence {
            settings: K::settings(&params),
            ..Self::default()
        }
    }
}

impl<K: DivergenceKind> AppearanceModel for Divergence<K> {
    fn properties(&self) -> Properties {
        Properties {
            symmetric: false,
            tracks_alone: false,
            ..Properties::default()
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.layout = Layout::new(shape, &self.settings);
        self.template.resize(&self.layout);
        self.template.set(&self.layout, patch);
        if self.template.p.iter().any(|p| !p.is_finite()) {
            return Err(TrackError::NotFinite("template"));
        }
        self.current.clone_from(&self.template);
        self.other.get_mut().resize(&self.layout);
        self.weights.resize(shape.len(), 0.0);
        self.f = 0.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.current.set(&self.layout, patch);
        self.f = similarity(&self.current.p, &self.template.p);
    }
    fn similarity(&self) -> f64 {
        self.f
    }
    fn likelihood(&self) -> f64 {
        let regions = self.layout.regions.len().max(1) as f64;
        libm::exp(self.settings.likelihood_alpha * self.f / regions)
    }
    fn memory(&self) -> usize {
        let tables = 4 * (self.table.capacity() + self.power.capacity() + 2 * self.sum.capacity());
        24 * self.layout.offset.len() + tables + self.outer.memory()
    }
    fn derivatives(&mut self) -> Option<&mut dyn Derivatives> {
        Some(self)
    }
    fn distances(&self) -> Option<&dyn Distances> {
        Some(self)
    }
    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }
}

impl<K: DivergenceKind> Derivatives for Divergence<K> {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        self.bin_factors(side);
        self.bucket_table(&hist::derivative(&SPLINE), 1);
        let own = self.own(side);
        hist::bucket_polynomials(&own.bucket, &own.tau, &self.table, out);
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.bin_factors(side);
        self.bucket_table(&hist::derivative(&hist::derivative(&SPLINE)), 2);
        let mut weights = std::mem::take(&mut self.weights);
        let own = self.own(side);
        hist::bucket_polynomials(&own.bucket, &own.tau, &self.table, &mut weights);
        self.outer_factors(side);
        self.outer_hessian(side, j, h);
        kernels::weighted_normal_equations(j, &weights, &[], &mut self.gram, &mut []);
        h.blend(1.0, 1.0, &self.gram);
        self.weights = weights;
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        let mut factors = std::mem::take(&mut self.factors);
        factors.clear();
        factors.extend(self.own(side).p.iter().map(|p| -1.0 / p));
        self.factors = factors;
        self.outer_hessian(side, j, h);
    }
}

impl<K: DivergenceKind> Distances for Divergence<K> {
    fn metric(&self) -> Metric {
        Metric::Other
    }
    fn feature_len(&self) -> usize {
        self.template.p.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        let mut other = self.other.borrow_mut();
        other.set(&self.layout, patch);
        out.iter_mut().zip(&other.p).for_each(|(o, &p)| *o = p as f32);
    }
    /// `Σ p ln(p/q)`, region after region; each adds something positive.
    fn distance(&self, query: &[f32], stored: &[f32], bound: f32) -> f32 {
        let bins = self.layout.bins;
        let mut sum = 0.0;
        for (p, q) in query.chunks_exact(bins).zip(stored.chunks_exact(bins)) {
            let terms = p
                .iter()
                .zip(q)
                .map(|(&p, &q)| f64::from(p) * libm::log(f64::from(p) / f64::from(q)));
            sum += terms.sum::<f64>().max(0.0);
            if sum > f64::from(bound) {
                break;
            }
        }
        sum as f32
    }
}

impl<K: DivergenceKind> Reference for Divergence<K> {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let layout = &self.layout;
        let histograms = |patch: &[f64]| -> Vec<f64> {
            let one = |region: &Region| {
                let mut p = vec![layout.seed; layout.bins];
                for (&x, &offset) in patch.iter().zip(&layout.offset) {
                    if region.tiles.contains(&(offset as usize / layout.buckets)) {
                        let (b, v) = hist::bin_reference(x, layout.buckets);
                        for k in b..b + SUPPORT {
                            p[k] += hist::spline_reference(k as f64 - 1.0 - v);
                        }
                    }
                }
                let z = layout.z(region);
                p.into_iter().map(move |p| p / z).collect::<Vec<_>>()
            };
            layout.regions.iter().flat_map(one).collect()
        };
        similarity(&histograms(current), &histograms(template))
    }
    fn plain(&self) -> &'static [Assignment<'static>] {
        &[("damping", "0")]
    }
}
