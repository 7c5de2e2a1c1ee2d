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
mod model;
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
pub use model::{
    Estimable, Geometric, Gradient, ImageHessian, Increment, JacobianKind, MatrixGroup, NonRigid, Points,
    Reference, SecondOrder, SsmCapabilities, StateSpaceModel, begin_frame, estimate, motion_squared, place,
};
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

use crate::entry::{Build, Entry, Family, NameOf, Part};
use crate::geom::Corners;
use crate::params::{Params, Resolution};
use crate::tracker::TrackError;

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
