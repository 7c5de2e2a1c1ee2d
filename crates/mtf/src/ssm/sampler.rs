//! Random states: perturbations, transitions from frame to frame, means. For stochastic search over any warp.
//!
//! Draws come from the caller's seeded stream, in an order that depends on nothing but the calls made.

use super::{Gradient, Increment, JacobianKind, MAX_DOF, Points, StateSpaceModel};
use crate::geom::{Corners, homography};
use crate::kernels::Jacobian;
use crate::params::{ParamValue, param_enum};
use crate::tracker::TrackError;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

param_enum! {
    /// What is disturbed.
    pub enum Perturbation {
        /// Each parameter, `Δ_k ~ N(µ_k, σ_k²)`, in units of the base frame.
        Params = "params",
        /// The four corners; the increment is the fit to where they went.
        Corners = "corners",
        /// As few points of the region as determine a state: its centre; two opposite corners; the lower corners and the
        /// middle of the upper side; all four corners.
        Points = "points",
        /// Geometric parameters (shift, scale, angles), each `N(µ_k, σ_k²)` about those of the identity, or, in additive
        /// transitions, about those of the state; of warps that are [`Geometric`](super::Geometric).
        Geometric = "geometric",
    }
}

impl Perturbation {
    /// How many deviations may be given for a warp.
    pub fn deviations<S: StateSpaceModel + ?Sized>(self, ssm: &S) -> Vec<usize> {
        match self {
            Perturbation::Params => vec![1, ssm.dof()],
            Perturbation::Corners => vec![1, 2, 8],
            Perturbation::Points => vec![1, 2, 2 * points_of(ssm)],
            Perturbation::Geometric => vec![ssm.dof()],
        }
    }
}

param_enum! {
    /// Unit of the deviations of corners and points, and of geometric shifts.
    pub enum SampleUnit {
        /// Image pixels.
        Pixels = "px",
        /// Sides of the square whose corners are as far from its centre as the region's are (RMS): `√2 r`.
        Side = "side",
    }
}

param_enum! {
    /// How states follow each other.
    pub enum Dynamics {
        /// A disturbance of the present state.
        RandomWalk = "random_walk",
        /// First-order autoregression: the last motion, damped, and a disturbance.
        Ar1 = "ar1",
    }
}

param_enum! {
    /// Mean of many states.
    pub enum Mean {
        /// Of the state vectors.
        State = "state",
        /// Of the warped corners, fitted.
        Corners = "corners",
        /// Karcher mean in the matrix group.
        Group = "group",
    }
}

/// Sets of standard deviations, written `6:4|3:2` (two sets of two). Samples are split evenly among the sets.
#[derive(Clone, Debug, PartialEq)]
pub struct SigmaSets(pub Vec<Vec<f64>>);

impl SigmaSets {
    /// One set with one number.
    pub fn single(sigma: f64) -> Self {
        SigmaSets(vec![vec![sigma]])
    }
    /// Set of sample `i` of `n`.
    pub fn set_of(&self, i: usize, n: usize) -> usize {
        (i * self.0.len() / n.max(1)).min(self.0.len().saturating_sub(1))
    }
}

impl ParamValue for SigmaSets {
    fn parse(text: &str) -> Option<Self> {
        let number = |s: &str| f64::parse(s.trim()).filter(|v| *v >= 0.0);
        let set = |s: &str| s.split(':').map(number).collect::<Option<Vec<f64>>>();
        text.split('|').map(set).collect::<Option<_>>().map(SigmaSets)
    }
    fn text(&self) -> String {
        let set = |s: &Vec<f64>| s.iter().map(ParamValue::text).collect::<Vec<_>>().join(":");
        self.0.iter().map(set).collect::<Vec<_>>().join("|")
    }
    fn allowed() -> String {
        "numbers separated by ':', sets of them by '|'".to_owned()
    }
}

/// Source of increments and transitions.
#[derive(Clone, Debug)]
pub struct Sampler {
    /// What is disturbed.
    pub perturbation: Perturbation,
    /// Unit of deviations of corners, points and geometric shifts.
    pub unit: SampleUnit,
    /// Deviations. Of parameters: one for all, or one each. Of geometric parameters: one each. Of `n` corners or points: one for every coordinate; two, of
    /// a shift common to all points and of each coordinate; or `2n`, one per coordinate.
    pub sigma: SigmaSets,
    /// Means `µ` of parameters, geometric ones too; empty for zero.
    pub mean: Vec<f64>,
    /// Factor of the last motion under [`Dynamics::Ar1`].
    pub ar_factor: f64,
    delta: Vec<f64>,
}

