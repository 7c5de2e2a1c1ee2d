//! Runs units: each frame of a sequence is decoded and filtered once and given to every tracker of a group.
//!
//! Frames are decoded a window ahead while the first trackers of a group work through the current window in parallel. Where
//! the frames of the whole sequence fit into memory, they are kept, and the other units of the group go through them one
//! after another on each thread: each is written as it ends, so that an interruption costs no more than the units in
//! progress. Where they do not fit, all trackers of the group go from window to window together, so memory does not depend
//! on a sequence's length (but for its log rows, which count towards the size of a group); their [`Pace`] says how many
//! those are. As many groups run at once as it takes to fill the threads, and one more to fill in where a group waits for
//! its slowest; each is driven by a plain thread that hands work to one pool, so nesting stays bounded.

use crate::dataset::Sequence;
use crate::metric::quantile;
use crate::panics;
use crate::plan::{FrameLogs, Job, Prepared, RunRequest, Unit, UnitKeys};
use crate::run::error::RunError;
use crate::run::observer::Observer;
use crate::run::pass::{Pass, Ready};
use crate::run::profile::{Activity, Spent};
use crate::run::watch::{Ended, Watch};
use crate::store::Durable;
use crate::store::framelog::{Row, format_log, pack_log, score_rows};
use crate::store::host::build;
use crate::store::journal::{Entry, EntryStatus, Finished, UnitTime};
use crate::store::rundir::{RunDir, digest};
use mtf::image::{Frame, Pixels};
use mtf::interrupt;
use mtf::tracker::{Tracker, afford};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

/// Most units that go through a sequence together.
const GROUP: usize = 256;
/// Units per thread that go through a sequence together where its frames are not kept, to begin with.
const PER_THREAD: usize = 4;
/// Time of reading relative to tracking above which more units go together: less is little beside tracking, and fewer units
/// together end sooner.
const READING_SHARE: f64 = 0.05;
/// How often a tracker tells how far it is.
const TELL_EVERY: Duration = Duration::from_millis(100);
/// Most frames decoded ahead.
const WINDOW: usize = 16;
/// Share of the memory budget that frames decoded ahead may take.
const FRAME_SHARE: u64 = 8;
/// Share of the memory budget that kept sequences may take.
const KEPT_SHARE: u64 = 2;
/// Bytes a frame costs a unit until its log is written.
const ROW_BYTES: u64 = (size_of::<Row>() + size_of::<f32>()) as u64;

/// What all groups share.
pub(crate) struct Context<'a> {
    pub request: &'a RunRequest,
    pub prepared: &'a Prepared<'a>,
    pub keys: &'a UnitKeys,
    pub dir: &'a RunDir,
    pub observer: &'a dyn Observer,
    /// Set by a signal.
    pub stop: &'a AtomicBool,
    /// When it was first seen to be set.
    pub stopped: OnceLock<Instant>,
    /// Set when a file could not be written, by whoever met the error first.
    pub broken: AtomicBool,
    pub error: Mutex<Option<RunError>>,
    pub pool: &'a rayon::ThreadPool,
    pub pace: Pace,
    /// Groups that run at once.
    pub at_once: usize,
    pub spent: Spent,
    /// Ends starts and updates that take too long.
    pub watch: Watch,
}

/// How many units go through a sequence together.
#[derive(Debug)]
pub(crate) struct Pace {
    /// Where all frames are kept: those that go first, while frames are decoded.
    first: usize,
    /// Where they are not. Twice as many as long as reading takes its share.
    together: AtomicUsize,
}

impl Pace {
    /// Of a run that will be stopped soon, perhaps (`hurry`), or that was stopped before it got anything done (`stuck`).
    pub fn new(hurry: bool, stuck: bool, threads: usize) -> Pace {
        let first = if stuck { 1 } else { threads };
        let together = if hurry || stuck {
            first
        } else {
            PER_THREAD * threads
        };
        Pace {
            first,
            together: AtomicUsize::new(together.min(GROUP)),
        }
    }

    /// The units of the next group where frames are not kept.
    fn together(&self) -> usize {
        self.together.load(Ordering::Relaxed)
    }

    /// A group of `units` units has ended; reading took `share` of the time of tracking so far.
    fn learn(&self, units: usize, share: f64) {
        // Once for groups that ran at the same time.
        if share > READING_SHARE && units >= self.together() {
            self.together.store((2 * units).min(GROUP), Ordering::Relaxed);
        }
    }
}

