//! Windows of sparse optical flow: bilinear values at one common fraction of a pixel, Scharr gradients, and the
//! products that a Lucas-Kanade step needs.

use super::sample::sample_lanes;
use super::{Border, Lanes, PlaneView, WIDTH, dispatch};

/// A window's place in one plane of an image.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    plane: PlaneView<'a>,
    /// Upper left pixel of the window, at most 2²⁴ from the image's.
    left: i32,
    top: i32,
    /// Fractions of a pixel in `[0, 1]` by which the window lies right of and below that.
    fraction: [f32; 2],
}

impl<'a> Place<'a> {
    /// The window whose upper left sample is at `(x, y)` px.
    pub fn new(plane: PlaneView<'a>, x: f64, y: f64) -> Self {
        let limit = f64::from(1 << 24);
        let (left, top) = (x.floor().clamp(-limit, limit), y.floor().clamp(-limit, limit));
        Place {
            plane,
            left: left as i32,
            top: top as i32,
            fraction: [
                (x - left).clamp(0.0, 1.0) as f32,
                (y - top).clamp(0.0, 1.0) as f32,
            ],
        }
    }

    /// Whether all taps of a `cols x rows` window, columns rounded up to whole lanes, can be loaded.
    #[inline(always)]
    fn inside(&self, cols: usize, rows: usize) -> bool {
        let (left, top) = (self.left as usize, self.top as usize);
        self.left >= 0
            && self.top >= 0
            && left + cols < self.plane.width()
            && top + rows < self.plane.height()
    }

    /// Pixels of a window that is inside, from its upper left one on.
    #[inline(always)]
    fn pixels(&self) -> &'a [f32] {
        &self.plane.data()[self.top as usize * self.plane.stride() + self.left as usize..]
    }

    /// Columns and rows of a window whose samples lie in the image.
    pub fn valid(&self, cols: usize, rows: usize) -> [std::ops::Range<usize>; 2] {
        let range = |first: i32, fraction: f32, window: usize, size: usize| {
            let low = (-i64::from(first)).clamp(0, window as i64);
            let last = size as i64 - 1 - i64::from(first) + i64::from(fraction <= 0.0);
            low as usize..last.clamp(low, window as i64) as usize
        };
        [
            range(self.left, self.fraction[0], cols, self.plane.width()),
            range(self.top, self.fraction[1], rows, self.plane.height()),
        ]
    }

    /// Pixels `row` rows below the upper left one, from its column on, coordinates clamped to the image.
    fn clamped_row(&self, row: usize, out: &mut [f32]) {
        let y = (i64::from(self.top) + row as i64).clamp(0, self.plane.height() as i64 - 1) as usize;
        let pixels = &self.plane.data()[y * self.plane.stride()..][..self.plane.width()];
        let left = i64::from(self.left);
        let before = (-left).clamp(0, out.len() as i64) as usize;
        let first = left.clamp(0, self.plane.width() as i64) as usize;
        let count = (self.plane.width() - first).min(out.len() - before);
        let (head, rest) = out.split_at_mut(before);
        let (middle, tail) = rest.split_at_mut(count);
        head.fill(pixels[0]);
        middle.copy_from_slice(&pixels[first..first + count]);
        tail.fill(pixels[self.plane.width() - 1]);
    }
}

/// Columns rounded up to whole lanes.
pub fn padded(cols: usize) -> usize {
    cols.next_multiple_of(WIDTH)
}

/// Largest side of a window.
pub const MAX_SIDE: usize = 111;
/// Pixels under a row of the largest window, one sample beyond it on both sides.
const LINE: usize = 128;

/// A window of the first image, its gradient and the gradient's products: `padded(side)` columns, `side` rows. Beyond
/// `side` columns and outside the image the gradient is zero.
#[derive(Clone, Debug, Default)]
pub struct FlowWindow {
    side: usize,
    values: Vec<f32>,
    gx: Vec<f32>,
    gy: Vec<f32>,
    /// Values one sample beyond the window on every side.
    wide: Vec<f32>,
    /// Places of a row of those in the image.
    x: Vec<f32>,
    y: Vec<f32>,
}

