//! Ends units from outside: long starts and updates look at a token, and one thread sets it when a unit's time is up or the
//! run is to end at once. May depend on nothing else of the run.

use mtf::interrupt::{self, Token};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How often units in progress are looked at.
const EVERY: Duration = Duration::from_millis(50);

/// The units in progress.
#[derive(Default)]
pub(crate) struct Watch {
    state: Mutex<State>,
    closed: Condvar,
}

#[derive(Default)]
struct State {
    units: Vec<Watched>,
    closed: bool,
}

struct Watched {
    token: Token,
    deadline: Option<Instant>,
    late: bool,
}

struct Closing<'w>(&'w Watch);

impl Drop for Closing<'_> {
    fn drop(&mut self) {
        self.0.state().closed = true;
        self.0.closed.notify_all();
    }
}

/// Why work was ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    /// By itself.
    Itself,
    /// At its deadline.
    Late,
    /// With all others.
    Halted,
}

impl Watch {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Looks at the units until [`closing`](Self::closing) ends, and ends all of them once `halted`.
    pub fn serve(&self, halted: impl Fn() -> bool) {
        let mut state = self.state();
        while !state.closed {
            drop(state);
            let (halt, now) = (halted(), Instant::now());
            state = self.state();
            for unit in &mut state.units {
                let late = unit.deadline.is_some_and(|deadline| now >= deadline);
                if (late || halt) && !unit.token.is_set() {
                    unit.late = late;
                    unit.token.interrupt();
                }
            }
            if !state.closed {
                let waited = self.closed.wait_timeout(state, EVERY);
                state = waited.unwrap_or_else(PoisonError::into_inner).0;
            }
        }
    }

    /// Ends [`serve`](Self::serve) when what is returned is dropped.
    pub fn closing(&self) -> impl Drop {
        Closing(self)
    }

    /// Does `work`, which ends early when it is late or the run is halted. Without a thread that serves, nothing ends it.
    pub fn over<R>(&self, limit: Option<Duration>, work: impl FnOnce() -> R) -> (R, Ended) {
        let token = Token::default();
        let deadline = limit.and_then(|limit| Instant::now().checked_add(limit));
        self.state().units.push(Watched {
            token: token.clone(),
            deadline,
            late: false,
        });
        let done = interrupt::with(&token, work);
        let mut state = self.state();
        let at = state.units.iter().position(|unit| unit.token.is(&token));
        let unit = at.map(|at| state.units.swap_remove(at));
        let ended = match unit.filter(|unit| unit.token.is_set()) {
            None => Ended::Itself,
            Some(unit) if unit.late => Ended::Late,
            Some(_) => Ended::Halted,
        };
        (done, ended)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    /// Goes on until it is interrupted.
    fn endless() {
        while !interrupt::requested() {
            std::thread::yield_now();
        }
    }

    #[test]
    fn work_is_ended_at_its_deadline_or_with_all() {
        let (watch, halt) = (Watch::default(), AtomicBool::new(false));
        std::thread::scope(|scope| {
            scope.spawn(|| watch.serve(|| halt.load(Ordering::Relaxed)));
            let _closing = watch.closing();
            assert_eq!(watch.over(Some(Duration::ZERO), || 7).0, 7);
            assert_eq!(
                watch.over(Some(Duration::from_millis(10)), endless).1,
                Ended::Late
            );
            assert_eq!(watch.over(None, || ()).1, Ended::Itself);
            halt.store(true, Ordering::Relaxed);
            let hour = Some(Duration::from_secs(3600));
            assert_eq!(watch.over(hour, endless).1, Ended::Halted);
        });
        assert!(watch.state().units.is_empty());
    }
}
