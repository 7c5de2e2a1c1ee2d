//! Conditional tone maps: the expectation of one patch given the other, globally or in blended windows, for the
//! sum-of-conditional-variance models. The loops are in `kernels::tone`.

use super::PatchShape;
use crate::kernels::{self, Window};

/// How a map is estimated and read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// Mean of each bin, constant within it.
    Step,
    /// Mean of each bin, interpolated between the centres of the bins.
    Linear,
    /// Least-squares line.
    Line,
}

/// What a [`ToneMap`] needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Settings {
    /// Bins over 0–255.
    pub bins: usize,
    /// Estimation.
    pub shape: Shape,
    /// Windows per side and their spacing in grid points; `None` for one map of the whole patch.
    pub windows: Option<(usize, usize)>,
    /// Whether slopes are computed.
    pub slopes: bool,
    /// How far the lost contrast of the mapped patch is restored to that of the other one: 0 not at all, 1 fully.
    pub contrast: f64,
}

/// Variance (gray levels²) under which a patch has no contrast to map.
const FLAT: f64 = 1e-4;
/// Most that a map is stretched.
const MAX_STRETCH: f64 = 4.0;

/// Tone map `m(v) = v + d(v)` from a patch `a` towards a patch `b`.
#[derive(Clone, Debug)]
pub(super) struct ToneMap {
    settings: Settings,
    shape: PatchShape,
    /// Per channel when localised, else one for all channels.
    windows: Vec<Window>,
    /// Weights of the windows at each point.
    weights: Vec<f32>,
    /// Columns and points of the plane the windows lie in.
    stride: usize,
    plane: usize,
    bins: Vec<u8>,
    /// Shifts of the bins, window after window, plane after plane; or lines.
    tables: Vec<f32>,
    lines: Vec<[f32; 2]>,
    pivot: f32,
}

impl ToneMap {
    pub fn new(settings: Settings) -> Self {
        ToneMap {
            settings,
            shape: PatchShape {
                res: crate::params::Resolution { cols: 0, rows: 0 },
                channels: 1,
            },
            windows: Vec::new(),
            weights: Vec::new(),
            stride: 0,
            plane: 0,
            bins: Vec::new(),
            tables: Vec::new(),
            lines: Vec::new(),
            pivot: 128.0,
        }
    }

    /// Makes room for patches of a shape.
    pub fn resize(&mut self, shape: PatchShape) {
        self.shape = shape;
        self.windows.clear();
        let (cols, rows) = (shape.res.cols, shape.res.rows);
        match self.settings.windows {
            None => {
                (self.stride, self.plane) = (shape.len(), shape.len());
                let (cols, rows) = (shape.len(), 1);
                self.windows.push(Window {
                    x: 0,
                    y: 0,
                    cols,
                    rows,
                });
            }
            Some((side, spacing)) => {
                (self.stride, self.plane) = (cols, cols * rows);
                // A window covers at least half of the grid, however coarse the grid is.
                let step = |points: usize| spacing.min(points / (2 * (side - 1).max(1)));
                let (dx, dy) = (step(cols), step(rows));
                for k in 0..side * side {
                    let (ix, iy) = (k % side, k / side);
                    self.windows.push(Window {
                        x: ix * dx,
                        y: iy * dy,
                        cols: cols - (side - 1) * dx,
                        rows: rows - (side - 1) * dy,
                    });
                }
            }
        }
        self.weights = kernels::blend_weights(&self.windows, self.stride, self.plane / self.stride.max(1));
        let planes = shape.len() / self.plane.max(1);
        self.bins.clear();
        self.bins.resize(shape.len(), 0);
        let maps = planes * self.windows.len();
        match self.settings.shape {
            Shape::Line => self.lines.resize(maps, [0.0; 2]),
            _ => self.tables.resize(maps * self.settings.bins, 0.0),
        }
    }

    fn per_level(&self) -> f32 {
        self.settings.bins as f32 / 256.0
    }

    /// Estimates the map: the conditional expectation of `b` given `a`.
    pub fn fit(&mut self, a: &[f32], b: &[f32]) {
        let per_level = self.per_level();
        let last = (self.settings.bins - 1) as u8;
        if self.settings.shape != Shape::Line {
            kernels::tone_bins(a, per_level, last, &mut self.bins);
        }
        let maps = self.windows.len();
        for plane in 0..a.len() / self.plane {
            let at = plane * self.plane..(plane + 1) * self.plane;
            let (a, b, bins) = (&a[at.clone()], &b[at.clone()], &self.bins[at]);
            for (k, &window) in self.windows.iter().enumerate() {
                let k = plane * maps + k;
                if self.settings.shape == Shape::Line {
                    let sums = kernels::line_sums(a, b, self.pivot, self.stride, window);
                    self.lines[k] = line(sums, window.len() as f64, self.settings.contrast);
                } else {
                    let mut sums = [[0.0; 4]; 256];
                    kernels::tone_sums(bins, a, b, self.pivot, self.stride, window, &mut sums);
                    let n = self.settings.bins;
                    let table = &mut self.tables[k * n..(k + 1) * n];
                    means(&sums[..n], table);
                    if self.settings.contrast > 0.0 {
                        let whole = kernels::line_sums(a, b, self.pivot, self.stride, window);
                        raise(
                            &sums[..n],
                            whole,
                            window.len() as f64,
                            self.settings.contrast,
                            table,
                        );
                    }
                    fill_gaps(&sums[..n], table);
                }
            }
        }
    }

