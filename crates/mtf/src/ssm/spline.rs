//! Spline: bilinear free-form deformation with a regular net of control points at the centres of patches of the grid.
//!
//! In grid indices, `W_j(x) ∝ (1 - |a|)₊ (1 - |b|)₊`, `a = (col - c_j)/n`, `b = (row - r_j)/n`, with the half width
//! `n = (cs - 1)/2 + overlap` for patches of `cs` samples, normalised to sum 1. The overlap `(cs + 1)/2` gives `n = cs`:
//! bilinear interpolation between centres, continued linearly beyond the outermost ones.

use super::frame::BaseFrame;
use super::freeform::{Basis, BendPenalty, Weight};
use crate::geom::{Mat3, homography};
use crate::params::{Resolution, param_enum};
use crate::tracker::TrackError;

param_enum! {
    /// Displacements beyond the outermost control points.
    pub enum SplineEdge {
        /// They continue as they are between the last two.
        Linear = "linear",
        /// They stay what they are at the last one.
        Constant = "constant",
    }
}

crate::params! {
    /// Parameters of [`super::Spline`].
    pub struct SplineParams {
        /// Samples per control point, columns x rows.
        control_patch: Resolution = Resolution { cols: 10, rows: 10 };
        /// Samples that neighbouring patches share; 0: as many as interpolate bilinearly.
        control_overlap: f64 = 0.0, in 0.0..=1000.0;
        /// Beyond the outermost control points, with bilinear interpolation: linear or constant.
        control_edge: SplineEdge = SplineEdge::Linear;
        /// Penalty on unexpected bending, relative to the mean diagonal of the Hessian.
        bend_penalty: f64 = 3.0, in 0.0..=1e6;
        /// Fraction of a frame's bend that is expected in the next one.
        bend_memory: f64 = 0.9, in 0.0..=1.0;
    }
}

/// Weights of [`super::Spline`].
#[derive(Clone, Debug)]
pub struct SplineBasis {
    params: SplineParams,
    net: Resolution,
    grid: Resolution,
    to_square: Mat3,
    control: Vec<[f64; 2]>,
}

impl Default for SplineBasis {
    fn default() -> Self {
        Self::new(SplineParams::default())
    }
}

/// Control points along one axis of `samples` samples: at least two.
fn count(samples: usize, patch: usize) -> usize {
    ((samples as f64 / patch as f64).round() as usize).max(2)
}

impl SplineBasis {
    /// Weight and derivative of control point `j` of `n` at `t` samples along an axis of `samples`.
    fn along(&self, t: f64, j: usize, n: usize, samples: usize) -> (f64, f64) {
        let patch = samples as f64 / n as f64;
        if self.params.control_overlap == 0.0 {
            let mut u = (t - (patch - 1.0) / 2.0) / patch;
            let mut slope = 1.0 / patch;
            if self.params.control_edge == SplineEdge::Constant && !(0.0..=(n - 1) as f64).contains(&u) {
                u = u.clamp(0.0, (n - 1) as f64);
                slope = 0.0;
            }
            let cell = (u.floor().max(0.0) as usize).min(n - 2);
            let f = u - cell as f64;
            return match j.checked_sub(cell) {
                Some(0) => (1.0 - f, -slope),
                Some(1) => (f, slope),
                _ => (0.0, 0.0),
            };
        }
        let width = (patch - 1.0) / 2.0 + self.params.control_overlap;
        let hat = |k: usize| {
            let a = (t - (patch - 1.0) / 2.0 - k as f64 * patch) / width;
            if a.abs() < 1.0 {
                (1.0 - a.abs(), -a.signum() / width)
            } else {
                (0.0, 0.0)
            }
        };
        let (sum, slope) = (0..n).map(hat).fold((0.0, 0.0), |s, h| (s.0 + h.0, s.1 + h.1));
        if sum <= 0.0 {
            // Between patches that do not reach this far: the nearest one.
            let nearest = ((t - (patch - 1.0) / 2.0) / patch)
                .round()
                .clamp(0.0, (n - 1) as f64);
            return (f64::from(u8::from(j as f64 == nearest)), 0.0);
        }
        let (h, d) = hat(j);
        (h / sum, (d * sum - h * slope) / (sum * sum))
    }
}

