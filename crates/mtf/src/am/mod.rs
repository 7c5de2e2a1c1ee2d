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
//! [`gradient_into`](AppearanceModel::gradient_into); 7 and 8 its product with a Jacobian; 9 their difference; 10 and
//! 11 [`hessian_into`](AppearanceModel::hessian_into); 12 [`self_hessian_into`](AppearanceModel::self_hessian_into);
//! 13 the sum of 10 and 11. Their second-order forms add `Σ_i f_t[i] K_i`, which the warp contributes
//! ([`crate::ssm::StateSpaceModel::curvature_into`]).
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
mod ncc;
mod network;
mod ngf;
mod nssd;
mod pca;
mod riu;
mod robust;
mod sad;
mod scv;
mod spss;
mod ssd;
mod ssim;
mod sum;
mod tone;
mod zncc;

pub use bank::OrientedBank;
pub use ccre::{Ccre, CcreParams, CrossCumulative};
pub use dfm::{Dfm, DfmParams, PatchFeatures};
pub use divergence::{Divergence, DivergenceKind, DivergenceSettings};
pub use information::{Information, InformationSettings, Kind as InformationKind};
pub use kld::{Kld, KldParams, Whole};
pub use lkld::{Lkld, LkldParams, Localised};
pub use mi::{Mi, MiParams, Mutual};
pub use ncc::Ncc;
pub use network::{Network, NetworkError};
pub use ngf::{Ngf, NgfParams};
pub use nssd::Nssd;
pub use pca::Pca;
pub use riu::Riu;
pub use robust::Robust;
pub use sad::Sad;
pub use scv::{ConditionalVariance, Lrscv, Lscv, Rscv, Scv};
pub use spss::Spss;
pub use ssd::Ssd;
pub use ssim::Ssim;
pub use sum::Sum;
pub use zncc::Zncc;

use crate::entry::{Build, Entry, Family, NameOf, Part};
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::params::{Assignment, Built, Params, Resolution};
use crate::tracker::TrackError;
use dyn_clone::DynClone;

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
    AmEntry::of::<Mi>().plain_with(&[("centred", "0")]),
    AmEntry::of::<Ccre>().plain_with(&[("centred", "0")]),
    AmEntry::of::<Kld>().plain_with(&[("damping", "0")]),
    AmEntry::of::<Lkld>().plain_with(&[("damping", "0")]),
    AmEntry::of::<Ngf>().plain_with(&[("centred", "0"), ("ngf_eta", "20")]),
    sum::ENTRY,
    AmEntry::of::<Dfm>(),
];

/// Shape of a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PatchShape {
    /// Sampling grid.
    pub res: Resolution,
    /// Planes: 1 or 3.
    pub channels: usize,
}

impl PatchShape {
    /// Number of values: points x channels.
    pub fn len(&self) -> usize {
        self.res.len() * self.channels
    }
    /// True when there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Which argument of `f(T, I)` is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The template `T`.
    Template,
    /// The current patch `I`.
    Current,
}

/// Which Hessian of `f`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curvature {
    /// The self Hessian (function 12): both patches replaced by the side's own patch.
    SelfHessian,
    /// The Hessian as it stands (functions 10 and 11).
    Standard,
}

/// How distances between features behave: what a nearest-neighbour index may assume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metric {
    /// Squared Euclidean distance of feature vectors.
    SquaredL2,
    /// Sum of absolute differences of feature vectors.
    L1,
    /// Anything else; only comparisons one by one are valid.
    Other,
}

/// What a model can do; search methods require some of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Has `df/dI`, `df/dT` and self Hessians: usable by gradient search methods.
    pub derivatives: bool,
    /// `f(T, I) = f(I, T)`.
    pub symmetric: bool,
    /// Metric of its distance feature.
    pub metric: Metric,
    /// One gain and one bias of the whole current patch change `f` not at all, or only by an accident of the measure: a
    /// search cannot estimate them.
    pub gain_bias_invariant: bool,
    /// Can leave out values ([`AppearanceModel::set_mask`]); its feature has an element per value.
    pub masks: bool,
}

/// Gradient (row vector `J`) and Hessian of the similarity with respect to the search parameters.
#[derive(Clone, Debug)]
pub struct Normal {
    /// Gradient, length S.
    pub gradient: Vec<f64>,
    /// Hessian, S x S; negative definite near a maximum.
    pub hessian: SymMatrix,
}

