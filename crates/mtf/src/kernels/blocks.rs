//! Moments of two images over blocks of their points.

use super::{Lanes, WIDTH, dispatch};

dispatch! {
    /// `[Σ y, Σ y², Σ x y]` over each block of points; block `b` ends before point `ends[b]`, where the next one begins.
    pub fn block_moments(x: &[f32], y: &[f32], ends: &[usize], out: &mut [[f64; 3]]) = moments_lanes;
}

#[inline(always)]
fn moments_lanes<V: Lanes>(x: &[f32], y: &[f32], ends: &[usize], out: &mut [[f64; 3]]) {
    let mut first = 0;
    for (&last, out) in ends.iter().zip(out) {
        let (x, y) = (&x[first..last], &y[first..last]);
        let mut acc = [V::splat(0.0); 3];
        for i in (0..x.len()).step_by(WIDTH) {
            let (a, b) = (V::load_at(x, i), V::load_at(y, i));
            acc[0] = acc[0].add(b);
            acc[1] = b.mul_add(b, acc[1]);
            acc[2] = a.mul_add(b, acc[2]);
        }
        *out = acc.map(V::sum);
        first = last;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_f64(v in prop::collection::vec((0f32..255.0, 0f32..255.0), 1..200), cut in 0usize..200) {
            let (x, y): (Vec<f32>, Vec<f32>) = v.iter().copied().unzip();
            let ends = [cut.min(v.len()), v.len()];
            let (mut out, mut portable) = ([[0.0; 3]; 2], [[0.0; 3]; 2]);
            block_moments(&x, &y, &ends, &mut out);
            moments_lanes::<Portable>(&x, &y, &ends, &mut portable);
            prop_assert_eq!(out, portable);
            for (block, got) in [&v[..ends[0]], &v[ends[0]..]].into_iter().zip(out) {
                let wide = block.iter().map(|p| (f64::from(p.0), f64::from(p.1)));
                let want = wide.fold([0.0; 3], |s, (a, b)| [s[0] + b, s[1] + b * b, s[2] + a * b]);
                for k in 0..3 {
                    prop_assert!((got[k] - want[k]).abs() <= 1e-5 * want[k].max(1.0));
                }
            }
        }
    }
}