impl Context<'_> {
    /// Nothing new is to be begun.
    fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.broken.load(Ordering::Relaxed)
    }

    /// What is in progress is to be given up.
    pub fn halted(&self) -> bool {
        let late = || {
            let since = self.stopped.get_or_init(|| {
                if !self.request.grace.is_zero() {
                    self.observer.stopping(self.request.grace);
                }
                Instant::now()
            });
            since.elapsed() >= self.request.grace
        };
        self.broken.load(Ordering::Relaxed) || (self.stop.load(Ordering::Relaxed) && late())
    }

    /// Keeps the first error and stops everything.
    pub fn fail(&self, error: RunError) {
        let mut first = self.error.lock().unwrap_or_else(|e| e.into_inner());
        first.get_or_insert(error);
        self.broken.store(true, Ordering::Relaxed);
    }

    fn sequence(&self, unit: &Unit) -> &Sequence {
        self.prepared.sequences[unit.sequence as usize]
    }
}

/// How many of `groups` groups of at most `trackers` trackers to run at once to keep `threads` busy.
pub(crate) fn groups_at_once(threads: usize, trackers: usize, groups: usize) -> usize {
    let spare = usize::from(threads > 1);
    let fill = (2 * threads).div_ceil(trackers.max(1)) + spare;
    fill.min(threads).clamp(1, groups.max(1))
}

/// Cuts the units of a sequence into groups, as many as it takes to occupy `threads`.
pub(crate) fn groups(units: &[Unit], threads: usize) -> impl Iterator<Item = &[Unit]> {
    units.chunks(GROUP.max(4 * threads))
}

/// Runs `pending` (groups of units of one sequence each) to their end or until halted; what is finished goes to `journal`.
pub(crate) fn run_units(context: &Context<'_>, journal: SyncSender<Finished>, mut pending: Vec<&[Unit]>) {
    // The longest first, so that none is left to run alone at the end.
    pending.sort_by_key(|units| {
        std::cmp::Reverse(units.len() * units.first().map_or(0, |u| context.sequence(u).len()))
    });
    let work = Mutex::new(VecDeque::from(pending));
    let journal = &journal;
    let drive = || {
        while !context.stopping() {
            let next = work.lock().unwrap_or_else(|e| e.into_inner()).pop_front();
            match next {
                Some(units) => run_sequence(context, journal, units),
                None => break,
            }
        }
    };
    std::thread::scope(|scope| {
        // Where the system grants no more threads, this one does it all.
        for _ in 1..context.at_once {
            let _ = std::thread::Builder::new().spawn_scoped(scope, drive);
        }
        drive();
    });
}

fn run_sequence(context: &Context<'_>, journal: &SyncSender<Finished>, units: &[Unit]) {
    let Some(first) = units.first() else { return };
    let sequence = context.sequence(first);
    let budget = context.request.memory / context.at_once as u64;
    let mut waiting: VecDeque<&Unit> = units.iter().collect();
    let mut unreadable: Option<String> = None;
    while !waiting.is_empty() && !context.stopping() {
        let mut kept = Kept::new(context, sequence, &waiting);
        let most = if kept.is_wanted() {
            context.pace.first
        } else {
            context.pace.together()
        };
        let mut group = Vec::new();
        let mut bytes = 0;
        while let Some(&unit) = waiting.front().filter(|_| group.len() < most) {
            let pass = prepare(context, unit, unreadable.as_deref());
            bytes += memory(sequence, &pass);
            // The first tracker over the budget is made again for the next group.
            if bytes > budget && !group.is_empty() {
                break;
            }
            group.push(pass);
            waiting.pop_front();
        }
        let read = run_group(context, sequence, budget, &mut group, &mut waiting, &mut kept);
        if context.halted() {
            return;
        }
        if let Err(reason) = read {
            unreadable.get_or_insert(reason);
        }
        let units = group.len();
        context.pool.install(|| {
            group.into_par_iter().with_max_len(1).for_each(|pass| {
                let write = || finish(context, journal, sequence, pass);
                context.spent.on(Activity::Writing, write);
            });
        });
        match kept.whole() {
            Some(frames) => waiting = run_each(context, journal, frames, budget, waiting),
            None => context.pace.learn(units, context.spent.reading_share()),
        }
    }
}

