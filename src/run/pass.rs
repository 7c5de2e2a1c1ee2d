//! A unit on its way: one tracker from its start frame to the end of the sequence, started anew as its protocol says.

use crate::dataset::Sequence;
use crate::metric::MetricSet;
use crate::panics;
use crate::plan::{Protocol, Unit};
use crate::store::framelog::{ABSENT, BROKEN, FAILED, INIT, Row, SKIPPED, round_corners};
use mtf::geom::{Corners, homography};
use mtf::image::Frame;
use mtf::tracker::{Stop, Tracker};
use std::time::{Duration, Instant};

/// A frame with its index and the time it took to read, decode and filter, s.
pub(crate) struct Ready {
    pub index: usize,
    pub frame: Frame,
    /// Its gray image is made.
    pub gray: bool,
    /// Its colour image is.
    pub colour: bool,
    pub seconds: f64,
}

impl Ready {
    /// Whether a tracker that reads so many channels finds them made.
    pub fn has(&self, channels: usize) -> bool {
        if channels == 1 { self.gray } else { self.colour }
    }
}

/// Makes a tracker that is to start on the given frame.
pub(crate) type MakeAt<'a> = dyn Fn(u32) -> Result<Box<dyn Tracker>, String> + 'a;

/// A unit on its way.
pub(crate) struct Pass<'a> {
    pub unit: &'a Unit,
    pub course: Protocol,
    pub tracker: Option<Box<dyn Tracker>>,
    pub rows: Vec<Row>,
    pub init_seconds: f64,
    pub seconds: Vec<f32>,
    pub input_seconds: f64,
    pub failed: Option<String>,
    metrics: MetricSet,
    state: State,
    /// Frame of the last start.
    since: usize,
}

/// What is next for a tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// To start on the first frame with ground truth from here. Beyond the end, too: what a unit needs of its data does not
    /// depend on its tracker.
    Starting(usize),
    Tracking,
    /// Failed.
    Over,
}

