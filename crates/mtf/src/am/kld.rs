//! KLD, Kullback-Leibler divergence of the patches' gray value histograms, [`super::divergence`] with one region. Positions
//! do not enter: a member of sums of models and a measure for sampling searches, not a tracker of its own.
//!
//! The original maximises the divergence; here `f` is its negative.

use super::divergence::{Divergence, DivergenceKind, DivergenceSettings};

crate::params! {
    /// Parameters of [`Kld`].
    pub struct KldParams {
        /// Histogram bins.
        n_bins: usize = 8, in 4..=64;
        /// Count added to every bin before normalising.
        pre_seed: f64 = 10.0, in 1e-3..=1e6;
        /// Damping of the Hessians by J'J, as a multiple of the mean curvature per value.
        damping: f64 = 10.0, in 0.0..=1e6;
        /// Likelihood exp(alpha f): alpha.
        likelihood_alpha: f64 = 50.0, in 0.0..=1e6;
    }
}

/// What makes [`Divergence`] that of whole patches.
#[derive(Clone, Copy, Debug, Default)]
pub struct Whole;

impl DivergenceKind for Whole {
    type Params = KldParams;
    const NAME: &'static str = "kld";
    const SUMMARY: &'static str = "Kullback-Leibler divergence of histograms (does not track alone)";
    fn settings(p: &KldParams) -> DivergenceSettings {
        DivergenceSettings {
            bins: p.n_bins,
            seed: p.pre_seed,
            damping: p.damping,
            likelihood_alpha: p.likelihood_alpha,
            regions: 1,
            spacing: 0,
        }
    }
}

/// Kullback-Leibler divergence.
pub type Kld = Divergence<Whole>;
