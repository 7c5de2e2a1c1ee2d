//! The static convergence experiment (Baker & Matthews 2004): how far from the truth may a tracker start?
//!
//! An image is warped by what moves each corner of a box by Gaussian noise of standard deviation σ; the tracker, which knows
//! the box in the unwarped image, starts there. It has converged when it is within a threshold of the moved corners after a
//! few updates on the warped image. All trackers of one state space model see the same warps.
//!
//! A tracker is perturbed by warps that its own state space model has ([`Perturb::Own`]): it cannot reach others, however
//! well it searches. The noise is fitted with the model, and is larger in models of less freedom, so that σ means the same
//! in all: the mean square of the corners' displacement is `8 σ²` over the eight coordinates.

use crate::metric::quantile::{NORMAL_975, student_975};
use crate::plan::{Job, RunRequest, TrackerEntry, derived_seed, usual_filter};
use mtf::geom::{Corners, Mat3, homography};
use mtf::image::{Frame, Image, PreProcessor};
use mtf::params::Resolution;
use mtf::registry::Registry;
use mtf::ssm::{self, SsmEntry};
use mtf::tracker::{Tracker, afford};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// An image to warp.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Name.
    pub name: String,
    /// Its gray values, 0–255.
    pub image: Image,
}

/// The warps that images are perturbed by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Perturb {
    /// Those of each tracker's state space model; homographies where it is none of fewer than 8 parameters.
    #[default]
    Own,
    /// Homographies, for all trackers.
    Homography,
}

/// What is tried.
#[derive(Clone)]
pub struct BasinRequest {
    /// The trackers, with the model of the warps that they are perturbed by; `None`: homographies.
    pub trackers: Vec<(TrackerEntry, Option<SsmEntry>)>,
    /// Mean corner distance of a converged tracker, px: the same for all, whose rates could not be compared otherwise.
    pub threshold: f64,
    /// The images.
    pub textures: Vec<Texture>,
    /// Standard deviations of each coordinate of each corner, px.
    pub sigmas: Vec<f64>,
    /// Warps per image and sigma.
    pub trials: usize,
    /// Side of the box in the middle of each image, px; less in images that are too small for it.
    pub side: f64,
    /// Updates on each warped image.
    pub updates: usize,
    /// Filter of every image.
    pub pre: Arc<dyn PreProcessor>,
    /// Seed of warps and trackers.
    pub seed: u64,
}

impl BasinRequest {
    /// How often a tracker is started: trackers x images x sigmas x warps.
    pub fn starts(&self) -> u64 {
        let counts = [
            self.trackers.len(),
            self.textures.len(),
            self.sigmas.len(),
            self.trials,
        ];
        counts.iter().map(|&n| n as u64).product()
    }

    /// Mean corner distance of a converged tracker unless told otherwise, px: that of Baker & Matthews.
    pub const THRESHOLD: f64 = 1.0;

    /// `trackers` of `registry` on `textures`, with the program's defaults: 500 warps for each of the usual sigmas, a box of
    /// 200 px, 3 updates, converged within [`THRESHOLD`](Self::THRESHOLD), the usual filter, seed 0.
    pub fn new(
        registry: &Registry,
        trackers: Vec<TrackerEntry>,
        perturb: Perturb,
        textures: Vec<Texture>,
    ) -> BasinRequest {
        let side = 200.0;
        let model = |tracker: &TrackerEntry| match perturb {
            Perturb::Own => own_model(registry, &tracker.name.ssm, &tracker.parameters),
            Perturb::Homography => None,
        };
        BasinRequest {
            trackers: trackers.into_iter().map(|t| (t.clone(), model(&t))).collect(),
            threshold: BasinRequest::THRESHOLD,
            textures,
            sigmas: usual_sigmas(side),
            trials: 500,
            side,
            updates: 3,
            pre: usual_filter(),
            seed: 0,
        }
    }
}

/// The model of a tracker with the parameters `parameters` and the state space model `ssm` (empty for composites: then
/// that of a composite's own warp, or of its last member).
fn own_model(registry: &Registry, ssm: &str, parameters: &Value) -> Option<SsmEntry> {
    let named = Some(ssm).filter(|name| !name.is_empty());
    if let Some(name) = named.or_else(|| parameters["ssm"].as_str()) {
        return registry
            .ssms()
            .iter()
            .find(|entry| entry.is_called(name))
            .cloned();
    }
    let last = parameters["members"].as_array()?.last()?;
    let spec = registry.parse(last["tracker"].as_str()?).ok()?;
    own_model(registry, spec.parts().2, &last["parameters"])
}

