//! Image pyramids: every level half the size of the one below it, `x_level = x / 2^level` exactly (Burt & Adelson 1983).

use super::Image;
use crate::kernels;

/// Smallest side of an image that has a smaller level, px.
pub(super) const MIN_SIDE: usize = 24;

/// Half-size image, `⌈w/2⌉ x ⌈h/2⌉`: its pixel `(x, y)` is the binomially smoothed pixel `(2x, 2y)`.
pub(super) fn halve(image: &Image) -> Image {
    let (w, h) = (image.width(), image.height());
    let mut out = Image::new(w.div_ceil(2), h.div_ceil(2), image.channels());
    let mut scratch = vec![0.0; kernels::halve_scratch_len(w)];
    let stride = out.stride();
    for c in 0..image.channels() {
        kernels::halve(
            image.plane(c),
            w,
            h,
            image.stride(),
            out.plane_mut(c),
            stride,
            &mut scratch,
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Frame;

    #[test]
    fn coordinates_are_halved_exactly() {
        // A ramp stays one away from the border, at half the coordinates.
        let frame = Frame::from_gray(Image::from_fn(101, 64, |x, y| x as f32 + 0.5 * y as f32));
        let half = frame.half(1).unwrap();
        assert_eq!((half.width(), half.height()), (51, 32));
        for y in 1..31 {
            for x in 1..50 {
                let want = 2.0 * x as f32 + y as f32;
                assert!((half.gray().get(0, x, y) - want).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn levels_are_shared_and_end_before_they_are_tiny() {
        let frame = Frame::from_gray(Image::from_fn(200, 100, |x, y| (x * y % 251) as f32));
        let again = frame.clone();
        assert!(std::ptr::eq(frame.level(2, 1).gray(), again.level(2, 1).gray()));
        assert_eq!(frame.levels(), 4);
        let top = frame.level(9, 1);
        assert_eq!((top.width(), top.height()), (25, 13));
        assert!(top.half(1).is_none());
        let colour = frame.half(3).unwrap().colour();
        assert_eq!(colour.plane(2), frame.half(1).unwrap().gray().plane(0));
    }

    /// Prints the time of a pyramid: `cargo test --release -- --ignored --nocapture pyramid`.
    #[test]
    #[ignore = "prints a time"]
    fn time_of_640x480() {
        let image = Image::from_fn(640, 480, |x, y| (x * y % 251) as f32);
        let times = (0..50).map(|_| {
            let frame = Frame::from_gray(image.clone());
            let start = std::time::Instant::now();
            frame.level(4, 1);
            start.elapsed()
        });
        println!("5 levels of 640x480: {:?}", times.min());
    }
}
