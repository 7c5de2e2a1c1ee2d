//! What the illumination models share: a field of gains and one of biases, `g_i = γ_i I_i + β_i` with
//! `γ_i = 1 + Σ_j w_ij a_j`, `β_i = Σ_k v_ik b_k`, linear in the parameters `[a, b]`.
//!
//! `dg_i/da_j = w_ij I_i`, `dg_i/db_k = v_ik`, `dg_i/dI_i = γ_i`, `d²g_i/dI_i da_j = w_ij`; all other second derivatives
//! vanish. The inverse of an increment composes as `1 + a_j <- (1 + a_j)/(1 + Δa_j)`, `b_k <- (b_k - Δb_k)/(1 + Δa_k)`:
//! exactly where each bias has its own gain, else, with one bias for several gains, to first order in `Δ` with the mean of
//! the `Δa`.
//!
//! A multiplicative increment inside the map, `a <- a + (1 + a) Δa` with `dg/da` scaled likewise, yields the same iterates
//! and is not offered apart.

use super::{IlluminationModel, Reference};
use crate::am::PatchShape;
use crate::entry::Part;
use crate::kernels::{self, Jacobian};
use crate::params::{Params, Resolution};
use crate::tracker::TrackError;

/// Gains below this are refused.
pub const MIN_GAIN: f64 = 0.05;

/// The weights `w` and `v` of a field.
pub trait GainBasis: Send + Sized + 'static {
    /// Parameters.
    type Params: Params;
    /// Name.
    const NAME: &'static str;
    /// Other names.
    const ALIASES: &'static [&'static str] = &[];
    /// One line for `list ilm`.
    const SUMMARY: &'static str;
    /// Builds it.
    fn new(params: Self::Params) -> Self;
    /// `w_j` of each gain, points of the grid row by row; they sum to one at every point. Fails when the grid is too
    /// coarse.
    fn gains(&self, res: Resolution) -> Result<Vec<Vec<f32>>, TrackError>;
    /// Whether each gain has a bias of its own, with the same weights; else there is one for the whole patch.
    fn local_biases(&self) -> bool;
}

/// A field of gains and biases.
#[derive(Clone, Debug)]
pub struct GainField<B> {
    basis: B,
    channels: usize,
    /// `w_j`, `v_k` at each point.
    gains: Vec<Vec<f32>>,
    biases: Vec<Vec<f32>>,
    /// `[a, b]`.
    state: Vec<f64>,
    next: Vec<f64>,
    /// `γ`, `β` at each point.
    gain: Vec<f32>,
    bias: Vec<f32>,
}

impl<B: GainBasis> GainField<B> {
    /// With parameters.
    pub fn with_params(params: B::Params) -> Self {
        GainField {
            basis: B::new(params),
            channels: 1,
            gains: Vec::new(),
            biases: Vec::new(),
            state: Vec::new(),
            next: Vec::new(),
            gain: Vec::new(),
            bias: Vec::new(),
        }
    }

    /// Takes `next` as the state, if it is one.
    fn accept(&mut self) -> Result<(), TrackError> {
        std::mem::swap(&mut self.state, &mut self.next);
        self.compute_fields();
        let least = self.gain.iter().copied().fold(f32::INFINITY, f32::min);
        if self.state.iter().all(|a| a.is_finite()) && f64::from(least) >= MIN_GAIN {
            return Ok(());
        }
        std::mem::swap(&mut self.state, &mut self.next);
        self.compute_fields();
        Err(TrackError::Illumination("gain too small"))
    }

    fn compute_fields(&mut self) {
        self.gain.fill(1.0);
        self.bias.fill(0.0);
        let (a, b) = self.state.split_at(self.gains.len());
        for (w, a) in self.gains.iter().zip(a) {
            kernels::accumulate(w, *a as f32, &mut self.gain);
        }
        for (v, b) in self.biases.iter().zip(b) {
            kernels::accumulate(v, *b as f32, &mut self.bias);
        }
    }
}

/// Leaves the combinations of fields whose coefficients add up to zero: the field in the middle gets minus the sum of the
/// others'.
fn hold_mean(fields: &mut Vec<Vec<f32>>) {
    let middle = fields.remove(fields.len() / 2);
    for field in fields {
        kernels::add_scaled(-1.0, &middle, field);
    }
}