/// Powers of the square root of 2, rounded to whole numbers, from 1 px to a quarter of the box's side.
pub fn usual_sigmas(side: f64) -> Vec<f64> {
    let mut sigmas: Vec<f64> = (0..)
        .map(|k| 2f64.powf(0.5 * f64::from(k)).round())
        .take_while(|s| *s <= side / 4.0)
        .collect();
    sigmas.dedup();
    sigmas
}

/// How often a tracker converged from one sigma.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BasinRow {
    /// Its id.
    pub tracker: String,
    /// Image; `pooled` for all.
    pub texture: String,
    /// State space model of the warps that it was perturbed by.
    pub warp: String,
    /// Standard deviation of the perturbation, px.
    pub sigma: f64,
    /// Warps tried.
    pub trials: usize,
    /// Those it converged from.
    pub converged: usize,
    /// Mean corner distance after each update over those it converged from, px; empty when there are none.
    pub distance: Vec<f64>,
    /// Rate of each image; of one image nothing.
    pub rates: Vec<f64>,
}

impl BasinRow {
    /// Fraction it converged from.
    pub fn rate(&self) -> f64 {
        self.converged as f64 / self.trials as f64
    }

    /// 95 % interval of the rate: of one image for other warps of it (Wilson 1927), of several for other images.
    ///
    /// Warps of an image are no independent trials of what images are like. With `s²` the variance of the rates `r_i` of `k`
    /// images, the mean varies by `s² / k`, as that of `p (1 - p) k / s²` independent trials would (no more than there
    /// were). As `s²` is of few images, the interval reaches as far as Student's distribution with `k - 1` degrees of
    /// freedom says (Korn & Graubard 1998).
    pub fn interval(&self) -> [f64; 2] {
        let (n, p, k) = (self.trials as f64, self.rate(), self.rates.len() as f64);
        if k < 2.0 {
            return wilson(p, n);
        }
        let mean = self.rates.iter().sum::<f64>() / k;
        let variance = self.rates.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (k - 1.0);
        // Where all rates are 0 or 1, they do not say how much images differ.
        let effective = if variance > 0.0 {
            (p * (1.0 - p) * k / variance).min(n)
        } else {
            n
        };
        wilson(p, effective * (NORMAL_975 / student_975(k - 1.0)).powi(2))
    }
}

/// 95 % interval of a rate `p` of `n` trials (Wilson 1927).
fn wilson(p: f64, n: f64) -> [f64; 2] {
    const Z: f64 = NORMAL_975;
    let centre = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
    let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    [(centre - half).max(0.0), (centre + half).min(1.0)]
}

/// Name of the rows over all images.
pub const POOLED: &str = "pooled";

/// The sigma at which a tracker converges from half of the warps, px, linear between those tried: `rows` are those of one
/// tracker and image by growing sigma. `None` when the rate is below a half from the first, infinite when it never is.
pub fn half_rate_sigma(rows: &[&BasinRow]) -> Option<f64> {
    let below = rows.iter().position(|r| r.rate() < 0.5);
    match below {
        None => Some(f64::INFINITY),
        Some(0) => None,
        Some(k) => {
            let (a, b) = (rows[k - 1], rows[k]);
            Some(a.sigma + (b.sigma - a.sigma) * (a.rate() - 0.5) / (a.rate() - b.rate()))
        }
    }
}

/// Why an experiment cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BasinError {
    /// Nothing to do.
    #[error("no {0}")]
    Nothing(&'static str),
    /// An image is too small.
    #[error("{texture}: {width}x{height} px leave no room for a box; give images of 40 px and more")]
    Small {
        /// Image.
        texture: String,
        /// Width, px.
        width: usize,
        /// Height, px.
        height: usize,
    },
    /// A tracker cannot start.
    #[error("{tracker} cannot start on {texture}: {reason}")]
    Start {
        /// Tracker.
        tracker: String,
        /// Image.
        texture: String,
        /// Why.
        reason: String,
    },
    /// Asked to stop.
    #[error("stopped")]
    Stopped,
}

