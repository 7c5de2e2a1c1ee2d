//! Oriented derivative filters as patch features: no data, no dependencies.
//!
//! Derivatives of Gaussians of standard deviation 1 and 2 grid points (Freeman & Adelson 1991), separable, applied on
//! the sampling grid where the whole filter fits and zero elsewhere. In order: the two first derivatives of the finer
//! scale, of the coarser, then `xx`, `xy`, `yy` of both. Linear, so their derivative is the bank itself.

use super::PatchShape;
use super::patch_features::PatchFeatures;
use crate::kernels::{self, Pass};
use crate::tracker::TrackError;
use std::cell::RefCell;

/// `(scale, order along x, order along y)` of each map.
const MAPS: [(usize, usize, usize); 10] = [
    (0, 1, 0),
    (0, 0, 1),
    (1, 1, 0),
    (1, 0, 1),
    (0, 2, 0),
    (0, 1, 1),
    (0, 0, 2),
    (1, 2, 0),
    (1, 1, 1),
    (1, 0, 2),
];

/// Bank of oriented derivative filters.
#[derive(Clone, Debug)]
pub struct OrientedBank {
    maps: usize,
    cols: usize,
    channels: usize,
    /// Values per plane.
    plane: usize,
    /// Taps by scale and order of the derivative.
    taps: [[Vec<f32>; 3]; 2],
    between: RefCell<[Vec<f32>; 2]>,
}

/// Taps of the derivative of a Gaussian: order 0 sums to one, order 1 gives the slope of a ramp, order 2 the second
/// derivative of a parabola; the higher orders sum to zero.
fn taps(sigma: f64, order: usize) -> Vec<f32> {
    let radius = (2.0 * sigma).ceil() as i32;
    let gauss = |x: f64| libm::exp(-0.5 * x * x / (sigma * sigma));
    let weight = |k: i32| {
        let x = f64::from(k);
        match order {
            0 => gauss(x),
            1 => x * gauss(x),
            _ => (x * x / (sigma * sigma) - 1.0) * gauss(x),
        }
    };
    let mut w: Vec<f64> = (-radius..=radius).map(weight).collect();
    let moment = |w: &[f64], m: i32| -> f64 {
        let terms = w.iter().zip(-radius..).map(|(w, k)| w * f64::from(k).powi(m));
        terms.sum()
    };
    let scale = match order {
        0 => moment(&w, 0),
        1 => moment(&w, 1),
        _ => {
            let excess = moment(&w, 0) / w.len() as f64;
            w.iter_mut().for_each(|w| *w -= excess);
            moment(&w, 2) / 2.0
        }
    };
    w.iter().map(|w| (w / scale) as f32).collect()
}

impl OrientedBank {
    /// The first `maps` of the ten filters, all of them at most.
    pub fn new(maps: usize) -> Self {
        OrientedBank {
            maps: maps.clamp(1, MAPS.len()),
            cols: 0,
            channels: 0,
            plane: 0,
            taps: [1.0, 2.0].map(|sigma| [0, 1, 2].map(|order| taps(sigma, order))),
            between: RefCell::default(),
        }
    }

    fn filter(&self, patch: &[f32], out: &mut [f32]) {
        let [between, _] = &mut *self.between.borrow_mut();
        for (k, out) in out.chunks_exact_mut(self.plane).enumerate() {
            let channel = k / self.maps;
            let (scale, dx, dy) = MAPS[k % self.maps];
            let x = &patch[channel * self.plane..(channel + 1) * self.plane];
            kernels::filter_pass(x, self.cols, &self.taps[scale][dx], Pass::Rows, between);
            kernels::filter_pass(between, self.cols, &self.taps[scale][dy], Pass::Columns, out);
        }
    }
}

