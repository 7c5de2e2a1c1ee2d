//! Search methods: how the state that maximises the similarity is found.
//!
//! One file per method, in `lk` (gradient searches) or `sampled` (searches that score many states); [`SMS`] is the table that the command line, the documentation and the conformance tests read.
//! A method is generic over its appearance model and warp: `Iclk<Ssd, Homography>` is one with static types, and the
//! registry builds the same code over boxed models. May depend on everything below `registry`.

mod lk;
mod needs;
mod sampled;
mod sampling;
mod template;
mod workspace;

pub(crate) use sampled::Probe;

pub use lk::{
    AesmMethod, CoarseWarp, EsmMethod, EsmParams, FalkMethod, FclkMethod, FcsdMethod, FcsdParams,
    HaclkMethod, HesmMethod, HesmParams, Hessian, IalkMethod, IclkMethod, Kit, Lk, LkMethod, LkParams,
    MaskParams, PointRule,
};
pub use sampled::{
    Centres, Estimate, IndexKind, Likelihood, Nn, NnParams, Pf, PfParams, Regression, RegressionParams,
    Resampling, Step,
};
pub use sampling::{BorderMode, Channels, SamplingParams};
pub use template::Learning;

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
/// ESM with additive steps.
pub type Aesm<A, S> = Lk<AesmMethod, A, S>;
/// Hierarchical ESM.
pub type Hesm<A, S> = Lk<HesmMethod, A, S>;
/// Forward compositional steepest ascent.
pub type Fcsd<A, S> = Lk<FcsdMethod, A, S>;
/// FCLK with the Hessian of the ground truth.
pub type Haclk<A, S> = Lk<HaclkMethod, A, S>;

use crate::am::{AppearanceModel, Capabilities};
use crate::entry::{Entry, Family};
use crate::ilm::IlluminationModel;
use crate::params::{Assignment, Built, Use};
use crate::ssm::{SsmCapabilities, StateSpaceModel};
use crate::tracker::Tracker;

/// Every search method of the crate, in the order of the documentation.
pub const SMS: &[SmEntry] = &[
    lk::entry::<FalkMethod>(),
    lk::entry::<IalkMethod>(),
    lk::entry::<FclkMethod>(),
    lk::entry::<IclkMethod>(),
    lk::entry::<EsmMethod>(),
    lk::entry::<AesmMethod>(),
    lk::entry::<HesmMethod>(),
    lk::entry::<FcsdMethod>(),
    lk::entry::<HaclkMethod>(),
    sampled::NN,
    sampled::PF,
    sampled::REGRESSION,
];

/// Builds a tracker from assignments and its models.
pub type BuildSm =
    fn(&[Assignment<'_>], Box<dyn AppearanceModel>, Box<dyn StateSpaceModel>) -> Built<Box<dyn Tracker>>;

/// Builds a tracker from assignments, its models and one of illumination.
pub type BuildLit = fn(
    &[Assignment<'_>],
    Box<dyn AppearanceModel>,
    Box<dyn StateSpaceModel>,
    Box<dyn IlluminationModel>,
) -> Built<Box<dyn Tracker>>;

/// The family of search methods.
#[derive(Clone, Copy)]
pub struct SmFamily {
    /// What it needs, with these assignments, that an appearance model lacks, if it lacks anything.
    pub refuses: fn(&[Assignment<'_>], &Capabilities) -> Option<&'static str>,
    /// What it needs that a state space model lacks, if it lacks anything.
    pub refuses_ssm: fn(&SsmCapabilities) -> Option<&'static str>,
    /// Fails when the value of a parameter does not go with an appearance model and a state space model that are not refused;
    /// the latter has not started. What builds the tracker fails then, too.
    pub suits: fn(&[Assignment<'_>], &Capabilities, &dyn StateSpaceModel) -> Built<()>,
    /// What it uses of an appearance model: parameters that change nothing of it are refused.
    pub uses: &'static [Use],
    /// Builds a tracker that estimates the illumination as well; `None` for methods that cannot.
    pub build_lit: Option<BuildLit>,
}

impl SmFamily {
    /// A method that takes any model as it is, and estimates no illumination.
    pub const UNDEMANDING: SmFamily = SmFamily {
        refuses: |_, _| None,
        refuses_ssm: |_| None,
        suits: |_, _, _| Ok(()),
        uses: &[Use::Scores, Use::Derivatives, Use::Distances],
        build_lit: None,
    };
}

impl Family for SmFamily {
    type Build = BuildSm;
    const ROLE: &'static str = "search method";
    const GROUPED: bool = true;
}

/// A row of the table of search methods.
pub type SmEntry = Entry<SmFamily>;
