//! NN, nearest-neighbour search (Dick, Perez, Jagersand & Shademan 2013): at the start the region is sampled under many
//! random warps `Δ⁻¹`; a patch that looks like sample `k` is brought back by `Δ_k`.
//!
//! With several neighbours the patch is first written as the combination of them that comes nearest, weights adding up to one
//! (the local reconstruction of Roweis & Saul 2000), and the same combination of their increments is applied.

use super::deviations::Deviations;
use super::index::{self, Centres, Features, Index, IndexKind, IndexSettings, Judge, Nearest};
use super::probe::Probe;
use super::step::Step;
use crate::am::{AppearanceModel, Capabilities, Metric};
use crate::geom::solve::{SymMatrix, solve_negative};
use crate::geom::{Corners, homography};
use crate::image::{Frame, Image};
use crate::interrupt;
use crate::kernels;
use crate::params::{Assignment, Built, ParamError, ParamValue, Params, Use};
use crate::sm::sampling::SamplingParams;
use crate::sm::workspace::Buffers;
use crate::sm::{SmEntry, SmFamily};
use crate::ssm::{Dynamics, Increment, Perturbation, SampleUnit, SigmaSets, StateSpaceModel};
use crate::tracker::{Stop, TrackError, Tracker, Update};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

crate::params! {
    /// Parameters of nearest-neighbour search.
    pub struct NnParams {
        /// Samples, the undisturbed region included.
        n_samples: usize = 2000, in 2..=1_000_000;
        /// Most iterations per frame.
        max_iters: usize = 10, in 1..=100_000, paper 1 => "each further look starts nearer: AUC .962 against .692";
        /// Converged when the corners' squared motion, summed over all eight coordinates, falls below this; px².
        epsilon: f64 = 1e-4, in 0.0..=1e6;
        /// Increments are additive or compositional.
        update: Step = Step::Compositional;
        /// What is disturbed: corners, points, params, or geometric (affine, similitude: shift, scale, angles).
        perturb: Perturbation = Perturbation::Corners;
        /// Unit of lengths in sigma: px, or side (1 is the side of the region as a square).
        unit: SampleUnit = SampleUnit::Pixels;
        /// Standard deviations of samples: common shift and single coordinate (COMMON:SINGLE) in what unit names, or one per
        /// parameter, in the parameter's unit (shifts as unit names, angles in rad); sets separated by '|' share the samples.
        sigma: SigmaSets = SigmaSets(
            [0.25, 0.5, 1.0, 2.0, 4.0, 8.0].iter().map(|t| vec![*t, 0.5 * t]).collect()
        );
        /// If not 0: the parameters are disturbed, with deviations estimated such that the corners move by so many px (RMS), instead
        /// of what perturb, unit and sigma say; sets separated by '|'.
        pix_sigma: SigmaSets = SigmaSets::single(0.0);
        /// Nearest samples by: linear, hierarchical, gnn, fgnn; kd (distances of vectors); kmeans, composite of kd and kmeans
        /// (Euclidean distances); auto.
        index: IndexKind = IndexKind::Auto;
        /// kd, kmeans, composite, hierarchical: samples whose full distance is compared; clusters are compared whole.
        candidates: usize = 64, in 1..=1_000_000;
        /// kmeans, composite, hierarchical: clusters that one is divided into.
        branching: usize = 32, in 2..=1000;
        /// kmeans, composite, hierarchical: first centres are random, gonzales (each the farthest from those before) or kmeanspp.
        centres: Centres = Centres::Random;
        /// kmeans, composite: most iterations of k-means.
        kmeans_iters: usize = 11, in 0..=100_000;
        /// kmeans, composite: how much sooner clusters of large variance are looked at; factor of the variance beside the squared distance.
        cb_index: f64 = 0.2, in 0.0..=100.0;
        /// hierarchical: trees.
        trees: usize = 4, in 1..=100;
        /// hierarchical: largest cluster that is not divided.
        leaf: usize = 100, in 1..=1_000_000;
        /// gnn, fgnn: links of each sample.
        degree: usize = 100, in 1..=100_000;
        /// gnn, fgnn: most steps of a walk.
        max_steps: usize = 10, in 1..=100_000;
        /// Neighbours combined by local reconstruction; 1: the nearest alone.
        neighbours: usize = 1, in 1..=1000;
        /// Local reconstruction: ridge as a share of the trace.
        ridge: f64 = 1e-3, in 1e-9..=1e3;
    }
}

