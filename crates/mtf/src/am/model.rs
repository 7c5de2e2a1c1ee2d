//! The trait of appearance models, and what a model may offer beyond it.
//!
//! [`AppearanceModel`] is what every model is. What only some searches use is a trait of its own, reached by one method of the
//! model that returns `None` unless the model says otherwise; a search asks once per patch, never per pixel.
//!
//! | offered by | trait | used by |
//! |---|---|---|
//! | [`derivatives`](AppearanceModel::derivatives) | [`Derivatives`] | gradient searches |
//! | [`distances`](AppearanceModel::distances) | [`Distances`] | nearest neighbours, regression, masks of similar pixels |
//! | [`masking`](AppearanceModel::masking) | [`Masking`] | selective pixel integration |
//! | [`per_frame`](AppearanceModel::per_frame) | [`PerFrame`] | every search, at the start of a frame |
//! | [`learner`](AppearanceModel::learner) | [`Learner`] | searches told to learn |
//! | [`reference`](AppearanceModel::reference) | [`Reference`] | derivative checks |

use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::params::{Assignment, Resolution};
use crate::tracker::TrackError;
use auto_impl::auto_impl;
use dyn_clone::DynClone;

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

/// Properties of a similarity measure `f`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Properties {
    /// `f(T, I) = f(I, T)`.
    pub symmetric: bool,
    /// One gain and one bias of the whole current patch change `f` not at all, or only by an accident of the measure: a
    /// search cannot estimate them.
    pub gain_bias_invariant: bool,
    /// A gradient search with this model alone finds a region again. False for models that see too little of a patch to
    /// determine all parameters of a warp; they serve sampling searches and sums of models.
    pub tracks_alone: bool,
}

impl Default for Properties {
    /// Symmetric, sees gain and bias, tracks alone.
    fn default() -> Self {
        Properties {
            symmetric: true,
            gain_bias_invariant: false,
            tracks_alone: true,
        }
    }
}

/// What a model offers, for search methods that require some of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// It has [`Derivatives`].
    pub derivatives: bool,
    /// Its derivatives have a [`SelfGradient`].
    pub self_gradient: bool,
    /// See [`Derivatives::one_sided`].
    pub one_sided: Option<(Side, &'static str)>,
    /// Metric of its [`Distances`], if it has any.
    pub metric: Option<Metric>,
    /// It has [`Masking`].
    pub masks: bool,
    /// See [`Properties::gain_bias_invariant`].
    pub gain_bias_invariant: bool,
}

impl Capabilities {
    /// What `am` offers.
    pub fn of(am: &mut dyn AppearanceModel) -> Self {
        Capabilities {
            derivatives: am.derivatives().is_some(),
            self_gradient: am.derivatives().is_some_and(|d| d.self_gradient().is_some()),
            one_sided: am.derivatives().and_then(|d| d.one_sided()),
            metric: am.distances().map(Distances::metric),
            masks: am.masking().is_some(),
            gain_bias_invariant: am.properties().gain_bias_invariant,
        }
    }
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

/// A similarity measure `f(T, I)` between a template and a current patch.
///
/// Call order: [`set_template`](Self::set_template) once, then [`set_current`](Self::set_current) with each new patch;
/// everything else refers to those two. No method but `set_template` allocates.
#[auto_impl(Box)]
pub trait AppearanceModel: Send + DynClone {
    /// Properties of the measure; the same before and after [`set_template`](Self::set_template).
    fn properties(&self) -> Properties;

    /// Takes the template patch (function 1 at initialisation) and makes it the current patch as well.
    /// Fails when the patch is not finite or has nothing to track.
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError>;

    /// Takes the current patch and computes what the similarity and its derivatives share (function 4 without `f`).
    fn set_current(&mut self, patch: &[f32]);

    /// `f(T, I)` (function 4).
    fn similarity(&self) -> f64;

    /// Probability-like score of the current patch, in `(0, 1]`, 1 at a perfect match.
    fn likelihood(&self) -> f64;

    /// Bytes kept between frames.
    fn memory(&self) -> usize;

    /// Takes the current patch and returns `f`: [`set_current`](Self::set_current) and [`similarity`](Self::similarity) for
    /// searches that need no derivatives, which a model may leave undefined until the next `set_current`.
    fn score(&mut self, patch: &[f32]) -> f64 {
        self.set_current(patch);
        self.similarity()
    }

    /// Its derivatives, if it has any.
    fn derivatives(&mut self) -> Option<&mut dyn Derivatives> {
        None
    }

    /// Distances between patches, if it has a feature to measure them by.
    fn distances(&self) -> Option<&dyn Distances> {
        None
    }

    /// Masks, if it can leave out values; its feature then has an element per value.
    fn masking(&mut self) -> Option<&mut dyn Masking> {
        None
    }

    /// What it does once per frame, if anything.
    fn per_frame(&mut self) -> Option<&mut dyn PerFrame> {
        None
    }

    /// Learning from tracked patches, if it learns.
    fn learner(&mut self) -> Option<&mut dyn Learner> {
        None
    }

