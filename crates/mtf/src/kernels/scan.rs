//! One block of a template correlated with an image at every place along a line.

use super::{Lanes, WIDTH, dispatch};

/// Elements of the plane that [`correlate_along`] reads past the last place, beyond the largest offset.
pub const SCAN_SLACK: usize = 2 * WIDTH;
/// Least standard deviation of intensity that counts as contrast.
const CONTRAST: f32 = 0.5;

dispatch! {
    /// Adds `max(0, z)³` to `out[i]`, for the correlation `z` of `values` with `plane[i + offsets[k]]` over all `k`. The
    /// values have mean 0 and sum of squares 1; the plane has [`SCAN_SLACK`] elements more than the largest index.
    pub fn correlate_along(plane: &[f32], offsets: &[usize], values: &[f32], out: &mut [f32]) = correlate_lanes;
}

/// `max(0, z)³` from `[Σ t y, Σ y, Σ y²]`.
#[inline(always)]
fn cubed<V: Lanes>([product, sum, squares]: [V; 3], share: V, least: V) -> V {
    let spread = squares.sub(sum.mul(sum).mul(share)).max(least);
    let z = product.div(spread.sqrt()).max(V::splat(0.0));
    z.mul(z).mul(z)
}

/// Adds a value of the image, times that of the template, to the sums.
#[inline(always)]
fn take<V: Lanes>(sums: &mut [V; 3], y: V, value: V) {
    sums[0] = y.mul_add(value, sums[0]);
    sums[1] = sums[1].add(y);
    sums[2] = y.mul_add(y, sums[2]);
}

#[inline(always)]
fn correlate_lanes<V: Lanes>(plane: &[f32], offsets: &[usize], values: &[f32], out: &mut [f32]) {
    let n = values.len() as f32;
    let (share, least) = (V::splat(1.0 / n), V::splat(n * CONTRAST * CONTRAST));
    // Two groups of places at a time hide the latency of the sums.
    for i in (0..out.len()).step_by(2 * WIDTH) {
        let at = &plane[i..];
        let (mut first, mut second) = ([V::splat(0.0); 3], [V::splat(0.0); 3]);
        for (&offset, &value) in offsets.iter().zip(values) {
            let pixels = &at[offset..offset + 2 * WIDTH];
            let value = V::splat(value);
            take(&mut first, V::load(&pixels[..WIDTH]), value);
            take(&mut second, V::load(&pixels[WIDTH..]), value);
        }
        V::load_at(out, i)
            .add(cubed(first, share, least))
            .store_at(out, i);
        if i + WIDTH < out.len() {
            let i = i + WIDTH;
            V::load_at(out, i)
                .add(cubed(second, share, least))
                .store_at(out, i);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Portable;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_f64(plane in prop::collection::vec(-128f32..128.0, 140), values in prop::collection::vec(-1f32..1.0, 4..20), n in 1usize..40) {
            let mean = values.iter().sum::<f32>() / values.len() as f32;
            let norm = values.iter().map(|v| (v - mean).powi(2)).sum::<f32>().sqrt().max(1e-3);
            let values: Vec<f32> = values.iter().map(|v| (v - mean) / norm).collect();
            let offsets: Vec<usize> = (0..values.len()).map(|k| k * 7 % 61).collect();
            let (mut out, mut portable) = (vec![0.5; n], vec![0.5; n]);
            correlate_along(&plane, &offsets, &values, &mut out);
            correlate_lanes::<Portable>(&plane, &offsets, &values, &mut portable);
            prop_assert_eq!(&out, &portable);
            for (i, got) in out.iter().enumerate() {
                let y: Vec<f64> = offsets.iter().map(|o| f64::from(plane[i + o])).collect();
                let mean = y.iter().sum::<f64>() / y.len() as f64;
                let spread = y.iter().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
                let product: f64 = y.iter().zip(&values).map(|(y, t)| (y - mean) * f64::from(*t)).sum();
                let z = (product / spread).max(0.0);
                prop_assert!((f64::from(*got) - 0.5 - z.powi(3)).abs() < 1e-3, "{} {}", got, z);
            }
        }
    }
}
