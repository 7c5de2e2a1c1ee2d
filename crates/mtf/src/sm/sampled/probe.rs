//! What the methods that score many states share: template, patch at the present state, region.

use crate::am::{self, AppearanceModel, Distances, PatchShape};
use crate::geom::{Corners, Mat3};
use crate::image::Image;
use crate::sm::needs::Needs;
use crate::sm::sampling::SamplingParams;
use crate::sm::template::{KEEP_BASE, check_template};
use crate::sm::workspace::{Buffers, Workspace};
use crate::ssm::{self, Dynamics, Increment, Sampler, StateSpaceModel};
use crate::tracker::TrackError;
use rand_pcg::Pcg64;

/// An appearance model and a warp looking at images.
#[derive(Clone)]
pub(crate) struct Probe<A, S> {
    pub sampling: SamplingParams,
    pub am: A,
    pub ssm: S,
    started: bool,
    /// State to go back to.
    before: Vec<f64>,
}

/// A similarity that is a number.
pub(super) fn number(f: f64) -> Result<f64, TrackError> {
    if f.is_finite() {
        Ok(f)
    } else {
        Err(TrackError::NotFinite("similarity"))
    }
}

impl<A: AppearanceModel, S: StateSpaceModel> Probe<A, S> {
    pub fn new(sampling: SamplingParams, am: A, ssm: S) -> Self {
        Probe {
            sampling,
            am,
            ssm,
            started: false,
            before: Vec::new(),
        }
    }

    pub fn workspace(&self) -> Workspace {
        Workspace::take(self.sampling.res.len(), self.sampling.channels.count(), 0)
    }

    /// Puts the warp on `corners` and samples the template, into `b`.
    pub fn place(&mut self, image: &Image, corners: &Corners, b: &mut Buffers) -> Result<(), TrackError> {
        self.started = false;
        self.ssm.init(corners, self.sampling.res)?;
        self.check(image)?;
        self.look(image, b)?;
        check_template(&b.values)
    }

    /// Places the warp and shows the model its template.
    pub fn start(&mut self, image: &Image, corners: &Corners, b: &mut Buffers) -> Result<(), TrackError> {
        self.place(image, corners, b)?;
        self.am.set_template(self.sampling.shape(), &b.values)
    }

    /// All that `init` does is done.
    pub fn ready(&mut self) {
        self.started = true;
    }

    pub fn check_started(&self) -> Result<(), TrackError> {
        if self.started {
            Ok(())
        } else {
            Err(TrackError::NotInitialised)
        }
    }

    /// Distances between patches.
    pub fn distances(&self) -> Result<&dyn Distances, TrackError> {
        self.am.distances().ok_or(TrackError::Unable(
            "the appearance model has no feature to measure distances by",
        ))
    }

    /// Tells both models that a frame begins.
    pub fn begin_frame(&mut self) {
        ssm::begin_frame(&self.ssm);
        am::begin_frame(&mut self.am);
    }

    /// Whether the region has moved less than `epsilon` (px²) since it had the corners and state given.
    pub fn settled(&self, corners: &Corners, state: &[f64], epsilon: f64) -> bool {
        ssm::motion_squared(&self.ssm, corners, state) < epsilon
    }

    /// Patch at the present state, into `b`.
    pub fn look(&self, image: &Image, b: &mut Buffers) -> Result<(), TrackError> {
        self.ssm.warp_into(&mut b.x, &mut b.y);
        self.sampling.sample(image, b, false)
    }

    /// Similarity at the present state.
    pub fn similarity(&mut self, image: &Image, b: &mut Buffers) -> Result<f64, TrackError> {
        self.look(image, b)?;
        number(self.am.score(&b.values))
    }

    /// Patch at a random state near the base, whose state is left in the warp. Draws from set `set` of the sampler; `work`
    /// holds 2S numbers.
    pub fn look_around(
        &mut self,
        image: &Image,
        sampler: &mut Sampler,
        set: usize,
        rng: &mut Pcg64,
        work: &mut [f64],
        b: &mut Buffers,
    ) -> Result<(), TrackError> {
        work.fill(0.0);
        let (p, last) = work.split_at_mut(work.len() / 2);
        let how = Increment::Compositional;
        sampler.transition(set, &mut self.ssm, Dynamics::RandomWalk, how, rng, p, last)?;
        // Whatever lies outside the image has the border's value, here as on every frame.
        let _ = self.look(image, b);
        Ok(())
    }

    /// Refuses regions that have outgrown the image.
    pub fn check(&self, image: &Image) -> Result<(), TrackError> {
        if self.ssm.corners().outgrow(image.width(), image.height()) {
            return Err(TrackError::TOO_LARGE);
        }
        Ok(())
    }

    /// Moves the warp to `corners`: within its base frame where it can represent them, else by taking them as the new base.
    /// Returns the homography from the old base corners to the new ones (image pixels) in the latter case.
    pub fn set_region(&mut self, corners: &Corners) -> Result<Option<Mat3>, TrackError> {
        self.check_started()?;
        self.before.clear();
        self.before.extend_from_slice(self.ssm.state());
        if self
            .ssm
            .fit_corners(corners)
            .is_ok_and(|misfit| misfit < KEEP_BASE)
        {
            return Ok(None);
        }
        self.ssm.set_state(&self.before)?;
        let old = self.ssm.base().corners_in_image();
        self.ssm.rebase(corners)?;
        Ok(crate::geom::homography::from_corners(&old, corners))
    }

    /// What both models keep, or will keep once they have started on patches; the appearance model sees them in the shape
    /// given.
    pub(in crate::sm) fn needs(&self, shape: PatchShape) -> Needs {
        if self.started {
            Needs::of_started(&self.am, &self.ssm)
        } else {
            Needs::of(&self.am, &self.ssm, shape, self.sampling.res)
        }
    }

    pub fn memory(&self) -> usize {
        self.needs(self.sampling.shape()).models()
    }
}