impl Basis for SplineBasis {
    type Params = SplineParams;
    const NAME: &'static str = "spline";
    const ALIASES: &'static [&'static str] = &["spl"];
    const SUMMARY: &'static str = "bilinear free-form deformation by a net of control points";

    fn new(params: SplineParams) -> Self {
        let two = Resolution { cols: 2, rows: 2 };
        SplineBasis {
            params,
            net: two,
            grid: two,
            to_square: Mat3::identity(),
            control: Vec::new(),
        }
    }

    fn place(&mut self, frame: &BaseFrame) -> Result<(), TrackError> {
        let grid = frame.res().ok_or(TrackError::NotInitialised)?;
        let patch = self.params.control_patch;
        self.grid = grid;
        self.net = Resolution {
            cols: count(grid.cols, patch.cols),
            rows: count(grid.rows, patch.rows),
        };
        self.to_square = frame
            .from_square
            .try_inverse()
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        let place = |k: usize, n: usize, samples: usize| {
            let patch = samples as f64 / n as f64;
            ((patch - 1.0) / 2.0 + k as f64 * patch) / (samples.max(2) - 1) as f64 - 0.5
        };
        let net = self.net;
        self.control = (0..net.len())
            .map(|k| {
                let at = [
                    place(k % net.cols, net.cols, grid.cols),
                    place(k / net.cols, net.rows, grid.rows),
                ];
                homography::apply(&frame.from_square, at)
            })
            .collect();
        Ok(())
    }

    fn net(&self) -> Resolution {
        self.net
    }

    fn control(&self) -> &[[f64; 2]] {
        &self.control
    }

    fn weights_into(&self, x: [f64; 2], out: &mut [Weight]) {
        let at = homography::apply(&self.to_square, x);
        let (w, _) = homography::spatial_derivatives(&self.to_square, x);
        let samples = [
            (self.grid.cols.max(2) - 1) as f64,
            (self.grid.rows.max(2) - 1) as f64,
        ];
        let (col, row) = ((at[0] + 0.5) * samples[0], (at[1] + 0.5) * samples[1]);
        for (k, out) in out.iter_mut().enumerate() {
            let (a, da) = self.along(col, k % self.net.cols, self.net.cols, self.grid.cols);
            let (b, db) = self.along(row, k / self.net.cols, self.net.rows, self.grid.rows);
            let (along_col, along_row) = (da * b * samples[0], a * db * samples[1]);
            *out = Weight {
                w: a * b,
                dx: along_col * w[(0, 0)] + along_row * w[(1, 0)],
                dy: along_col * w[(0, 1)] + along_row * w[(1, 1)],
            };
        }
    }

    fn penalty(&self) -> BendPenalty {
        BendPenalty {
            weight: self.params.bend_penalty,
            memory: self.params.bend_memory,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    fn along(params: SplineParams, t: f64) -> Vec<f64> {
        let b = SplineBasis::new(params);
        (0..5).map(|j| b.along(t, j, 5, 50).0).collect()
    }

    #[test]
    fn bilinear_by_hand() {
        let p = SplineParams::default();
        // Centres at 4.5, 14.5, ...
        assert_eq!(along(p.clone(), 4.5), [1.0, 0.0, 0.0, 0.0, 0.0]);
        for (t, a) in [(7.0, 0.25), (49.0, 1.45), (0.0, -0.45)] {
            let w = along(p.clone(), t);
            let last = if t > 40.0 { 4 } else { 1 };
            assert_abs_diff_eq!(w[last], a, epsilon = 1e-12);
            assert_abs_diff_eq!(w.iter().sum::<f64>(), 1.0, epsilon = 1e-12);
        }
        let constant = SplineParams {
            control_edge: SplineEdge::Constant,
            ..p
        };
        assert_eq!(along(constant, 49.0), [0.0, 0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn overlaps_by_hand() {
        let with = |control_overlap| SplineParams {
            control_overlap,
            ..SplineParams::default()
        };
        // The bilinear overlap (cs + 1)/2, given explicitly: the same between centres.
        for t in [4.5, 9.0, 22.2, 44.5] {
            let (a, b) = (along(with(5.5), t), along(with(0.0), t));
            for (a, b) in a.iter().zip(&b) {
                assert_abs_diff_eq!(a, b, epsilon = 1e-12);
            }
        }
        // Overlap 1: a patch moves as one but for its border.
        assert_eq!(along(with(1.0), 6.0), [1.0, 0.0, 0.0, 0.0, 0.0]);
        // None to speak of leaves the border to the nearest centre.
        assert_eq!(along(with(0.01), 9.6), [0.0, 1.0, 0.0, 0.0, 0.0]);
        // A wide one blends everything.
        assert!(along(with(100.0), 20.0).iter().all(|w| *w > 0.15));
    }
}
