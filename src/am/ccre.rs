//! CCRE, cross-cumulative residual entropy (Wang & Vemuri 2007): mutual information with the cumulative distribution of
//! the current patch, [`super::information`] with `α = Φ`, the integral of the cubic B-spline. Smoother than MI, and not
//! symmetric.

use super::information::{Information, Kind};

/// What makes [`Information`] the cross-cumulative residual entropy.
#[derive(Clone, Copy, Debug, Default)]
pub struct CrossCumulative;

impl Kind for CrossCumulative {
    const NAME: &'static str = "ccre";
    const SUMMARY: &'static str = "cross-cumulative residual entropy, centred gradients";
    const CUMULATIVE: bool = true;
}

/// Cross-cumulative residual entropy.
pub type Ccre = Information<CrossCumulative>;
