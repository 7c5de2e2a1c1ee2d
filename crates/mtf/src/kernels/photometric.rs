//! Gain and bias fields over patches.

use super::{Lanes, WIDTH, dispatch};

dispatch! {
    /// `out_i = gain_i x_i + bias_i`.
    pub fn light(x: &[f32], gain: &[f32], bias: &[f32], out: &mut [f32]) = light_lanes;
    /// `out_i = (x_i - bias_i) / gain_i`.
    pub fn unlight(x: &[f32], gain: &[f32], bias: &[f32], out: &mut [f32]) = unlight_lanes;
    /// `out_i <- k_i out_i`.
    pub fn multiply(k: &[f32], out: &mut [f32]) = multiply_lanes;
}

#[inline(always)]
fn light_lanes<V: Lanes>(x: &[f32], gain: &[f32], bias: &[f32], out: &mut [f32]) {
    let n = x.len();
    let (gain, bias, out) = (&gain[..n], &bias[..n], &mut out[..n]);
    for i in (0..n).step_by(WIDTH) {
        V::load_at(x, i)
            .mul_add(V::load_at(gain, i), V::load_at(bias, i))
            .store_at(out, i);
    }
}

#[inline(always)]
fn unlight_lanes<V: Lanes>(x: &[f32], gain: &[f32], bias: &[f32], out: &mut [f32]) {
    let n = x.len();
    let (gain, bias, out) = (&gain[..n], &bias[..n], &mut out[..n]);
    for i in (0..n).step_by(WIDTH) {
        let v = V::load_at(x, i).sub(V::load_at(bias, i));
        v.div(V::load_at(gain, i)).store_at(out, i);
    }
}

#[inline(always)]
fn multiply_lanes<V: Lanes>(k: &[f32], out: &mut [f32]) {
    let n = k.len();
    let out = &mut out[..n];
    for i in (0..n).step_by(WIDTH) {
        V::load_at(k, i).mul(V::load_at(out, i)).store_at(out, i);
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
            v in prop::collection::vec((0f32..255.0, 0.05f32..2.0, -80f32..80.0), 1..300)
        ) {
            let (x, rest): (Vec<f32>, Vec<(f32, f32)>) = v.iter().map(|&(x, g, b)| (x, (g, b))).unzip();
            let (gain, bias): (Vec<f32>, Vec<f32>) = rest.into_iter().unzip();
            let (mut a, mut b) = (vec![0.0; x.len()], vec![0.0; x.len()]);
            light(&x, &gain, &bias, &mut a);
            light_lanes::<Portable>(&x, &gain, &bias, &mut b);
            prop_assert_eq!(&a, &b);
            for (i, &(x, g, b)) in v.iter().enumerate() {
                let exact = f64::from(g) * f64::from(x) + f64::from(b);
                prop_assert!((f64::from(a[i]) - exact).abs() < 1e-4);
            }
            unlight(&a, &gain, &bias, &mut b);
            let mut portable = vec![0.0; x.len()];
            unlight_lanes::<Portable>(&a, &gain, &bias, &mut portable);
            prop_assert_eq!(&b, &portable);
            for i in 0..x.len() {
                prop_assert!((b[i] - x[i]).abs() < 1e-3);
            }
            let before = b.clone();
            multiply(&gain, &mut b);
            multiply_lanes::<Portable>(&gain, &mut portable);
            prop_assert_eq!(&b, &portable);
            for i in 0..x.len() {
                prop_assert!((b[i] - before[i] * gain[i]).abs() < 1e-3);
            }
        }
    }
}
