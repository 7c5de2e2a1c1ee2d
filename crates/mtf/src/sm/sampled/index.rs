//! Indices of samples: which of many features are nearest to a query.
//!
//! `linear` compares with all, each comparison ending early. `kd` finds candidates in a k-d tree (Bentley 1975) over the
//! sixteen principal axes of the samples and ranks them by their full distance. `gnn` walks a graph whose nodes are linked to
//! their nearest samples (Hajebi et al. 2011), downhill from the best of some samples; `fgnn` is the same over a graph that is made
//! from distances along the principal axes.

use crate::am::{AppearanceModel, Distances, Metric};
use crate::interrupt::{self, Interrupted};
use crate::kernels;
use crate::params::param_enum;
use crate::threads::in_shares;
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

/// Compares features, one for each thread that may do so at once.
pub(super) struct Judge<A> {
    am: A,
    near: Nearest,
}

/// Numbers that must be compared before another thread is worth it; a value of a model whose distance is no sum over values
/// counts as many.
const WORTH: usize = 1 << 18;
const DEAR: usize = 32;

impl<A: AppearanceModel> Judge<A> {
    /// Of a model that has distances.
    pub fn new(am: A) -> Self {
        Judge {
            am,
            near: Nearest::new(1),
        }
    }
}

fn distances_of<A: AppearanceModel>(am: &A) -> &dyn Distances {
    am.distances().expect("judges are made of models with distances")
}

/// Compares the query with `count` samples, `id` names them, and offers them in this order, whoever compares. Interrupted, it
/// leaves out the rest.
fn offer_all<A: AppearanceModel>(
    judges: &mut [Judge<A>],
    features: &Features,
    query: &[f32],
    count: usize,
    id: impl Fn(usize) -> usize + Sync,
    out: &mut Nearest,
) {
    let first = distances_of(&judges[0].am);
    let price = match first.metric() {
        Metric::Other => DEAR,
        Metric::SquaredL2 | Metric::L1 => 1,
    };
    if judges.len() == 1 || count * features.len * price < WORTH {
        for i in (0..count).map(id).take_while(|_| !interrupt::requested()) {
            out.offer(first.distance(query, features.row(i), out.bound()), i);
        }
        return;
    }
    let known = &*out;
    in_shares(judges, count, |judge, share| {
        let Judge { am, near } = judge;
        near.k = known.k;
        near.found.clone_from(&known.found);
        let distances = distances_of(am);
        for i in share.map(&id).take_while(|_| !interrupt::requested()) {
            near.offer(distances.distance(query, features.row(i), near.bound()), i);
        }
    });
    for judge in judges {
        for &(distance, i) in &judge.near.found {
            if !out.found.iter().any(|f| f.1 == i) {
                out.offer(distance, i);
            }
        }
    }
}

/// What `of` makes of each number below `count`, in order, each state of `states` working on a share of them.
fn of_each<T: Send, R: Send>(
    states: &mut [T],
    count: usize,
    of: impl Fn(&mut T, usize) -> R + Sync,
) -> Result<Vec<R>, Interrupted> {
    let one = |state: &mut T, i: usize| interrupt::check().map(|()| of(state, i));
    if let [state] = states {
        return (0..count).map(|i| one(state, i)).collect();
    }
    let made = in_shares(states, count, |state, share| {
        share.map(|i| one(state, i)).collect::<Result<Vec<R>, _>>()
    });
    let made: Vec<Vec<R>> = made.into_iter().collect::<Result<_, _>>()?;
    Ok(made.into_iter().flatten().collect())
}

/// Projection onto the principal axes of samples.
#[derive(Clone)]
pub(super) struct Axes {
    mean: Vec<f32>,
    axes: Vec<Vec<f32>>,
    centred: Vec<f32>,
}