/// Warped images made at a time.
const BATCH: usize = 16;
/// Smallest side of an image, px.
const LEAST: usize = 40;
/// Least area of a moved box relative to the box: less is no view of it.
const FOLDED: f64 = 0.05;

/// Parameters of a homography, and coordinates of four corners.
const FULL: usize = 8;

/// Warps to perturb images by.
#[derive(Clone)]
struct Warps {
    name: &'static str,
    /// What the moved corners are fitted with; not with a homography, which reaches all.
    model: Option<SsmEntry>,
    /// What noise is multiplied by. A fit with `d` parameters keeps the share `d / 8` of its mean square.
    gain: f64,
}

impl Warps {
    /// Those of `model`; homographies without one, and where it has as many parameters.
    fn new(model: Option<&SsmEntry>) -> Result<Warps, String> {
        if let Some(entry) = model {
            let mut started = (entry.build)(&[]).map_err(|e| e.to_string())?;
            // Some have parameters for each point of a region, and none before they have one.
            let region = Corners::rect(0.0, 0.0, 100.0, 100.0);
            let res = Resolution { cols: 2, rows: 2 };
            started.init(&region, res).map_err(|e| e.to_string())?;
            let dof = started.dof();
            if dof < FULL {
                return Ok(Warps {
                    name: entry.name,
                    model: Some(entry.clone()),
                    gain: (FULL as f64 / dof as f64).sqrt(),
                });
            }
        }
        Ok(Warps {
            name: "homography",
            model: None,
            gain: 1.0,
        })
    }

    /// The corners of `base` moved by one of them. The same for every tracker.
    fn perturbed(&self, base: &Corners, sigma: f64, rng: &mut Pcg64) -> Corners {
        loop {
            let moved = Corners(base.0.map(|c| {
                c.map(|v| {
                    let z: f64 = StandardNormal.sample(rng);
                    v + self.gain * sigma * z
                })
            }));
            let moved = match &self.model {
                None => Some(moved),
                Some(model) => ssm::fit_truth(model, base, &moved).ok(),
            };
            if let Some(moved) = moved
                && moved.is_convex()
                && moved.signed_area() > FOLDED * base.signed_area()
            {
                return moved;
            }
        }
    }
}

/// The image as seen when `to_source` takes its pixels to those of `image`: the mean of 2x2 bilinear samples per pixel, border
/// pixels repeated outside.
fn warped(image: &Image, to_source: &Mat3) -> Image {
    let (w, h) = (image.width(), image.height());
    let at = |x: f64, y: f64| {
        let [u, v] = homography::apply(to_source, [x, y]);
        let (u, v) = (u.clamp(0.0, (w - 1) as f64), v.clamp(0.0, (h - 1) as f64));
        let (x, y) = ((u as usize).min(w - 2), (v as usize).min(h - 2));
        let (du, dv) = ((u - x as f64) as f32, (v - y as f64) as f32);
        let (top, bottom) = (&image.row(0, y)[x..x + 2], &image.row(0, y + 1)[x..x + 2]);
        let (a, b) = (
            top[0] + du * (top[1] - top[0]),
            bottom[0] + du * (bottom[1] - bottom[0]),
        );
        a + dv * (b - a)
    };
    Image::from_fn(w, h, |x, y| {
        let (x, y) = (x as f64, y as f64);
        0.25 * (at(x - 0.25, y - 0.25)
            + at(x + 0.25, y - 0.25)
            + at(x - 0.25, y + 0.25)
            + at(x + 0.25, y + 0.25))
    })
}

/// A tracker on one image.
struct Subject<'a> {
    entry: &'a TrackerEntry,
    warps: &'a Warps,
    threshold: f64,
    tracker: Box<dyn Tracker>,
    row: BasinRow,
}

