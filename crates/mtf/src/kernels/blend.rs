//! Loops of warps that are sums of weighted displacements.

use super::{Lanes, WIDTH, dispatch};

dispatch! {
    /// `out += k w`.
    pub fn accumulate(w: &[f32], k: f32, out: &mut [f32]) = accumulate_lanes;
    /// `out = k out + shift`.
    pub fn scale_shift(k: f32, shift: f32, out: &mut [f32]) = scale_shift_lanes;
    /// `out = k a b`.
    pub fn product(a: &[f32], b: &[f32], k: f32, out: &mut [f32]) = product_lanes;
    /// Row vectors `(gx, gy)` times the 2x2 matrices `k [w0 w1; w2 w3]` of each point, or times `k` and their inverses.
    pub fn row_times(
        gx: &[f32], gy: &[f32], w: [&[f32]; 4], inverse: bool, k: f32, out_x: &mut [f32], out_y: &mut [f32],
    ) = row_times_lanes;
}

#[inline(always)]
fn accumulate_lanes<V: Lanes>(w: &[f32], k: f32, out: &mut [f32]) {
    let n = w.len();
    let (out, k) = (&mut out[..n], V::splat(k));
    let mut i = 0;
    while i < n {
        V::load_at(w, i).mul_add(k, V::load_at(out, i)).store_at(out, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn scale_shift_lanes<V: Lanes>(k: f32, shift: f32, out: &mut [f32]) {
    let (k, shift) = (V::splat(k), V::splat(shift));
    let mut i = 0;
    while i < out.len() {
        V::load_at(out, i).mul_add(k, shift).store_at(out, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn product_lanes<V: Lanes>(a: &[f32], b: &[f32], k: f32, out: &mut [f32]) {
    let n = a.len();
    let (b, out, k) = (&b[..n], &mut out[..n], V::splat(k));
    let mut i = 0;
    while i < n {
        V::load_at(a, i).mul(k).mul(V::load_at(b, i)).store_at(out, i);
        i += WIDTH;
    }
}

#[inline(always)]
fn row_times_lanes<V: Lanes>(
    gx: &[f32],
    gy: &[f32],
    w: [&[f32]; 4],
    inverse: bool,
    k: f32,
    out_x: &mut [f32],
    out_y: &mut [f32],
) {
    let n = gx.len();
    let (gy, out_x, out_y) = (&gy[..n], &mut out_x[..n], &mut out_y[..n]);
    let w = w.map(|w| &w[..n]);
    let (k, zero) = (V::splat(k), V::splat(0.0));
    let mut i = 0;
    while i < n {
        let (x, y) = (V::load_at(gx, i), V::load_at(gy, i));
        let [mut a, mut b, mut c, mut d] = w.map(|w| V::load_at(w, i));
        let mut scale = k;
        if inverse {
            let det = a.mul(d).sub(b.mul(c));
            scale = k.div(det);
            (a, b, c, d) = (d, zero.sub(b), zero.sub(c), a);
        }
        x.mul_add(a, y.mul(c)).mul(scale).store_at(out_x, i);
        x.mul_add(b, y.mul(d)).mul(scale).store_at(out_y, i);
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
        fn agree_with_f64_and_between_instruction_sets(
            v in prop::collection::vec(prop::array::uniform6(-1.0f32..1.0), 1..60), k in 0.1f32..50.0,
        ) {
            let column = |c: usize| v.iter().map(|p| p[c]).collect::<Vec<f32>>();
            let [gx, gy, a, b, c, d] = [0, 1, 2, 3, 4, 5].map(column);
            // Close to the identity, so that the inverse exists.
            let a: Vec<f32> = a.iter().map(|v| 2.0 + 0.5 * v).collect();
            let d: Vec<f32> = d.iter().map(|v| 2.0 + 0.5 * v).collect();
            let n = v.len();
            for inverse in [false, true] {
                let ([mut x, mut y], [mut px, mut py]) = ([vec![0.0; n], vec![0.0; n]], [vec![0.0; n], vec![0.0; n]]);
                row_times(&gx, &gy, [&a, &b, &c, &d], inverse, k, &mut x, &mut y);
                row_times_lanes::<Portable>(&gx, &gy, [&a, &b, &c, &d], inverse, k, &mut px, &mut py);
                prop_assert_eq!((&x, &y), (&px, &py));
                for i in 0..n {
                    let w = nalgebra::Matrix2::new(a[i], b[i], c[i], d[i]).map(f64::from);
                    let w = if inverse { w.try_inverse().unwrap() } else { w };
                    let g = nalgebra::RowVector2::new(f64::from(gx[i]), f64::from(gy[i])) * w * f64::from(k);
                    prop_assert!((g[0] - f64::from(x[i])).abs() < 1e-5 * f64::from(k) * 4.0);
                    prop_assert!((g[1] - f64::from(y[i])).abs() < 1e-5 * f64::from(k) * 4.0);
                }
            }
            let (mut out, mut portable) = (b.clone(), b.clone());
            accumulate(&gx, k, &mut out);
            scale_shift(k, 3.0, &mut out);
            accumulate_lanes::<Portable>(&gx, k, &mut portable);
            scale_shift_lanes::<Portable>(k, 3.0, &mut portable);
            prop_assert_eq!(&out, &portable);
            let (mut both, mut portable) = (vec![0.0; n], vec![0.0; n]);
            product(&gx, &gy, k, &mut both);
            product_lanes::<Portable>(&gx, &gy, k, &mut portable);
            prop_assert_eq!(&both, &portable);
            for i in 0..n {
                let k = f64::from(k);
                let exact = k * (f64::from(b[i]) + k * f64::from(gx[i])) + 3.0;
                prop_assert!((exact - f64::from(out[i])).abs() < 1e-5 * k * k + 1e-5);
                prop_assert!((k * f64::from(gx[i]) * f64::from(gy[i]) - f64::from(both[i])).abs() < 1e-5 * k);
            }
        }
    }
}
