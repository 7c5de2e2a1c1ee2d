//! How the processor time of a run grows with the number of trackers and of frames, on one thread: measured times, the line
//! through them by least squares and how much of their variance it explains.
//!
//! `cargo bench --bench scaling`

use cpu_time::ProcessTime;
use mtf::diagnose::Waves;
use mtf::registry::Registry;
use mtf_eval::dataset::{self, LoadOptions, Sequence};
use mtf_eval::plan::{FrameLogs, RunRequest, TrackerEntry};
use mtf_eval::report::Exporters;
use mtf_eval::run;
use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

const SIZE: (u32, u32) = (320, 240);
const FRAMES: usize = 400;
/// Runs of which the fastest counts: what the machine can do undisturbed.
const REPEATS: usize = 9;

/// A sequence of a textured plane that sways; the object is 120x90 px.
fn write_sequence(root: &Path) -> Result<(), Box<dyn Error>> {
    let waves = Waves::new(5);
    let mut truth = String::from("frame ulx uly urx ury lrx lry llx lly\n");
    std::fs::create_dir_all(root.join("sway"))?;
    for frame in 0..FRAMES {
        let t = frame as f64 / 30.0;
        let (dx, dy) = (20.0 * t.sin(), 15.0 * (0.7 * t).sin());
        let value = |x, y| image::Luma([waves.at([f64::from(x) - dx, f64::from(y) - dy]) as u8]);
        let name = format!("frame{:05}.png", frame + 1);
        image::GrayImage::from_fn(SIZE.0, SIZE.1, value).save(root.join("sway").join(&name))?;
        let (l, t) = (100.0 + dx, 75.0 + dy);
        let (r, b) = (l + 120.0, t + 90.0);
        writeln!(truth, "{name} {l} {t} {r} {t} {r} {b} {l} {b}")?;
    }
    std::fs::write(root.join("sway.txt"), truth)?;
    Ok(())
}

/// `count` trackers that do the same work under different names.
fn trackers(registry: &Arc<Registry>, count: usize) -> Result<Vec<TrackerEntry>, Box<dyn Error>> {
    let entry = TrackerEntry::from_registry(registry, &registry.parse("esm/ssd/homography")?)?;
    let copy = |k: usize| {
        let mut entry = entry.clone();
        entry.name.id += &format!(" {k}");
        entry.slug += &format!("-{k}");
        entry
    };
    Ok((0..count).map(copy).collect())
}

/// Seconds of processor time of a whole run: planning, decoding, tracking, writing.
fn time(
    root: &Path,
    sequence: &Sequence,
    trackers: Vec<TrackerEntry>,
    frames: usize,
) -> Result<f64, Box<dyn Error>> {
    let request = RunRequest::builder()
        .trackers(trackers)
        .sequences([sequence.truncated(frames)])
        .threads(1)
        .out(root.join("out"))
        .force(true)
        .frame_logs(FrameLogs::None)
        .build()?;
    let begin = ProcessTime::try_now()?;
    let report = run::run(
        &request,
        &Exporters::builtin(),
        &run::Silent,
        &AtomicBool::new(false),
    )?;
    let seconds = begin.try_elapsed()?.as_secs_f64();
    assert!(report.failed.is_empty(), "{:?}", report.failed);
    Ok(seconds)
}

/// The least of several times at each size; size by size in turn, so that what disturbs the machine for a while spoils one
/// time of each.
fn sweep(
    sizes: &[usize],
    time: impl Fn(usize) -> Result<f64, Box<dyn Error>>,
) -> Result<Vec<(f64, f64)>, Box<dyn Error>> {
    let mut points: Vec<(f64, f64)> = sizes.iter().map(|&n| (n as f64, f64::INFINITY)).collect();
    for _ in 0..REPEATS {
        for (point, &n) in points.iter_mut().zip(sizes) {
            point.1 = point.1.min(time(n)?);
        }
    }
    Ok(points)
}

/// Least squares `y = a + b x`, and the share `R²` of the variance of `y` that it explains.
fn fit(points: &[(f64, f64)]) -> (f64, f64, f64) {
    let n = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let sum = |f: &dyn Fn(f64, f64) -> f64| points.iter().map(|p| f(p.0 - x, p.1 - y)).sum::<f64>();
    let b = sum(&|dx, dy| dx * dy) / sum(&|dx, _| dx * dx);
    let a = y - b * x;
    let rest = sum(&|dx, dy| (dy - b * dx).powi(2));
    (a, b, 1.0 - rest / sum(&|_, dy| dy * dy))
}

fn report(what: &str, points: &[(f64, f64)]) {
    let (a, b, r2) = fit(points);
    println!("{what:>9}        time        line");
    for (n, seconds) in points {
        println!("{n:9} {:8.1} ms {:8.1} ms", 1e3 * seconds, 1e3 * (a + b * n));
    }
    println!(
        "time = {:.2} ms + {:.4} ms x {what}, R² = {r2:.6}\n",
        1e3 * a,
        1e3 * b
    );
}

fn main() -> Result<(), Box<dyn Error>> {
    let root = tempfile::tempdir()?;
    write_sequence(&root.path().join("data"))?;
    let sequences = dataset::load(&root.path().join("data"), &LoadOptions::default())?.sequences;
    let registry = Arc::new(Registry::builtin());
    let run =
        |count: usize, frames: usize| time(root.path(), &sequences[0], trackers(&registry, count)?, frames);
    println!("esm/ssd/homography on {}x{} px, one thread\n", SIZE.0, SIZE.1);
    let points = sweep(&[1, 2, 4, 8, 16, 32, 64], |count| run(count, 100))?;
    report("trackers", &points);
    let points = sweep(&[25, 50, 100, 200, 400], |frames| run(16, frames))?;
    report("frames", &points);
    Ok(())
}
