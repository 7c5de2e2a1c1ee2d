//! PGB, piecewise gain and bias (Silveira & Malis 2007): `g_i = (1 + a_r(i)) I_i + b`, a gain for each rectangle `r` of
//! the patch and one bias, or one for each rectangle.
//!
//! Rectangles are `floor(points/count)` points wide and high; the last column and row take what remains.

use super::GainBasis;
use crate::params::{Resolution, param_enum};
use crate::tracker::TrackError;

param_enum! {
    /// What has a bias.
    pub enum BiasScope {
        /// The patch.
        Patch = "patch",
        /// Each rectangle.
        Region = "region",
    }
}

crate::params! {
    /// Parameters of [`super::Pgb`].
    pub struct PgbParams {
        /// Rectangles side by side.
        pgb_cols: usize = 3, in 2..=8;
        /// Rectangles one below the other.
        pgb_rows: usize = 3, in 2..=8;
        /// One bias for the patch or one for each region.
        pgb_bias: BiasScope = BiasScope::Patch;
    }
}

/// Indicators of rectangles.
#[derive(Clone, Debug)]
pub struct PgbBasis {
    params: PgbParams,
}

impl GainBasis for PgbBasis {
    type Params = PgbParams;
    const NAME: &'static str = "pgb";
    const SUMMARY: &'static str = "gain of each rectangle of the patch, one bias";
    fn new(params: PgbParams) -> Self {
        PgbBasis { params }
    }
    fn gains(&self, res: Resolution) -> Result<Vec<Vec<f32>>, TrackError> {
        let (cols, rows) = (self.params.pgb_cols, self.params.pgb_rows);
        if res.cols < cols || res.rows < rows {
            return Err(TrackError::Illumination("fewer samples than regions"));
        }
        let mut gains = vec![vec![0.0; res.len()]; cols * rows];
        for i in 0..res.len() {
            let at = |k: usize, points: usize, count: usize| (k / (points / count)).min(count - 1);
            let (x, y) = (at(i % res.cols, res.cols, cols), at(i / res.cols, res.rows, rows));
            gains[y * cols + x][i] = 1.0;
        }
        Ok(gains)
    }
    fn local_biases(&self) -> bool {
        self.params.pgb_bias == BiasScope::Region
    }
}
