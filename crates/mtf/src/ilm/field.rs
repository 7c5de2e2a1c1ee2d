//! What the illumination models share: a field of gains and one of biases, `g_i = γ_i I_i + β_i` with
//! `γ_i = 1 + Σ_j w_ij a_j`, `β_i = Σ_k v_ik b_k`, linear in the parameters `[a, b]`.
//!
//! `dg_i/da_j = w_ij I_i`, `dg_i/db_k = v_ik`, `dg_i/dI_i = γ_i`, `d²g_i/dI_i da_j = w_ij`; all other second derivatives
//! vanish.
//!
//! # Inverse increments
//!
//! At every point the inverse of an increment composes to the gain `γ_i/δ_i` and the bias `(β_i - ε_i)/δ_i`, with gain `δ` and
//! bias `ε` of the increment. Where gains have disjoint supports and each has its own bias, that is a state:
//! `1 + a_j <- (1 + a_j)/(1 + Δa_j)`, `b_j <- (b_j - Δb_j)/(1 + Δa_j)`. Elsewhere (one bias for several gains, gains that
//! overlap, one gain and bias held fixed) it is none in general, and the nearest one is taken: the state that brings the patch
//! `g⁻¹(T; a)` nearest to what the composed map makes of it, `(T_i - ε_i)/δ_i`, in least squares over the points, up to one
//! gain and bias of the whole where these are held fixed. It is the exact one where there is one, and nothing of first order in
//! `Δ` is lost that the model can express; formulas for single coefficients lose terms `b Δa` and `a Δa`.
//!
//! Biases beyond what intensities are come of appearance models that hardly see them. Gains must not make up for these: the
//! gains are then fitted to `γ_i/δ_i` and the biases to `(β_i - ε_i)/δ_i`, each by themselves.
//!
//! A multiplicative increment inside the map, `a <- a + (1 + a) Δa` with `dg/da` scaled likewise, yields the same iterates
//! and is not offered apart.

use super::{IlluminationModel, Reference};
use crate::am::PatchShape;
use crate::entry::Part;
use crate::geom::solve::{SymMatrix, solve_negative};
use crate::kernels::{self, Jacobian};
use crate::params::{Params, Resolution};
use crate::tracker::TrackError;

/// Gains below this are refused.
pub const MIN_GAIN: f64 = 0.05;

/// Brightest intensity, gray levels.
const WHITE: f32 = 255.0;

/// Share of the diagonal added to the least squares of an inverse increment: points without texture must not decide.
const TIKHONOV: f64 = 1e-6;

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
    /// Whether each gain has a bias of its own, with the same weights, which overlap nowhere; else there is one for the whole
    /// patch.
    fn local_biases(&self) -> bool;
}

/// Least squares for inverse increments that are no states.
#[derive(Clone, Debug, Default)]
struct Nearest {
    /// The patch before its light, and the biases of that light at the points. How far the first guess is from the composed
    /// map: `γ_i I_i` and `β_i`.
    raw: Vec<f32>,
    beta: Vec<f32>,
    light: Vec<f32>,
    shift: Vec<f32>,
    /// Columns of the parameters and, where one gain and bias are held fixed, of that bias.
    j: Jacobian,
    h: SymMatrix,
    both: Vec<f64>,
    gradient: Vec<f64>,
    correction: Vec<f64>,
    work: Vec<f64>,
}

impl Nearest {
    fn new(values: usize, unknowns: usize) -> Self {
        Nearest {
            raw: vec![0.0; values],
            beta: Vec::new(),
            light: vec![0.0; values],
            shift: vec![0.0; values],
            j: Jacobian::new(values, unknowns),
            h: SymMatrix::new(unknowns),
            both: vec![0.0; 2 * unknowns],
            gradient: vec![0.0; unknowns],
            correction: vec![0.0; unknowns],
            work: vec![0.0; unknowns * unknowns + unknowns],
        }
    }