impl Normal {
    /// Zero system of `s` parameters.
    pub fn new(s: usize) -> Self {
        Normal {
            gradient: vec![0.0; s],
            hessian: SymMatrix::new(s),
        }
    }
    /// Zero system of `s` parameters. Allocates only when it grows.
    pub fn reset(&mut self, s: usize) {
        self.gradient.clear();
        self.gradient.resize(s, 0.0);
        self.hessian.reset(s);
    }
    /// Copies `other`, which has the same size.
    pub fn copy_from(&mut self, other: &Normal) {
        self.gradient.copy_from_slice(&other.gradient);
        self.hessian.copy_from(&other.hessian);
    }
}

/// A similarity measure between a template and a current patch.
///
/// Call order: [`set_template`](Self::set_template) once, then [`set_current`](Self::set_current) with each new patch;
/// everything else refers to those two. No method but `set_template` allocates.
pub trait AppearanceModel: Send + DynClone {
    /// What the model can do.
    fn capabilities(&self) -> Capabilities;

    /// Whether `f` grows along the steps that gradient and Hessian make. False for centred gradients, which lead to perfect
    /// alignment instead of the maximum of `f`: Levenberg-Marquardt then asks that `J (-H)⁻¹ J'` shrink.
    fn similarity_is_merit(&self) -> bool {
        true
    }

    /// Whether a gradient search with this model alone finds a region again. False for models that see too little of a patch
    /// to determine all parameters of a warp; they serve sampling searches and sums of models.
    fn tracks_alone(&self) -> bool {
        true
    }

    /// Takes the template patch (function 1 at initialisation) and makes it the current patch as well.
    /// Fails when the patch is not finite or has nothing to track.
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError>;

    /// Tells that the patches to come belong to a new frame: models that estimate something once per frame do so with the
    /// next patch. Called by search methods at the start of each update.
    fn begin_frame(&mut self) {}

    /// Takes the current patch and computes what the similarity and its derivatives share (function 4 without `f`).
    fn set_current(&mut self, patch: &[f32]);

    /// Takes the current patch and returns `f`: [`set_current`](Self::set_current) and [`similarity`](Self::similarity) for
    /// searches that need no derivatives, which a model may leave undefined until the next `set_current`.
    fn score(&mut self, patch: &[f32]) -> f64 {
        self.set_current(patch);
        self.similarity()
    }

    /// Restricts the model to the values for which `mask` is 1; the others, for which it is 0, contribute nothing to
    /// `f` and its derivatives until the next mask or template. Takes effect with the next
    /// [`set_current`](Self::set_current); only called if the model can (see [`Capabilities::masks`]).
    fn set_mask(&mut self, _mask: &[f32]) {}

    /// Whether values are weighted, by a mask or by how well they agree: then even the template's self Hessian changes
    /// with the current patch.
    fn weighted(&self) -> bool {
        false
    }

    /// `f(T, I)` (function 4).
    fn similarity(&self) -> f64;

    /// `df/dT` (function 5) or `df/dI` (function 6) for each raw pixel value; `out` has the patch's length.
    fn gradient_into(&mut self, side: Side, out: &mut [f32]);

    /// Gradient with respect to the search parameters (functions 7, 8): the product of
    /// [`gradient_into`](Self::gradient_into) and `j`. `scratch` has the patch's length.
    fn project_gradient(&mut self, side: Side, j: &Jacobian, scratch: &mut [f32], out: &mut [f64]) {
        self.gradient_into(side, scratch);
        kernels::project(j, scratch, out);
    }

