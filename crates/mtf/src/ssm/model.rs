//! The trait of state space models, and what a model may offer beyond it.
//!
//! [`StateSpaceModel`] is what every warp is. What only some searches use, or only some warps have, is a trait of its own,
//! reached by one method of the model that returns `None` unless the model says otherwise; a search asks once per patch.
//!
//! | offered by | trait | used by |
//! |---|---|---|
//! | [`second_order`](StateSpaceModel::second_order) | [`SecondOrder`] | gradient searches with second-order terms |
//! | [`matrix_group`](StateSpaceModel::matrix_group) | [`MatrixGroup`] | means of particles, gradients of the warped image |
//! | [`non_rigid`](StateSpaceModel::non_rigid) | [`NonRigid`] | every search, for warps that bend |
//! | [`estimable`](StateSpaceModel::estimable) | [`Estimable`] | composites that fit a warp to points |
//! | [`geometric`](StateSpaceModel::geometric) | [`Geometric`] | samplers of shifts, scales and angles |
//! | [`reference`](StateSpaceModel::reference) | [`Reference`] | derivative checks |

use super::frame::BaseFrame;
use crate::consensus::Estimator;
use crate::geom::solve::SymMatrix;
use crate::geom::{Corners, Mat3};
use crate::kernels::Jacobian;
use crate::params::Resolution;
use crate::tracker::TrackError;
use auto_impl::auto_impl;
use dyn_clone::DynClone;

/// What a warp's algebra offers; search methods require some of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SsmCapabilities {
    /// Warps compose within the family, exactly or by its documented projection.
    pub compositional: bool,
    /// They have inverses within it, likewise.
    pub invertible: bool,
    /// Both hold exactly: the warps are a group.
    pub group: bool,
    /// Point pairs that determine a state.
    pub min_points: usize,
}

/// How an increment `Δ` changes the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Increment {
    /// `p <- p + Δ`.
    Additive,
    /// `w(x; p) <- w(w(x; Δ); p)`.
    Compositional,
    /// `w(x; p) <- w(w(x; Δ)⁻¹; p)`.
    InverseCompositional,
}

/// Which product of image gradient and warp Jacobian (paper, table of SSM functions).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JacobianKind {
    /// `g0 · w_p(x0; 0)`: gradient of the template in the base frame. For warps that are no group, the template's side of
    /// the warped kind, `g0 · w_x(x0; p)⁻¹ · dw/dΔ`, which changes with the state.
    Template,
    /// `g · w_x(x0; p) · w_p(x0; 0)`: image gradient at the current points, compositional. For warps that are no group,
    /// `g · dw/dΔ` of the projected composition.
    Warped,
    /// `g · w_p(x0; p)`: image gradient at the current points, additive.
    Additive,
    /// `g0 · w_x(x0; p)⁻¹ · w_p(x0; p)`: template gradient carried to the current warp (inverse additive).
    Approximate,
}

impl JacobianKind {
    /// True when the gradient is the template's, in the base frame.
    pub fn of_template(self) -> bool {
        matches!(self, JacobianKind::Template | JacobianKind::Approximate)
    }
}

/// Image gradients at the points of one channel: per pixel at the current points, or the template's in the base frame.
#[derive(Clone, Copy, Debug)]
pub struct Gradient<'a> {
    /// Along x.
    pub x: &'a [f32],
    /// Along y.
    pub y: &'a [f32],
}

/// Image Hessians at the points of one channel, in the same coordinates as the [`Gradient`].
#[derive(Clone, Copy, Debug)]
pub struct ImageHessian<'a> {
    /// `∂²I/∂x²`.
    pub xx: &'a [f32],
    /// `∂²I/∂x∂y`.
    pub xy: &'a [f32],
    /// `∂²I/∂y²`.
    pub yy: &'a [f32],
}

/// Points in image pixels.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    /// x.
    pub x: &'a [f32],
    /// y.
    pub y: &'a [f32],
}

/// A parametric family of warps `w(x; p)` with its base frame and state `p`, S numbers.
///
/// Methods that change the state leave it as it was when they fail. None but `init` and `rebase` allocates.
#[auto_impl(Box)]
pub trait StateSpaceModel: Send + DynClone {
    /// What the warp's algebra offers.
    fn capabilities(&self) -> SsmCapabilities;

