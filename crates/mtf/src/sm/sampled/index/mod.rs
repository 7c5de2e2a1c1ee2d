//! Indices of samples: which of many features are nearest to a query.
//!
//! A file per index with its row of [`ROWS`]. `linear` compares with all, each comparison ending early. All others compare with
//! some, by the full distance, and differ in which: those near in a k-d tree ([`kd`]), those of near clusters in a tree of means
//! ([`kmeans`]), in trees of samples ([`hierarchical`]), or on a walk over a graph ([`graph`]).

mod clusters;
mod composite;
mod graph;
mod hierarchical;
mod kd;
mod kmeans;

pub use clusters::Centres;

use crate::am::{AppearanceModel, Distances, Metric};
use crate::interrupt::{self, Interrupted};
use crate::params::{ParamValue, param_enum};
use crate::threads::in_shares;

param_enum! {
    /// How the nearest samples are found.
    pub enum IndexKind {
        /// `kd` for Euclidean features, `linear` for sums of absolute differences, else `fgnn`.
        Auto = "auto",
        /// Comparison with all.
        Linear = "linear",
        /// k-d tree over principal axes, candidates ranked by full distance.
        Kd = "kd",
        /// Tree of clusters around means.
        Kmeans = "kmeans",
        /// `kd` and `kmeans`, the nearest of both.
        Composite = "composite",
        /// Trees of clusters around samples.
        Hierarchical = "hierarchical",
        /// Graph of nearest samples.
        Gnn = "gnn",
        /// Graph of samples nearest along the principal axes.
        Fgnn = "fgnn",
    }
}

/// Every index.
const ROWS: &[IndexRow] = &[
    LINEAR,
    kd::KD,
    kmeans::KMEANS,
    composite::COMPOSITE,
    hierarchical::HIERARCHICAL,
    graph::GNN,
    graph::FGNN,
];

/// A row of the table of indices.
struct IndexRow {
    kind: IndexKind,
    /// Distances for which its neighbours are the right ones.
    metrics: &'static [Metric],
    /// Bytes kept, and those that making it takes besides.
    memory: fn(&IndexSettings, Size) -> [usize; 2],
    /// An index over the samples, of which there are two at least.
    make: fn(Making<'_>) -> Result<Box<dyn Search>, Interrupted>,
}

/// Any distances: each sample is compared by the model.
const ALL: &[Metric] = &[Metric::SquaredL2, Metric::L1, Metric::Other];

const LINEAR: IndexRow = IndexRow {
    kind: IndexKind::Linear,
    metrics: ALL,
    memory: |_, _| [0, 0],
    make: |_| Ok(Box::new(Linear)),
};

/// Samples, numbers of each, and threads that make the index.
#[derive(Clone, Copy)]
struct Size {
    n: usize,
    len: usize,
    threads: usize,
}

/// What an index is made of.
struct Making<'a> {
    judges: &'a mut [Judge],
    features: &'a Features,
    settings: &'a IndexSettings,
}

/// Offers the samples that may be nearest to a query.
trait Search: Send {
    /// Fewer than asked for where distances are not finite. The same for any number of judges.
    fn find(&mut self, asked: &mut Asked<'_>, out: &mut Nearest);
}

/// A query, and what it is compared by and with.
struct Asked<'a> {
    judges: &'a mut [Judge],
    features: &'a Features,
    query: &'a [f32],
}

impl Asked<'_> {
    /// Compares with `count` samples, `id` names them, and offers them in this order.
    fn offer(&mut self, count: usize, id: impl Fn(usize) -> usize + Sync, out: &mut Nearest) {
        offer_all(self.judges, self.features, self.query, count, id, out);
    }

    /// Distance from sample `i`, as the model has it.
    fn distance(&self, i: usize) -> f32 {
        distances_of(&*self.judges[0].am).distance(self.query, self.features.row(i), f32::INFINITY)
    }
}

/// Compares with all.
struct Linear;

impl Search for Linear {
    fn find(&mut self, asked: &mut Asked<'_>, out: &mut Nearest) {
        asked.offer(asked.features.count(), |i| i, out);
    }
}

