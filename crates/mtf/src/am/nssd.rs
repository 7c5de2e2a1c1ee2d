//! NSSD, SSD of patches scaled to another range of intensities.
//!
//! `x̃ = norm_min + k x`, `k = (norm_max - norm_min)/255`; `f = -½ Σ (Ĩ_i - T̃_i)² = k²` times that of [`super::Ssd`], and
//! so are all its derivatives. The optimum and every step of a search are SSD's; likelihoods, damping and sums of
//! models see the range.

use super::ssd::{Squares, SquaresKind, SquaresSettings};
use super::weights::Robust;

crate::params! {
    /// Parameters of [`Nssd`].
    pub struct NssdParams {
        /// Loss of single differences: none (squares), huber or tukey (M-estimators, scaled by the median difference).
        robust: Robust = Robust::None;
        /// What gray level 0 becomes.
        norm_min: f64 = 0.0, in -1e4..=0.0;
        /// What gray level 255 becomes.
        norm_max: f64 = 1.0, in 1e-3..=1e4;
        /// Likelihood exp(-alpha sqrt(-f/n)) of n values: alpha, per normalised gray level.
        likelihood_alpha: f64 = 500.0, in 0.0..=1e6;
    }
}

/// What makes [`Squares`] NSSD: intensities scaled to a range.
#[derive(Clone, Copy, Debug)]
pub struct Scaled;

impl SquaresKind for Scaled {
    type Params = NssdParams;
    const NAME: &'static str = "nssd";
    const SUMMARY: &'static str = "sum of squared differences of patches scaled to a range";
    fn settings(p: &NssdParams) -> SquaresSettings {
        SquaresSettings {
            robust: p.robust,
            scale: (p.norm_max - p.norm_min) / 255.0,
            likelihood_alpha: p.likelihood_alpha,
        }
    }
}

/// Sum of squared differences of scaled patches.
pub type Nssd = Squares<Scaled>;