    /// Its slow definition, for derivative checks.
    fn reference(&self) -> Option<&dyn Reference> {
        None
    }
}

dyn_clone::clone_trait_object!(AppearanceModel);

/// Derivatives of `f` at the present template and current patch, each `n` values long (channel-planar), and their products
/// with Jacobians `J = d(value)/dp` of `n` rows and S columns.
pub trait Derivatives {
    /// `df/dT` (function 5) or `df/dI` (function 6) for each raw pixel value; `out` has the patch's length.
    fn gradient_into(&mut self, side: Side, out: &mut [f32]);

    /// First-order Hessian `J' (d²f/dI²) J` of the current side (function 11) or the same of the template side
    /// (function 10); `j` has a row per value.
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix);

    /// Self Hessian (function 12): `J' (d²f(C, I)/dI² at I = C) J` with `C` the template or the current patch.
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix);

    /// Gradient with respect to the search parameters (functions 7, 8): the product of
    /// [`gradient_into`](Self::gradient_into) and `j`. `scratch` has the patch's length.
    fn project_gradient(&mut self, side: Side, j: &Jacobian, scratch: &mut [f32], out: &mut [f64]) {
        self.gradient_into(side, scratch);
        kernels::project(j, scratch, out);
    }

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

    /// The gradient of a patch compared with itself; `None` where it vanishes, as it does for measures with their maximum
    /// there.
    fn self_gradient(&mut self) -> Option<&mut dyn SelfGradient> {
        None
    }

    /// A parameter that is on and changes the derivatives of one side alone, and that side: a search that reads only the
    /// other's would not notice.
    fn one_sided(&self) -> Option<(Side, &'static str)> {
        None
    }

    /// Whether `f` grows along the steps that gradient and Hessian make. False for centred gradients, which lead to perfect
    /// alignment instead of the maximum of `f`: Levenberg-Marquardt then asks that `J (-H)⁻¹ J'` shrink.
    fn similarity_is_merit(&self) -> bool {
        true
    }

    /// Whether values are weighted, by a mask or by how well they agree: then even the template's self Hessian changes
    /// with the current patch.
    fn weighted(&mut self) -> bool {
        false
    }
}

/// The gradient of a patch compared with itself: what the second-order terms of the self Hessian are weighted by.
pub trait SelfGradient {
    /// `df(C, I)/dI at I = C` for each raw pixel value, `C` the side's own patch.
    fn self_gradient_into(&mut self, side: Side, out: &mut [f32]);
}

/// Distances between patches, by a feature of each. Usable once the template is set.
pub trait Distances {
    /// What may be assumed of [`distance`](Self::distance).
    fn metric(&self) -> Metric;

    /// Length of a feature.
    fn feature_len(&self) -> usize;

    /// Feature of any patch, such that [`distance`](Self::distance) orders pairs as `-f` does.
    fn feature_into(&self, patch: &[f32], out: &mut [f32]);

    /// Distance between two features; `query` is of the patch searched for, `stored` plays the template. May stop early and
    /// return any value above `bound` once it is known to exceed it. By default squared Euclidean.
    fn distance(&self, query: &[f32], stored: &[f32], bound: f32) -> f32 {
        kernels::squared_distance(query, stored, bound)
    }
}

/// Masks.
pub trait Masking {
    /// Restricts the model to the values for which `mask` is 1; the others, for which it is 0, contribute nothing to
    /// `f` and its derivatives until the next mask or template. An empty mask leaves out nothing. Takes effect with the next
    /// [`set_current`](AppearanceModel::set_current).
    fn set_mask(&mut self, mask: &[f32]);
}

/// Estimates that are made once per frame.
pub trait PerFrame {
    /// Tells that the patches to come belong to a new frame: what is estimated once per frame is estimated from the next
    /// patch. Called by search methods at the start of each update.
    fn begin_frame(&mut self);
}

/// Adaptation to what is tracked.
pub trait Learner {
    /// Adapts the model to the patch at which a frame's search ended (raw, like all patches). Returns true when
    /// something that a search method may have kept has changed: gradients or Hessians of the template side. May allocate.
    fn learn(&mut self, patch: &[f32]) -> bool;

    /// Whether the model is of little use unless it learns: search methods then call [`learn`](Self::learn) unless told
    /// not to.
    fn needs_learning(&mut self) -> bool;
}

/// The definition that derivative checks compare a model with.
pub trait Reference {
    /// Slow `f64` definition of the function whose derivatives the model returns, for any two patches. A model that
    /// holds part of itself fixed while differentiating (ZNCC its normalisation) holds it at its present patches.
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64;

    /// Terms `r_i`, slowly and in `f64`, of a model whose self Hessian is `-Σ_i (dr_i/dp)' (dr_i/dp)` with the other patch
    /// held; none where it is the second derivative of [`similarity_of`](Self::similarity_of).
    fn terms_of(&self, _template: &[f64], _current: &[f64]) -> Option<Vec<f64>> {
        None
    }

    /// Assignments under which the model's derivatives are those of [`similarity_of`](Self::similarity_of), and nothing in it
    /// depends on the template but the template itself. Empty where that is so by default.
    fn plain(&self) -> &'static [Assignment<'static>] {
        &[]
    }
}

/// Begins a frame with a model that does something then.
pub fn begin_frame<A: AppearanceModel + ?Sized>(am: &mut A) {
    if let Some(model) = am.per_frame() {
        model.begin_frame();
    }
}
