//! Images: pixels as they come in, gray and colour float planes, pre-processing, frames shared by many trackers.
//!
//! A frame is made of pixels in somebody else's memory ([`PixelView`]), of decoded ones that it keeps ([`Pixels`]), or of
//! a float image as it stands ([`Image`]).
//!
//! Depends on `kernels` only.

mod frame;
mod pixel_view;
mod pixels;
mod planar;
mod preprocess;
mod pyramid;

pub use frame::Frame;
pub use pixel_view::{PixelError, PixelView, Samples};
pub use pixels::Pixels;
pub use planar::Image;
pub use preprocess::{
    Anisotropic, Bilateral, Boxed, Chain, Equalised, Gaussian, Identity, Median, PREPROCESSORS, PreProcessor,
    PreProcessorEntry, PreProcessorError, Sobel, parse_preprocessor,
};
