//! `gnn` walks a graph whose nodes are linked to their nearest samples (Hajebi et al. 2011), downhill from the best of some
//! samples; `fgnn` is the same over a graph that is made from distances along the principal axes.

use super::kd::{self, Tree};
use super::{
    ALL, Asked, IndexKind, IndexRow, IndexSettings, Linear, Making, Nearest, Search, distances_of, of_each,
};
use crate::interrupt;

/// Samples from which a walk may start.
const PROBES: usize = 64;

/// The table rows.
pub(super) const GNN: IndexRow = IndexRow {
    kind: IndexKind::Gnn,
    metrics: ALL,
    memory: |settings, size| {
        let [graph, lists] = memory(settings, size.n);
        [graph, lists + size.threads * size.n * size_of::<(f32, usize)>()]
    },
    make: |making| {
        let Making {
            judges,
            features,
            settings,
        } = making;
        let n = features.count();
        let wanted = (settings.degree + 1).min(n);
        let near = of_each(judges, n, |judge, i| {
            let row = features.row(i);
            let model = distances_of(&*judge.am);
            let mut distances: Vec<(f32, usize)> = (0..n)
                .map(|j| match interrupt::requested() {
                    true => (f32::INFINITY, j),
                    false => (model.distance(row, features.row(j), f32::INFINITY), j),
                })
                .collect();
            distances.select_nth_unstable_by(wanted - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            distances[..wanted].iter().map(|d| d.1).collect()
        })?;
        interrupt::check()?;
        Ok(Box::new(Graph::new(near, settings.degree, settings.max_steps)))
    },
};

/// The same from distances along the principal axes.
pub(super) const FGNN: IndexRow = IndexRow {
    kind: IndexKind::Fgnn,
    metrics: ALL,
    memory: |settings, size| {
        let ([graph, lists], [tree, projected]) = (memory(settings, size.n), kd::memory(size));
        [graph, lists + tree + projected]
    },
    make: |making| {
        let Making {
            judges,
            features,
            settings,
        } = making;
        let Some((tree, points)) = Tree::new(features, settings.candidates, judges)? else {
            return Ok(Box::new(Linear));
        };
        let n = features.count();
        let wanted = (settings.degree + 1).min(n);
        let near = of_each(judges, n, |_, i| tree.nearest(&points[i], wanted))?;
        Ok(Box::new(Graph::new(near, settings.degree, settings.max_steps)))
    },
};

/// Bytes of the links, and of the lists they are made from.
fn memory(settings: &IndexSettings, n: usize) -> [usize; 2] {
    let links = (settings.degree + 1).min(n);
    [4 * n * (links + 2), n * (size_of::<Vec<usize>>() + 8 * links)]
}

/// Links of every sample to `degree` others.
struct Graph {
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
}

impl Search for Graph {
    fn find(&mut self, asked: &mut Asked<'_>, out: &mut Nearest) {
        let mut offer = |ids: &[u32], out: &mut Nearest| asked.offer(ids.len(), |k| ids[k] as usize, out);
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