impl Axes {
    /// By subspace iteration over evenly chosen samples.
    fn of(features: &Features) -> Result<Self, Interrupted> {
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
                interrupt::check()?;
                centre(i, &mut row);
                for (axis, sum) in axes.iter().zip(&mut next) {
                    kernels::add_scaled(kernels::dot(axis, &row) as f32, &row, sum);
                }
            }
            axes = next;
            orthonormalise(&mut axes);
        }
        Ok(Axes {
            mean,
            axes,
            centred: row,
        })
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
    /// With what each sample is along the axes, if a tree can be built. Made by so many threads.
    fn new(
        features: &Features,
        candidates: usize,
        threads: usize,
    ) -> Result<Option<(Self, Vec<[f32; AXES]>)>, Interrupted> {
        let axes = Axes::of(features)?;
        let mut each = vec![axes.clone(); threads];
        let points = of_each(&mut each, features.count(), |axes, i| {
            axes.project(features.row(i))
        })?;
        let Ok(tree) = ImmutableKdTree::new_from_slice(&points) else {
            return Ok(None);
        };
        let tree = Tree {
            axes,
            tree,
            candidates,
        };
        Ok(Some((tree, points)))
    }

    /// The nearest along the axes, in order.
    fn nearest(&self, point: &[f32; AXES], count: usize) -> Vec<usize> {
        let Some(count) = NonZero::new(count).filter(|_| point.iter().all(|v| v.is_finite())) else {
            return Vec::new();
        };
        let near = self
            .tree
            .query(point)
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
    /// Samples to compare next.
    next: Vec<u32>,
}

impl Graph {
    /// `near`: for each sample those that are nearest to it, itself perhaps among them.
    fn new(near: Vec<Vec<usize>>, degree: usize, max_steps: usize) -> Self {
        let n = near.len();
        let degree = degree.min(n - 1);
        let links = near.into_iter().enumerate().flat_map(|(i, mut near)| {
            near.retain(|&j| j != i);
            // Never more, nor fewer, than the others have.
            near.resize(degree, i);
            near.into_iter().map(|j| j as u32)
        });
        Graph {
            links: links.collect(),
            degree,
            max_steps,
            last: 0,
            seen: vec![0; n],
            search: 0,
            next: Vec::with_capacity(n),
        }
    }

