//! Central differences on the sampling grid, their adjoint, and what normalised gradient fields make of them.
//!
//! `(Dx x)[i] = (x[i+1] - x[i-1])/2`, at an edge of the grid half the one-sided difference; `Dy` likewise. All planes of
//! a patch are handled alike, one after the other.

use super::{Jacobian, Lanes, WIDTH, dispatch};

dispatch! {
    /// `gx = Dx x`, `gy = Dy x` for planes of `rows` rows of `cols` values.
    pub fn patch_gradient(x: &[f32], cols: usize, rows: usize, gx: &mut [f32], gy: &mut [f32]) = gradient_lanes;
    /// `out = Dx' qx + Dy' qy`.
    pub fn patch_gradient_adjoint(qx: &[f32], qy: &[f32], cols: usize, rows: usize, out: &mut [f32]) = adjoint_lanes;
    /// Divides each vector by `|g|_η = sqrt(gx² + gy² + η²)` and writes the inverse of that, unless `inverse` is empty.
    pub fn normalise_field(gx: &mut [f32], gy: &mut [f32], eta: f32, inverse: &mut [f32]) = normalise_lanes;
    /// `Σ (u_i · v_i)²`.
    pub fn squared_alignment(ux: &[f32], uy: &[f32], vx: &[f32], vy: &[f32]) -> f64 = alignment_lanes;
    /// `q = (r (v - r u) - w s) / |g|_η` with `r = u · v` and `s` the same as the first term at `v = u`; `u` a normalised field,
    /// `inverse` its `1/|g|_η`.
    pub fn alignment_gradient(
        ux: &[f32], uy: &[f32], inverse: &[f32], vx: &[f32], vy: &[f32], w: f32, qx: &mut [f32], qy: &mut [f32],
    ) = alignment_gradient_lanes;
    /// With the terms of [`alignment_gradient`]: `Σ q · s/|g|_η²` for `w = 0`, and `Σ s²/|g|_η²`.
    pub fn alignment_bias(ux: &[f32], uy: &[f32], inverse: &[f32], vx: &[f32], vy: &[f32]) -> [f64; 2] = alignment_bias_lanes;
    /// Directions `a`, `b` for [`combine_rows`] such that the Gram matrix of its result is `Σ [Dx J; Dy J]_i' m_i [Dx J; Dy J]_i`,
    /// `m` the mixed second derivative of `½ Σ (u · v)²` at `v = u`: `a = √2 (1 - u²) u/|g|`, `b = u⊥/|g|`.
    pub fn field_axes(ux: &[f32], uy: &[f32], inverse: &[f32], axes: &mut [Vec<f32>; 4]) = field_axes_lanes;
    /// `ax_i (Dx J)_i + ay_i (Dy J)_i` in the first rows of `out`, the same with `b` in the following; axes `ax, ay, bx, by`.
    pub fn combine_rows(j: &Jacobian, cols: usize, rows: usize, axes: &[Vec<f32>; 4], out: &mut Jacobian) = combine_rows_lanes;
}

/// Starts of the groups of eight that cover a row; the last one overlaps the one before it.
#[inline(always)]
fn groups(cols: usize) -> impl Iterator<Item = usize> {
    (0..cols.div_ceil(WIDTH)).map(move |k| (WIDTH * k).min(cols.saturating_sub(WIDTH)))
}

/// Values to the left and to the right of those from `i` on, `i` from [`groups`]; beyond the edges the outermost ones.
#[inline(always)]
fn neighbours<V: Lanes>(row: &[f32], i: usize) -> (V, V) {
    let cols = row.len();
    if cols <= WIDTH {
        let (mut left, mut right) = ([0.0; WIDTH], [0.0; WIDTH]);
        for k in 0..cols {
            left[k] = row[k.saturating_sub(1)];
            right[k] = row[(k + 1).min(cols - 1)];
        }
        return (V::from_array(left), V::from_array(right));
    }
    let left = if i > 0 {
        V::load(&row[i - 1..i - 1 + WIDTH])
    } else {
        V::load(&row[..WIDTH]).repeat_first()
    };
    let right = if i + WIDTH < cols {
        V::load(&row[i + 1..i + 1 + WIDTH])
    } else {
        V::load(&row[i..i + WIDTH]).repeat_last()
    };
    (left, right)
}

