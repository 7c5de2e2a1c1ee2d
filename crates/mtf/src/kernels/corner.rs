//! Corner response of a whole plane and intensity centroids of patches.

use super::blur::reflect101;
use super::{Lanes, WIDTH, dispatch};

/// Taps of the window that structure matrices are summed over.
const TAPS: usize = 5;

/// Elements of the scratch slice that [`corner_response`] needs for a plane `width` pixels wide.
pub fn corner_scratch_len(width: usize) -> usize {
    3 * TAPS * width.next_multiple_of(WIDTH) + 3 * (width.next_multiple_of(WIDTH) + TAPS - 1)
}

/// Largest distance of a patch's pixels from its centre that [`centroid`] counts.
pub const CENTROID_RADIUS: usize = 15;

dispatch! {
    /// Smaller eigenvalue (Shi & Tomasi 1994) of `Σ w ∇I ∇Iᵀ` at every pixel, row-major `width x height`, (intensity/px)²;
    /// `∇I` by central differences, one-sided at the border, `w` binomial over 5x5 pixels, reflected there.
    /// `scratch` has [`corner_scratch_len`] elements.
    pub fn corner_response(
        plane: &[f32], width: usize, height: usize, stride: usize, out: &mut [f32], scratch: &mut [f32],
    ) = response_lanes;
    /// Columns within `range` where the middle one of three rows is greater than `least` and no smaller than its eight
    /// neighbours, into `out` in ascending order; returns how many. The range leaves out the first and the last column, and
    /// `out` is as long as it.
    pub fn row_peaks(rows: [&[f32]; 3], range: std::ops::Range<usize>, least: f32, out: &mut [u32]) -> usize = peaks_lanes;
    /// First moments `(Σ x I, Σ y I)` of the disc of radius 15 around pixel `(x, y)`, relative to it. The disc, and one
    /// column to the left of it, lie inside the plane.
    pub fn centroid(plane: &[f32], stride: usize, x: usize, y: usize) -> [f64; 2] = centroid_lanes;
}

/// `(a + e + 4 (b + d) + 6 c) / 16`.
#[inline(always)]
fn binomial<V: Lanes>(a: V, b: V, c: V, d: V, e: V) -> V {
    let sum = b.add(d).mul_add(V::splat(4.0), a.add(e));
    c.mul_add(V::splat(6.0), sum).mul(V::splat(1.0 / 16.0))
}

/// The same along a line, for its first eight places.
#[inline(always)]
fn along<V: Lanes>(line: &[f32]) -> V {
    let line = &line[..WIDTH + TAPS - 1];
    binomial(
        V::load(&line[..WIDTH]),
        V::load(&line[1..1 + WIDTH]),
        V::load(&line[2..2 + WIDTH]),
        V::load(&line[3..3 + WIDTH]),
        V::load(&line[4..4 + WIDTH]),
    )
}

#[inline(always)]
fn response_lanes<V: Lanes>(
    plane: &[f32],
    width: usize,
    height: usize,
    stride: usize,
    out: &mut [f32],
    scratch: &mut [f32],
) {
    let padded = width.next_multiple_of(WIDTH);
    let (ring, lines) = scratch[..corner_scratch_len(width)].split_at_mut(3 * TAPS * padded);
    ring.fill(0.0);
    lines.fill(0.0);
    let across = padded + TAPS - 1;
    let half = V::splat(0.5);
    let mut done = 0;
    for y in 0..height {
        while done < height.min(y + TAPS / 2 + 1) {
            let line = |y: usize| &plane[y * stride..y * stride + width];
            let (above, here, below) = (
                line(done.saturating_sub(1)),
                line(done),
                line((done + 1).min(height - 1)),
            );
            let slot = &mut ring[3 * (done % TAPS) * padded..][..3 * padded];
            let (xx, rest) = slot.split_at_mut(padded);
            let (xy, yy) = rest.split_at_mut(padded);
            let mut x = 0;
            while x < width {
                let (left, right) = if x > 0 && x + WIDTH < width {
                    (
                        V::load(&here[x - 1..x - 1 + WIDTH]),
                        V::load(&here[x + 1..x + 1 + WIDTH]),
                    )
                } else {
                    let (mut left, mut right) = ([0.0; WIDTH], [0.0; WIDTH]);
                    for k in 0..WIDTH.min(width - x) {
                        left[k] = here[(x + k).saturating_sub(1)];
                        right[k] = here[(x + k + 1).min(width - 1)];
                    }
                    (V::from_array(left), V::from_array(right))
                };
                let gx = right.sub(left).mul(half);
                let gy = V::load_at(below, x).sub(V::load_at(above, x)).mul(half);
                gx.mul(gx).store(&mut xx[x..x + WIDTH]);
                gx.mul(gy).store(&mut xy[x..x + WIDTH]);
                gy.mul(gy).store(&mut yy[x..x + WIDTH]);
                x += WIDTH;
            }
            done += 1;
        }
        let slots: [usize; TAPS] =
            std::array::from_fn(|k| 3 * (reflect101((y + k) as isize - 2, height) % TAPS) * padded);
        for product in 0..3 {
            let line = &mut lines[product * across..(product + 1) * across];
            let row = |k: usize| &ring[slots[k] + product * padded..][..padded];
            let (a, b, c, d, e) = (row(0), row(1), row(2), row(3), row(4));
            let mut x = 0;
            while x < padded {
                let at = x..x + WIDTH;
                binomial(
                    V::load(&a[at.clone()]),
                    V::load(&b[at.clone()]),
                    V::load(&c[at.clone()]),
                    V::load(&d[at.clone()]),
                    V::load(&e[at]),
                )
                .store(&mut line[2 + x..2 + x + WIDTH]);
                x += WIDTH;
            }
            for i in 1..=2 {
                line[2 - i] = line[2 + reflect101(-(i as isize), width)];
                line[1 + width + i] = line[2 + reflect101((width - 1 + i) as isize, width)];
            }
        }
        let out = &mut out[y * width..(y + 1) * width];
        let mut x = 0;
        while x < width {
            let xx = along::<V>(&lines[x..]);
            let xy = along::<V>(&lines[across + x..]);
            let yy = along::<V>(&lines[2 * across + x..]);
            let (mean, diff) = (xx.add(yy).mul(half), xx.sub(yy).mul(half));
            let root = diff.mul_add(diff, xy.mul(xy)).sqrt();
            mean.sub(root).store_at(out, x);
            x += WIDTH;
        }
    }
}

