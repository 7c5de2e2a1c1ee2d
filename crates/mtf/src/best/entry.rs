//! The row of `best` in the table of trackers that take members: it takes none.

use super::{Best, BestParams};
use crate::compose::CompositeEntry;
use crate::params::Params;

/// `best` as the registry knows it.
pub const ENTRY: CompositeEntry = CompositeEntry::of::<BestParams>(
    "best",
    &[],
    "alignment to the template by blocks, from motion, flow, a coarse search or key points, whichever agrees",
    0..=0,
    |p, _| {
        let params = BestParams::from_assignments(p).map_err(|e| e.to_string())?;
        Ok(Box::new(Best::new(params)))
    },
);
