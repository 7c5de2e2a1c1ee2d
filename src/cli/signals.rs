//! Signals that ask the program to stop.

use super::exit::Failure;
use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Makes a file that would grow beyond the limit of file sizes (`ulimit -f`) an error of the write, which is reported as a
/// full disk is, instead of a signal that kills the process.
pub fn limits_are_errors() {
    // Where there is no such signal, or it cannot be had, the system's own way stays.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
}

/// Set by an interrupt, a request to terminate or SIGUSR1 (what batch systems send before time is up).
///
/// # Errors
/// The system refuses.
pub fn stop_on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGUSR1] {
        // A second signal ends the process at once: a killed run is resumed all the same.
        signal_hook::flag::register_conditional_default(signal, Arc::clone(&stop))
            .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&stop)))
            .map_err(|e| Failure::usage(format!("cannot handle signals: {e}")))?;
    }
    Ok(stop)
}
