//! One frame of a sequence, shared by every tracker that runs on it.

use super::{Decoded, Image, PreProcessor};
use std::sync::{Arc, OnceLock};

/// A decoded frame with its pre-processed float images, each made at most once and on first use.
///
/// Cheap to share between threads behind an `Arc`; trackers borrow what they need from it.
#[derive(Debug)]
pub struct Frame {
    decoded: Decoded,
    pre: Arc<dyn PreProcessor>,
    gray: OnceLock<Image>,
    colour: OnceLock<Image>,
}

impl Frame {
    /// A frame from decoded pixels; `pre` is applied to each float image made from it.
    pub fn new(decoded: Decoded, pre: Arc<dyn PreProcessor>) -> Self {
        Frame {
            decoded,
            pre,
            gray: OnceLock::new(),
            colour: OnceLock::new(),
        }
    }

    /// A frame that is this single-plane image as it stands (repeated in each plane in colour), for callers that have
    /// made their own.
    pub fn from_gray(image: Image) -> Self {
        let decoded = Decoded::gray_from_image(&image);
        let mut colour = Image::new(image.width(), image.height(), 3);
        for c in 0..3 {
            colour.plane_mut(c).copy_from_slice(image.plane(0));
        }
        Frame {
            decoded,
            pre: Arc::new(super::Identity),
            gray: OnceLock::from(image),
            colour: OnceLock::from(colour),
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.decoded.width()
    }
    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.decoded.height()
    }
    /// The pixels as they came from the file.
    pub fn decoded(&self) -> &Decoded {
        &self.decoded
    }
    /// Pre-processed single-plane image, 0–255 (BT.601 gray).
    pub fn gray(&self) -> &Image {
        self.gray.get_or_init(|| self.pre.apply(self.decoded.to_gray()))
    }
    /// Pre-processed image of three planes R, G, B, 0–255 (a gray file is repeated in each).
    pub fn colour(&self) -> &Image {
        self.colour
            .get_or_init(|| self.pre.apply(self.decoded.to_colour()))
    }
    /// [`gray`](Self::gray) for 1 channel, [`colour`](Self::colour) for 3.
    pub fn with_channels(&self, channels: usize) -> &Image {
        if channels == 1 { self.gray() } else { self.colour() }
    }
}
