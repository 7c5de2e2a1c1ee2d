//! The members of a composite as one: what is done with all of them in turn.

use super::seed::{self, Apart};
use crate::geom::Corners;
use crate::image::Frame;
use crate::interrupt;
use crate::tracker::{TrackError, Tracker};
use std::ops::{Deref, DerefMut};

/// Trackers in order.
pub(super) struct Members(Vec<Box<dyn Tracker>>);

impl Deref for Members {
    type Target = [Box<dyn Tracker>];
    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl DerefMut for Members {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.0
    }
}

impl Members {
    pub fn new(members: Vec<Box<dyn Tracker>>) -> Self {
        Members(members)
    }

    /// Initialises all; stops at the first that fails.
    pub fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.0.iter_mut().try_for_each(|m| {
            interrupt::check()?;
            m.init(frame, corners)
        })
    }

    /// Moves all; stops at the first that fails.
    pub fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.0.iter_mut().try_for_each(|m| m.set_region(corners))
    }

    /// Shows all a frame in which the object is known to be at `corners`; stops at the first that fails.
    pub fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.0.iter_mut().try_for_each(|m| m.skip(frame, corners))
    }

    /// Seeds them apart.
    pub fn reseed(&mut self, seed: u64) {
        for (member, k) in self.0.iter_mut().zip(1u64..) {
            member.reseed(seed::of_member(seed, k, Apart::Mixed));
        }
    }

    pub fn set_threads(&mut self, threads: usize) {
        self.0.iter_mut().for_each(|m| m.set_threads(threads));
    }

    /// Channels that they read between them.
    pub fn channels(&self) -> usize {
        self.0.iter().map(|m| m.channels()).max().unwrap_or(1)
    }

    /// Bytes that they keep.
    pub fn memory(&self) -> usize {
        kept(self.iter().map(AsRef::as_ref))
    }

    /// Bytes that they take for a while, in turn.
    pub fn passing(&self) -> usize {
        passing(self.iter().map(AsRef::as_ref))
    }

    /// Adds one at the end.
    pub fn push(&mut self, member: Box<dyn Tracker>) {
        self.0.push(member);
    }
}

/// Bytes that trackers keep.
pub(super) fn kept<'a>(trackers: impl IntoIterator<Item = &'a dyn Tracker>) -> usize {
    let bytes = trackers.into_iter().map(|t| t.memory());
    bytes.fold(0, usize::saturating_add)
}

/// Bytes that trackers take for a while when they start or search one after the other.
pub(super) fn passing<'a>(trackers: impl IntoIterator<Item = &'a dyn Tracker>) -> usize {
    let bytes = trackers
        .into_iter()
        .map(|t| t.memory_needed().saturating_sub(t.memory()));
    bytes.max().unwrap_or(0)
}
