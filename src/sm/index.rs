//! Indices of samples: which of many features are nearest to a query.
//!
//! `linear` compares with all, each comparison ending early. `kd` finds candidates in a k-d tree (Bentley 1975) over the
//! sixteen principal axes of the samples and ranks them by their full distance. `gnn` walks a graph whose nodes are linked to
//! their nearest samples (Hajebi et al. 2011), downhill from the best of some samples; `fgnn` is the same over a graph that is made
//! from distances along the principal axes.

use crate::am::AppearanceModel;
use crate::kernels;
use crate::params::param_enum;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZero;

param_enum! {
    /// How the nearest samples are found.
    pub enum IndexKind {
        /// `kd` for Euclidean features, `linear` for sums of absolute differences, else `fgnn`.
        Auto = "auto",
        /// Comparison with all.
        Linear = "linear",
        /// k-d tree over principal axes, candidates ranked by full distance.
        Kd = "kd",
        /// Graph of nearest samples.
        Gnn = "gnn",
        /// Graph of samples nearest along the principal axes.
        Fgnn = "fgnn",
    }
}

/// Principal axes kept.
const AXES: usize = 16;
/// Samples that determine them, and rounds of subspace iteration.
const AXIS_SAMPLES: usize = 512;
const ROUNDS: usize = 3;

/// Samples from which a walk may start.
const PROBES: usize = 64;

/// Features, one after the other.
#[derive(Default)]
pub(super) struct Features {
    pub values: Vec<f32>,
    /// Numbers per feature.
    pub len: usize,
}

impl Features {
    pub fn count(&self) -> usize {
        self.values.len() / self.len.max(1)
    }
    pub fn row(&self, i: usize) -> &[f32] {
        &self.values[i * self.len..(i + 1) * self.len]
    }
}

/// The `k` nearest so far, nearest first; of equal distances the one offered first.
pub(super) struct Nearest {
    k: usize,
    pub found: Vec<(f32, usize)>,
}

impl Nearest {
    pub fn new(k: usize) -> Self {
        Nearest {
            k,
            found: Vec::with_capacity(k + 1),
        }
    }
    /// Distances of this and more are of no interest.
    fn bound(&self) -> f32 {
        if self.found.len() < self.k {
            f32::INFINITY
        } else {
            self.found[self.k - 1].0
        }
    }
    fn offer(&mut self, distance: f32, i: usize) {
        if distance < self.bound() {
            let at = self.found.partition_point(|f| f.0 <= distance);
            self.found.insert(at, (distance, i));
            self.found.truncate(self.k);
        }
    }
}

/// Projection onto the principal axes of samples.
pub(super) struct Axes {
    mean: Vec<f32>,
    axes: Vec<Vec<f32>>,
    centred: Vec<f32>,
}

impl Axes {
    /// By subspace iteration over evenly chosen samples.
    fn of(features: &Features) -> Self {
        let (n, len) = (features.count(), features.len);
        let stride = n.div_ceil(AXIS_SAMPLES);
        let chosen = || (0..n).step_by(stride);
        let mut mean = vec![0.0; len];
        let share = 1.0 / chosen().count() as f32;
        chosen().for_each(|i| kernels::add_scaled(share, features.row(i), &mut mean));
        let mut row = vec![0.0; len];
        let centre = |i: usize, row: &mut Vec<f32>| {
            kernels::combine(1.0, features.row(i), -1.0, &mean, row);
        };
        let count = AXES.min(len);
        let mut axes: Vec<Vec<f32>> = (0..count)
            .map(|k| {
                centre((1 + k * n / count) % n, &mut row);
                row.clone()
            })
            .collect();
        orthonormalise(&mut axes);
        for _ in 0..ROUNDS {
            let mut next = vec![vec![0.0; len]; count];
            for i in chosen() {
                centre(i, &mut row);
                for (axis, sum) in axes.iter().zip(&mut next) {
                    kernels::add_scaled(kernels::dot(axis, &row) as f32, &row, sum);
                }
            }
            axes = next;
            orthonormalise(&mut axes);
        }
        Axes {
            mean,
            axes,
            centred: row,
        }
    }

    fn project(&mut self, feature: &[f32]) -> [f32; AXES] {
        kernels::combine(1.0, feature, -1.0, &self.mean, &mut self.centred);
        let mut out = [0.0; AXES];
        for (o, axis) in out.iter_mut().zip(&self.axes) {
            *o = kernels::dot(axis, &self.centred) as f32;
        }
        out
    }
}

