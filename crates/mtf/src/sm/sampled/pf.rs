//! PF, particle filter (Isard & Blake 1998; Kwon, Lee & Park 2009 on warps): a cloud of states, moved at random, weighted by
//! how well each explains the frame, and resampled.
//!
//! Weights are `exp(β f)` with `β` chosen anew each time such that the effective number of particles, `(Σw)²/Σw²`, is a given
//! share of all: the same for every appearance model, whatever the scale of its `f`. With several passes per frame each
//! one searches around the last with smaller steps.

use super::deviations::Deviations;
use super::probe::Probe;
use super::resample::{Resampling, effective, resample, temper};
use super::step::Step;
use crate::am::{self, AppearanceModel, Capabilities};
use crate::geom::Corners;
use crate::image::{Frame, Image};
use crate::interrupt;
use crate::params::{Assignment, Built, ParamError, ParamValue, Params, Use, param_enum};
use crate::sm::sampling::SamplingParams;
use crate::sm::template::Learning;
use crate::sm::workspace::Buffers;
use crate::sm::{SmEntry, SmFamily};
use crate::ssm::{
    Dynamics, Increment, Mean, Perturbation, SampleUnit, Sampler, SigmaSets, StateSpaceModel, mean_into,
};
use crate::tracker::{Stop, TrackError, Tracker, Update};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

param_enum! {
    /// Weight of a particle.
    pub enum Likelihood {
        /// `exp(β f)`, `β` from the effective number of particles.
        Tempered = "tempered",
        /// The appearance model's own.
        Am = "am",
        /// `exp(-m / 2σ)`.
        Gaussian = "gaussian",
        /// `1 / (1 + m)`.
        Reciprocal = "reciprocal",
    }
}

param_enum! {
    /// What is returned.
    pub enum Estimate {
        /// The particle of the largest weight.
        Best = "best",
        /// Weighted mean of the states.
        State = "state",
        /// Weighted mean of the warped corners.
        Corners = "corners",
        /// Weighted mean in the matrix group.
        Group = "group",
    }
}

crate::params! {
    /// Parameters of the particle filter.
    pub struct PfParams {
        /// Particles.
        n_particles: usize = 500, in 1..=1_000_000;
        /// Passes per frame.
        max_iters: usize = 1, in 1..=1000;
        /// Passes end when the estimate's corners move less than this: squared, summed over all eight coordinates; px².
        epsilon: f64 = 1e-4, in 0.0..=1e6;
        /// Motion: random_walk or ar1 (the last motion, damped, and a random step). Later passes of a frame walk at random.
        dynamics: Dynamics = Dynamics::Ar1, paper Dynamics::RandomWalk => "an object that moved goes on moving: AUC .824 against .646";
        /// Share of the last motion that ar1 expects again.
        ar_factor: f64 = 0.8, in 0.0..=1.0;
        /// Steps are additive or compositional.
        update: Step = Step::Compositional;
        /// What is disturbed: corners, points, params, or geometric (affine, similitude: shift, scale, angles).
        perturb: Perturbation = Perturbation::Corners;
        /// Unit of lengths in sigma: px, or side (1 is the side of the region as a square).
        unit: SampleUnit = SampleUnit::Pixels;
        /// Standard deviations of random steps: common shift and single coordinate (COMMON:SINGLE) in what unit names, or one per
        /// parameter, in the parameter's unit (shifts as unit names, angles in rad); sets separated by '|' share the particles.
        sigma: SigmaSets = SigmaSets(vec![vec![2.5, 2.5]]);
        /// If not 0: the parameters are disturbed, with deviations estimated such that the corners move by so many px (RMS), instead
        /// of what perturb, unit and sigma say; sets separated by '|'.
        pix_sigma: SigmaSets = SigmaSets::single(0.0);
        /// Factor of the standard deviations from pass to pass.
        shrink: f64 = 0.6, in 0.01..=1.0;
        /// Weights: tempered, am, gaussian or reciprocal. With m = f(T,T) - f, divided by f(T,T), or where that is 0 by the
        /// number of values: gaussian exp(-m / 2 measurement_sigma), reciprocal 1 / (1 + m).
        likelihood: Likelihood = Likelihood::Tempered, paper Likelihood::Am => "one setting for models of any scale, and finer: SR@1 .39 against .21 (AUC .824 against .833)";
        /// Tempered weights: effective particles as a share of all.
        effective_share: f64 = 0.05, in 1e-4..=1.0;
        /// Variance of gaussian weights, relative as m is (see likelihood).
        measurement_sigma: f64 = 0.002, in 1e-9..=1e9;
        /// none, binary (multinomial, binary search), linear (multinomial, linear search), residual or systematic.
        resampling: Resampling = Resampling::Systematic, paper Resampling::Binary => "one random number instead of one per particle, and less scatter: AUC .824 with both";
        /// Resample only when the effective share of the particles is at most this; 0: always.
        adaptive_resampling: f64 = 0.0, in 0.0..=1.0;
        /// Estimate: best, state, corners or group (mean).
        mean: Estimate = Estimate::Corners, paper Estimate::State => "does not depend on the coordinates of the warp: AUC .824 against .820";
        /// After each pass all particles go to the estimate.
        reset_to_mean: bool = true, paper false => "a cloud that stays together finds finer steps: AUC .824 against .715";
        /// Sets of deviations get particles by how well theirs did.
        adapt_sets: bool = false;
        /// Share of an even split that each set keeps.
        min_set_share: f64 = 0.1, in 0.0..=1.0;
        /// The appearance model learns from each tracked frame: auto (models that need it), 0 or 1.
        enable_learning: Learning = Learning::Auto;
    }
}

