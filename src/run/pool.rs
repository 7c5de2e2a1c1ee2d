//! Worker threads, as many as were asked for or as many as can be had.

use crate::run::error::RunError;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::io;
use std::time::Duration;

/// Time that threads of a pool that was given up take to end.
const ENDING: Duration = Duration::from_millis(20);
/// Times that a single thread is asked for again, while others end.
const TRIES: usize = 5;

/// A pool of `threads` worker threads, 0 for one per core; of fewer where the system grants fewer, which `warn` is told.
///
/// # Errors
/// It grants none.
pub fn pool(threads: usize, warn: &dyn Fn(&str)) -> Result<ThreadPool, RunError> {
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let wanted = if threads == 0 { cores() } else { threads };
    let (mut count, mut tries) = (wanted, TRIES);
    loop {
        match pool_of(count) {
            Ok(pool) => {
                if count < wanted {
                    warn(&format!(
                        "{count} worker threads instead of {wanted}: the system grants no more (ulimit -u, ulimit -v)"
                    ));
                }
                return Ok(pool);
            }
            Err(error) if count == 1 && tries == 0 => return Err(RunError::Threads(error)),
            Err(_) => {
                tries -= usize::from(count == 1);
                count = (count / 2).max(1);
                // The threads that could be started end by themselves.
                std::thread::sleep(ENDING);
            }
        }
    }
}

/// A pool of exactly `count` threads that leaves room for those that give it work.
fn pool_of(count: usize) -> io::Result<ThreadPool> {
    let pool = ThreadPoolBuilder::new()
        .num_threads(count)
        .thread_name(|i| format!("worker {i}"))
        .build()
        .map_err(io::Error::other)?;
    // One drives the groups of units, and one is to spare.
    let spare: Vec<_> = (0..2).map(|_| std::thread::Builder::new().spawn(|| ())).collect();
    for thread in spare {
        let _ = thread?.join();
    }
    Ok(pool)
}