    /// Shift of each value of `a` into `out`, and the slope of the map there into `slope` unless that is empty.
    pub fn apply(&mut self, a: &[f32], out: &mut [f32], slope: &mut [f32]) {
        let per_level = self.per_level();
        if self.settings.shape == Shape::Step {
            kernels::tone_bins(a, per_level, (self.settings.bins - 1) as u8, &mut self.bins);
        }
        let maps = self.windows.len();
        for plane in 0..a.len() / self.plane {
            let at = plane * self.plane..(plane + 1) * self.plane;
            let (a, out) = (&a[at.clone()], &mut out[at.clone()]);
            let slope = if slope.is_empty() {
                &mut []
            } else {
                &mut slope[at.clone()]
            };
            let weights = &self.weights;
            let n = maps * self.settings.bins;
            match self.settings.shape {
                Shape::Line => {
                    let lines = &self.lines[plane * maps..(plane + 1) * maps];
                    kernels::line_shift(a, self.pivot, lines, weights, out, slope);
                }
                Shape::Linear => {
                    let tables = &self.tables[plane * n..(plane + 1) * n];
                    kernels::linear_shift(a, per_level, tables, weights, out, slope);
                }
                Shape::Step => {
                    let tables = &self.tables[plane * n..(plane + 1) * n];
                    kernels::step_shift(&self.bins[at], per_level, tables, weights, out, slope);
                }
            }
        }
    }

    pub fn memory(&self) -> usize {
        self.bins.capacity()
            + 4 * (self.tables.capacity() + self.weights.capacity())
            + 8 * self.lines.capacity()
    }
}

/// Factor that restores the contrast lost between two variances, `(other/mapped)^(contrast/2)`.
fn stretch(other: f64, mapped: f64, contrast: f64) -> f64 {
    libm::pow((other / mapped).max(1.0), 0.5 * contrast).min(MAX_STRETCH)
}

/// Least-squares line of a shift from the sums of `kernels::line_sums` over `n` points, stretched.
fn line([c, cc, d, cd, dd]: [f64; 5], n: f64, contrast: f64) -> [f32; 2] {
    let variance = cc / n - (c / n).powi(2);
    if variance <= FLAT {
        return [(d / n) as f32, 0.0];
    }
    let covariance = cd / n - c * d / (n * n);
    let mut gain = covariance / variance;
    let mapped = (1.0 + gain).powi(2) * variance;
    if contrast > 0.0 && mapped > FLAT {
        let other = variance + 2.0 * covariance + dd / n - (d / n).powi(2);
        gain += (stretch(other, mapped, contrast) - 1.0) * (1.0 + gain);
    }
    [((d - gain * c) / n) as f32, gain as f32]
}

/// Stretches a table of shifts about the mean of the other patch, to restore the contrast of the mapped one.
fn raise(sums: &[[f64; 4]], [c, cc, d, cd, dd]: [f64; 5], n: f64, contrast: f64, table: &mut [f32]) {
    // Both variances from the same sums, so that equal patches give exactly one.
    let (mut mean, mut square) = (c, cc);
    for ([count, _, c, _], &shift) in sums.iter().zip(&*table) {
        let shift = f64::from(shift);
        mean += count * shift;
        square += 2.0 * shift * c + count * shift * shift;
    }
    let mapped = square / n - (mean / n).powi(2);
    let other = (cc + (2.0 * cd + dd)) / n - ((c + d) / n).powi(2);
    if mapped <= FLAT {
        return;
    }
    let k = stretch(other, mapped, contrast) - 1.0;
    let centre = (c + d) / n;
    for (t, [count, _, c, _]) in table.iter_mut().zip(sums) {
        if *count > 0.0 {
            *t += (k * (c / count + f64::from(*t) - centre)) as f32;
        }
    }
}

/// Mean shift of each occupied bin, zero for the others.
fn means(sums: &[[f64; 4]], table: &mut [f32]) {
    for (t, [count, shift, ..]) in table.iter_mut().zip(sums) {
        *t = if *count > 0.0 { (shift / count) as f32 } else { 0.0 };
    }
}

