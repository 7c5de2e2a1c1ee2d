//! `mtf-eval basin`: how far from the truth a tracker may start.

use super::args::TrackerArgs;
use super::console::{clock, print, write_text};
use super::exit::{Failure, Outcome};
use super::experiment::{filter, trackers};
use super::program::Program;
use super::progress::Meter;
use super::signals::stop_on_signals;
use crate::dataset::decode;
use crate::files;
use crate::measure::basin::{self, BasinRequest, BasinRow, Perturb, Texture};
use crate::report::{Format, basin_svg, render};
use crate::run::pool;
use crate::synth::texture::TEXTURES;
use mtf::image::{Frame, Identity};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Textures drawn for the experiment when no image is given: different kinds, all with something to see.
const DRAWN: [&str; 4] = ["rock", "painting", "page", "bricks"];
/// Seed of their drawing.
const DRAWING: u64 = 1;

/// Measure the basin of convergence: start trackers away from the truth and count how often they find it
///
/// Each image is warped such that the corners of a box in its middle move by Gaussian noise; the tracker starts on the
/// unmoved box. It has converged when it is within --threshold of the moved corners after a few updates. Intervals of rows
/// over several images are for other images.
#[derive(clap::Args, Debug)]
pub struct BasinArgs {
    /// Images, or folders of images [default: textures drawn by the program]
    #[arg(value_name = "IMAGE")]
    pub images: Vec<PathBuf>,
    /// Which trackers.
    #[command(flatten)]
    pub trackers: TrackerArgs,
    /// Standard deviations of the corners' coordinates, px [default: from 1 to a quarter of the box's side]
    #[arg(
        long,
        value_name = "PX,...",
        value_delimiter = ',',
        help_heading = "Experiment"
    )]
    pub sigma: Vec<f64>,
    /// Warps per image and sigma
    #[arg(long, value_name = "N", default_value_t = 500, help_heading = "Experiment")]
    pub trials: usize,
    /// Side of the box, px
    #[arg(long, value_name = "PX", default_value_t = 200.0, help_heading = "Experiment")]
    pub side: f64,
    /// Updates on each warped image
    #[arg(long, value_name = "N", default_value_t = 3, help_heading = "Experiment")]
    pub updates: usize,
    /// Mean corner distance of a converged tracker, px; the same for all
    #[arg(long, value_name = "PX", default_value_t = BasinRequest::THRESHOLD, help_heading = "Experiment")]
    pub threshold: f64,
    /// The warps of images: those of each tracker's own state space model, or homographies for all
    #[arg(
        long,
        value_enum,
        value_name = "WARPS",
        default_value = "own",
        help_heading = "Experiment"
    )]
    pub perturb: PerturbArg,
    /// Seed of warps and trackers
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Experiment")]
    pub seed: u64,
    /// Worker threads [default: one per core]
    #[arg(short = 'j', long, value_name = "N", help_heading = "Experiment")]
    pub threads: Option<usize>,
    /// A row per image as well
    #[arg(long, help_heading = "Output")]
    pub each: bool,
    /// Draw the share of starts that converged against sigma (SVG)
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub chart: Option<PathBuf>,
    /// Form of the result: a row per tracker, image and sigma; json: an array of objects (one line; --pretty indents it)
    #[arg(long, value_name = "FORM", default_value = "table", help_heading = "Output")]
    pub format: Format,
}

/// What images are warped by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum PerturbArg {
    /// Warps of the tracker's own state space model
    Own,
    /// Homographies
    Homography,
}

