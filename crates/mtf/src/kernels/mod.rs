//! Hot loops only: slices in, slices out, no traits but [`Lanes`], no allocation.
//!
//! Every kernel stands beside a slow reference in `f64` (in its tests or as `*_reference`), and runs with identical
//! results on any instruction set. A slice that is too short panics. Depends on the matrices of `geom` only. Private to the
//! crate; [`Jacobian`] and [`simd_level`] are public at its root.

mod blend;
mod blocks;
pub mod blur;
mod cholesky;
mod corner;
mod falloff;
mod filter;
mod flow;
mod gradient;
pub mod gray;
mod halve;
mod hamming;
pub mod hist;
mod jacobian;
mod lanes;
mod median;
mod normal;
pub mod pad;
mod photometric;
mod pixelwise;
mod plane;
mod reduce;
mod robust;
mod sample;
mod scan;
mod steepest;
pub mod stencil;
#[cfg(test)]
mod tests;
mod tone;
mod warp;

pub use blend::{accumulate, product, row_times, scale_shift};
pub use blocks::block_moments;
pub use cholesky::factorise;
pub use corner::{CENTROID_RADIUS, centroid, corner_response, corner_scratch_len, row_peaks};
pub use falloff::{Falloff, Tap, bilateral_row, diffuse_row};
pub use filter::{Pass, filter_pass, subtract_combination};
pub use flow::{FlowWindow, Place, flow_match, flow_mismatch, flow_window, flow_window_warped};
pub use gradient::gradient_row;
pub use halve::{halve, halve_scratch_len};
pub use hamming::{Bits, hamming, hamming_distances};
pub use jacobian::Jacobian;
#[cfg(test)]
use lanes::Portable;
use lanes::{Lanes, WIDTH, dispatch};
pub use lanes::{SimdLevel, simd_level};
pub use median::{MAX_MEDIAN, median_in_place};
pub use normal::{block_gram, normal_equations, project, weighted_normal_equations};
pub use photometric::{light, multiply, unlight};
pub use pixelwise::{
    absolute_distance, affine_product, ratio_variation, reciprocal, spss_curvature, spss_distance,
    spss_gradient, spss_losses, spss_self, weighted_difference,
};
pub use plane::PlaneView;
pub use reduce::{
    add_scaled, combine, dot, moments, rescale, squared_distance, subtract, subtract_from, sum,
};
pub use robust::{add_steep, huber, keep_close, tukey, weighted_squares};
pub use sample::{Border, image_hessian, sample, sample_gradient, sample_reference};
pub use scan::{SCAN_SLACK, correlate_along};
pub use steepest::{Column, Covectors, steepest, steepest_reference};
pub use tone::{
    Window, blend_weights, line_shift, line_sums, linear_shift, shifted_residual, step_shift, tone_bins,
    tone_sums,
};
pub use warp::{regular_grid, warp_projective};
