//! Illumination models: how the light on a patch may change, as a parametric map `g(I; a)` of its intensities.
//!
//! One file per model; [`ILMS`] is the table that the command line, the documentation and the conformance tests read.
//! May depend on `kernels`, `params`, `tracker` and the shape of patches, never on what compares or warps them.
//!
//! # Coupling
//!
//! The current patch `I` is replaced by `g(I; a)` before an appearance model sees it, so that all its derivatives are
//! with respect to `g`. With `J = dI/dp`, `γ = dg/dI` (a number per value) and `g_a = dg/da`, a search over `[p, a]` uses
//!
//! `J_full = [diag(γ) J, g_a]`, gradient `f_t J_full`, first-order Hessian `J_fullᵀ (d²f/dg²) J_full`,
//!
//! whatever the appearance model ([`IlluminationModel::extend`]). Second-order Hessians gain
//! `Σ_i f_t[i] d²g_i/dI_i da_k J_i` in the mixed block ([`IlluminationModel::mixed`]).
//!
//! On the template's side a search that moves the current patch (FALK, IALK, FCLK, ESM) needs the Jacobian that equals
//! the current one at convergence: `g(I; a) = T` there, so its rows are those of the patch `g⁻¹(T; a)`, while the template's
//! gradients are already at its light. A search that moves the template (ICLK) compares `g(I; a)` with `g(T; Δ)`, takes
//! rows of `T` and composes the inverse: `g(·; a') = g⁻¹(g(·; a); Δ)`.

mod field;
mod gb;
mod pgb;
mod rbf;

pub use field::{GainBasis, GainField, MIN_GAIN};
pub use gb::GbBasis;
pub use pgb::{BiasScope, PgbBasis, PgbParams};
pub use rbf::{RbfBasis, RbfParams};

/// One gain and one bias.
pub type Gb = GainField<GbBasis>;
/// A gain for each rectangle of the patch.
pub type Pgb = GainField<PgbBasis>;
/// Smoothly blended gains at control points.
pub type Rbf = GainField<RbfBasis>;

use crate::am::PatchShape;
use crate::entry::{Build, Entry, Family, Part};
use crate::kernels::Jacobian;
use crate::params::{NoParams, Params};
use crate::tracker::TrackError;

/// Every illumination model of the crate, in the order of the documentation; the first stands for having none.
pub const ILMS: &[IlmEntry] = &[
    IlmEntry::NONE,
    IlmEntry::of::<Gb>().global(),
    IlmEntry::of::<Pgb>(),
    IlmEntry::of::<Rbf>(),
];

/// A photometric map with its state. State 0 is the identity. No method but `init` allocates, and the first inverse step;
/// methods that change the state leave it as it was when they fail.
pub trait IlluminationModel: Send {
    /// Prepares for patches of a shape, state 0. With `relative` set, one gain and one bias of the whole patch are held
    /// fixed: for appearance models that cannot see them. Fails when the patch has too few points.
    fn init(&mut self, shape: PatchShape, relative: bool) -> Result<(), TrackError>;

    /// Number of parameters A.
    fn dof(&self) -> usize;

    /// State `a`, length A.
    fn state(&self) -> &[f64];

    /// Sets the state. Fails unless intensities keep their order everywhere.
    fn set_state(&mut self, a: &[f64]) -> Result<(), TrackError>;

    /// Applies an increment to the current patch's side, `a <- a + Δ`.
    fn step(&mut self, delta: &[f64]) -> Result<(), TrackError>;

    /// Applies the inverse of an increment of the template's side, `g(·; a) <- g⁻¹(g(·; a); Δ)`. Where that is no state, the
    /// nearest one for a patch that the present state brings to `template`, of the shape given to [`init`](Self::init).
    fn step_inverse(&mut self, delta: &[f64], template: &[f32]) -> Result<(), TrackError>;

    /// `out = g(raw; a)`.
    fn light(&self, raw: &[f32], out: &mut [f32]);

    /// `out = g⁻¹(lit; a)`.
    fn unlight(&self, lit: &[f32], out: &mut [f32]);

    /// `γ = dg/dI` of the values of one channel, the same in all.
    fn gain(&self) -> &[f32];

    /// Writes `dg/da` at the patch `raw` to columns `first..first + A` of `j`.
    fn jacobian_into(&self, raw: &[f32], first: usize, j: &mut Jacobian);

    /// `d²g/dI da_k` of the values of one channel, the same in all; `None` when it vanishes.
    fn mixed(&self, k: usize) -> Option<&[f32]>;

    /// Squared change since state `from`, in gray levels at full intensity (255).
    fn change_squared(&self, from: &[f64]) -> f64;

    /// Turns `dI/dp`, the columns of `j` but the last A, into `[diag(γ) dI/dp, dg/da]` at the patch `raw`.
    fn extend(&self, raw: &[f32], j: &mut Jacobian) {
        let s = j.cols() - self.dof();
        for k in 0..s {
            for channel in j.col_mut(k).chunks_exact_mut(self.gain().len()) {
                crate::kernels::multiply(self.gain(), channel);
            }
        }
        self.jacobian_into(raw, s, j);
    }

    /// Bytes kept between frames.
    fn memory(&self) -> usize;

    /// Its slow definition, for derivative checks.
    fn reference(&self) -> Option<&dyn Reference> {
        None
    }
}

/// The definition that derivative checks compare a model with.
pub trait Reference {
    /// Slow `f64` definition of [`light`](IlluminationModel::light) at any state `a`.
    fn light_of(&self, a: &[f64], raw: &[f64]) -> Vec<f64>;
}

/// The family of illumination models.
#[derive(Clone, Copy, Debug)]
pub struct IlmFamily {
    /// It is a gain and a bias of the whole patch and nothing else.
    pub global: bool,
}

impl Family for IlmFamily {
    /// `None` for no model.
    type Build = Build<Option<Box<dyn IlluminationModel>>>;
    const ROLE: &'static str = "illumination model";
}

/// A row of the table of illumination models.
pub type IlmEntry = Entry<IlmFamily>;

impl IlmEntry {
    /// No illumination model.
    pub const NONE: IlmEntry = Entry::new::<NoParams>(
        "none",
        "the light does not change",
        |_| Ok(None),
        IlmFamily { global: false },
    )
    .also(&["0"]);

    /// The entry of model `M`.
    pub const fn of<M: IlluminationModel + Part>() -> Self {
        Entry::of_part::<M>(
            |a| Ok(Some(Box::new(M::new(M::Params::from_assignments(a)?)))),
            IlmFamily { global: false },
        )
    }

    /// The same of a model that is a gain and a bias of the whole patch and nothing else.
    pub const fn global(mut self) -> Self {
        self.family.global = true;
        self
    }

    /// Whether this is the entry for no model.
    pub fn is_none(&self) -> bool {
        self.name == Self::NONE.name
    }
}
