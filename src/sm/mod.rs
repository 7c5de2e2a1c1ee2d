//! Search methods: how the state that maximises the similarity is found.
//!
//! One file per method; [`SMS`] is the table that the command line, the documentation and the conformance tests read.
//! A method is generic over its appearance model and warp: `Iclk<Ssd, Homography>` is one with static types, and the
//! registry builds the same code over boxed models. May depend on everything below `registry`.

mod esm;
mod falk;
mod fclk;
mod gradient;
mod ialk;
mod iclk;
mod kit;
mod light;
mod mask;
mod sampling;
mod workspace;

pub use esm::{EsmMethod, EsmParams};
pub use falk::FalkMethod;
pub use fclk::FclkMethod;
pub use gradient::{Hessian, Learning, Lk, LkMethod, LkParams};
pub use ialk::IalkMethod;
pub use iclk::IclkMethod;
pub use kit::Kit;
pub use mask::{MaskParams, PointRule};
pub use sampling::{BorderMode, Channels, SamplingParams};

/// Forward additive Lucas-Kanade.
pub type Falk<A, S> = Lk<FalkMethod, A, S>;
/// Inverse additive Lucas-Kanade.
pub type Ialk<A, S> = Lk<IalkMethod, A, S>;
/// Forward compositional Lucas-Kanade.
pub type Fclk<A, S> = Lk<FclkMethod, A, S>;
/// Inverse compositional Lucas-Kanade.
pub type Iclk<A, S> = Lk<IclkMethod, A, S>;
/// Efficient second-order minimisation.
pub type Esm<A, S> = Lk<EsmMethod, A, S>;

use crate::am::{AppearanceModel, Capabilities};
use crate::ilm::IlluminationModel;
use crate::params::{Assignment, Built, ParamInfo};
use crate::ssm::{SsmCapabilities, StateSpaceModel};
use crate::tracker::Tracker;

/// Every search method of the crate, in the order of the documentation.
pub const SMS: &[SmEntry] = &[
    gradient::entry::<FalkMethod>(),
    gradient::entry::<IalkMethod>(),
    gradient::entry::<FclkMethod>(),
    gradient::entry::<IclkMethod>(),
    gradient::entry::<EsmMethod>(),
];

/// Builds a tracker from assignments, its models and one of illumination.
pub type BuildLit = fn(
    &[Assignment<'_>],
    Box<dyn AppearanceModel>,
    Box<dyn StateSpaceModel>,
    Box<dyn IlluminationModel>,
) -> Built<Box<dyn Tracker>>;

/// A row of the table of search methods.
#[derive(Clone)]
pub struct SmEntry {
    /// Name.
    pub name: &'static str,
    /// Other names.
    pub aliases: &'static [&'static str],
    /// Groups that include it (`lk`, `gradient`, ...).
    pub groups: &'static [&'static str],
    /// One-line description.
    pub summary: &'static str,
    /// Parameters.
    pub params: fn() -> Vec<ParamInfo>,
    /// What it needs, with these assignments, that an appearance model lacks, if it lacks anything.
    pub refuses: fn(&[Assignment<'_>], &Capabilities) -> Option<&'static str>,
    /// What it needs that a state space model lacks, if it lacks anything.
    pub refuses_ssm: fn(&SsmCapabilities) -> Option<&'static str>,
    /// Builds the tracker from `(name, value)` assignments and its models.
    pub build:
        fn(&[Assignment<'_>], Box<dyn AppearanceModel>, Box<dyn StateSpaceModel>) -> Built<Box<dyn Tracker>>,
    /// Builds a tracker that estimates the illumination as well; `None` for methods that cannot.
    pub build_lit: Option<BuildLit>,
    /// Canonical text of a parameter after the assignments.
    pub canonical: fn(&[Assignment<'_>], &str) -> Built<Option<String>>,
}
