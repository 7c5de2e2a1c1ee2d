//! RKLT: a tracker that follows from frame to frame (a grid with a robust fit) leads, one with a fixed template corrects
//! its drift (Zhang, Singh & Jagersand 2015). When the two end far apart one has failed: the leader, if the template tracker
//! sees the object as well as ever from where it was, or else the template, and the leader's answer stands.
//!
//! With selective pixel integration (Dellaert & Collins 1999) the template tracker leaves out what lies next to points of the
//! leader's grid that do not agree with the leader's fit: what is covered, or lit differently.

use super::entry::{CompositeEntry, CompositeFamily, Member, Refused};
use super::{flow_grid, grid, line, members};
use crate::geom::Corners;
use crate::image::Frame;
use crate::interrupt;
use crate::params::Params;
use crate::tracker::{Stop, TrackError, Tracker, Update};
use std::sync::Arc;

crate::params! {
    /// Parameters of [`Rklt`].
    pub struct RkltParams {
        /// The template's answer is where the leader starts in the next frame.
        rkl_feedback: bool = true;
        /// Compare the two answers.
        rkl_failure_detection: bool = true;
        /// Root of the summed squared corner distances beyond which the template has failed, px.
        rkl_failure_thresh: f64 = 40.0, in 0.0..=1e4, paper 15.0 => "the template corrects a leader that slips by some pixels a corner; AUC .901 with both";
        /// The template tracker uses only those of its points whose nearest point of the leader's grid agrees with the leader's
        /// fit. Needs a leader with a grid (flow, grid, line) and a gradient search with a model that can leave out pixels.
        rkl_spi: bool = false, paper true => "fewer pixels lose the object sooner: AUC .901 against .886 (SR@1 .829 against .836), and most models cannot leave out any";
        /// Similarity of the template tracker's appearance model, on that model's scale, from which its answer is enough that starts where the object
        /// was: the leader is not asked then. 1e30: never.
        rkl_enough: f64 = NEVER, in -NEVER..=NEVER;
    }
}

/// The table row.
pub(super) const ENTRY: CompositeEntry = CompositeEntry::new::<RkltParams>(
    "rklt",
    "a leader from frame to frame, and a fixed template that corrects its drift",
    |a, parts| {
        let params = RkltParams::from_assignments(a)?;
        if params.rkl_spi {
            selects(&parts.members[0], &parts.members[1])?;
        }
        let [leader, template] = [0, 1].map(|i| Arc::clone(&parts.members[i].make));
        Ok(Arc::new(move || {
            Ok(Box::new(Rklt::new(params.clone(), leader()?, template()?)))
        }))
    },
    CompositeFamily { members: (2, 2) },
)
.also(&["rkl"]);

/// No similarity is as large.
const NEVER: f64 = 1e30;

/// Share of the usual similarity that may be missing where the object is seen as well as ever.
const LESS: f64 = 0.1;

/// Fails unless the leader has a grid of points and the template tracker can leave out pixels.
fn selects(leader: &Member<'_>, template: &Member<'_>) -> Result<(), Refused> {
    let grids = [flow_grid::ENTRY.name, grid::ENTRY.name, line::ENTRY.name];
    let why = if !grids.contains(&leader.kind) {
        format!("a leader with a grid ({}) is needed", grids.join(", "))
    } else if template.value("spi").is_none() {
        format!(
            "a gradient search is needed as template tracker, not {}",
            template.kind
        )
    } else {
        // A model that can select points by a rule of its own can leave out any.
        match (template.adapt)(&[("spi", "gradient")]) {
            Ok(_) => return Ok(()),
            Err(e) => e.to_string(),
        }
    };
    Err(Refused::Unfit(format!(
        "rkl_spi=1: {why}; rkl_spi=0 uses all pixels"
    )))
}

/// A leader and a template tracker.
pub struct Rklt {
    params: RkltParams,
    leader: Box<dyn Tracker>,
    template: Box<dyn Tracker>,
    corners: Corners,
    /// Similarity of the template tracker's answer when it was last believed.
    usual: f64,
}

impl Rklt {
    /// From its two members.
    pub fn new(params: RkltParams, leader: Box<dyn Tracker>, template: Box<dyn Tracker>) -> Self {
        Rklt {
            params,
            leader,
            template,
            corners: Corners::default(),
            usual: f64::INFINITY,
        }
    }

    fn members(&self) -> [&dyn Tracker; 2] {
        [self.leader.as_ref(), self.template.as_ref()]
    }

    /// The template tracker's answer from `start` on, by the points next to those of the leader's that agree if `selected`.
    fn correct(&mut self, frame: &Frame, start: &Corners, selected: bool) -> Result<Update, TrackError> {
        if self.params.rkl_spi {
            let marked = self.leader.agreeing().filter(|_| selected);
            self.template.use_points(marked);
        }
        if self.template.corners() != *start {
            self.template.set_region(start)?;
        }
        self.template.update(frame)
    }