/// `Dx` and `Dy` of row `y` of a plane from `i` on.
#[inline(always)]
fn differences<V: Lanes>(plane: &[f32], cols: usize, rows: usize, y: usize, i: usize) -> (V, V) {
    let above = &plane[y.saturating_sub(1) * cols..][..cols];
    let below = &plane[(y + 1).min(rows - 1) * cols..][..cols];
    let (left, right) = neighbours::<V>(&plane[y * cols..(y + 1) * cols], i);
    let half = V::splat(0.5);
    let dy = V::load_at(below, i).sub(V::load_at(above, i));
    (right.sub(left).mul(half), dy.mul(half))
}

#[inline(always)]
fn gradient_lanes<V: Lanes>(x: &[f32], cols: usize, rows: usize, gx: &mut [f32], gy: &mut [f32]) {
    let n = cols * rows;
    let planes = x
        .chunks_exact(n)
        .zip(gx.chunks_exact_mut(n))
        .zip(gy.chunks_exact_mut(n));
    for ((x, gx), gy) in planes {
        for y in 0..rows {
            let (gx, gy) = (
                &mut gx[y * cols..(y + 1) * cols],
                &mut gy[y * cols..(y + 1) * cols],
            );
            for i in groups(cols) {
                let (dx, dy) = differences::<V>(x, cols, rows, y, i);
                dx.store_at(gx, i);
                dy.store_at(gy, i);
            }
        }
    }
}

#[inline(always)]
fn adjoint_lanes<V: Lanes>(qx: &[f32], qy: &[f32], cols: usize, rows: usize, out: &mut [f32]) {
    let n = cols * rows;
    let half = V::splat(0.5);
    for ((qx, qy), out) in qx
        .chunks_exact(n)
        .zip(qy.chunks_exact(n))
        .zip(out.chunks_exact_mut(n))
    {
        for y in 0..rows {
            let row = &qx[y * cols..(y + 1) * cols];
            let out = &mut out[y * cols..(y + 1) * cols];
            let line = |y: usize| &qy[y * cols..(y + 1) * cols];
            // Beyond the edges the field continues with the opposite sign.
            let (above, sign_above) = if y > 0 {
                (line(y - 1), 0.5)
            } else {
                (line(0), -0.5)
            };
            let (below, sign_below) = if y + 1 < rows {
                (line(y + 1), -0.5)
            } else {
                (line(y), 0.5)
            };
            let (sign_above, sign_below) = (V::splat(sign_above), V::splat(sign_below));
            for i in groups(cols) {
                let (left, right) = neighbours::<V>(row, i);
                let (mut first, mut last) = ([1.0; WIDTH], [1.0; WIDTH]);
                if i == 0 {
                    first[0] = -1.0;
                }
                if i + WIDTH >= cols {
                    last[cols - 1 - i] = -1.0;
                }
                let left = left.mul(V::from_array(first));
                let v = left.sub(right.mul(V::from_array(last))).mul(half);
                let v = V::load_at(above, i).mul_add(sign_above, v);
                V::load_at(below, i).mul_add(sign_below, v).store_at(out, i);
            }
        }
    }
}

#[inline(always)]
fn normalise_lanes<V: Lanes>(gx: &mut [f32], gy: &mut [f32], eta: f32, inverse: &mut [f32]) {
    let n = gx.len();
    let gy = &mut gy[..n];
    let (one, eta2) = (V::splat(1.0), V::splat(eta * eta));
    let mut i = 0;
    while i < n {
        let (x, y) = (V::load_at(gx, i), V::load_at(gy, i));
        let k = one.div(x.mul_add(x, y.mul_add(y, eta2)).sqrt());
        x.mul(k).store_at(gx, i);
        y.mul(k).store_at(gy, i);
        if !inverse.is_empty() {
            k.store_at(inverse, i);
        }
        i += WIDTH;
    }
}

