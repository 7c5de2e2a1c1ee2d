//! `kmeans`: a tree of clusters around means (Muja & Lowe 2009), each divided by Lloyd's iterations; for Euclidean features.

use super::clusters::{Clusters, Groups, bytes, choose, expected_nodes};
use super::{
    Asked, Features, IndexKind, IndexRow, IndexSettings, Judge, Making, Nearest, Search, Size, of_each,
};
use crate::am::Metric;
use crate::interrupt::Interrupted;
use crate::kernels;
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// The table row.
pub(super) const KMEANS: IndexRow = IndexRow {
    kind: IndexKind::Kmeans,
    metrics: &[Metric::SquaredL2],
    memory,
    make: |making| Ok(Box::new(Kmeans::new(making)?)),
};

/// Bytes kept, and those that making it takes besides.
pub(super) fn memory(settings: &IndexSettings, Size { n, len, .. }: Size) -> [usize; 2] {
    let branching = settings.branching;
    let nodes = expected_nodes(n, branching, |size| size >= branching);
    let kept = bytes(nodes, n, 1, size_of::<Ball>() + 4 * len);
    [kept, 2 * branching.min(n) * 4 * len + 32 * n]
}

/// Mean of a cluster, and the mean squared distance of its samples from it.
#[derive(Default)]
struct Ball {
    centre: Vec<f32>,
    variance: f32,
}

/// Tree of means.
pub(super) struct Kmeans {
    clusters: Clusters<Ball>,
    candidates: usize,
    cb_index: f32,
}

impl Kmeans {
    pub fn new(making: Making<'_>) -> Result<Self, Interrupted> {
        let Making {
            judges,
            features,
            settings,
        } = making;
        let mut rng = Pcg64::seed_from_u64(settings.seed);
        let divide = |members: &[u32]| divide(judges, features, settings, &mut rng, members);
        Ok(Kmeans {
            clusters: Clusters::new(features.count(), 1, divide)?,
            candidates: settings.candidates,
            cb_index: settings.cb_index as f32,
        })
    }
}

/// Squared distance of each member from sample `i`.
fn distances_from(
    judges: &mut [Judge],
    features: &Features,
    members: &[u32],
    i: u32,
) -> Result<Vec<f32>, Interrupted> {
    let from = features.row(i as usize);
    of_each(judges, members.len(), |_, m| {
        kernels::squared_distance(features.row(members[m] as usize), from, f32::INFINITY)
    })
}

/// Clusters of at least as many samples as they would be divided into are.
fn divide(
    judges: &mut [Judge],
    features: &Features,
    settings: &IndexSettings,
    rng: &mut Pcg64,
    members: &[u32],
) -> Result<Groups<Ball>, Interrupted> {
    if members.len() < settings.branching {
        return Ok(Groups::none());
    }
    let row = |m: usize| features.row(members[m] as usize);
    let chosen = choose(settings.centres, members, settings.branching, rng, |i| {
        distances_from(judges, features, members, i)
    })?;
    let mut balls: Vec<Ball> = chosen
        .iter()
        .map(|&i| Ball {
            centre: features.row(i as usize).to_vec(),
            variance: 0.0,
        })
        .collect();
    let mut assigned = nearest(judges, &balls, members.len(), row)?;
    for _ in 0..settings.kmeans_iters {
        means(&mut balls, &assigned, row);
        let next = nearest(judges, &balls, members.len(), row)?;
        if next == assigned {
            break;
        }
        assigned = next;
    }
    means(&mut balls, &assigned, row);
    Ok(Groups::new(members, &assigned, balls))
}

/// Number of the centre that is nearest to each row; of equal ones the first.
fn nearest<'a>(
    judges: &mut [Judge],
    balls: &[Ball],
    count: usize,
    row: impl Fn(usize) -> &'a [f32] + Sync,
) -> Result<Vec<usize>, Interrupted> {
    of_each(judges, count, |_, m| {
        let (mut best, mut least) = (0, f32::INFINITY);
        for (k, ball) in balls.iter().enumerate() {
            let d = kernels::squared_distance(row(m), &ball.centre, least);
            if d < least {
                (best, least) = (k, d);
            }
        }
        best
    })
}

/// Moves each centre to the mean of its rows, if it has any.
fn means<'a>(balls: &mut [Ball], assigned: &[usize], row: impl Fn(usize) -> &'a [f32]) {
    let mut counts = vec![0_usize; balls.len()];
    assigned.iter().for_each(|&k| counts[k] += 1);
    for (ball, _) in balls.iter_mut().zip(&counts).filter(|(_, n)| **n > 0) {
        ball.centre.fill(0.0);
        ball.variance = 0.0;
    }
    for (m, &k) in assigned.iter().enumerate() {
        kernels::add_scaled(1.0 / counts[k] as f32, row(m), &mut balls[k].centre);
    }
    for (m, &k) in assigned.iter().enumerate() {
        let d = kernels::squared_distance(row(m), &balls[k].centre, f32::INFINITY);
        balls[k].variance += d / counts[k] as f32;
    }
}

impl Search for Kmeans {
    fn find(&mut self, asked: &mut Asked<'_>, out: &mut Nearest) {
        let cb_index = self.cb_index;
        let reach = |asked: &Asked<'_>, ball: &Ball| {
            let d = kernels::squared_distance(asked.query, &ball.centre, f32::INFINITY);
            (d, d - cb_index * ball.variance)
        };
        self.clusters.find(asked, self.candidates, reach, out);
    }
}