impl Subject<'_> {
    /// One trial: back to the box on the first frame, then the updates on the warped one.
    fn trial(&mut self, first: &Frame, base: &Corners, frame: &Frame, truth: &Corners, updates: usize) {
        let tracker = &mut self.tracker;
        // A tracker that follows from frame to frame needs to have seen the first one last.
        let _ = tracker.set_region(base);
        let _ = tracker.update(first);
        let placed = tracker.set_region(base);
        let distances: Vec<f64> = (0..updates)
            .map(|_| {
                // One that fails stays where it was.
                let _ = tracker.update(frame);
                tracker.corners().mean_distance(truth)
            })
            .collect();
        self.row.trials += 1;
        if placed.is_ok() && distances.last().is_some_and(|d| *d <= self.threshold) {
            self.row.converged += 1;
            self.row.distance.resize(updates, 0.0);
            self.row
                .distance
                .iter_mut()
                .zip(distances)
                .for_each(|(sum, d)| *sum += d);
        }
    }
}

/// What is there before the first start: the experiment makes sense, and each tracker has its warps.
fn prepared(request: &BasinRequest) -> Result<Vec<Warps>, BasinError> {
    for (empty, what) in [
        (request.trackers.is_empty(), "tracker"),
        (request.textures.is_empty(), "image"),
        (request.sigmas.is_empty(), "sigma"),
        (request.trials == 0, "trial"),
        (request.updates == 0, "update"),
    ] {
        if empty {
            return Err(BasinError::Nothing(what));
        }
    }
    let warps = request.trackers.iter().map(|(entry, model)| {
        Warps::new(model.as_ref()).map_err(|reason| BasinError::Start {
            tracker: entry.name.id.clone(),
            texture: request.textures[0].name.clone(),
            reason,
        })
    });
    warps.collect()
}

/// The kinds of warps that trackers are perturbed by, each once.
fn kinds(warps: &[Warps]) -> Vec<&Warps> {
    let mut kinds: Vec<&Warps> = warps.iter().collect();
    kinds.sort_by_key(|w| w.name);
    kinds.dedup_by_key(|w| w.name);
    kinds
}

/// An image with the box that trackers start on.
struct Scene<'a> {
    texture: &'a Texture,
    first: Frame,
    base: Corners,
}

impl<'a> Scene<'a> {
    fn new(request: &BasinRequest, texture: &'a Texture) -> Result<Scene<'a>, BasinError> {
        let (w, h) = (texture.image.width(), texture.image.height());
        if w.min(h) < LEAST {
            return Err(BasinError::Small {
                texture: texture.name.clone(),
                width: w,
                height: h,
            });
        }
        let side = request.side.min(0.6 * w.min(h) as f64);
        let corner = |n: usize| ((n as f64 - 1.0) - side) / 2.0;
        Ok(Scene {
            texture,
            first: Frame::from_gray(request.pre.apply(texture.image.clone())),
            base: Corners::rect(corner(w), corner(h), side, side),
        })
    }

    /// A tracker that has started on the box.
    fn subject<'s>(
        &self,
        request: &BasinRequest,
        entry: &'s TrackerEntry,
        warps: &'s Warps,
    ) -> Result<Subject<'s>, BasinError> {
        let name = &self.texture.name;
        let start = |reason: String| BasinError::Start {
            tracker: entry.name.id.clone(),
            texture: name.clone(),
            reason,
        };
        let mut tracker = (entry.make)(Job {
            sequence: None,
            start: 0,
        })
        .map_err(start)?;
        tracker.reseed(derived_seed(request.seed, &[&entry.name.id, name], None));
        afford(tracker.as_ref(), RunRequest::MEMORY).map_err(|e| start(e.to_string()))?;
        tracker
            .init(&self.first, &self.base)
            .map_err(|e| start(e.to_string()))?;
        Ok(Subject {
            entry,
            warps,
            threshold: request.threshold,
            tracker,
            row: no_trials(entry, warps, name, 0.0),
        })
    }

    /// The corners that `warps` move the box to, `count` times. The same noise for all kinds.
    fn truths(&self, request: &BasinRequest, warps: &Warps, sigma: f64, count: usize) -> Vec<Corners> {
        let names = ["warps", &self.texture.name, &sigma.to_string()];
        let mut rng = Pcg64::seed_from_u64(derived_seed(request.seed, &names, None));
        (0..count)
            .map(|_| warps.perturbed(&self.base, sigma, &mut rng))
            .collect()
    }

    /// The image with its box moved to `truth`.
    fn view(&self, request: &BasinRequest, truth: &Corners) -> Option<(Frame, Corners)> {
        let to_source = homography::from_corners(truth, &self.base)?;
        let image = request.pre.apply(warped(&self.texture.image, &to_source));
        Some((Frame::from_gray(image), *truth))
    }
}

