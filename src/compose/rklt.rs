//! RKLT: a tracker that follows from frame to frame (a grid with a robust fit) leads, one with a fixed template corrects
//! its drift (Zhang, Singh & Jagersand 2015). When the two end far apart the template has failed, and the leader's answer
//! stands.

use crate::geom::Corners;
use crate::image::Frame;
use crate::tracker::{Stop, TrackError, Tracker, Update};

crate::params! {
    /// Parameters of [`Rklt`].
    pub struct RkltParams {
        /// The template's answer is where the leader starts in the next frame.
        rkl_feedback: bool = true;
        /// Compare the two answers.
        rkl_failure_detection: bool = true;
        /// Root of the summed squared corner distances beyond which the template has failed, px.
        rkl_failure_thresh: f64 = 40.0, in 0.0..=1e4;
    }
}

/// A leader and a template tracker.
pub struct Rklt {
    params: RkltParams,
    leader: Box<dyn Tracker>,
    template: Box<dyn Tracker>,
    corners: Corners,
}

impl Rklt {
    /// From its two members.
    pub fn new(params: RkltParams, leader: Box<dyn Tracker>, template: Box<dyn Tracker>) -> Self {
        Rklt {
            params,
            leader,
            template,
            corners: Corners::default(),
        }
    }
}

impl Tracker for Rklt {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.leader.init(frame, corners)?;
        self.template.init(frame, corners)?;
        self.corners = *corners;
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        let led = self.leader.update(frame);
        // Without a leader the template starts from where the object was.
        let start = led.as_ref().map_or(self.corners, |u| u.corners);
        let corrected = self
            .template
            .set_region(&start)
            .and_then(|()| self.template.update(frame));
        let trusted = |u: &Update| {
            let apart = u.corners.distance_squared(&start).sqrt();
            led.is_err() || !self.params.rkl_failure_detection || apart <= self.params.rkl_failure_thresh
        };
        let iterations =
            led.as_ref().map_or(0, |u| u.iterations) + corrected.as_ref().map_or(0, |u| u.iterations);
        let mut update = match (corrected, led) {
            (Ok(u), _) if trusted(&u) => {
                if self.params.rkl_feedback {
                    // A leader that cannot go there goes on from its own answer.
                    let _ = self.leader.set_region(&u.corners);
                }
                u
            }
            (_, Ok(u)) => u,
            (_, Err(e)) => return Err(e),
        };
        update.stop = Stop::Done;
        update.iterations = iterations;
        self.corners = update.corners;
        Ok(update)
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.leader.set_region(corners)?;
        self.template.set_region(corners)?;
        self.corners = *corners;
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.corners
    }

    fn reseed(&mut self, seed: u64) {
        self.leader.reseed(seed);
        self.template.reseed(seed);
    }

    fn channels(&self) -> usize {
        self.leader.channels().max(self.template.channels())
    }

    fn memory(&self) -> usize {
        self.leader.memory() + self.template.memory()
    }
}
