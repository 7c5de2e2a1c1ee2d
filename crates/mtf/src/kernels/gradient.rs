//! Magnitude of the image gradient by separable kernels.

use super::pad::padded_stride;

/// Row `y` of a padded plane as `sqrt(gx² + gy²)`: `gx` is smoothed by `smooth` along columns and differenced by `slope` along
/// rows, `gy` the other way round. Both have the same odd number of taps, `2 radius + 1`. `lines`: two lines as long as those
/// of the padded plane; `out`: the pixels of a row.
pub fn gradient_row(
    padded: &[f32],
    y: usize,
    smooth: &[f32],
    slope: &[f32],
    lines: &mut [f32],
    out: &mut [f32],
) {
    let (width, taps) = (out.len(), smooth.len());
    let stride = padded_stride(width, taps / 2);
    let (smoothed, sloped) = lines[..2 * stride].split_at_mut(stride);
    smoothed.fill(0.0);
    sloped.fill(0.0);
    for j in 0..taps {
        let row = &padded[(y + j) * stride..][..stride];
        for ((s, d), v) in smoothed.iter_mut().zip(&mut *sloped).zip(row) {
            *s += smooth[j] * v;
            *d += slope[j] * v;
        }
    }
    for (x, out) in out.iter_mut().enumerate() {
        let (mut gx, mut gy) = (0.0f32, 0.0f32);
        for i in 0..taps {
            gx += slope[i] * smoothed[x + i];
            gy += smooth[i] * sloped[x + i];
        }
        *out = (gx * gx + gy * gy).sqrt();
    }
}
