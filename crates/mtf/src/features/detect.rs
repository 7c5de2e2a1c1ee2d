//! Local maxima of the corner response, spread evenly.

use crate::kernels;

/// A corner of one image, px of that image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Corner {
    /// Pixel.
    pub pixel: [usize; 2],
    /// Place, refined within the pixel.
    pub at: [f32; 2],
    /// Response, (intensity/px)².
    pub response: f32,
}

/// Most corners of a cell.
const PER_CELL: usize = 5;
/// Corners wanted per cell, on average.
const MEAN_PER_CELL: f64 = 2.0;

/// Picks up to `count` corners: the strongest of each cell of a grid first, then the second ones, and so on.
#[derive(Clone, Debug, Default)]
pub(super) struct Picker {
    cells: Vec<([(f32, u32); PER_CELL], usize)>,
    rank: Vec<(f32, u32)>,
    peaks: Vec<u32>,
}

impl Picker {
    /// Corners among the local maxima above `least` that are `margin` px or more from the border of the row-major
    /// response image, and that `wanted` accepts; appended to `out`.
    pub fn pick(
        &mut self,
        response: &[f32],
        width: usize,
        margin: usize,
        least: f32,
        count: usize,
        wanted: impl Fn(usize, usize) -> bool,
        out: &mut Vec<Corner>,
    ) {
        let height = response.len() / width;
        let margin = margin.max(1);
        if width <= 2 * margin || height <= 2 * margin || count == 0 {
            return;
        }
        let area = ((width - 2 * margin) * (height - 2 * margin)) as f64;
        let side = ((area * MEAN_PER_CELL / count as f64).sqrt() as usize).max(4);
        let cols = (width - 2 * margin).div_ceil(side);
        self.cells.clear();
        self.cells.resize(
            cols * (height - 2 * margin).div_ceil(side),
            ([(0.0, 0); PER_CELL], 0),
        );
        self.peaks.resize(width, 0);
        for y in margin..height - margin {
            let line = |y: usize| &response[y * width..(y + 1) * width];
            let rows = [line(y - 1), line(y), line(y + 1)];
            let n = kernels::row_peaks(rows, margin..width - margin, least, &mut self.peaks);
            for &x in &self.peaks[..n] {
                let (x, v) = (x as usize, rows[1][x as usize]);
                // Of equal neighbours the first counts.
                let first = v > rows[1][x - 1] && rows[0][x - 1..x + 2].iter().all(|a| v > *a);
                if first && wanted(x, y) {
                    let cell = (y - margin) / side * cols + (x - margin) / side;
                    insert(&mut self.cells[cell], (v, (y * width + x) as u32));
                }
            }
        }
        let mut left = count;
        for k in 0..PER_CELL {
            self.rank.clear();
            let ranked = self.cells.iter().filter(|c| c.1 > k).map(|c| c.0[k]);
            self.rank.extend(ranked);
            if self.rank.len() > left {
                self.rank
                    .sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
                self.rank.truncate(left);
            }
            left -= self.rank.len();
            out.extend(self.rank.iter().map(|&(v, i)| {
                let (x, y) = (i as usize % width, i as usize / width);
                let at = [
                    x as f32 + vertex(response[i as usize - 1], v, response[i as usize + 1]),
                    y as f32 + vertex(response[i as usize - width], v, response[i as usize + width]),
                ];
                Corner {
                    pixel: [x, y],
                    at,
                    response: v,
                }
            }));
            if left == 0 {
                break;
            }
        }
    }
}

/// Keeps the best of a cell, best first.
fn insert((best, n): &mut ([(f32, u32); PER_CELL], usize), new: (f32, u32)) {
    let place = best[..*n].iter().position(|b| new.0 > b.0).unwrap_or(*n);
    if place < PER_CELL {
        best[place..].rotate_right(1);
        best[place] = new;
        *n = (*n + 1).min(PER_CELL);
    }
}

/// Where the parabola through three values has its top, relative to the middle one.
fn vertex(before: f32, middle: f32, after: f32) -> f32 {
    let bend = before - 2.0 * middle + after;
    if bend < 0.0 {
        (0.5 * (before - after) / bend).clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_peaks_spread_over_the_image() {
        // Peaks every 8 px, those on the left a hundred times stronger.
        let (w, h) = (160, 120);
        let response: Vec<f32> = (0..w * h)
            .map(|i| {
                let (x, y) = (i % w, i / w);
                let k = if x < 80 { 100.0 } else { 1.0 };
                let d = |v: usize| (v % 8) as f32 - 4.2;
                k * (40.0 - d(x) * d(x) - d(y) * d(y)) + (x + y) as f32 * 1e-3
            })
            .collect();
        let mut out = Vec::new();
        Picker::default().pick(&response, w, 4, 1.0, 100, |_, _| true, &mut out);
        assert_eq!(out.len(), 100);
        let right = out.iter().filter(|c| c.pixel[0] >= 80).count();
        assert!((35..65).contains(&right), "{right}");
        for c in &out {
            assert_eq!((c.pixel[0] % 8, c.pixel[1] % 8), (4, 4));
            assert!((c.at[0] - c.pixel[0] as f32 - 0.2).abs() < 0.01, "{c:?}");
        }
        let mut some = Vec::new();
        Picker::default().pick(&response, w, 4, 1.0, 1000, |x, _| x < 40, &mut some);
        assert!(!some.is_empty() && some.iter().all(|c| c.pixel[0] < 40));
        let mut none = Vec::new();
        Picker::default().pick(&[1.0; 64], 8, 4, 0.0, 10, |_, _| true, &mut none);
        assert!(none.is_empty());
    }
}