impl FlowWindow {
    /// For windows of `side x side` samples, `side <= MAX_SIDE`.
    pub fn new(side: usize) -> Self {
        assert!(side <= MAX_SIDE, "window too large");
        let n = padded(side) * side;
        FlowWindow {
            side,
            values: vec![0.0; n],
            gx: vec![0.0; n],
            gy: vec![0.0; n],
            wide: vec![0.0; (padded(side) + WIDTH) * (side + 2)],
            x: vec![0.0; padded(side) + WIDTH],
            y: vec![0.0; padded(side) + WIDTH],
        }
    }

    /// Samples per side.
    pub fn side(&self) -> usize {
        self.side
    }
}

dispatch! {
    /// Fills `window` with the bilinear values at a place and their Scharr gradient; returns the sums of `gx²`, `gx gy`, `gy²`.
    pub fn flow_window(place: Place<'_>, window: &mut FlowWindow) -> [f64; 3] = window_lanes;
    /// The same for a window seen through an affine map: its sample `(i, j)` is at `(m0 + m1 i + m2 j, m3 + m4 i + m5 j)` px,
    /// or the nearest place of the image.
    pub fn flow_window_warped(image: PlaneView<'_>, map: [f64; 6], window: &mut FlowWindow) -> [f64; 3] = warped_window_lanes;
    /// `(Σ d gx, Σ d gy)`, `d` the window's values less those at another place (zero outside the image).
    pub fn flow_mismatch(place: Place<'_>, window: &FlowWindow) -> [f64; 2] = mismatch_lanes;
    /// Sums of `|a - b|`, `a`, `b`, `a²`, `a b`, `b²` over the samples inside the image, `a` the window's values and `b` those
    /// at another place, both less the window's middle value.
    fn flow_moments(place: Place<'_>, window: &FlowWindow) -> [f64; 6] = moments_lanes;
    #[cold]
    fn mismatch_at_border(place: Place<'_>, window: &FlowWindow) -> [f64; 2] = mismatch_border_lanes;
    #[cold]
    fn moments_at_border(place: Place<'_>, window: &FlowWindow, middle: f32) -> [f64; 6] = moments_border_lanes;
}

/// How alike two windows are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowMatch {
    /// Mean absolute difference over the samples inside the image, intensity; infinite when there are none.
    pub residual: f64,
    /// Normalised cross-correlation over them, 0 when either window is flat.
    pub ncc: f64,
}

/// Compares the window with the values at another place.
pub fn flow_match(place: Place<'_>, window: &FlowWindow) -> FlowMatch {
    let [cols, rows] = place.valid(window.side, window.side);
    let count = (cols.len() * rows.len()) as f64;
    let [d, a, b, aa, ab, bb] = flow_moments(place, window);
    let (va, vb) = (aa - a * a / count, bb - b * b / count);
    FlowMatch {
        residual: if count > 0.0 { d / count } else { f64::INFINITY },
        // Below a variance of a millionth, rounding is all there is.
        ncc: if va > 1e-6 * count && vb > 1e-6 * count {
            (ab - a * b / count) / (va * vb).sqrt()
        } else {
            0.0
        },
    }
}

/// Pixels from the first on, interpolated with their right neighbours.
#[inline(always)]
fn across_pixels<V: Lanes>(pixels: &[f32], dx: V) -> V {
    let pixels = &pixels[..WIDTH + 1];
    let (a, b) = (V::load(&pixels[..WIDTH]), V::load(&pixels[1..]));
    dx.mul_add(b.sub(a), a)
}

/// `[a b; c d]` interpolated at the fractions.
#[inline(always)]
fn bilinear<V: Lanes>(upper: &[f32], lower: &[f32], i: usize, dx: V, dy: V) -> V {
    let (a, b) = (
        V::load(&upper[i..i + WIDTH]),
        V::load(&upper[i + 1..i + 1 + WIDTH]),
    );
    let (c, d) = (
        V::load(&lower[i..i + WIDTH]),
        V::load(&lower[i + 1..i + 1 + WIDTH]),
    );
    let upper = dx.mul_add(b.sub(a), a);
    let lower = dx.mul_add(d.sub(c), c);
    dy.mul_add(lower.sub(upper), upper)
}

#[inline(always)]
fn window_lanes<V: Lanes>(place: Place<'_>, window: &mut FlowWindow) -> [f64; 3] {
    let side = window.side;
    let across = padded(side) + WIDTH;
    let wide = &mut window.wide;
    let around = Place {
        left: place.left - 1,
        top: place.top - 1,
        ..place
    };
    if around.inside(side + 2, side + 2) {
        // Past the end of a row come other pixels of the plane, which are not used.
        let pixels = around.pixels();
        let (dx, dy) = (V::splat(place.fraction[0]), V::splat(place.fraction[1]));
        let mut i = 0;
        while i < side + 2 {
            let mut upper = across_pixels(&pixels[i..], dx);
            for row in 0..side + 2 {
                let lower = across_pixels(&pixels[(row + 1) * place.plane.stride() + i..], dx);
                let o = row * across + i;
                dy.mul_add(lower.sub(upper), upper).store(&mut wide[o..o + WIDTH]);
                upper = lower;
            }
            i += WIDTH;
        }
    } else {
        let (dx, dy) = (V::splat(place.fraction[0]), V::splat(place.fraction[1]));
        let mut lines = [[0.0; LINE]; 2];
        let [mut upper, mut lower] = lines.each_mut().map(|l| &mut l[..across + 1]);
        around.clamped_row(0, upper);
        for (row, out) in wide.chunks_exact_mut(across).enumerate() {
            around.clamped_row(row + 1, lower);
            let mut i = 0;
            while i < side + 2 {
                bilinear(upper, lower, i, dx, dy).store(&mut out[i..i + WIDTH]);
                i += WIDTH;
            }
            std::mem::swap(&mut upper, &mut lower);
        }
    }
    gradient_pass::<V>(window, place.valid(side, side))
}

#[inline(always)]
fn warped_window_lanes<V: Lanes>(image: PlaneView<'_>, map: [f64; 6], window: &mut FlowWindow) -> [f64; 3] {
    let across = padded(window.side) + WIDTH;
    let used = padded(window.side + 2);
    let FlowWindow { wide, x, y, .. } = window;
    let ramp = V::from_array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    for (row, out) in wide.chunks_exact_mut(across).enumerate() {
        let down = row as f64 - 1.0;
        let mut i = 0;
        while i < used {
            let right = i as f64 - 1.0;
            let start = |k: usize| map[k] + map[k + 1] * right + map[k + 2] * down;
            let (left, top) = (V::splat(start(0) as f32), V::splat(start(3) as f32));
            ramp.mul_add(V::splat(map[1] as f32), left)
                .store(&mut x[i..i + WIDTH]);
            ramp.mul_add(V::splat(map[4] as f32), top)
                .store(&mut y[i..i + WIDTH]);
            i += WIDTH;
        }
        sample_lanes::<V>(image, Border::Replicate, &x[..used], &y[..used], &mut out[..used]);
    }
    let all = 0..window.side;
    gradient_pass::<V>(window, [all.clone(), all])
}

/// Eight elements from the first, the second and the third on.
#[inline(always)]
fn three<V: Lanes>(s: &[f32]) -> [V; 3] {
    let s = &s[..WIDTH + 2];
    [
        V::load(&s[..WIDTH]),
        V::load(&s[1..1 + WIDTH]),
        V::load(&s[2..2 + WIDTH]),
    ]
}

/// Values, Scharr gradient inside the given columns and rows, and its products, from the values one sample beyond.
#[inline(always)]
fn gradient_pass<V: Lanes>(
    window: &mut FlowWindow,
    [valid_cols, valid_rows]: [std::ops::Range<usize>; 2],
) -> [f64; 3] {
    let FlowWindow {
        side,
        values,
        gx,
        gy,
        wide,
        ..
    } = window;
    let side = *side;
    let (cols, across) = (padded(side), padded(side) + WIDTH);
    let (smooth, middle, half) = (V::splat(3.0 / 16.0), V::splat(10.0 / 16.0), V::splat(0.5));
    let zero = V::splat(0.0);
    let (mut xx, mut xy, mut yy) = (zero, zero, zero);
    let mut i = 0;
    while i < cols {
        let mask = column_mask::<V>(&valid_cols, i);
        // A row above, here, and a row below; in each one place to the left, here, and one to the right.
        let mut a = three::<V>(&wide[i..]);
        let mut b = three::<V>(&wide[across + i..]);
        for row in 0..side {
            let c = three::<V>(&wide[(row + 2) * across + i..]);
            let inside = if valid_rows.contains(&row) { mask } else { zero };
            let left = a[0].add(c[0]).mul_add(smooth, b[0].mul(middle));
            let right = a[2].add(c[2]).mul_add(smooth, b[2].mul(middle));
            let x = right.sub(left).mul(half).mul(inside);
            let y = c[0].sub(a[0]).add(c[2].sub(a[2]));
            let y = y.mul_add(smooth, c[1].sub(a[1]).mul(middle)).mul(half);
            let y = y.mul(inside);
            let o = row * cols + i;
            b[1].store(&mut values[o..o + WIDTH]);
            x.store(&mut gx[o..o + WIDTH]);
            y.store(&mut gy[o..o + WIDTH]);
            xx = x.mul_add(x, xx);
            xy = x.mul_add(y, xy);
            yy = y.mul_add(y, yy);
            (a, b) = (b, c);
        }
        i += WIDTH;
    }
    [xx.sum(), xy.sum(), yy.sum()]
}

#[inline(always)]
fn mismatch_lanes<V: Lanes>(place: Place<'_>, window: &FlowWindow) -> [f64; 2] {
    let (side, cols) = (window.side, padded(window.side));
    if !place.inside(cols, side) {
        return mismatch_at_border(place, window);
    }
    let (dx, dy) = (V::splat(place.fraction[0]), V::splat(place.fraction[1]));
    let (mut bx, mut by) = (V::splat(0.0), V::splat(0.0));
    let pixels = place.pixels();
    let mut i = 0;
    while i < cols {
        let mut upper = across_pixels(&pixels[i..], dx);
        for row in 0..side {
            let lower = across_pixels(&pixels[(row + 1) * place.plane.stride() + i..], dx);
            let at = row * cols + i..row * cols + i + WIDTH;
            let there = dy.mul_add(lower.sub(upper), upper);
            let d = V::load(&window.values[at.clone()]).sub(there);
            bx = d.mul_add(V::load(&window.gx[at.clone()]), bx);
            by = d.mul_add(V::load(&window.gy[at]), by);
            upper = lower;
        }
        i += WIDTH;
    }
    [bx.sum(), by.sum()]
}

#[inline(always)]
fn moments_lanes<V: Lanes>(place: Place<'_>, window: &FlowWindow) -> [f64; 6] {
    let (side, cols) = (window.side, padded(window.side));
    let middle = window.values[side / 2 * cols + side / 2];
    if !place.inside(cols, side) {
        return moments_at_border(place, window, middle);
    }
    let (dx, dy) = (V::splat(place.fraction[0]), V::splat(place.fraction[1]));
    let shift = V::splat(middle);
    let mut sums = [V::splat(0.0); 6];
    let pixels = place.pixels();
    let mut i = 0;
    while i < cols {
        let mask = column_mask::<V>(&(0..side), i);
        let mut upper = across_pixels(&pixels[i..], dx);
        for row in 0..side {
            let lower = across_pixels(&pixels[(row + 1) * place.plane.stride() + i..], dx);
            let a = V::load(&window.values[row * cols + i..row * cols + i + WIDTH]);
            let b = dy.mul_add(lower.sub(upper), upper);
            add_moments(&mut sums, a, b, shift, mask);
            upper = lower;
        }
        i += WIDTH;
    }
    total_moments(sums)
}

/// 1 in those of the columns from `i` on that are in the range, else 0.
#[inline(always)]
fn column_mask<V: Lanes>(valid: &std::ops::Range<usize>, i: usize) -> V {
    let ramp = V::from_array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    let column = ramp.add(V::splat(i as f32));
    let (low, high) = (V::splat(valid.start as f32 - 0.5), V::splat(valid.end as f32));
    low.less(column).mul(column.less(high))
}

#[inline(always)]
fn mismatch_border_lanes<V: Lanes>(place: Place<'_>, window: &FlowWindow) -> [f64; 2] {
    let (side, cols) = (window.side, padded(window.side));
    let [valid_cols, valid_rows] = place.valid(side, side);
    let (dx, dy) = (V::splat(place.fraction[0]), V::splat(place.fraction[1]));
    let (mut bx, mut by) = (V::splat(0.0), V::splat(0.0));
    let mut lines = [[0.0; LINE]; 2];
    let [mut upper, mut lower] = lines.each_mut().map(|l| &mut l[..cols + 1]);
    place.clamped_row(valid_rows.start, upper);
    for row in valid_rows {
        place.clamped_row(row + 1, lower);
        let line = row * cols..(row + 1) * cols;
        let (t, gx, gy) = (
            &window.values[line.clone()],
            &window.gx[line.clone()],
            &window.gy[line],
        );
        let mut i = 0;
        while i < cols {
            let d = V::load(&t[i..i + WIDTH]).sub(bilinear(upper, lower, i, dx, dy));
            let d = d.mul(column_mask::<V>(&valid_cols, i));
            bx = d.mul_add(V::load(&gx[i..i + WIDTH]), bx);
            by = d.mul_add(V::load(&gy[i..i + WIDTH]), by);
            i += WIDTH;
        }
        std::mem::swap(&mut upper, &mut lower);
    }
    [bx.sum(), by.sum()]
}

#[inline(always)]
fn moments_border_lanes<V: Lanes>(place: Place<'_>, window: &FlowWindow, middle: f32) -> [f64; 6] {
    let (side, cols) = (window.side, padded(window.side));
    let [valid_cols, valid_rows] = place.valid(side, side);
    let (dx, dy) = (V::splat(place.fraction[0]), V::splat(place.fraction[1]));
    let mut sums = [V::splat(0.0); 6];
    let mut lines = [[0.0; LINE]; 2];
    let [mut upper, mut lower] = lines.each_mut().map(|l| &mut l[..cols + 1]);
    place.clamped_row(valid_rows.start, upper);
    for row in valid_rows {
        place.clamped_row(row + 1, lower);
        let values = &window.values[row * cols..(row + 1) * cols];
        let mut i = 0;
        while i < cols {
            let mask = column_mask::<V>(&valid_cols, i);
            let b = bilinear(upper, lower, i, dx, dy);
            add_moments(
                &mut sums,
                V::load(&values[i..i + WIDTH]),
                b,
                V::splat(middle),
                mask,
            );
            i += WIDTH;
        }
        std::mem::swap(&mut upper, &mut lower);
    }
    total_moments(sums)
}

/// Adds `|a - b|`, `a`, `b`, `a²`, `a b`, `b²`, both less `shift`, where the mask is 1.
#[inline(always)]
fn add_moments<V: Lanes>(sums: &mut [V; 6], a: V, b: V, shift: V, mask: V) {
    let (a, b) = (a.sub(shift).mul(mask), b.sub(shift).mul(mask));
    sums[0] = sums[0].add(a.sub(b).abs());
    sums[1] = sums[1].add(a);
    sums[2] = sums[2].add(b);
    sums[3] = a.mul_add(a, sums[3]);
    sums[4] = a.mul_add(b, sums[4]);
    sums[5] = b.mul_add(b, sums[5]);
}

#[inline(always)]
fn total_moments<V: Lanes>([d, a, b, aa, ab, bb]: [V; 6]) -> [f64; 6] {
    [d.sum(), a.sum(), b.sum(), aa.sum(), ab.sum(), bb.sum()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    fn place(image: &Image, x: f64, y: f64) -> Place<'_> {
        Place::new(image.view(0), x, y)
    }

    /// Value at clamped coordinates, in `f64`.
    fn value(image: &Image, x: f64, y: f64) -> f64 {
        let (x, y) = (
            x.clamp(0.0, image.width() as f64 - 1.0),
            y.clamp(0.0, image.height() as f64 - 1.0),
        );
        let (lx, ly) = (x.floor(), y.floor());
        let p = |i: f64, j: f64| {
            let x = (lx + i).min(image.width() as f64 - 1.0) as usize;
            let y = (ly + j).min(image.height() as f64 - 1.0) as usize;
            f64::from(image.get(0, x, y))
        };
        let (dx, dy) = (x - lx, y - ly);
        (1.0 - dy) * ((1.0 - dx) * p(0.0, 0.0) + dx * p(1.0, 0.0))
            + dy * ((1.0 - dx) * p(0.0, 1.0) + dx * p(1.0, 1.0))
    }

    proptest! {
        #[test]
        fn agree_with_f64_and_between_instruction_sets(
            side in (1usize..14).prop_map(|r| 2 * r + 1), w in 20usize..60, h in 20usize..60,
            from in (-10.0f64..50.0, -10.0f64..50.0), shift in (-3.0f64..3.0, -3.0f64..3.0),
        ) {
            let image = Image::from_fn(w, h, |x, y| ((x * 7919 + y * 104_729) % 251) as f32);
            let mut window = FlowWindow::new(side);
            let at = place(&image, from.0, from.1);
            let g = flow_window(at, &mut window);
            let mut portable = FlowWindow::new(side);
            prop_assert_eq!(g, window_lanes::<Portable>(at, &mut portable));
            prop_assert_eq!((&window.values, &window.gx, &window.gy), (&portable.values, &portable.gx, &portable.gy));
            let to = place(&image, from.0 + shift.0, from.1 + shift.1);
            let b = flow_mismatch(to, &window);
            prop_assert_eq!(b, mismatch_lanes::<Portable>(to, &window));

            let inside = |x: f64, y: f64| x >= 0.0 && y >= 0.0 && x <= (w - 1) as f64 && y <= (h - 1) as f64;
            let (mut gg, mut bb, mut size) = ([0.0; 3], [0.0; 2], 1.0);
            for row in 0..side {
                for col in 0..side {
                    let (x, y) = (from.0 + col as f64, from.1 + row as f64);
                    let v = |i: i32, j: i32| value(&image, x + f64::from(i), y + f64::from(j));
                    let k = row * padded(side) + col;
                    if inside(x, y) {
                        prop_assert!((f64::from(window.values[k]) - v(0, 0)).abs() < 0.01);
                    }
                    // Clamping sample by sample is not clamping the window at fractions of a pixel.
                    if !(inside(x - 1.0, y - 1.0) && inside(x + 1.0, y + 1.0)) {
                        continue;
                    }
                    let d = |a: f64, b: f64, c: f64| (3.0 * a + 10.0 * b + 3.0 * c) / 32.0;
                    let gx = d(v(1, -1) - v(-1, -1), v(1, 0) - v(-1, 0), v(1, 1) - v(-1, 1));
                    let gy = d(v(-1, 1) - v(-1, -1), v(0, 1) - v(0, -1), v(1, 1) - v(1, -1));
                    prop_assert!((f64::from(window.gx[k]) - gx).abs() < 0.01, "{} {}", window.gx[k], gx);
                    prop_assert!((f64::from(window.gy[k]) - gy).abs() < 0.01);
                }
            }
            for row in 0..side {
                for col in 0..side {
                    let k = row * padded(side) + col;
                    let (gx, gy) = (f64::from(window.gx[k]), f64::from(window.gy[k]));
                    gg[0] += gx * gx;
                    gg[1] += gx * gy;
                    gg[2] += gy * gy;
                    let (x, y) = (from.0 + shift.0 + col as f64, from.1 + shift.1 + row as f64);
                    if inside(x, y) {
                        let d = f64::from(window.values[k]) - value(&image, x, y);
                        bb[0] += d * gx;
                        bb[1] += d * gy;
                        size += (d * gx).abs() + (d * gy).abs();
                    }
                }
            }
            for k in 0..3 {
                prop_assert!((g[k] - gg[k]).abs() < 1e-4 * (1.0 + gg[0] + gg[2]));
            }
            for k in 0..2 {
                prop_assert!((b[k] - bb[k]).abs() < 1e-4 * size, "{:?} {:?}", b, bb);
            }
        }
    }

    #[test]
    fn windows_seen_through_a_map() {
        let image = Image::from_fn(60, 50, |x, y| ((x * 7919 + y * 104_729) % 251) as f32);
        let grid = image.view(0);
        let mut plain = FlowWindow::new(9);
        let g = flow_window(place(&image, 20.25, 18.5), &mut plain);
        let mut warped = FlowWindow::new(9);
        let map = [20.25, 1.0, 0.0, 18.5, 0.0, 1.0];
        let w = flow_window_warped(grid, map, &mut warped);
        assert_eq!(w, warped_window_lanes::<Portable>(grid, map, &mut warped.clone()));
        for k in 0..3 {
            assert!((g[k] - w[k]).abs() < 1e-4 * (g[0] + g[2]));
        }
        // A quarter of a turn exchanges the axes.
        let turned = flow_window_warped(grid, [28.25, 0.0, -1.0, 18.5, 1.0, 0.0], &mut warped);
        for (a, b) in [(turned[0], g[2]), (turned[1], -g[1]), (turned[2], g[0])] {
            assert!((a - b).abs() < 1e-4 * (g[0] + g[2]), "{turned:?} {g:?}");
        }
    }

    #[test]
    fn residual_and_valid_samples() {
        let image = Image::from_fn(40, 30, |x, _| x as f32);
        let mut window = FlowWindow::new(5);
        flow_window(place(&image, 10.0, 10.0), &mut window);
        let near = flow_match(place(&image, 12.5, 10.0), &window);
        assert!(
            (near.residual - 2.5).abs() < 1e-5 && (near.ncc - 1.0).abs() < 1e-5,
            "{near:?}"
        );
        let border = flow_match(place(&image, 36.5, 10.0), &window);
        assert!(
            (border.residual - 26.5).abs() < 1e-5 && (border.ncc - 1.0).abs() < 1e-5,
            "{border:?}"
        );
        let outside = flow_match(place(&image, 80.0, 10.0), &window);
        assert_eq!((outside.residual, outside.ncc), (f64::INFINITY, 0.0));
        let flat = Image::from_fn(40, 30, |_, _| 90.0);
        assert_eq!(flow_match(place(&flat, 10.3, 10.0), &window).ncc, 0.0);
        let moments = flow_moments(place(&image, 12.5, 10.0), &window);
        assert_eq!(
            moments,
            moments_lanes::<Portable>(place(&image, 12.5, 10.0), &window)
        );
        assert_eq!(place(&image, -2.0, 27.0).valid(5, 5), [2..5, 0..3]);
        assert_eq!(place(&image, -2.5, 27.5).valid(5, 5), [3..5, 0..2]);
    }
}
