//! Guard: a tracker whose answers are doubted when what they show no longer looks like the object, and what is done then.
//!
//! Confidence is the normalised cross-correlation (zero mean) of the region in the first frame and in the present one, both
//! seen through the homography of their corners: in [-1, 1] whatever appearance model the tracker compares by.

use super::entry::{CompositeEntry, CompositeFamily};
use super::members;
use super::seed::{self, Apart};
use crate::am::Ncc;
use crate::geom::Corners;
use crate::image::Frame;
use crate::interrupt;
use crate::params::{Params, Resolution};
use crate::sm::{Probe, SamplingParams};
use crate::ssm::Homography;
use crate::tracker::{Stop, TrackError, Tracker, Update};
use std::sync::Arc;

crate::params! {
    /// Parameters of [`Guard`].
    pub struct GuardParams {
        /// Answers of less confidence are in doubt: normalised cross-correlation with the first frame.
        min_confidence: f64 = 0.5, in -1.0..=1.0;
        /// Frames in doubt in a row before something is done.
        patience: usize = 1, in 1..=1000;
        /// Where the detector does not help either, the tracker is put back to where it was last trusted.
        guard_reset: bool = true;
    }
}

/// The table row.
pub(super) const ENTRY: CompositeEntry = CompositeEntry::new::<GuardParams>(
    "guard",
    "a tracker that is put back, or found again by a second member, when it no longer looks like the object",
    |a, parts| {
        let params = GuardParams::from_assignments(a)?;
        let (tracker, detector) = (
            Arc::clone(&parts.members[0].make),
            parts.members.get(1).map(|m| Arc::clone(&m.make)),
        );
        Ok(Arc::new(move || {
            let detector = detector.as_ref().map(|make| make()).transpose()?;
            Ok(Box::new(Guard::new(params.clone(), tracker()?, detector)))
        }))
    },
    CompositeFamily { members: (1, 2) },
);

/// Samples per side by which confidence is judged.
const SIDE: usize = 30;

/// A tracker, and maybe a second one that finds the object again.
pub struct Guard {
    params: GuardParams,
    tracker: Box<dyn Tracker>,
    detector: Option<Box<dyn Tracker>>,
    probe: Probe<Ncc, Homography>,
    trusted: Corners,
    doubts: usize,
}

impl Guard {
    /// From the tracker and, if there is one, a detector: a tracker that searches for the first frame's object wherever it
    /// is, such as [`FeatureTracker`](crate::features::FeatureTracker).
    pub fn new(params: GuardParams, tracker: Box<dyn Tracker>, detector: Option<Box<dyn Tracker>>) -> Self {
        let sampling = SamplingParams {
            res: Resolution {
                cols: SIDE,
                rows: SIDE,
            },
            ..SamplingParams::default()
        };
        Guard {
            params,
            tracker,
            detector,
            probe: Probe::new(sampling, Ncc::default(), Homography::default()),
            trusted: Corners::default(),
            doubts: 0,
        }
    }

    fn members(&self) -> impl Iterator<Item = &dyn Tracker> {
        [Some(&self.tracker), self.detector.as_ref()]
            .into_iter()
            .flatten()
            .map(AsRef::as_ref)
    }

    /// How much what is at `corners` looks like the object, in [-1, 1]; -1 where nothing can be seen.
    fn confidence(&mut self, frame: &Frame, corners: &Corners) -> f64 {
        let mut b = self.probe.workspace();
        let seen = self.probe.set_region(corners);
        seen.and_then(|_| self.probe.similarity(frame.gray(), &mut b))
            .unwrap_or(-1.0)
    }

    /// The answer with its confidence, -1 for none.
    fn judged(&mut self, frame: &Frame, update: &Result<Update, TrackError>) -> f64 {
        match update {
            Ok(update) => self.confidence(frame, &update.corners),
            Err(_) => -1.0,
        }
    }

    /// What the tracker makes of where the detector sees the object, when that looks more like it than `confidence`.
    fn redetect(&mut self, frame: &Frame, confidence: f64) -> Option<(Update, f64)> {
        let detector = self.detector.as_mut()?;
        let seen = detector.update(frame).ok()?;
        let found = self.confidence(frame, &seen.corners);
        if found < self.params.min_confidence || found <= confidence {
            return None;
        }
        let moved = self.tracker.set_region(&seen.corners);
        let update = moved.and_then(|()| self.tracker.update(frame)).ok();
        let finer = update.map(|u| (u, self.confidence(frame, &u.corners)));
        // The tracker may be further from the object than the detector, or unable to go there.
        finer.filter(|(_, c)| *c >= found).or_else(|| {
            let _ = self.tracker.set_region(&seen.corners);
            Some((seen, found))
        })
    }
}

impl Tracker for Guard {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.tracker.init(frame, corners)?;
        if let Some(detector) = &mut self.detector {
            detector.init(frame, corners)?;
        }
        let mut b = self.probe.workspace();
        self.probe.start(frame.gray(), corners, &mut b)?;
        self.probe.ready();
        self.trusted = *corners;
        self.doubts = 0;
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        let mut update = self.tracker.update(frame);
        let mut confidence = self.judged(frame, &update);
        if confidence < self.params.min_confidence {
            self.doubts += 1;
            if self.doubts >= self.params.patience {
                if let Some((found, c)) = self.redetect(frame, confidence) {
                    (update, confidence) = (Ok(found), c);
                } else if self.params.guard_reset {
                    // One that cannot go there stays where it is.
                    let _ = self.tracker.set_region(&self.trusted);
                }
            }
        }
        interrupt::check()?;
        // Where it was put back to is the answer too.
        let update = Update {
            corners: self.tracker.corners(),
            ..update?
        };
        let stop = match confidence >= self.params.min_confidence {
            true => {
                self.trusted = update.corners;
                self.doubts = 0;
                Stop::Done
            }
            false => Stop::Absent,
        };
        Ok(Update {
            stop,
            similarity: confidence,
            ..update
        })
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.tracker.set_region(corners)?;
        self.trusted = *corners;
        self.doubts = 0;
        Ok(())
    }

    fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.tracker.skip(frame, corners)?;
        self.trusted = *corners;
        self.doubts = 0;
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.tracker.corners()
    }

    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        self.tracker.place(x)
    }

    fn reseed(&mut self, seed: u64) {
        self.tracker.reseed(seed);
        if let Some(detector) = &mut self.detector {
            detector.reseed(seed::of_member(seed, 1, Apart::Flipped));
        }
    }

    fn set_threads(&mut self, threads: usize) {
        self.tracker.set_threads(threads);
        if let Some(detector) = &mut self.detector {
            detector.set_threads(threads);
        }
    }

    fn channels(&self) -> usize {
        let detector = self.detector.as_ref().map_or(1, |d| d.channels());
        self.tracker.channels().max(detector)
    }

    fn memory(&self) -> usize {
        members::kept(self.members()).saturating_add(self.probe.memory())
    }

    fn memory_needed(&self) -> usize {
        self.memory().saturating_add(members::passing(self.members()))
    }
}
