//! Appearance models: how similar two patches are, and how that changes with their pixels.
//!
//! One file per model; [`AMS`] is the table that the command line, the documentation and the conformance tests read.
//! May depend on `kernels`, `params`, `tracker` and `geom::solve`, never on warps or search methods: a search method
//! hands over patches (raw intensities, 0–255) and Jacobians, and gets back gradients and Hessians.
//!
//! # Conventions
//!
//! `f(T, I)` is a *similarity* (larger is better) of the template patch `T` and the current patch `I`, both of length
//! `n = points x channels`, channel-planar (`value[c * points + i]`). All derivatives are with respect to the **raw**
//! pixel values: a model that normalises its patches (ZNCC's 1/σ, a histogram's bin scale) includes that factor, so
//! `J = d(raw value)/dp` serves every model. The numbers below are those of the paper's table of AM functions:
//! 1 sampling is done by the search method for all models alike ([`crate::sm`]), 2 and 3 (image gradient and Hessian)
//! by `kernels::sample`; 4 is [`similarity`](AppearanceModel::similarity); 5 and 6 are
//! [`gradient_into`](Derivatives::gradient_into); 7 and 8 its product with a Jacobian; 9 their difference; 10 and
//! 11 [`hessian_into`](Derivatives::hessian_into); 12 [`self_hessian_into`](Derivatives::self_hessian_into);
//! 13 the sum of 10 and 11. Their second-order forms add `Σ_i f_t[i] K_i`, which the warp contributes
//! ([`crate::ssm::SecondOrder`]).
//!
//! Models whose gradient does not vanish at perfect alignment return centred gradients and the matching mixed Hessian
//! from the same methods, so that no search method knows the difference.

mod bank;
mod ccre;
mod dfm;
mod divergence;
mod information;
mod kld;
mod lkld;
mod mi;
mod model;
mod ncc;
mod network;
mod ngf;
mod nssd;
mod patch_features;
mod pca;
mod riu;
mod sad;
mod scv;
mod spss;
mod ssd;
mod ssim;
mod standard;
mod sum;
mod tone;
mod weights;
mod zncc;

pub use bank::OrientedBank;
pub use ccre::{Ccre, CcreParams, CrossCumulative};
pub use dfm::{Dfm, DfmParams};
pub use divergence::{Divergence, DivergenceKind, DivergenceSettings};
pub use information::{Information, InformationSettings, Kind as InformationKind};
pub use kld::{Kld, KldParams, Whole};
pub use lkld::{Lkld, LkldParams, Localised};
pub use mi::{Mi, MiParams, Mutual};
pub use model::{
    AppearanceModel, Capabilities, Curvature, Derivatives, Distances, Learner, Masking, Metric, Normal,
    PatchShape, PerFrame, Properties, Reference, SelfGradient, Side, begin_frame,
};
pub use ncc::Ncc;
pub use network::{Network, NetworkError};
pub use ngf::{Ngf, NgfParams};
pub use nssd::{Nssd, NssdParams, Scaled};
pub use patch_features::PatchFeatures;
pub use pca::Pca;
pub use riu::Riu;
pub use sad::Sad;
pub use scv::{ConditionalVariance, Lrscv, Lscv, Rscv, Scv};
pub use spss::Spss;
pub use ssd::{Squares, SquaresKind, SquaresSettings, Ssd, SsdParams, Unscaled};
pub use ssim::Ssim;
pub use sum::Sum;
pub use weights::Robust;
pub use zncc::Zncc;

use crate::entry::{Build, Entry, Family, NameOf, Part};
use crate::params::{Assignment, Built, Params};

/// Every appearance model of the crate, in the order of the documentation.
pub const AMS: &[AmEntry] = &[
    AmEntry::of::<Ssd>(),
    AmEntry::of::<Nssd>(),
    AmEntry::of::<Sad>(),
    AmEntry::of::<Zncc>(),
    AmEntry::of::<Ncc>(),
    AmEntry::of::<Ssim>(),
    AmEntry::of::<Spss>(),
    AmEntry::of::<Riu>(),
    AmEntry::of::<Scv>(),
    AmEntry::of::<Rscv>(),
    AmEntry::of::<Lscv>(),
    AmEntry::of::<Lrscv>(),
    AmEntry::of::<Pca>(),
    AmEntry::of::<Mi>(),
    AmEntry::of::<Ccre>(),
    AmEntry::of::<Kld>(),
    AmEntry::of::<Lkld>(),
    AmEntry::of::<Ngf>(),
    sum::ENTRY,
    AmEntry::of::<Dfm>(),
];

/// The family of appearance models.
#[derive(Clone, Copy, Debug)]
pub struct AmFamily {
    /// Of a model that is made of others, which its parameters name ([`AmName`]): builds it when more are known than the parts
    /// that it has by default.
    pub join: Option<JoinAm>,
}

/// Builds a model that is made of others from `(name, value)` assignments and the rows that may be named there.
pub type JoinAm = fn(&[Assignment<'_>], &[AmEntry]) -> Built<Box<dyn AppearanceModel>>;

impl Family for AmFamily {
    type Build = Build<Box<dyn AppearanceModel>>;
    const ROLE: &'static str = "appearance model";

    fn made_of_others(&self) -> bool {
        self.join.is_some()
    }

    fn names_allowed(known: &[AmEntry]) -> String {
        let parts = known.iter().filter(|e| !e.family.made_of_others());
        parts.map(|e| e.name).collect::<Vec<_>>().join(", ")
    }
}

/// An appearance model by its name, as a parameter of models that are made of others.
pub type AmName = NameOf<AmFamily>;

/// A row of the table of appearance models.
pub type AmEntry = Entry<AmFamily>;

impl AmEntry {
    /// The entry of model `M`.
    pub const fn of<M: AppearanceModel + Part>() -> Self {
        Entry::of_part::<M>(
            |a| Ok(Box::new(M::new(M::Params::from_assignments(a)?))),
            AmFamily { join: None },
        )
    }

    /// Builds the model, which may be made of those `known`.
    ///
    /// # Errors
    /// A value is not allowed, or names a model that is not known.
    pub fn model(
        &self,
        assignments: &[Assignment<'_>],
        known: &[AmEntry],
    ) -> Built<Box<dyn AppearanceModel>> {
        match self.family.join {
            Some(join) => join(assignments, known),
            None => (self.build)(assignments),
        }
    }
}
