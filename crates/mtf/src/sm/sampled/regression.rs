//! Learned regression (Jurie & Dhome 2002, hyperplane approximation; coarse to fine as in Zimmermann, Matas & Svoboda 2009):
//! at the start the region is sampled under many random warps, and ridge regression learns how features of a patch tell
//! the motion that made it. In place of a regression network: one linear layer per level.
//!
//! A level learns from motions of one size; a frame passes the levels from coarse to fine and repeats the last one; steps
//! that make the patch less similar are not taken. Patches are means over cells of the sampling grid, which keeps out what the
//! cells cannot resolve. Motions are those of the four corners, so that any warp that composes takes the increment that fits
//! them best.

use super::probe::{Probe, number};
use super::ridge::ridge;
use crate::am::{AppearanceModel, Metric, PatchShape};
use crate::geom::{Corners, homography};
use crate::image::{Frame, Image};
use crate::interrupt;
use crate::kernels;
use crate::params::{Params, Resolution, Use};
use crate::sm::sampling::SamplingParams;
use crate::sm::workspace::Buffers;
use crate::sm::{SmEntry, SmFamily};
use crate::ssm::{Increment, Perturbation, SampleUnit, Sampler, SigmaSets, StateSpaceModel};
use crate::tracker::{Stop, TrackError, Tracker, Update};
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// Common shift and single coordinate of the corners, px: from what ESM is lost in down to where it converges, in steps
/// that each level's error stays within.
const LEVELS: [[f64; 2]; 8] = [
    [24.0, 16.0],
    [20.0, 12.0],
    [16.0, 8.0],
    [12.0, 6.0],
    [8.0, 4.0],
    [4.0, 2.0],
    [2.0, 1.0],
    [1.0, 0.5],
];

crate::params! {
    /// Parameters of learned regression.
    pub struct RegressionParams {
        /// Samples per level.
        n_samples: usize = 1000, in 2..=1_000_000;
        /// Most steps per frame: one per level, the others at the last.
        max_iters: usize = 20, in 1..=100_000;
        /// Converged when the corners' squared motion, summed over all eight coordinates, falls below this; px².
        epsilon: f64 = 1e-4, in 0.0..=1e6;
        /// What is disturbed: corners, points or params.
        perturb: Perturbation = Perturbation::Corners;
        /// Unit of lengths in sigma: px, or side (1 is the side of the region as a square).
        unit: SampleUnit = SampleUnit::Pixels;
        /// Standard deviations of samples, a set per level, the coarsest first: common shift and single coordinate (COMMON:SINGLE) in
        /// what unit names, or one per parameter, in the parameter's unit.
        sigma: SigmaSets = SigmaSets(LEVELS.iter().map(|l| l.to_vec()).collect());
        /// Ridge as a share of the inputs' mean square.
        ridge: f64 = 0.1, in 1e-9..=1e3;
        /// Samples along each side of a cell.
        pool: usize = 2, in 1..=100;
    }
}

/// Coordinates of four corners.
const OUTPUTS: usize = 8;

/// Learned regression over appearance model `A` and warp `S`.
pub struct Regression<A, S> {
    /// Search parameters; changes take effect at the next `init`.
    pub params: RegressionParams,
    probe: Probe<A, S>,
    seed: u64,
    /// Feature of the template.
    template: Vec<f32>,
    /// Per level: motion of the corners (base, px) for each number of a feature less the template's; a row per coordinate.
    levels: Vec<Vec<f32>>,
    /// Corners of the base in which the levels were learned.
    base: Corners,
    cells: Vec<f32>,
    feature: Vec<f32>,
    delta: Vec<f64>,
    accepted: Vec<f64>,
}

/// Means over `pool x pool` cells of the patch; cells differ in size by one sample where the sides are no multiples.
fn pool_into(patch: &[f32], shape: PatchShape, small: Resolution, out: &mut [f32]) {
    let Resolution { cols, rows } = shape.res;
    let bounds = |k: usize, n: usize, count: usize| k * count / n..(k + 1) * count / n;
    for (c, plane) in patch.chunks_exact(cols * rows).enumerate() {
        for r in 0..small.rows {
            for q in 0..small.cols {
                let (ys, xs) = (bounds(r, small.rows, rows), bounds(q, small.cols, cols));
                let count = (ys.len() * xs.len()) as f32;
                let sum: f32 = ys
                    .map(|y| plane[y * cols..][xs.clone()].iter().sum::<f32>())
                    .sum();
                out[(c * small.rows + r) * small.cols + q] = sum / count;
            }
        }
    }
}

impl<A: AppearanceModel, S: StateSpaceModel> Regression<A, S> {
    /// With default parameters.
    pub fn new(am: A, ssm: S) -> Self {
        Self::with_params(SamplingParams::default(), RegressionParams::default(), am, ssm)
    }

