//! State space models: which warps the object may undergo.
//!
//! One file per model; [`SSMS`] is the table that the command line, the documentation and the conformance tests read.
//! May depend on `kernels`, `geom`, `params` and `tracker`, never on appearance models or search methods.
//!
//! # Frames
//!
//! A model works in its *base frame*: image coordinates moved to the centroid of the initial corners and divided by
//! their RMS distance `r` from it. The grid `x0` is the regular grid of the unit square mapped to the initial corners by
//! a homography, so any quadrilateral is represented exactly whatever the model's degrees of freedom;
//! `image = centre + r * w(x0; p)`, and `p = 0` at initialisation.

mod affine;
mod asrt;
mod ast;
mod cbh;
mod frame;
mod freeform;
mod homography;
mod isometry;
mod ist;
mod lie;
mod lie_affine;
mod lie_homography;
mod lie_isometry;
mod projective;
mod sampler;
mod similitude;
mod sl3;
mod spline;
mod tps;
mod translation;

pub use affine::AffineModel;
pub use asrt::AsrtModel;
pub use ast::AstModel;
pub use cbh::CbhModel;
pub use frame::BaseFrame;
pub use freeform::{Basis, BendPenalty, FreeForm, Weight};
pub use homography::HomographyModel;
pub use isometry::IsometryModel;
pub use ist::IstModel;
pub use lie::{LieBasis, LieModel};
pub use lie_affine::LieAffineBasis;
pub use lie_homography::LieHomographyBasis;
pub use lie_isometry::LieIsometryBasis;
pub use projective::{MAX_DOF, Projective, ProjectiveModel};
pub use sampler::{Dynamics, Mean, Perturbation, SampleUnit, Sampler, SigmaSets, mean_into, sigma_of_motion};
pub use similitude::SimilitudeModel;
pub use sl3::Sl3Basis;
pub use spline::{SplineBasis, SplineEdge, SplineParams};
pub use tps::{TpsBasis, TpsParams};
pub use translation::TranslationModel;

/// Translation, 2 parameters.
pub type Translation = Projective<TranslationModel>;
/// Rotation and translation, 3 parameters.
pub type Isometry = Projective<IsometryModel>;
/// Isotropic scale and translation, 3 parameters.
pub type Ist = Projective<IstModel>;
/// Scales along both axes and translation, 4 parameters.
pub type Ast = Projective<AstModel>;
/// Rotation, isotropic scale and translation, 4 parameters.
pub type Similitude = Projective<SimilitudeModel>;
/// Scales along both axes, rotation-like and translation, 5 parameters; not a group.
pub type Asrt = Projective<AsrtModel>;
/// Affine warp, 6 parameters.
pub type Affine = Projective<AffineModel>;
/// Homography, 8 parameters.
pub type Homography = Projective<HomographyModel>;
/// Homography by its corner offsets, 8 parameters.
pub type Cbh = Projective<CbhModel>;
/// Isometry in se(2), 3 parameters.
pub type LieIsometry = Projective<LieModel<LieIsometryBasis>>;
/// Affine warp in aff(2), 6 parameters.
pub type LieAffine = Projective<LieModel<LieAffineBasis>>;
/// Homography in sl(3), elementary basis, 8 parameters.
pub type LieHomography = Projective<LieModel<LieHomographyBasis>>;
/// Homography in sl(3), geometric basis, 8 parameters.
pub type Sl3 = Projective<LieModel<Sl3Basis>>;
/// Bilinear free-form deformation, two parameters per control point.
pub type Spline = FreeForm<SplineBasis>;
/// Thin plate spline, two parameters per control point.
pub type Tps = FreeForm<TpsBasis>;

use crate::consensus::Estimator;
use crate::entry::{Build, Entry, Family, NameOf, Part};
use crate::geom::solve::SymMatrix;
use crate::geom::{Corners, Mat3};
use crate::kernels::Jacobian;
use crate::params::{Params, Resolution};
use crate::tracker::TrackError;
use dyn_clone::DynClone;