    /// First-order Hessian `J' (d²f/dI²) J` of the current side (function 11) or the same of the template side
    /// (function 10); `j` has a row per value.
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix);

    /// Self Hessian (function 12): `J' (d²f(C, I)/dI² at I = C) J` with `C` the template or the current patch.
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix);

    /// Gradient (functions 7, 8) and the chosen Hessian in one go. `scratch` has the patch's length.
    /// Models override it where one pass over `j` can do both.
    fn linearise(
        &mut self,
        side: Side,
        curvature: Curvature,
        j: &Jacobian,
        scratch: &mut [f32],
        out: &mut Normal,
    ) {
        self.project_gradient(side, j, scratch, &mut out.gradient);
        match curvature {
            Curvature::SelfHessian => self.self_hessian_into(side, j, &mut out.hessian),
            Curvature::Standard => self.hessian_into(side, j, &mut out.hessian),
        }
    }

    /// Probability-like score of the current patch, in `(0, 1]`, 1 at a perfect match.
    fn likelihood(&self) -> f64;

    /// Length of the distance feature.
    fn feature_len(&self) -> usize;

    /// Feature of any patch, such that [`distance`](Self::distance) orders pairs as `-f` does.
    fn feature_into(&self, patch: &[f32], out: &mut [f32]);

    /// Distance between two features; `query` is of the patch searched for, `stored` plays the template. May stop early and
    /// return any value above `bound` once it is known to exceed it.
    fn distance(&self, query: &[f32], stored: &[f32], bound: f32) -> f32 {
        kernels::squared_distance(query, stored, bound)
    }

    /// Adapts the model to the patch at which a frame's search ended (raw, like all patches). Returns true when
    /// something that a search method may have kept has changed: gradients or Hessians of the template side. May allocate.
    fn learn(&mut self, _patch: &[f32]) -> bool {
        false
    }

    /// Whether the model is of little use unless it learns: search methods then call [`learn`](Self::learn) unless told
    /// not to.
    fn needs_learning(&self) -> bool {
        false
    }

    /// Slow `f64` definition of the function whose derivatives the model returns, for any two patches. A model that
    /// holds part of itself fixed while differentiating (ZNCC its normalisation) holds it at its present patches.
    fn reference(&self, template: &[f64], current: &[f64]) -> f64;

    /// Bytes kept between frames.
    fn memory(&self) -> usize;
}

dyn_clone::clone_trait_object!(AppearanceModel);

impl AppearanceModel for Box<dyn AppearanceModel> {
    fn capabilities(&self) -> Capabilities {
        (**self).capabilities()
    }
    fn similarity_is_merit(&self) -> bool {
        (**self).similarity_is_merit()
    }
    fn tracks_alone(&self) -> bool {
        (**self).tracks_alone()
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        (**self).set_template(shape, patch)
    }
    fn begin_frame(&mut self) {
        (**self).begin_frame()
    }
    fn set_current(&mut self, patch: &[f32]) {
        (**self).set_current(patch)
    }
    fn score(&mut self, patch: &[f32]) -> f64 {
        (**self).score(patch)
    }
    fn set_mask(&mut self, mask: &[f32]) {
        (**self).set_mask(mask)
    }
    fn weighted(&self) -> bool {
        (**self).weighted()
    }
    fn similarity(&self) -> f64 {
        (**self).similarity()
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        (**self).gradient_into(side, out)
    }
    fn project_gradient(&mut self, side: Side, j: &Jacobian, scratch: &mut [f32], out: &mut [f64]) {
        (**self).project_gradient(side, j, scratch, out)
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        (**self).hessian_into(side, j, h)
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        (**self).self_hessian_into(side, j, h)
    }
    fn linearise(&mut self, side: Side, c: Curvature, j: &Jacobian, scratch: &mut [f32], out: &mut Normal) {
        (**self).linearise(side, c, j, scratch, out)
    }
    fn likelihood(&self) -> f64 {
        (**self).likelihood()
    }
    fn feature_len(&self) -> usize {
        (**self).feature_len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        (**self).feature_into(patch, out)
    }
    fn distance(&self, query: &[f32], stored: &[f32], bound: f32) -> f32 {
        (**self).distance(query, stored, bound)
    }
    fn learn(&mut self, patch: &[f32]) -> bool {
        (**self).learn(patch)
    }
    fn needs_learning(&self) -> bool {
        (**self).needs_learning()
    }
    fn reference(&self, template: &[f64], current: &[f64]) -> f64 {
        (**self).reference(template, current)
    }
    fn memory(&self) -> usize {
        (**self).memory()
    }
}

/// The family of appearance models.
#[derive(Clone, Copy, Debug)]
pub struct AmFamily {
    /// Assignments under which the derivatives are those of [`reference`](AppearanceModel::reference), and nothing in the
    /// model depends on the template but the template itself. Empty where that is so by default.
    pub plain: &'static [Assignment<'static>],
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
            AmFamily {
                plain: &[],
                join: None,
            },
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

    /// The same with assignments under which its derivatives can be checked ([`AmFamily::plain`]).
    pub const fn plain_with(mut self, plain: &'static [Assignment<'static>]) -> Self {
        self.family.plain = plain;
        self
    }
}
