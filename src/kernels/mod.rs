//! Hot loops only: slices in, slices out, no traits but [`Lanes`], no allocation.
//!
//! Every kernel stands beside a slow reference in `f64` (in its tests or as `*_reference`), and runs with identical
//! results on any instruction set. Depends on nothing else in the crate but plain data types.

pub mod blur;
pub mod gray;
pub mod hist;
mod lanes;
mod normal;
mod reduce;
mod sample;
mod steepest;
pub mod stencil;
mod warp;
mod weighted;

#[cfg(target_arch = "x86_64")]
pub use lanes::Avx2;
pub(crate) use lanes::dispatch;
pub use lanes::{Lanes, Portable, SimdLevel, WIDTH, simd_level};
pub use normal::{Jacobian, normal_equations, project};
pub use reduce::{add_scaled, combine, dot, rescale, squared_distance, subtract, subtract_from, sum};
pub use sample::{Border, Grid2, image_hessian, sample, sample_gradient, sample_reference};
pub use steepest::{Column, Covectors, steepest, steepest_reference};
pub use warp::warp_projective;
pub use weighted::weighted_gram;
