//! One plane of an image, as the kernels take it.

/// One plane of an image: pixel `(x, y)` is `data[y * stride + x]`. There is a spare column and a spare row, so that the
/// right, lower and lower right neighbour of every pixel can be read; what they hold is of no account.
///
/// The fields are private, so that what [`PlaneView::new`] has checked stays true: `sample` reads without
/// looking at the length again.
#[derive(Clone, Copy, Debug)]
pub struct PlaneView<'a> {
    data: &'a [f32],
    width: usize,
    height: usize,
    stride: usize,
}

impl<'a> PlaneView<'a> {
    /// Plane of `width` x `height` pixels. Panics unless both are positive and below 2²⁴, `stride > width`, and `data` holds
    /// `height + 1` rows of `stride` and at most `i32::MAX` elements.
    pub fn new(data: &'a [f32], width: usize, height: usize, stride: usize) -> Self {
        assert!(
            data.len() <= i32::MAX as usize && width.max(height) < 1 << 24,
            "image too large to index"
        );
        let needed = stride.checked_mul(height + 1);
        assert!(
            width > 0 && height > 0 && stride > width && needed.is_some_and(|n| n <= data.len()),
            "a plane with a spare column and row"
        );
        PlaneView {
            data,
            width,
            height,
            stride,
        }
    }
    /// Width in pixels.
    #[inline(always)]
    pub fn width(&self) -> usize {
        self.width
    }
    /// Height in pixels.
    #[inline(always)]
    pub fn height(&self) -> usize {
        self.height
    }
    /// Elements between the starts of two rows.
    #[inline(always)]
    pub fn stride(&self) -> usize {
        self.stride
    }
    /// All elements, the spare ones too.
    #[inline(always)]
    pub fn data(&self) -> &'a [f32] {
        self.data
    }
    /// Value of pixel `(x, y)`.
    #[inline(always)]
    pub(super) fn at(&self, x: usize, y: usize) -> f32 {
        self.data[y * self.stride + x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::catch_unwind;

    #[test]
    fn planes_that_are_too_short_panic() {
        let accepted = |elements: usize, width, height, stride| {
            let data = vec![0.0; elements];
            catch_unwind(|| PlaneView::new(&data, width, height, stride).width()).is_ok()
        };
        assert!(accepted(5 * 4, 4, 3, 5));
        assert!(!accepted(5 * 4 - 1, 4, 3, 5));
        assert!(!accepted(5 * 4, 5, 3, 5));
        assert!(!accepted(5 * 4, 0, 3, 5));
        assert!(!accepted(5 * 4, 4, 0, 5));
        // Products that overflow.
        assert!(!accepted(5 * 4, 4, usize::MAX / 5 + 1, 5));
        assert!(!accepted(5 * 4, 4, 3, usize::MAX / 4 + 1));
    }
}
