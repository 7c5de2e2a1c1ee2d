//! Pixels that stand in somebody else's memory: what a camera driver or another library delivers.

use super::{Image, Pixels};

/// The numbers of a [`PixelView`], row by row, and what they mean. Colours are interleaved: all channels of a pixel stand
/// side by side. Intensities are 0–255, also of `f32`. Alpha is passed over.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Samples<'a> {
    /// Gray, one byte per pixel.
    Gray8(&'a [u8]),
    /// Red, green, blue.
    Rgb8(&'a [u8]),
    /// Blue, green, red.
    Bgr8(&'a [u8]),
    /// Red, green, blue, alpha.
    Rgba8(&'a [u8]),
    /// Blue, green, red, alpha.
    Bgra8(&'a [u8]),
    /// Gray, one float per pixel.
    GrayF32(&'a [f32]),
    /// Red, green, blue, floats.
    RgbF32(&'a [f32]),
}

impl Samples<'_> {
    /// Elements per pixel.
    fn channels(&self) -> usize {
        match self {
            Samples::Gray8(_) | Samples::GrayF32(_) => 1,
            Samples::Rgb8(_) | Samples::Bgr8(_) | Samples::RgbF32(_) => 3,
            Samples::Rgba8(_) | Samples::Bgra8(_) => 4,
        }
    }

    /// Elements in all.
    fn len(&self) -> usize {
        match self {
            Samples::Gray8(s)
            | Samples::Rgb8(s)
            | Samples::Bgr8(s)
            | Samples::Rgba8(s)
            | Samples::Bgra8(s) => s.len(),
            Samples::GrayF32(s) | Samples::RgbF32(s) => s.len(),
        }
    }
}

/// Why a buffer is no image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PixelError {
    /// The width or the height is zero.
    #[error("an image of {width} x {height} pixels is empty")]
    Empty {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
    },
    /// More pixels than can be counted in 31 bits.
    #[error("an image of {width} x {height} pixels is too large")]
    TooLarge {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
    },
    /// Rows overlap.
    #[error("rows start {stride} elements apart, but each is {needed} long")]
    Stride {
        /// Elements between the starts of two rows.
        stride: usize,
        /// Elements in a row.
        needed: usize,
    },
    /// The buffer ends before the last pixel.
    #[error("the buffer has {got} elements, {needed} are needed")]
    TooShort {
        /// Elements in the buffer.
        got: usize,
        /// Elements up to the end of the last row.
        needed: usize,
    },
}

/// An image in borrowed memory, its size and length checked.
///
/// ```
/// use mtf::image::{PixelView, Samples};
/// // Two rows of three gray pixels, each row padded to four bytes.
/// let buffer = [10, 20, 30, 0, 40, 50, 60, 0];
/// let view = PixelView::new(3, 2, 4, Samples::Gray8(&buffer))?;
/// assert_eq!((view.width(), view.height()), (3, 2));
/// assert!(PixelView::new(3, 3, 4, Samples::Gray8(&buffer)).is_err());
/// # Ok::<(), mtf::image::PixelError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PixelView<'a> {
    width: usize,
    height: usize,
    stride: usize,
    samples: Samples<'a>,
}

/// Pixels of a view in memory of their own: bytes stay bytes, floats become planes.
pub(super) enum Copied {
    Bytes(Pixels),
    Floats(Image),
}

impl<'a> PixelView<'a> {
    /// `width` x `height` pixels whose rows start `stride` elements of `samples` apart (elements, not bytes; at least a row's
    /// length). After the last row no padding is needed.
    pub fn new(width: usize, height: usize, stride: usize, samples: Samples<'a>) -> Result<Self, PixelError> {
        if width == 0 || height == 0 {
            return Err(PixelError::Empty { width, height });
        }
        let largest = |w: usize, h: usize| (w + 8).checked_mul(h + 1).is_some_and(|n| n <= i32::MAX as usize);
        if width.max(height) >= 1 << 24 || !largest(width, height) {
            return Err(PixelError::TooLarge { width, height });
        }
        let row = width * samples.channels();
        if stride < row {
            return Err(PixelError::Stride { stride, needed: row });
        }
        let needed = stride.saturating_mul(height - 1).saturating_add(row);
        if samples.len() < needed {
            return Err(PixelError::TooShort {
                got: samples.len(),
                needed,
            });
        }
        Ok(PixelView {
            width,
            height,
            stride,
            samples,
        })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }
    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// A copy in memory of its own.
    pub(super) fn copied(&self) -> Copied {
        match self.samples {
            Samples::Gray8(s) => {
                let mut gray = Vec::with_capacity(self.width * self.height);
                self.rows(s).for_each(|row| gray.extend_from_slice(row));
                Copied::Bytes(Pixels::from_gray(self.width, self.height, gray))
            }
            Samples::Rgb8(s) => self.colours(s, [0, 1, 2]),
            Samples::Bgr8(s) => self.colours(s, [2, 1, 0]),
            Samples::Rgba8(s) => self.colours(s, [0, 1, 2]),
            Samples::Bgra8(s) => self.colours(s, [2, 1, 0]),
            Samples::GrayF32(s) | Samples::RgbF32(s) => {
                let channels = self.samples.channels();
                let mut image = Image::new(self.width, self.height, channels);
                for c in 0..channels {
                    for (y, row) in self.rows(s).enumerate() {
                        let from = row[c..].iter().step_by(channels);
                        image
                            .row_mut(c, y)
                            .iter_mut()
                            .zip(from)
                            .for_each(|(v, p)| *v = *p);
                    }
                }
                Copied::Floats(image)
            }
        }
    }

    /// Rows without their padding.
    fn rows<T>(&self, samples: &'a [T]) -> impl Iterator<Item = &'a [T]> {
        let (stride, row) = (self.stride, self.width * self.samples.channels());
        (0..self.height).map(move |y| &samples[y * stride..][..row])
    }

    /// Bytes with red, green and blue at these places of each pixel.
    fn colours(&self, samples: &'a [u8], order: [usize; 3]) -> Copied {
        let mut rgb = Vec::with_capacity(3 * self.width * self.height);
        for row in self.rows(samples) {
            let pixels = row.chunks_exact(self.samples.channels());
            rgb.extend(pixels.flat_map(|p| order.map(|c| p[c])));
        }
        Copied::Bytes(Pixels::from_rgb(self.width, self.height, rgb))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Frame, Identity, parse_preprocessor};
    use std::sync::Arc;

    const SIZE: (usize, usize) = (13, 7);

    /// Element `i` of a tight buffer.
    fn value(i: usize) -> u8 {
        (i.wrapping_mul(7919) >> 3) as u8
    }

    /// Rows of `row` elements, then `gap` others that must not be read.
    fn padded<T: Copy>(row: usize, gap: usize, odd: T, of: impl Fn(usize) -> T) -> Vec<T> {
        let mut out = Vec::new();
        for y in 0..SIZE.1 {
            out.extend((0..row).map(|x| of(y * row + x)));
            if y + 1 < SIZE.1 {
                out.extend(std::iter::repeat_n(odd, gap));
            }
        }
        out
    }

    fn frame(stride: usize, samples: Samples<'_>) -> Frame {
        let view = PixelView::new(SIZE.0, SIZE.1, stride, samples).unwrap();
        Frame::from_view(&view, Arc::new(Identity))
    }

    fn assert_same(a: &Frame, b: &Frame) {
        assert_eq!(a.gray(), b.gray());
        assert_eq!(a.colour(), b.colour());
        assert_eq!(a.decoded(), b.decoded());
    }

    #[test]
    fn any_stride_equals_the_tight_buffer() {
        for gap in [0, 1, 3, 40] {
            let bytes = |row| padded(row, gap, 77, value);
            let floats = |row| padded(row, gap, f32::NAN, |i| f32::from(value(i)) + 0.25);
            let (gray, colour, alpha) = (SIZE.0, 3 * SIZE.0, 4 * SIZE.0);
            let tight: Vec<u8> = (0..4 * SIZE.0 * SIZE.1).map(value).collect();
            let tight_floats: Vec<f32> = tight.iter().map(|&v| f32::from(v) + 0.25).collect();
            type Make<T> = for<'a> fn(&'a [T]) -> Samples<'a>;
            let of_bytes: [(Make<u8>, usize); 5] = [
                (|s| Samples::Gray8(s), gray),
                (|s| Samples::Rgb8(s), colour),
                (|s| Samples::Bgr8(s), colour),
                (|s| Samples::Rgba8(s), alpha),
                (|s| Samples::Bgra8(s), alpha),
            ];
            for (samples, row) in of_bytes {
                assert_same(
                    &frame(row + gap, samples(&bytes(row))),
                    &frame(row, samples(&tight)),
                );
            }
            let of_floats: [(Make<f32>, usize); 2] =
                [(|s| Samples::GrayF32(s), gray), (|s| Samples::RgbF32(s), colour)];
            for (samples, row) in of_floats {
                assert_same(
                    &frame(row + gap, samples(&floats(row))),
                    &frame(row, samples(&tight_floats)),
                );
            }
        }
    }

    #[test]
    fn bytes_equal_owned_pixels_and_floats_of_the_same_values() {
        let bytes: Vec<u8> = (0..3 * SIZE.0 * SIZE.1).map(value).collect();
        let floats: Vec<f32> = bytes.iter().map(|&v| v.into()).collect();
        let pixels = SIZE.0 * SIZE.1;
        let gray = frame(SIZE.0, Samples::Gray8(&bytes));
        let owned = Pixels::from_gray(SIZE.0, SIZE.1, bytes[..pixels].to_vec());
        assert_same(&gray, &Frame::new(owned, Arc::new(Identity)));
        assert_same(&gray, &frame(SIZE.0, Samples::GrayF32(&floats)));
        let colour = frame(3 * SIZE.0, Samples::Rgb8(&bytes));
        let owned = Pixels::from_rgb(SIZE.0, SIZE.1, bytes.clone());
        assert_same(&colour, &Frame::new(owned, Arc::new(Identity)));
        let float = frame(3 * SIZE.0, Samples::RgbF32(&floats));
        assert_eq!(colour.colour(), float.colour());
        assert_eq!(colour.decoded(), float.decoded());
        // The gray of floats is not rounded.
        for y in 0..SIZE.1 {
            for (a, b) in colour.gray().row(0, y).iter().zip(float.gray().row(0, y)) {
                assert!((a - b).abs() < 0.51, "{a} {b}");
            }
        }
    }

    #[test]
    fn orders_of_channels() {
        let rgb: Vec<u8> = (0..3 * SIZE.0 * SIZE.1).map(value).collect();
        let reorder = |order: &[usize]| -> Vec<u8> {
            let pixel = |p: &[u8]| {
                order
                    .iter()
                    .map(|&c| *p.get(c).unwrap_or(&200))
                    .collect::<Vec<_>>()
            };
            rgb.chunks_exact(3).flat_map(pixel).collect()
        };
        let want = frame(3 * SIZE.0, Samples::Rgb8(&rgb));
        assert_same(&want, &frame(3 * SIZE.0, Samples::Bgr8(&reorder(&[2, 1, 0]))));
        assert_same(&want, &frame(4 * SIZE.0, Samples::Rgba8(&reorder(&[0, 1, 2, 3]))));
        assert_same(&want, &frame(4 * SIZE.0, Samples::Bgra8(&reorder(&[2, 1, 0, 3]))));
    }

    #[test]
    fn floats_are_pre_processed_like_bytes() {
        let bytes: Vec<u8> = (0..SIZE.0 * SIZE.1).map(value).collect();
        let floats: Vec<f32> = bytes.iter().map(|&v| v.into()).collect();
        let blur = parse_preprocessor("gaussian:5:3").unwrap();
        let made = |samples| {
            let view = PixelView::new(SIZE.0, SIZE.1, SIZE.0, samples).unwrap();
            Frame::from_view(&view, blur.clone())
        };
        let (of_bytes, of_floats) = (made(Samples::Gray8(&bytes)), made(Samples::GrayF32(&floats)));
        assert_same(&of_bytes, &of_floats);
        assert_ne!(of_bytes.gray().row(0, 0)[0], floats[0]);
    }

    #[test]
    fn wrong_sizes_are_typed_errors() {
        let error = |w, h, stride, samples| PixelView::new(w, h, stride, samples).map(|_| ()).unwrap_err();
        let (bytes, floats) = ([0u8; 60], [0f32; 60]);
        assert_eq!(
            error(0, 5, 5, Samples::Gray8(&bytes)),
            PixelError::Empty { width: 0, height: 5 }
        );
        assert!(matches!(
            error(4, 0, 5, Samples::Gray8(&bytes)),
            PixelError::Empty { .. }
        ));
        assert_eq!(
            error(4, 5, 11, Samples::Bgr8(&bytes)),
            PixelError::Stride {
                stride: 11,
                needed: 12
            }
        );
        assert!(PixelView::new(4, 5, 12, Samples::RgbF32(&floats)).is_ok());
        assert_eq!(
            error(4, 5, 13, Samples::RgbF32(&floats)),
            PixelError::TooShort { got: 60, needed: 64 }
        );
        for (w, h, stride) in [(1 << 24, 1, 1 << 24), (1 << 20, 1 << 20, 1 << 20)] {
            assert!(matches!(
                error(w, h, stride, Samples::Gray8(&bytes)),
                PixelError::TooLarge { .. }
            ));
        }
        assert!(matches!(
            error(4, 5, usize::MAX, Samples::Gray8(&bytes)),
            PixelError::TooShort { .. }
        ));
    }
}
