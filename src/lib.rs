//! Registration-based tracking, decomposed into search method x appearance model x state space model, and its
//! evaluation on image sequences with ground truth.
#![deny(missing_docs)]

pub mod am;
pub mod compose;
pub mod dataset;
pub mod diagnose;
pub mod estimate;
pub mod eval;
pub mod expr;
pub mod features;
pub mod flow;
pub mod geom;
pub mod ilm;
pub mod image;
pub mod kernels;
pub mod output;
pub mod params;
pub mod registry;
pub mod sm;
pub mod ssm;
pub mod synth;
pub mod tracker;

/// What most programs need.
pub mod prelude {
    pub use crate::am::{AppearanceModel, Ncc, Ssd, Zncc};
    pub use crate::dataset;
    pub use crate::eval::error::frame_error;
    pub use crate::geom::Corners;
    pub use crate::ilm::{Gb, IlluminationModel, Pgb, Rbf};
    pub use crate::image::{Frame, Image, parse_preprocessor};
    pub use crate::registry::{Registry, Selection, TrackerSpec};
    pub use crate::sm::{Esm, Falk, Fclk, Ialk, Iclk};
    pub use crate::ssm::{Affine, Homography, Isometry, Similitude, StateSpaceModel, Translation};
    pub use crate::tracker::{TrackError, Tracker, Update};
}