/// Values summed in `f32` before the partial sum is widened.
const BLOCK: usize = 32 * WIDTH;

#[inline(always)]
fn alignment_lanes<V: Lanes>(ux: &[f32], uy: &[f32], vx: &[f32], vy: &[f32]) -> f64 {
    let n = ux.len();
    let (uy, vx, vy) = (&uy[..n], &vx[..n], &vy[..n]);
    let mut total = 0.0;
    let mut start = 0;
    while start < n {
        let end = (start + BLOCK).min(n);
        let mut acc = V::splat(0.0);
        let mut i = start;
        while i < end {
            let r = V::load_at(ux, i).mul_add(V::load_at(vx, i), V::load_at(uy, i).mul(V::load_at(vy, i)));
            acc = r.mul_add(r, acc);
            i += WIDTH;
        }
        total += acc.sum();
        start = end;
    }
    total
}

/// `r (v - r u)` with `r = u · v`.
#[inline(always)]
fn rejected<V: Lanes>([u0, u1]: [V; 2], [v0, v1]: [V; 2]) -> (V, V) {
    let r = u0.mul_add(v0, u1.mul(v1));
    let minus = V::splat(0.0).sub(r);
    (r.mul(minus.mul_add(u0, v0)), r.mul(minus.mul_add(u1, v1)))
}