impl<'a> Pass<'a> {
    /// Before the first frame. A tracker that cannot be made fails the unit.
    pub fn new(
        unit: &'a Unit,
        course: Protocol,
        metrics: &MetricSet,
        made: Result<Box<dyn Tracker>, String>,
    ) -> Pass<'a> {
        let start = unit.start as usize;
        let (tracker, failed) = match made {
            Ok(tracker) => (Some(tracker), None),
            Err(reason) => (None, Some(reason)),
        };
        Pass {
            unit,
            course,
            tracker,
            rows: Vec::new(),
            init_seconds: 0.0,
            seconds: Vec::new(),
            input_seconds: 0.0,
            metrics: metrics.clone(),
            state: if failed.is_some() {
                State::Over
            } else {
                State::Starting(start)
            },
            failed,
            since: start,
        }
    }

    /// The unit has failed.
    pub fn is_over(&self) -> bool {
        self.state == State::Over
    }

    /// Time in starts and updates so far.
    pub fn spent(&self) -> Duration {
        let updates: f64 = self.seconds.iter().map(|&s| f64::from(s)).sum();
        Duration::try_from_secs_f64(self.init_seconds + updates).unwrap_or(Duration::MAX)
    }

    /// Ends the unit without a result.
    pub fn fail(&mut self, reason: String) {
        self.failed = Some(reason);
        self.state = State::Over;
        self.discard();
    }

    /// Ends the unit, which took longer than `limit`.
    pub fn time_out(&mut self, limit: Duration) {
        self.fail(format!("longer than {} s", limit.as_secs_f64()));
    }

    /// Takes the next frame, from the unit's start on; returns how many frames are done by that.
    pub fn advance(&mut self, ready: &Ready, sequence: &Sequence, make: &MakeAt<'_>) -> usize {
        let (i, before) = (ready.index, self.rows.len());
        // Of the tracker that this frame is for; another may be started on it afterwards.
        let since = self.since;
        let annotated = sequence.truth(i).is_some();
        // Nothing would be left to track after a start on the last frame.
        let worth = i + 1 < sequence.len() || i == self.unit.start as usize;
        let row = match self.state {
            State::Over => None,
            State::Tracking => self.track(ready, sequence, make),
            State::Starting(from) if i >= from && annotated && worth => {
                self.start_in_turn(ready, sequence, make)
            }
            State::Starting(_) => Some(self.idle(sequence, i)),
        };
        self.rows.extend(row.map(|row| Row { since, ..row }));
        self.rows.len() - before
    }

    /// Starts where nothing is tracked; none if that fails the unit.
    fn start_in_turn(&mut self, ready: &Ready, sequence: &Sequence, make: &MakeAt<'_>) -> Option<Row> {
        let i = ready.index;
        let first = i == self.unit.start as usize;
        match (self.course, self.start(ready, sequence, make)) {
            (Protocol::Reinit { skip, .. }, Err(_)) if !first => Some(self.failure(None, skip, sequence, i)),
            (Protocol::Every(_), _) if !first => Some(self.idle(sequence, i)),
            (_, Ok(corners)) => Some(Row {
                corners,
                ..Row::without_tracker(INIT)
            }),
            (_, Err(reason)) => {
                self.fail(reason);
                None
            }
        }
    }

    /// Starts a tracker on a frame with ground truth.
    fn start(
        &mut self,
        ready: &Ready,
        sequence: &Sequence,
        make: &MakeAt<'_>,
    ) -> Result<Option<Corners>, String> {
        let i = ready.index;
        self.since = i;
        let begin = Instant::now();
        // The tracker of the first start is there: its needs decided what is decoded.
        let tracker = match self.tracker.take() {
            Some(tracker) if i == self.unit.start as usize => Ok(tracker),
            old => {
                drop_quietly(old);
                make(i as u32)
            }
        };
        let started = tracker.and_then(|mut tracker| {
            let row = panics::catch(|| initialise(tracker.as_mut(), sequence, ready));
            match row.unwrap_or_else(|panic| Err(format!("panic in frame {i}: {panic}"))) {
                Ok(corners) => Ok((tracker, corners)),
                Err(reason) => {
                    drop_quietly(Some(tracker));
                    Err(reason)
                }
            }
        });
        self.init_seconds += begin.elapsed().as_secs_f64();
        let (tracker, corners) = match started {
            Ok(started) => started,
            Err(reason) => {
                if let Protocol::Every(k) = self.course {
                    self.state = State::Starting(i + k as usize);
                }
                return Err(reason);
            }
        };
        self.tracker = Some(tracker);
        self.state = State::Tracking;
        Ok(corners)
    }

    /// Tracks one frame; none if that fails the unit.
    fn track(&mut self, ready: &Ready, sequence: &Sequence, make: &MakeAt<'_>) -> Option<Row> {
        let i = ready.index;
        let truth = sequence.truth_from(self.since, i);
        let mut tracker = self.tracker.take()?;
        let updated = panics::catch(|| {
            if let (Some(truth), Some(analysis)) = (truth, tracker.needs_truth()) {
                analysis.tell_truth(&truth);
            }
            let begin = Instant::now();
            let (mut row, answered) = update(tracker.as_mut(), &ready.frame);
            let seconds = tracker.seconds(begin.elapsed().as_secs_f64());
            row.dense = self.dense_errors(Some(tracker.as_ref()), sequence, i, row.corners);
            (row, answered, seconds)
        });
        self.tracker = Some(tracker);
        let updated = updated.map(|(row, answered, seconds)| {
            if seconds.is_finite() {
                self.seconds.push(seconds as f32);
                self.input_seconds += ready.seconds;
            }
            (row, answered)
        });
        match (self.course, updated) {
            (Protocol::Reinit { threshold, skip }, updated) => {
                let error = |row: &Row| self.metrics.frame_errors(&row.corners?, &truth?).next();
                match updated {
                    Ok((row, true))
                        if row.corners.is_some() && error(&row).is_none_or(|al| al <= threshold) =>
                    {
                        Some(row)
                    }
                    other => Some(self.failure(other.ok().map(|(row, _)| row), skip, sequence, i)),
                }
            }
            (Protocol::Every(k), Err(_)) => {
                self.discard();
                self.state = State::Starting(self.since + k as usize);
                Some(self.idle(sequence, i))
            }
            (Protocol::Every(k), Ok((row, _))) => {
                if i >= self.since + k as usize && truth.is_some() && i + 1 < sequence.len() {
                    // Refused: without output until the next.
                    let _ = self.start(ready, sequence, make);
                }
                Some(row)
            }
            (_, Ok((row, _))) => Some(row),
            (_, Err(panic)) => {
                self.fail(format!("panic in frame {i}: {panic}"));
                None
            }
        }
    }

    /// A failure in frame `i`, whose row is `row` if there is one: ends the stretch. The row keeps the errors of what the
    /// tracker gave, which are there to be seen.
    fn failure(&mut self, row: Option<Row>, skip: u32, sequence: &Sequence, i: usize) -> Row {
        self.discard();
        self.state = State::Starting(i + skip as usize);
        let row = row.unwrap_or_else(|| Row {
            dense: self.dense_errors(None, sequence, i, None),
            ..Row::without_tracker(FAILED)
        });
        Row {
            status: FAILED,
            ..row
        }
    }

    /// The row of a frame in which nothing is tracked.
    fn idle(&self, sequence: &Sequence, i: usize) -> Row {
        match self.course {
            Protocol::Every(_) => Row {
                dense: self.dense_errors(None, sequence, i, None),
                ..Row::without_tracker(BROKEN)
            },
            _ => Row::without_tracker(SKIPPED),
        }
    }

    /// Values of the dense metrics in frame `i`, where both it and the frame of the start have dense truth; without corners
    /// those of no output. A tracker that does not say where its points are moves them as a plane.
    fn dense_errors(
        &self,
        tracker: Option<&dyn Tracker>,
        sequence: &Sequence,
        i: usize,
        corners: Option<Corners>,
    ) -> Option<Box<[f64]>> {
        let (first, truth) = (sequence.dense_truth(self.since)?, sequence.dense_truth(i)?);
        let plane = || homography::from_corners(&sequence.truth_from(self.since, self.since)?, &corners?);
        let places = plane().map(|plane| {
            let told = |x: [f64; 2]| tracker.and_then(|t| t.place(x));
            let place = |&x: &[f64; 2]| told(x).unwrap_or_else(|| homography::apply(&plane, x));
            first.iter().map(place).collect::<Vec<_>>()
        });
        Some(self.metrics.dense_errors(places.as_deref(), truth))
    }

    fn discard(&mut self) {
        drop_quietly(self.tracker.take());
    }
}