/// Puts empty bins on the line between their occupied neighbours, or repeats the outermost one.
fn fill_gaps(sums: &[[f64; 4]], table: &mut [f32]) {
    let mut last: Option<usize> = None;
    for k in (0..sums.len()).filter(|&k| sums[k][0] > 0.0) {
        match last {
            None => {
                let first = table[k];
                table[..k].fill(first);
            }
            Some(l) => {
                let (from, rise) = (table[l], table[k] - table[l]);
                for e in l + 1..k {
                    table[e] = from + rise * ((e - l) as f32 / (k - l) as f32);
                }
            }
        }
        last = Some(k);
    }
    if let Some(l) = last {
        let end = table[l];
        table[l + 1..].fill(end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Resolution;

    fn shape(channels: usize) -> PatchShape {
        PatchShape {
            res: Resolution { cols: 20, rows: 16 },
            channels,
        }
    }

    fn map(shape: Shape, windows: Option<(usize, usize)>) -> ToneMap {
        ToneMap::new(Settings {
            bins: 64,
            shape,
            windows,
            slopes: true,
            contrast: 0.0,
        })
    }

    #[test]
    fn gaps_between_bins_are_filled() {
        let mut out = [9.0; 7];
        let o = [0.0; 4];
        let at = |count: f64, sum: f64| [count, sum, 0.0, 0.0];
        let sums = [o, at(2.0, 4.0), o, o, at(1.0, 8.0), o, o];
        means(&sums, &mut out);
        fill_gaps(&sums, &mut out);
        assert_eq!(out, [2.0, 2.0, 4.0, 6.0, 8.0, 8.0, 8.0]);
        means(&[o; 7], &mut out);
        fill_gaps(&[o; 7], &mut out);
        assert_eq!(out, [0.0; 7]);
    }

    #[test]
    fn contrast_is_kept_however_loose_the_relation() {
        let shape = shape(1);
        let n = shape.len();
        let value = |i: usize, k: usize| ((i * k) % 157) as f32 + 40.0;
        let a: Vec<f32> = (0..n).map(|i| value(i, 37)).collect();
        let b: Vec<f32> = (0..n).map(|i| 0.5 * a[i] + 0.3 * value(i, 91)).collect();
        let variance = |x: &[f32]| {
            let mean = x.iter().sum::<f32>() / n as f32;
            x.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / n as f32
        };
        for kind in [Shape::Step, Shape::Linear, Shape::Line] {
            for contrast in [0.0, 1.0] {
                let mut map = map(kind, None);
                map.settings.contrast = contrast;
                map.resize(shape);
                map.fit(&a, &b);
                let (mut d, mut mapped) = (vec![0.0; n], a.clone());
                map.apply(&a, &mut d, &mut []);
                mapped.iter_mut().zip(&d).for_each(|(m, d)| *m += d);
                let ratio = variance(&mapped) / variance(&b);
                if contrast == 1.0 {
                    // Interpolation between bins rounds the map's corners.
                    assert!((ratio - 1.0).abs() < 0.05, "{kind:?}: {ratio}");
                } else {
                    assert!(ratio < 0.9, "{kind:?}: {ratio}");
                }
                map.fit(&a, &a);
                map.apply(&a, &mut d, &mut []);
                assert!(d.iter().all(|&d| d == 0.0), "{kind:?}");
            }
        }
    }

    #[test]
    fn lines_recover_gain_and_bias_and_equal_patches_need_no_shift() {
        for channels in [1, 3] {
            let n = shape(channels).len();
            let a: Vec<f32> = (0..n).map(|i| 40.0 + (i * 37 % 150) as f32).collect();
            let b: Vec<f32> = a.iter().map(|v| 0.6 * v + 30.0).collect();
            let (mut d, mut s) = (vec![0.0; n], vec![0.0; n]);
            for windows in [None, Some((3, 10))] {
                let mut line = map(Shape::Line, windows);
                line.resize(shape(channels));
                line.fit(&a, &b);
                line.apply(&a, &mut d, &mut s);
                for i in 0..n {
                    assert!((a[i] + d[i] - b[i]).abs() < 1e-3 && (s[i] - 0.6).abs() < 1e-5);
                }
                for kind in [Shape::Step, Shape::Linear, Shape::Line] {
                    let mut map = map(kind, windows);
                    map.resize(shape(channels));
                    map.fit(&a, &a);
                    map.apply(&a, &mut d, &mut s);
                    assert!(d.iter().all(|&d| d == 0.0) && s.iter().all(|&s| s == 1.0));
                    map.fit(&a, &b);
                    map.apply(&a, &mut d, &mut []);
                    // A bin of four levels cannot follow the slope within it.
                    assert!((0..n).all(|i| (a[i] + d[i] - b[i]).abs() < 1.7), "{kind:?}");
                }
            }
        }
    }

    #[test]
    fn windows_cover_the_grid_at_any_resolution() {
        for (cols, rows) in [(2, 2), (5, 3), (13, 11), (50, 50), (200, 20)] {
            for side in 1..=5 {
                let mut m = map(Shape::Step, Some((side, 10)));
                m.resize(PatchShape {
                    res: Resolution { cols, rows },
                    channels: 1,
                });
                assert_eq!(m.windows.len(), side * side);
                let last = m.windows[side * side - 1];
                assert_eq!((last.x + last.cols, last.y + last.rows), (cols, rows));
                assert!(last.len() > 0 && m.windows[0].x == 0);
            }
        }
    }
}
