//! Images: decoding, gray and colour float planes, pre-processing, frames shared by many trackers.
//!
//! Depends on `kernels` and `error` only.

mod decode;
mod frame;
mod plane;
mod preprocess;
mod pyramid;

pub use decode::{Decoded, ImageError, MAX_PIXELS, decode, decode_file, dimensions};
pub use frame::Frame;
pub use plane::Image;
pub use preprocess::{
    Gaussian, Identity, PREPROCESSORS, PreProcessor, PreProcessorEntry, PreProcessorError, parse_preprocessor,
};
