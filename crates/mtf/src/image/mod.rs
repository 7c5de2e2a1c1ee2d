//! Images: gray and colour float planes, pre-processing, frames shared by many trackers.
//!
//! Depends on `kernels` only.

mod frame;
mod pixels;
mod planar;
mod preprocess;
mod pyramid;

pub use frame::Frame;
pub use pixels::Pixels;
pub use planar::Image;
pub use preprocess::{
    Gaussian, Identity, PREPROCESSORS, PreProcessor, PreProcessorEntry, PreProcessorError, parse_preprocessor,
};
