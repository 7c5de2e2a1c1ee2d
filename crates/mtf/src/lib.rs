//! Tracking of planar objects by registration: in every frame, find the warp that makes the image inside a region look like
//! the region did in the first frame.
//!
//! # The decomposition
//!
//! Every tracker here is put together from parts that know nothing of one another, after Singh & Jagersand, *Modular
//! Tracking Framework: A fast library for high precision tracking*:
//!
//! - The **state space model** (SSM, [`ssm`]) says how the region may move. It maps points of the first frame to points of
//!   this frame with a few numbers, the state: 2 for a translation, 6 for an affine map, 8 for a homography.
//! - The **appearance model** (AM, [`am`]) says how alike two patches of pixels are: the sum of squared differences, normalised
//!   cross-correlation, mutual information and others.
//! - The **search method** (SM, [`sm`]) looks for the state with which the patch under the warp is most like the first one.
//!   Some follow gradients (Lucas & Kanade and their heirs), some draw samples (particle filter, nearest neighbours).
//! - The **illumination model** (ILM, [`ilm`]) is optional. It says how light may change the patch, as a gain and a bias, say.
//!
//! A tracker is written `SM/AM/SSM` or `SM/AM/SSM/ILM`: `esm/zncc/homography`, `iclk/ssd/affine/gb`. Any search method
//! works with any appearance model and any state space model that have what it needs; [`registry`] knows which do.
//! **Composites** ([`compose`], [`features`]) are trackers made of others: one after the other, side by side, on a grid, over
//! a pyramid. The tracker [`best`] has no parts to choose.
//!
//! # A tracker in ten lines
//!
//! ```
//! use mtf::image::{PixelView, Samples};
//! use mtf::prelude::*;
//!
//! // What a camera would deliver: gray bytes, the object shifted by `dx` pixels.
//! let camera = |dx: f64| -> Vec<u8> {
//!     let at = |i: usize| [(i % 160) as f64 - dx, (i / 160) as f64];
//!     let wave = |[x, y]: [f64; 2]| 128.0 + 60.0 * ((0.2 * x).sin() + (0.15 * y + 0.1 * x).cos());
//!     (0..160 * 120).map(|i| wave(at(i)) as u8).collect()
//! };
//! let blur = parse_preprocessor("gaussian:5:3")?;
//! let frame = |bytes: &[u8]| -> Result<Frame, mtf::image::PixelError> {
//!     Ok(Frame::from_view(&PixelView::new(160, 120, 160, Samples::Gray8(bytes))?, blur.clone()))
//! };
//!
//! let registry = Registry::builtin();
//! let mut tracker = registry.build(&registry.parse("esm/ssd/homography")?)?;
//! let start = Corners::rect(50.0, 40.0, 60.0, 40.0);
//! tracker.init(&frame(&camera(0.0))?, &start)?;
//! let found = tracker.update(&frame(&camera(2.5))?)?.corners;
//! assert!(found.mean_distance(&start.translated(2.5, 0.0)) < 0.2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! With the types known when the program is compiled, the same tracker is `Esm::new(Ssd::default(), Homography::new())`.
//! Coordinates are in pixels, x to the right, y down, with `(0, 0)` the centre of the upper left pixel. Corners stand in the
//! order upper left, upper right, lower right, lower left. Intensities are 0–255.
//!
//! # Modules, lowest first
//!
//! A module uses those above it in this table only.
//!
//! | module | holds |
//! |---|---|
//! | [`geom`], [`mod@params`], [`expr`] | plane geometry; parameters of models; expressions such as `grid(iclk/ssd/affine)` |
//! | [`interrupt`] | ending long work early |
//! | [`entry`] | the rows of the tables of models |
//! | `kernels` (private) | hot loops over slices |
//! | [`image`] | pixels, float images, filters, frames |
//! | [`tracker`] | the trait of every tracker, its result and its errors |
//! | [`consensus`] | warps of point pairs with outliers |
//! | [`flow`] | motion of points between frames |
//! | [`am`], [`ilm`], [`ssm`] | the models |
//! | [`sm`] | the search methods |
//! | [`features`] | key points, and the tracker by them |
//! | [`compose`] | trackers made of trackers |
//! | [`best`] | the tracker without options |
//! | [`registry`] | models and trackers by name, which fit together, and how they are built |
//! | [`diagnose`] | derivatives and similarities looked at closely |
//! | [`conformance`] | tests that every model of a registry must pass |
//!
//! # A model of your own
//!
//! Implement [`AppearanceModel`](am::AppearanceModel) (say), give it a name and parameters, and add it to a [`Registry`]:
//! it then stands wherever a built-in model may stand. The mathematics that a model must supply is at the head of [`am`],
//! [`ssm`] and [`ilm`]; a search method gets it as vectors and as [`Jacobian`]s, one column per parameter. Each model names
//! the paper it is from in its own module.
//!
//! [`Registry`]: registry::Registry
#![deny(missing_docs)]

pub mod am;
pub mod best;
pub mod compose;
pub mod conformance;
pub mod consensus;
pub mod diagnose;
pub mod entry;
pub mod expr;
pub mod features;
pub mod flow;
pub mod geom;
pub mod ilm;
pub mod image;
pub mod interrupt;
mod kernels;
pub mod params;
pub mod registry;
pub mod sm;
pub mod ssm;
mod threads;
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