/// Runs each of the units `waiting` through the frames of its sequence, and writes it as it ends. Those that need other
/// frames, or for whose tracker there is no room beside the others, are returned.
fn run_each<'a>(
    context: &Context<'_>,
    journal: &SyncSender<Finished>,
    frames: &[Ready],
    budget: u64,
    waiting: VecDeque<&'a Unit>,
) -> VecDeque<&'a Unit> {
    let left = Mutex::new(VecDeque::new());
    let leave = |unit| left.lock().unwrap_or_else(|e| e.into_inner()).push_back(unit);
    let used = AtomicU64::new(0);
    let run = |unit: &'a Unit| {
        if context.stopping() {
            return;
        }
        let sequence = context.sequence(unit);
        let mut pass = prepare(context, unit, None);
        let bytes = memory(sequence, &pass);
        let channels = pass.tracker.as_ref().map(|t| t.channels());
        let there = frames
            .first()
            .is_some_and(|ready| ready.index <= unit.start as usize && channels.is_none_or(|n| ready.has(n)));
        if !there {
            return leave(unit);
        }
        if used.fetch_add(bytes, Ordering::Relaxed) + bytes > budget {
            used.fetch_sub(bytes, Ordering::Relaxed);
            return leave(unit);
        }
        let track = || track_window(context, sequence, &mut pass, frames);
        let ended = context.spent.on(Activity::Tracking, track);
        if ended {
            let write = || finish(context, journal, sequence, pass);
            context.spent.on(Activity::Writing, write);
        }
        used.fetch_sub(bytes, Ordering::Relaxed);
    };
    context.pool.install(|| {
        let waiting: Vec<&Unit> = waiting.into();
        waiting.into_par_iter().with_max_len(1).for_each(run);
    });
    left.into_inner().unwrap_or_else(|e| e.into_inner())
}

/// The frames of a sequence, kept for the units that follow the first ones.
struct Kept {
    frames: Vec<Ready>,
    /// Frames that there will be; `None` when they are not kept.
    count: Option<usize>,
    /// Bytes they may take.
    room: u64,
}

impl Kept {
    /// For the units `waiting` of `sequence`, if there are more than go first and there is room.
    fn new(context: &Context<'_>, sequence: &Sequence, waiting: &VecDeque<&Unit>) -> Kept {
        let first = waiting.iter().map(|unit| unit.start as usize).min();
        let count = sequence.len() - first.unwrap_or(0);
        let mut kept = Kept {
            frames: Vec::new(),
            count: (waiting.len() > context.pace.first).then_some(count),
            room: context.request.memory / KEPT_SHARE / context.at_once as u64,
        };
        kept.fit(frame_bytes((sequence.width(), sequence.height()), true, false));
        kept
    }

    /// Gives up if frames of so many bytes do not fit.
    fn fit(&mut self, bytes: u64) {
        self.count = self
            .count
            .filter(|&n| (n as u64).saturating_mul(bytes) <= self.room);
    }

    fn is_wanted(&self) -> bool {
        self.count.is_some()
    }

    fn add(&mut self, window: Vec<Ready>) {
        if self.is_wanted() {
            self.frames.extend(window);
        }
    }

    /// All of them, if they were kept.
    fn whole(&self) -> Option<&[Ready]> {
        (self.count? == self.frames.len()).then_some(&self.frames)
    }
}

/// Bytes of a frame of `size`: its pixels, and its planes with their pyramids, which take a third as much again.
fn frame_bytes((width, height): (usize, usize), gray: bool, colour: bool) -> u64 {
    let planes = u64::from(gray) + 3 * u64::from(colour);
    let pixels = (width * height) as u64;
    pixels * (1 + 2 * u64::from(colour)) + pixels * 4 * planes * 4 / 3
}

/// Bytes that a unit takes.
fn memory(sequence: &Sequence, pass: &Pass<'_>) -> u64 {
    let rows = ROW_BYTES * (sequence.len() as u64 - u64::from(pass.unit.start));
    rows + pass.tracker.as_ref().map_or(0, |t| t.memory() as u64)
}

