//! Progress of a run on stderr: a bar on terminals, now and then a line elsewhere.

use super::args::ProgressMode;
use super::console::Console;
use crate::run::Observer;
use crate::store::journal::Entry;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};
use std::time::{Duration, Instant};

/// Longest silence of plain progress.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// Shows a run's progress.
pub struct Progress<'a> {
    console: &'a Console,
    bar: ProgressBar,
    plain: bool,
    began: OnceLock<Begin>,
    last_line: Mutex<Instant>,
    frames: AtomicU64,
    units: AtomicUsize,
    failed: AtomicUsize,
}

struct Begin {
    at: Instant,
    frames: u64,
    pending: usize,
}

impl<'a> Progress<'a> {
    /// Progress as the user asked for it.
    pub fn new(console: &'a Console, mode: ProgressMode) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let show = !console.quiet && mode != ProgressMode::None;
        let bar = if show && terminal && mode == ProgressMode::Auto {
            // Ten redraws a second are enough and cost nothing.
            let target = ProgressDrawTarget::stderr_with_hz(10);
            let style = ProgressStyle::with_template("{wide_bar} {msg} {percent}% ETA {eta}");
            ProgressBar::with_draw_target(None, target)
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        } else {
            ProgressBar::hidden()
        };
        Progress {
            console,
            plain: show && bar.is_hidden(),
            bar,
            began: OnceLock::new(),
            last_line: Mutex::new(Instant::now()),
            frames: AtomicU64::new(0),
            units: AtomicUsize::new(0),
            failed: AtomicUsize::new(0),
        }
    }

    fn say(&self, line: &str) {
        self.bar.suspend(|| self.console.line(line));
    }

    fn summary(&self, begin: &Begin) -> String {
        let rate = self.frames.load(Ordering::Relaxed) as f64 / begin.at.elapsed().as_secs_f64().max(1e-3);
        let failed = match self.failed.load(Ordering::Relaxed) {
            0 => String::new(),
            n => format!(", {n} failed"),
        };
        let units = self.units.load(Ordering::Relaxed);
        format!("{units}/{} units{failed}, {rate:.0} frames/s", begin.pending)
    }
}

impl Observer for Progress<'_> {
    fn begin(&self, units: usize, pending: usize, frames: u64) {
        if !self.console.quiet {
            let resumed = match units - pending {
                0 => String::new(),
                n => format!(" ({n} of {units} are done already)"),
            };
            self.console.note(&format!(
                "{pending} units (one tracker on one sequence each) to track{resumed}"
            ));
        }
        let begin = Begin {
            at: Instant::now(),
            frames,
            pending,
        };
        self.bar.set_length(frames);
        self.bar.set_message(self.summary(&begin));
        let _ = self.began.set(begin);
    }

    fn frames(&self, count: u64) {
        let done = self.frames.fetch_add(count, Ordering::Relaxed) + count;
        self.bar.inc(count);
        let Some(begin) = self.began.get().filter(|_| self.plain) else {
            return;
        };
        // Whoever comes while another prints has nothing to add.
        let Ok(mut last) = self.last_line.try_lock() else {
            return;
        };
        if last.elapsed() >= LINE_EVERY {
            *last = Instant::now();
            let left = begin.at.elapsed().as_secs_f64()
                * (begin.frames.saturating_sub(done) as f64 / done.max(1) as f64);
            self.say(&format!("{}, about {left:.0} s left", self.summary(begin)));
        }
    }

    fn unit(&self, entry: &Entry) {
        self.units.fetch_add(1, Ordering::Relaxed);
        if entry.reason.is_some() {
            self.failed.fetch_add(1, Ordering::Relaxed);
        }
        if let Some(begin) = self.began.get() {
            self.bar.set_message(self.summary(begin));
        }
        if self.console.verbose > 0 {
            let outcome = entry.reason.as_deref().unwrap_or("ok");
            let seconds = entry.time.seconds;
            self.say(&format!(
                "{} on {}/{}: {outcome} ({seconds:.2} s)",
                entry.tracker, entry.dataset, entry.sequence
            ));
        }
    }

    fn stopping(&self, grace: Duration) {
        if !self.console.quiet {
            let seconds = grace.as_secs_f64();
            self.say(&format!(
                "stopping: what is being tracked has {seconds} s to end (interrupt again to stop at once)"
            ));
        }
    }

    fn end(&self) {
        self.bar.finish_and_clear();
        if let Some(begin) = self.began.get().filter(|_| !self.console.quiet) {
            self.console.note(&format!(
                "{} in {:.1} s",
                self.summary(begin),
                begin.at.elapsed().as_secs_f64()
            ));
        }
    }

    fn warn(&self, message: &str) {
        self.bar.suspend(|| self.console.warn(message));
    }
}