impl Default for Sampler {
    /// Corners by two pixels.
    fn default() -> Self {
        Sampler::new(Perturbation::Corners, SampleUnit::Pixels, SigmaSets::single(2.0))
    }
}

/// Draws that may fail (degenerate points, folded regions) before a sample is given up.
const TRIES: usize = 100;
/// Draws and rounds by which deviations are brought to a wanted motion.
const CALIBRATION: (usize, usize) = (2000, 6);

const NOT_GEOMETRIC: TrackError = TrackError::Unable("the warp has no geometric parameters");
const NO_SAMPLE: TrackError = TrackError::Degenerate("no sound sample among many");

impl Sampler {
    /// With zero mean and the autoregression factor 0.5.
    pub fn new(perturbation: Perturbation, unit: SampleUnit, sigma: SigmaSets) -> Self {
        Sampler {
            perturbation,
            unit,
            sigma,
            mean: Vec::new(),
            ar_factor: 0.5,
            delta: Vec::new(),
        }
    }

    /// Parameters disturbed so that the corners move by each of `pixels` (RMS), a set each; see [`sigma_of_motion`].
    pub fn of_motion<S: StateSpaceModel + ?Sized>(ssm: &S, pixels: &[f64]) -> Result<Self, TrackError> {
        let sets = pixels
            .iter()
            .map(|px| sigma_of_motion(ssm, *px))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Sampler::new(
            Perturbation::Params,
            SampleUnit::Pixels,
            SigmaSets(sets),
        ))
    }

    /// Numbers of a set, and of `mean`, that fit a warp: an error says what is wrong.
    pub fn check<S: StateSpaceModel + ?Sized>(&self, ssm: &S) -> Result<(), TrackError> {
        if self.perturbation == Perturbation::Geometric && ssm.geometric().is_none() {
            return Err(NOT_GEOMETRIC);
        }
        let right = self.perturbation.deviations(ssm);
        if self.sigma.0.is_empty() || !self.sigma.0.iter().all(|s| right.contains(&s.len())) {
            return Err(TrackError::BadRegion(
                "the number of deviations does not fit the warp",
            ));
        }
        if !self.mean.is_empty() && self.mean.len() != ssm.dof() {
            return Err(TrackError::BadRegion("the number of means does not fit the warp"));
        }
        Ok(())
    }

    /// `N(µ_k, σ_k²)` for each number.
    fn draw_normal(&self, sigma: &[f64], rng: &mut Pcg64, out: &mut [f64]) {
        for (k, d) in out.iter_mut().enumerate() {
            let z: f64 = rng.sample(StandardNormal);
            *d = self.mean.get(k).unwrap_or(&0.0) + sigma.get(k).unwrap_or(&sigma[0]) * z;
        }
    }

    /// Steps of geometric parameters, shifts in the unit of the base frame.
    fn draw_geometric<S: StateSpaceModel + ?Sized>(
        &self,
        sigma: &[f64],
        ssm: &S,
        rng: &mut Pcg64,
        steps: &mut [f64],
    ) -> Result<(), TrackError> {
        if ssm.geometric().is_none() || steps.len() != ssm.dof() {
            return Err(NOT_GEOMETRIC);
        }
        self.draw_normal(sigma, rng, steps);
        let unit = self.pixels(ssm) / ssm.base().radius;
        steps.iter_mut().take(2).for_each(|shift| *shift *= unit);
        Ok(())
    }

    /// Whether transitions add to states.
    fn adds<S: StateSpaceModel + ?Sized>(how: Increment, ssm: &S) -> bool {
        how == Increment::Additive || !ssm.capabilities().compositional
    }

    /// Whether transitions add to geometric parameters: their last motion is one of those.
    fn adds_geometric<S: StateSpaceModel + ?Sized>(&self, how: Increment, ssm: &S) -> bool {
        self.perturbation == Perturbation::Geometric && Self::adds(how, ssm)
    }

    /// The last motion that [`transition`](Self::transition) expects, undamped, of a warp that went from state `p` to `q` in
    /// one step: of `w(p)⁻¹ ∘ w(q)`, or the difference of geometric parameters where these are added to.
    pub fn motion_into<S: StateSpaceModel + ?Sized>(
        &self,
        ssm: &S,
        how: Increment,
        p: &[f64],
        q: &[f64],
        out: &mut [f64],
    ) -> Result<(), TrackError> {
        if self.adds_geometric(how, ssm) {
            geometric_difference(ssm, p, q, out)
        } else {
            ssm.relative_into(p, q, out)
        }
    }

    /// The unit in pixels.
    fn pixels<S: StateSpaceModel + ?Sized>(&self, ssm: &S) -> f64 {
        match self.unit {
            SampleUnit::Pixels => 1.0,
            SampleUnit::Side => std::f64::consts::SQRT_2 * ssm.base().radius,
        }
    }

    /// Draws an increment from set `set`. Fails when no draw of many determines one.
    pub fn draw<S: StateSpaceModel + ?Sized>(
        &self,
        set: usize,
        ssm: &S,
        rng: &mut Pcg64,
        delta: &mut [f64],
    ) -> Result<(), TrackError> {
        let sigma = self.sigma.0.get(set).filter(|s| !s.is_empty()).ok_or(NO_SAMPLE)?;
        if self.perturbation == Perturbation::Params {
            self.draw_normal(sigma, rng, delta);
            return Ok(());
        }
        if self.perturbation == Perturbation::Geometric {
            let mut steps = [0.0; MAX_DOF];
            let steps = &mut steps[..delta.len().min(MAX_DOF)];
            self.draw_geometric(sigma, ssm, rng, steps)?;
            let identity = [0.0; MAX_DOF];
            return geometric_sum(ssm, &identity[..steps.len()], [steps, &identity], delta);
        }
        let count = match self.perturbation {
            Perturbation::Points => points_of(ssm),
            _ => 4,
        };
        let scale = self.pixels(ssm);
        let from = region_points(&ssm.base().corners_in_image(), count);
        for _ in 0..TRIES {
            let mut normal = |s: f64| {
                let z: f64 = rng.sample(StandardNormal);
                scale * s * z
            };
            let shift = if sigma.len() == 2 {
                [normal(sigma[0]), normal(sigma[0])]
            } else {
                [0.0; 2]
            };
            let mut to = from;
            for (i, p) in to[..count].iter_mut().enumerate() {
                for (c, v) in p.iter_mut().enumerate() {
                    let s = match sigma.len() {
                        1 => sigma[0],
                        2 => sigma[1],
                        _ => *sigma.get(2 * i + c).unwrap_or(&0.0),
                    };
                    *v += shift[c] + normal(s);
                }
            }
            if ssm.fit_into(&from[..count], &to[..count], delta).is_ok() {
                return Ok(());
            }
        }
        Err(NO_SAMPLE)
    }

    /// Sets the state to one whose geometric parameters are those of `p` and a random step, and the last motion with
    /// [`Dynamics::Ar1`].
    #[allow(clippy::too_many_arguments)]
    fn walk_geometric<S: StateSpaceModel + ?Sized>(
        &self,
        set: usize,
        ssm: &mut S,
        dynamics: Dynamics,
        rng: &mut Pcg64,
        p: &[f64],
        last: &[f64],
        state: &mut [f64],
    ) -> Result<(), TrackError> {
        let sigma = self.sigma.0.get(set).filter(|s| !s.is_empty()).ok_or(NO_SAMPLE)?;
        let mut steps = [0.0; MAX_DOF];
        let steps = &mut steps[..p.len().min(MAX_DOF)];
        self.draw_geometric(sigma, ssm, rng, steps)?;
        let last = match dynamics {
            Dynamics::RandomWalk => &[],
            Dynamics::Ar1 => last,
        };
        geometric_sum(ssm, p, [steps, last], state)?;
        ssm.set_state(state)
    }

    /// Moves state `p`, whose last motion is `last` (S numbers, zero at first), one step on: with an increment `Δ`,
    /// a random walk leads to `p + Δ` or `w(p) ∘ w(Δ)`, the autoregression to `p + last + Δ` or
    /// `w(p) ∘ w(last) ∘ w(Δ)`, after which `last` is the factor times the motion made. Warps that do not compose take the
    /// additive step. Under [`Perturbation::Geometric`] additive steps, `last` with them, are of the geometric parameters. The warp's state is left at the new `p`. Fails, and changes neither `p` nor `last`, when no draw
    /// of many gives a sound region.
    #[allow(clippy::too_many_arguments)]
    pub fn transition<S: StateSpaceModel + ?Sized>(
        &mut self,
        set: usize,
        ssm: &mut S,
        dynamics: Dynamics,
        how: Increment,
        rng: &mut Pcg64,
        p: &mut [f64],
        last: &mut [f64],
    ) -> Result<(), TrackError> {
        let additive = Self::adds(how, ssm);
        let geometric = self.adds_geometric(how, ssm);
        let how = if additive {
            Increment::Additive
        } else {
            Increment::Compositional
        };
        let mut delta = std::mem::take(&mut self.delta);
        delta.resize(p.len(), 0.0);
        let mut result = Err(NO_SAMPLE);
        for _ in 0..TRIES {
            if geometric {
                result = self.walk_geometric(set, ssm, dynamics, rng, p, last, &mut delta);
                if result.is_ok() {
                    break;
                }
                continue;
            }
            result = self.draw(set, ssm, rng, &mut delta);
            if result.is_err() {
                break;
            }
            result = ssm
                .set_state(p)
                .and_then(|()| match dynamics {
                    Dynamics::RandomWalk => Ok(()),
                    Dynamics::Ar1 => ssm.update(how, last),
                })
                .and_then(|()| ssm.update(how, &delta));
            if result.is_ok() {
                break;
            }
        }
        self.delta = delta;
        result.map_err(|_| NO_SAMPLE)?;
        if dynamics == Dynamics::Ar1 {
            if geometric {
                geometric_difference(ssm, p, ssm.state(), last)?;
            } else if additive {
                last.iter_mut()
                    .zip(ssm.state())
                    .zip(p.iter())
                    .for_each(|((r, q), p)| *r = q - p);
            } else {
                ssm.relative_into(p, ssm.state(), last)?;
            }
            last.iter_mut().for_each(|r| *r *= self.ar_factor);
        }
        p.copy_from_slice(ssm.state());
        Ok(())
    }
}

