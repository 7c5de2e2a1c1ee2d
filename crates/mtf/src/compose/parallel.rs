//! Parallel: trackers side by side from the same place; the answer is a mean of theirs (Singh & Jagersand, *Modular Tracking
//! Framework*, composite trackers). Members without an answer do not count.

use super::entry::{CompositeEntry, CompositeFamily, build_all};
use super::history::{History, Recall};
use super::members::Members;
use crate::geom::Corners;
use crate::image::Frame;
use crate::interrupt;
use crate::params::{Params, Resolution, param_enum};
use crate::ssm::{self, SsmName, StateSpaceModel};
use crate::tracker::{Stop, TrackError, Tracker, Update};
use std::sync::Arc;

param_enum! {
    /// How the members' answers become one.
    pub enum Combination {
        /// Mean of each corner.
        MeanCorners = "mean_corners",
        /// Median of each coordinate of each corner: up to half of the members may be wrong.
        MedianCorners = "median_corners",
        /// Mean of the states that the corners are in a state space model, on its group where it is one.
        MeanStates = "mean_states",
    }
}

crate::params! {
    /// Parameters of [`Parallel`].
    pub struct ParallelParams {
        /// Combination of the answers: mean_corners, median_corners or mean_states.
        estimate: Combination = Combination::MeanCorners;
        /// State space model of mean_states.
        state_ssm: SsmName = SsmName::default();
        /// All members start from the common answer in the next frame.
        reset_to_mean: bool = true;
        /// Start anew from a frame before when a member is far from the common answer.
        auto_reinit: bool = false;
        /// Mean corner distance of a member to the common answer beyond which they disagree, px.
        reinit_err_thresh: f64 = 10.0, in 0.0..=1e4;
        /// How many frames before the present one all members are started anew.
        reinit_frame_gap: usize = 10, in 1..=1000;
    }
}

/// The table row.
pub(super) const ENTRY: CompositeEntry = CompositeEntry::new::<ParallelParams>(
    "parallel",
    "side by side from the same place; the answer is a mean",
    |a, parts| {
        let (params, members) = (ParallelParams::from_assignments(a)?, parts.makes());
        let by_states = params.estimate == Combination::MeanStates;
        let warp = by_states
            .then(|| parts.warp("state_ssm", &params.state_ssm))
            .transpose()?;
        Ok(Arc::new(move || {
            let ssm = warp.as_ref().map(|warp| warp.build()).transpose()?;
            Ok(Box::new(Parallel::new(params.clone(), build_all(&members)?, ssm)))
        }))
    },
    CompositeFamily { members: (1, 64) },
)
.also(&["prl"])
.published("section 3.2");

/// Trackers side by side.
pub struct Parallel {
    params: ParallelParams,
    members: Members,
    answers: Vec<Corners>,
    /// The common answer.
    corners: Corners,
    /// For the mean of states: base at the corners before.
    ssm: Option<Box<dyn StateSpaceModel>>,
    states: Vec<f64>,
    mean: Vec<f64>,
    history: History,
}

impl Parallel {
    /// From its members, at least one, and the model of the states whose mean is taken; without a model,
    /// [`Combination::MeanStates`] is a mean of corners.
    pub fn new(
        params: ParallelParams,
        members: Vec<Box<dyn Tracker>>,
        ssm: Option<Box<dyn StateSpaceModel>>,
    ) -> Self {
        Parallel {
            answers: Vec::with_capacity(members.len()),
            history: History::new(params.auto_reinit, params.reinit_frame_gap),
            params,
            members: Members::new(members),
            corners: Corners::default(),
            ssm,
            states: Vec::new(),
            mean: Vec::new(),
        }
    }

    /// The answers as one.
    fn combine(&mut self) -> Result<Corners, TrackError> {
        let n = self.answers.len();
        let each = |f: &dyn Fn(usize, usize) -> f64| Corners(std::array::from_fn(|i| [f(i, 0), f(i, 1)]));
        let answers = &self.answers;
        Ok(match (self.params.estimate, &mut self.ssm) {
            (Combination::MedianCorners, _) => each(&|i, k| {
                let mut values: Vec<f64> = answers.iter().map(|a| a.0[i][k]).collect();
                values.sort_unstable_by(f64::total_cmp);
                (values[(n - 1) / 2] + values[n / 2]) / 2.0
            }),
            (Combination::MeanStates, Some(ssm)) => {
                ssm.rebase(&self.corners)?;
                self.states.clear();
                for answer in answers {
                    ssm.fit_corners(answer)?;
                    self.states.extend_from_slice(ssm.state());
                }
                let weights = vec![1.0; n];
                self.mean.resize(ssm.dof(), 0.0);
                ssm::mean_into(
                    ssm::Mean::Group,
                    ssm.as_ref(),
                    &self.states,
                    &weights,
                    &mut self.mean,
                )?;
                ssm.set_state(&self.mean)?;
                ssm.corners()
            }
            _ => each(&|i, k| answers.iter().map(|a| a.0[i][k]).sum::<f64>() / n as f64),
        })
    }
}

impl Recall for Parallel {
    fn restart(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.corners = *corners;
        self.members.init(frame, corners)
    }

    fn step(&mut self, frame: &Frame) -> (Result<Update, TrackError>, bool) {
        let mut error = TrackError::NotInitialised;
        let (mut iterations, mut similarity) = (0, f64::NAN);
        self.answers.clear();
        for member in self.members.iter_mut() {
            match member.update(frame) {
                Ok(update) => {
                    self.answers.push(update.corners);
                    iterations += update.iterations;
                    // The first member speaks for all: members may measure in different units.
                    if similarity.is_nan() {
                        similarity = update.similarity;
                    }
                }
                Err(e) => error = e,
            }
        }
        if let Err(e) = interrupt::check() {
            return (Err(e.into()), false);
        }
        if self.answers.is_empty() {
            return (Err(error), true);
        }
        let corners = match self.combine() {
            Ok(corners) => corners,
            Err(e) => return (Err(e), true),
        };
        let limit = self.params.reinit_err_thresh;
        let near = |a: &Corners| a.mean_distance(&corners) <= limit;
        let doubt = self.answers.len() < self.members.len() || !self.answers.iter().all(near);
        self.corners = corners;
        if self.params.reset_to_mean {
            for member in self.members.iter_mut() {
                // A member that cannot go there stays where it is.
                let _ = member.set_region(&corners);
            }
        }
        let update = Update {
            corners,
            stop: Stop::Done,
            iterations,
            similarity,
        };
        (Ok(update), doubt)
    }

    fn history(&mut self) -> &mut History {
        &mut self.history
    }
}

impl Tracker for Parallel {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        if let Some(ssm) = &mut self.ssm {
            // The sampled points play no part.
            ssm.init(corners, Resolution { cols: 2, rows: 2 })?;
        }
        self.restart(frame, corners)?;
        self.history.start(frame, corners);
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        self.step_with_recall(frame)
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.members.set_region(corners)?;
        self.corners = *corners;
        Ok(())
    }

    fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.history.keep(frame, corners);
        self.members.skip(frame, corners)?;
        self.corners = *corners;
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.corners
    }

    fn reseed(&mut self, seed: u64) {
        self.members.reseed(seed);
    }

    fn set_threads(&mut self, threads: usize) {
        self.members.set_threads(threads);
    }

    fn channels(&self) -> usize {
        self.members.channels()
    }

    fn memory(&self) -> usize {
        self.members.memory().saturating_add(self.history.memory())
    }

    fn memory_needed(&self) -> usize {
        self.memory().saturating_add(self.members.passing())
    }
}
