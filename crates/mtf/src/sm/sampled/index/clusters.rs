//! Trees of clusters: samples divided into groups around pivots, the groups divided again.
//!
//! A search goes down to the cluster whose pivot is nearest, remembers those that it passes by, and goes on with the most
//! promising of them until it has compared as many samples as it may (Muja & Lowe 2009, 2014). Without that limit it
//! compares all.

use super::{Asked, Nearest};
use crate::interrupt::{self, Interrupted};
use crate::params::param_enum;
use rand::RngExt;
use rand_pcg::Pcg64;
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::Range;

param_enum! {
    /// How the first centres of clusters are chosen among the samples.
    pub enum Centres {
        /// At random.
        Random = "random",
        /// One at random, then each the farthest from those before (Gonzales 1985).
        Gonzales = "gonzales",
        /// One at random, then each with a probability that grows with the distance from those before, as k-means++ has it
        /// (Arthur & Vassilvitskii 2007).
        PlusPlus = "kmeanspp",
    }
}

/// `k` of the members, or all if they are fewer. `distances` gives those of the members, in order, from one of them.
pub(super) fn choose(
    how: Centres,
    members: &[u32],
    k: usize,
    rng: &mut Pcg64,
    mut distances: impl FnMut(u32) -> Result<Vec<f32>, Interrupted>,
) -> Result<Vec<u32>, Interrupted> {
    let k = k.min(members.len());
    let mut draw = |from: usize| rng.random_range(from as u32..members.len() as u32) as usize;
    if how == Centres::Random {
        let mut pool = members.to_vec();
        (0..k).for_each(|i| pool.swap(i, draw(i)));
        pool.truncate(k);
        return Ok(pool);
    }
    let first = draw(0);
    let mut chosen = vec![members[first]];
    let mut nearest = distances(members[first])?;
    let mut taken = vec![false; members.len()];
    taken[first] = true;
    while chosen.len() < k {
        // Distances may be negative: those of some models are similarities turned round.
        let open = || (0..members.len()).filter(|&i| !taken[i] && nearest[i].is_finite());
        let least = nearest
            .iter()
            .filter(|d| d.is_finite())
            .fold(f32::INFINITY, |a, &b| a.min(b));
        let next = match how {
            Centres::PlusPlus => {
                let total: f64 = open().map(|i| f64::from(nearest[i] - least)).sum();
                let mut left = total * rng.random::<f64>();
                open().find(|&i| {
                    left -= f64::from(nearest[i] - least);
                    left < 0.0
                })
            }
            _ => None,
        };
        let farthest = || open().reduce(|a, b| if nearest[b] > nearest[a] { b } else { a });
        let Some(next) = next.or_else(farthest) else { break };
        taken[next] = true;
        chosen.push(members[next]);
        for (d, new) in nearest.iter_mut().zip(distances(members[next])?) {
            *d = d.min(new);
        }
    }
    Ok(chosen)
}

/// Groups of samples, none of them empty, and their pivots.
pub(super) struct Groups<P> {
    members: Vec<Vec<u32>>,
    pivots: Vec<P>,
}

impl<P> Groups<P> {
    /// A cluster that is not divided.
    pub fn none() -> Self {
        Groups {
            members: Vec::new(),
            pivots: Vec::new(),
        }
    }

    /// Of members with the number of the pivot each belongs to.
    pub fn new(members: &[u32], assigned: &[usize], pivots: Vec<P>) -> Self {
        let mut groups = vec![Vec::new(); pivots.len()];
        members
            .iter()
            .zip(assigned)
            .for_each(|(&i, &k)| groups[k].push(i));
        let all = groups.into_iter().zip(pivots).filter(|(g, _)| !g.is_empty());
        let (members, pivots) = all.unzip();
        Groups { members, pivots }
    }
}

struct Node {
    /// Clusters it is divided into; none for a leaf.
    children: Range<usize>,
    /// Place of its samples in the order.
    members: Range<usize>,
}

/// A cluster that a search may go on with, the least priority number first, of equal ones that of the older cluster.
struct Branch {
    priority: f32,
    node: usize,
}

