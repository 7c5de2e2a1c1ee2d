//! Element-wise terms of the pixelwise similarity measures (SAD, SPSS, RIU).

use super::{Lanes, WIDTH, dispatch};

dispatch! {
    /// `Σ |x_i - y_i|`, or any larger number than `bound` as soon as the sum exceeds it.
    pub fn absolute_distance(x: &[f32], y: &[f32], bound: f64) -> f64 = absolute_lanes;
    /// `out_i = (a + b x_i) y_i`.
    pub fn affine_product(a: f32, b: f32, x: &[f32], y: &[f32], out: &mut [f32]) = affine_product_lanes;
    /// `out_i = 1 / (shift + x_i)`.
    pub fn reciprocal(shift: f32, x: &[f32], out: &mut [f32]) = reciprocal_lanes;
    /// `out_i = (x_i - y_i) w_i`; returns `Σ out_i`.
    pub fn weighted_difference(x: &[f32], y: &[f32], w: &[f32], out: &mut [f32]) -> f64 = difference_lanes;
    /// Variance over mean of `(kappa + x_i) / (kappa + y_i)`.
    pub fn ratio_variation(x: &[f32], y: &[f32], kappa: f32) -> f64 = ratio_lanes;
    /// `out_i = (x_i - y_i)² / (x_i² + y_i² + c)`: one minus the structural similarity of single pixels; returns `Σ out_i`.
    pub fn spss_losses(x: &[f32], y: &[f32], c: f32, out: &mut [f32]) -> f64 = losses_lanes;
    /// `Σ (x_i - y_i)² / (x_i² + y_i² + c)`, or any larger number than `bound` as soon as the sum exceeds it.
    pub fn spss_distance(x: &[f32], y: &[f32], c: f32, bound: f32) -> f32 = spss_distance_lanes;
    /// Derivative with respect to `x_i` of `(2 x_i y_i + c) / (x_i² + y_i² + c)`, whose loss is `loss_i`.
    pub fn spss_gradient(x: &[f32], y: &[f32], loss: &[f32], c: f32, out: &mut [f32]) = gradient_lanes;
    /// Second derivative with respect to `x_i` of the same.
    pub fn spss_curvature(x: &[f32], y: &[f32], loss: &[f32], c: f32, out: &mut [f32]) = curvature_lanes;
    /// `out_i = -2 / (2 x_i² + c)`: the second derivative at `y = x`.
    pub fn spss_self(x: &[f32], c: f32, out: &mut [f32]) = self_lanes;
}

/// Elements between checks of the bound, and between widenings of partial sums.
const BLOCK: usize = 32 * WIDTH;

#[inline(always)]
fn absolute_lanes<V: Lanes>(x: &[f32], y: &[f32], bound: f64) -> f64 {
    let y = &y[..x.len()];
    let (mut total, mut start) = (0.0, 0);
    while start < x.len() && total <= bound {
        let end = (start + BLOCK).min(x.len());
        let mut acc = V::splat(0.0);
        let mut i = start;
        while i < end {
            acc = acc.add(V::load_at(x, i).sub(V::load_at(y, i)).abs());
            i += WIDTH;
        }
        total += acc.sum();
        start = end;
    }
    total
}

#[inline(always)]
fn affine_product_lanes<V: Lanes>(a: f32, b: f32, x: &[f32], y: &[f32], out: &mut [f32]) {
    let (y, out) = (&y[..x.len()], &mut out[..x.len()]);
    let (a, b) = (V::splat(a), V::splat(b));
    for i in (0..x.len()).step_by(WIDTH) {
        let v = V::load_at(x, i).mul_add(b, a).mul(V::load_at(y, i));
        v.store_at(out, i);
    }
}

#[inline(always)]
fn reciprocal_lanes<V: Lanes>(shift: f32, x: &[f32], out: &mut [f32]) {
    let out = &mut out[..x.len()];
    for i in (0..x.len()).step_by(WIDTH) {
        let v = V::splat(1.0).div(V::load_at(x, i).add(V::splat(shift)));
        v.store_at(out, i);
    }
}

#[inline(always)]
fn difference_lanes<V: Lanes>(x: &[f32], y: &[f32], w: &[f32], out: &mut [f32]) -> f64 {
    let n = x.len();
    let (y, w, out) = (&y[..n], &w[..n], &mut out[..n]);
    let (mut total, mut start) = (0.0, 0);
    while start < n {
        let end = (start + BLOCK).min(n);
        let mut acc = V::splat(0.0);
        for i in (start..end).step_by(WIDTH) {
            let v = V::load_at(x, i).sub(V::load_at(y, i)).mul(V::load_at(w, i));
            v.store_at(out, i);
            acc = acc.add(v);
        }
        total += acc.sum();
        start = end;
    }
    total
}

