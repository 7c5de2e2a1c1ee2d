//! Steepest-descent images: image gradient times warp Jacobian, for every projective warp and every search method.
//!
//! A gradient at a point is carried as a *covector* `q = (q_x, q_y, q_1)` on homogeneous points with
//! `q · (x, y, 1) = 0`. Then the chain rule through a homography is the product `q A` with its 3x3 matrix, and the
//! derivative along parameter `k` of a warp with matrix `M(p)` is `q · dM/dp_k · (x, y, 1)`: nine products
//! `q_r x_c`, combined by the entries of `dM/dp_k`.

use super::{Jacobian, Lanes, WIDTH, dispatch};

/// Where the covectors come from and how they are carried into the base frame.
#[derive(Clone, Copy, Debug)]
pub struct Covectors<'a> {
    /// Gradient along x at each point.
    pub gx: &'a [f32],
    /// Gradient along y.
    pub gy: &'a [f32],
    /// Positions of those points, in the coordinates of the gradient.
    pub px: &'a [f32],
    /// Positions, y.
    pub py: &'a [f32],
    /// The frame's origin in those coordinates.
    pub centre: [f32; 2],
    /// One unit of the frame in those coordinates.
    pub scale: f32,
    /// 3x3 matrix (row-major) that multiplies the covectors from the right.
    pub matrix: [f32; 9],
    /// Row `d` of a denominator `D = d · (x, y, 1)` that divides them; `None` for 1.
    pub denominator: Option<[f32; 3]>,
}

/// Column of a Jacobian as a combination of the nine products `q_r x_c` (index `3 r + c`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Column {
    weights: [f32; 9],
    /// The only product with a weight, if there is just one.
    single: Option<usize>,
}

impl Column {
    /// From the nine entries of `dM/dp_k`, row-major.
    pub fn new(entries: [f64; 9]) -> Self {
        let mut nonzero = (0..9).filter(|&i| entries[i] != 0.0);
        let (first, second) = (nonzero.next(), nonzero.next());
        Column {
            weights: entries.map(|e| e as f32),
            single: first.filter(|_| second.is_none()),
        }
    }
}

dispatch! {
    /// Writes the columns for points `(x, y)` of the base frame into rows `row..row + x.len()` of `out`.
    pub fn steepest(
        x: &[f32], y: &[f32], q: &Covectors<'_>, columns: &[Column], row: usize, out: &mut Jacobian,
    ) = steepest_lanes;
}

/// Points whose covectors are kept in the first-level cache while all columns are written.
const BLOCK: usize = 256;

#[inline(always)]
fn steepest_lanes<V: Lanes>(
    x: &[f32],
    y: &[f32],
    q: &Covectors<'_>,
    columns: &[Column],
    row: usize,
    out: &mut Jacobian,
) {
    let n = x.len();
    let (data, stride) = (&mut out.data, out.stride);
    let mut carried = [[0.0; BLOCK]; 3];
    let mut start = 0;
    while start < n {
        let end = (start + BLOCK).min(n);
        let [r0, r1, r2] = &mut carried;
        let len = end - start;
        let (x, y) = (&x[start..end], &y[start..end]);
        carry::<V>(x, y, q, start, [&mut r0[..len], &mut r1[..len], &mut r2[..len]]);
        let rows = [&r0[..len], &r1[..len], &r2[..len]];
        let mut k = 0;
        while k < columns.len() {
            let at = k * stride + row + start;
            if let Some(r) = whole_row(&columns[k..]) {
                let (first, rest) = data[at..].split_at_mut(stride);
                let (second, third) = rest.split_at_mut(stride);
                let to = [&mut first[..len], &mut second[..len], &mut third[..len]];
                row_columns::<V>(rows[r], [x, y], to);
                k += 3;
                continue;
            }
            let to = &mut data[at..at + len];
            let weights = V::splat_each(columns[k].weights);
            match columns[k].single {
                Some(i) if i % 3 == 0 => product_column::<V>(rows[i / 3], x, weights[i], to),
                Some(i) if i % 3 == 1 => product_column::<V>(rows[i / 3], y, weights[i], to),
                Some(i) => plain_column::<V>(rows[i / 3], weights[i], to),
                None => mixed_column::<V>(rows, [x, y], weights, to),
            }
            k += 1;
        }
        start = end;
    }
}