impl Ord for Branch {
    fn cmp(&self, other: &Self) -> Ordering {
        let reversed = other.priority.total_cmp(&self.priority);
        reversed.then(other.node.cmp(&self.node))
    }
}
impl PartialOrd for Branch {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl PartialEq for Branch {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Branch {}

/// Trees of clusters around pivots `P` over the same samples.
pub(super) struct Clusters<P> {
    nodes: Vec<Node>,
    pivots: Vec<P>,
    roots: Vec<usize>,
    /// Samples, those of a cluster side by side.
    order: Vec<u32>,
    branches: BinaryHeap<Branch>,
    /// Search in which each sample was compared last.
    seen: Vec<u32>,
    search: u32,
    /// Samples to compare next.
    next: Vec<u32>,
}

impl<P: Default> Clusters<P> {
    /// Of `n` samples, one tree.
    ///
    /// # Errors
    /// Interrupted.
    pub fn new(
        n: usize,
        trees: usize,
        mut divide: impl FnMut(&[u32]) -> Result<Groups<P>, Interrupted>,
    ) -> Result<Self, Interrupted> {
        let (mut nodes, mut pivots, mut order) = (Vec::new(), Vec::new(), Vec::new());
        let mut roots = Vec::new();
        for tree in 0..trees {
            let mut at = nodes.len();
            roots.push(at);
            pivots.push(P::default());
            order.extend(0..n as u32);
            nodes.push(Node {
                children: 0..0,
                members: tree * n..(tree + 1) * n,
            });
            while at < nodes.len() {
                interrupt::check()?;
                let Range { start, end } = nodes[at].members;
                let groups = divide(&order[start..end])?;
                if groups.members.len() > 1 {
                    let first = nodes.len();
                    let mut start = start;
                    for group in groups.members {
                        let members = start..start + group.len();
                        start = members.end;
                        order[members.clone()].copy_from_slice(&group);
                        nodes.push(Node {
                            children: 0..0,
                            members,
                        });
                    }
                    pivots.extend(groups.pivots);
                    nodes[at].children = first..nodes.len();
                }
                at += 1;
            }
        }
        Ok(Clusters {
            branches: BinaryHeap::with_capacity(nodes.len()),
            nodes,
            pivots,
            roots,
            order,
            seen: vec![0; n],
            search: 0,
            next: Vec::with_capacity(n),
        })
    }
}

impl<P> Clusters<P> {
    /// Offers samples, cluster by cluster, until `limit` have been compared and as many as asked for found. `reach` tells how
    /// far a pivot is and with what priority, the least first, its cluster is looked at later.
    pub fn find(
        &mut self,
        asked: &mut Asked<'_>,
        limit: usize,
        reach: impl Fn(&Asked<'_>, &P) -> (f32, f32),
        out: &mut Nearest,
    ) {
        self.search = self.search.wrapping_add(1);
        self.branches.clear();
        let mut compared = 0;
        let enough = |compared: usize, out: &Nearest| compared >= limit && out.is_full();
        for tree in 0..self.roots.len() {
            self.descend(self.roots[tree], asked, &reach, &mut compared, enough, out);
        }
        while !enough(compared, out) && !interrupt::requested() {
            let Some(branch) = self.branches.pop() else { break };
            self.descend(branch.node, asked, &reach, &mut compared, enough, out);
        }
    }

    /// From a cluster to the leaf that is nearest at each fork, whose samples are compared.
    fn descend(
        &mut self,
        mut at: usize,
        asked: &mut Asked<'_>,
        reach: &impl Fn(&Asked<'_>, &P) -> (f32, f32),
        compared: &mut usize,
        enough: impl Fn(usize, &Nearest) -> bool,
        out: &mut Nearest,
    ) {
        while !self.nodes[at].children.is_empty() {
            let (mut nearest, mut least, mut passed) = (None, f32::INFINITY, 0.0);
            for node in self.nodes[at].children.clone() {
                let (distance, priority) = reach(asked, &self.pivots[node]);
                let other = match nearest {
                    Some(before) if distance < least => Some((before, passed)),
                    Some(_) => Some((node, priority)),
                    None => None,
                };
                if let Some((node, priority)) = other {
                    self.branches.push(Branch { priority, node });
                }
                if nearest.is_none() || distance < least {
                    (nearest, least, passed) = (Some(node), distance, priority);
                }
            }
            let Some(node) = nearest else { return };
            at = node;
        }
        if enough(*compared, out) {
            return;
        }
        self.next.clear();
        for &i in &self.order[self.nodes[at].members.clone()] {
            if self.seen[i as usize] != self.search {
                self.seen[i as usize] = self.search;
                self.next.push(i);
            }
        }
        *compared += self.next.len();
        let next = &self.next;
        asked.offer(next.len(), |k| next[k] as usize, out);
    }
}

/// Clusters of trees that are divided evenly, while `divides` says so of their size.
pub(super) fn expected_nodes(n: usize, branching: usize, divides: impl Fn(usize) -> bool) -> usize {
    let (mut nodes, mut clusters, mut size) = (1, 1_usize, n);
    while divides(size) && size > 1 {
        clusters = clusters.saturating_mul(branching).min(n);
        nodes += clusters;
        size /= branching;
    }
    nodes
}

/// Bytes of trees with so many clusters over `n` samples, pivots of `pivot` bytes.
pub(super) fn bytes(nodes: usize, n: usize, trees: usize, pivot: usize) -> usize {
    nodes * (size_of::<Node>() + size_of::<Branch>() + pivot) + 4 * n * (trees + 2)
}
