//! Plane geometry in `f64`: corners, polygons, 3x3 matrices, small symmetric solvers.
//!
//! Depends on nothing else in the crate. Image coordinates everywhere: x right, y down, pixels, pixel centres at
//! integers, so `(0, 0)` is the centre of the top-left pixel.

mod corners;
pub mod fit;
pub mod homography;
pub mod lie;
pub mod polygon;
pub mod solve;

pub use corners::{Corners, LARGEST_REGION};
/// 3x3 matrix acting on homogeneous points `(x, y, 1)`.
pub type Mat3 = nalgebra::Matrix3<f64>;
