//! Hot loops only: slices in, slices out, no traits but [`lanes::Lanes`], no allocation.
//!
//! Every fast kernel stands beside its slow reference in `f64` (functions in `reference` modules), and the two are
//! compared in tests. Depends on nothing else in the crate but plain image types.

pub mod blur;
pub mod gray;
pub mod lanes;

#[cfg(target_arch = "x86_64")]
pub use lanes::Avx2;
pub(crate) use lanes::dispatch;
pub use lanes::{Lanes, Portable, SimdLevel, WIDTH, simd_level};
