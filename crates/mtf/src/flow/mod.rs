//! Motion of points between two frames.
//!
//! Depends on `image`, `kernels` and `params` only.

mod klt;

pub use klt::{Klt, KltParams, PointStatus, Texture, Tracked};
