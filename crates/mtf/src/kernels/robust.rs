//! Weights of M-estimators, weighted sums and pixel masks.

use super::{Lanes, WIDTH, dispatch};

dispatch! {
    /// `Σ w_i x_i²`.
    pub fn weighted_squares(w: &[f32], x: &[f32]) -> f64 = squares_lanes;
    /// Huber's weights of `x_i = inverse_scale e_i`: `w_i <- w_i k/max(|x_i|, k)`. Returns `Σ w_i ρ(x_i)` with the weights
    /// as given; `ρ(x) = x²/2` up to `|x| = k`, `k (|x| - k/2)` beyond.
    pub fn huber(e: &[f32], inverse_scale: f32, k: f32, w: &mut [f32]) -> f64 = huber_lanes;
    /// Tukey's biweights of `x_i = inverse_scale e_i`: `w_i <- w_i max(0, 1 - x_i²/c²)²`. Returns `Σ w_i ρ(x_i)` with the
    /// weights as given; `ρ(x) = c²/6 (1 - max(0, 1 - x²/c²)³)`.
    pub fn tukey(e: &[f32], inverse_scale: f32, c: f32, w: &mut [f32]) -> f64 = tukey_lanes;
    /// `out_i <- 0` where not `|x_i - y_i| < limit`.
    pub fn keep_close(x: &[f32], y: &[f32], limit: f32, out: &mut [f32]) = close_lanes;
    /// `out_i <- 1` where `x_i² + y_i² > limit²`.
    pub fn add_steep(x: &[f32], y: &[f32], limit: f32, out: &mut [f32]) = steep_lanes;
}

/// Elements summed in `f32` before the partial sum is widened.
const BLOCK: usize = 32 * WIDTH;

#[inline(always)]
fn blocked<V: Lanes>(n: usize, mut term: impl FnMut(usize, V) -> V) -> f64 {
    let (mut total, mut start) = (0.0, 0);
    while start < n {
        let end = (start + BLOCK).min(n);
        let mut acc = V::splat(0.0);
        for i in (start..end).step_by(WIDTH) {
            acc = term(i, acc);
        }
        total += acc.sum();
        start = end;
    }
    total
}

#[inline(always)]
fn squares_lanes<V: Lanes>(w: &[f32], x: &[f32]) -> f64 {
    let x = &x[..w.len()];
    blocked::<V>(w.len(), |i, acc| {
        let v = V::load_at(x, i);
        V::load_at(w, i).mul(v).mul_add(v, acc)
    })
}

#[inline(always)]
fn huber_lanes<V: Lanes>(e: &[f32], inverse_scale: f32, k: f32, w: &mut [f32]) -> f64 {
    let e = &e[..w.len()];
    let (s, k, half) = (V::splat(inverse_scale), V::splat(k), V::splat(0.5));
    blocked::<V>(w.len(), |i, acc| {
        let (given, x) = (V::load_at(w, i), V::load_at(e, i).mul(s).abs());
        given.mul(k).div(x.max(k)).store_at(w, i);
        let near = x.min(k);
        given.mul(near).mul_add(x.sub(near.mul(half)), acc)
    })
}

#[inline(always)]
fn tukey_lanes<V: Lanes>(e: &[f32], inverse_scale: f32, c: f32, w: &mut [f32]) -> f64 {
    let e = &e[..w.len()];
    let (s, zero, one) = (V::splat(inverse_scale / c), V::splat(0.0), V::splat(1.0));
    let sixth = V::splat(c * c / 6.0);
    blocked::<V>(w.len(), |i, acc| {
        let (given, x) = (V::load_at(w, i), V::load_at(e, i).mul(s));
        let t = one.sub(x.mul(x)).max(zero);
        let weight = t.mul(t);
        given.mul(weight).store_at(w, i);
        given.mul(sixth).mul_add(one.sub(weight.mul(t)), acc)
    })
}