impl<B: GainBasis> Default for GainField<B> {
    fn default() -> Self {
        Self::with_params(B::Params::default())
    }
}

impl<B: GainBasis> IlluminationModel for GainField<B> {
    fn init(&mut self, shape: PatchShape, relative: bool) -> Result<(), TrackError> {
        self.channels = shape.channels;
        self.gains = self.basis.gains(shape.res)?;
        let whole = vec![vec![1.0; shape.res.len()]];
        let local = self.basis.local_biases();
        self.biases = if local { self.gains.clone() } else { whole };
        if relative {
            hold_mean(&mut self.gains);
            hold_mean(&mut self.biases);
        }
        self.gain = vec![1.0; shape.res.len()];
        self.bias = vec![0.0; shape.res.len()];
        self.state = vec![0.0; self.gains.len() + self.biases.len()];
        self.next = self.state.clone();
        Ok(())
    }
    fn dof(&self) -> usize {
        self.state.len()
    }
    fn state(&self) -> &[f64] {
        &self.state
    }
    fn set_state(&mut self, a: &[f64]) -> Result<(), TrackError> {
        self.next.copy_from_slice(a);
        self.accept()
    }
    fn step(&mut self, delta: &[f64]) -> Result<(), TrackError> {
        for (next, (a, d)) in self.next.iter_mut().zip(self.state.iter().zip(delta)) {
            *next = a + d;
        }
        self.accept()
    }
    fn step_inverse(&mut self, delta: &[f64]) -> Result<(), TrackError> {
        let n = self.gains.len();
        let mean = delta[..n].iter().sum::<f64>() / n.max(1) as f64;
        let paired = self.biases.len() == n;
        for k in 0..self.state.len() {
            let (a, d) = (self.state[k], delta[k]);
            self.next[k] = if k < n {
                (1.0 + a) / (1.0 + d) - 1.0
            } else {
                (a - d) / (1.0 + if paired { delta[k - n] } else { mean })
            };
        }
        self.accept()
    }
    fn light(&self, raw: &[f32], out: &mut [f32]) {
        let n = self.gain.len();
        for (raw, out) in raw.chunks_exact(n).zip(out.chunks_exact_mut(n)) {
            kernels::light(raw, &self.gain, &self.bias, out);
        }
    }
    fn unlight(&self, lit: &[f32], out: &mut [f32]) {
        let n = self.gain.len();
        for (lit, out) in lit.chunks_exact(n).zip(out.chunks_exact_mut(n)) {
            kernels::unlight(lit, &self.gain, &self.bias, out);
        }
    }
    fn gain(&self) -> &[f32] {
        &self.gain
    }
    fn jacobian_into(&self, raw: &[f32], first: usize, j: &mut Jacobian) {
        let n = self.gain.len();
        for (k, w) in self.gains.iter().enumerate() {
            for (raw, out) in raw.chunks_exact(n).zip(j.col_mut(first + k).chunks_exact_mut(n)) {
                kernels::product(w, raw, 1.0, out);
            }
        }
        let first = first + self.gains.len();
        for (k, v) in self.biases.iter().enumerate() {
            j.col_mut(first + k)
                .chunks_exact_mut(n)
                .for_each(|out| out.copy_from_slice(v));
        }
    }
    fn mixed(&self, k: usize) -> Option<&[f32]> {
        self.gains.get(k).map(|w| &w[..])
    }
    fn change_squared(&self, from: &[f64]) -> f64 {
        let gains = self.gains.len();
        let changes = self.state.iter().zip(from).enumerate();
        let gray = changes.map(|(k, (a, b))| (a - b) * if k < gains { 255.0 } else { 1.0 });
        gray.map(|d| d * d).sum()
    }
    fn memory(&self) -> usize {
        4 * self.gain.len() * (2 + self.gains.len() + self.biases.len())
    }
    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }
}

impl<B: GainBasis> Reference for GainField<B> {
    fn light_of(&self, a: &[f64], raw: &[f64]) -> Vec<f64> {
        let (gains, biases) = a.split_at(self.gains.len());
        let sum = |weights: &[Vec<f32>], values: &[f64], i: usize| {
            weights
                .iter()
                .zip(values)
                .map(|(w, a)| f64::from(w[i]) * a)
                .sum::<f64>()
        };
        let n = self.gain.len();
        raw.iter()
            .enumerate()
            .map(|(i, v)| (1.0 + sum(&self.gains, gains, i % n)) * v + sum(&self.biases, biases, i % n))
            .collect()
    }
}

