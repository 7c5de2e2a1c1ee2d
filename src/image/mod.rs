//! Images: decoding, gray and colour float planes, pre-processing, frames shared by many trackers.
//!
//! Depends on `kernels` and `error` only.

mod decode;
mod frame;
mod plane;
mod preprocess;

pub use decode::{Decoded, ImageError, decode, decode_file};
pub use frame::Frame;
pub use plane::Image;
pub use preprocess::{Gaussian, Identity, PreProcessor, parse_preprocessor};
