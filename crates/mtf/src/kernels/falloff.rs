//! Filters whose weights fall with the difference of intensities as a Gaussian does: bilateral smoothing and diffusion.

use super::pad::padded_stride;

/// Steps of the table, and where it ends: `exp(-t²)` is below 2e-8 from there on.
const STEPS: usize = 2048;
const END: f32 = 4.25;

/// `exp(-t²)` by linear interpolation in a table; the error is below 2e-6.
#[derive(Clone, Debug)]
pub struct Falloff(Vec<f32>);

impl Falloff {
    /// Makes the table.
    pub fn new() -> Self {
        let at = |i: usize| f64::from(END) * i as f64 / STEPS as f64;
        Falloff((0..=STEPS).map(|i| libm::exp(-at(i) * at(i)) as f32).collect())
    }

    /// `exp(-t²)` for `t >= 0`.
    #[inline(always)]
    fn at(&self, t: f32) -> f32 {
        let s = t * (STEPS as f32 / END);
        if s.is_nan() || s >= STEPS as f32 {
            return 0.0;
        }
        let i = s as usize;
        let (a, b) = (self.0[i], self.0[i + 1]);
        a + (s - i as f32) * (b - a)
    }
}

/// A place of a window, columns and rows from its upper left corner, and its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tap {
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
    /// Weight.
    pub weight: f32,
}

/// Sums of one row of a bilateral filter over the padded planes in `planes` ([`super::pad::pad`], `channels` of them one
/// after the other):
/// `k_i = weight_i exp(-(scale d_i)²)`, `d_i = Σ_c |I_c(i) - I_c(centre)|`. For each of the `width` pixels of row `y`, the first
/// `width` elements of `sums` become `Σ_i k_i`, and the next, channel by channel, `Σ_i k_i I_c(i)`.
#[allow(clippy::too_many_arguments)]
pub fn bilateral_row(
    planes: &[f32],
    channels: usize,
    width: usize,
    radius: usize,
    y: usize,
    taps: &[Tap],
    tone: &Falloff,
    scale: f32,
    sums: &mut [f32],
) {
    let (stride, size) = (padded_stride(width, radius), planes.len() / channels);
    let (totals, weighted) = sums[..(channels + 1) * width].split_at_mut(width);
    totals.fill(0.0);
    weighted.fill(0.0);
    for tap in taps {
        let here = (y + radius) * stride + radius;
        let there = (y + tap.y) * stride + tap.x;
        for x in 0..width {
            let mut d = 0.0;
            for c in 0..channels {
                d += (planes[c * size + there + x] - planes[c * size + here + x]).abs();
            }
            let k = tap.weight * tone.at(scale * d);
            totals[x] += k;
            for c in 0..channels {
                weighted[c * width + x] += k * planes[c * size + there + x];
            }
        }
    }
}

/// One step of diffusion of row `y` of a padded plane with a border of one pixel (Perona & Malik 1990):
/// `out = I + rate Σ_i w_i exp(-(scale d_i)²) d_i` over the eight neighbours, `d_i = I_i - I`, `w_i` 1 beside and above, ½ at
/// corners. `out` has a row's pixels.
pub fn diffuse_row(padded: &[f32], y: usize, rate: f32, tone: &Falloff, scale: f32, out: &mut [f32]) {
    let width = out.len();
    let stride = padded_stride(width, 1);
    let row = |j: usize| &padded[(y + j) * stride..][..width + 2];
    let rows = [row(0), row(1), row(2)];
    for (x, out) in out.iter_mut().enumerate() {
        let here = rows[1][x + 1];
        let flow = |j: usize, i: usize| {
            let d = rows[j][x + i] - here;
            tone.at(scale * d.abs()) * d
        };
        let beside = flow(0, 1) + flow(1, 0) + flow(1, 2) + flow(2, 1);
        let corners = flow(0, 0) + flow(0, 2) + flow(2, 0) + flow(2, 2);
        *out = here + rate * (beside + 0.5 * corners);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_function() {
        let tone = Falloff::new();
        for i in 0..50_000 {
            let t = i as f32 * 1e-4;
            let exact = (-f64::from(t) * f64::from(t)).exp();
            assert!((f64::from(tone.at(t)) - exact).abs() < 2e-6, "{t}");
        }
        assert_eq!((tone.at(f32::INFINITY), tone.at(f32::NAN)), (0.0, 0.0));
    }
}