impl<B: GainBasis> Part for GainField<B> {
    type Params = B::Params;
    const NAME: &'static str = B::NAME;
    const ALIASES: &'static [&'static str] = B::ALIASES;
    const SUMMARY: &'static str = B::SUMMARY;
    fn new(params: B::Params) -> Self {
        Self::with_params(params)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Gb, Pgb, PgbParams, Rbf};
    use super::*;
    use crate::ilm::{BiasScope, ILMS};
    use proptest::prelude::*;

    const SHAPE: PatchShape = PatchShape {
        res: Resolution { cols: 11, rows: 8 },
        channels: 3,
    };

    fn patch() -> Vec<f32> {
        (0..SHAPE.len()).map(|i| (i * 37 % 200) as f32 + 20.0).collect()
    }

    proptest! {
        /// Composing the inverse of an increment is exact where every gain has its bias.
        #[test]
        fn inverse_increments_undo_themselves(v in prop::collection::vec(-0.3f64..0.3, 36)) {
            let local = PgbParams { pgb_bias: BiasScope::Region, ..PgbParams::default() };
            let models: [Box<dyn IlluminationModel>; 2] =
                [Box::new(Gb::default()), Box::new(Pgb::with_params(local))];
            for mut m in models {
                m.init(SHAPE, false).unwrap();
                let a = m.dof();
                let scaled = |v: &[f64]| -> Vec<f64> {
                    (0..a).map(|k| if k < a / 2 { v[k] } else { 50.0 * v[k] }).collect()
                };
                let (state, delta) = (scaled(&v[..a]), scaled(&v[v.len() - a..]));
                m.set_state(&state).unwrap();
                let raw: Vec<f64> = patch().iter().map(|&v| f64::from(v)).collect();
                let lit = m.reference().unwrap().light_of(&state, &raw);
                m.step_inverse(&delta).unwrap();
                let back = m.reference().unwrap().light_of(&delta, &m.reference().unwrap().light_of(m.state(), &raw));
                for (a, b) in back.iter().zip(&lit) {
                    prop_assert!((a - b).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn lighting_inverts_and_weights_sum_to_one() {
        for entry in ILMS {
            let Some(mut m) = (entry.build)(&[]).unwrap() else {
                continue;
            };
            for relative in [false, true] {
                m.init(SHAPE, relative).unwrap();
                let dof = m.dof();
                let a: Vec<f64> = (0..dof).map(|k| 0.05 * (k as f64 - 3.0)).collect();
                m.set_state(&a).unwrap();
                let raw = patch();
                let (mut lit, mut back) = (raw.clone(), raw.clone());
                m.light(&raw, &mut lit);
                m.unlight(&lit, &mut back);
                let wide: Vec<f64> = raw.iter().map(|&v| v.into()).collect();
                for (i, exact) in m.reference().unwrap().light_of(&a, &wide).iter().enumerate() {
                    assert!((f64::from(lit[i]) - exact).abs() < 1e-3, "{}", entry.name);
                    assert!((back[i] - raw[i]).abs() < 1e-3, "{}", entry.name);
                }
                if !relative {
                    for i in 0..SHAPE.res.len() {
                        let total: f32 = (0..dof).filter_map(|k| m.mixed(k)).map(|w| w[i]).sum();
                        assert!((total - 1.0).abs() < 1e-6, "{}", entry.name);
                    }
                }
                // Darkness is refused, and leaves the state alone.
                if dof > 0 {
                    assert!(m.step(&vec![-2.0; dof]).is_err());
                    assert_eq!(m.state(), a);
                }
            }
        }
    }

    #[test]
    fn regions_need_points() {
        let coarse = PatchShape {
            res: Resolution { cols: 2, rows: 2 },
            channels: 1,
        };
        assert!(Pgb::default().init(coarse, false).is_err());
        assert!(Rbf::default().init(coarse, false).is_err());
        assert!(Gb::default().init(coarse, false).is_ok());
    }
}