/// Gram and Schmidt, the second pass for accuracy; vectors that depend on others become zero.
fn orthonormalise(vectors: &mut [Vec<f32>]) {
    for k in 0..vectors.len() {
        let (before, rest) = vectors.split_at_mut(k);
        let v = &mut rest[0];
        let size = kernels::dot(v, v);
        for _ in 0..2 {
            for u in before.iter() {
                kernels::add_scaled(-kernels::dot(u, v) as f32, u, v);
            }
        }
        let left = kernels::dot(v, v);
        let scale = if left > 1e-10 * size && left > 0.0 {
            1.0 / left.sqrt()
        } else {
            0.0
        };
        v.iter_mut().for_each(|x| *x *= scale as f32);
    }
}

/// k-d tree over projected samples.
pub(super) struct Tree {
    axes: Axes,
    tree: ImmutableKdTree<f32, AXES>,
    candidates: usize,
}

impl Tree {
    fn new(features: &Features, candidates: usize) -> Option<Self> {
        let mut axes = Axes::of(features);
        let points: Vec<[f32; AXES]> = (0..features.count())
            .map(|i| axes.project(features.row(i)))
            .collect();
        let tree = ImmutableKdTree::new_from_slice(&points).ok()?;
        Some(Tree {
            axes,
            tree,
            candidates,
        })
    }

    /// The nearest along the axes, in order.
    fn nearest(&mut self, query: &[f32], count: usize) -> Vec<usize> {
        let point = self.axes.project(query);
        let Some(count) = NonZero::new(count).filter(|_| point.iter().all(|v| v.is_finite())) else {
            return Vec::new();
        };
        let near = self
            .tree
            .query(&point)
            .nearest_n::<SquaredEuclidean<f32>>(count)
            .execute();
        near.into_iter().map(|r| r.item as usize).collect()
    }
}

/// Links of every sample to `degree` others.
pub(super) struct Graph {
    links: Vec<u32>,
    degree: usize,
    max_steps: usize,
    /// Where the last search ended.
    last: usize,
    /// Search in which each node was compared last.
    seen: Vec<u32>,
    search: u32,
}

impl Graph {
    fn new(n: usize, degree: usize, max_steps: usize, mut nearest: impl FnMut(usize) -> Vec<usize>) -> Self {
        let degree = degree.min(n - 1);
        let links = (0..n)
            .flat_map(|i| {
                let mut near = nearest(i);
                near.retain(|&j| j != i);
                // Never fewer than the others have.
                near.resize(degree, i);
                near.into_iter().map(|j| j as u32)
            })
            .collect();
        Graph {
            links,
            degree,
            max_steps,
            last: 0,
            seen: vec![0; n],
            search: 0,
        }
    }

    fn find(&mut self, mut distance: impl FnMut(usize, f32) -> f32, out: &mut Nearest) {
        self.search = self.search.wrapping_add(1);
        let mut visit = |i: usize, seen: &mut [u32]| {
            if seen[i] != self.search {
                seen[i] = self.search;
                let d = distance(i, out.bound());
                out.offer(d, i);
            }
            out.found.first().map_or(0, |f| f.1)
        };
        // Start at the best of the last answer, the identity and others from all over: walks that begin among the many
        // samples near the identity may not find out.
        let n = self.seen.len();
        let mut at = visit(self.last, &mut self.seen);
        for i in (0..n).step_by(n.div_ceil(PROBES)) {
            at = visit(i, &mut self.seen);
        }
        for _ in 0..self.max_steps {
            let mut best = at;
            for &j in &self.links[at * self.degree..(at + 1) * self.degree] {
                best = visit(j as usize, &mut self.seen);
            }
            if best == at {
                break;
            }
            at = best;
        }
        self.last = at;
    }
}

/// An index over samples.
pub(super) enum Index {
    Linear,
    Kd(Tree),
    Graph(Graph),
}

/// What an index is made with.
#[derive(Clone, Copy)]
pub(super) struct IndexSettings {
    /// Never `Auto`.
    pub kind: IndexKind,
    pub candidates: usize,
    pub degree: usize,
    pub max_steps: usize,
}

