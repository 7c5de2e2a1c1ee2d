//! Bilinear sampling: value and analytic gradient from the same four taps, and the image Hessian.

use super::{Lanes, PlaneView, WIDTH, dispatch};

/// What lies outside the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Border {
    /// Samples outside are 128 with zero gradient.
    Constant,
    /// Coordinates are clamped to the image.
    Replicate,
}

/// Intensity of samples outside the image with [`Border::Constant`].
pub const OUTSIDE: f32 = 128.0;

impl PlaneView<'_> {
    /// Value and gradient at one point: the definition, also taken by every group of points that touches the border
    /// or a pixel centre. `None`: outside with a constant border.
    #[inline(always)]
    fn point(&self, border: Border, x: f32, y: f32) -> Option<[f32; 3]> {
        let (right, bottom) = ((self.width() - 1) as f32, (self.height() - 1) as f32);
        let (mut x, mut y) = (x, y);
        let inside = x >= 0.0 && x <= right && y >= 0.0 && y <= bottom;
        let (mut free_x, mut free_y) = (1.0, 1.0);
        if !inside {
            if border == Border::Constant || x.is_nan() || y.is_nan() {
                return None;
            }
            (free_x, free_y) = (
                f32::from(x >= 0.0 && x <= right),
                f32::from(y >= 0.0 && y <= bottom),
            );
            (x, y) = (x.clamp(0.0, right), y.clamp(0.0, bottom));
        }
        let (lx, ly) = (x.floor(), y.floor());
        let (dx, dy) = (x - lx, y - ly);
        let (ix, iy) = (lx as usize, ly as usize);
        let (p00, p10) = (self.at(ix, iy), self.at(ix + 1, iy));
        let (p01, p11) = (self.at(ix, iy + 1), self.at(ix + 1, iy + 1));
        // Spare elements may hold anything: their weight is zero, which a NaN would survive.
        let (p10, p11) = if ix + 1 == self.width() {
            (p00, p01)
        } else {
            (p10, p11)
        };
        let (p01, p11) = if iy + 1 == self.height() {
            (p00, p10)
        } else {
            (p01, p11)
        };
        let (top, bottom_slope) = (p10 - p00, p11 - p01);
        let upper = dx.mul_add(top, p00);
        let lower = dx.mul_add(bottom_slope, p01);
        let value = dy.mul_add(lower - upper, upper);
        let mut gx = dy.mul_add(bottom_slope - top, top);
        let mut gy = lower - upper;
        // On a pixel centre the surface has a kink: the mean of the slopes on both sides, one side at the border.
        if dx == 0.0 && ix > 0 {
            let left = |y: usize| self.at(ix, y) - self.at(ix - 1, y);
            let below = if iy + 1 == self.height() { iy } else { iy + 1 };
            let before = dy.mul_add(left(below) - left(iy), left(iy));
            gx = if ix + 1 == self.width() {
                before
            } else {
                0.5 * (gx + before)
            };
        }
        if dy == 0.0 && iy > 0 {
            let up = |x: usize| self.at(x, iy) - self.at(x, iy - 1);
            let beside = if ix + 1 == self.width() { ix } else { ix + 1 };
            let before = dx.mul_add(up(beside) - up(ix), up(ix));
            gy = if iy + 1 == self.height() {
                before
            } else {
                0.5 * (gy + before)
            };
        }
        Some([value, gx * free_x, gy * free_y])
    }
}

