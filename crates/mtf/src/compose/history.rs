//! Starting anew from a frame before: what cascades and parallel trackers do when their members disagree.

use crate::geom::Corners;
use crate::image::Frame;
use crate::tracker::{TrackError, Tracker, Update};
use std::collections::VecDeque;

/// The last frames that were tracked, with the corners found in them.
pub(super) struct History {
    gap: usize,
    /// Oldest first.
    frames: VecDeque<(Frame, Corners)>,
}

impl History {
    /// Keeps the last `gap` frames, or none where nothing is to be started anew.
    pub fn new(wanted: bool, gap: usize) -> Self {
        let gap = if wanted { gap } else { 0 };
        History {
            gap,
            frames: VecDeque::with_capacity(gap),
        }
    }

    /// Forgets all but the first frame.
    pub fn start(&mut self, frame: &Frame, corners: &Corners) {
        self.frames.clear();
        self.keep(frame, corners);
    }

    /// Adds a frame and what was found in it.
    pub fn keep(&mut self, frame: &Frame, corners: &Corners) {
        if self.gap > 0 {
            if self.frames.len() == self.gap {
                self.frames.pop_front();
            }
            self.frames.push_back((frame.clone(), *corners));
        }
    }

    /// Bytes of the frames kept.
    pub fn memory(&self) -> usize {
        let pixels = |(frame, _): &(Frame, Corners)| frame.width() * frame.height();
        // 8-bit pixels and a float image, once per frame.
        self.gap * self.frames.front().map_or(1 << 21, |f| 5 * pixels(f))
    }
}

/// A tracker that can be started anew from its history.
pub(super) trait Recall: Tracker {
    /// Initialises all members.
    fn restart(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError>;
    /// Tracks one frame, and says whether the members disagree about it.
    fn step(&mut self, frame: &Frame) -> (Result<Update, TrackError>, bool);
    /// Its history.
    fn history(&mut self) -> &mut History;

    /// Tracks one frame. When the members disagree, all are started anew on the oldest frame kept, at the corners found
    /// there, and follow the frames since then, this one last, with no further questions asked.
    fn step_with_recall(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        let (mut result, doubt) = self.step(frame);
        let kept = std::mem::take(&mut self.history().frames);
        if doubt
            && let Some((first, corners)) = kept.front()
            && self.restart(first, corners).is_ok()
        {
            for (frame, _) in kept.iter().skip(1) {
                // What matters is where the members stand in the end.
                let _ = self.step(frame);
            }
            result = self.step(frame).0;
        }
        self.history().frames = kept;
        if let Ok(update) = &result {
            let corners = update.corners;
            self.history().keep(frame, &corners);
        }
        result
    }
}