/// What an index is made with.
#[derive(Clone, Copy)]
pub(super) struct IndexSettings {
    /// Never `Auto`.
    pub kind: IndexKind,
    /// Samples whose full distance is compared.
    pub candidates: usize,
    /// Graphs: links of each sample, most steps of a walk.
    pub degree: usize,
    pub max_steps: usize,
    /// Clusters that one is divided into, how their first centres are chosen, and from which seed.
    pub branching: usize,
    pub centres: Centres,
    pub seed: u64,
    /// k-means: iterations, and the advantage of clusters of large variance.
    pub kmeans_iters: usize,
    pub cb_index: f64,
    /// Trees of samples: how many, and the largest cluster that is not divided.
    pub trees: usize,
    pub leaf: usize,
}

impl IndexSettings {
    fn row(&self) -> &'static IndexRow {
        let mine = |row: &&IndexRow| row.kind == self.kind;
        ROWS.iter().find(mine).unwrap_or(&LINEAR)
    }

    /// Bytes that an index over `n` samples of `len` numbers keeps, and those that making it on so many threads takes
    /// besides.
    pub fn memory(&self, n: usize, len: usize, threads: usize) -> [usize; 2] {
        (self.row().memory)(self, Size { n, len, threads })
    }
}

/// Whether an index of this kind finds neighbours by distances of that kind.
pub(super) fn valid(kind: IndexKind, metric: Metric) -> bool {
    let row = ROWS.iter().find(|row| row.kind == kind);
    row.is_none_or(|row| row.metrics.contains(&metric))
}

/// Names of all kinds that do.
pub(super) fn valid_names(metric: Metric) -> String {
    let rows = ROWS.iter().filter(|row| row.metrics.contains(&metric));
    let names = rows.map(|row| row.kind.text());
    [IndexKind::Auto.text()]
        .into_iter()
        .chain(names)
        .collect::<Vec<_>>()
        .join(", ")
}

/// An index over samples.
pub(super) struct Index(Box<dyn Search>);

impl Index {
    /// One that compares with all samples.
    pub fn linear() -> Self {
        Index(Box::new(Linear))
    }

    /// Index over the samples, of which there are two at least. Where no tree can be built, a linear one.
    ///
    /// # Errors
    /// Interrupted.
    pub fn new(
        judges: &mut [Judge],
        features: &Features,
        settings: &IndexSettings,
    ) -> Result<Self, Interrupted> {
        let making = Making {
            judges,
            features,
            settings,
        };
        (settings.row().make)(making).map(Index)
    }