/// The greater lanes of `s` from `x - 1`, `x` and `x + 1` on.
#[inline(always)]
fn greatest<V: Lanes>(s: &[f32], x: usize) -> V {
    let s = &s[x - 1..x + 1 + WIDTH];
    V::load(&s[..WIDTH])
        .max(V::load(&s[1..1 + WIDTH]))
        .max(V::load(&s[2..2 + WIDTH]))
}

#[inline(always)]
fn peaks_lanes<V: Lanes>(
    rows: [&[f32]; 3],
    range: std::ops::Range<usize>,
    least: f32,
    out: &mut [u32],
) -> usize {
    let [above, here, below] = rows;
    let width = here.len();
    let mut n = 0;
    let mut keep = |x: usize| {
        let v = here[x];
        let around = [above, here, below];
        if v > least && around.iter().all(|r| r[x - 1..x + 2].iter().all(|a| v >= *a)) {
            out[n] = x as u32;
            n += 1;
        }
    };
    let (low, high) = (V::splat(f32::NEG_INFINITY), V::splat(-f32::MIN_POSITIVE));
    let mut x = range.start;
    while x < range.end {
        let end = (x + WIDTH).min(range.end);
        // Most groups have no peak: all of them below a neighbour or the least value.
        let none = x + WIDTH < width && {
            let beside = V::load(&here[x - 1..x - 1 + WIDTH]).max(V::load(&here[x + 1..x + 1 + WIDTH]));
            let rival = greatest::<V>(above, x).max(greatest::<V>(below, x)).max(beside);
            let excess = V::load(&here[x..x + WIDTH]).sub(rival.max(V::splat(least)));
            excess.all_within(low, high)
        };
        if !none {
            (x..end).for_each(&mut keep);
        }
        x = end;
    }
    n
}

/// Half widths of the disc's rows.
const fn half_widths() -> [i32; 2 * CENTROID_RADIUS + 1] {
    let radius = CENTROID_RADIUS as i32;
    let mut widths = [0; 2 * CENTROID_RADIUS + 1];
    let mut row = 0;
    while row < widths.len() {
        let y = row as i32 - radius;
        let mut x = 0;
        while (x + 1) * (x + 1) + y * y <= radius * radius {
            x += 1;
        }
        widths[row] = x;
        row += 1;
    }
    widths
}

/// Columns of a row of weights: from one left of the disc to its right end.
const SPAN: usize = 2 * CENTROID_RADIUS + 2;

/// `x` inside the disc, zero outside; and one inside.
static WEIGHTS: [[[f32; SPAN]; 2 * CENTROID_RADIUS + 1]; 2] = weights();

const fn weights() -> [[[f32; SPAN]; 2 * CENTROID_RADIUS + 1]; 2] {
    let widths = half_widths();
    let mut out = [[[0.0; SPAN]; 2 * CENTROID_RADIUS + 1]; 2];
    let mut row = 0;
    while row < widths.len() {
        let mut col = 0;
        while col < SPAN {
            let x = col as i32 - CENTROID_RADIUS as i32 - 1;
            if x >= -widths[row] && x <= widths[row] {
                out[0][row][col] = x as f32;
                out[1][row][col] = 1.0;
            }
            col += 1;
        }
        row += 1;
    }
    out
}

