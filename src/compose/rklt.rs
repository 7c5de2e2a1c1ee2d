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
        /// Similarity of the template tracker's, in its own units, from which its answer is enough that starts where the object
        /// was: the leader is not asked then. 1e30: never.
        rkl_enough: f64 = NEVER, in -NEVER..=NEVER;
    }
}

/// No similarity is as large.
const NEVER: f64 = 1e30;

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

    /// The template tracker's answer from `start` on.
    fn correct(&mut self, frame: &Frame, start: &Corners) -> Result<Update, TrackError> {
        if self.template.corners() != *start {
            self.template.set_region(start)?;
        }
        self.template.update(frame)
    }

    /// The template tracker's answer from where the object was, when that is enough.
    fn alone(&mut self, frame: &Frame) -> Option<Update> {
        if self.params.rkl_enough >= NEVER {
            return None;
        }
        let start = self.corners;
        let update = self.correct(frame, &start).ok()?;
        (update.similarity >= self.params.rkl_enough && self.leader.skip(frame, &update.corners).is_ok())
            .then_some(update)
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
        if let Some(update) = self.alone(frame) {
            self.corners = update.corners;
            return Ok(Update {
                stop: Stop::Done,
                ..update
            });
        }
        let led = self.leader.update(frame);
        // Without a leader the template starts from where the object was.
        let start = led.as_ref().map_or(self.corners, |u| u.corners);
        let corrected = self.correct(frame, &start);
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

    fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.leader.skip(frame, corners)?;
        self.template.skip(frame, corners)?;
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

    fn set_threads(&mut self, threads: usize) {
        self.leader.set_threads(threads);
        self.template.set_threads(threads);
    }

    fn channels(&self) -> usize {
        self.leader.channels().max(self.template.channels())
    }

    fn memory(&self) -> usize {
        self.leader.memory() + self.template.memory()
    }
}