impl PfParams {
    fn deviations(&self) -> Deviations<'_> {
        Deviations {
            perturb: self.perturb,
            unit: self.unit,
            sigma: &self.sigma,
            pix_sigma: &self.pix_sigma,
        }
    }

    fn increment(&self) -> Increment {
        match self.update {
            Step::Additive => Increment::Additive,
            Step::Compositional => Increment::Compositional,
        }
    }
}

/// Particles: `n` states of S numbers, one after the other.
#[derive(Default)]
struct Cloud {
    states: Vec<f64>,
    /// Damped last motion of each.
    last: Vec<f64>,
    /// Where resampling writes.
    spare: [Vec<f64>; 2],
    /// Logarithms of the weights carried over while no resampling takes place.
    carried: Vec<f64>,
    scores: Vec<f64>,
    weights: Vec<f64>,
    chosen: Vec<usize>,
    /// Share of each set of deviations.
    shares: Vec<f64>,
    /// Set of each particle.
    sets: Vec<usize>,
}

/// Particle filter over appearance model `A` and warp `S`.
pub struct Pf<A, S> {
    /// Search parameters; changes take effect at the next `init`.
    pub params: PfParams,
    probe: Probe<A, S>,
    /// With more threads than one: what moves and scores each share of the particles.
    helpers: Vec<(Probe<A, S>, Sampler)>,
    threads: usize,
    /// The model has seen the patch at the old place in the new frame.
    opened: bool,
    sampler: Sampler,
    /// Deviations of the first pass of a frame.
    sigma: SigmaSets,
    cloud: Cloud,
    rng: Pcg64,
    seed: u64,
    /// `f(T, T)` and what differences from it are divided by.
    scale: [f64; 2],
    /// Estimate, the one before it, the state of the last frame.
    estimate: Vec<f64>,
    before: Vec<f64>,
    frame_start: Vec<f64>,
    motion: Vec<f64>,
}

impl<A: AppearanceModel, S: StateSpaceModel> Pf<A, S> {
    /// With default parameters.
    pub fn new(am: A, ssm: S) -> Self {
        Self::with_params(SamplingParams::default(), PfParams::default(), am, ssm)
    }

    /// With all parameters.
    pub fn with_params(sampling: SamplingParams, params: PfParams, am: A, ssm: S) -> Self {
        Pf {
            params,
            probe: Probe::new(sampling, am, ssm),
            helpers: Vec::new(),
            threads: 1,
            opened: false,
            sampler: Sampler::default(),
            sigma: SigmaSets(Vec::new()),
            cloud: Cloud::default(),
            rng: Pcg64::seed_from_u64(0),
            seed: 0,
            scale: [0.0, 1.0],
            estimate: Vec::new(),
            before: Vec::new(),
            frame_start: Vec::new(),
            motion: Vec::new(),
        }
    }