#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn alignment_gradient_lanes<V: Lanes>(
    ux: &[f32],
    uy: &[f32],
    inverse: &[f32],
    vx: &[f32],
    vy: &[f32],
    w: f32,
    qx: &mut [f32],
    qy: &mut [f32],
) {
    let n = ux.len();
    let (uy, inverse, vx, vy) = (&uy[..n], &inverse[..n], &vx[..n], &vy[..n]);
    let (qx, qy) = (&mut qx[..n], &mut qy[..n]);
    let minus = V::splat(-w);
    let mut i = 0;
    while i < n {
        let u = [V::load_at(ux, i), V::load_at(uy, i)];
        let (q0, q1) = rejected(u, [V::load_at(vx, i), V::load_at(vy, i)]);
        let (s0, s1) = rejected(u, u);
        let k = V::load_at(inverse, i);
        s0.mul_add(minus, q0).mul(k).store_at(qx, i);
        s1.mul_add(minus, q1).mul(k).store_at(qy, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn alignment_bias_lanes<V: Lanes>(
    ux: &[f32],
    uy: &[f32],
    inverse: &[f32],
    vx: &[f32],
    vy: &[f32],
) -> [f64; 2] {
    let n = ux.len();
    let (uy, inverse, vx, vy) = (&uy[..n], &inverse[..n], &vx[..n], &vy[..n]);
    let mut total = [0.0; 2];
    let mut start = 0;
    while start < n {
        let end = (start + BLOCK).min(n);
        let (mut qs, mut ss) = (V::splat(0.0), V::splat(0.0));
        let mut i = start;
        while i < end {
            let u = [V::load_at(ux, i), V::load_at(uy, i)];
            let (q0, q1) = rejected(u, [V::load_at(vx, i), V::load_at(vy, i)]);
            let (s0, s1) = rejected(u, u);
            let k = V::load_at(inverse, i);
            let (k0, k1) = (s0.mul(k).mul(k), s1.mul(k).mul(k));
            qs = q0.mul_add(k0, q1.mul_add(k1, qs));
            ss = s0.mul_add(k0, s1.mul_add(k1, ss));
            i += WIDTH;
        }
        total = [total[0] + qs.sum(), total[1] + ss.sum()];
        start = end;
    }
    total
}

#[inline(always)]
fn field_axes_lanes<V: Lanes>(ux: &[f32], uy: &[f32], inverse: &[f32], axes: &mut [Vec<f32>; 4]) {
    let n = ux.len();
    let (uy, inverse) = (&uy[..n], &inverse[..n]);
    let [ax, ay, bx, by] = axes;
    let (ax, ay, bx, by) = (&mut ax[..n], &mut ay[..n], &mut bx[..n], &mut by[..n]);
    let (root, one, zero) = (V::splat(std::f32::consts::SQRT_2), V::splat(1.0), V::splat(0.0));
    let mut i = 0;
    while i < n {
        let (x, y, k) = (V::load_at(ux, i), V::load_at(uy, i), V::load_at(inverse, i));
        let rho = x.mul_add(x, y.mul(y));
        let along = root.mul(one.sub(rho)).mul(k);
        along.mul(x).store_at(ax, i);
        along.mul(y).store_at(ay, i);
        zero.sub(k.mul(y)).store_at(bx, i);
        k.mul(x).store_at(by, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn combine_rows_lanes<V: Lanes>(
    j: &Jacobian,
    cols: usize,
    rows: usize,
    axes: &[Vec<f32>; 4],
    out: &mut Jacobian,
) {
    let (n, size) = (j.rows(), cols * rows);
    let [ax, ay, bx, by] = axes;
    let (ax, ay, bx, by) = (&ax[..n], &ay[..n], &bx[..n], &by[..n]);
    out.resize(2 * n, j.cols());
    for s in 0..j.cols() {
        let (first, second) = out.col_mut(s).split_at_mut(n);
        for (plane, values) in j.col(s).chunks_exact(size).enumerate() {
            for y in 0..rows {
                let at = plane * size + y * cols..plane * size + (y + 1) * cols;
                let (first, second) = (&mut first[at.clone()], &mut second[at.clone()]);
                let (ax, ay, bx, by) = (&ax[at.clone()], &ay[at.clone()], &bx[at.clone()], &by[at]);
                for i in groups(cols) {
                    let (dx, dy) = differences::<V>(values, cols, rows, y, i);
                    let v = V::load_at(ax, i).mul_add(dx, V::load_at(ay, i).mul(dy));
                    v.store_at(first, i);
                    let v = V::load_at(bx, i).mul_add(dx, V::load_at(by, i).mul(dy));
                    v.store_at(second, i);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    fn slow(x: &[f32], cols: usize, rows: usize) -> (Vec<f64>, Vec<f64>) {
        let at = |c: usize, i: usize, k: usize| {
            f64::from(x[c * cols * rows + k.min(rows - 1) * cols + i.min(cols - 1)])
        };
        let mut g = (Vec::new(), Vec::new());
        for p in 0..x.len() {
            let (c, i, k) = (p / (cols * rows), p % cols, p / cols % rows);
            g.0.push((at(c, i + 1, k) - at(c, i.saturating_sub(1), k)) / 2.0);
            g.1.push((at(c, i, k + 1) - at(c, i, k.saturating_sub(1))) / 2.0);
        }
        g
    }

    proptest! {
        #[test]
        fn agree_with_f64_and_between_instruction_sets(
            cols in 2usize..30, rows in 2usize..6, planes in 1usize..3, seed in 0u32..1000,
        ) {
            let n = cols * rows * planes;
            let value = |i: usize, k: u32| {
                let v = (i as u32).wrapping_mul(2654435761).wrapping_add((k + seed).wrapping_mul(40503)) >> 8;
                (v % 2001) as f32 / 1000.0 - 1.0
            };
            let vector = |k: u32| (0..n).map(|i| value(i, k)).collect::<Vec<f32>>();
            let x = vector(1);
            let exact = slow(&x, cols, rows);
            let (mut gx, mut gy, mut px, mut py) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
            patch_gradient(&x, cols, rows, &mut gx, &mut gy);
            gradient_lanes::<Portable>(&x, cols, rows, &mut px, &mut py);
            prop_assert_eq!((&gx, &gy), (&px, &py));
            for i in 0..n {
                prop_assert!((f64::from(gx[i]) - exact.0[i]).abs() < 1e-6 && (f64::from(gy[i]) - exact.1[i]).abs() < 1e-6);
            }
            // The adjoint is defined by <D x, q> = <x, D' q>.
            let (qx, qy) = (vector(2), vector(3));
            let (mut out, mut portable) = (vec![0.0; n], vec![0.0; n]);
            patch_gradient_adjoint(&qx, &qy, cols, rows, &mut out);
            adjoint_lanes::<Portable>(&qx, &qy, cols, rows, &mut portable);
            prop_assert_eq!(&out, &portable);
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum::<f64>();
            prop_assert!((dot(&gx, &qx) + dot(&gy, &qy) - dot(&x, &out)).abs() < 1e-5 * n as f64);

            let mut inverse = vec![0.0; n];
            normalise_field(&mut gx, &mut gy, 0.3, &mut inverse);
            for i in 0..n {
                let norm = (exact.0[i].powi(2) + exact.1[i].powi(2) + 0.09).sqrt();
                prop_assert!((f64::from(gx[i]) - exact.0[i] / norm).abs() < 1e-5);
                prop_assert!((f64::from(inverse[i]) * norm - 1.0).abs() < 1e-5);
            }
            let sum: f64 = (0..n).map(|i| f64::from(gx[i] * qx[i] + gy[i] * qy[i]).powi(2)).sum();
            prop_assert!((squared_alignment(&gx, &gy, &qx, &qy) - sum).abs() < 1e-5 * (1.0 + sum));
            let [same, size] = alignment_bias(&gx, &gy, &inverse, &gx, &gy);
            prop_assert_eq!(same, size);
            alignment_gradient(&gx, &gy, &inverse, &gx, &gy, 1.0, &mut px, &mut py);
            prop_assert!(px.iter().chain(&py).all(|&v| v == 0.0));
            let (mut bx, mut by) = (vec![0.0; n], vec![0.0; n]);
            alignment_gradient(&gx, &gy, &inverse, &gx, &gy, 0.0, &mut bx, &mut by);
            alignment_gradient(&gx, &gy, &inverse, &qx, &qy, 0.0, &mut px, &mut py);
            let [both, own] = alignment_bias(&gx, &gy, &inverse, &qx, &qy);
            prop_assert!((both - dot(&px, &bx) - dot(&py, &by)).abs() < 1e-5 * (1.0 + n as f64));
            prop_assert!((own - dot(&bx, &bx) - dot(&by, &by)).abs() < 1e-5 * (1.0 + own));
            for i in 0..n {
                let r = gx[i] * qx[i] + gy[i] * qy[i];
                prop_assert!((px[i] - r * (qx[i] - r * gx[i]) * inverse[i]).abs() < 1e-4);
            }

            let mut j = Jacobian::new(n, 3);
            (0..3).for_each(|k| j.col_mut(k).copy_from_slice(&vector(9 + k as u32)));
            let (mut a, mut b) = (Jacobian::default(), Jacobian::default());
            let mut axes = [(); 4].map(|()| vec![0.0; n]);
            field_axes(&gx, &gy, &inverse, &mut axes);
            let wide = axes.clone();
            field_axes_lanes::<Portable>(&gx, &gy, &inverse, &mut axes);
            prop_assert_eq!(&axes, &wide);
            combine_rows(&j, cols, rows, &axes, &mut a);
            combine_rows_lanes::<Portable>(&j, cols, rows, &axes, &mut b);
            for k in 0..3 {
                let d = slow(j.col(k), cols, rows);
                for i in 0..n {
                    let (x, y, inv) = (f64::from(gx[i]), f64::from(gy[i]), f64::from(inverse[i]));
                    let along = 2f64.sqrt() * (1.0 - x * x - y * y) * inv * (x * d.0[i] + y * d.1[i]);
                    let across = inv * (x * d.1[i] - y * d.0[i]);
                    prop_assert!((f64::from(a.col(k)[i]) - along).abs() < 1e-5);
                    prop_assert!((f64::from(a.col(k)[n + i]) - across).abs() < 1e-5);
                }
            }
            prop_assert_eq!(a.col(2), b.col(2));
        }
    }
}