impl NnParams {
    fn deviations(&self) -> Deviations<'_> {
        Deviations {
            perturb: self.perturb,
            unit: self.unit,
            sigma: &self.sigma,
            pix_sigma: &self.pix_sigma,
        }
    }

    /// Settings of an index of this kind, its random choices from `seed`.
    pub(super) fn index_settings(&self, kind: IndexKind, seed: u64) -> IndexSettings {
        IndexSettings {
            kind,
            candidates: self.candidates,
            degree: self.degree,
            max_steps: self.max_steps,
            branching: self.branching,
            centres: self.centres,
            seed,
            kmeans_iters: self.kmeans_iters,
            cb_index: self.cb_index,
            trees: self.trees,
            leaf: self.leaf,
        }
    }
}

/// Weights of neighbours.
struct Reconstruction {
    differences: Vec<f32>,
    gram: SymMatrix,
    ones: Vec<f64>,
    weights: Vec<f64>,
    work: Vec<f64>,
}

impl Reconstruction {
    fn new(k: usize, len: usize) -> Self {
        Reconstruction {
            differences: vec![0.0; if k > 1 { k * len } else { 0 }],
            gram: SymMatrix::new(k),
            ones: vec![-1.0; k],
            weights: vec![0.0; k],
            work: vec![0.0; k * k + k],
        }
    }

    /// Weights `w`, `Σ w = 1`, of least `|q - Σ w_i x_i|² + ridge tr(G) |w|²`; false when there are none.
    fn solve(&mut self, query: &[f32], features: &Features, near: &[(f32, usize)], ridge: f64) -> bool {
        if near.len() != self.weights.len() {
            return false;
        }
        let len = query.len();
        for (d, &(_, i)) in self.differences.chunks_exact_mut(len).zip(near) {
            kernels::combine(1.0, query, -1.0, features.row(i), d);
        }
        let d = |i: usize| &self.differences[i * len..(i + 1) * len];
        self.gram.fill(|i, j| -kernels::dot(d(i), d(j)));
        let k = near.len();
        let trace: f64 = (0..k).map(|i| self.gram.get(i, i)).sum();
        // A query that is one of the samples needs something to divide by.
        let floor = (ridge * trace / k as f64).min(-1e-12);
        self.gram.fill_from(|i, j, v| if i == j { v + floor } else { v });
        let solved = solve_negative(&self.gram, 0.0, &self.ones, &mut self.weights, &mut self.work);
        let total: f64 = self.weights.iter().sum();
        self.weights.iter_mut().for_each(|w| *w /= total);
        solved && total > 0.0
    }
}

/// Nearest-neighbour search over appearance model `A` and warp `S`.
pub struct Nn<A, S> {
    /// Search parameters; changes take effect at the next `init`.
    pub params: NnParams,
    probe: Probe<A, S>,
    seed: u64,
    features: Features,
    /// Increment of each sample, S numbers, and the region it leads to from the first base.
    increments: Vec<f64>,
    regions: Vec<Corners>,
    base: Corners,
    index: Index,
    /// As many as there are threads.
    judges: Vec<Judge>,
    threads: usize,
    near: Nearest,
    reconstruction: Reconstruction,
    query: Vec<f32>,
    delta: Vec<f64>,
    /// State of the iteration before, and the best of the frame.
    accepted: Vec<f64>,
    best: Vec<f64>,
}

