//! Hot loops only: slices in, slices out, no traits but [`Lanes`], no allocation.
//!
//! Every kernel stands beside a slow reference in `f64` (in its tests or as `*_reference`), and runs with identical
//! results on any instruction set. Depends on nothing else in the crate but plain data types.

mod blend;
pub mod blur;
pub mod gray;
mod lanes;
mod normal;
mod reduce;
mod sample;
mod steepest;
mod warp;

pub use blend::{accumulate, product, row_times, scale_shift};
#[cfg(target_arch = "x86_64")]
pub use lanes::Avx2;
pub(crate) use lanes::dispatch;
pub use lanes::{Lanes, Portable, SimdLevel, WIDTH, simd_level};
pub use normal::{Jacobian, normal_equations, project};
pub use reduce::{combine, dot, rescale, squared_distance, subtract, subtract_from, sum};
pub use sample::{Border, Grid2, image_hessian, sample, sample_gradient, sample_reference};
pub use steepest::{Column, Covectors, steepest, steepest_reference};
pub use warp::warp_projective;
