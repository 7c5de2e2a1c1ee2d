//! Cascade: trackers one after the other, each starting where the one before ended (Singh & Jagersand, *Modular Tracking
//! Framework*, composite trackers). A wide but coarse search in front of a narrow but precise one.
//!
//! The answer is that of the last layer that had one. A layer whose answer is none (it threw) is passed over.

use super::entry::{CompositeEntry, CompositeFamily, build_all};
use super::history::{History, Recall};
use super::members::Members;
use crate::geom::Corners;
use crate::image::Frame;
use crate::interrupt;
use crate::params::Params;
use crate::tracker::{Stop, TrackError, Tracker, Update};
use std::sync::Arc;

crate::params! {
    /// Parameters of [`Cascade`].
    pub struct CascadeParams {
        /// The last layer's answer is where the first one starts in the next frame.
        feedback: bool = true;
        /// Start anew from a frame before when two successive layers disagree.
        auto_reinit: bool = false;
        /// Mean corner distance between successive layers beyond which they disagree, px.
        reinit_err_thresh: f64 = 10.0, in 0.0..=1e4;
        /// How many frames before the present one all layers are started anew.
        reinit_frame_gap: usize = 10, in 1..=1000;
    }
}

/// The table row.
pub(super) const ENTRY: CompositeEntry = CompositeEntry::new::<CascadeParams>(
    "cascade",
    "one after the other, each from where the one before ended",
    |a, parts| {
        let (params, layers) = (CascadeParams::from_assignments(a)?, parts.makes());
        Ok(Arc::new(move || {
            Ok(Box::new(Cascade::new(params.clone(), build_all(&layers)?)))
        }))
    },
    CompositeFamily { members: (1, 16) },
)
.also(&["casc"])
.published("section 3.2");

/// Trackers in sequence.
pub struct Cascade {
    params: CascadeParams,
    layers: Members,
    history: History,
}

impl Cascade {
    /// From its layers, at least one, in their order.
    pub fn new(params: CascadeParams, layers: Vec<Box<dyn Tracker>>) -> Self {
        Cascade {
            history: History::new(params.auto_reinit, params.reinit_frame_gap),
            params,
            layers: Members::new(layers),
        }
    }

    /// One pass through the layers; whether two of them disagreed, or one went wrong.
    fn pass(&mut self, frame: &Frame) -> (Result<Update, TrackError>, bool) {
        let mut answer: Option<Update> = None;
        let mut error = TrackError::NotInitialised;
        let mut doubt = false;
        for layer in self.layers.iter_mut() {
            let started = answer.map_or(Ok(()), |a| layer.set_region(&a.corners));
            match started.and_then(|()| layer.update(frame)) {
                Ok(mut update) => {
                    if let Some(before) = answer {
                        let apart = before.corners.mean_distance(&update.corners);
                        // A distance that is no number is a disagreement too.
                        doubt |= apart.is_nan() || apart > self.params.reinit_err_thresh;
                        update.iterations += before.iterations;
                    }
                    update.stop = Stop::Done;
                    answer = Some(update);
                }
                Err(e) => {
                    doubt = true;
                    error = e;
                }
            }
        }
        if let Err(e) = interrupt::check() {
            return (Err(e.into()), false);
        }
        if let Some(update) = answer {
            let last = self.layers.len() - 1;
            let to = if self.params.feedback { 0..last } else { 0..0 };
            for layer in &mut self.layers[to] {
                // A layer that cannot go there stays where it is.
                let _ = layer.set_region(&update.corners);
            }
        }
        (answer.ok_or(error), doubt)
    }
}

impl Recall for Cascade {
    fn restart(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.layers.init(frame, corners)
    }

    fn step(&mut self, frame: &Frame) -> (Result<Update, TrackError>, bool) {
        self.pass(frame)
    }

    fn history(&mut self) -> &mut History {
        &mut self.history
    }
}

impl Tracker for Cascade {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.restart(frame, corners)?;
        self.history.start(frame, corners);
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        self.step_with_recall(frame)
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.layers.set_region(corners)
    }

    fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.history.keep(frame, corners);
        self.layers.skip(frame, corners)
    }

    fn corners(&self) -> Corners {
        self.layers
            .last()
            .map_or(Corners::default(), |layer| layer.corners())
    }

    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        self.layers.last()?.place(x)
    }

    fn reseed(&mut self, seed: u64) {
        self.layers.reseed(seed);
    }

    fn set_threads(&mut self, threads: usize) {
        self.layers.set_threads(threads);
    }

    fn channels(&self) -> usize {
        self.layers.channels()
    }

    fn memory(&self) -> usize {
        self.layers.memory().saturating_add(self.history.memory())
    }

    fn memory_needed(&self) -> usize {
        self.memory().saturating_add(self.layers.passing())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    /// Answers the same corners whatever it is told.
    struct Fixed(Corners);

    impl Tracker for Fixed {
        fn init(&mut self, _: &Frame, _: &Corners) -> Result<(), TrackError> {
            Ok(())
        }
        fn update(&mut self, _: &Frame) -> Result<Update, TrackError> {
            Ok(Update {
                corners: self.0,
                stop: Stop::Done,
                iterations: 1,
                similarity: 0.0,
            })
        }
        fn set_region(&mut self, _: &Corners) -> Result<(), TrackError> {
            Ok(())
        }
        fn corners(&self) -> Corners {
            self.0
        }
    }

    #[test]
    fn layers_that_end_farther_apart_than_the_threshold_are_doubted() {
        let frame = Frame::from_gray(Image::new(8, 8, 1));
        let square = Corners::rect(1.0, 1.0, 4.0, 4.0);
        let doubted = |shifts: &[f64]| {
            let params = CascadeParams {
                reinit_err_thresh: 4.0,
                ..CascadeParams::default()
            };
            let layer = |dx: &f64| Box::new(Fixed(square.translated(*dx, 0.0))) as Box<dyn Tracker>;
            Cascade::new(params, shifts.iter().map(layer).collect())
                .pass(&frame)
                .1
        };
        assert!(!doubted(&[0.0]) && !doubted(&[0.0, 3.99]) && !doubted(&[0.0, -3.0, 0.9, 4.5]));
        assert!(doubted(&[0.0, 4.01]) && doubted(&[0.0, 3.0, -1.1, 0.0]));
        assert!(doubted(&[0.0, f64::NAN]));
    }
}