    /// Number of parameters S.
    fn dof(&self) -> usize;

    /// The base frame: origin, scale, corners and sampling grid at `p = 0`.
    fn base(&self) -> &BaseFrame;

    /// New base frame and grid for `corners` (px), `p = 0`. Fails unless they are a convex quadrilateral of at least 1 px².
    fn init(&mut self, corners: &Corners, res: Resolution) -> Result<(), TrackError>;

    /// Makes `corners` (px) the base (`p = 0`) while the template stays what it was; returns the homography from the new
    /// base frame to the old one, with which base-frame template gradients are carried over.
    fn rebase(&mut self, corners: &Corners) -> Result<Mat3, TrackError>;

    /// State `p`, length S.
    fn state(&self) -> &[f64];

    /// Sets the state. Fails when the warped region is not a convex quadrilateral in front of the camera.
    fn set_state(&mut self, p: &[f64]) -> Result<(), TrackError>;

    /// Applies an increment of length S. Fails where the family has no such increment.
    fn update(&mut self, how: Increment, delta: &[f64]) -> Result<(), TrackError>;

    /// Corners at a state `p` of finite numbers, in image pixels; the state is not changed, nor is `p` judged.
    fn corners_at(&self, p: &[f64]) -> Corners;

    /// Sets `p` to the least-squares fit of the base corners to `corners` (px); returns the RMS residual in pixels.
    /// Non-rigid warps, which four corners do not determine, move as the plane through them and keep their bend.
    fn fit_corners(&mut self, corners: &Corners) -> Result<f64, TrackError>;

    /// Least-squares state that takes points `from`, where they are at `p = 0`, to points `to`, both in image pixels,
    /// into `p`; the present state is not changed. Fails when the pairs do not determine one. May allocate.
    fn fit_into(&self, from: &[[f64; 2]], to: &[[f64; 2]], p: &mut [f64]) -> Result<(), TrackError>;

    /// Increment that leads from state `p` to state `q`: of `w(p)⁻¹ ∘ w(q)` where warps compose, else `q - p`.
    fn relative_into(&self, p: &[f64], q: &[f64], out: &mut [f64]) -> Result<(), TrackError>;

    /// Writes the current points of the grid in image pixels.
    fn warp_into(&self, x: &mut [f32], y: &mut [f32]);

    /// Writes rows `row..row + points` of `J = dI/dp` (row-contiguous per channel, a column per parameter).
    /// `points` are the current points.
    fn jacobian_into(
        &self,
        kind: JacobianKind,
        gradient: Gradient<'_>,
        points: Points<'_>,
        row: usize,
        j: &mut Jacobian,
    );

    /// Bytes kept between frames.
    fn memory(&self) -> usize;

    /// Current corners in image pixels.
    fn corners(&self) -> Corners {
        self.corners_at(self.state())
    }

    /// Its second-order terms, if it has any to offer.
    fn second_order(&self) -> Option<&dyn SecondOrder> {
        None
    }

    /// What it can do because its warps are matrices, if they are.
    fn matrix_group(&self) -> Option<&dyn MatrixGroup> {
        None
    }

    /// What it does because its warps bend, if they do.
    fn non_rigid(&self) -> Option<&dyn NonRigid> {
        None
    }

    /// Robust estimates from point pairs, if it can make them.
    fn estimable(&mut self) -> Option<&mut dyn Estimable> {
        None
    }

    /// Its geometric parameters, if it has such.
    fn geometric(&self) -> Option<&dyn Geometric> {
        None
    }

    /// Its slow definition, for derivative checks.
    fn reference(&self) -> Option<&dyn Reference> {
        None
    }
}

dyn_clone::clone_trait_object!(StateSpaceModel);

/// Second derivatives of the image by the parameters.
pub trait SecondOrder {
    /// Adds `Σ_i weights_i K_i` to `h`, `K_i = d²I_i/dp²` of the given kind: the second-order part of a Hessian.
    fn curvature_into(
        &self,
        kind: JacobianKind,
        weights: &[f32],
        gradient: Gradient<'_>,
        hessian: ImageHessian<'_>,
        h: &mut SymMatrix,
    );
}