impl<A: AppearanceModel + Clone + 'static, S: StateSpaceModel + Clone> Nn<A, S> {
    /// With default parameters.
    pub fn new(am: A, ssm: S) -> Self {
        Self::with_params(SamplingParams::default(), NnParams::default(), am, ssm)
    }

    /// With all parameters.
    pub fn with_params(sampling: SamplingParams, params: NnParams, am: A, ssm: S) -> Self {
        Nn {
            params,
            probe: Probe::new(sampling, am, ssm),
            seed: 0,
            features: Features::default(),
            increments: Vec::new(),
            regions: Vec::new(),
            base: Corners::default(),
            index: Index::linear(),
            judges: Vec::new(),
            threads: 1,
            near: Nearest::new(1),
            reconstruction: Reconstruction::new(0, 0),
            query: Vec::new(),
            delta: Vec::new(),
            accepted: Vec::new(),
            best: Vec::new(),
        }
    }

    fn increment(&self) -> Increment {
        match self.params.update {
            Step::Compositional if self.probe.ssm.capabilities().compositional => Increment::Compositional,
            _ => Increment::Additive,
        }
    }

    /// How the samples are indexed whose distances are of this kind.
    fn settings(&self, metric: Metric) -> IndexSettings {
        let p = &self.params;
        let kind = match (p.index, metric) {
            (IndexKind::Auto, Metric::SquaredL2) => IndexKind::Kd,
            (IndexKind::Auto, Metric::L1) => IndexKind::Linear,
            (IndexKind::Auto, Metric::Other) => IndexKind::Fgnn,
            (kind, _) => kind,
        };
        p.index_settings(kind, self.seed)
    }

    /// Bytes kept, and those that the start takes besides.
    fn bytes(&self) -> [usize; 2] {
        let p = &self.params;
        let shape = self.probe.sampling.shape();
        let needs = self.probe.needs(shape);
        let metric = self.probe.am.distances().map_or(Metric::Other, |d| d.metric());
        let [index, making] = self
            .settings(metric)
            .memory(p.n_samples, needs.feature, self.threads);
        let sample = 4 * needs.feature + 8 * needs.dof + size_of::<Corners>();
        let near = if p.neighbours > 1 {
            p.neighbours.min(p.n_samples) * (4 * needs.feature + 16 * p.neighbours)
        } else {
            0
        };
        let kept = (needs.models().saturating_mul(1 + self.threads))
            .saturating_add(p.n_samples.saturating_mul(sample))
            .saturating_add(index)
            .saturating_add(near);
        let copies = if self.threads > 1 { self.threads } else { 0 };
        let passing = (needs.models().saturating_mul(copies))
            .saturating_add(needs.scratch(shape.len()).saturating_mul(self.threads))
            .saturating_add(8 * needs.dof * p.n_samples)
            .saturating_add(making);
        [kept, passing]
    }

    /// Makes the samples from the first frame.
    fn collect(&mut self, image: &Image, b: &mut Buffers) -> Result<(), TrackError> {
        let p = &self.params;
        let (n, s) = (p.n_samples, self.probe.ssm.dof());
        let mut sampler = p.deviations().sampler(&self.probe.ssm)?;
        let len = self.probe.distances()?.feature_len();
        self.features = Features {
            values: vec![0.0; n * len],
            len,
        };
        self.increments = vec![0.0; n * s];
        self.base = self.probe.ssm.base().corners_in_image();
        self.regions = vec![self.base; n];
        let mut rng = Pcg64::seed_from_u64(self.seed);
        let (home, mut last) = (vec![0.0; s], vec![0.0; s]);
        let mut states = vec![0.0; n * s];
        let additive = self.increment() == Increment::Additive;
        let ssm = &mut self.probe.ssm;
        let samples = states
            .chunks_exact_mut(s)
            .zip(self.increments.chunks_exact_mut(s));
        for (i, (state, d)) in samples.enumerate().skip(1) {
            interrupt::check()?;
            let set = sampler.sigma.set_of(i - 1, n - 1);
            let (walk, how) = (Dynamics::RandomWalk, Increment::Compositional);
            sampler.transition(set, ssm, walk, how, &mut rng, state, &mut last)?;
            if additive {
                d.iter_mut().zip(&*state).for_each(|(d, p)| *d = -p);
            } else {
                ssm.relative_into(state, &home, d)?;
            }
            self.regions[i] = ssm.corners_at(d);
        }
        let rows = self
            .features
            .values
            .chunks_exact_mut(len)
            .zip(states.chunks_exact(s));
        let show = |probe: &mut Probe<A, S>, b: &mut Buffers, row: &mut [f32], state: &[f64]| {
            interrupt::check()?;
            probe.ssm.set_state(state)?;
            // Whatever lies outside the image has the border's value, here as on every frame.
            let _ = probe.look(image, b);
            probe.distances()?.feature_into(&b.values, row);
            Ok::<(), TrackError>(())
        };
        if self.threads == 1 {
            for (row, state) in rows {
                show(&mut self.probe, b, row, state)?;
            }
        } else {
            let mut probes = vec![self.probe.clone(); self.threads];
            let share = n.div_ceil(self.threads);
            let rows = self.features.values.par_chunks_mut(share * len);
            let shares = rows.zip(states.par_chunks(share * s));
            let token = interrupt::current();
            probes
                .par_iter_mut()
                .zip(shares)
                .try_for_each(|(probe, (rows, states))| {
                    let mut ws = probe.workspace();
                    let mut rows = rows.chunks_exact_mut(len).zip(states.chunks_exact(s));
                    let mut all = || rows.try_for_each(|(row, state)| show(probe, &mut ws, row, state));
                    interrupt::under(token.clone(), &mut all)
                })?;
        }
        self.probe.ssm.set_state(&home)
    }

    /// Feature of the patch at the present state; its distance from the template's.
    fn ask(&mut self, image: &Image, b: &mut Buffers) -> Result<f32, TrackError> {
        self.probe.look(image, b)?;
        let distances = self.probe.distances()?;
        distances.feature_into(&b.values, &mut self.query);
        let d = distances.distance(&self.query, self.features.row(0), f32::INFINITY);
        if d.is_finite() {
            Ok(d)
        } else {
            Err(TrackError::NotFinite("distance"))
        }
    }

    /// Increment for the present query.
    fn answer(&mut self) -> Result<(), TrackError> {
        self.index
            .find(&mut self.judges, &self.features, &self.query, &mut self.near);
        let near = &self.near.found;
        let nearest = near.first().ok_or(TrackError::NotFinite("distance"))?.1;
        let s = self.delta.len();
        let row = |i: usize| &self.increments[i * s..(i + 1) * s];
        let combined = self.params.neighbours > 1
            && self
                .reconstruction
                .solve(&self.query, &self.features, near, self.params.ridge);
        if combined {
            self.delta.fill(0.0);
            for (&(_, i), w) in near.iter().zip(&self.reconstruction.weights) {
                self.delta.iter_mut().zip(row(i)).for_each(|(d, v)| *d += w * v);
            }
        } else {
            self.delta.copy_from_slice(row(nearest));
        }
        Ok(())
    }

    fn search(&mut self, image: &Image, b: &mut Buffers) -> Result<(Stop, u32), TrackError> {
        let how = self.increment();
        let mut least = f32::INFINITY;
        let mut iterations = 0;
        let mut stop = Stop::MaxIterations;
        while iterations < self.params.max_iters {
            interrupt::check()?;
            iterations += 1;
            let distance = self.ask(image, b)?;
            if distance < least {
                least = distance;
                self.best.copy_from_slice(self.probe.ssm.state());
            }
            self.answer()?;
            // What was found in a part of the samples is no answer.
            interrupt::check()?;
            let before = self.probe.ssm.corners();
            self.accepted.copy_from_slice(self.probe.ssm.state());
            self.probe.ssm.update(how, &self.delta)?;
            self.probe.check(image)?;
            if self.probe.settled(&before, &self.accepted, self.params.epsilon) {
                stop = Stop::Converged;
                break;
            }
        }
        // Steps between samples may go to and fro: the place that looks most like the template counts.
        if self.ask(image, b).is_ok_and(|distance| distance > least) {
            self.probe.ssm.set_state(&self.best)?;
        }
        Ok((stop, iterations as u32))
    }
}