    /// Gathers all particles at the present state, moving on as `motion` says.
    fn gather(&mut self) {
        let s = self.estimate.len();
        self.estimate.copy_from_slice(self.probe.ssm.state());
        for p in self.cloud.states.chunks_exact_mut(s) {
            p.copy_from_slice(&self.estimate);
        }
        for r in self.cloud.last.chunks_exact_mut(s) {
            r.copy_from_slice(&self.motion);
        }
        self.cloud.carried.fill(0.0);
    }

    /// Deals the particles to the sets of deviations by the sets' shares, neighbours to different ones: resampling leaves the
    /// offspring of one particle side by side.
    fn deal(&mut self) {
        let Cloud { sets, shares, .. } = &mut self.cloud;
        let n = sets.len();
        let stride = (1 + (0.618 * n as f64) as usize..)
            .find(|&k| gcd(k, n) == 1)
            .unwrap_or(1);
        let (mut set, mut until) = (0, shares[0]);
        for i in 0..n {
            while (i as f64 + 0.5) / n as f64 > until && set + 1 < shares.len() {
                set += 1;
                until += shares[set];
            }
            sets[i * stride % n] = set;
        }
    }

    /// Moves every particle and scores it.
    fn scatter(&mut self, image: &Image, pass: usize, b: &mut Buffers) {
        let s = self.estimate.len();
        let factor = self.params.shrink.powi(pass as i32);
        for (now, first) in self.sampler.sigma.0.iter_mut().zip(&self.sigma.0) {
            now.iter_mut().zip(first).for_each(|(v, f)| *v = factor * f);
        }
        let step = Move {
            dynamics: if pass == 0 {
                self.params.dynamics
            } else {
                Dynamics::RandomWalk
            },
            how: self.params.increment(),
            likelihood: self.params.likelihood,
            seed: self.rng.random(),
        };
        let Cloud {
            states,
            last,
            scores,
            sets,
            ..
        } = &mut self.cloud;
        if self.helpers.is_empty() {
            let all = Share {
                first: 0,
                states,
                last,
                sets,
                scores,
            };
            step.make(&mut self.probe, &mut self.sampler, image, all, b);
            return;
        }
        let size = scores.len().div_ceil(self.helpers.len());
        let shares = states
            .par_chunks_mut(size * s)
            .zip(last.par_chunks_mut(size * s))
            .zip(sets.par_chunks(size).zip(scores.par_chunks_mut(size)));
        let (opened, patch, sigma) = (self.opened, &b.values, &self.sampler.sigma);
        let token = interrupt::current();
        self.helpers.par_iter_mut().zip(shares).enumerate().for_each(
            |(k, ((probe, sampler), ((states, last), (sets, scores))))| {
                // Each begins the frame as the tracker itself did.
                if pass == 0 {
                    am::begin_frame(&mut probe.am);
                    if opened {
                        probe.am.set_current(patch);
                    }
                }
                sampler.sigma.clone_from(sigma);
                let mine = Share {
                    first: k * size,
                    states,
                    last,
                    sets,
                    scores,
                };
                let mut ws = probe.workspace();
                let make = || step.make(probe, sampler, image, mine, &mut ws);
                interrupt::under(token.clone(), make);
            },
        );
    }

    /// Weights from scores; false when no particle has any.
    fn weigh(&mut self) -> bool {
        let Cloud {
            scores,
            carried,
            weights,
            ..
        } = &mut self.cloud;
        let [top, scale] = self.scale;
        let log = |f: f64| {
            let m = ((top - f) / scale).max(0.0);
            match self.params.likelihood {
                Likelihood::Tempered | Likelihood::Am => f,
                Likelihood::Gaussian => -0.5 * m / self.params.measurement_sigma,
                Likelihood::Reciprocal => -libm::log1p(m),
            }
        };
        scores.iter_mut().for_each(|f| *f = log(*f));
        if scores.iter().all(|f| *f == f64::NEG_INFINITY) {
            return false;
        }
        let share = match self.params.likelihood {
            Likelihood::Tempered => Some(self.params.effective_share),
            _ => None,
        };
        temper(scores, carried, share, weights);
        true
    }