/// Every state space model of the crate, in the order of the documentation.
pub const SSMS: &[SsmEntry] = &[
    SsmEntry::of::<Translation>(),
    SsmEntry::of::<Isometry>(),
    SsmEntry::of::<LieIsometry>(),
    SsmEntry::of::<Ist>(),
    SsmEntry::of::<Ast>(),
    SsmEntry::of::<Similitude>(),
    SsmEntry::of::<Asrt>(),
    SsmEntry::of::<Affine>(),
    SsmEntry::of::<LieAffine>(),
    SsmEntry::of::<Homography>(),
    SsmEntry::of::<LieHomography>(),
    SsmEntry::of::<Sl3>(),
    SsmEntry::of::<Cbh>(),
    SsmEntry::of::<Spline>(),
    SsmEntry::of::<Tps>(),
];

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
    /// States can be estimated from point pairs.
    pub estimable: bool,
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

/// A parametric family of warps with its state.
///
/// Methods that change the state leave it as it was when they fail. None but `init` and `rebase` allocates.
pub trait StateSpaceModel: Send + DynClone {
    /// Number of parameters S.
    fn dof(&self) -> usize;

    /// What the warp's algebra offers.
    fn capabilities(&self) -> SsmCapabilities;

    /// New base frame and grid for `corners`, `p = 0`. Fails unless they are a convex quadrilateral of at least 1 px².
    fn init(&mut self, corners: &Corners, res: Resolution) -> Result<(), TrackError>;

    /// State `p`, length S.
    fn state(&self) -> &[f64];

    /// Sets the state. Fails when the warped region is not a convex quadrilateral in front of the camera.
    fn set_state(&mut self, p: &[f64]) -> Result<(), TrackError>;

    /// Applies an increment of length S.
    fn update(&mut self, how: Increment, delta: &[f64]) -> Result<(), TrackError>;

    /// Current corners in image pixels.
    fn corners(&self) -> Corners;

    /// Corners at a state `p` of finite numbers, in image pixels; the state is not changed, nor is `p` judged.
    fn corners_at(&self, p: &[f64]) -> Corners;

    /// Corners of the base frame (at `p = 0`) in image pixels.
    fn base_corners(&self) -> Corners;

    /// Sets `p` to the least-squares fit of the base corners to `corners`; returns the RMS residual in pixels.
    /// Non-rigid warps, which four corners do not determine, move as the plane through them and keep their bend.
    fn fit_corners(&mut self, corners: &Corners) -> Result<f64, TrackError>;

    /// Least-squares state that takes points `from`, where they are at `p = 0`, to points `to`, both in image pixels,
    /// into `p`; the present state is not changed. Fails when the pairs do not determine one. May allocate.
    fn fit_into(&self, from: &[[f64; 2]], to: &[[f64; 2]], p: &mut [f64]) -> Result<(), TrackError>;

    /// Sets the state to a robust estimate from pairs as in [`fit_into`](Self::fit_into), some of them wrong; which ones
    /// is left in the estimator.
    fn estimate(
        &mut self,
        estimator: &mut Estimator,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
    ) -> Result<(), TrackError>;

    /// Increment that leads from state `p` to state `q`: of `w(p)⁻¹ ∘ w(q)` where warps compose, else `q - p`.
    fn relative_into(&self, p: &[f64], q: &[f64], out: &mut [f64]) -> Result<(), TrackError>;

    /// Weighted mean of states (S numbers each) that respects the group: the Karcher mean of their matrices. The default,
    /// for warps that form no matrix group, is the mean of the states. Weights are not negative and not all zero.
    fn group_mean_into(&self, states: &[f64], weights: &[f64], out: &mut [f64]) -> Result<(), TrackError> {
        sampler::state_mean(states, weights, out);
        Ok(())
    }