impl PatchFeatures for OrientedBank {
    fn prepare(&mut self, shape: PatchShape) -> Result<(), TrackError> {
        (self.cols, self.channels, self.plane) = (shape.res.cols, shape.channels, shape.res.len());
        for buffer in self.between.get_mut() {
            buffer.resize(self.plane, 0.0);
        }
        if shape.res.cols.min(shape.res.rows) < self.taps[0][0].len() {
            return Err(TrackError::Template("patch smaller than the feature filters"));
        }
        Ok(())
    }
    fn maps(&self) -> usize {
        self.maps * self.channels
    }
    fn map_len(&self) -> usize {
        self.plane
    }
    fn evaluate(&self, patch: &[f32], out: &mut [f32]) {
        self.filter(patch, out);
    }
    fn derivative(&self, _patch: &[f32], direction: &[f32], out: &mut [f32]) {
        self.filter(direction, out);
    }
    fn has_transpose(&self) -> bool {
        true
    }
    fn transposed(&self, _patch: &[f32], weights: &[f32], out: &mut [f32]) {
        let [between, back] = &mut *self.between.borrow_mut();
        out.fill(0.0);
        for (k, w) in weights.chunks_exact(self.plane).enumerate() {
            let channel = k / self.maps;
            let (scale, dx, dy) = MAPS[k % self.maps];
            kernels::filter_pass(w, self.cols, &self.taps[scale][dy], Pass::ColumnsAdjoint, between);
            kernels::filter_pass(between, self.cols, &self.taps[scale][dx], Pass::RowsAdjoint, back);
            let out = &mut out[channel * self.plane..(channel + 1) * self.plane];
            out.iter_mut().zip(&*back).for_each(|(o, b)| *o += b);
        }
    }
    fn reference(&self, patch: &[f64]) -> Vec<f64> {
        let (cols, rows) = (self.cols, self.plane / self.cols);
        let mut out = vec![0.0; self.maps() * self.plane];
        for (k, map) in out.chunks_exact_mut(self.plane).enumerate() {
            let (scale, dx, dy) = MAPS[k % self.maps];
            let x = &patch[k / self.maps * self.plane..];
            let (tx, ty) = (&self.taps[scale][dx], &self.taps[scale][dy]);
            let r = tx.len() / 2;
            for y in r..rows.saturating_sub(r) {
                for c in r..cols.saturating_sub(r) {
                    let row = |v: usize| -> f64 {
                        let at = (y + v - r) * cols + c - r;
                        tx.iter().zip(&x[at..]).map(|(&t, p)| f64::from(t) * p).sum()
                    };
                    map[y * cols + c] = ty.iter().enumerate().map(|(v, &t)| f64::from(t) * row(v)).sum();
                }
            }
        }
        out
    }
    fn memory(&self) -> usize {
        8 * self.plane
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Resolution;

    #[test]
    fn filters_are_derivatives() {
        let mut bank = OrientedBank::new(10);
        let res = Resolution { cols: 15, rows: 13 };
        bank.prepare(PatchShape { res, channels: 1 }).unwrap();
        // 3 + 2 x - y + x² - 0.5 x y + 1.5 y² about the centre.
        let at = |i: usize| ((i % 15) as f64 - 7.0, (i / 15) as f64 - 6.0);
        let patch: Vec<f32> = (0..res.len())
            .map(|i| {
                let (x, y) = at(i);
                (3.0 + 2.0 * x - y + x * x - 0.5 * x * y + 1.5 * y * y) as f32
            })
            .collect();
        let mut out = vec![0.0; 10 * res.len()];
        bank.evaluate(&patch, &mut out);
        let centre = 6 * 15 + 7;
        let expected = [2.0, -1.0, 2.0, -1.0, 2.0, -0.5, 3.0, 2.0, -0.5, 3.0];
        for (k, e) in expected.iter().enumerate() {
            assert!((out[k * res.len() + centre] - e).abs() < 1e-4, "map {k}");
        }
    }

    #[test]
    fn tiny_patches_are_refused() {
        let res = Resolution { cols: 4, rows: 9 };
        assert!(
            OrientedBank::new(4)
                .prepare(PatchShape { res, channels: 1 })
                .is_err()
        );
    }
}
