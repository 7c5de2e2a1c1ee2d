//! Searches that compare patches at many states, without derivatives: nearest neighbours, particles, learned regression.
//!
//! A file per method; `probe` is the models looking at an image, which all of them use. May depend on all below search
//! methods and on the searches' sampling.

mod deviations;
mod index;
mod nn;
mod pf;
mod probe;
mod regression;
mod resample;
mod ridge;
mod step;

pub use index::{Centres, IndexKind};
pub use nn::{Nn, NnParams};
pub use pf::{Estimate, Likelihood, Pf, PfParams};
pub(crate) use probe::Probe;
pub use regression::{Regression, RegressionParams};
pub use resample::Resampling;
pub use step::Step;

pub(super) const NN: super::SmEntry = nn::ENTRY;
pub(super) const PF: super::SmEntry = pf::ENTRY;
pub(super) const REGRESSION: super::SmEntry = regression::ENTRY;
