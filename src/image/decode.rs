//! Decoding. To be written.

use super::Image;

/// Decoded 8-bit pixels.
#[derive(Clone, Debug)]
pub struct Decoded {
    width: usize,
    height: usize,
}

impl Decoded {
    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }
    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }
    pub(crate) fn gray_from_image(image: &Image) -> Self {
        Decoded {
            width: image.width(),
            height: image.height(),
        }
    }
    pub(crate) fn to_gray(&self) -> Image {
        Image::new(self.width, self.height, 1)
    }
    pub(crate) fn to_colour(&self) -> Image {
        Image::new(self.width, self.height, 3)
    }
}

/// Why an image cannot be decoded.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {}

/// Decodes.
pub fn decode(_bytes: &[u8], _colour: bool) -> Result<Decoded, ImageError> {
    todo!()
}
/// Decodes a file.
pub fn decode_file(_path: &std::path::Path, _colour: bool) -> Result<Decoded, ImageError> {
    todo!()
}