    /// The template tracker's answer from where the object was, when its similarity is at least `least`.
    fn stay(&mut self, frame: &Frame, least: f64) -> Option<Update> {
        let start = self.corners;
        // The leader has not seen this frame, or is wrong.
        let update = self.correct(frame, &start, false).ok();
        update.filter(|u| u.similarity >= least)
    }

    /// An answer for which the leader is not needed.
    fn alone(&mut self, frame: &Frame) -> Option<Update> {
        if self.params.rkl_enough >= NEVER {
            return None;
        }
        let update = self.stay(frame, self.params.rkl_enough)?;
        let told = self.leader.skip(frame, &update.corners);
        told.is_ok().then_some(update)
    }
}

impl Tracker for Rklt {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.leader.init(frame, corners)?;
        self.template.init(frame, corners)?;
        if self.params.rkl_spi && self.leader.agreeing().is_none() {
            return Err(TrackError::Unable("the leader has no grid of points"));
        }
        if self.params.rkl_spi && !self.template.use_points(None) {
            return Err(TrackError::Unable("the template tracker cannot leave out points"));
        }
        self.corners = *corners;
        self.usual = f64::INFINITY;
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        if let Some(update) = self.alone(frame) {
            self.corners = update.corners;
            self.usual = update.similarity;
            return Ok(Update {
                stop: Stop::Done,
                ..update
            });
        }
        let led = self.leader.update(frame);
        // Without a leader the template starts from where the object was.
        let start = led.as_ref().map_or(self.corners, |u| u.corners);
        let mut corrected = self.correct(frame, &start, led.is_ok()).ok();
        if led.is_ok() && self.params.rkl_failure_detection {
            let apart = |u: &Update| u.corners.distance_squared(&start).sqrt();
            corrected = corrected.filter(|u| apart(u) <= self.params.rkl_failure_thresh);
            if corrected.is_none() {
                corrected = self.stay(frame, self.usual - LESS * self.usual.abs());
            }
        }
        interrupt::check()?;
        let iterations = led.as_ref().map_or(0, |u| u.iterations) + corrected.map_or(0, |u| u.iterations);
        let mut update = match corrected {
            Some(u) => {
                self.usual = u.similarity;
                if self.params.rkl_feedback {
                    // A leader that cannot go there goes on from its own answer.
                    let _ = self.leader.set_region(&u.corners);
                }
                u
            }
            None => led?,
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
        members::kept(self.members())
    }

    fn memory_needed(&self) -> usize {
        self.memory().saturating_add(members::passing(self.members()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    const START: Corners = Corners([[10.0, 10.0], [50.0, 10.0], [50.0, 40.0], [10.0, 40.0]]);

    /// Goes as far right as it is told, frame by frame, or, when it starts within 20 px of where it should be, there.
    struct Mover {
        at: Corners,
        steps: Vec<f64>,
        truth: Option<Corners>,
    }

    impl Tracker for Mover {
        fn init(&mut self, _: &Frame, corners: &Corners) -> Result<(), TrackError> {
            self.at = *corners;
            Ok(())
        }
        fn update(&mut self, _: &Frame) -> Result<Update, TrackError> {
            let near = self.truth.filter(|t| t.mean_distance(&self.at) < 20.0);
            let step = self.steps.pop().unwrap_or(60.0);
            self.at = near.unwrap_or(self.at.translated(step, 0.0));
            Ok(Update {
                corners: self.at,
                stop: Stop::Converged,
                iterations: 1,
                similarity: if near.is_some() { 0.95 } else { 0.5 },
            })
        }
        fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
            self.at = *corners;
            Ok(())
        }
        fn corners(&self) -> Corners {
            self.at
        }
    }

    /// Where two frames end in which the leader goes 5 px and then `leap`, and the object is at `truth`.
    fn end(leap: f64, truth: Corners) -> Corners {
        let mover = |steps: Vec<f64>, truth| -> Box<dyn Tracker> {
            Box::new(Mover {
                at: START,
                steps,
                truth,
            })
        };
        let (leader, template) = (mover(vec![leap, 5.0], None), mover(Vec::new(), Some(truth)));
        let mut tracker = Rklt::new(RkltParams::default(), leader, template);
        let frame = Frame::from_gray(Image::new(64, 64, 1));
        tracker.init(&frame, &START).unwrap();
        tracker.update(&frame).unwrap();
        let corners = tracker.update(&frame).unwrap().corners;
        assert_eq!(corners, tracker.corners());
        corners
    }

    #[test]
    fn the_one_that_fails_is_not_believed() {
        let near = START.translated(7.0, 0.0);
        assert_eq!(end(4.0, near), near);
        // The leader leaps away, and the template tracker finds nothing there.
        assert_eq!(end(200.0, near), near);
        // Nothing is found anywhere.
        let gone = START.translated(900.0, 0.0);
        assert_eq!(end(200.0, gone), START.translated(205.0, 0.0));
    }
}
