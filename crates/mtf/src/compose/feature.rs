//! The row of tracking by key points ([`FeatureTracker`]), which takes no members.

use super::entry::{CompositeEntry, CompositeFamily, WarpParams};
use crate::consensus::EstimatorParams;
use crate::features::{FeatureParams, FeatureTracker, MatchParams};
use crate::params::Params;
use std::sync::Arc;

type FeatureSettings = (FeatureParams, (MatchParams, (EstimatorParams, WarpParams)));

/// The table row.
pub(super) const ENTRY: CompositeEntry = CompositeEntry::new::<FeatureSettings>(
    "feature",
    "key points of the template found again in each frame, and one warp fitted to the matches",
    |a, parts| {
        let (features, (matching, (estimator, warp))) = FeatureSettings::from_assignments(a)?;
        let warp = parts.warp("ssm", &warp.ssm)?;
        Ok(Arc::new(move || {
            let (features, matching, estimator) = (features.clone(), matching.clone(), estimator.clone());
            Ok(Box::new(FeatureTracker::new(
                features,
                matching,
                estimator,
                warp.build()?,
            )))
        }))
    },
    CompositeFamily { members: (0, 0) },
)
.also(&["feat"]);
