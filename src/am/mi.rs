//! MI, mutual information (Viola & Wells 1997; Dowson & Bowden 2008): joint histogram of both patches with cubic B-spline
//! windows, [`super::information`] with `α = β`. Largest when the one patch tells most about the other, whatever the
//! relation: gain, inversion, gamma.
//!
//! The Hessians subtract the outer products of the *marginal* sums, `Σ_k γ_k γ_k'/p_k`; subtracting `Σ_kl γ_kl γ_kl'/p_k`, as
//! the literature often does, is not the derivative of the gradient.

use super::information::{Information, Kind};

/// What makes [`Information`] mutual information.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mutual;

impl Kind for Mutual {
    const NAME: &'static str = "mi";
    const SUMMARY: &'static str = "mutual information, centred gradients";
    const CUMULATIVE: bool = false;
}

/// Mutual information.
pub type Mi = Information<Mutual>;
