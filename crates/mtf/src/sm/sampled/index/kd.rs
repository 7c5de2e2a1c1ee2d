//! `kd`: candidates in a k-d tree (Bentley 1975) over the sixteen principal axes of the samples, ranked by their full
//! distance.

use super::{Asked, Features, IndexKind, IndexRow, Judge, Linear, Nearest, Search, Size, of_each};
use crate::am::Metric;
use crate::interrupt::{self, Interrupted};
use crate::kernels;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZero;

/// Principal axes kept.
const AXES: usize = 16;
/// Samples that determine them, and rounds of subspace iteration.
const AXIS_SAMPLES: usize = 512;
const ROUNDS: usize = 3;

/// The table row.
pub(super) const KD: IndexRow = IndexRow {
    kind: IndexKind::Kd,
    metrics: &[Metric::SquaredL2, Metric::L1],
    memory: |_, size| memory(size),
    make: |making| {
        let tree = Tree::new(making.features, making.settings.candidates, making.judges)?;
        Ok(match tree {
            Some((tree, _)) => Box::new(tree),
            None => Box::new(Linear),
        })
    },
};

/// Bytes kept, and those that making it takes besides.
pub(super) fn memory(size: Size) -> [usize; 2] {
    let Size { n, len, threads } = size;
    let (axes, points) = (4 * (AXES + 2) * len, 4 * AXES * n);
    [axes + 4 * (AXES + 1) * n, 2 * points + threads * axes]
}

/// Projection onto the principal axes of samples.
#[derive(Clone)]
struct Axes {
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
    /// With what each sample is along the axes, if a tree can be built. Made by as many threads as there are judges.
    pub fn new(
        features: &Features,
        candidates: usize,
        judges: &[Judge],
    ) -> Result<Option<(Self, Vec<[f32; AXES]>)>, Interrupted> {
        let axes = Axes::of(features)?;
        let mut each = vec![axes.clone(); judges.len()];
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
    pub fn nearest(&self, point: &[f32; AXES], count: usize) -> Vec<usize> {
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

impl Search for Tree {
    fn find(&mut self, asked: &mut Asked<'_>, out: &mut Nearest) {
        let count = self.candidates.max(2 * out.k).min(asked.features.count());
        let point = self.axes.project(asked.query);
        let near = self.nearest(&point, count);
        asked.offer(near.len(), |k| near[k], out);
    }
}