impl<A: AppearanceModel + Clone + 'static, S: StateSpaceModel + Clone> Tracker for Nn<A, S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        let image = frame.with_channels(self.channels());
        let mut ws = self.probe.workspace();
        self.probe.start(image, corners, &mut ws)?;
        self.judges.clear();
        let judge = || Judge::new(self.probe.am.clone());
        self.judges.resize_with(self.threads, judge);
        self.collect(image, &mut ws)?;
        let settings = self.settings(self.probe.distances()?.metric());
        self.index = Index::new(&mut self.judges, &self.features, &settings)?;
        let p = &self.params;
        let (k, s, len) = (
            p.neighbours.min(p.n_samples),
            self.probe.ssm.dof(),
            self.features.len,
        );
        self.near = Nearest::new(k);
        self.reconstruction = Reconstruction::new(k, len);
        self.query = vec![0.0; len];
        self.delta = vec![0.0; s];
        self.accepted = vec![0.0; s];
        self.best = vec![0.0; s];
        self.probe.ready();
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        self.probe.check_started()?;
        let image = frame.with_channels(self.channels());
        let mut ws = self.probe.workspace();
        self.probe.begin_frame();
        self.accepted.copy_from_slice(self.probe.ssm.state());
        let found = self
            .search(image, &mut ws)
            .and_then(|done| Ok((done, self.probe.similarity(image, &mut ws)?)));
        match found {
            Ok(((stop, iterations), similarity)) => Ok(Update {
                corners: self.probe.ssm.corners(),
                stop,
                iterations,
                similarity,
            }),
            Err(e) => {
                // The step that led nowhere is undone.
                self.probe.ssm.set_state(&self.accepted)?;
                Err(e)
            }
        }
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        if self.probe.set_region(corners)?.is_none() {
            return Ok(());
        }
        // Another base: what led from the first base to a region now leads from the new one to that region's image.
        let ssm = &self.probe.ssm;
        let base = ssm.base().corners_in_image();
        let carry = homography::from_corners(&self.base, &base)
            .ok_or(TrackError::BadRegion("corners are no convex quadrilateral"))?;
        let s = self.delta.len();
        for (d, region) in self.increments.chunks_exact_mut(s).zip(&self.regions) {
            let to = homography::apply_corners(&carry, region);
            if ssm.fit_into(&base.0, &to.0, d).is_err() {
                d.fill(0.0);
            }
        }
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.probe.ssm.corners()
    }

    fn reseed(&mut self, seed: u64) {
        self.seed = seed;
    }

    fn set_threads(&mut self, threads: usize) {
        self.threads = threads.max(1);
    }

    fn channels(&self) -> usize {
        self.probe.sampling.channels.count()
    }

    fn memory(&self) -> usize {
        self.bytes()[0]
    }

    fn memory_needed(&self) -> usize {
        let [kept, passing] = self.bytes();
        kept.saturating_add(passing)
    }
}