    fn memory(&self) -> usize {
        4 * (3 * self.raw.len() + self.beta.len()) + self.j.memory()
    }
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
    /// Empty until an inverse increment is no state.
    nearest: Nearest,
    /// One gain and one bias of the whole are held fixed.
    relative: bool,
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
            nearest: Nearest::default(),
            relative: false,
        }
    }

    /// Moves `next`, a first guess, to the state nearest to the composition of the present one with the inverse of `delta`. The
    /// gain and bias at the points become those of `next`.
    fn approach(&mut self, delta: &[f64], template: &[f32]) {
        if self.gains.len() == self.biases.len() && !self.relative {
            return;
        }
        let mut nearest = std::mem::take(&mut self.nearest);
        if nearest.raw.len() != template.len() {
            let fixed = usize::from(self.relative);
            nearest = Nearest::new(template.len(), self.state.len() + fixed);
        }
        let Nearest {
            raw,
            beta,
            light,
            shift,
            j,
            h,
            both,
            gradient,
            correction,
            work,
        } = &mut nearest;
        self.unlight(template, raw);
        beta.clone_from(&self.bias);
        self.compute_fields(delta);
        // One gain of the whole is not seen: that which keeps the mean of the gains as it is.
        let whole = if self.relative {
            self.kept_mean(delta) as f32
        } else {
            1.0
        };
        let n = beta.len();
        let mut joint = true;
        for (i, (light, shift)) in light.iter_mut().zip(shift.iter_mut()).enumerate() {
            let (gain, bias) = (self.gain[i % n], self.bias[i % n]);
            *light = whole * (template[i] - beta[i % n]) / gain;
            *shift = whole * (beta[i % n] - bias) / gain;
            joint &= (beta[i % n] - bias).abs() <= WHITE;
        }
        self.jacobian_into(raw, 0, j);
        if self.relative {
            j.col_mut(self.state.len()).fill(1.0);
        }
        let guess = std::mem::take(&mut self.next);
        self.compute_fields(&guess);
        for (i, (light, shift)) in light.iter_mut().zip(shift.iter_mut()).enumerate() {
            *light -= self.gain[i % n] * raw[i];
            *shift -= self.bias[i % n];
        }
        kernels::normal_equations(j, &[light.as_slice(), shift.as_slice()], h, both);
        let (of_light, of_shift) = both.split_at(gradient.len());
        let gains = self.gains.len();
        for (k, g) in gradient.iter_mut().enumerate() {
            *g = match (joint, k < gains) {
                (true, _) => of_light[k] + of_shift[k],
                (false, true) => of_light[k],
                (false, false) => of_shift[k],
            };
        }
        h.fill_from(|i, k, v| match (i == k, (i < gains) == (k < gains)) {
            (true, _) => -v * (1.0 + TIKHONOV),
            (_, false) if !joint => 0.0,
            _ => -v,
        });
        self.next = guess;
        // Without a solution the guess stands.
        if solve_negative(h, 0.0, gradient, correction, work) {
            for (next, c) in self.next.iter_mut().zip(&*correction) {
                *next -= c;
            }
        }
        self.nearest = nearest;
    }

    /// Where the mean of the gains is held: the factor that brings the mean of the composed gains back to it.
    fn kept_mean(&self, delta: &[f64]) -> f64 {
        let n = self.gains.len();
        let (a, d) = (&self.state[..n], &delta[..n]);
        // The gain in the middle is minus the sum of the others.
        let middle = (1.0 - a.iter().sum::<f64>()) / (1.0 - d.iter().sum::<f64>());
        let others = a.iter().zip(d).map(|(a, d)| (1.0 + a) / (1.0 + d));
        (n + 1) as f64 / (middle + others.sum::<f64>())
    }

    /// Takes `next` as the state, if it is one.
    fn accept(&mut self) -> Result<(), TrackError> {
        std::mem::swap(&mut self.state, &mut self.next);
        let state = std::mem::take(&mut self.state);
        self.compute_fields(&state);
        self.state = state;
        let least = self.gain.iter().copied().fold(f32::INFINITY, f32::min);
        if self.state.iter().all(|a| a.is_finite()) && f64::from(least) >= MIN_GAIN {
            return Ok(());
        }
        std::mem::swap(&mut self.state, &mut self.next);
        let state = std::mem::take(&mut self.state);
        self.compute_fields(&state);
        self.state = state;
        Err(TrackError::Illumination("gain too small"))
    }

    /// Gain and bias at the points for parameters `[a, b]`.
    fn compute_fields(&mut self, parameters: &[f64]) {
        self.gain.fill(1.0);
        self.bias.fill(0.0);
        let (a, b) = parameters.split_at(self.gains.len());
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
        self.relative = relative;
        self.nearest = Nearest::default();
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
    fn step_inverse(&mut self, delta: &[f64], template: &[f32]) -> Result<(), TrackError> {
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
        self.approach(delta, template);
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
        4 * self.gain.len() * (2 + self.gains.len() + self.biases.len()) + self.nearest.memory()
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
                m.step_inverse(&delta, &patch()).unwrap();
                let back = m.reference().unwrap().light_of(&delta, &m.reference().unwrap().light_of(m.state(), &raw));
                for (a, b) in back.iter().zip(&lit) {
                    prop_assert!((a - b).abs() < 1e-9);
                }
            }
        }
    }

    /// What the inverse of `delta` composed with `state` makes of each value of a patch that the light brings to `lit`.
    fn composed(m: &dyn IlluminationModel, delta: &[f64], lit: &[f64]) -> Vec<f64> {
        let of = |v: f64| m.reference().unwrap().light_of(delta, &vec![v; lit.len()]);
        let (zero, one) = (of(0.0), of(1.0));
        let each = lit.iter().zip(zero.iter().zip(&one));
        each.map(|(t, (z, o))| (t - z) / (o - z)).collect()
    }

    /// Root of the mean squared difference, up to the best gain and bias of the second list if `relative`.
    fn apart(want: &[f64], got: &[f64], relative: bool) -> f64 {
        let n = want.len() as f64;
        let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
        let (mw, mg) = if relative {
            (mean(want), mean(got))
        } else {
            (0.0, 0.0)
        };
        let dot = |u: &[f64], mu: f64, v: &[f64], mv: f64| -> f64 {
            u.iter().zip(v).map(|(u, v)| (u - mu) * (v - mv)).sum()
        };
        let gain = match relative {
            true => dot(want, mw, got, mg) / dot(got, mg, got, mg),
            false => 1.0,
        };
        let squares = want
            .iter()
            .zip(got)
            .map(|(w, g)| (w - mw - gain * (g - mg)).powi(2));
        (squares.sum::<f64>() / n).sqrt()
    }

    proptest! {
        /// No state is nearer to the composition than the one taken: not the states around it, not the formulas for single
        /// coefficients; where the composition is a state, it is that state.
        #[test]
        fn inverse_increments_are_the_nearest_states(
            v in prop::collection::vec(-0.25f64..0.25, 36), kind in 0usize..3, relative: bool,
        ) {
            let local = PgbParams { pgb_bias: BiasScope::Region, ..PgbParams::default() };
            let mut m: Box<dyn IlluminationModel> = match kind {
                0 => Box::new(Pgb::default()),
                1 => Box::new(Pgb::with_params(local)),
                _ => Box::new(Rbf::default()),
            };
            m.init(SHAPE, relative).unwrap();
            let dof = m.dof();
            let gains = (0..dof).filter(|k| m.mixed(*k).is_some()).count();
            let scaled = |v: &[f64], by: f64| -> Vec<f64> {
                (0..dof).map(|k| by * if k < gains { v[k] } else { 60.0 * v[k] }).collect()
            };
            // Gains of the field in the middle are minus the sum of the others'.
            let small = if relative { 0.2 } else { 1.0 };
            let (state, delta) = (scaled(&v[..dof], small), scaled(&v[36 - dof..], 0.4 * small));
            m.set_state(&state).unwrap();
            let template = patch();
            let lit: Vec<f64> = template.iter().map(|&v| v.into()).collect();
            let raw = composed(&*m, &state, &lit);
            let want = composed(&*m, &delta, &lit);
            m.step_inverse(&delta, &template).unwrap();
            let taken = m.state().to_vec();
            let error = |a: &[f64]| apart(&want, &m.reference().unwrap().light_of(a, &raw), relative);
            let least = error(&taken);
            let slack = 1e-3 + if relative { 0.05 } else { 1e-3 } * least;
            for k in 0..dof {
                for d in [-1.0, 1.0] {
                    let mut other = taken.clone();
                    other[k] += d * if k < gains { 0.01 } else { 1.0 };
                    prop_assert!(least <= error(&other) + slack, "{k} {d}: {least} {}", error(&other));
                }
            }
            let mean = delta[..gains].iter().sum::<f64>() / gains as f64;
            let formulas: Vec<f64> = (0..dof).map(|k| match k < gains {
                true => (1.0 + state[k]) / (1.0 + delta[k]) - 1.0,
                false => (state[k] - delta[k]) / (1.0 + mean),
            }).collect();
            prop_assert!(least <= error(&formulas) + slack, "{least} {}", error(&formulas));
            // Of a piecewise map with its own biases nothing is lost, whatever is held fixed.
            if kind == 1 {
                prop_assert!(least < 1e-2, "{least}");
            }
        }

        /// Equal gains everywhere make a map that composes within every model.
        #[test]
        fn compositions_that_are_states_are_found(a in -0.3f64..0.3, d in -0.3f64..0.3, b in -40.0f64..40.0, e in -40.0f64..40.0) {
            let models: [Box<dyn IlluminationModel>; 2] = [Box::new(Pgb::default()), Box::new(Rbf::default())];
            for mut m in models {
                m.init(SHAPE, false).unwrap();
                let all = |gain: f64, bias: f64| -> Vec<f64> {
                    (0..m.dof()).map(|k| if m.mixed(k).is_some() { gain } else { bias }).collect()
                };
                let (state, delta) = (all(a, b), all(d, e));
                let want = all((1.0 + a) / (1.0 + d) - 1.0, (b - e) / (1.0 + d));
                m.set_state(&state).unwrap();
                m.step_inverse(&delta, &patch()).unwrap();
                for (k, (got, want)) in m.state().iter().zip(&want).enumerate() {
                    let unit = if m.mixed(k).is_some() { 1.0 } else { 100.0 };
                    prop_assert!((got - want).abs() < 1e-4 * unit, "{k}: {got} {want}");
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

    /// Each model in both forms, at a state that is not the identity.
    fn lit() -> impl Iterator<Item = (&'static str, Box<dyn IlluminationModel>)> {
        let forms = ILMS
            .iter()
            .flat_map(|entry| [false, true].map(|relative| (entry, relative)));
        forms.filter_map(|(entry, relative)| {
            let mut m = (entry.build)(&[]).unwrap()?;
            m.init(SHAPE, relative).unwrap();
            let a: Vec<f64> = (0..m.dof()).map(|k| 0.04 * (k as f64 - 3.0)).collect();
            m.set_state(&a).unwrap();
            Some((entry.name, m))
        })
    }

    #[test]
    fn a_column_is_the_difference_that_its_parameter_makes() {
        let raw = patch();
        let wide: Vec<f64> = raw.iter().map(|&v| v.into()).collect();
        for (name, m) in lit() {
            let (dof, a) = (m.dof(), m.state().to_vec());
            let mut j = Jacobian::new(SHAPE.len(), dof + 1);
            m.jacobian_into(&raw, 1, &mut j);
            let light = |a: &[f64]| m.reference().unwrap().light_of(a, &wide);
            let here = light(&a);
            for k in 0..dof {
                // Linear in its parameters: a difference over any step is exact.
                let mut moved = a.clone();
                moved[k] += 1.0;
                for ((there, here), column) in light(&moved).iter().zip(&here).zip(j.col(1 + k)) {
                    assert!((there - here - f64::from(*column)).abs() < 1e-3, "{name} {k}");
                }
            }
        }
    }

    #[test]
    fn gains_below_a_twentieth_are_refused_wherever_they_are() {
        let refused = Err(TrackError::Illumination("gain too small"));
        let mut m = Gb::default();
        m.init(SHAPE, false).unwrap();
        m.set_state(&[-0.94, 5.0]).unwrap();
        assert_eq!(m.set_state(&[-0.96, 5.0]), refused);
        assert_eq!(m.step(&[-0.02, 0.0]), refused);
        assert_eq!(m.state(), [-0.94, 5.0]);
        // One rectangle of nine.
        let mut m = Pgb::default();
        m.init(SHAPE, false).unwrap();
        let with = |gain: f64| {
            (0..10)
                .map(|k| if k == 4 { gain } else { 0.0 })
                .collect::<Vec<_>>()
        };
        assert_eq!(m.set_state(&with(-0.94)), Ok(()));
        assert_eq!(m.set_state(&with(-0.96)), refused);
        for bad in [f64::NAN, f64::INFINITY] {
            assert!(m.set_state(&with(bad)).is_err());
        }
        assert_eq!(m.state(), with(-0.94));
    }
}