impl Index {
    /// Index over the samples, of which there are two at least. Where no tree can be built, a linear one.
    pub fn new<A: AppearanceModel>(am: &A, features: &Features, settings: IndexSettings) -> Self {
        let n = features.count();
        let IndexSettings {
            candidates,
            degree,
            max_steps,
            ..
        } = settings;
        match settings.kind {
            IndexKind::Auto | IndexKind::Linear => Index::Linear,
            IndexKind::Kd => Tree::new(features, candidates).map_or(Index::Linear, Index::Kd),
            IndexKind::Gnn => {
                let mut distances = vec![(0.0, 0); n];
                Index::Graph(Graph::new(n, degree, max_steps, |i| {
                    for (j, d) in distances.iter_mut().enumerate() {
                        *d = (am.distance(features.row(i), features.row(j), f32::INFINITY), j);
                    }
                    let wanted = (degree + 1).min(n);
                    distances
                        .select_nth_unstable_by(wanted - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                    distances[..wanted]
                        .iter()
                        .map(|d| d.1)
                        .filter(|&j| j != i)
                        .take(degree)
                        .collect()
                }))
            }
            IndexKind::Fgnn => Tree::new(features, candidates).map_or(Index::Linear, |mut tree| {
                Index::Graph(Graph::new(n, degree, max_steps, |i| {
                    let mut near = tree.nearest(features.row(i), degree + 1);
                    near.retain(|&j| j != i);
                    near.truncate(degree);
                    near
                }))
            }),
        }
    }

    /// Whether there is a tree.
    #[cfg(test)]
    fn is_tree(&self) -> bool {
        matches!(self, Index::Kd(_))
    }

    /// The nearest samples to a query; fewer than asked for where distances are not finite.
    pub fn find<A: AppearanceModel>(
        &mut self,
        am: &A,
        features: &Features,
        query: &[f32],
        out: &mut Nearest,
    ) {
        out.found.clear();
        let distance = |i: usize, bound: f32| am.distance(query, features.row(i), bound);
        match self {
            Index::Linear => {
                for i in 0..features.count() {
                    out.offer(distance(i, out.bound()), i);
                }
            }
            Index::Kd(tree) => {
                let count = tree.candidates.max(2 * out.k).min(features.count());
                for i in tree.nearest(query, count) {
                    out.offer(distance(i, out.bound()), i);
                }
            }
            Index::Graph(graph) => graph.find(distance, out),
        }
    }

    /// Bytes.
    pub fn memory(&self) -> usize {
        match self {
            Index::Linear => 0,
            Index::Kd(tree) => 4 * (AXES + 2) * tree.axes.mean.len() + 4 * (AXES + 1) * tree.tree.size(),
            Index::Graph(graph) => 4 * (graph.links.len() + graph.seen.len()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::am::{AppearanceModel, PatchShape, Ssd};
    use crate::params::Resolution;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// Points of a curved sheet of three dimensions in many.
    fn sheet(n: usize, len: usize) -> Features {
        let mut rng = Pcg64::seed_from_u64(5);
        let values = (0..n)
            .flat_map(|i| {
                let scale = if i == 0 { 0.0 } else { 1.0 };
                let u: [f32; 3] = std::array::from_fn(|_| scale * rng.random_range(-1.0f32..1.0));
                (0..len)
                    .map(|k| {
                        let t = k as f32 / len as f32;
                        100.0 * ((u[0] + 3.0 * t).sin() + u[1] * t + u[2] * (1.0 - t) * t)
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        Features { values, len }
    }

    #[test]
    fn every_index_finds_the_nearest() {
        let features = sheet(600, 99);
        let mut am = Ssd::default();
        let shape = PatchShape {
            res: Resolution { cols: 11, rows: 9 },
            channels: 1,
        };
        am.set_template(shape, features.row(3)).unwrap();
        let mut rng = Pcg64::seed_from_u64(6);
        let settings = |kind| IndexSettings {
            kind,
            candidates: 40,
            degree: 60,
            max_steps: 20,
        };
        let kinds = [IndexKind::Linear, IndexKind::Kd, IndexKind::Gnn, IndexKind::Fgnn];
        let mut indices = kinds.map(|kind| Index::new(&am, &features, settings(kind)));
        assert!(indices[1].is_tree());
        for round in 0..40 {
            let at = rng.random_range(0..600);
            let noise = |v: &f32| v + rng.random_range(-1.0f32..1.0);
            let query: Vec<f32> = features.row(at).iter().map(noise).collect();
            let mut all: Vec<(f32, usize)> = (0..600)
                .map(|i| {
                    (
                        kernels::squared_distance(&query, features.row(i), f32::INFINITY),
                        i,
                    )
                })
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (index, kind) in indices.iter_mut().zip(kinds) {
                let mut near = Nearest::new(5);
                index.find(&am, &features, &query, &mut near);
                assert_eq!(near.found[..], all[..5], "{kind:?}, round {round}");
            }
        }
        // Nothing is near a query that is not finite.
        for index in &mut indices {
            let mut near = Nearest::new(5);
            index.find(&am, &features, &[f32::NAN; 99], &mut near);
            assert!(near.found.is_empty());
        }
    }
}