    /// With all parameters.
    pub fn with_params(sampling: SamplingParams, params: RegressionParams, am: A, ssm: S) -> Self {
        Regression {
            params,
            probe: Probe::new(sampling, am, ssm),
            seed: 0,
            template: Vec::new(),
            levels: Vec::new(),
            base: Corners::default(),
            cells: Vec::new(),
            feature: Vec::new(),
            delta: Vec::new(),
            accepted: Vec::new(),
        }
    }

    /// Shape of the pooled patch.
    fn shape(&self) -> PatchShape {
        let Resolution { cols, rows } = self.probe.sampling.res;
        let side = |n: usize| (n / self.params.pool).clamp(2, n);
        PatchShape {
            res: Resolution {
                cols: side(cols),
                rows: side(rows),
            },
            channels: self.channels(),
        }
    }

    /// Pools the patch in `b` and takes its feature, less the template's.
    fn describe(&mut self, b: &Buffers) -> Result<(), TrackError> {
        pool_into(
            &b.values,
            self.probe.sampling.shape(),
            self.shape().res,
            &mut self.cells,
        );
        self.probe
            .distances()?
            .feature_into(&self.cells, &mut self.feature);
        for (f, t) in self.feature.iter_mut().zip(&self.template) {
            *f -= t;
        }
        Ok(())
    }

    /// Learns one level.
    fn learn_level(&mut self, image: &Image, level: usize, b: &mut Buffers) -> Result<Vec<f32>, TrackError> {
        let p = &self.params;
        let mut sampler = Sampler::new(p.perturb, p.unit, p.sigma.clone());
        sampler.check(&self.probe.ssm)?;
        let (n, s, inputs) = (p.n_samples, self.delta.len(), self.template.len());
        let kappa = p.ridge;
        let (mut x, mut y) = (vec![0.0; n * inputs], vec![0.0; n * OUTPUTS]);
        let mut work = vec![0.0; 2 * s];
        let home = vec![0.0; s];
        let mut rng = Pcg64::seed_from_u64(self.seed.wrapping_add(level as u64));
        let from = self.base.to_array();
        for (x, y) in x.chunks_exact_mut(inputs).zip(y.chunks_exact_mut(OUTPUTS)) {
            interrupt::check()?;
            self.probe
                .look_around(image, &mut sampler, level, &mut rng, &mut work, b)?;
            self.describe(b)?;
            x.copy_from_slice(&self.feature);
            let ssm = &self.probe.ssm;
            ssm.relative_into(ssm.state(), &home, &mut self.delta)?;
            let to = ssm.corners_at(&self.delta).to_array();
            y.iter_mut()
                .zip(to.iter().zip(from))
                .for_each(|(y, (t, f))| *y = t - f);
        }
        self.probe.ssm.set_state(&home)?;
        ridge(&x, &y, inputs, OUTPUTS, kappa)?.ok_or(TrackError::Singular)
    }

    /// One step with a level.
    fn step(&mut self, image: &Image, level: usize, b: &mut Buffers) -> Result<(), TrackError> {
        self.probe.look(image, b)?;
        self.describe(b)?;
        let motion = |o: usize| {
            let n = self.feature.len();
            kernels::dot(&self.levels[level][o * n..(o + 1) * n], &self.feature)
        };
        let mut to = self.base.to_array();
        to.iter_mut().enumerate().for_each(|(o, v)| *v += motion(o));
        if to.iter().any(|v| !v.is_finite()) {
            return Err(TrackError::NotFinite("motion"));
        }
        let mut to = Corners::from_array(to);
        let ssm = &mut self.probe.ssm;
        let base = ssm.base().corners_in_image();
        if base != self.base {
            let carry = homography::from_corners(&self.base, &base)
                .ok_or(TrackError::BadRegion("corners are no convex quadrilateral"))?;
            to = homography::apply_corners(&carry, &to);
        }
        ssm.fit_into(&base.0, &to.0, &mut self.delta)?;
        ssm.update(Increment::Compositional, &self.delta)?;
        self.probe.check(image)
    }

    fn search(&mut self, image: &Image, b: &mut Buffers) -> Result<(Stop, u32), TrackError> {
        let last = self.levels.len() - 1;
        let steps = self.params.max_iters.max(last + 1);
        let mut best = self.similarity(image, b)?;
        if best.is_nan() {
            return Err(TrackError::NotFinite("similarity"));
        }
        for k in 0..steps {
            interrupt::check()?;
            let before = self.probe.ssm.corners();
            self.accepted.copy_from_slice(self.probe.ssm.state());
            let f = self
                .step(image, k.min(last), b)
                .and_then(|()| self.similarity(image, b))
                .unwrap_or(f64::NEG_INFINITY);
            // A level that sees what it has not learned leads away: the finer ones take over from the old place.
            let better = f > best;
            if better {
                best = f;
            } else {
                self.probe.ssm.set_state(&self.accepted)?;
            }
            let still = self.probe.settled(&before, &self.accepted, self.params.epsilon);
            if k >= last && (still || !better) {
                return Ok((Stop::Converged, k as u32 + 1));
            }
        }
        Ok((Stop::MaxIterations, steps as u32))
    }

