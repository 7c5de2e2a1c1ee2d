//! Patches of mean zero and deviation one: what the correlation models share. Depends on `kernels` alone.

use crate::kernels;

/// Patches whose standard deviation is below this are flat: they standardise to zero.
pub(super) const FLAT: f64 = 1e-6;

/// Writes `(x - mean) / deviation` to `out`, zero for a flat patch; returns mean and `1 / deviation` (0 when flat).
pub(super) fn standardise(x: &[f32], out: &mut [f32]) -> (f64, f64) {
    let n = x.len() as f64;
    let mean = kernels::sum(x) / n;
    let deviation = (kernels::rescale(x, mean as f32, 1.0, out) / n).sqrt();
    let inverse = if deviation >= FLAT { 1.0 / deviation } else { 0.0 };
    kernels::rescale(x, mean as f32, inverse as f32, out);
    (mean, inverse)
}

/// A template to correlate many patches with, when only the correlation is wanted: one pass over each.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Correlator {
    mean: f32,
    /// Sum of the standardised template: zero but for rounding, which the distance of the means multiplies.
    sum: f64,
}

impl Correlator {
    /// For the standardised `template`, which had this mean.
    pub fn new(mean: f64, template: &[f32]) -> Self {
        Correlator {
            mean: mean as f32,
            sum: kernels::sum(template),
        }
    }

    /// Correlation coefficient of the patch and the template, and `1/σ` of the patch. None where the patch
    /// is so flat, or so much brighter or darker than the template, that sums about the template's mean are too inexact.
    pub fn correlate(self, template: &[f32], patch: &[f32]) -> Option<(f64, f64)> {
        let n = patch.len() as f64;
        let [sum, squares, product] = kernels::moments(patch, self.mean, template);
        let shift = sum / n;
        let variance = squares / n - shift * shift;
        let exact = variance > 0.1 * shift * shift && variance > FLAT * FLAT;
        exact.then(|| {
            let inverse = 1.0 / variance.sqrt();
            ((product - shift * self.sum) / n * inverse, inverse)
        })
    }
}
