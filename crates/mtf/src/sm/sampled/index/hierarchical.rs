//! `hierarchical`: trees of clusters around some of the samples (Muja & Lowe 2012). Distances are those of the model alone, so
//! that any will do, the sample around which a cluster lies in the template's role.

use super::clusters::{Clusters, Groups, bytes, choose, expected_nodes};
use super::{
    ALL, Asked, Features, IndexKind, IndexRow, IndexSettings, Judge, Making, Nearest, Search, Size,
    distances_of, of_each,
};
use crate::interrupt::Interrupted;
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// The table row.
pub(super) const HIERARCHICAL: IndexRow = IndexRow {
    kind: IndexKind::Hierarchical,
    metrics: ALL,
    memory: |settings, Size { n, .. }| {
        let IndexSettings {
            trees,
            leaf,
            branching,
            ..
        } = *settings;
        let nodes = trees * expected_nodes(n, branching, |size| size > leaf);
        [bytes(nodes, n, trees, size_of::<u32>()), 32 * n]
    },
    make: |making| {
        let Making {
            judges,
            features,
            settings,
        } = making;
        let mut rng = Pcg64::seed_from_u64(settings.seed);
        let divide = |members: &[u32]| divide(judges, features, settings, &mut rng, members);
        Ok(Box::new(Hierarchical {
            clusters: Clusters::new(features.count(), settings.trees, divide)?,
            candidates: settings.candidates,
        }))
    },
};

/// Trees whose pivots are samples.
struct Hierarchical {
    clusters: Clusters<u32>,
    candidates: usize,
}

/// Clusters larger than a leaf are divided: each sample goes to the nearest of some of them.
fn divide(
    judges: &mut [Judge],
    features: &Features,
    settings: &IndexSettings,
    rng: &mut Pcg64,
    members: &[u32],
) -> Result<Groups<u32>, Interrupted> {
    if members.len() <= settings.leaf {
        return Ok(Groups::none());
    }
    let row = |i: u32| features.row(i as usize);
    let pivots = choose(settings.centres, members, settings.branching, rng, |i| {
        of_each(judges, members.len(), |judge, m| {
            distances_of(&*judge.am).distance(row(members[m]), row(i), f32::INFINITY)
        })
    })?;
    let assigned = of_each(judges, members.len(), |judge, m| {
        let distances = distances_of(&*judge.am);
        let (mut best, mut least) = (0, f32::INFINITY);
        for (k, &i) in pivots.iter().enumerate() {
            let d = distances.distance(row(members[m]), row(i), least);
            if d < least {
                (best, least) = (k, d);
            }
        }
        best
    })?;
    Ok(Groups::new(members, &assigned, pivots))
}

impl Search for Hierarchical {
    fn find(&mut self, asked: &mut Asked<'_>, out: &mut Nearest) {
        let reach = |asked: &Asked<'_>, &pivot: &u32| {
            let d = asked.distance(pivot as usize);
            (d, d)
        };
        self.clusters.find(asked, self.candidates, reach, out);
    }
}