#[inline(always)]
fn ratio_lanes<V: Lanes>(x: &[f32], y: &[f32], kappa: f32) -> f64 {
    let y = &y[..x.len()];
    let (mut sum, mut squares, mut start) = (0.0, 0.0, 0);
    while start < x.len() {
        let end = (start + BLOCK).min(x.len());
        let mut acc = [V::splat(0.0); 2];
        for i in (start..end).step_by(WIDTH) {
            // The ratio less one, whose squares lose no digits when it is nearly constant one.
            let (a, b) = (V::load_at(x, i), V::load_at(y, i));
            let v = a.sub(b).div(b.add(V::splat(kappa)));
            acc[0] = acc[0].add(v);
            acc[1] = v.mul_add(v, acc[1]);
        }
        sum += acc[0].sum();
        squares += acc[1].sum();
        start = end;
    }
    let n = x.len() as f64;
    let shift = sum / n;
    (squares / n - shift * shift).max(0.0) / (1.0 + shift)
}

/// `x² + y² + c`.
#[inline(always)]
fn denominator<V: Lanes>(x: V, y: V, c: V) -> V {
    x.mul_add(x, y.mul_add(y, c))
}

#[inline(always)]
fn losses_lanes<V: Lanes>(x: &[f32], y: &[f32], c: f32, out: &mut [f32]) -> f64 {
    let n = x.len();
    let (y, out) = (&y[..n], &mut out[..n]);
    let (mut total, mut start) = (0.0, 0);
    while start < n {
        let end = (start + BLOCK).min(n);
        let mut acc = V::splat(0.0);
        for i in (start..end).step_by(WIDTH) {
            let (a, b) = (V::load_at(x, i), V::load_at(y, i));
            let d = a.sub(b);
            let v = d.mul(d).div(denominator(a, b, V::splat(c)));
            v.store_at(out, i);
            acc = acc.add(v);
        }
        total += acc.sum();
        start = end;
    }
    total
}

#[inline(always)]
fn spss_distance_lanes<V: Lanes>(x: &[f32], y: &[f32], c: f32, bound: f32) -> f32 {
    let y = &y[..x.len()];
    let (mut total, mut start) = (0.0, 0);
    while start < x.len() && total <= bound {
        let end = (start + BLOCK).min(x.len());
        let mut acc = V::splat(0.0);
        for i in (start..end).step_by(WIDTH) {
            let (a, b) = (V::load_at(x, i), V::load_at(y, i));
            let d = a.sub(b);
            acc = acc.add(d.mul(d).div(denominator(a, b, V::splat(c))));
        }
        total += acc.sum() as f32;
        start = end;
    }
    total
}

/// Derivative and `2 / (x² + y² + c)`. With f = 1 - loss, `y - f x` is written without the cancellation of nearly
/// equal numbers.
#[inline(always)]
fn slope<V: Lanes>(x: V, y: V, loss: V, c: V) -> (V, V) {
    let inverse = V::splat(2.0).div(denominator(x, y, c));
    (loss.mul_add(x, y.sub(x)).mul(inverse), inverse)
}

#[inline(always)]
fn gradient_lanes<V: Lanes>(x: &[f32], y: &[f32], loss: &[f32], c: f32, out: &mut [f32]) {
    let n = x.len();
    let (y, loss, out) = (&y[..n], &loss[..n], &mut out[..n]);
    for i in (0..n).step_by(WIDTH) {
        let (a, b, w) = (V::load_at(x, i), V::load_at(y, i), V::load_at(loss, i));
        slope(a, b, w, V::splat(c)).0.store_at(out, i);
    }
}

#[inline(always)]
fn curvature_lanes<V: Lanes>(x: &[f32], y: &[f32], loss: &[f32], c: f32, out: &mut [f32]) {
    let n = x.len();
    let (y, loss, out) = (&y[..n], &loss[..n], &mut out[..n]);
    let (one, two) = (V::splat(1.0), V::splat(2.0));
    for i in (0..n).step_by(WIDTH) {
        let (a, b, w) = (V::load_at(x, i), V::load_at(y, i), V::load_at(loss, i));
        let (g, inverse) = slope(a, b, w, V::splat(c));
        let h = a.mul(g).mul_add(two, one.sub(w)).mul(inverse);
        V::splat(0.0).sub(h).store_at(out, i);
    }
}