type AllParams = (SamplingParams, NnParams);

/// Fails when the parameters ask for an index or a number of neighbours that the appearance model does not allow, or for
/// samples that the warp does not.
fn suits(assignments: &[Assignment<'_>], am: &Capabilities, ssm: &dyn StateSpaceModel) -> Built<()> {
    let (_, params) = AllParams::from_assignments(assignments)?;
    let metric = am.metric.unwrap_or(Metric::Other);
    let distances = match metric {
        Metric::SquaredL2 => "Euclidean",
        Metric::L1 => "sums of absolute differences",
        Metric::Other => "not those of vectors",
    };
    let refused = |name, value: String, allowed: String| {
        Err(ParamError::Value {
            name,
            value,
            allowed: format!("{allowed} with an appearance model whose distances are {distances}"),
        })
    };
    if !index::valid(params.index, metric) {
        return refused("index", params.index.text(), index::valid_names(metric));
    }
    if params.neighbours > 1 && metric == Metric::Other {
        return refused("neighbours", params.neighbours.text(), "1".to_owned());
    }
    params.deviations().suit(ssm)
}

/// The table row.
pub(super) const ENTRY: SmEntry = SmEntry::new::<AllParams>(
    "nn",
    "nearest neighbour among samples of the first frame",
    |a, mut am, ssm| {
        suits(a, &Capabilities::of(&mut *am), &*ssm)?;
        let (sampling, params) = AllParams::from_assignments(a)?;
        Ok(Box::new(Nn::with_params(sampling, params, am, ssm)))
    },
    SmFamily {
        refuses: |_, am| {
            am.metric
                .is_none()
                .then_some("has no feature to measure distances by")
        },
        suits,
        uses: &[Use::Distances],
        ..SmFamily::UNDEMANDING
    },
)
.also(&["nearest_neighbour"])
.published("algorithm 6")
.in_groups(&["stochastic"]);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::am::Ssd;
    use crate::ssm::Translation;

    /// Waves of several lengths, moved by `(dx, dy)` px.
    fn frame([dx, dy]: [f64; 2]) -> Frame {
        let texture = |x: f64, y: f64| {
            let wave = |a: f64, b: f64, c: f64| libm::sin(a * x + b * y + c);
            128.0 + 40.0 * wave(0.21, 0.13, 0.4) + 35.0 * wave(-0.11, 0.27, 1.9)
        };
        let value = |x: usize, y: usize| texture(x as f64 - dx, y as f64 - dy) as f32;
        Frame::from_gray(Image::from_fn(200, 180, value))
    }

    /// Few samples lead to and fro. The best of all places seen counts, so that more iterations never make it worse.
    #[test]
    fn searches_of_more_iterations_end_no_farther_from_the_template() {
        let mut returned = 0;
        for seed in 0..8 {
            let reached = |max_iters: usize| {
                let params = NnParams {
                    n_samples: 12,
                    max_iters,
                    epsilon: 0.0,
                    sigma: SigmaSets::single(5.0),
                    ..NnParams::default()
                };
                let sampling = SamplingParams::default();
                let mut tracker = Nn::with_params(sampling, params, Ssd::default(), Translation::new());
                tracker.reseed(seed);
                tracker
                    .init(&frame([0.0; 2]), &Corners::rect(70.0, 60.0, 50.0, 50.0))
                    .unwrap();
                tracker.update(&frame([4.3, -3.1])).unwrap().similarity
            };
            let reached: Vec<f64> = (1..9).map(reached).collect();
            assert!(reached.is_sorted(), "{seed} {reached:?}");
            returned += reached.windows(2).filter(|pair| pair[0] == pair[1]).count();
        }
        assert!(returned > 0);
    }
}