    /// Similarity of the pooled patch at the present state.
    fn similarity(&mut self, image: &Image, b: &mut Buffers) -> Result<f64, TrackError> {
        self.probe.look(image, b)?;
        self.describe(b)?;
        number(self.probe.am.score(&self.cells))
    }
}

impl<A: AppearanceModel, S: StateSpaceModel> Tracker for Regression<A, S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        let image = frame.with_channels(self.channels());
        let mut ws = self.probe.workspace();
        self.probe.place(image, corners, &mut ws)?;
        let shape = self.shape();
        self.cells = vec![0.0; shape.len()];
        pool_into(
            &ws.values,
            self.probe.sampling.shape(),
            shape.res,
            &mut self.cells,
        );
        self.probe.am.set_template(shape, &self.cells)?;
        let distances = self.probe.distances()?;
        let inputs = distances.feature_len();
        self.template = vec![0.0; inputs];
        self.feature = vec![0.0; inputs];
        distances.feature_into(&self.cells, &mut self.template);
        self.delta = vec![0.0; self.probe.ssm.dof()];
        self.accepted = self.delta.clone();
        self.base = self.probe.ssm.base().corners_in_image();
        self.levels = (0..self.params.sigma.0.len())
            .map(|level| self.learn_level(image, level, &mut ws))
            .collect::<Result<_, _>>()?;
        self.probe.ready();
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        self.probe.check_started()?;
        let image = frame.with_channels(self.channels());
        let mut ws = self.probe.workspace();
        self.probe.begin_frame();
        let (stop, iterations) = self.search(image, &mut ws)?;
        let similarity = self.similarity(image, &mut ws)?;
        Ok(Update {
            corners: self.probe.ssm.corners(),
            stop,
            iterations,
            similarity,
        })
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.probe.set_region(corners)?;
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.probe.ssm.corners()
    }

    fn reseed(&mut self, seed: u64) {
        self.seed = seed;
    }

    fn channels(&self) -> usize {
        self.probe.sampling.channels.count()
    }

    fn memory(&self) -> usize {
        let needs = self.probe.needs(self.shape());
        let levels = OUTPUTS * self.params.sigma.0.len() + 3;
        (needs.models()).saturating_add(4 * needs.feature.saturating_mul(levels))
    }

    fn memory_needed(&self) -> usize {
        let needs = self.probe.needs(self.shape());
        let (n, inputs) = (self.params.n_samples, needs.feature);
        // Samples twice, by row and by column; their products in a matrix of the smaller order, twice.
        let samples = n.saturating_mul(8 * inputs + 16 * OUTPUTS);
        let products = n.min(inputs).saturating_pow(2).saturating_mul(16);
        let scratch = needs.scratch(self.probe.sampling.shape().len());
        [samples, products, scratch]
            .into_iter()
            .fold(self.memory(), usize::saturating_add)
    }
}

type AllParams = (SamplingParams, RegressionParams);

/// The table row.
pub(super) const ENTRY: SmEntry = SmEntry::new::<AllParams>(
    "regression",
    "ridge regression from patch to motion, learned on the first frame, coarse to fine",
    |a, am, ssm| {
        let (sampling, params) = AllParams::from_assignments(a)?;
        Ok(Box::new(Regression::with_params(sampling, params, am, ssm)))
    },
    SmFamily {
        refuses: |_, am| {
            (am.metric != Some(Metric::SquaredL2)).then_some("has no features with Euclidean distances")
        },
        refuses_ssm: |ssm| (!ssm.compositional).then_some("does not compose"),
        uses: &[Use::Distances],
        ..SmFamily::UNDEMANDING
    },
)
.also(&["lr"])
.in_groups(&["learned"]);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_means() {
        let shape = PatchShape {
            res: Resolution { cols: 5, rows: 4 },
            channels: 2,
        };
        let patch: Vec<f32> = (0..40).map(|v| v as f32).collect();
        let small = Resolution { cols: 2, rows: 2 };
        let mut out = [0.0; 8];
        pool_into(&patch, shape, small, &mut out);
        // Columns 0, 1 and 2, 3, 4; rows 0, 1 and 2, 3.
        assert_eq!(out, [3.0, 5.5, 13.0, 15.5, 23.0, 25.5, 33.0, 35.5]);
        let same = shape.res;
        let mut copy = [0.0; 40];
        pool_into(&patch, shape, same, &mut copy);
        assert_eq!(copy[..], patch[..]);
    }
}