/// Dropping what has panicked may panic again.
fn drop_quietly(tracker: Option<Box<dyn Tracker>>) {
    let _ = panics::catch(|| drop(tracker));
}

/// Starts `tracker`; its corners after that.
fn initialise(
    tracker: &mut dyn Tracker,
    sequence: &Sequence,
    ready: &Ready,
) -> Result<Option<Corners>, String> {
    let truth = sequence
        .truth_from(ready.index, ready.index)
        .ok_or_else(|| format!("no ground truth in frame {} to start from", ready.index))?;
    if tracker.needs_truth().is_some()
        && let Some(i) = (ready.index..sequence.len()).find(|&i| sequence.truth(i).is_none())
    {
        return Err(format!(
            "the tracker is for analysis and needs ground truth in every frame; {} has none",
            sequence.frame_name(i)
        ));
    }
    tracker
        .init(&ready.frame, &truth)
        .map_err(|e| format!("cannot start on {}: {e}", sequence.frame_name(ready.index)))?;
    Ok(round_corners(&tracker.corners()))
}

/// The row of one update, and whether it succeeded.
fn update(tracker: &mut dyn Tracker, frame: &Frame) -> (Row, bool) {
    match tracker.update(frame) {
        Ok(update) => {
            let corners = round_corners(&update.corners);
            let status = match (corners, update.stop) {
                (None, _) => "not_finite",
                (_, Stop::Converged) => "converged",
                (_, Stop::MaxIterations) => "max_iters",
                (_, Stop::Done) => "ok",
                (_, Stop::Absent) => ABSENT,
            };
            let row = Row {
                corners,
                iterations: update.iterations,
                similarity: update.similarity,
                ..Row::without_tracker(status)
            };
            (row, true)
        }
        // The tracker stands where it last was: that is its answer, and it goes on from there.
        Err(error) => {
            let row = Row {
                corners: round_corners(&tracker.corners()),
                ..Row::without_tracker(error.word())
            };
            (row, false)
        }
    }
}