#[inline(always)]
fn close_lanes<V: Lanes>(x: &[f32], y: &[f32], limit: f32, out: &mut [f32]) {
    let n = x.len();
    let (y, out) = (&y[..n], &mut out[..n]);
    for i in (0..n).step_by(WIDTH) {
        let d = V::load_at(x, i).sub(V::load_at(y, i)).abs();
        V::load_at(out, i).mul(d.less(V::splat(limit))).store_at(out, i);
    }
}

#[inline(always)]
fn steep_lanes<V: Lanes>(x: &[f32], y: &[f32], limit: f32, out: &mut [f32]) {
    let n = x.len();
    let (y, out) = (&y[..n], &mut out[..n]);
    for i in (0..n).step_by(WIDTH) {
        let (x, y) = (V::load_at(x, i), V::load_at(y, i));
        let steep = V::splat(limit * limit).less(x.mul_add(x, y.mul(y)));
        V::load_at(out, i).max(steep).store_at(out, i);
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
            v in prop::collection::vec((-50f32..50.0, -50f32..50.0, 0f32..2.0), 1..600), scale in 0.05f32..2.0
        ) {
            let e: Vec<f32> = v.iter().map(|v| v.0).collect();
            let y: Vec<f32> = v.iter().map(|v| v.1).collect();
            let given: Vec<f32> = v.iter().map(|v| v.2).collect();
            let n = v.len() as f64;
            let squares: f64 = v.iter().map(|v| f64::from(v.2) * f64::from(v.0).powi(2)).sum();
            prop_assert!((weighted_squares(&given, &e) - squares).abs() < 1e-6 * squares + 1e-6);
            prop_assert_eq!(weighted_squares(&given, &e), squares_lanes::<Portable>(&given, &e));
            let x = |e: f32| f64::from(e) * f64::from(scale);
            let (mut w, mut p) = (given.clone(), given.clone());
            let loss = huber(&e, scale, 1.345, &mut w);
            prop_assert_eq!(loss, huber_lanes::<Portable>(&e, scale, 1.345, &mut p));
            prop_assert_eq!(&w, &p);
            let mut exact = 0.0;
            for i in 0..e.len() {
                let (x, k, g) = (x(e[i]).abs(), 1.345, f64::from(given[i]));
                exact += g * if x <= k { 0.5 * x * x } else { k * (x - 0.5 * k) };
                prop_assert!((f64::from(w[i]) - g * (k / x).min(1.0)).abs() < 1e-5);
            }
            prop_assert!((loss - exact).abs() < 1e-5 * exact + 1e-6);
            let (mut w, mut p) = (given.clone(), given.clone());
            let loss = tukey(&e, scale, 4.685, &mut w);
            prop_assert_eq!(loss, tukey_lanes::<Portable>(&e, scale, 4.685, &mut p));
            prop_assert_eq!(&w, &p);
            let mut exact = 0.0;
            for i in 0..e.len() {
                let (x, c, g) = (x(e[i]), 4.685, f64::from(given[i]));
                let t = (1.0 - (x / c).powi(2)).max(0.0);
                exact += g * c * c / 6.0 * (1.0 - t.powi(3));
                prop_assert!((f64::from(w[i]) - g * t * t).abs() < 1e-5);
            }
            prop_assert!((loss - exact).abs() < 1e-5 * n);
            let (mut w, mut p) = (given.clone(), given.clone());
            keep_close(&e, &y, 20.0, &mut w);
            close_lanes::<Portable>(&e, &y, 20.0, &mut p);
            prop_assert_eq!(&w, &p);
            add_steep(&e, &y, 30.0, &mut p);
            let mut steep = w.clone();
            steep_lanes::<Portable>(&e, &y, 30.0, &mut steep);
            prop_assert_eq!(&steep, &p);
            for i in 0..e.len() {
                let close = (e[i] - y[i]).abs() < 20.0;
                prop_assert_eq!(w[i], if close { given[i] } else { 0.0 });
                let far = e[i].mul_add(e[i], y[i] * y[i]) > 900.0;
                prop_assert_eq!(steep[i], if far { w[i].max(1.0) } else { w[i] });
            }
        }
    }
}
