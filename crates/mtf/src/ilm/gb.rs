//! GB, global gain and bias (Bartoli 2008): `g_i = (1 + a) I_i + b`.

use super::GainBasis;
use crate::params::{NoParams, Resolution};
use crate::tracker::TrackError;

/// One gain, one bias.
#[derive(Clone, Debug)]
pub struct GbBasis;

impl GainBasis for GbBasis {
    type Params = NoParams;
    const NAME: &'static str = "gb";
    const SUMMARY: &'static str = "gain and bias of the whole patch";
    fn new(_: NoParams) -> Self {
        GbBasis
    }
    fn gains(&self, res: Resolution) -> Result<Vec<Vec<f32>>, TrackError> {
        Ok(vec![vec![1.0; res.len()]])
    }
    fn local_biases(&self) -> bool {
        false
    }
}