/// Makes the unit's tracker.
fn prepare<'a>(context: &Context<'_>, unit: &'a Unit, unreadable: Option<&str>) -> Pass<'a> {
    let made = match unreadable {
        Some(reason) => Err(reason.to_string()),
        None => make(context, unit, unit.start),
    };
    Pass::new(
        unit,
        context.prepared.plan.course(unit),
        &context.request.metrics,
        made,
    )
}

/// Makes a tracker for the unit that is to start on `frame`. It does not depend on what the unit did before that.
fn make(context: &Context<'_>, unit: &Unit, frame: u32) -> Result<Box<dyn Tracker>, String> {
    let make = &context.prepared.trackers[unit.tracker as usize].make;
    let job = Job {
        sequence: Some(context.sequence(unit)),
        start: frame as usize,
    };
    let mut tracker = panics::catch(|| make(job)).and_then(|made| made)?;
    tracker.reseed(context.prepared.plan.seed_at(unit, frame));
    tracker.set_threads(context.request.threads_per_tracker);
    // Before it is started, as no one could stop it then.
    let fits = panics::catch(|| afford(tracker.as_ref(), context.request.memory))?;
    fits.map_err(|e| format!("{e}, or more --memory"))?;
    Ok(tracker)
}

/// Runs a group over its sequence; units whose trackers turn out not to fit the budget go back to those `waiting`. An
/// unreadable frame fails the units of the group and is returned.
fn run_group<'a>(
    context: &Context<'_>,
    sequence: &Sequence,
    budget: u64,
    group: &mut Vec<Pass<'a>>,
    waiting: &mut VecDeque<&'a Unit>,
    kept: &mut Kept,
) -> Result<(), String> {
    let Some(first) = group
        .iter()
        .filter(|pass| !pass.is_over())
        .map(|pass| pass.unit.start as usize)
        .min()
    else {
        return Ok(());
    };
    let channels = |n| {
        group
            .iter()
            .filter_map(|pass| pass.tracker.as_ref())
            .any(|t| t.channels() == n)
    };
    let (gray, colour) = (channels(1), channels(3));
    let read = |range: Range<usize>| decode(context, sequence, range, gray, colour);

    // The first frame alone, to learn how much memory a frame takes.
    let window = match context
        .pool
        .install(|| read(first..sequence.len().min(first + 1)))
    {
        Ok(window) => window,
        Err(reason) => {
            fail_all(group, &reason);
            return Err(reason);
        }
    };
    let ahead = window.first().map_or(WINDOW, |ready| {
        let bytes = frame_bytes((ready.frame.width(), ready.frame.height()), gray, colour);
        kept.fit(bytes);
        let room = context.request.memory / FRAME_SHARE / context.at_once as u64 / 2;
        ((room / bytes.max(1)) as usize).clamp(1, WINDOW)
    });
    // Started a few at a time: only then do all trackers know what they need.
    let mut used = 0;
    let mut started = 0;
    while started < group.len() && (started == 0 || used <= budget) && !context.halted() {
        let end = group.len().min(started + 2 * context.pool.current_num_threads());
        let few = &mut group[started..end];
        context.pool.install(|| {
            few.par_iter_mut().with_max_len(1).for_each(|pass| {
                let track = || track_window(context, sequence, pass, &window);
                context.spent.on(Activity::Tracking, track);
            })
        });
        used += few.iter().map(|pass| memory(sequence, pass)).sum::<u64>();
        started = end;
    }
    for pass in group.drain(started..).rev() {
        waiting.push_front(pass.unit);
    }
    let upcoming = |from: usize| from..sequence.len().min(from + ahead);
    kept.add(window);
    let mut next = context.pool.install(|| read(upcoming(first + 1)));
    loop {
        let window = match next {
            Ok(window) => window,
            Err(reason) => {
                fail_all(group, &reason);
                return Err(reason);
            }
        };
        // Frames that are kept are read to the end: the next units need them.
        let idle = !kept.is_wanted() && group.iter().all(Pass::is_over);
        let Some(last) = window.last().filter(|_| !idle && !context.halted()) else {
            return Ok(());
        };
        let following = upcoming(last.index + 1);
        ((), next) = context.pool.install(|| {
            rayon::join(
                || {
                    group.par_iter_mut().with_max_len(1).for_each(|pass| {
                        let track = || track_window(context, sequence, pass, &window);
                        context.spent.on(Activity::Tracking, track);
                    })
                },
                || read(following),
            )
        });
        kept.add(window);
    }
}

