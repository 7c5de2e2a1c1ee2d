//! Registration-based tracking, decomposed into search method x appearance model x state space model.
#![deny(missing_docs)]

pub mod am;
pub mod best;
pub mod compose;
pub mod conformance;
pub mod diagnose;
pub mod entry;
pub mod estimate;
pub mod expr;
pub mod features;
pub mod flow;
pub mod geom;
pub mod ilm;
pub mod image;
mod kernels;
pub mod params;
pub mod registry;
pub mod sm;
pub mod ssm;
pub mod tracker;

pub use kernels::{Jacobian, SimdLevel, simd_level};

/// Kernels for the benches of this workspace to time. No part of the interface.
#[doc(hidden)]
pub mod bench_kernels {
    pub use crate::kernels::{
        Border, PlaneView, hist, normal_equations, project, sample, sample_gradient, sample_reference,
        squared_distance, steepest_reference, weighted_normal_equations,
    };
}

/// What most programs need.
pub mod prelude {
    pub use crate::am::{AppearanceModel, Ncc, Ssd, Zncc};
    pub use crate::geom::Corners;
    pub use crate::ilm::{Gb, IlluminationModel, Pgb, Rbf};
    pub use crate::image::{Frame, Image, parse_preprocessor};
    pub use crate::registry::{Registry, Selection, TrackerSpec};
    pub use crate::sm::{Esm, Falk, Fclk, Ialk, Iclk};
    pub use crate::ssm::{Affine, Homography, Isometry, Similitude, StateSpaceModel, Translation};
    pub use crate::tracker::{TrackError, Tracker, Update};
}
