//! Progress of long work on stderr: a bar on terminals, now and then a line elsewhere. A run's bar has the trackers that
//! lead so far below it.

use super::args::ProgressMode;
use super::console::{Console, clock};
use crate::metric::{Errors, Sample};
use crate::plan::Remaining;
use crate::run::{Observer, Work};
use crate::store::journal::{Entry, EntryStatus};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Silence of plain progress before its first line.
const FIRST_LINE: Duration = Duration::from_secs(1);
/// Longest silence of plain progress after that.
const LINE_EVERY: Duration = Duration::from_secs(5);
/// How often the text beside a bar changes.
const REDRAW_EVERY: Duration = Duration::from_millis(200);
/// Trackers shown below a bar.
const LEADERS: usize = 3;

/// A bar on terminals, lines elsewhere, or nothing, as the user asked for it.
pub struct Meter<'a> {
    console: &'a Console,
    bar: ProgressBar,
    plain: bool,
    lines: Mutex<Lines>,
}

/// When something was last said.
struct Lines {
    began: Instant,
    last: Option<Instant>,
    drawn: Option<Instant>,
}

impl<'a> Meter<'a> {
    /// Nothing is said before [`begin`](Self::begin). A bar may have lines below it (`below`).
    pub fn new(console: &'a Console, mode: ProgressMode, below: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let show = !console.quiet && mode != ProgressMode::None;
        let bar = if show && terminal && mode == ProgressMode::Auto {
            // Ten redraws a second are enough and cost nothing.
            let target = ProgressDrawTarget::stderr_with_hz(10);
            let style = ProgressStyle::with_template(match below {
                true => "{wide_bar} {percent:>3} %  {msg}\n{prefix}",
                false => "{wide_bar} {percent:>3} %  {msg}",
            });
            ProgressBar::with_draw_target(None, target)
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        } else {
            ProgressBar::hidden()
        };
        Meter {
            console,
            plain: show && bar.is_hidden(),
            bar,
            lines: Mutex::new(Lines {
                began: Instant::now(),
                last: None,
                drawn: None,
            }),
        }
    }

    /// There are `steps` steps to do.
    pub fn begin(&self, steps: u64) {
        if let Ok(mut lines) = self.lines.lock() {
            lines.began = Instant::now();
        }
        self.bar.set_length(steps);
        self.bar.tick();
    }

    /// `count` more steps are done. `text` says how things stand, `below` what is shown below a bar.
    pub fn step(&self, count: u64, text: &dyn Fn() -> String, below: &dyn Fn() -> String) {
        self.bar.inc(count);
        // Whoever comes while another prints has nothing to add.
        let Ok(mut lines) = self.lines.try_lock() else {
            return;
        };
        let now = Instant::now();
        let since = |at: Option<Instant>| at.map(|at| now.duration_since(at));
        if self.plain {
            let due = match since(lines.last) {
                None => now.duration_since(lines.began) >= FIRST_LINE,
                Some(silence) => silence >= LINE_EVERY,
            };
            if due {
                lines.last = Some(now);
                self.console.line(&text());
            }
        } else if !self.bar.is_hidden() && since(lines.drawn).is_none_or(|t| t >= REDRAW_EVERY) {
            lines.drawn = Some(now);
            self.bar.set_message(text());
            self.bar.set_prefix(below());
        }
    }

    /// There is a bar with room below it.
    fn is_bar(&self) -> bool {
        !self.bar.is_hidden()
    }

    /// Says something above the bar.
    fn say(&self, say: impl FnOnce(&Console)) {
        self.bar.suspend(|| say(self.console));
    }

    /// Takes the bar away and leaves a clean line.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }
}

/// Shows a run's progress.
pub struct Progress<'a> {
    console: &'a Console,
    meter: Meter<'a>,
    state: Mutex<State>,
    stopping: AtomicBool,
}

/// How far a run is.
struct State {
    began: Instant,
    pending: usize,
    remaining: Remaining,
    frames: u64,
    units: usize,
    failed: usize,
    leaders: Leaders,
}

impl State {
    /// Units, failures and speed.
    fn summary(&self) -> String {
        let rate = self.frames as f64 / self.began.elapsed().as_secs_f64().max(1e-3);
        let failed = match self.failed {
            0 => String::new(),
            n => format!(", {n} failed"),
        };
        format!(
            "{}/{} units{failed}, {rate:.0} frames/s",
            self.units, self.pending
        )
    }

    /// The same, and the time that the rest will take.
    fn line(&self) -> String {
        match self.remaining.left() {
            None => self.summary(),
            Some(left) => {
                // As many trackers work at once as until now.
                let threads = self.remaining.spent() / self.began.elapsed().as_secs_f64().max(1e-3);
                let left = clock(left / threads.max(1e-3));
                format!("{}, about {left} left", self.summary())
            }
        }
    }
}

/// Success of trackers so far.
#[derive(Default)]
struct Leaders(BTreeMap<String, Lead>);

#[derive(Default)]
struct Lead {
    /// `auc` of each unit times its frames.
    sum: f64,
    frames: f64,
    units: usize,
}

impl Leaders {
    /// A unit of the tracker `id` has ended.
    fn add(&mut self, id: &str, errors: &Errors) {
        let sample = Sample::new(errors.metrics(), [errors]);
        let frames = sample.frames() as f64;
        if frames > 0.0 {
            let lead = self.0.entry(id.to_owned()).or_default();
            // Number 0 is the primary metric.
            lead.sum += sample.auc(0) * frames;
            lead.frames += frames;
            lead.units += 1;
        }
    }