    /// Makes `corners` the base (`p = 0`) while the template stays what it was; returns the homography from the new
    /// base frame to the old one, with which base-frame template gradients are carried over.
    fn rebase(&mut self, corners: &Corners) -> Result<Mat3, TrackError>;

    /// How far the region has moved since it had the corners and state given: the sum of squared corner distances, px²
    /// (for non-rigid warps, that of the control points, as if they were four).
    fn motion_squared(&self, corners: &Corners, _state: &[f64]) -> f64 {
        self.corners().distance_squared(corners)
    }

    /// Called by search methods at the start of each frame, with the state of the frame before.
    fn begin_frame(&mut self) {}

    /// Adds what is known of likely states to the gradient and the (negative definite) Hessian of an additive step.
    fn regularise(&self, _gradient: &mut [f64], _hessian: &mut SymMatrix) {}

    /// Grid points in the base frame.
    fn grid(&self) -> Points<'_>;

    /// Current place of grid point `i` in image pixels, in `f64`: the slow reference of [`warp_into`](Self::warp_into).
    fn point(&self, i: usize) -> [f64; 2];

    /// Current place of any place `x` of the frame it was initialised on, px; `None` when the corners tell all, as those
    /// of a plane do.
    fn place(&self, _x: [f64; 2]) -> Option<[f64; 2]> {
        None
    }

    /// Writes the current points in image pixels.
    fn warp_into(&self, x: &mut [f32], y: &mut [f32]);

    /// Writes where the grid, moved by `offset` in the base frame, is warped to, in image pixels. The default, for warps
    /// that do not compose, moves the warped points alike.
    fn warp_offset_into(&self, offset: [f64; 2], x: &mut [f32], y: &mut [f32]) {
        self.warp_into(x, y);
        for (out, d) in [x, y].into_iter().zip(offset) {
            out.iter_mut().for_each(|v| *v += (self.radius() * d) as f32);
        }
    }

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

    /// Adds `Σ_i weights_i K_i` to `h`, `K_i = d²I_i/dp²` of the given kind: the second-order part of a Hessian.
    fn curvature_into(
        &self,
        kind: JacobianKind,
        weights: &[f32],
        gradient: Gradient<'_>,
        hessian: ImageHessian<'_>,
        h: &mut SymMatrix,
    );

    /// Factor from pixels to the base frame for image gradients: `∂I/∂(frame) = r ∂I/∂(pixel)`.
    fn radius(&self) -> f64;

    /// Bytes kept between frames.
    fn memory(&self) -> usize;
}

dyn_clone::clone_trait_object!(StateSpaceModel);