/// Starts of each tracker that are timed before the experiment.
const PROBED: usize = 2;

/// About how long the experiment will take on the threads of this pool, s: from a few starts of each tracker on the first
/// image, in the middle of the sigmas.
///
/// # Errors
/// See [`BasinError`].
pub fn probe(request: &BasinRequest, stop: &AtomicBool) -> Result<f64, BasinError> {
    let warps = prepared(request)?;
    let scene = Scene::new(request, &request.textures[0])?;
    let sigma = request.sigmas[request.sigmas.len() / 2];
    let starts = (request.textures.len() * request.sigmas.len() * request.trials) as f64;
    let threads = rayon::current_num_threads() as f64;
    let mut seconds = 0.0;
    for kind in kinds(&warps) {
        let begin = Instant::now();
        let truths = scene.truths(request, kind, sigma, PROBED.min(request.trials));
        let views: Vec<_> = truths.iter().filter_map(|t| scene.view(request, t)).collect();
        let drawing = begin.elapsed().as_secs_f64() / truths.len() as f64;
        let trackers = request.trackers.iter().zip(&warps);
        let own: Vec<_> = trackers.filter(|(_, warps)| warps.name == kind.name).collect();
        let time = |((entry, _), warps): &(&(TrackerEntry, Option<SsmEntry>), &Warps)| {
            if stop.load(Ordering::Relaxed) {
                return Err(BasinError::Stopped);
            }
            let begin = Instant::now();
            let mut subject = scene.subject(request, entry, warps)?;
            let start = begin.elapsed().as_secs_f64();
            for (frame, truth) in &views {
                subject.trial(&scene.first, &scene.base, frame, truth, request.updates);
            }
            let trials = begin.elapsed().as_secs_f64() - start;
            Ok((start, trials / views.len().max(1) as f64))
        };
        let times: Vec<(f64, f64)> = own
            .par_iter()
            .with_max_len(1)
            .map(time)
            .collect::<Result<_, _>>()?;
        // Trackers share the threads, and all wait for the slowest.
        let shared = |of: fn(&(f64, f64)) -> f64| {
            let each = times.iter().map(of);
            (each.clone().sum::<f64>() / threads).max(each.fold(0.0, f64::max))
        };
        let beginning = request.textures.len() as f64 * shared(|t| t.0);
        seconds += beginning + starts * (shared(|t| t.1) + drawing / threads);
    }
    Ok(seconds)
}