    /// The best by `auc` over the frames of their units so far, each on a line of its own.
    fn text(&self) -> String {
        let mut all: Vec<(&String, &Lead)> = self.0.iter().collect();
        let auc = |lead: &Lead| lead.sum / lead.frames;
        all.sort_by(|a, b| auc(b.1).total_cmp(&auc(a.1)).then_with(|| a.0.cmp(b.0)));
        let line = |(id, lead): (&String, &Lead)| {
            let units = if lead.units == 1 { "unit" } else { "units" };
            format!("  AUC {:.3} so far, {} {units}: {id}", auc(lead), lead.units)
        };
        let lines: Vec<String> = all.into_iter().take(LEADERS).map(line).collect();
        lines.join("\n")
    }
}

impl<'a> Progress<'a> {
    /// Progress as the user asked for it.
    pub fn new(console: &'a Console, mode: ProgressMode) -> Self {
        Progress {
            console,
            meter: Meter::new(console, mode, true),
            state: Mutex::new(State {
                began: Instant::now(),
                pending: 0,
                remaining: Remaining::default(),
                frames: 0,
                units: 0,
                failed: 0,
                leaders: Leaders::default(),
            }),
            stopping: AtomicBool::new(false),
        }
    }

    fn with<R>(&self, f: impl FnOnce(&mut State) -> R) -> R {
        f(&mut self.state.lock().unwrap_or_else(|e| e.into_inner()))
    }
}

impl Observer for Progress<'_> {
    fn begin(&self, work: &Work<'_>) {
        let pending = work.pending.len();
        let resumed = match work.units - pending {
            0 => String::new(),
            n => format!(" ({n} of {} are done already)", work.units),
        };
        self.console.note(&format!(
            "{pending} units (one tracker on one sequence each) to track{resumed}"
        ));
        self.with(|state| {
            state.began = Instant::now();
            state.pending = pending;
            state.remaining = Remaining::new(work.plan, work.pending);
        });
        let frames = work.pending.iter().map(|unit| work.plan.unit_frames(unit)).sum();
        self.meter.begin(frames);
    }

    fn frames(&self, tracker: u32, count: u64, seconds: f64) {
        self.with(|state| {
            state.frames += count;
            state.remaining.add(tracker, count, seconds);
        });
        if !self.stopping.load(Ordering::Relaxed) {
            let line = || self.with(|state| state.line());
            let leaders = || self.with(|state| state.leaders.text());
            self.meter.step(count, &line, &leaders);
        }
    }

    fn unit(&self, entry: &Entry, errors: &dyn Fn() -> Errors) {
        let errors = (self.meter.is_bar() && entry.status == EntryStatus::Ok).then(errors);
        self.with(|state| {
            state.units += 1;
            state.failed += usize::from(entry.reason.is_some());
            if let Some(errors) = &errors {
                state.leaders.add(&entry.tracker, errors);
            }
        });
        if self.console.verbose > 0 {
            let outcome = entry.reason.as_deref().unwrap_or("ok");
            let seconds = entry.time.seconds;
            self.meter.say(|console| {
                console.line(&format!(
                    "{} on {}/{}: {outcome} ({seconds:.2} s)",
                    entry.tracker, entry.dataset, entry.sequence
                ));
            });
        }
    }

    fn stopping(&self, grace: Duration) {
        self.stopping.store(true, Ordering::Relaxed);
        // For good: whoever interrupts again is to find a clean line.
        self.meter.end();
        let seconds = grace.as_secs_f64();
        self.console.note(&format!(
            "stopping: what is being tracked has {seconds} s to end (interrupt again to stop at once)"
        ));
    }

    fn end(&self) {
        self.meter.end();
        let (summary, whole) = self.with(|state| {
            let seconds = state.began.elapsed().as_secs_f64();
            (
                format!("{} in {seconds:.1} s", state.summary()),
                state.units == state.pending,
            )
        });
        // What is kept of a run that was stopped is said by its end.
        if whole {
            self.console.note(&summary);
        }
    }

    fn warn(&self, message: &str) {
        self.meter.say(|console| console.warn(message));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::MetricSet;
    use mtf::geom::Corners;

    #[test]
    fn leaders_are_the_best_over_their_frames() {
        let metrics = MetricSet::builtin();
        let truth = Corners::rect(40.0, 40.0, 100.0, 80.0);
        let errors = |shifts: &[f64]| {
            let mut errors = Errors::new(&metrics);
            for d in shifts {
                errors.push(Some(&truth.translated(*d, 0.0)), &truth);
            }
            errors
        };
        let mut leaders = Leaders::default();
        assert_eq!(leaders.text(), "");
        leaders.add("a", &errors(&[0.0]));
        leaders.add("a", &errors(&[30.0, 30.0, 30.0]));
        leaders.add("b", &errors(&[0.1]));
        leaders.add("c", &errors(&[1.0]));
        leaders.add("d", &errors(&[100.0]));
        // Nothing was evaluated.
        leaders.add("e", &errors(&[]));
        assert_eq!(
            leaders.text(),
            "  AUC 1.000 so far, 1 unit: b\n  AUC 0.960 so far, 1 unit: c\n  AUC 0.250 so far, 2 units: a"
        );
    }
}