/// Runs the command.
///
/// # Errors
/// Wrong arguments, unreadable images, a tracker that cannot start, or stopped early.
pub fn run(args: &BasinArgs, program: &Program) -> Outcome {
    let (registry, console) = (&program.catalogue.registry, &program.console);
    let entries = trackers(&args.trackers, program)?;
    let perturb = match args.perturb {
        PerturbArg::Own => Perturb::Own,
        PerturbArg::Homography => Perturb::Homography,
    };
    let positive = |v: &f64| v.is_finite() && *v > 0.0;
    if !(positive(&args.side) && positive(&args.threshold) && args.sigma.iter().all(positive)) {
        return Err(Failure::usage(
            "--side, --sigma and --threshold take numbers above 0",
        ));
    }
    let mut sigmas = args.sigma.clone();
    if sigmas.is_empty() {
        sigmas = basin::usual_sigmas(args.side);
    }
    sigmas.sort_by(f64::total_cmp);
    sigmas.dedup();
    let request = BasinRequest {
        threshold: args.threshold,
        sigmas,
        trials: args.trials,
        side: args.side,
        updates: args.updates,
        pre: filter(&args.trackers)?,
        seed: args.seed,
        ..BasinRequest::new(registry, entries, perturb, textures(&args.images)?)
    };
    let pool = pool(args.threads.unwrap_or(0), &|text| console.warn(text))?;
    let stop = stop_on_signals()?;
    let starts = request.starts();
    let of = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    let counts = format!(
        "{} x {} x {} x {} = {starts} starts",
        of(request.trackers.len(), "tracker"),
        of(request.textures.len(), "image"),
        of(request.sigmas.len(), "sigma"),
        of(request.trials, "warp")
    );
    let seconds = pool.install(|| basin::probe(&request, &stop))?;
    let threads = pool.current_num_threads();
    let time = clock(seconds);
    console.note(&format!("{counts}, about {time} with {}", of(threads, "thread")));
    let meter = Meter::new(console, program.progress, false);
    meter.begin(starts);
    let (begin, done) = (Instant::now(), AtomicU64::new(0));
    let progress = |count: u64| {
        let done = done.fetch_add(count, Ordering::Relaxed) + count;
        let line = || {
            let left = begin.elapsed().as_secs_f64() * starts.saturating_sub(done) as f64 / done as f64;
            format!("{done}/{starts} starts, about {} left", clock(left))
        };
        meter.step(count, &line, &String::new);
    };
    let rows = pool.install(|| basin::run(&request, &stop, &progress));
    meter.end();
    let rows = rows?;
    let pooled = request.textures.len() > 1;
    let shown: Vec<&BasinRow> = rows
        .iter()
        .filter(|r| args.each || !pooled || r.texture == basin::POOLED)
        .collect();
    let mut lines = Vec::new();
    for group in shown.chunk_by(|a, b| (&a.tracker, &a.texture) == (&b.tracker, &b.texture)) {
        let half = basin::half_rate_sigma(group).map_or("-".to_owned(), |s| format!("{s:.2}"));
        lines.extend(group.iter().map(|row| {
            let [low, high] = row.interval();
            let last = row.distance.last().map_or(String::new(), |d| format!("{d:.4}"));
            vec![
                row.tracker.clone(),
                row.texture.clone(),
                row.sigma.to_string(),
                row.trials.to_string(),
                format!("{:.4}", row.rate()),
                format!("{low:.4}"),
                format!("{high:.4}"),
                last,
                half.clone(),
                request.threshold.to_string(),
                row.warp.clone(),
            ]
        }));
    }
    let header = [
        "tracker",
        "image",
        "sigma",
        "trials",
        "converged",
        "low95",
        "high95",
        "distance",
        "sigma50",
        "threshold",
        "perturbed_by",
    ];
    print(&match args.format {
        Format::Json => console.json(&lines.iter().map(|line| object(&header, line)).collect::<Vec<_>>()),
        format => render(&header, &lines, format, console.table_colour),
    })?;
    if let Some(path) = &args.chart {
        let of_all = |row: &&BasinRow| !pooled || row.texture == basin::POOLED;
        let all: Vec<&BasinRow> = rows.iter().filter(of_all).collect();
        let groups: Vec<Vec<&BasinRow>> = all
            .chunk_by(|a, b| a.tracker == b.tracker)
            .map(<[_]>::to_vec)
            .collect();
        let note = format!(
            "{counts} of {} updates, converged within {} px; 95 % intervals",
            request.updates, request.threshold
        );
        let svg = basin_svg(&groups, "Basins of convergence", &note).map_err(Failure::usage)?;
        write_text(path, &svg)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// A row of a table for machines: what is a number in it is one.
fn object(header: &[&str], row: &[String]) -> Map<String, Value> {
    let value = |cell: &String| {
        cell.parse::<f64>()
            .map_or_else(|_| cell.as_str().into(), Value::from)
    };
    header
        .iter()
        .zip(row)
        .map(|(name, cell)| ((*name).to_owned(), value(cell)))
        .collect()
}

/// The images named, those of folders in the order of their names; or drawn ones.
fn textures(paths: &[PathBuf]) -> Result<Vec<Texture>, Failure> {
    if paths.is_empty() {
        let drawn = TEXTURES.iter().filter(|t| DRAWN.contains(&t.name)).map(|t| {
            let image = t.draw(DRAWING);
            let gray = |x: usize, y: usize| {
                let [r, g, b] = image.get_pixel(x as u32, y as u32).0.map(f32::from);
                0.299 * r + 0.587 * g + 0.114 * b
            };
            let (w, h) = image.dimensions();
            Texture {
                name: t.name.to_owned(),
                image: mtf::image::Image::from_fn(w as usize, h as usize, gray),
            }
        });
        return Ok(drawn.collect());
    }
    let failed = |path: &Path, e: &dyn std::fmt::Display| Failure::usage(format!("{}: {e}", path.display()));
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path).map_err(|e| failed(path, &e))?;
        let image = |p: &PathBuf| {
            let extension = p.extension().map(|e| e.to_string_lossy().to_lowercase());
            extension.is_some_and(|e| {
                ["png", "jpg", "jpeg", "bmp", "tif", "tiff", "pgm", "ppm"].contains(&e.as_str())
            })
        };
        let mut inside: Vec<PathBuf> = entries
            .filter_map(|e| Some(e.ok()?.path()))
            .filter(image)
            .collect();
        if inside.is_empty() {
            return Err(failed(
                path,
                &"no images in this folder; give image files or a folder of them",
            ));
        }
        inside.sort();
        files.extend(inside);
    }
    let read = |path: &PathBuf| {
        let bytes = files::read(path, files::Kind::IMAGE).map_err(|e| failed(path, &e))?;
        let decoded = decode(&bytes, false).map_err(|e| failed(path, &e))?;
        let name = path
            .file_stem()
            .unwrap_or(path.as_os_str())
            .to_string_lossy()
            .into_owned();
        Ok(Texture {
            name,
            image: Frame::new(decoded, Arc::new(Identity)).gray().clone(),
        })
    };
    files.iter().map(read).collect()
}