    /// The nearest samples to a query; fewer than asked for where distances are not finite. The same for any number of
    /// judges.
    pub fn find(&mut self, judges: &mut [Judge], features: &Features, query: &[f32], out: &mut Nearest) {
        out.found.clear();
        let mut asked = Asked {
            judges,
            features,
            query,
        };
        self.0.find(&mut asked, out);
    }
}

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
        if self.is_full() {
            self.found[self.k - 1].0
        } else {
            f32::INFINITY
        }
    }
    /// Whether there are as many as asked for.
    fn is_full(&self) -> bool {
        self.found.len() >= self.k
    }
    /// Offers what another has found.
    fn join(&mut self, other: &Nearest) {
        for &(distance, i) in &other.found {
            if !self.found.iter().any(|f| f.1 == i) {
                self.offer(distance, i);
            }
        }
    }
    /// Empties it, to find as many as `other`.
    fn reset(&mut self, other: &Nearest) {
        self.k = other.k;
        self.found.clear();
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
pub(super) struct Judge {
    am: Box<dyn AppearanceModel>,
    near: Nearest,
}

/// Numbers that must be compared before another thread is worth it; a value of a model whose distance is no sum over values
/// counts as many.
const WORTH: usize = 1 << 18;
const DEAR: usize = 32;

impl Judge {
    /// Of a model that has distances.
    pub fn new(am: impl AppearanceModel + 'static) -> Self {
        Judge {
            am: Box::new(am),
            near: Nearest::new(1),
        }
    }
}

fn distances_of(am: &dyn AppearanceModel) -> &dyn Distances {
    am.distances().expect("judges are made of models with distances")
}

/// Compares the query with `count` samples, `id` names them, and offers them in this order, whoever compares. Interrupted, it
/// leaves out the rest.
fn offer_all(
    judges: &mut [Judge],
    features: &Features,
    query: &[f32],
    count: usize,
    id: impl Fn(usize) -> usize + Sync,
    out: &mut Nearest,
) {
    let first = distances_of(&*judges[0].am);
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
        let distances = distances_of(&**am);
        for i in share.map(&id).take_while(|_| !interrupt::requested()) {
            near.offer(distances.distance(query, features.row(i), near.bound()), i);
        }
    });
    for judge in judges {
        out.join(&judge.near);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::am::{AppearanceModel, PatchShape, Sad, Ssd};
    use crate::kernels;
    use crate::params::Resolution;
    use crate::sm::NnParams;
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

    /// The settings that users start from.
    fn usual(kind: IndexKind) -> IndexSettings {
        NnParams::default().index_settings(kind, 9)
    }

    fn judges<A: AppearanceModel + Clone + 'static>(am: &A, count: usize) -> Vec<Judge> {
        (0..count).map(|_| Judge::new(am.clone())).collect()
    }

    /// A model whose template is a sample.
    fn shown<A: AppearanceModel>(mut am: A, features: &Features) -> A {
        let shape = PatchShape {
            res: Resolution { cols: 11, rows: 9 },
            channels: 1,
        };
        am.set_template(shape, features.row(3)).unwrap();
        am
    }

    /// Samples with some noise.
    fn queries(features: &Features, count: usize) -> Vec<Vec<f32>> {
        let mut rng = Pcg64::seed_from_u64(6);
        let one = |_| {
            let at = rng.random_range(0..features.count());
            let noise = |v: &f32| v + rng.random_range(-1.0f32..1.0);
            features.row(at).iter().map(noise).collect()
        };
        (0..count).map(one).collect()
    }

    /// The share of the five nearest that an index finds.
    fn recall<A>(am: &A, features: &Features, settings: &IndexSettings, queries: &[Vec<f32>]) -> f64
    where
        A: AppearanceModel + Clone + 'static,
    {
        let mut judges = judges(am, 1);
        let mut index = Index::new(&mut judges, features, settings).unwrap();
        let (mut near, mut all) = (Nearest::new(5), Nearest::new(5));
        let mut hits = 0;
        for query in queries {
            index.find(&mut judges, features, query, &mut near);
            Index::linear().find(&mut judges, features, query, &mut all);
            assert!(near.found.windows(2).all(|w| w[0].0 <= w[1].0));
            assert_eq!(near.found.len(), 5, "{:?}", settings.kind);
            hits += all.found.iter().filter(|f| near.found.contains(f)).count();
        }
        hits as f64 / (5 * queries.len()) as f64
    }

    #[test]
    fn trees_of_clusters_find_most_neighbours_and_all_without_a_limit() {
        let features = sheet(2000, 99);
        let queries = queries(&features, 200);
        let (ssd, sad) = (shown(Ssd::default(), &features), shown(Sad::default(), &features));
        let centres = [Centres::Random, Centres::Gonzales, Centres::PlusPlus];
        for kind in [IndexKind::Kmeans, IndexKind::Composite, IndexKind::Hierarchical] {
            for centres in centres {
                let few = IndexSettings {
                    centres,
                    ..usual(kind)
                };
                let all = IndexSettings {
                    candidates: 2000,
                    ..few
                };
                let share = recall(&ssd, &features, &few, &queries);
                assert!(share > 0.9, "{kind:?} {centres:?}: {share}");
                assert_eq!(
                    recall(&ssd, &features, &all, &queries),
                    1.0,
                    "{kind:?} {centres:?}"
                );
            }
        }
        // Distances that are not Euclidean.
        for kind in [IndexKind::Kd, IndexKind::Hierarchical] {
            let few = usual(kind);
            let all = IndexSettings {
                candidates: 2000,
                ..few
            };
            let share = recall(&sad, &features, &few, &queries);
            assert!(share > 0.9, "{kind:?}: {share}");
            assert_eq!(recall(&sad, &features, &all, &queries), 1.0, "{kind:?}");
        }
    }

    #[test]
    fn the_same_index_from_the_same_seed_for_any_number_of_threads() {
        let features = sheet(1500, 99);
        let queries = queries(&features, 20);
        let am = shown(Ssd::default(), &features);
        let found = |settings: &IndexSettings, threads: usize| {
            let mut judges = judges(&am, threads);
            let mut index = Index::new(&mut judges, &features, settings).unwrap();
            let mut near = Nearest::new(3);
            let one = |query: &Vec<f32>| {
                index.find(&mut judges, &features, query, &mut near);
                near.found.clone()
            };
            queries.iter().map(one).collect::<Vec<_>>()
        };
        for row in ROWS {
            // So few comparisons that the seed can be told from the answers.
            let settings = IndexSettings {
                candidates: 3,
                leaf: 4,
                trees: 1,
                ..usual(row.kind)
            };
            assert_eq!(found(&settings, 1), found(&settings, 3), "{:?}", row.kind);
        }
        for kind in [IndexKind::Kmeans, IndexKind::Hierarchical] {
            let settings = IndexSettings {
                candidates: 3,
                leaf: 4,
                trees: 1,
                ..usual(kind)
            };
            let other = IndexSettings { seed: 10, ..settings };
            assert_ne!(found(&settings, 1), found(&other, 1), "{kind:?}");
        }
    }

    #[test]
    fn samples_that_are_all_alike_make_an_index() {
        let features = Features {
            values: vec![7.0; 99 * 300],
            len: 99,
        };
        let am = shown(Ssd::default(), &sheet(4, 99));
        for row in ROWS {
            for centres in [Centres::Random, Centres::Gonzales, Centres::PlusPlus] {
                let settings = IndexSettings {
                    centres,
                    ..usual(row.kind)
                };
                let mut judges = judges(&am, 1);
                let mut index = Index::new(&mut judges, &features, &settings).unwrap();
                let mut near = Nearest::new(2);
                index.find(&mut judges, &features, &[7.0; 99], &mut near);
                assert_eq!(near.found.len(), 2, "{:?}", row.kind);
                index.find(&mut judges, &features, &[f32::NAN; 99], &mut near);
                assert!(near.found.is_empty(), "{:?}", row.kind);
            }
        }
    }

    #[test]
    fn every_kind_but_auto_has_a_row() {
        let all = IndexKind::allowed();
        let rows: Vec<String> = ROWS.iter().map(|row| row.kind.text()).collect();
        assert_eq!(all, format!("auto, {}", rows.join(", ")));
        assert_eq!(valid_names(Metric::SquaredL2), all);
        assert_eq!(
            valid_names(Metric::L1),
            "auto, linear, kd, hierarchical, gnn, fgnn"
        );
        assert_eq!(
            valid_names(Metric::Other),
            "auto, linear, hierarchical, gnn, fgnn"
        );
        assert!(valid(IndexKind::Auto, Metric::Other) && !valid(IndexKind::Kmeans, Metric::L1));
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
            candidates: 40,
            degree: 60,
            max_steps: 20,
            ..usual(kind)
        };
        let kinds = [IndexKind::Linear, IndexKind::Kd, IndexKind::Gnn, IndexKind::Fgnn];
        assert!(
            kd::Tree::new(&features, 40, &[Judge::new(am.clone())])
                .unwrap()
                .is_some()
        );
        // One that compares, or three.
        let mut judges = [1, 3].map(|count| (0..count).map(|_| Judge::new(am.clone())).collect::<Vec<_>>());
        let mut indices = kinds.map(|kind| Index::new(&mut judges[1], &features, &settings(kind)).unwrap());
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
                Index::linear().find(judges, &features, &query, &mut near);
                near.found
            });
            assert_eq!(found[0][..2], [(0.0, i), (0.0, i + 1500)]);
            assert!(found[1..].iter().all(|f| *f == found[0]), "sample {i}");
        }
    }
}