    /// `offer` compares the query with samples and offers them.
    fn find(&mut self, mut offer: impl FnMut(&[u32], &mut Nearest), out: &mut Nearest) {
        self.search = self.search.wrapping_add(1);
        // Start at the best of the last answer, the identity and others from all over: walks that begin among the many
        // samples near the identity may not find out.
        let n = self.seen.len();
        self.next.clear();
        let starts = [self.last].into_iter().chain((0..n).step_by(n.div_ceil(PROBES)));
        for i in starts {
            if self.seen[i] != self.search {
                self.seen[i] = self.search;
                self.next.push(i as u32);
            }
        }
        offer(&self.next, out);
        let best = |out: &Nearest| out.found.first().map_or(0, |f| f.1);
        let mut at = best(out);
        for _ in 0..self.max_steps {
            self.next.clear();
            for &j in &self.links[at * self.degree..(at + 1) * self.degree] {
                if self.seen[j as usize] != self.search {
                    self.seen[j as usize] = self.search;
                    self.next.push(j);
                }
            }
            offer(&self.next, out);
            if best(out) == at {
                break;
            }
            at = best(out);
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

impl IndexSettings {
    /// Bytes that an index over `n` samples of `len` numbers keeps, and those that making it on so many threads takes
    /// besides.
    pub fn memory(&self, n: usize, len: usize, threads: usize) -> [usize; 2] {
        let links = (self.degree + 1).min(n);
        let (axes, points) = (4 * (AXES + 2) * len, 4 * AXES * n);
        let tree = axes + 4 * (AXES + 1) * n;
        let (graph, lists) = (4 * n * (links + 2), n * (size_of::<Vec<usize>>() + 8 * links));
        let projected = 2 * points + threads * axes;
        match self.kind {
            IndexKind::Auto | IndexKind::Linear => [0, 0],
            IndexKind::Kd => [tree, projected],
            IndexKind::Gnn => [graph, lists + threads * n * size_of::<(f32, usize)>()],
            IndexKind::Fgnn => [graph, lists + tree + projected],
        }
    }
}

impl Index {
    /// Index over the samples, of which there are two at least. Where no tree can be built, a linear one.
    ///
    /// # Errors
    /// Interrupted.
    pub fn new<A: AppearanceModel>(
        judges: &mut [Judge<A>],
        features: &Features,
        settings: IndexSettings,
    ) -> Result<Self, Interrupted> {
        let n = features.count();
        let IndexSettings {
            candidates,
            degree,
            max_steps,
            ..
        } = settings;
        let wanted = (degree + 1).min(n);
        Ok(match settings.kind {
            IndexKind::Auto | IndexKind::Linear => Index::Linear,
            IndexKind::Kd => Tree::new(features, candidates, judges.len())?
                .map_or(Index::Linear, |(tree, _)| Index::Kd(tree)),
            IndexKind::Gnn => {
                let near = of_each(judges, n, |judge, i| {
                    let row = features.row(i);
                    let model = distances_of(&judge.am);
                    let mut distances: Vec<(f32, usize)> = (0..n)
                        .map(|j| match interrupt::requested() {
                            true => (f32::INFINITY, j),
                            false => (model.distance(row, features.row(j), f32::INFINITY), j),
                        })
                        .collect();
                    distances
                        .select_nth_unstable_by(wanted - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                    distances[..wanted].iter().map(|d| d.1).collect()
                })?;
                interrupt::check()?;
                Index::Graph(Graph::new(near, degree, max_steps))
            }
            IndexKind::Fgnn => match Tree::new(features, candidates, judges.len())? {
                Some((tree, points)) => {
                    let near = of_each(judges, n, |_, i| tree.nearest(&points[i], wanted))?;
                    Index::Graph(Graph::new(near, degree, max_steps))
                }
                None => Index::Linear,
            },
        })
    }

    /// Whether there is a tree.
    #[cfg(test)]
    fn is_tree(&self) -> bool {
        matches!(self, Index::Kd(_))
    }

    /// The nearest samples to a query; fewer than asked for where distances are not finite. The same for any number of
    /// judges.
    pub fn find<A: AppearanceModel>(
        &mut self,
        judges: &mut [Judge<A>],
        features: &Features,
        query: &[f32],
        out: &mut Nearest,
    ) {
        out.found.clear();
        match self {
            Index::Linear => offer_all(judges, features, query, features.count(), |i| i, out),
            Index::Kd(tree) => {
                let count = tree.candidates.max(2 * out.k).min(features.count());
                let point = tree.axes.project(query);
                let near = tree.nearest(&point, count);
                offer_all(judges, features, query, near.len(), |k| near[k], out);
            }
            Index::Graph(graph) => graph.find(
                |ids, out| offer_all(judges, features, query, ids.len(), |k| ids[k] as usize, out),
                out,
            ),
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
        // One that compares, or three.
        let mut judges = [1, 3].map(|count| (0..count).map(|_| Judge::new(am.clone())).collect::<Vec<_>>());
        let mut indices = kinds.map(|kind| Index::new(&mut judges[1], &features, settings(kind)).unwrap());
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
                for judges in &mut judges {
                    let mut near = Nearest::new(5);
                    index.find(judges, &features, &query, &mut near);
                    assert_eq!(near.found[..], all[..5], "{kind:?}, round {round}");
                }
            }
        }
        // Nothing is near a query that is not finite.
        for index in &mut indices {
            let mut near = Nearest::new(5);
            index.find(&mut judges[0], &features, &[f32::NAN; 99], &mut near);
            assert!(near.found.is_empty());
        }
    }
    #[test]
    fn many_compare_as_one_does() {
        let mut features = sheet(3000, 99);
        assert!(features.values.len() > WORTH);
        // Ties, also between those that different threads look at.
        features.values.copy_within(0..99 * 1500, 99 * 1500);
        let am = Ssd::default();
        let mut judges =
            [1, 2, 3].map(|count| (0..count).map(|_| Judge::new(am.clone())).collect::<Vec<_>>());
        for i in [0, 7, 1499] {
            let query = features.row(i).to_vec();
            let found = judges.each_mut().map(|judges| {
                let mut near = Nearest::new(4);
                Index::Linear.find(judges, &features, &query, &mut near);
                near.found
            });
            assert_eq!(found[0][..2], [(0.0, i), (0.0, i + 1500)]);
            assert!(found[1..].iter().all(|f| *f == found[0]), "sample {i}");
        }
    }
}
