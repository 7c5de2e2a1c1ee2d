//! The Lucas-Kanade family: gradient searches that share one driver.
//!
//! A file per method; `driver` iterates, `kit` hands a method Jacobians, gradients and Hessians, `light` adds an
//! illumination model, `mask` selects points. May depend on all below search methods and on the searches' sampling.

mod driver;
mod entry;
mod esm;
mod falk;
mod fclk;
mod fcsd;
mod haclk;
mod hesm;
mod ialk;
mod iclk;
mod kit;
mod light;
mod mask;
mod method;
mod params;
mod relaxation;

pub use driver::Lk;
pub(super) use entry::entry;
pub use esm::{AesmMethod, EsmMethod, EsmParams};
pub use falk::FalkMethod;
pub use fclk::FclkMethod;
pub use fcsd::{FcsdMethod, FcsdParams};
pub use haclk::HaclkMethod;
pub use hesm::{CoarseWarp, HesmMethod, HesmParams};
pub use ialk::IalkMethod;
pub use iclk::IclkMethod;
pub use kit::Kit;
pub use mask::{MaskParams, PointRule};
pub use method::LkMethod;
pub use params::{Hessian, LkParams};
