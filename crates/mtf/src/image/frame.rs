//! One frame of a sequence, shared by every tracker that runs on it.

use super::pixel_view::Copied;
use super::{Identity, Image, PixelView, Pixels, PreProcessor, pyramid};
use std::sync::{Arc, OnceLock};

/// A decoded frame with its pre-processed float images and their pyramid, each made at most once and on first use.
///
/// A handle: clones share everything, so a tracker that needs the frame before keeps a clone of it.
#[derive(Clone, Debug)]
pub struct Frame(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    width: usize,
    height: usize,
    pre: Arc<dyn PreProcessor>,
    /// Made from a float image, which `gray` holds from the start.
    made: bool,
    /// Float pixels as they came in, before `pre`.
    floats: Option<Image>,
    decoded: OnceLock<Pixels>,
    gray: OnceLock<Image>,
    colour: OnceLock<Image>,
    /// The next level of the pyramid, gray and colour.
    half: OnceLock<Frame>,
    half_colour: OnceLock<Frame>,
}

impl Frame {
    fn build(width: usize, height: usize, pre: Arc<dyn PreProcessor>, made: bool) -> Inner {
        Inner {
            width,
            height,
            pre,
            made,
            floats: None,
            decoded: OnceLock::new(),
            gray: OnceLock::new(),
            colour: OnceLock::new(),
            half: OnceLock::new(),
            half_colour: OnceLock::new(),
        }
    }

    /// A frame from decoded pixels; `pre` is applied to each float image made from it.
    pub fn new(decoded: Pixels, pre: Arc<dyn PreProcessor>) -> Self {
        let (width, height) = (decoded.width(), decoded.height());
        Frame(Arc::new(Inner {
            decoded: OnceLock::from(decoded),
            ..Self::build(width, height, pre, false)
        }))
    }

    /// A frame from pixels in somebody else's memory, which are copied; `pre` is applied to each float image made from them.
    /// The gray of colours is BT.601, `0.299 R + 0.587 G + 0.114 B`, rounded for bytes and not for floats.
    ///
    /// Where no tracker reads colour, a gray view saves the copy of the colours.
    pub fn from_view(view: &PixelView<'_>, pre: Arc<dyn PreProcessor>) -> Self {
        match view.copied() {
            Copied::Bytes(pixels) => Frame::new(pixels, pre),
            Copied::Floats(image) => Frame(Arc::new(Inner {
                floats: Some(image),
                ..Self::build(view.width(), view.height(), pre, false)
            })),
        }
    }

    /// A frame that is this single-plane image as it stands (repeated in each plane in colour), for callers that have
    /// made their own.
    pub fn from_gray(image: Image) -> Self {
        let (width, height) = (image.width(), image.height());
        Frame(Arc::new(Inner {
            gray: OnceLock::from(image),
            ..Self::build(width, height, Arc::new(Identity), true)
        }))
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.0.width
    }
    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.0.height
    }
    /// The pixels as they came in; for frames made of floats, those rounded.
    pub fn decoded(&self) -> &Pixels {
        self.0
            .decoded
            .get_or_init(|| Pixels::from_image(self.0.floats.as_ref().unwrap_or_else(|| self.gray())))
    }
    /// Pre-processed single-plane image, 0–255 (BT.601 gray).
    pub fn gray(&self) -> &Image {
        self.0.gray.get_or_init(|| {
            let raw = match &self.0.floats {
                Some(image) => image.to_gray(),
                None => self.decoded().to_gray(),
            };
            self.0.pre.apply(raw)
        })
    }
    /// Pre-processed image of three planes R, G, B, 0–255 (a gray file is repeated in each).
    pub fn colour(&self) -> &Image {
        self.0.colour.get_or_init(|| {
            if self.0.made {
                return self.gray().to_colour();
            }
            let raw = match &self.0.floats {
                Some(image) => image.to_colour(),
                None => self.decoded().to_colour(),
            };
            self.0.pre.apply(raw)
        })
    }
    /// [`gray`](Self::gray) for 1 channel, [`colour`](Self::colour) for 3.
    pub fn with_channels(&self, channels: usize) -> &Image {
        if channels == 1 { self.gray() } else { self.colour() }
    }

    /// The frame at half the size, pixel `(x, y)` at `(2x, 2y)` of this one, low-pass filtered; made once and shared.
    /// With 1 channel its colour is gray. `None` for frames of less than 24 px on a side.
    pub fn half(&self, channels: usize) -> Option<&Frame> {
        if self.width().min(self.height()) < pyramid::MIN_SIDE {
            return None;
        }
        let gray = self
            .0
            .half
            .get_or_init(|| Frame::from_gray(pyramid::halve(self.gray())));
        if channels == 1 {
            return Some(gray);
        }
        Some(self.0.half_colour.get_or_init(|| {
            Frame(Arc::new(Inner {
                gray: OnceLock::from(gray.gray().clone()),
                colour: OnceLock::from(pyramid::halve(self.colour())),
                ..Self::build(gray.width(), gray.height(), Arc::new(Identity), true)
            }))
        }))
    }

    /// Whether anybody has read the pyramid, so that it has been made.
    pub fn is_halved(&self) -> bool {
        self.0.half.get().is_some()
    }

    /// Level `level` of the pyramid: this frame halved that many times, or the smallest there is.
    pub fn level(&self, level: usize, channels: usize) -> &Frame {
        let mut at = self;
        for _ in 0..level {
            let Some(half) = at.half(channels) else { break };
            at = half;
        }
        at
    }

    /// Number of levels of the pyramid, itself included.
    pub fn levels(&self) -> usize {
        let (mut side, mut levels) = (self.width().min(self.height()), 1);
        while side >= pyramid::MIN_SIDE {
            side = side.div_ceil(2);
            levels += 1;
        }
        levels
    }
}
