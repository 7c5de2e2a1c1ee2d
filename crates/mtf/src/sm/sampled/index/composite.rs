//! `composite`: a k-d tree and a tree of means, the nearest that either finds (Muja & Lowe 2009).

use super::kmeans::{self, Kmeans};
use super::{Asked, IndexKind, IndexRow, Making, Nearest, Search, kd};
use crate::am::Metric;

/// The table row.
pub(super) const COMPOSITE: IndexRow = IndexRow {
    kind: IndexKind::Composite,
    metrics: &[Metric::SquaredL2],
    memory: |settings, size| {
        let (tree, means) = (kd::memory(size), kmeans::memory(settings, size));
        [tree[0] + means[0], tree[1].max(means[1])]
    },
    make: |making| {
        let Making {
            judges,
            features,
            settings,
        } = making;
        let first = (kd::KD.make)(Making {
            judges: &mut *judges,
            features,
            settings,
        })?;
        let second = Kmeans::new(Making {
            judges,
            features,
            settings,
        })?;
        Ok(Box::new(Composite {
            first,
            second,
            more: Nearest::new(1),
        }))
    },
};

struct Composite {
    first: Box<dyn Search>,
    second: Kmeans,
    /// What the second finds.
    more: Nearest,
}

impl Search for Composite {
    fn find(&mut self, asked: &mut Asked<'_>, out: &mut Nearest) {
        self.first.find(asked, out);
        self.more.reset(out);
        self.second.find(asked, &mut self.more);
        out.join(&self.more);
    }
}
