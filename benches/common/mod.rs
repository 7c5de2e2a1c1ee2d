//! Timing of short calls and a table with ratios.

use std::hint::black_box;
use std::time::{Duration, Instant};

/// Seconds of one call of `f`: the fastest of many batches, which is what the machine can do undisturbed.
pub fn fastest<R>(mut f: impl FnMut() -> R) -> f64 {
    let once = Instant::now();
    black_box(f());
    // Batches of about a fifth of a millisecond.
    let batch = (2e-4 / once.elapsed().as_secs_f64().max(1e-9)).clamp(1.0, 1e5) as u32;
    let start = Instant::now();
    let mut best = f64::INFINITY;
    while start.elapsed() < Duration::from_millis(300) {
        let t = Instant::now();
        for _ in 0..batch {
            black_box(f());
        }
        best = best.min(t.elapsed().as_secs_f64() / f64::from(batch));
    }
    best
}

/// Prints one row: time, and how many times faster than what it is compared with.
pub fn row(name: &str, seconds: f64, other: &str, other_seconds: f64) {
    println!(
        "{name:44} {:9.2} us {:8.1} x {other} ({:.2} us)",
        seconds * 1e6,
        other_seconds / seconds,
        other_seconds * 1e6
    );
}
