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

/// Column of a Jacobian as a sparse combination of the nine products `q_r x_c` (index `3 r + c`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Column {
    len: usize,
    index: [usize; 9],
    weight: [f32; 9],
}

impl Column {
    /// From the nine entries of `dM/dp_k`, row-major; zeros are left out.
    pub fn new(entries: [f64; 9]) -> Self {
        let mut c = Column::default();
        for (i, &e) in entries.iter().enumerate().filter(|(_, e)| **e != 0.0) {
            c.index[c.len] = i;
            c.weight[c.len] = e as f32;
            c.len += 1;
        }
        c
    }
}

dispatch! {
    /// Writes the columns for points `(x, y)` of the base frame into rows `row..row + x.len()` of `out`.
    pub fn steepest(
        x: &[f32], y: &[f32], q: &Covectors<'_>, columns: &[Column], row: usize, out: &mut Jacobian,
    ) = steepest_lanes;
}

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
    let (y, gx, gy, px, py) = (&y[..n], &q.gx[..n], &q.gy[..n], &q.px[..n], &q.py[..n]);
    let a = q.matrix.map(V::splat);
    let (cx, cy, scale) = (V::splat(q.centre[0]), V::splat(q.centre[1]), V::splat(q.scale));
    let one = V::splat(1.0);
    let zero = V::splat(0.0);
    let denominator = q.denominator.map(|d| d.map(V::splat));
    let (data, stride) = out.data_mut();
    let mut i = 0;
    while i < n {
        let (xv, yv) = (V::load_at(x, i), V::load_at(y, i));
        let (g0, g1) = (V::load_at(gx, i), V::load_at(gy, i));
        let dx = V::load_at(px, i).sub(cx);
        let dy = V::load_at(py, i).sub(cy);
        let mut q0 = g0.mul(scale);
        let mut q1 = g1.mul(scale);
        let mut q2 = zero.sub(g0.mul_add(dx, g1.mul(dy)));
        if let Some(d) = denominator {
            let inv = one.div(d[0].mul_add(xv, d[1].mul_add(yv, d[2])));
            (q0, q1, q2) = (q0.mul(inv), q1.mul(inv), q2.mul(inv));
        }
        let r0 = q0.mul_add(a[0], q1.mul_add(a[3], q2.mul(a[6])));
        let r1 = q0.mul_add(a[1], q1.mul_add(a[4], q2.mul(a[7])));
        let r2 = q0.mul_add(a[2], q1.mul_add(a[5], q2.mul(a[8])));
        let products = [
            r0.mul(xv),
            r0.mul(yv),
            r0,
            r1.mul(xv),
            r1.mul(yv),
            r1,
            r2.mul(xv),
            r2.mul(yv),
            r2,
        ];
        for (k, column) in columns.iter().enumerate() {
            let value = if column.len == 1 && column.weight[0] == 1.0 {
                products[column.index[0]]
            } else {
                let mut v = zero;
                for t in 0..column.len {
                    v = products[column.index[t]].mul_add(V::splat(column.weight[t]), v);
                }
                v
            };
            let at = k * stride + row + i;
            value.store_at(&mut data[at..at + WIDTH.min(n - i)], 0);
        }
        i += WIDTH;
    }
}

/// The same for one point in `f64`: `[q_r x_c]` summed with the entries of each `dM/dp_k`.
///
/// `gradient` is per unit of the base frame at the image of `x0` under `m` (see [`Covectors`] for the general case).
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
