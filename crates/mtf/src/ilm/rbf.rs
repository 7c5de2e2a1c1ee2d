//! RBF, gains at control points, blended smoothly (Silveira & Malis 2007): `g_i = (1 + Σ_j w_ij a_j) I_i + b`.
//!
//! Control points are the centres of a regular partition of the patch; `w_ij ∝ 1/(1 + d_ij²)` with the distance `d` in
//! sample spacings, scaled to `Σ_j w_ij = 1`, so that equal gains make a constant field.

use super::GainBasis;
use crate::params::Resolution;
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`super::Rbf`].
    pub struct RbfParams {
        /// Control points side by side.
        rbf_cols: usize = 3, in 2..=8;
        /// Control points one below the other.
        rbf_rows: usize = 3, in 2..=8;
    }
}

/// Normalised inverse-square weights.
#[derive(Clone, Debug)]
pub struct RbfBasis {
    params: RbfParams,
}

impl GainBasis for RbfBasis {
    type Params = RbfParams;
    const NAME: &'static str = "rbf";
    const SUMMARY: &'static str = "gains at control points, blended by radial basis functions, one bias";
    fn new(params: RbfParams) -> Self {
        RbfBasis { params }
    }
    fn gains(&self, res: Resolution) -> Result<Vec<Vec<f32>>, TrackError> {
        let (cols, rows) = (self.params.rbf_cols, self.params.rbf_rows);
        if res.cols < cols || res.rows < rows {
            return Err(TrackError::Illumination("fewer samples than control points"));
        }
        let centre =
            |k: usize, points: usize, count: usize| (k as f64 + 0.5) * points as f64 / count as f64 - 0.5;
        let raw = |i: usize, j: usize| {
            let dx = (i % res.cols) as f64 - centre(j % cols, res.cols, cols);
            let dy = (i / res.cols) as f64 - centre(j / cols, res.rows, rows);
            1.0 / (1.0 + dx * dx + dy * dy)
        };
        let count = cols * rows;
        let totals: Vec<f64> = (0..res.len())
            .map(|i| (0..count).map(|j| raw(i, j)).sum())
            .collect();
        let weights = |j: usize| (0..res.len()).map(|i| (raw(i, j) / totals[i]) as f32).collect();
        Ok((0..count).map(weights).collect())
    }
    fn local_biases(&self) -> bool {
        false
    }
}