/// The state whose geometric parameters are those of state `p` and `steps` together.
fn geometric_sum<S: StateSpaceModel + ?Sized>(
    ssm: &S,
    p: &[f64],
    steps: [&[f64]; 2],
    out: &mut [f64],
) -> Result<(), TrackError> {
    let geometric = ssm.geometric().ok_or(NOT_GEOMETRIC)?;
    let mut g = [0.0; MAX_DOF];
    let g = g.get_mut(..p.len()).ok_or(NOT_GEOMETRIC)?;
    geometric.geometric_into(p, g);
    for step in steps {
        g.iter_mut().zip(step).for_each(|(g, d)| *g += d);
    }
    geometric.state_into(g, out);
    Ok(())
}

/// Geometric parameters of `q` less those of `p`, angles the short way round.
fn geometric_difference<S: StateSpaceModel + ?Sized>(
    ssm: &S,
    p: &[f64],
    q: &[f64],
    out: &mut [f64],
) -> Result<(), TrackError> {
    let geometric = ssm.geometric().ok_or(NOT_GEOMETRIC)?;
    let mut from = [0.0; MAX_DOF];
    let from = from.get_mut(..p.len()).ok_or(NOT_GEOMETRIC)?;
    geometric.geometric_into(p, from);
    geometric.geometric_into(q, out);
    for (k, (d, from)) in out.iter_mut().zip(from).enumerate() {
        *d -= *from;
        if let Some(period) = geometric.period(k) {
            *d -= period * (*d / period).round();
        }
    }
    Ok(())
}