#[inline(always)]
fn self_lanes<V: Lanes>(x: &[f32], c: f32, out: &mut [f32]) {
    let out = &mut out[..x.len()];
    for i in (0..x.len()).step_by(WIDTH) {
        let a = V::load_at(x, i);
        let d = a.mul(V::splat(2.0)).mul_add(a, V::splat(c));
        V::splat(-2.0).div(d).store_at(out, i);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agree_with_f64_loops_and_between_instruction_sets(
            v in prop::collection::vec((0f32..255.0, 0f32..255.0, 0.01f32..1.0), 1..700)
        ) {
            let n = v.len();
            let (x, y, w): (Vec<f32>, Vec<f32>, Vec<f32>) =
                (v.iter().map(|v| v.0).collect(), v.iter().map(|v| v.1).collect(), v.iter().map(|v| v.2).collect());
            let wide: Vec<[f64; 3]> = v.iter().map(|v| [v.0.into(), v.1.into(), v.2.into()]).collect();
            let near = |a: f64, b: f64, scale: f64| (a - b).abs() <= 1e-5 * scale.abs() + 1e-9;
            let sad: f64 = wide.iter().map(|[x, y, _]| (x - y).abs()).sum();
            prop_assert!(near(absolute_distance(&x, &y, f64::INFINITY), sad, sad));
            prop_assert!(absolute_distance(&x, &y, 1.0) <= sad * 1.00001);
            prop_assert_eq!(
                absolute_distance(&x, &y, f64::INFINITY), absolute_lanes::<Portable>(&x, &y, f64::INFINITY)
            );
            let (mut a, mut b, mut c, mut d) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
            affine_product(0.5, -2.0, &x, &w, &mut a);
            affine_product_lanes::<Portable>(0.5, -2.0, &x, &w, &mut b);
            prop_assert_eq!(&a, &b);
            reciprocal(31.0, &x, &mut c);
            reciprocal_lanes::<Portable>(31.0, &x, &mut b);
            prop_assert_eq!(&c, &b);
            for (i, [x, _, w]) in wide.iter().enumerate() {
                prop_assert!(near(a[i].into(), (0.5 - 2.0 * x) * w, 1.0 + 2.0 * x));
                prop_assert!(near(c[i].into(), 1.0 / (31.0 + x), 1.0 / (31.0 + x)));
            }
            let total = weighted_difference(&x, &y, &w, &mut a);
            prop_assert_eq!(total, difference_lanes::<Portable>(&x, &y, &w, &mut b));
            prop_assert_eq!(&a, &b);
            prop_assert!(near(total, wide.iter().map(|[x, y, w]| (x - y) * w).sum(), 255.0 * n as f64));

            let ratio: Vec<f64> = wide.iter().map(|[x, y, _]| (31.0 + x) / (31.0 + y)).collect();
            let mean = ratio.iter().sum::<f64>() / n as f64;
            let variation = ratio.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / n as f64 / mean;
            prop_assert!(near(ratio_variation(&x, &y, 31.0), variation, 1.0 + variation));
            prop_assert_eq!(ratio_variation(&x, &y, 31.0), ratio_lanes::<Portable>(&x, &y, 31.0));

            let k = 6.5025;
            let mut loss = vec![0.0; n];
            let total = spss_losses(&x, &y, k, &mut loss);
            prop_assert_eq!(total, losses_lanes::<Portable>(&x, &y, k, &mut b));
            prop_assert_eq!(&loss, &b);
            let k64 = f64::from(k);
            prop_assert!(near(total, wide.iter().map(|[x, y, _]| (x - y).powi(2) / (x * x + y * y + k64)).sum(), total));
            prop_assert!(near(spss_distance(&x, &y, k, f32::INFINITY).into(), total, total));
            prop_assert!(f64::from(spss_distance(&x, &y, k, 0.01)) <= total * 1.00001);
            spss_gradient(&x, &y, &loss, k, &mut a);
            gradient_lanes::<Portable>(&x, &y, &loss, k, &mut b);
            spss_curvature(&x, &y, &loss, k, &mut c);
            curvature_lanes::<Portable>(&x, &y, &loss, k, &mut d);
            prop_assert_eq!((&a, &c), (&b, &d));
            spss_self(&x, k, &mut b);
            self_lanes::<Portable>(&x, k, &mut d);
            prop_assert_eq!(&b, &d);
            for (i, &[x, y, _]) in wide.iter().enumerate() {
                let dn = x * x + y * y + k64;
                let f = (2.0 * x * y + k64) / dn;
                let g = 2.0 * (y - f * x) / dn;
                prop_assert!(near(a[i].into(), g, 2.0 * (x + y) / dn));
                prop_assert!(near(c[i].into(), -2.0 * (f + 2.0 * x * g) / dn, 4.0 / dn));
                prop_assert!(near(b[i].into(), -2.0 / (2.0 * x * x + k64), 1.0 / k64));
            }
        }
    }
}
