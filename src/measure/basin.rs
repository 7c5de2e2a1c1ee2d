//! The static convergence experiment (Baker & Matthews 2004): how far from the truth may a tracker start?
//!
//! An image is warped by the homography that moves each corner of a box by Gaussian noise of standard deviation σ; the
//! tracker, which knows the box in the unwarped image, starts there. It has converged when it is within a threshold
//! of the moved corners after a few updates on the warped image. All trackers see the same warps.

use crate::metric::quantile::NORMAL_975;
use crate::plan::{RunRequest, TrackerEntry, derived_seed, usual_filter};
use mtf::geom::{Corners, Mat3, homography};
use mtf::image::{Frame, Image, PreProcessor};
use mtf::tracker::{Tracker, afford};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// An image to warp.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Name.
    pub name: String,
    /// Its gray values, 0–255.
    pub image: Image,
}

/// What is tried.
#[derive(Clone)]
pub struct BasinRequest {
    /// The trackers, with the distance of a converged one, px.
    pub trackers: Vec<(TrackerEntry, f64)>,
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
    /// Mean corner distance of a converged tracker unless told otherwise, px.
    pub const WITHIN: f64 = 1.0;

    /// `trackers`, converged within [`WITHIN`](Self::WITHIN), on `textures`, with the program's defaults: 500 warps for
    /// each of the usual sigmas, a box of 200 px, 3 updates, the usual filter, seed 0.
    pub fn new(trackers: Vec<TrackerEntry>, textures: Vec<Texture>) -> BasinRequest {
        let side = 200.0;
        BasinRequest {
            trackers: trackers.into_iter().map(|t| (t, BasinRequest::WITHIN)).collect(),
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
    /// Standard deviation of the perturbation, px.
    pub sigma: f64,
    /// Warps tried.
    pub trials: usize,
    /// Those it converged from.
    pub converged: usize,
    /// Mean corner distance after each update over those it converged from, px; empty when there are none.
    pub distance: Vec<f64>,
}

impl BasinRow {
    /// Fraction it converged from.
    pub fn rate(&self) -> f64 {
        self.converged as f64 / self.trials as f64
    }

    /// 95 % interval of the rate (Wilson 1927).
    pub fn interval(&self) -> [f64; 2] {
        const Z: f64 = NORMAL_975;
        let (n, p) = (self.trials as f64, self.rate());
        let centre = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        [(centre - half).max(0.0), (centre + half).min(1.0)]
    }
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

/// Warps per sigma and image: the moved corners. The same for every tracker.
fn perturbed(base: &Corners, sigma: f64, rng: &mut Pcg64) -> Corners {
    loop {
        let moved = Corners(base.0.map(|c| {
            c.map(|v| {
                let z: f64 = StandardNormal.sample(rng);
                v + sigma * z
            })
        }));
        if moved.is_convex() && moved.signed_area() > FOLDED * base.signed_area() {
            return moved;
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

/// Runs the experiment: rows by tracker, then image (all of them pooled last), then sigma. The same for any number of
/// threads. `progress` is told the share that is done.
///
/// # Errors
/// See [`BasinError`].
pub fn run(
    request: &BasinRequest,
    stop: &AtomicBool,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Vec<BasinRow>, BasinError> {
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
    let mut rows: Vec<BasinRow> = Vec::new();
    let steps = (request.textures.len() * request.sigmas.len()) as f64;
    for (t, texture) in request.textures.iter().enumerate() {
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
        let base = Corners::rect(corner(w), corner(h), side, side);
        let first = Frame::from_gray(request.pre.apply(texture.image.clone()));
        let mut subjects: Vec<Subject<'_>> = request
            .trackers
            .par_iter()
            .map(|(entry, threshold)| {
                let start = |reason: String| BasinError::Start {
                    tracker: entry.name.id.clone(),
                    texture: texture.name.clone(),
                    reason,
                };
                let mut tracker = (entry.make)().map_err(start)?;
                tracker.reseed(derived_seed(request.seed, &[&entry.name.id, &texture.name], None));
                afford(tracker.as_ref(), RunRequest::MEMORY).map_err(|e| start(e.to_string()))?;
                tracker.init(&first, &base).map_err(|e| start(e.to_string()))?;
                let row = BasinRow {
                    tracker: entry.name.id.clone(),
                    texture: texture.name.clone(),
                    sigma: 0.0,
                    trials: 0,
                    converged: 0,
                    distance: Vec::new(),
                };
                Ok(Subject {
                    entry,
                    threshold: *threshold,
                    tracker,
                    row,
                })
            })
            .collect::<Result<_, BasinError>>()?;
        for (s, &sigma) in request.sigmas.iter().enumerate() {
            let mut rng = Pcg64::seed_from_u64(derived_seed(
                request.seed,
                &["warps", &texture.name, &sigma.to_string()],
                None,
            ));
            let truths: Vec<Corners> = (0..request.trials)
                .map(|_| perturbed(&base, sigma, &mut rng))
                .collect();
            for batch in truths.chunks(BATCH) {
                if stop.load(Ordering::Relaxed) {
                    return Err(BasinError::Stopped);
                }
                let views: Vec<(Frame, Corners)> = batch
                    .par_iter()
                    .filter_map(|truth| {
                        let to_source = homography::from_corners(truth, &base)?;
                        let image = request.pre.apply(warped(&texture.image, &to_source));
                        Some((Frame::from_gray(image), *truth))
                    })
                    .collect();
                subjects.par_iter_mut().with_max_len(1).for_each(|subject| {
                    for (frame, truth) in &views {
                        subject.trial(&first, &base, frame, truth, request.updates);
                    }
                });
            }
            for subject in &mut subjects {
                let fresh = BasinRow {
                    tracker: subject.entry.name.id.clone(),
                    texture: texture.name.clone(),
                    sigma: 0.0,
                    trials: 0,
                    converged: 0,
                    distance: Vec::new(),
                };
                let mut row = std::mem::replace(&mut subject.row, fresh);
                row.sigma = sigma;
                rows.push(row);
            }
            progress((t * request.sigmas.len() + s + 1) as f64 / steps);
        }
    }
    Ok(ordered(request, rows))
}

/// Rows by tracker, image and sigma, with pooled ones; sums of distances become means.
fn ordered(request: &BasinRequest, rows: Vec<BasinRow>) -> Vec<BasinRow> {
    let mut out = Vec::with_capacity(2 * rows.len());
    let finish = |mut row: BasinRow| {
        let n = row.converged as f64;
        row.distance
            .iter_mut()
            .for_each(|d| *d = (*d / n * 1e6).round() / 1e6);
        row
    };
    for (entry, _) in &request.trackers {
        let own = || rows.iter().filter(|r| r.tracker == entry.name.id);
        out.extend(own().cloned().map(finish));
        if request.textures.len() < 2 {
            continue;
        }
        for &sigma in &request.sigmas {
            let mut pooled = BasinRow {
                tracker: entry.name.id.clone(),
                texture: POOLED.to_owned(),
                sigma,
                trials: 0,
                converged: 0,
                distance: Vec::new(),
            };
            for row in own().filter(|r| r.sigma == sigma) {
                pooled.trials += row.trials;
                pooled.converged += row.converged;
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
    use mtf::registry::Registry;

    fn request(trackers: &[&str]) -> BasinRequest {
        let registry = Arc::new(Registry::builtin());
        let entry = |id: &&str| {
            let spec = registry.parse(id).unwrap();
            (TrackerEntry::from_registry(&registry, &spec).unwrap(), 1.0)
        };
        let texture = |seed: u64| {
            let waves = Waves::new(seed);
            Texture {
                name: format!("waves{seed}"),
                image: Image::from_fn(200, 160, |x, y| waves.at([x as f64, y as f64]) as f32),
            }
        };
        BasinRequest {
            trackers: trackers.iter().map(entry).collect(),
            textures: vec![texture(1), texture(2)],
            sigmas: vec![0.5, 24.0],
            trials: 12,
            side: 60.0,
            updates: 3,
            pre: Arc::new(mtf::image::Identity),
            seed: 7,
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
    fn sigmas_grow_to_a_quarter_of_the_box() {
        assert_eq!(usual_sigmas(40.0), [1.0, 2.0, 3.0, 4.0, 6.0, 8.0]);
    }

    #[test]
    fn intervals_hold_the_rate() {
        for (converged, low, high) in [(0, 0.0, 0.0738), (25, 0.3664, 0.6336), (50, 0.9262, 1.0)] {
            let row = BasinRow {
                tracker: String::new(),
                texture: String::new(),
                sigma: 1.0,
                trials: 50,
                converged,
                distance: Vec::new(),
            };
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
}