impl StateSpaceModel for Box<dyn StateSpaceModel> {
    fn dof(&self) -> usize {
        (**self).dof()
    }
    fn capabilities(&self) -> SsmCapabilities {
        (**self).capabilities()
    }
    fn init(&mut self, corners: &Corners, res: Resolution) -> Result<(), TrackError> {
        (**self).init(corners, res)
    }
    fn state(&self) -> &[f64] {
        (**self).state()
    }
    fn set_state(&mut self, p: &[f64]) -> Result<(), TrackError> {
        (**self).set_state(p)
    }
    fn update(&mut self, how: Increment, delta: &[f64]) -> Result<(), TrackError> {
        (**self).update(how, delta)
    }
    fn corners(&self) -> Corners {
        (**self).corners()
    }
    fn corners_at(&self, p: &[f64]) -> Corners {
        (**self).corners_at(p)
    }
    fn base_corners(&self) -> Corners {
        (**self).base_corners()
    }
    fn fit_corners(&mut self, corners: &Corners) -> Result<f64, TrackError> {
        (**self).fit_corners(corners)
    }
    fn fit_into(&self, from: &[[f64; 2]], to: &[[f64; 2]], p: &mut [f64]) -> Result<(), TrackError> {
        (**self).fit_into(from, to, p)
    }
    fn estimate(
        &mut self,
        estimator: &mut Estimator,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
    ) -> Result<(), TrackError> {
        (**self).estimate(estimator, from, to)
    }
    fn relative_into(&self, p: &[f64], q: &[f64], out: &mut [f64]) -> Result<(), TrackError> {
        (**self).relative_into(p, q, out)
    }
    fn group_mean_into(&self, states: &[f64], weights: &[f64], out: &mut [f64]) -> Result<(), TrackError> {
        (**self).group_mean_into(states, weights, out)
    }
    fn rebase(&mut self, corners: &Corners) -> Result<Mat3, TrackError> {
        (**self).rebase(corners)
    }
    fn motion_squared(&self, corners: &Corners, state: &[f64]) -> f64 {
        (**self).motion_squared(corners, state)
    }
    fn begin_frame(&mut self) {
        (**self).begin_frame()
    }
    fn regularise(&self, gradient: &mut [f64], hessian: &mut SymMatrix) {
        (**self).regularise(gradient, hessian)
    }
    fn grid(&self) -> Points<'_> {
        (**self).grid()
    }
    fn point(&self, i: usize) -> [f64; 2] {
        (**self).point(i)
    }
    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        (**self).place(x)
    }
    fn warp_into(&self, x: &mut [f32], y: &mut [f32]) {
        (**self).warp_into(x, y)
    }
    fn warp_offset_into(&self, offset: [f64; 2], x: &mut [f32], y: &mut [f32]) {
        (**self).warp_offset_into(offset, x, y)
    }
    fn jacobian_into(
        &self,
        kind: JacobianKind,
        gradient: Gradient<'_>,
        points: Points<'_>,
        row: usize,
        j: &mut Jacobian,
    ) {
        (**self).jacobian_into(kind, gradient, points, row, j)
    }
    fn curvature_into(
        &self,
        kind: JacobianKind,
        weights: &[f32],
        gradient: Gradient<'_>,
        hessian: ImageHessian<'_>,
        h: &mut SymMatrix,
    ) {
        (**self).curvature_into(kind, weights, gradient, hessian, h)
    }
    fn radius(&self) -> f64 {
        (**self).radius()
    }
    fn memory(&self) -> usize {
        (**self).memory()
    }
}

/// The family of state space models.
#[derive(Clone, Copy, Debug)]
pub struct SsmFamily;

impl Family for SsmFamily {
    type Build = Build<Box<dyn StateSpaceModel>>;
    const ROLE: &'static str = "state space model";
}

/// A row of the table of state space models.
pub type SsmEntry = Entry<SsmFamily>;

impl SsmEntry {
    /// The entry of model `M`.
    pub const fn of<M: StateSpaceModel + Part>() -> Self {
        Entry::of_part::<M>(
            |a| Ok(Box::new(M::new(M::Params::from_assignments(a)?))),
            SsmFamily,
        )
    }
}

/// Ground truth within a model of few parameters: the region that `model`, started at `base`, takes where it fits
/// `corners` best. Fails when `base` is no region or `corners` determine no state.
pub fn fit_truth(model: &SsmEntry, base: &Corners, corners: &Corners) -> Result<Corners, TruthError> {
    let mut ssm = (model.build)(&[])?;
    // The grid plays no part.
    ssm.init(base, Resolution { cols: 2, rows: 2 })?;
    ssm.fit_corners(corners)?;
    Ok(ssm.corners())
}

/// A state space model by its name, as a parameter of trackers that have a warp of their own.
pub type SsmName = NameOf<SsmFamily>;

impl Default for SsmName {
    fn default() -> Self {
        SsmName::new(Homography::NAME)
    }
}

/// Why ground truth cannot be fitted with a model.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// Bad parameter.
    #[error(transparent)]
    Param(#[from] crate::params::ParamError),
    /// Bad corners.
    #[error(transparent)]
    Region(#[from] TrackError),
}
