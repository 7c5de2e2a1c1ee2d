//! The row of `best` in the table of trackers that take members: it takes none.

use super::{Best, BestParams};
#[cfg(feature = "ablation")]
use crate::compose::Refused;
use crate::compose::{CompositeEntry, CompositeFamily};
use crate::params::Params;
use std::sync::Arc;

/// `best` as the registry knows it.
pub const ENTRY: CompositeEntry = CompositeEntry::new::<BestParams>(
    "best",
    "alignment to the template by blocks, from motion, flow, a coarse search or key points, whichever agrees",
    |a, _| {
        #[cfg(feature = "ablation")]
        super::constants::check().map_err(|e| Refused::Unfit(e.to_string()))?;
        let params = BestParams::from_assignments(a)?;
        Ok(Arc::new(move || Ok(Box::new(Best::new(params.clone())))))
    },
    CompositeFamily { members: (0, 0) },
);