#[inline(always)]
fn centroid_lanes<V: Lanes>(plane: &[f32], stride: usize, x: usize, y: usize) -> [f64; 2] {
    let (mut mx, mut my) = (V::splat(0.0), V::splat(0.0));
    for row in 0..2 * CENTROID_RADIUS + 1 {
        let at = (y + row - CENTROID_RADIUS) * stride + x - CENTROID_RADIUS - 1;
        let pixels = &plane[at..at + SPAN];
        let mut line = V::splat(0.0);
        for i in (0..SPAN).step_by(WIDTH) {
            let p = V::load(&pixels[i..i + WIDTH]);
            mx = p.mul_add(V::load(&WEIGHTS[0][row][i..i + WIDTH]), mx);
            line = p.mul_add(V::load(&WEIGHTS[1][row][i..i + WIDTH]), line);
        }
        my = line.mul_add(V::splat(row as f32 - CENTROID_RADIUS as f32), my);
    }
    [mx.sum(), my.sum()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    fn noise(n: usize) -> Vec<f32> {
        (0..n).map(|i| ((i * 7919 + i * i % 1013) % 251) as f32).collect()
    }

    proptest! {
        #[test]
        fn response_agrees_with_f64_and_between_instruction_sets(w in 3usize..40, h in 3usize..40) {
            let plane = noise(w * h);
            let (mut out, mut portable) = (vec![0.0; w * h], vec![0.0; w * h]);
            corner_response(&plane, w, h, w, &mut out, &mut vec![f32::NAN; corner_scratch_len(w)]);
            response_lanes::<Portable>(&plane, w, h, w, &mut portable, &mut vec![f32::NAN; corner_scratch_len(w)]);
            prop_assert_eq!(&out, &portable);
            let p = |x: isize, y: isize| {
                let clamp = |v: isize, n: usize| v.clamp(0, n as isize - 1) as usize;
                f64::from(plane[clamp(y, h) * w + clamp(x, w)])
            };
            let weights = [1.0, 4.0, 6.0, 4.0, 1.0].map(|v: f64| v / 16.0);
            for y in 0..h {
                for x in 0..w {
                    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
                    for (j, wy) in weights.iter().enumerate() {
                        for (i, wx) in weights.iter().enumerate() {
                            let u = reflect101((x + i) as isize - 2, w) as isize;
                            let v = reflect101((y + j) as isize - 2, h) as isize;
                            let gx = 0.5 * (p(u + 1, v) - p(u - 1, v));
                            let gy = 0.5 * (p(u, v + 1) - p(u, v - 1));
                            xx += wx * wy * gx * gx;
                            xy += wx * wy * gx * gy;
                            yy += wx * wy * gy * gy;
                        }
                    }
                    let want = 0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
                    prop_assert!((f64::from(out[y * w + x]) - want).abs() < 1e-5 * (1.0 + xx + yy));
                }
            }
        }
    }

    #[test]
    fn peaks_are_no_smaller_than_their_neighbours() {
        let (w, h) = (83, 20);
        let plane: Vec<f32> = noise(w * h).iter().map(|v| (v / 10.0).floor()).collect();
        let mut total = 0;
        for y in 1..h - 1 {
            let line = |y: usize| &plane[y * w..(y + 1) * w];
            let rows = [line(y - 1), line(y), line(y + 1)];
            for range in [1..w - 1, 7..61, 5..6] {
                let (mut out, mut portable) = (vec![0; w], vec![0; w]);
                let n = row_peaks(rows, range.clone(), 12.0, &mut out);
                assert_eq!(
                    n,
                    peaks_lanes::<Portable>(rows, range.clone(), 12.0, &mut portable)
                );
                assert_eq!(out, portable);
                let peak = |x: &usize| {
                    let v = rows[1][*x];
                    v > 12.0 && rows.iter().all(|r| (x - 1..x + 2).all(|i| v >= r[i]))
                };
                let want: Vec<u32> = range.filter(peak).map(|x| x as u32).collect();
                assert_eq!(out[..n], want);
                total += n;
            }
        }
        assert!(total > 50, "{total}");
    }

    #[test]
    fn centroids_agree_with_the_definition() {
        let (w, h) = (60, 50);
        let plane = noise(w * h);
        for (x, y) in [(16, 15), (30, 20), (44, 34)] {
            let got = centroid(&plane, w, x, y);
            assert_eq!(got, centroid_lanes::<Portable>(&plane, w, x, y));
            let mut want = [0.0; 2];
            for j in -15i32..=15 {
                for i in -15i32..=15 {
                    if i * i + j * j <= 225 {
                        let v = f64::from(plane[(y as i32 + j) as usize * w + (x as i32 + i) as usize]);
                        want[0] += f64::from(i) * v;
                        want[1] += f64::from(j) * v;
                    }
                }
            }
            for k in 0..2 {
                assert!((got[k] - want[k]).abs() < 2.0, "{got:?} {want:?}");
            }
        }
    }
}
