//! Planar `f32` images.

use crate::kernels::PlaneView;

/// Planar float image, intensities 0–255, one or three planes (R, G, B), pixel centres at integers.
///
/// Rows are `stride` apart; `stride >= width + 1` and each plane has one spare row, so that the 2x2 support of any
/// point in `[0, width-1] x [0, height-1]` may be loaded without a bounds test. Spare elements are finite but
/// otherwise meaningless: bilinear weights on them are zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    width: usize,
    height: usize,
    stride: usize,
    channels: usize,
    data: Vec<f32>,
}

impl Image {
    /// All-zero image. `width`, `height` in pixels, `channels` 1 or 3.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        let stride = (width + 1).next_multiple_of(8);
        Image {
            width,
            height,
            stride,
            channels,
            data: vec![0.0; stride * (height + 1) * channels],
        }
    }

    /// Changes the size, keeping the memory; the values are meaningless afterwards.
    pub(crate) fn reshape(&mut self, width: usize, height: usize, channels: usize) {
        let stride = (width + 1).next_multiple_of(8);
        (self.width, self.height) = (width, height);
        (self.stride, self.channels) = (stride, channels);
        self.data.resize(stride * (height + 1) * channels, 0.0);
    }

    /// Single-plane image from row-major values (`values.len() == width * height`).
    pub fn from_gray(width: usize, height: usize, values: &[f32]) -> Self {
        assert_eq!(values.len(), width * height, "values must fill the image");
        let mut image = Image::new(width, height, 1);
        for (y, row) in values.chunks_exact(width).enumerate() {
            image.row_mut(0, y).copy_from_slice(row);
        }
        image
    }

    /// Single-plane image whose value at `(x, y)` is `f(x, y)`.
    pub fn from_fn(width: usize, height: usize, f: impl Fn(usize, usize) -> f32) -> Self {
        let mut image = Image::new(width, height, 1);
        for y in 0..height {
            for (x, v) in image.row_mut(0, y).iter_mut().enumerate() {
                *v = f(x, y);
            }
        }
        image
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }
    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }
    /// Number of planes.
    pub fn channels(&self) -> usize {
        self.channels
    }
    /// Elements between the starts of two rows.
    pub fn stride(&self) -> usize {
        self.stride
    }
    /// Plane `c`: `stride * (height + 1)` elements.
    pub fn plane(&self, c: usize) -> &[f32] {
        let n = self.stride * (self.height + 1);
        &self.data[c * n..(c + 1) * n]
    }
    /// Plane `c`, mutable.
    pub fn plane_mut(&mut self, c: usize) -> &mut [f32] {
        let n = self.stride * (self.height + 1);
        &mut self.data[c * n..(c + 1) * n]
    }
    /// Plane `c` as the kernels take it.
    pub(crate) fn view(&self, c: usize) -> PlaneView<'_> {
        PlaneView::new(self.plane(c), self.width, self.height, self.stride)
    }
    /// Row `y` of plane `c`, `width` elements.
    pub fn row(&self, c: usize, y: usize) -> &[f32] {
        let at = (c * (self.height + 1) + y) * self.stride;
        &self.data[at..at + self.width]
    }
    /// Row `y` of plane `c`, mutable.
    pub fn row_mut(&mut self, c: usize, y: usize) -> &mut [f32] {
        let at = (c * (self.height + 1) + y) * self.stride;
        &mut self.data[at..at + self.width]
    }
    /// One plane of BT.601 gray, not rounded; a gray image as it is.
    pub(crate) fn to_gray(&self) -> Image {
        if self.channels == 1 {
            return self.clone();
        }
        let mut gray = Image::new(self.width, self.height, 1);
        for y in 0..self.height {
            let colours = self.row(0, y).iter().zip(self.row(1, y)).zip(self.row(2, y));
            for (v, ((r, g), b)) in gray.row_mut(0, y).iter_mut().zip(colours) {
                *v = 0.299 * r + 0.587 * g + 0.114 * b;
            }
        }
        gray
    }
    /// Three planes; a gray one is repeated.
    pub(crate) fn to_colour(&self) -> Image {
        if self.channels == 3 {
            return self.clone();
        }
        let mut colour = Image::new(self.width, self.height, 3);
        for c in 0..3 {
            colour.plane_mut(c).copy_from_slice(self.plane(0));
        }
        colour
    }
    /// Value at integer pixel `(x, y)` of plane `c`.
    pub fn get(&self, c: usize, x: usize, y: usize) -> f32 {
        self.row(c, y)[x]
    }
}