/// Points that [`Perturbation::Points`] disturbs.
fn points_of<S: StateSpaceModel + ?Sized>(ssm: &S) -> usize {
    ssm.capabilities().min_points.clamp(1, 4)
}

fn region_points(corners: &Corners, count: usize) -> [[f64; 2]; 4] {
    let square = Corners::rect(-0.5, -0.5, 1.0, 1.0);
    let [ul, _, lr, ll] = corners.0;
    // Regions are convex, so the square has a homography to them.
    let inside = |p| {
        homography::from_corners(&square, corners).map_or(corners.centroid(), |m| homography::apply(&m, p))
    };
    match count {
        1 => [corners.centroid(); 4],
        2 => [ul, lr, ul, lr],
        3 => [lr, ll, inside([0.0, -0.5]), lr],
        _ => corners.0,
    }
}

/// Deviations of the parameters under which each moves the grid equally, and all together the corners by `pixels` in the
/// root mean square over samples and corners.
///
/// `σ_k` is proportional to `1 / mean_i |∂w(x_i; 0)/∂p_k|`, the mean over the grid; the factor is found by measuring samples of
/// a fixed stream. The paper calls it `estimateStateSigma`, and leaves open how it is done.
pub fn sigma_of_motion<S: StateSpaceModel + ?Sized>(ssm: &S, pixels: f64) -> Result<Vec<f64>, TrackError> {
    let grid = ssm.base().grid();
    let (n, s) = (grid.x.len(), ssm.dof());
    if n == 0 || s == 0 {
        return Err(TrackError::NotInitialised);
    }
    let (ones, zeros) = (vec![1.0; n], vec![0.0; n]);
    let [along_x, along_y] = [(&ones, &zeros), (&zeros, &ones)].map(|(x, y)| {
        let mut j = Jacobian::new(n, s);
        let (gradient, points) = (Gradient { x, y }, Points { x: grid.x, y: grid.y });
        ssm.jacobian_into(JacobianKind::Template, gradient, points, 0, &mut j);
        j
    });
    let mut sigma: Vec<f64> = (0..s)
        .map(|k| {
            let pairs = along_x.col(k).iter().zip(along_y.col(k));
            let sum: f64 = pairs.map(|(&x, &y)| f64::from(x).hypot(f64::from(y))).sum();
            pixels / (ssm.base().radius * sum / n as f64)
        })
        .collect();
    if !sigma.iter().all(|v| v.is_finite()) {
        return Err(NO_SAMPLE);
    }
    let base = ssm.base().corners_in_image();
    let mut p = vec![0.0; s];
    for _ in 0..CALIBRATION.1 {
        let mut rng = Pcg64::seed_from_u64(0x5167);
        let (mut sum, mut count) = (0.0, 0);
        for _ in 0..CALIBRATION.0 {
            for (p, sigma) in p.iter_mut().zip(&sigma) {
                let z: f64 = rng.sample(StandardNormal);
                *p = sigma * z;
            }
            let corners = ssm.corners_at(&p);
            // Regions that no search would accept are not counted.
            if corners.is_convex() && corners.signed_area() * base.signed_area() > 0.0 {
                sum += corners.distance_squared(&base) / 4.0;
                count += 1;
            }
        }
        if pixels == 0.0 {
            return Ok(sigma);
        }
        let factor = pixels / (sum / f64::from(count.max(1))).sqrt();
        if !factor.is_finite() {
            return Err(NO_SAMPLE);
        }
        sigma.iter_mut().for_each(|v| *v *= factor);
    }
    Ok(sigma)
}