dispatch! {
    /// Bilinear values at `(x_i, y_i)` in pixels; returns how many points are outside the image.
    pub fn sample(image: PlaneView<'_>, border: Border, x: &[f32], y: &[f32], out: &mut [f32]) -> usize = sample_lanes;
    /// Bilinear values and their analytic gradient `(∂I/∂x, ∂I/∂y)` per pixel; returns how many points are outside.
    pub fn sample_gradient(
        image: PlaneView<'_>, border: Border, x: &[f32], y: &[f32], out: &mut [f32], gx: &mut [f32], gy: &mut [f32],
    ) -> usize = sample_gradient_lanes;
}

dispatch! {
    /// What the kernels do where the fast path does not hold, apart from it so that it costs no registers.
    #[cold]
    #[inline(never)]
    fn careful_values(image: PlaneView<'_>, border: Border, x: &[f32], y: &[f32], out: &mut [f32]) -> usize =
        careful_value_lanes;
    #[cold]
    #[inline(never)]
    fn careful(image: PlaneView<'_>, border: Border, x: &[f32], y: &[f32], out: [&mut [f32]; 3]) -> usize = careful_lanes;
}

// The parameter is there for `dispatch!`, which compiles both for the instruction set.
#[allow(clippy::extra_unused_type_parameters)]
#[inline(always)]
fn careful_value_lanes<V: Lanes>(
    image: PlaneView<'_>,
    border: Border,
    x: &[f32],
    y: &[f32],
    out: &mut [f32],
) -> usize {
    let mut outside = 0;
    for ((out, &x), &y) in out.iter_mut().zip(x).zip(y) {
        let value = image.point(border, x, y);
        outside += usize::from(value.is_none());
        *out = value.map_or(OUTSIDE, |v| v[0]);
    }
    outside
}

#[allow(clippy::extra_unused_type_parameters)]
#[inline(always)]
fn careful_lanes<V: Lanes>(
    image: PlaneView<'_>,
    border: Border,
    x: &[f32],
    y: &[f32],
    [out, gx, gy]: [&mut [f32]; 3],
) -> usize {
    let mut outside = 0;
    for k in 0..x.len() {
        let value = image.point(border, x[k], y[k]);
        outside += usize::from(value.is_none());
        [out[k], gx[k], gy[k]] = value.unwrap_or([OUTSIDE, 0.0, 0.0]);
    }
    outside
}

/// Fractions and the four taps of eight points; `None` when some point needs the careful path.
#[inline(always)]
fn taps<V: Lanes>(image: &PlaneView<'_>, x: V, y: V, smooth: bool) -> Option<([V; 2], [V; 4])> {
    // Strictly below the last pixel, so that all four taps are pixels.
    let right = V::splat((image.width() - 1) as f32 * (1.0 - f32::EPSILON));
    let bottom = V::splat((image.height() - 1) as f32 * (1.0 - f32::EPSILON));
    let zero = V::splat(0.0);
    if !(x.all_within(zero, right) && y.all_within(zero, bottom)) {
        return None;
    }
    let (lx, ly) = (x.floor(), y.floor());
    let (dx, dy) = (x.sub(lx), y.sub(ly));
    if smooth && (dx.any_zero() || dy.any_zero()) {
        return None;
    }
    // SAFETY: `0 <= x < width - 1` or, in an image one pixel wide, `x = 0`, as was just checked; so `floor(x)` and its right
    // neighbour are pixels or the spare column. The same holds in y with the spare row. `PlaneView::new` has checked that the
    // plane holds the spare column and row and has at most `i32::MAX` elements, and that sizes are exact in `f32`.
    let quads = unsafe { V::quads(image.data(), image.stride(), lx, ly) };
    Some(([dx, dy], quads))
}

#[inline(always)]
pub(super) fn sample_lanes<V: Lanes>(
    image: PlaneView<'_>,
    border: Border,
    x: &[f32],
    y: &[f32],
    out: &mut [f32],
) -> usize {
    let n = x.len();
    let (y, out) = (&y[..n], &mut out[..n]);
    let mut outside = 0;
    let mut i = 0;
    while i < n {
        if i + WIDTH <= n
            && let Some(([dx, dy], [p00, p10, p01, p11])) = taps(
                &image,
                V::load(&x[i..i + WIDTH]),
                V::load(&y[i..i + WIDTH]),
                false,
            )
        {
            let upper = dx.mul_add(p10.sub(p00), p00);
            let lower = dx.mul_add(p11.sub(p01), p01);
            dy.mul_add(lower.sub(upper), upper).store(&mut out[i..i + WIDTH]);
        } else {
            let at = i..n.min(i + WIDTH);
            outside += careful_values(image, border, &x[at.clone()], &y[at.clone()], &mut out[at]);
        }
        i += WIDTH;
    }
    outside
}

#[inline(always)]
fn sample_gradient_lanes<V: Lanes>(
    image: PlaneView<'_>,
    border: Border,
    x: &[f32],
    y: &[f32],
    out: &mut [f32],
    gx: &mut [f32],
    gy: &mut [f32],
) -> usize {
    let n = x.len();
    let (y, out, gx, gy) = (&y[..n], &mut out[..n], &mut gx[..n], &mut gy[..n]);
    let mut outside = 0;
    let mut i = 0;
    while i < n {
        if i + WIDTH <= n
            && let Some(([dx, dy], [p00, p10, p01, p11])) =
                taps(&image, V::load(&x[i..i + WIDTH]), V::load(&y[i..i + WIDTH]), true)
        {
            let (top, bottom) = (p10.sub(p00), p11.sub(p01));
            let upper = dx.mul_add(top, p00);
            let lower = dx.mul_add(bottom, p01);
            let down = lower.sub(upper);
            dy.mul_add(down, upper).store(&mut out[i..i + WIDTH]);
            dy.mul_add(bottom.sub(top), top).store(&mut gx[i..i + WIDTH]);
            down.store(&mut gy[i..i + WIDTH]);
        } else {
            let at = i..n.min(i + WIDTH);
            let to = [&mut out[at.clone()], &mut gx[at.clone()], &mut gy[at.clone()]];
            outside += careful(image, border, &x[at.clone()], &y[at], to);
        }
        i += WIDTH;
    }
    outside
}

/// Image Hessian by central differences of bilinear values with step `h` px:
/// `Ixx = (I(x+2h, y) + I(x-2h, y) - 2 I(x, y)) / 4h²`, `Ixy = (I(x+h, y+h) + I(x-h, y-h) - I(x+h, y-h) - I(x-h, y+h)) / 4h²`.
///
/// `value` holds the bilinear values at the points; `out` is `[Ixx, Ixy, Iyy]`, each of the points' length.
pub fn image_hessian(
    image: PlaneView<'_>,
    border: Border,
    h: f32,
    x: &[f32],
    y: &[f32],
    value: &[f32],
    out: [&mut [f32]; 3],
) {
    let [xx, xy, yy] = out;
    let at = |px: f32, py: f32| image.point(border, px, py).map_or(OUTSIDE, |p| p[0]);
    let k = 1.0 / (4.0 * h * h);
    for i in 0..x.len() {
        let (px, py, centre) = (x[i], y[i], value[i]);
        xx[i] = k * (at(px + 2.0 * h, py) + at(px - 2.0 * h, py) - 2.0 * centre);
        yy[i] = k * (at(px, py + 2.0 * h) + at(px, py - 2.0 * h) - 2.0 * centre);
        xy[i] = k * (at(px + h, py + h) + at(px - h, py - h) - at(px + h, py - h) - at(px - h, py + h));
    }
}

/// Slow references in `f64`: the bilinear surface and the Keys bicubic surface (a = -1/2, edges replicated), which is
/// smooth and interpolates the same pixels. Points outside give 128.
pub mod sample_reference {
    use super::{OUTSIDE, PlaneView};

    fn inside(image: &PlaneView<'_>, x: f64, y: f64) -> bool {
        x >= 0.0 && x <= (image.width() - 1) as f64 && y >= 0.0 && y <= (image.height() - 1) as f64
    }

    fn pixel(image: &PlaneView<'_>, x: i64, y: i64) -> f64 {
        let clamp = |v: i64, n: usize| v.clamp(0, n as i64 - 1) as usize;
        f64::from(image.at(clamp(x, image.width()), clamp(y, image.height())))
    }

    /// Bilinear value.
    pub fn bilinear(image: &PlaneView<'_>, x: f64, y: f64) -> f64 {
        if !inside(image, x, y) {
            return f64::from(OUTSIDE);
        }
        let (lx, ly) = (x.floor(), y.floor());
        let (dx, dy) = (x - lx, y - ly);
        let p = |i: i64, j: i64| pixel(image, lx as i64 + i, ly as i64 + j);
        (1.0 - dy) * ((1.0 - dx) * p(0, 0) + dx * p(1, 0)) + dy * ((1.0 - dx) * p(0, 1) + dx * p(1, 1))
    }

    /// Bicubic value (Catmull-Rom).
    pub fn cubic(image: &PlaneView<'_>, x: f64, y: f64) -> f64 {
        if !inside(image, x, y) {
            return f64::from(OUTSIDE);
        }
        let keys = |p: [f64; 4], t: f64| {
            p[1] + 0.5
                * t
                * (p[2] - p[0]
                    + t * (2.0 * p[0] - 5.0 * p[1] + 4.0 * p[2] - p[3]
                        + t * (3.0 * (p[1] - p[2]) + p[3] - p[0])))
        };
        let (lx, ly) = (x.floor(), y.floor());
        let row = |j: i64| {
            let p = |i: i64| pixel(image, lx as i64 + i, ly as i64 + j);
            keys([p(-1), p(0), p(1), p(2)], x - lx)
        };
        keys([row(-1), row(0), row(1), row(2)], y - ly)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    fn noise(w: usize, h: usize) -> Image {
        Image::from_fn(w, h, |x, y| ((x * 7919 + y * 104729) % 251) as f32)
    }
    fn grid(image: &Image) -> PlaneView<'_> {
        image.view(0)
    }

    proptest! {
        #[test]
        fn value_and_gradient_agree_with_the_reference(
            w in 1usize..40, h in 1usize..40,
            points in prop::collection::vec((-0.2f32..1.2, -0.2f32..1.2), 1..60),
        ) {
            let image = noise(w, h);
            let g = grid(&image);
            let x: Vec<f32> = points.iter().map(|p| p.0 * w as f32).collect();
            let y: Vec<f32> = points.iter().map(|p| p.1 * h as f32).collect();
            let n = x.len();
            let mut v = vec![0.0; n];
            let mut full = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
            let outside = sample(g, Border::Constant, &x, &y, &mut v);
            let [fv, fx, fy] = &mut full;
            prop_assert_eq!(outside, sample_gradient(g, Border::Constant, &x, &y, fv, fx, fy));
            let value = |x: f64, y: f64| sample_reference::bilinear(&g, x, y);
            for i in 0..n {
                let (px, py) = (f64::from(x[i]), f64::from(y[i]));
                prop_assert!((f64::from(v[i]) - value(px, py)).abs() < 0.01);
                prop_assert_eq!(v[i], full[0][i]);
                let cell = |p: f64, n: usize| p.fract().min(1.0 - p.fract()) > 1e-3 && p > 0.0 && p < n as f64 - 1.0;
                if cell(px, w) && cell(py, h) {
                    let e = 1e-4;
                    let dx = (value(px + e, py) - value(px - e, py)) / (2.0 * e);
                    let dy = (value(px, py + e) - value(px, py - e)) / (2.0 * e);
                    prop_assert!((f64::from(full[1][i]) - dx).abs() < 0.01, "{} {}", full[1][i], dx);
                    prop_assert!((f64::from(full[2][i]) - dy).abs() < 0.01);
                }
            }
            let mut p = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
            let [pv, px, py] = &mut p;
            sample_gradient_lanes::<Portable>(g, Border::Constant, &x, &y, pv, px, py);
            prop_assert_eq!(&full, &p);
        }
    }

    #[test]
    fn pixel_centres_take_the_central_difference_and_borders_one_side() {
        let image = noise(9, 9);
        let g = grid(&image);
        let at = |x: usize, y: usize| image.get(0, x, y);
        let mut out = [[0.0; 3]; 3];
        let [v, gx, gy] = &mut out;
        sample_gradient(g, Border::Constant, &[4.0, 0.0, 8.0], &[5.0, 0.0, 8.0], v, gx, gy);
        assert_eq!(*v, [at(4, 5), at(0, 0), at(8, 8)]);
        assert_eq!(
            *gx,
            [
                (at(5, 5) - at(3, 5)) / 2.0,
                at(1, 0) - at(0, 0),
                at(8, 8) - at(7, 8)
            ]
        );
        assert_eq!(
            *gy,
            [
                (at(4, 6) - at(4, 4)) / 2.0,
                at(0, 1) - at(0, 0),
                at(8, 8) - at(8, 7)
            ]
        );
    }

    #[test]
    fn outside_and_not_a_number() {
        let image = noise(6, 5);
        let g = grid(&image);
        let x = [-0.01, 5.01, 2.0, f32::NAN, f32::INFINITY, 1.0, 1.0, 1e30, 3.0];
        let y = [1.0, 1.0, -0.01, 1.0, 1.0, 4.01, f32::NAN, 1.0, 2.0];
        let mut v = [0.0; 9];
        assert_eq!(sample(g, Border::Constant, &x, &y, &mut v), 8);
        assert!(v[..8].iter().all(|&v| v == OUTSIDE));
        let mut v = [[0.0; 9]; 3];
        let [val, gx, gy] = &mut v;
        sample_gradient(g, Border::Replicate, &x, &y, val, gx, gy);
        assert_eq!(v[0][0], image.get(0, 0, 1));
        assert_eq!((v[1][0], v[1][1]), (0.0, 0.0));
    }

    #[test]
    fn hessian_of_a_quadratic_is_exact() {
        let image = Image::from_fn(30, 30, |x, y| {
            let (x, y) = (x as f32 - 15.0, y as f32 - 15.0);
            0.5 * x * x + 0.25 * x * y - 0.375 * y * y
        });
        let (x, y) = ([15.0, 12.0], [15.0, 17.0]);
        let mut v = [0.0; 2];
        sample(grid(&image), Border::Constant, &x, &y, &mut v);
        let mut h = [[0.0; 2]; 3];
        let [xx, xy, yy] = &mut h;
        image_hessian(grid(&image), Border::Constant, 1.0, &x, &y, &v, [xx, xy, yy]);
        assert_eq!(h, [[1.0; 2], [0.25; 2], [-0.75; 2]]);
    }

    #[test]
    fn cubic_interpolates_and_reproduces_parabolas() {
        let image = Image::from_fn(20, 20, |x, y| (x * x) as f32 * 0.5 + y as f32);
        let g = grid(&image);
        assert_eq!(sample_reference::cubic(&g, 7.0, 9.0), 33.5);
        assert!((sample_reference::cubic(&g, 7.3, 9.6) - (7.3f64 * 7.3 * 0.5 + 9.6)).abs() < 1e-9);
    }
}
