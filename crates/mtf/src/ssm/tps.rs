//! Thin plate spline (Bookstein 1989): displacements interpolated with least bending energy from a net of control points
//! `c_j` over the region, `U(r) = r² ln r`.
//!
//! `W(x) = [U(|x - c_1|), ..., U(|x - c_n|), 1, x, y] L⁻¹[:, 1..n]`, `L = [K + λ Id, P; Pᵀ, 0]`, `K_ij = U(|c_i - c_j|)`,
//! `P_j = (1, c_j)`. Affine motions are reproduced exactly.

use super::frame::BaseFrame;
use super::freeform::{Basis, BendPenalty, Weight};
use crate::geom::homography;
use crate::params::Resolution;
use crate::tracker::TrackError;
use nalgebra::DMatrix;

crate::params! {
    /// Parameters of [`super::Tps`].
    pub struct TpsParams {
        /// Control points over the region, columns x rows.
        control_net: Resolution = Resolution { cols: 4, rows: 4 };
        /// Stiffness λ, added to the diagonal of the kernel r² ln r, where r is in RMS distances of the region's corners from their centre; 0 interpolates the control points.
        stiffness: f64 = 0.0, in 0.0..=1e6;
        /// Penalty on unexpected bending, relative to the mean diagonal of the Hessian.
        bend_penalty: f64 = 1.0, in 0.0..=1e6;
        /// Fraction of a frame's bend that is expected in the next one.
        bend_memory: f64 = 0.9, in 0.0..=1.0;
    }
}

/// Weights of [`super::Tps`].
#[derive(Clone, Debug)]
pub struct TpsBasis {
    params: TpsParams,
    control: Vec<[f64; 2]>,
    /// First n columns of `L⁻¹`, n + 3 rows.
    solution: DMatrix<f64>,
}

impl Default for TpsBasis {
    fn default() -> Self {
        Self::new(TpsParams::default())
    }
}

/// `r² ln r` and its derivatives along x and y, from the difference vector.
fn kernel(dx: f64, dy: f64) -> [f64; 3] {
    let square = dx * dx + dy * dy;
    if square < 1e-24 {
        return [0.0; 3];
    }
    let log = libm::log(square);
    [0.5 * square * log, dx * (log + 1.0), dy * (log + 1.0)]
}

impl Basis for TpsBasis {
    type Params = TpsParams;
    const NAME: &'static str = "tps";
    const ALIASES: &'static [&'static str] = &["thinplate"];
    const SUMMARY: &'static str = "thin plate spline by a net of control points";

    fn new(params: TpsParams) -> Self {
        TpsBasis {
            params,
            control: Vec::new(),
            solution: DMatrix::zeros(0, 0),
        }
    }

    fn place(&mut self, frame: &BaseFrame) -> Result<(), TrackError> {
        let net = self.params.control_net;
        let step = |k: usize, n: usize| k as f64 / (n - 1) as f64 - 0.5;
        self.control = (0..net.len())
            .map(|k| {
                let at = [step(k % net.cols, net.cols), step(k / net.cols, net.rows)];
                homography::apply(&frame.from_square, at)
            })
            .collect();
        let (n, c) = (net.len(), &self.control);
        let system = DMatrix::from_fn(n + 3, n + 3, |i, j| {
            let affine = |k: usize, c: &[f64; 2]| [1.0, c[0], c[1]][k];
            match (i < n, j < n) {
                (true, true) => {
                    let u = kernel(c[i][0] - c[j][0], c[i][1] - c[j][1])[0];
                    if i == j { u + self.params.stiffness } else { u }
                }
                (true, false) => affine(j - n, &c[i]),
                (false, true) => affine(i - n, &c[j]),
                (false, false) => 0.0,
            }
        });
        let inverse = system
            .try_inverse()
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        self.solution = inverse.columns(0, n).into_owned();
        Ok(())
    }

    fn net(&self) -> Resolution {
        self.params.control_net
    }

    fn control(&self) -> &[[f64; 2]] {
        &self.control
    }

    fn weights_into(&self, x: [f64; 2], out: &mut [Weight]) {
        let n = self.control.len();
        let s = &self.solution;
        for (j, out) in out.iter_mut().enumerate() {
            *out = Weight {
                w: s[(n, j)] + x[0] * s[(n + 1, j)] + x[1] * s[(n + 2, j)],
                dx: s[(n + 1, j)],
                dy: s[(n + 2, j)],
            };
        }
        for (i, c) in self.control.iter().enumerate() {
            let [u, ux, uy] = kernel(x[0] - c[0], x[1] - c[1]);
            for (j, out) in out.iter_mut().enumerate() {
                out.w += u * s[(i, j)];
                out.dx += ux * s[(i, j)];
                out.dy += uy * s[(i, j)];
            }
        }
    }

    fn penalty(&self) -> BendPenalty {
        BendPenalty {
            weight: self.params.bend_penalty,
            memory: self.params.bend_memory,
        }
    }
}