/// `Σ w_i p_i / Σ w_i`.
fn state_mean(states: &[f64], weights: &[f64], out: &mut [f64]) {
    let total: f64 = weights.iter().sum();
    out.fill(0.0);
    for (p, w) in states.chunks_exact(out.len()).zip(weights) {
        out.iter_mut().zip(p).for_each(|(o, p)| *o += w / total * p);
    }
}

/// Weighted mean of states, S numbers each, one after the other. Weights are not negative, and not all zero. Fails when
/// there is none (no samples, corners without a fit, matrices without a logarithm).
pub fn mean_into<S: StateSpaceModel + ?Sized>(
    kind: Mean,
    ssm: &S,
    states: &[f64],
    weights: &[f64],
    out: &mut [f64],
) -> Result<(), TrackError> {
    let total: f64 = weights.iter().sum();
    if total.is_nan() || total <= 0.0 || states.len() != weights.len() * out.len() {
        return Err(TrackError::NotFinite("weights"));
    }
    match kind {
        Mean::State => state_mean(states, weights, out),
        Mean::Group => match ssm.matrix_group() {
            Some(group) => group.mean_into(states, weights, out)?,
            None => state_mean(states, weights, out),
        },
        Mean::Corners => {
            let mut sum = [0.0; 8];
            for (p, w) in states.chunks_exact(out.len()).zip(weights) {
                let c = ssm.corners_at(p).to_array();
                sum.iter_mut().zip(c).for_each(|(s, v)| *s += w / total * v);
            }
            ssm.fit_into(&ssm.base().corners_in_image().0, &Corners::from_array(sum).0, out)?;
        }
    }
    Ok(())
}