fn fail_all(group: &mut [Pass<'_>], reason: &str) {
    for pass in group.iter_mut().filter(|pass| !pass.is_over()) {
        pass.fail(reason.to_string());
    }
}

/// Reads frames in parallel, those of one file in order; the first unreadable one is the error.
fn decode(
    context: &Context<'_>,
    sequence: &Sequence,
    range: Range<usize>,
    gray: bool,
    colour: bool,
) -> Result<Vec<Ready>, String> {
    let read = |index: usize| -> Result<Ready, String> {
        let begin = Instant::now();
        let decode = || panics::catch(|| sequence.read(index, colour));
        let decoded = match gray || colour {
            true => context.spent.on(Activity::Reading, decode)?,
            // Nobody looks at it.
            false => Ok(Pixels::from_gray(1, 1, vec![0])),
        };
        let frame = Frame::new(
            decoded.map_err(|e| e.to_string())?,
            Arc::clone(&context.request.pre),
        );
        let filter = || {
            // Filtered here, so that no tracker's time includes it.
            if gray {
                frame.gray();
            }
            if colour {
                frame.colour();
            }
        };
        context.spent.on(Activity::Filtering, || panics::catch(filter))?;
        Ok(Ready {
            index,
            frame,
            gray,
            colour,
            seconds: begin.elapsed().as_secs_f64(),
        })
    };
    if sequence.in_order() {
        return range.map(read).collect();
    }
    let frames: Vec<Result<Ready, String>> = range.into_par_iter().with_max_len(1).map(read).collect();
    frames.into_iter().collect()
}

/// One tracker through one window, in order, until its time is up; false when it was given up before the end.
fn track_window(context: &Context<'_>, sequence: &Sequence, pass: &mut Pass<'_>, window: &[Ready]) -> bool {
    let limit = context.request.timeout;
    let left = limit.map(|limit| limit.saturating_sub(pass.spent()));
    let track = || track_frames(context, sequence, pass, window);
    let (whole, ended) = context.watch.over(left, track);
    match (whole, ended, limit) {
        (_, Ended::Halted, _) => return false,
        (_, Ended::Late, Some(limit)) => pass.time_out(limit),
        (whole, ..) => return whole,
    }
    true
}

/// The frames of a window, one after the other; false if the run was halted.
fn track_frames(context: &Context<'_>, sequence: &Sequence, pass: &mut Pass<'_>, window: &[Ready]) -> bool {
    let start = pass.unit.start as usize;
    let unit = pass.unit;
    let make_at = |frame: u32| make(context, unit, frame);
    let (mut done, mut since) = (0, Instant::now());
    let mut tell = |count: usize, always: bool| {
        done += count as u64;
        let elapsed = since.elapsed();
        if (always && done > 0) || elapsed >= TELL_EVERY {
            let told = std::mem::take(&mut done);
            context.observer.frames(unit.tracker, told, elapsed.as_secs_f64());
            since = Instant::now();
        }
    };
    for ready in window.iter().filter(|ready| ready.index >= start) {
        if pass.is_over() || interrupt::requested() {
            break;
        }
        if context.halted() {
            return false;
        }
        tell(pass.advance(ready, sequence, &make_at), false);
        // An update that does not look may take longer all the same.
        let late = |limit: &Duration| pass.failed.is_none() && pass.spent() > *limit;
        if let Some(limit) = context.request.timeout.filter(late) {
            pass.time_out(limit);
        }
    }
    tell(0, true);
    true
}

/// Writes the unit's log and sends its line to the journal.
fn finish(context: &Context<'_>, journal: &SyncSender<Finished>, sequence: &Sequence, pass: Pass<'_>) {
    let Pass {
        unit,
        rows,
        init_seconds,
        seconds,
        input_seconds,
        failed,
        ..
    } = pass;
    let plan = &context.prepared.plan;
    let path = context.dir.log(plan, unit);
    let start = unit.start as usize;
    let truth = |since: usize, i: usize| sequence.truth_from(since, i);
    let ok = failed.is_none();
    let mut entry = Entry {
        key: context.keys.of(unit),
        tracker: plan.trackers[unit.tracker as usize].id.clone(),
        dataset: sequence.dataset().to_string(),
        sequence: sequence.name().to_string(),
        start: unit.start,
        course: plan.course_name(unit),
        status: if ok { EntryStatus::Ok } else { EntryStatus::Failed },
        reason: failed,
        frames: rows.len(),
        log: None,
        errors: None,
        grid: Vec::new(),
        build: build().to_owned(),
        time: UnitTime {
            init_seconds: nano(init_seconds),
            ..unit_time(seconds, input_seconds, context.pool.current_num_threads())
        },
    };
    let mut written = None;
    let (logs, metrics) = (context.request.frame_logs, &context.request.metrics);
    let errors = || score_rows(metrics, &rows, start, |i| sequence.truth(i).is_some(), truth);
    // Frames that a failed unit did not reach need not be tracked any more.
    let unreached = plan.unit_frames(unit).saturating_sub(rows.len() as u64);
    if unreached > 0 {
        context.observer.frames(unit.tracker, unreached, 0.0);
    }
    if ok && logs != FrameLogs::None {
        let name = |i: usize| sequence.frame_name(i).to_string();
        let text = format_log(metrics, &rows, start, name, truth);
        let bytes = pack_log(text, logs);
        entry.log = Some(digest(&bytes));
        // Synced in groups by the journal, before the line that vouches for it.
        if let Err(error) = context.dir.put(&path, &bytes, Durable::Later) {
            return context.fail(error.into());
        }
        written = Some(path);
    } else {
        if ok {
            let errors = errors();
            (entry.errors, entry.grid) = (Some(errors.rows()), errors.dense_rows());
        }
        if logs != FrameLogs::None {
            // A log of an earlier run with other settings would be taken for this unit's by readers.
            let _ = std::fs::remove_file(path);
        }
    }
    context.observer.unit(&entry, &errors);
    // The receiver only goes away after an error, which it has recorded.
    let _ = journal.send(Finished { entry, log: written });
}

/// Rounded to a billionth.
fn nano(seconds: f64) -> f64 {
    (seconds * 1e9).round() / 1e9
}

fn unit_time(mut seconds: Vec<f32>, input_seconds: f64, threads: usize) -> UnitTime {
    // The sum of nothing would be -0.
    let total = seconds.iter().fold(0.0, |total, &s| total + f64::from(s));
    seconds.sort_by(f32::total_cmp);
    let quantile = |q: f64| quantile::nearest(&seconds, q).map_or(0.0, |s| nano(1e3 * f64::from(s)));
    UnitTime {
        init_seconds: 0.0,
        seconds: nano(total),
        ms_median: quantile(0.5),
        ms_p95: quantile(0.95),
        input_seconds: nano(input_seconds),
        updates: seconds.len(),
        threads,
        finished: crate::store::host::utc_now(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_fill_the_threads_and_no_more() {
        assert_eq!(groups_at_once(1, 1, 12), 1);
        assert_eq!(groups_at_once(8, 1, 12), 8);
        assert_eq!(groups_at_once(8, 1, 3), 3);
        assert_eq!(groups_at_once(8, 5, 12), 5);
        assert_eq!(groups_at_once(8, 256, 12), 2);
        assert_eq!(groups_at_once(1, 256, 12), 1);
        assert_eq!(groups_at_once(2, 1, 0), 1);
    }

    #[test]
    fn groups_grow_as_long_as_reading_costs() {
        let pace = Pace::new(false, false, 2);
        assert_eq!(pace.together(), 8);
        pace.learn(8, 0.01);
        assert_eq!(pace.together(), 8);
        pace.learn(8, 0.5);
        // One that ran at the same time, or had no room for more.
        pace.learn(8, 0.5);
        assert_eq!(pace.together(), 16);
        for _ in 0..9 {
            pace.learn(pace.together(), 0.5);
        }
        assert_eq!(pace.together(), GROUP);
        assert_eq!(Pace::new(true, false, 2).together(), 2);
        assert_eq!(Pace::new(false, true, 2).together(), 1);
    }

    #[test]
    fn quantiles_are_taken_over_the_updates() {
        let time = unit_time((1..=100).rev().map(|k| k as f32 * 1e-3).collect(), 0.5, 2);
        assert!((time.seconds - 5.05).abs() < 1e-6);
        assert!((time.ms_median - 51.0).abs() < 1e-4 && (time.ms_p95 - 95.0).abs() < 1e-4);
        assert_eq!(unit_time(Vec::new(), 0.0, 1).ms_p95, 0.0);
    }
}
