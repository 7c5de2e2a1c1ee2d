//! What every tracker is, single-layer or composite: the trait, its result and its failures.

use crate::geom::Corners;
use crate::image::Frame;
use crate::interrupt::Interrupted;
use crate::params::Resolution;
use auto_impl::auto_impl;

/// Why a frame's search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The corners moved less than epsilon.
    Converged,
    /// The iteration limit was reached.
    MaxIterations,
    /// The search has no iterations to count (sampling methods, composites).
    Done,
    /// The tracker believes that the object cannot be seen. Its corners are where it supposes the object to be.
    Absent,
}

/// Result of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Update {
    /// Tracked corners in image pixels.
    pub corners: Corners,
    /// Why the search ended.
    pub stop: Stop,
    /// Iterations used.
    pub iterations: u32,
    /// Similarity `f` of the appearance model where the search evaluated it last (larger is better): for gradient searches
    /// before their last step, not at `corners`, which would take another sampling of the image.
    pub similarity: f64,
}

/// Why a tracker could not track a frame (or start). The tracker keeps its last valid state and may try again.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TrackError {
    /// `update` before `init`.
    #[error("not initialised")]
    NotInitialised,
    /// The region given to `init` or `set_region` cannot be tracked.
    #[error("bad region: {0}")]
    BadRegion(&'static str),
    /// The template has nothing to track (flat or non-finite patch).
    #[error("degenerate template: {0}")]
    Template(&'static str),
    /// The warped region is not a convex quadrilateral of sensible size.
    #[error("degenerate warp: {0}")]
    Degenerate(&'static str),
    /// More than 90 % of the samples fall outside the image.
    #[error("outside the image")]
    Outside,
    /// The normal equations have no finite solution.
    #[error("singular system")]
    Singular,
    /// The illumination model cannot follow, or not be used with so small a patch.
    #[error("illumination: {0}")]
    Illumination(&'static str),
    /// A model cannot do what the search needs of it.
    #[error("unable: {0}")]
    Unable(&'static str),
    /// An analysis method was not told where the object is in this frame.
    #[error("no ground truth for this frame")]
    NoTruth,
    /// A number is not finite.
    #[error("not finite: {0}")]
    NotFinite(&'static str),
    /// The tracker says that the object cannot be seen.
    #[error("the object cannot be seen")]
    Absent,
    /// Recorded results say nothing of this frame.
    #[error("no result for this frame")]
    Missing,
    /// The caller asked for the end of the work ([`interrupt`](crate::interrupt)).
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

impl TrackError {
    /// What becomes of regions beyond [`LARGEST_REGION`](crate::geom::LARGEST_REGION).
    pub(crate) const TOO_LARGE: TrackError =
        TrackError::Degenerate("region is more than four times the image");

    /// One word for the status column of frame logs.
    pub fn word(&self) -> &'static str {
        match self {
            TrackError::NotInitialised => "uninitialised",
            TrackError::BadRegion(_) => "bad_region",
            TrackError::Template(_) => "bad_template",
            TrackError::Degenerate(_) => "degenerate",
            TrackError::Outside => "outside",
            TrackError::Singular => "singular",
            TrackError::Illumination(_) => "illumination",
            TrackError::Unable(_) => "unable",
            TrackError::NoTruth => "no_truth",
            TrackError::NotFinite(_) => "not_finite",
            TrackError::Absent => "absent",
            TrackError::Missing => "missing",
            TrackError::Interrupted(_) => "interrupted",
        }
    }
}

/// A tracker takes more memory than it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "needs about {}, more than allowed ({}); use fewer samples or patches",
    bytes(*.needed),
    bytes(*.allowed)
)]
pub struct TooLarge {
    /// Bytes that it takes at most, roughly.
    pub needed: u64,
    /// Bytes that it may take.
    pub allowed: u64,
}

/// A number of bytes in words: `8.1 GiB`.
fn bytes(count: u64) -> String {
    const UNITS: [&str; 5] = ["KiB", "MiB", "GiB", "TiB", "PiB"];
    let (mut value, mut unit) = (count as f64 / 1024.0, 0);
    while value >= 1023.5 && unit + 1 < UNITS.len() {
        (value, unit) = (value / 1024.0, unit + 1);
    }
    let digits = usize::from(value < 9.95);
    format!("{value:.digits$} {}", UNITS[unit])
}

/// Refuses a tracker, best before `init`, that takes more than `allowed` bytes at any time.
///
/// # Errors
/// [`TooLarge`], with [`Tracker::memory_needed`].
pub fn afford(tracker: &dyn Tracker, allowed: u64) -> Result<(), TooLarge> {
    let needed = tracker.memory_needed() as u64;
    if needed > allowed {
        return Err(TooLarge { needed, allowed });
    }
    Ok(())
}

/// Which points of a regular grid over the object are marked.
#[derive(Clone, Copy, Debug)]
pub struct Marks<'a> {
    /// Points of the grid.
    pub size: Resolution,
    /// One mark for each, row by row.
    pub marks: &'a [bool],
}

/// A tracker of one planar object. Object safe; composites implement it over other trackers.
#[auto_impl(Box)]
pub trait Tracker: Send {
    /// Starts on `frame` with the object at `corners` (UL UR LR LL, px). Long work ends early when it is interrupted
    /// ([`interrupt`](crate::interrupt)); the tracker must then be started anew.
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError>;

    /// Finds the object in the next frame, starting from where it was. On an error it keeps its last
    /// valid state.
    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError>;

    /// Moves the tracker to `corners` without changing its template.
    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError>;

    /// Current corners in image pixels.
    fn corners(&self) -> Corners;

    /// Is told that the object is at `corners` in the next frame instead of finding it there. Trackers that remember the
    /// last frame, and composites of such, take this one for it; for others it is the same as
    /// [`set_region`](Self::set_region).
    fn skip(&mut self, _frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.set_region(corners)
    }

    /// Where a place `x` of the object in the frame it was initialised on (px) is now. `None`: as the plane through the
    /// corners tells.
    fn place(&self, _x: [f64; 2]) -> Option<[f64; 2]> {
        None
    }

    /// The points of its grid that agreed with its answer in the last frame; `None` for trackers that have no such grid.
    fn agreeing(&self) -> Option<Marks<'_>> {
        None
    }

    /// From the next frame on uses only those points of its patch that lie next to marked ones; all again with `None`. False
    /// for trackers that cannot leave out points.
    fn use_points(&mut self, _marked: Option<Marks<'_>>) -> bool {
        false
    }

    /// Seed of all randomness; called before `init`. Trackers without randomness ignore it.
    fn reseed(&mut self, _seed: u64) {}

    /// Threads of the current `rayon` pool that `update` may use at once; one unless told. Never changes a result. Trackers
    /// with nothing to share out ignore it.
    fn set_threads(&mut self, _threads: usize) {}

    /// For methods of analysis alone: what must be told the ground truth before each `update`.
    fn needs_truth(&mut self) -> Option<&mut dyn NeedsTruth> {
        None
    }

    /// Channels of the image that `update` reads: 1 (gray) or 3 (R, G, B); 0 for trackers that do not look at frames, which
    /// may be given empty ones.
    fn channels(&self) -> usize {
        1
    }

    /// How long the last `update` took, s, where the tracker knows better than the clock of its caller, which says
    /// `elapsed`. NaN: not known.
    fn seconds(&self, elapsed: f64) -> f64 {
        elapsed
    }

    /// Bytes this tracker keeps between frames, roughly: sizes groups of trackers that run together. Before `init`, what its
    /// parameters make it keep from then on. Sums saturate.
    fn memory(&self) -> usize {
        1 << 17
    }

    /// Bytes this tracker takes at most at once, roughly: what it keeps, and what `init` or `update` takes for a while.
    /// Known before `init`, and never less than [`memory`](Self::memory).
    fn memory_needed(&self) -> usize {
        self.memory()
    }
}

/// A tracker that is told where the object is, for analysis.
pub trait NeedsTruth {
    /// The true corners (px) in the frame about to be given to [`Tracker::update`].
    fn tell_truth(&mut self, corners: &Corners);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_refusal_has_both_figures() {
        let error = TooLarge {
            needed: 8_700_000_000,
            allowed: 500 << 20,
        };
        let text = "needs about 8.1 GiB, more than allowed (500 MiB); use fewer samples or patches";
        assert_eq!(error.to_string(), text);
        let texts = [0, 1023 << 10, 1 << 20, u64::MAX].map(bytes);
        assert_eq!(texts, ["0.0 KiB", "1023 KiB", "1.0 MiB", "16384 PiB"]);
    }
}
