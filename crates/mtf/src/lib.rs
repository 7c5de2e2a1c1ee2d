//! Registration-based tracking, decomposed into search method x appearance model x state space model.
#![deny(missing_docs)]

pub mod am;
pub mod best;
pub mod compose;
pub mod diagnose;
pub mod entry;
pub mod estimate;
pub mod expr;
pub mod features;
pub mod flow;
pub mod geom;
pub mod ilm;
pub mod image;
pub mod kernels;
pub mod params;
pub mod registry;
pub mod sm;
pub mod ssm;
pub mod tracker;

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