/// Warps that are 3x3 matrices acting on the base frame.
pub trait MatrixGroup {
    /// Weighted mean of states (S numbers each) that respects the group: the Karcher mean of their matrices. Weights are not
    /// negative and not all zero.
    fn mean_into(&self, states: &[f64], weights: &[f64], out: &mut [f64]) -> Result<(), TrackError>;

    /// Writes where the grid, moved by `offset` in the base frame, is warped to, in image pixels.
    fn warp_offset_into(&self, offset: [f64; 2], x: &mut [f32], y: &mut [f32]);
}

/// Warps that do more than the corners tell.
pub trait NonRigid {
    /// Called by search methods at the start of each frame, with the state of the frame before.
    fn begin_frame(&self);

    /// Adds what is known of likely states to the gradient (length S) and the (negative definite) Hessian of an additive
    /// step.
    fn regularise(&self, gradient: &mut [f64], hessian: &mut SymMatrix);

    /// How far the region has moved since it had the state given, px²: the sum of squared distances of the control points,
    /// as if they were four.
    fn motion_squared(&self, state: &[f64]) -> f64;

    /// Current place of any place `x` of the frame it was initialised on, px.
    fn place(&self, x: [f64; 2]) -> [f64; 2];
}

/// States from point pairs of which some are wrong.
pub trait Estimable {
    /// Sets the state to a robust estimate from pairs as in [`fit_into`](StateSpaceModel::fit_into), some of them wrong; which
    /// ones is left in the estimator.
    fn estimate(
        &mut self,
        estimator: &mut Estimator,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
    ) -> Result<(), TrackError>;
}

/// Warps whose states are told by geometric parameters as well, S numbers of which the first two are the shift in the base
/// frame; S is at most [`MAX_DOF`](super::MAX_DOF).
pub trait Geometric {
    /// Geometric parameters of state `p`.
    fn geometric_into(&self, p: &[f64], g: &mut [f64]);

    /// State of geometric parameters `g`.
    fn state_into(&self, g: &[f64], p: &mut [f64]);

    /// After which parameter `k` repeats itself, if it is an angle; radians.
    fn period(&self, k: usize) -> Option<f64>;
}

/// The definition that derivative checks compare a warp with.
pub trait Reference {
    /// Current place of grid point `i` in image pixels, in `f64`: the slow form of
    /// [`warp_into`](StateSpaceModel::warp_into).
    fn point(&self, i: usize) -> [f64; 2];
}

/// How far the region of `ssm` has moved since it had the corners and state given: the sum of squared corner distances, px²,
/// unless the warp bends ([`NonRigid::motion_squared`]).
pub fn motion_squared<S: StateSpaceModel + ?Sized>(ssm: &S, corners: &Corners, state: &[f64]) -> f64 {
    match ssm.non_rigid() {
        Some(warp) => warp.motion_squared(state),
        None => ssm.corners().distance_squared(corners),
    }
}

/// Current place of any place `x` of the frame `ssm` was initialised on, px; `None` when the corners tell all, as those of a
/// plane do.
pub fn place<S: StateSpaceModel + ?Sized>(ssm: &S, x: [f64; 2]) -> Option<[f64; 2]> {
    ssm.non_rigid().map(|warp| warp.place(x))
}

/// Robust estimate from point pairs ([`Estimable::estimate`]); fails where the warp makes none.
pub fn estimate<S: StateSpaceModel + ?Sized>(
    ssm: &mut S,
    estimator: &mut Estimator,
    from: &[[f64; 2]],
    to: &[[f64; 2]],
) -> Result<(), TrackError> {
    let warp = ssm.estimable().ok_or(TrackError::Unable(
        "the warp cannot be estimated from point pairs",
    ))?;
    warp.estimate(estimator, from, to)
}

/// Begins a frame with a warp that does something then.
pub fn begin_frame<S: StateSpaceModel + ?Sized>(ssm: &S) {
    if let Some(warp) = ssm.non_rigid() {
        warp.begin_frame();
    }
}
