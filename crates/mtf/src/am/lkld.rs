//! LKLD, localised Kullback-Leibler divergence: the sum over overlapping regions of the patch, [`super::divergence`]. Sees
//! roughly where gray values are, still too little to track a homography alone.

use super::divergence::{Divergence, DivergenceKind, DivergenceSettings};

crate::params! {
    /// Parameters of [`Lkld`].
    pub struct LkldParams {
        /// Histogram bins.
        n_bins: usize = 8, in 4..=64;
        /// Count added to every bin before normalising.
        pre_seed: f64 = 10.0, in 1e-3..=1e6;
        /// Regions along each side of the patch.
        regions: usize = 3, in 1..=50;
        /// Samples from one region to the next (at most the side over the number of regions plus one).
        spacing: usize = 10, in 1..=1000;
        /// Damping of the Hessians by J'J, as a multiple of the mean curvature per value.
        damping: f64 = 10.0, in 0.0..=1e6;
        /// Likelihood exp(alpha f / regions²): alpha.
        likelihood_alpha: f64 = 50.0, in 0.0..=1e6;
    }
}

/// What makes [`Divergence`] that of regions.
#[derive(Clone, Copy, Debug, Default)]
pub struct Localised;

impl DivergenceKind for Localised {
    type Params = LkldParams;
    const NAME: &'static str = "lkld";
    const SUMMARY: &'static str = "Kullback-Leibler divergence summed over regions (does not track alone)";
    fn settings(p: &LkldParams) -> DivergenceSettings {
        DivergenceSettings {
            bins: p.n_bins,
            seed: p.pre_seed,
            damping: p.damping,
            likelihood_alpha: p.likelihood_alpha,
            regions: p.regions,
            spacing: p.spacing,
        }
    }
}

/// Localised Kullback-Leibler divergence.
pub type Lkld = Divergence<Localised>;