    /// Puts the warp at the estimate.
    fn conclude(&mut self) -> Result<(), TrackError> {
        let Cloud { states, weights, .. } = &self.cloud;
        let s = self.estimate.len();
        let kind = match self.params.mean {
            Estimate::Best => None,
            Estimate::State => Some(Mean::State),
            Estimate::Corners => Some(Mean::Corners),
            Estimate::Group => Some(Mean::Group),
        };
        let ssm = &mut self.probe.ssm;
        let mean = kind.map(|kind| {
            mean_into(kind, ssm, states, weights, &mut self.estimate)
                .and_then(|()| ssm.set_state(&self.estimate))
        });
        if mean.is_none_or(|m| m.is_err()) {
            let best = (0..weights.len()).fold(0, |a, b| if weights[b] > weights[a] { b } else { a });
            ssm.set_state(&states[best * s..(best + 1) * s])?;
        }
        Ok(())
    }

    /// Shares of the sets from the mean weight of their particles.
    fn reward_sets(&mut self) {
        let Cloud {
            shares,
            sets,
            weights,
            ..
        } = &mut self.cloud;
        let floor = self.params.min_set_share / shares.len() as f64;
        for (d, share) in shares.iter_mut().enumerate() {
            let mine = || sets.iter().zip(&*weights).filter(|(set, _)| **set == d);
            *share = mine().map(|(_, w)| w).sum::<f64>() / mine().count().max(1) as f64;
        }
        let total: f64 = shares.iter().sum();
        let free = 1.0 - floor * shares.len() as f64;
        shares.iter_mut().for_each(|w| *w = floor + free * *w / total);
    }

    fn renew(&mut self) {
        let s = self.estimate.len();
        let n = self.cloud.weights.len();
        let wanted = self.params.adaptive_resampling;
        let needed = wanted == 0.0 || effective(&self.cloud.weights) <= wanted * n as f64;
        let c = &mut self.cloud;
        if self.params.resampling == Resampling::None || !needed {
            for (l, w) in c.carried.iter_mut().zip(&c.weights) {
                *l = libm::log(w.max(f64::MIN_POSITIVE));
            }
            return;
        }
        resample(
            self.params.resampling,
            &c.weights,
            &mut self.rng,
            &mut c.carried,
            &mut c.chosen,
        );
        for (values, spare) in [&mut c.states, &mut c.last].into_iter().zip(&mut c.spare) {
            for (to, &from) in spare.chunks_exact_mut(s).zip(&c.chosen) {
                to.copy_from_slice(&values[from * s..(from + 1) * s]);
            }
            std::mem::swap(values, spare);
        }
        c.carried.fill(0.0);
    }

    fn search(&mut self, image: &Image, b: &mut Buffers) -> Result<(Stop, u32), TrackError> {
        for pass in 0..self.params.max_iters {
            let before = self.probe.ssm.corners();
            self.estimate.copy_from_slice(self.probe.ssm.state());
            self.deal();
            self.scatter(image, pass, b);
            interrupt::check()?;
            if !self.weigh() {
                return Err(TrackError::NotFinite("similarity of all particles"));
            }
            self.before.copy_from_slice(&self.estimate);
            self.conclude()?;
            self.probe.check(image)?;
            if self.params.adapt_sets {
                self.reward_sets();
            }
            let settled = self.probe.settled(&before, &self.before, self.params.epsilon);
            let last = settled || pass + 1 == self.params.max_iters;
            if self.params.reset_to_mean {
                if last && self.params.dynamics == Dynamics::Ar1 {
                    let (ssm, how) = (&self.probe.ssm, self.params.increment());
                    let (from, to) = (&self.frame_start, ssm.state());
                    self.sampler.motion_into(ssm, how, from, to, &mut self.motion)?;
                    let factor = self.params.ar_factor;
                    self.motion.iter_mut().for_each(|m| *m *= factor);
                }
                self.gather();
            } else {
                self.renew();
            }
            if last {
                let stop = if settled { Stop::Converged } else { Stop::Done };
                return Ok((stop, pass as u32 + 1));
            }
        }
        Ok((Stop::Done, self.params.max_iters as u32))
    }