/// `r` where the next three columns are `q_r x`, `q_r y` and `q_r`.
fn whole_row(columns: &[Column]) -> Option<usize> {
    let first = columns.first()?.single?;
    let plain = |k: usize| columns[k].single == Some(first + k) && columns[k].weights[first + k] == 1.0;
    (first % 3 == 0 && columns.len() >= 3 && (0..3).all(plain)).then_some(first / 3)
}

/// `r x`, `r y` and `r`.
#[inline(always)]
fn row_columns<V: Lanes>(r: &[f32], [x, y]: [&[f32]; 2], [out_x, out_y, out_r]: [&mut [f32]; 3]) {
    let n = r.len();
    let (x, y) = (&x[..n], &y[..n]);
    let (out_x, out_y, out_r) = (&mut out_x[..n], &mut out_y[..n], &mut out_r[..n]);
    let mut i = 0;
    while i < n {
        let v = V::load_at(r, i);
        v.mul(V::load_at(x, i)).store_at(out_x, i);
        v.mul(V::load_at(y, i)).store_at(out_y, i);
        v.store_at(out_r, i);
        i += WIDTH;
    }
}

/// Covectors of the points from `start` on, carried into the base frame.
#[inline(always)]
fn carry<V: Lanes>(x: &[f32], y: &[f32], q: &Covectors<'_>, start: usize, out: [&mut [f32]; 3]) {
    let n = x.len();
    let at = start..start + n;
    let (gx, gy) = (&q.gx[at.clone()], &q.gy[at.clone()]);
    let (px, py) = (&q.px[at.clone()], &q.py[at]);
    let (y, [r0, r1, r2]) = (&y[..n], out.map(|r| &mut r[..n]));
    // `q A` with the frame's unit and the sign of the third component in the matrix.
    let (a, k) = (q.matrix, q.scale);
    let column = |c: usize| [k * a[c], k * a[3 + c], -a[6 + c]];
    let [a0, a1, a2] = [column(0), column(1), column(2)];
    let a = [V::splat_each(a0), V::splat_each(a1), V::splat_each(a2)];
    let (cx, cy) = (V::splat(q.centre[0]), V::splat(q.centre[1]));
    let one = V::splat(1.0);
    // Not `map`: the compiler leaves closures over lanes without the wide instructions.
    #[allow(clippy::manual_map)]
    let denominator = match q.denominator {
        Some(d) => Some(V::splat_each(d)),
        None => None,
    };
    let mut i = 0;
    while i < n {
        let (mut g0, mut g1) = (V::load_at(gx, i), V::load_at(gy, i));
        if let Some(d) = denominator {
            let (xv, yv) = (V::load_at(x, i), V::load_at(y, i));
            let inv = one.div(d[0].mul_add(xv, d[1].mul_add(yv, d[2])));
            (g0, g1) = (g0.mul(inv), g1.mul(inv));
        }
        let dx = V::load_at(px, i).sub(cx);
        let dy = V::load_at(py, i).sub(cy);
        let q = [g0, g1, g0.mul_add(dx, g1.mul(dy))];
        product::<V>(q, a[0]).store_at(r0, i);
        product::<V>(q, a[1]).store_at(r1, i);
        product::<V>(q, a[2]).store_at(r2, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn product<V: Lanes>(q: [V; 3], a: [V; 3]) -> V {
    q[0].mul_add(a[0], q[1].mul_add(a[1], q[2].mul(a[2])))
}

/// `out = weight r x`.
#[inline(always)]
fn product_column<V: Lanes>(r: &[f32], x: &[f32], weight: V, out: &mut [f32]) {
    let n = out.len();
    let (r, x) = (&r[..n], &x[..n]);
    let mut i = 0;
    while i < n {
        V::load_at(r, i)
            .mul(V::load_at(x, i))
            .mul(weight)
            .store_at(out, i);
        i += WIDTH;
    }
}

/// `out = weight r`.
#[inline(always)]
fn plain_column<V: Lanes>(r: &[f32], weight: V, out: &mut [f32]) {
    let n = out.len();
    let r = &r[..n];
    let mut i = 0;
    while i < n {
        V::load_at(r, i).mul(weight).store_at(out, i);
        i += WIDTH;
    }
}

/// `out = Σ_r q_r (w_r0 x + w_r1 y + w_r2)`.
#[inline(always)]
fn mixed_column<V: Lanes>(rows: [&[f32]; 3], [x, y]: [&[f32]; 2], w: [V; 9], out: &mut [f32]) {
    let n = out.len();
    let (x, y, rows) = (&x[..n], &y[..n], rows.map(|r| &r[..n]));
    let mut i = 0;
    while i < n {
        let (xv, yv) = (V::load_at(x, i), V::load_at(y, i));
        let mut sum = V::splat(0.0);
        for k in 0..3 {
            let factor = w[3 * k].mul_add(xv, w[3 * k + 1].mul_add(yv, w[3 * k + 2]));
            sum = V::load_at(rows[k], i).mul_add(factor, sum);
        }
        sum.store_at(out, i);
        i += WIDTH;
    }
}

/// The same for one point in `f64`: `[q_r x_c]` summed with the entries of each `dM/dp_k`.
///
/// `gradient` is per unit of the base frame at the image of `x0` under `m` (see `Covectors` for the general case).
pub fn steepest_reference(
    x0: [f64; 2],
    gradient: [f64; 2],
    m: &crate::geom::Mat3,
    dm: &crate::geom::Mat3,
) -> f64 {
    let h = m * nalgebra::Vector3::new(x0[0], x0[1], 1.0);
    let d = dm * nalgebra::Vector3::new(x0[0], x0[1], 1.0);
    let (u, v) = (h[0] / h[2], h[1] / h[2]);
    (gradient[0] * (d[0] - u * d[2]) + gradient[1] * (d[1] - v * d[2])) / h[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Mat3;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_the_chain_rule_in_f64(
            p in prop::array::uniform8(-0.2f64..0.2),
            e in prop::array::uniform9(-1.0f64..1.0),
            points in prop::collection::vec((-1.2f64..1.2, -1.2f64..1.2, -20f64..20.0, -20f64..20.0), 1..40),
        ) {
            let m = Mat3::new(1.0 + p[0], p[1], p[2], p[3], 1.0 + p[4], p[5], p[6], p[7], 1.0);
            let dm = Mat3::from_row_slice(&e);
            let (centre, scale) = ([320.0, 200.0], 80.0);
            let n = points.len();
            let column = |f: &dyn Fn(&(f64, f64, f64, f64)) -> f64| points.iter().map(|p| f(p) as f32).collect::<Vec<_>>();
            let image = |p: &(f64, f64, f64, f64)| {
                let h = m * nalgebra::Vector3::new(p.0, p.1, 1.0);
                [centre[0] + scale * h[0] / h[2], centre[1] + scale * h[1] / h[2]]
            };
            let (x, y, gx, gy) = (column(&|p| p.0), column(&|p| p.1), column(&|p| p.2), column(&|p| p.3));
            let (px, py) = (column(&|p| image(p)[0]), column(&|p| image(p)[1]));
            let f = |m: &Mat3| std::array::from_fn(|i| m[(i / 3, i % 3)] as f32);
            let q = Covectors {
                gx: &gx, gy: &gy, px: &px, py: &py, centre: centre.map(|c| c as f32), scale: scale as f32,
                matrix: f(&Mat3::identity()), denominator: Some([m[(2, 0)] as f32, m[(2, 1)] as f32, m[(2, 2)] as f32]),
            };
            let columns = [Column::new(e), Column::new([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])];
            let mut j = Jacobian::new(n + 3, 2);
            steepest(&x, &y, &q, &columns, 3, &mut j);
            for (i, p) in points.iter().enumerate() {
                let exact = steepest_reference([p.0, p.1], [p.2 * scale, p.3 * scale], &m, &dm);
                prop_assert!((f64::from(j.col(0)[3 + i]) - exact).abs() < 1e-5 * 1600.0 * 9.0, "{} {exact}", j.col(0)[3 + i]);
            }
            let mut portable = Jacobian::new(n + 3, 2);
            steepest_lanes::<Portable>(&x, &y, &q, &columns, 3, &mut portable);
            prop_assert_eq!(j.col(0), portable.col(0));
            // Pulled back through M, the same gradient gives the compositional column.
            let q = Covectors { matrix: f(&m), ..q };
            steepest(&x, &y, &q, &columns, 3, &mut j);
            for (i, p) in points.iter().enumerate() {
                let compose = m * dm;
                let exact = steepest_reference([p.0, p.1], [p.2 * scale, p.3 * scale], &m, &compose);
                prop_assert!((f64::from(j.col(0)[3 + i]) - exact).abs() < 1e-5 * 1600.0 * 9.0);
            }
        }
    }
}