/// Runs the experiment: rows by tracker, then image (all of them pooled last), then sigma. The same for any number of
/// threads. `progress` is told how many of the [starts](BasinRequest::starts) are done since it was last told.
///
/// # Errors
/// See [`BasinError`].
pub fn run(
    request: &BasinRequest,
    stop: &AtomicBool,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Vec<BasinRow>, BasinError> {
    let warps = prepared(request)?;
    let mut rows: Vec<BasinRow> = Vec::new();
    for texture in &request.textures {
        let scene = Scene::new(request, texture)?;
        let mut subjects: Vec<Subject<'_>> = request
            .trackers
            .par_iter()
            .zip(&warps)
            .map(|((entry, _), warps)| scene.subject(request, entry, warps))
            .collect::<Result<_, BasinError>>()?;
        for &sigma in &request.sigmas {
            for kind in kinds(&warps) {
                let truths = scene.truths(request, kind, sigma, request.trials);
                let mut own: Vec<&mut Subject<'_>> = subjects
                    .iter_mut()
                    .filter(|s| s.warps.name == kind.name)
                    .collect();
                for batch in truths.chunks(BATCH) {
                    if stop.load(Ordering::Relaxed) {
                        return Err(BasinError::Stopped);
                    }
                    let views: Vec<(Frame, Corners)> = batch
                        .par_iter()
                        .filter_map(|truth| scene.view(request, truth))
                        .collect();
                    own.par_iter_mut().with_max_len(1).for_each(|subject| {
                        for (frame, truth) in &views {
                            subject.trial(&scene.first, &scene.base, frame, truth, request.updates);
                        }
                        progress(batch.len() as u64);
                    });
                }
            }
            for subject in &mut subjects {
                let fresh = no_trials(subject.entry, subject.warps, &texture.name, 0.0);
                let mut row = std::mem::replace(&mut subject.row, fresh);
                row.sigma = sigma;
                rows.push(row);
            }
        }
    }
    Ok(ordered(request, &warps, rows))
}

/// A row before the first trial.
fn no_trials(entry: &TrackerEntry, warps: &Warps, texture: &str, sigma: f64) -> BasinRow {
    BasinRow {
        tracker: entry.name.id.clone(),
        texture: texture.to_owned(),
        warp: warps.name.to_owned(),
        sigma,
        trials: 0,
        converged: 0,
        distance: Vec::new(),
        rates: Vec::new(),
    }
}

/// Rows by tracker, image and sigma, with pooled ones; sums of distances become means.
fn ordered(request: &BasinRequest, warps: &[Warps], rows: Vec<BasinRow>) -> Vec<BasinRow> {
    let mut out = Vec::with_capacity(2 * rows.len());
    let finish = |mut row: BasinRow| {
        let n = row.converged as f64;
        row.distance
            .iter_mut()
            .for_each(|d| *d = (*d / n * 1e6).round() / 1e6);
        row
    };
    for ((entry, _), warps) in request.trackers.iter().zip(warps) {
        let own = || rows.iter().filter(|r| r.tracker == entry.name.id);
        out.extend(own().cloned().map(finish));
        if request.textures.len() < 2 {
            continue;
        }
        for &sigma in &request.sigmas {
            let mut pooled = no_trials(entry, warps, POOLED, sigma);
            for row in own().filter(|r| r.sigma == sigma) {
                pooled.trials += row.trials;
                pooled.converged += row.converged;
                pooled.rates.push(row.rate());
                pooled
                    .distance
                    .resize(pooled.distance.len().max(row.distance.len()), 0.0);
                pooled
                    .distance
                    .iter_mut()
                    .zip(&row.distance)
                    .for_each(|(sum, d)| *sum += d);
            }
            out.push(finish(pooled));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use mtf::diagnose::Waves;
    use std::sync::atomic::AtomicU64;

    #[test]
    fn the_cost_is_known_before_and_every_start_is_told() {
        let request = request(&["esm/ssd/translation", "iclk/ssd/affine"]);
        assert_eq!(request.starts(), 2 * 2 * 2 * 12);
        let (stop, told) = (AtomicBool::new(false), AtomicU64::new(0));
        let seconds = probe(&request, &stop).unwrap();
        assert!(seconds > 0.0 && seconds.is_finite());
        let tell = |n: u64| {
            told.fetch_add(n, Ordering::Relaxed);
        };
        run(&request, &stop, &tell).unwrap();
        assert_eq!(told.into_inner(), request.starts());
        stop.store(true, Ordering::Relaxed);
        assert!(matches!(probe(&request, &stop), Err(BasinError::Stopped)));
    }

    fn request(trackers: &[&str]) -> BasinRequest {
        let registry = Arc::new(Registry::builtin());
        let entry = |id: &&str| {
            let spec = registry.parse(id).unwrap();
            TrackerEntry::from_registry(&registry, &spec).unwrap()
        };
        let texture = |seed: u64| {
            let waves = Waves::new(seed);
            Texture {
                name: format!("waves{seed}"),
                image: Image::from_fn(200, 160, |x, y| waves.at([x as f64, y as f64]) as f32),
            }
        };
        let trackers = trackers.iter().map(entry).collect();
        BasinRequest {
            sigmas: vec![0.5, 24.0],
            trials: 12,
            side: 60.0,
            pre: Arc::new(mtf::image::Identity),
            seed: 7,
            ..BasinRequest::new(&registry, trackers, Perturb::Own, vec![texture(1), texture(2)])
        }
    }

    fn rows(trackers: &[&str], threads: usize) -> Vec<BasinRow> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| run(&request(trackers), &AtomicBool::new(false), &|_| ()).unwrap())
    }

    #[test]
    fn near_starts_converge_and_far_ones_less_often() {
        let rows = rows(&["esm/ssd/homography", "iclk/ssd/homography"], 2);
        assert_eq!(rows.len(), 2 * 3 * 2);
        for pair in rows.chunks(2) {
            assert_eq!(pair[0].rate(), 1.0, "{:?}", pair[0]);
            assert!(pair[1].rate() < 0.9 && pair[0].distance[2] < 0.1, "{pair:?}");
        }
        let pooled: Vec<_> = rows.iter().filter(|r| r.texture == POOLED).collect();
        assert_eq!(pooled[0].trials, 24);
        let half = half_rate_sigma(&pooled[..2]).unwrap();
        assert!(half > 0.5, "{half}");
    }

    #[test]
    fn rows_do_not_depend_on_threads_or_on_other_trackers() {
        let alone = rows(&["esm/ssd/homography"], 1);
        assert_eq!(alone, rows(&["esm/ssd/homography"], 2));
        let among = rows(&["fclk/ncc/affine", "esm/ssd/homography"], 2);
        assert_eq!(alone, among[alone.len()..]);
    }

    #[test]
    fn a_tracker_is_perturbed_by_its_own_warps() {
        let perturbed_by = |perturb: Perturb| {
            let registry = Registry::builtin();
            let all = [
                "esm/ssd/translation",
                "esm/ssd/similitude",
                "falk/ssd/spline",
                "pyramid(esm/ssd/translation)",
                "pyes/ssd/affine",
            ];
            let entry =
                |id: &str| TrackerEntry::from_registry(&registry, &registry.parse(id).unwrap()).unwrap();
            let request = BasinRequest::new(&registry, all.map(entry).to_vec(), perturb, Vec::new());
            let name =
                |(_, model): &(TrackerEntry, Option<SsmEntry>)| Warps::new(model.as_ref()).unwrap().name;
            request.trackers.iter().map(name).collect::<Vec<_>>()
        };
        let own = ["translation", "similitude", "homography", "translation", "affine"];
        assert_eq!(perturbed_by(Perturb::Own), own);
        assert_eq!(perturbed_by(Perturb::Homography), ["homography"; 5]);
        // Half a pixel of homographies is a misfit of translations, not of their search.
        let rows = rows(&["esm/ssd/translation", "esm/ssd/homography"], 2);
        assert_eq!((rows[0].warp.as_str(), rows[0].rate()), ("translation", 1.0));
        assert_eq!((rows[6].warp.as_str(), rows[6].rate()), ("homography", 1.0));
        assert!(rows[0].distance[2] < 0.05, "{:?}", rows[0]);
    }

    #[test]
    fn sigma_means_the_same_displacement_for_all_warps() {
        let registry = Registry::builtin();
        let base = Corners::rect(20.0, 30.0, 100.0, 100.0);
        for name in ["translation", "isometry", "similitude", "affine", "homography"] {
            let warps = Warps::new(registry.ssms().iter().find(|e| e.is_called(name))).unwrap();
            let mut rng = Pcg64::seed_from_u64(3);
            let square = |_| {
                let moved = warps.perturbed(&base, 2.0, &mut rng).to_array();
                let apart = moved.iter().zip(base.to_array()).map(|(a, b)| (a - b).powi(2));
                apart.sum::<f64>() / 8.0
            };
            let rms = ((0..2000).map(square).sum::<f64>() / 2000.0).sqrt();
            assert!((rms - 2.0).abs() < 0.1, "{name}: {rms}");
        }
    }

    #[test]
    fn sigmas_grow_to_a_quarter_of_the_box() {
        assert_eq!(usual_sigmas(40.0), [1.0, 2.0, 3.0, 4.0, 6.0, 8.0]);
    }

    fn row(trials: usize, converged: usize, rates: &[f64]) -> BasinRow {
        BasinRow {
            tracker: String::new(),
            texture: String::new(),
            warp: String::new(),
            sigma: 1.0,
            trials,
            converged,
            distance: Vec::new(),
            rates: rates.to_vec(),
        }
    }

    #[test]
    fn intervals_are_over_images() {
        let width = |row: &BasinRow| row.interval()[1] - row.interval()[0];
        // 2000 trials on four images that differ say little of a fifth.
        let differ = row(2000, 1000, &[0.2, 0.4, 0.6, 0.8]);
        let student = 2.0 * student_975(3.0) * (0.2f64 / 3.0 / 4.0).sqrt();
        let share = width(&differ) / student;
        assert!((0.7..1.0).contains(&share), "{share} {:?}", differ.interval());
        // Images that agree are no more than their trials.
        let agree = row(2000, 1000, &[0.5, 0.5, 0.5, 0.5]);
        assert!(width(&agree) > width(&row(2000, 1000, &[])) && width(&agree) < 0.1);
        let [low, high] = row(2000, 2000, &[1.0; 4]).interval();
        assert!(low < 1.0 && high == 1.0);
    }

    /// Rates of images drawn from one distribution: the interval of few of them holds its mean about as often as it says.
    #[test]
    fn intervals_cover_the_mean_over_images() {
        let mut rng = Pcg64::seed_from_u64(5);
        let mut uniform = || rand::RngExt::random_range(&mut rng, 0.0..1.0);
        for (images, trials) in [(4, 100), (8, 50)] {
            let covered = (0..1000)
                .filter(|_| {
                    let rates: Vec<f64> = (0..images)
                        .map(|_| {
                            let rate = 0.3 + 0.5 * uniform();
                            (0..trials).filter(|_| uniform() < rate).count() as f64 / f64::from(trials)
                        })
                        .collect();
                    let converged = (rates.iter().sum::<f64>() * f64::from(trials)).round() as usize;
                    let [low, high] = row((images * trials) as usize, converged, &rates).interval();
                    low <= 0.55 && 0.55 <= high
                })
                .count();
            assert!(covered > 920, "{images} images: {covered} of 1000");
        }
    }

    #[test]
    fn intervals_hold_the_rate() {
        for (converged, low, high) in [(0, 0.0, 0.0738), (25, 0.3664, 0.6336), (50, 0.9262, 1.0)] {
            let row = row(50, converged, &[]);
            let [a, b] = row.interval();
            assert!((a - low).abs() < 5e-3 && (b - high).abs() < 5e-3, "{a} {b}");
            assert!(a <= row.rate() && row.rate() <= b);
        }
    }

    #[test]
    fn faults_are_told() {
        let fails = |change: &dyn Fn(&mut BasinRequest)| {
            let mut r = request(&["esm/ssd/homography"]);
            change(&mut r);
            run(&r, &AtomicBool::new(false), &|_| ()).unwrap_err().to_string()
        };
        assert_eq!(fails(&|r| r.sigmas.clear()), "no sigma");
        assert!(fails(&|r| r.textures[0].image = Image::new(30, 200, 1)).contains("30x200 px leave no room"));
        assert!(fails(&|r| r.textures[1].image = Image::new(100, 100, 1)).contains("cannot start on waves2"));
    }

    /// A tracker that fails to move from where it is put.
    struct Stuck(Corners);

    impl Tracker for Stuck {
        fn init(&mut self, _: &Frame, _: &Corners) -> Result<(), mtf::tracker::TrackError> {
            Ok(())
        }
        fn update(&mut self, _: &Frame) -> Result<mtf::tracker::Update, mtf::tracker::TrackError> {
            Err(mtf::tracker::TrackError::Singular)
        }
        fn set_region(&mut self, corners: &Corners) -> Result<(), mtf::tracker::TrackError> {
            self.0 = *corners;
            Ok(())
        }
        fn corners(&self) -> Corners {
            self.0
        }
    }

    #[test]
    fn a_tracker_within_the_threshold_has_converged() {
        let request = request(&["esm/ssd/homography"]);
        let (entry, _) = &request.trackers[0];
        let warps = Warps::new(None).unwrap();
        let frame = Frame::from_gray(Image::new(50, 50, 1));
        let base = Corners::rect(10.0, 10.0, 20.0, 20.0);
        for threshold in [0.5, 1.0, 4.0] {
            let converged = |distance: f64| {
                let mut subject = Subject {
                    entry,
                    warps: &warps,
                    threshold,
                    tracker: Box::new(Stuck(base)),
                    row: no_trials(entry, &warps, "t", 1.0),
                };
                // All corners are as far away as their mean.
                let truth = base.translated(0.6 * distance, -0.8 * distance);
                subject.trial(&frame, &base, &frame, &truth, 3);
                assert_eq!(subject.row.trials, 1);
                subject.row.converged == 1
            };
            assert!(converged(0.0) && converged(0.99 * threshold), "{threshold}");
            assert!(
                !converged(1.01 * threshold) && !converged(1.9 * threshold),
                "{threshold}"
            );
        }
    }
}