    /// Takes the deviations that the parameters ask for on the present base.
    fn prepare_sampler(&mut self) -> Result<(), TrackError> {
        self.sampler = self.params.deviations().sampler(&self.probe.ssm)?;
        self.sampler.ar_factor = self.params.ar_factor;
        self.sigma = self.sampler.sigma.clone();
        Ok(())
    }

    /// Forgets all motion.
    fn rest(&mut self) {
        self.motion.fill(0.0);
        self.gather();
    }
}

/// Particles side by side, from number `first` on.
struct Share<'a> {
    first: usize,
    states: &'a mut [f64],
    last: &'a mut [f64],
    sets: &'a [usize],
    scores: &'a mut [f64],
}

/// What happens to particles in a pass.
struct Move {
    dynamics: Dynamics,
    how: Increment,
    likelihood: Likelihood,
    /// Each particle draws from a stream of its own, made of this and its number: whichever thread moves it.
    seed: u64,
}

impl Move {
    /// Moves particles and scores them. Interrupted, it leaves out the rest.
    fn make<A: AppearanceModel, S: StateSpaceModel>(
        &self,
        probe: &mut Probe<A, S>,
        sampler: &mut Sampler,
        image: &Image,
        share: Share<'_>,
        b: &mut Buffers,
    ) {
        let s = probe.ssm.dof();
        let states = share.states.chunks_exact_mut(s);
        let particles = states.zip(share.last.chunks_exact_mut(s)).zip(share.sets);
        for ((i, ((p, r), &set)), score) in (share.first as u64..).zip(particles).zip(share.scores) {
            if interrupt::requested() {
                return;
            }
            let mut rng = Pcg64::seed_from_u64(self.seed.wrapping_add(i));
            // A particle that cannot move stays.
            let _ = sampler.transition(set, &mut probe.ssm, self.dynamics, self.how, &mut rng, p, r);
            let there = probe.ssm.set_state(p);
            let f = there.and_then(|()| probe.similarity(image, b));
            *score = match f {
                Ok(_) if self.likelihood == Likelihood::Am => {
                    libm::log(probe.am.likelihood().max(f64::MIN_POSITIVE))
                }
                Ok(f) => f,
                Err(_) => f64::NEG_INFINITY,
            };
            if score.is_nan() {
                *score = f64::NEG_INFINITY;
            }
        }
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

impl<A: AppearanceModel + Clone, S: StateSpaceModel + Clone> Tracker for Pf<A, S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        let image = frame.with_channels(self.channels());
        let mut ws = self.probe.workspace();
        self.probe.start(image, corners, &mut ws)?;
        let top = self.probe.am.similarity();
        let size = if top == 0.0 {
            self.probe.sampling.shape().len() as f64
        } else {
            top.abs()
        };
        self.scale = [top, size];
        self.prepare_sampler()?;
        let (n, s) = (self.params.n_particles, self.probe.ssm.dof());
        let sets = self.sigma.0.len();
        self.cloud = Cloud {
            states: vec![0.0; n * s],
            last: vec![0.0; n * s],
            spare: [vec![0.0; n * s], vec![0.0; n * s]],
            carried: vec![0.0; n],
            scores: vec![0.0; n],
            weights: vec![0.0; n],
            chosen: vec![0; n],
            shares: vec![1.0 / sets as f64; sets],
            sets: vec![0; n],
        };
        self.estimate = vec![0.0; s];
        self.before = vec![0.0; s];
        self.frame_start = vec![0.0; s];
        self.motion = vec![0.0; s];
        self.rng = Pcg64::seed_from_u64(self.seed);
        self.rest();
        self.probe.ready();
        self.helpers.clear();
        if self.threads > 1 {
            let helper = (self.probe.clone(), self.sampler.clone());
            self.helpers.resize(self.threads.min(n), helper);
        }
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        self.probe.check_started()?;
        let image = frame.with_channels(self.channels());
        let mut ws = self.probe.workspace();
        self.probe.begin_frame();
        self.frame_start.copy_from_slice(self.probe.ssm.state());
        // The first patch of a frame is the one at the old place: some models estimate the light from it.
        self.opened = self.probe.look(image, &mut ws).is_ok();
        if self.opened {
            self.probe.am.set_current(&ws.values);
        }
        let found = self
            .search(image, &mut ws)
            .and_then(|done| Ok((done, self.probe.similarity(image, &mut ws)?)));
        match found {
            Ok(((stop, iterations), similarity)) => {
                if self.params.enable_learning.wanted(&mut self.probe.am) {
                    let helpers = self.helpers.iter_mut().map(|(probe, _)| &mut probe.am);
                    for model in std::iter::once(&mut self.probe.am).chain(helpers) {
                        if let Some(learner) = model.learner() {
                            learner.learn(&ws.values);
                        }
                    }
                }
                Ok(Update {
                    corners: self.probe.ssm.corners(),
                    stop,
                    iterations,
                    similarity,
                })
            }
            Err(e) => {
                self.probe.ssm.set_state(&self.frame_start)?;
                self.rest();
                Err(e)
            }
        }
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        if self.probe.set_region(corners)?.is_some() {
            // What moves the corners by so many pixels depends on the base.
            self.prepare_sampler()?;
        }
        for (probe, _) in &mut self.helpers {
            probe.ssm.clone_from(&self.probe.ssm);
        }
        self.rest();
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.probe.ssm.corners()
    }

