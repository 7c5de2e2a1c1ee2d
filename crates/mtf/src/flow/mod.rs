//! Motion of points between two frames.
//!
//! Depends on `image`, `kernels`, `params` and `threads` only.

mod klt;

pub use klt::{Klt, KltParams, PointStatus, Texture, Tracked};
