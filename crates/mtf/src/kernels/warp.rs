//! Projecting the sampling grid into the image.

use super::{Lanes, WIDTH, dispatch};

dispatch! {
    /// Image points of grid points `(gx, gy)` under the 3x3 matrix `m` (row-major, acting on the base frame), mapped
    /// to pixels by `image = centre + scale * frame`:
    /// `out = centre + scale * ((m0 x + m1 y + m2) / D, (m3 x + m4 y + m5) / D)`, `D = m6 x + m7 y + m8`.
    pub fn warp_projective(
        m: &[f32; 9], centre: [f32; 2], scale: f32, gx: &[f32], gy: &[f32], out_x: &mut [f32], out_y: &mut [f32],
    ) = warp_lanes;
    /// Images under the 3x3 matrix `m` of the regular grid over the unit square around the origin, row by row:
    /// point `(i, k)` of `cols x rows` is that of `(i/(cols-1) - ½, k/(rows-1) - ½)`; 0 where there is one only.
    pub fn regular_grid(m: &[f32; 9], cols: usize, rows: usize, out_x: &mut [f32], out_y: &mut [f32]) = grid_lanes;
}

#[inline(always)]
fn grid_lanes<V: Lanes>(m: &[f32; 9], cols: usize, rows: usize, out_x: &mut [f32], out_y: &mut [f32]) {
    let m = V::splat_each(*m);
    let ramp = V::from_array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    let last = V::splat((cols.max(2) - 1) as f32);
    let middle = V::splat(if cols > 1 { 0.5 } else { 0.0 });
    let out = out_x.chunks_exact_mut(cols).zip(out_y.chunks_exact_mut(cols));
    for (k, (out_x, out_y)) in out.enumerate().take(rows) {
        let y = V::splat(if rows > 1 {
            k as f32 / (rows - 1) as f32 - 0.5
        } else {
            0.0
        });
        let mut i = 0;
        while i < cols {
            let x = ramp.add(V::splat(i as f32)).div(last).sub(middle);
            let u = m[0].mul_add(x, m[1].mul_add(y, m[2]));
            let v = m[3].mul_add(x, m[4].mul_add(y, m[5]));
            let d = m[6].mul_add(x, m[7].mul_add(y, m[8]));
            u.div(d).store_at(out_x, i);
            v.div(d).store_at(out_y, i);
            i += WIDTH;
        }
    }
}

#[inline(always)]
fn warp_lanes<V: Lanes>(
    m: &[f32; 9],
    centre: [f32; 2],
    scale: f32,
    gx: &[f32],
    gy: &[f32],
    out_x: &mut [f32],
    out_y: &mut [f32],
) {
    let n = gx.len();
    let (gy, out_x, out_y) = (&gy[..n], &mut out_x[..n], &mut out_y[..n]);
    let mv = V::splat_each(*m);
    let (cx, cy) = (V::splat(centre[0]), V::splat(centre[1]));
    let s = V::splat(scale);
    let affine = m[6] == 0.0 && m[7] == 0.0 && m[8] == 1.0;
    let mut i = 0;
    while i < n {
        let (x, y) = (V::load_at(gx, i), V::load_at(gy, i));
        let mut u = mv[0].mul_add(x, mv[1].mul_add(y, mv[2]));
        let mut v = mv[3].mul_add(x, mv[4].mul_add(y, mv[5]));
        let mut k = s;
        if !affine {
            k = s.div(mv[6].mul_add(x, mv[7].mul_add(y, mv[8])));
        }
        u = u.mul_add(k, cx);
        v = v.mul_add(k, cy);
        u.store_at(out_x, i);
        v.store_at(out_y, i);
        i += WIDTH;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn grids_agree_with_f64(cols in 1usize..30, rows in 1usize..6, m in prop::array::uniform8(-0.2f64..0.2)) {
            let m = [1.0 + m[0], m[1], m[2], m[3], 1.0 + m[4], m[5], m[6], m[7], 1.0];
            let mf = m.map(|v| v as f32);
            let new = || (vec![0.0; cols * rows], vec![0.0; cols * rows]);
            let ((mut x, mut y), (mut px, mut py)) = (new(), new());
            regular_grid(&mf, cols, rows, &mut x, &mut y);
            let step = |i: usize, n: usize| if n > 1 { i as f64 / (n - 1) as f64 - 0.5 } else { 0.0 };
            for i in 0..cols * rows {
                let (u, v) = (step(i % cols, cols), step(i / cols, rows));
                let d = m[6] * u + m[7] * v + m[8];
                prop_assert!((f64::from(x[i]) - (m[0] * u + m[1] * v + m[2]) / d).abs() < 1e-6);
                prop_assert!((f64::from(y[i]) - (m[3] * u + m[4] * v + m[5]) / d).abs() < 1e-6);
            }
            grid_lanes::<Portable>(&mf, cols, rows, &mut px, &mut py);
            prop_assert_eq!((x, y), (px, py));
        }

        #[test]
        fn agrees_with_f64(
            m in prop::array::uniform8(-0.2f64..0.2),
            points in prop::collection::vec((-1.2f64..1.2, -1.2f64..1.2), 1..40),
        ) {
            let m = [1.0 + m[0], m[1], m[2], m[3], 1.0 + m[4], m[5], m[6], m[7], 1.0];
            let mf = m.map(|v| v as f32);
            let gx: Vec<f32> = points.iter().map(|p| p.0 as f32).collect();
            let gy: Vec<f32> = points.iter().map(|p| p.1 as f32).collect();
            let n = gx.len();
            let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
            warp_projective(&mf, [320.5, 240.25], 90.0, &gx, &gy, &mut x, &mut y);
            for (i, p) in points.iter().enumerate() {
                let d = m[6] * p.0 + m[7] * p.1 + m[8];
                let u = 320.5 + 90.0 * (m[0] * p.0 + m[1] * p.1 + m[2]) / d;
                let v = 240.25 + 90.0 * (m[3] * p.0 + m[4] * p.1 + m[5]) / d;
                prop_assert!((f64::from(x[i]) - u).abs() < 2e-4 && (f64::from(y[i]) - v).abs() < 2e-4);
            }
            let (mut px, mut py) = (vec![0.0; n], vec![0.0; n]);
            warp_lanes::<Portable>(&mf, [320.5, 240.25], 90.0, &gx, &gy, &mut px, &mut py);
            prop_assert_eq!((x, y), (px, py));
        }
    }
}