    fn reseed(&mut self, seed: u64) {
        self.seed = seed;
    }

    fn set_threads(&mut self, threads: usize) {
        self.threads = threads;
    }

    fn channels(&self) -> usize {
        self.probe.sampling.channels.count()
    }

    fn memory(&self) -> usize {
        let needs = self.probe.needs(self.probe.sampling.shape());
        let particle = 8 * (4 * needs.dof + 5);
        let probes = if self.threads > 1 { self.threads + 1 } else { 1 };
        (needs.models().saturating_mul(probes)).saturating_add(particle * self.params.n_particles)
    }

    fn memory_needed(&self) -> usize {
        let shape = self.probe.sampling.shape();
        let scratch = self.probe.needs(shape).scratch(shape.len());
        self.memory()
            .saturating_add(scratch.saturating_mul(self.threads.max(1)))
    }
}

type AllParams = (SamplingParams, PfParams);

/// Fails for a switch that would change nothing, and for samples that the warp does not allow.
fn suits(assignments: &[Assignment<'_>], _: &Capabilities, ssm: &dyn StateSpaceModel) -> Built<()> {
    let (_, params) = AllParams::from_assignments(assignments)?;
    let deviations = params.deviations();
    if params.adapt_sets && deviations.sets() == 1 {
        return Err(ParamError::Unusable {
            name: "adapt_sets",
            value: true.text(),
            reason: "changes nothing with a single set; give sigma several".to_owned(),
        });
    }
    deviations.suit(ssm)
}

/// The table row.
pub(super) const ENTRY: SmEntry = SmEntry::new::<AllParams>(
    "pf",
    "particle filter",
    |a, mut am, ssm| {
        suits(a, &Capabilities::of(&mut *am), &*ssm)?;
        let (sampling, params) = AllParams::from_assignments(a)?;
        Ok(Box::new(Pf::with_params(sampling, params, am, ssm)))
    },
    SmFamily {
        suits,
        uses: &[Use::Scores],
        ..SmFamily::UNDEMANDING
    },
)
.also(&["particle_filter"])
.published("algorithm 7")
.in_groups(&["stochastic"]);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::am::Ssd;
    use crate::ssm::Translation;

    #[test]
    fn a_motion_in_pixels_stays_one_on_another_base() {
        let mut pf = Pf::new(Ssd::default(), Translation::new());
        pf.params.pix_sigma = SigmaSets::single(3.0);
        let image = Image::from_fn(120, 100, |x, y| ((x * x + 7 * y) % 50) as f32);
        pf.init(&Frame::from_gray(image), &Corners::rect(40.0, 40.0, 20.0, 20.0))
            .unwrap();
        let pixels = |pf: &Pf<Ssd, Translation>| pf.sigma.0[0][0] * pf.probe.ssm.base().radius;
        // RMS over both directions of a shift.
        let wanted = 3.0 / 2.0_f64.sqrt();
        assert!((pixels(&pf) / wanted - 1.0).abs() < 0.05);
        // Another size is none that a translation leads to.
        pf.set_region(&Corners::rect(20.0, 20.0, 60.0, 50.0)).unwrap();
        assert!((pixels(&pf) / wanted - 1.0).abs() < 0.05);
    }
}
