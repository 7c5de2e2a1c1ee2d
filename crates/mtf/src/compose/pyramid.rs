//! Pyramid: the same tracker on every level of the image pyramid, coarse to fine. Level `k` is the frame halved `k` times,
//! `x_k = x/2^k` exactly. Regions may widen by the same factor, as the windows of pyramidal flow do (Bouguet 2000).

use super::entry::{CompositeEntry, CompositeFamily, Make, Member, Refused};
use super::members::Members;
use super::seed::{self, Apart};
use crate::geom::{Corners, homography};
use crate::image::Frame;
use crate::interrupt;
use crate::params::{Built, ParamValue, Params, Resolution};
use crate::tracker::{Stop, TrackError, Tracker, Update};
use std::sync::Arc;

crate::params! {
    /// Parameters of [`Pyramid`].
    pub struct PyramidParams {
        /// Levels, the full frame included; fewer for small objects.
        levels: usize = 3, in 1..=8;
        /// Coarser levels sample fewer points: half as many per side from level to level, no fewer than 8. Faster, and coarser.
        scale_res: bool = false, paper true => "coarse levels of small objects keep enough points: AUC of `pyic` .857 against .839 (`pyes` .907 against .911)";
        /// Level `k` sees a region `2^k` times as wide about the same centre: as many pixels on every level. For small
        /// patches of a larger object.
        widen: bool = false;
    }
}

/// The table row.
pub(super) const ENTRY: CompositeEntry = CompositeEntry::new::<PyramidParams>(
    "pyramid",
    "the same tracker on every level of the image pyramid, coarse to fine",
    |a, parts| {
        let params = PyramidParams::from_assignments(a)?;
        let levels = (0..params.levels).map(|k| level(&params, &parts.members[0], k));
        let levels: Vec<Make> = levels.collect::<Result<_, _>>()?;
        Ok(Arc::new(move || {
            Ok(Box::new(Pyramid::new(levels.clone(), params.widen)?))
        }))
    },
    CompositeFamily { members: (1, 1) },
)
.also(&["pyr", "pysm", "pyrs"])
.published("section 3.2");

/// Fewest points per side of a coarse level.
const MIN_RES: usize = 8;

/// The tracker of level `k`, sampled more coarsely on coarser levels if asked for.
fn level(params: &PyramidParams, member: &Member<'_>, k: usize) -> Result<Make, Refused> {
    let res = member.value("res").and_then(Resolution::parse);
    let Some(res) = res.filter(|_| params.scale_res && k > 0) else {
        return Ok(Arc::clone(&member.make));
    };
    let side = |n: usize| (n >> k).max(MIN_RES.min(n));
    let coarse = Resolution {
        cols: side(res.cols),
        rows: side(res.rows),
    };
    (member.adapt)(&[("res", &coarse.text())])
}

/// Shortest side of the object on the coarsest level, px.
const MIN_SIDE: f64 = 8.0;

/// A tracker per level.
pub struct Pyramid {
    /// Level 0, and those coarser ones that have been needed.
    levels: Members,
    /// What builds each, level 0 first.
    makes: Vec<Make>,
    seed: Option<u64>,
    threads: usize,
    /// Of these, the ones in use: all that the object is large enough for.
    used: usize,
    widen: bool,
    /// Region at the start, px.
    base: Corners,
}

fn scaled(corners: &Corners, factor: f64) -> Corners {
    Corners(corners.0.map(|c| c.map(|v| v * factor)))
}

/// `2^-k`.
fn shrink(level: usize) -> f64 {
    1.0 / (1u64 << level) as f64
}

impl Pyramid {
    /// From what builds the tracker of each level, level 0 (the full frame) first; at least one. Coarser levels are built by
    /// `init`, as far as the object is large enough for them.
    ///
    /// # Errors
    /// Those of building level 0.
    pub fn new(levels: Vec<Make>, widen: bool) -> Built<Self> {
        let first = levels.first().map(|make| make()).transpose()?;
        Ok(Pyramid {
            levels: Members::new(first.into_iter().collect()),
            makes: levels,
            seed: None,
            threads: 1,
            used: 0,
            widen,
            base: Corners::default(),
        })
    }

    /// Builds the levels up to `k` that are not there yet.
    fn populate(&mut self, k: usize) -> Result<(), TrackError> {
        for make in &self.makes[self.levels.len().min(k + 1)..=k] {
            let unable = TrackError::Unable("the tracker of a level can no longer be built");
            let mut level = make().map_err(|_| unable)?;
            if let Some(seed) = self.seed {
                level.reseed(seed::of_member(seed, self.levels.len() as u64 + 1, Apart::Mixed));
            }
            level.set_threads(self.threads);
            self.levels.push(level);
        }
        Ok(())
    }

    /// Bytes that the levels keep which are not built yet.
    fn to_come(&self) -> usize {
        // Most levels are built alike.
        let first = self.levels.first().map_or(0, |level| level.memory());
        let alike = |make: &Make| Arc::ptr_eq(make, &self.makes[0]);
        let bytes = |make: &Make| match alike(make) {
            true => first,
            false => make().map_or(first, |level| level.memory()),
        };
        let coarser = &self.makes[self.levels.len()..];
        coarser.iter().map(bytes).fold(0, usize::saturating_add)
    }

    /// The region at the start that level `k` sees, px of the frame.
    fn seen(&self, k: usize) -> Corners {
        let centre = self.base.centroid();
        let factor = if self.widen { 1.0 / shrink(k) } else { 1.0 };
        Corners(
            self.base
                .0
                .map(|x| [0, 1].map(|c| centre[c] + factor * (x[c] - centre[c]))),
        )
    }

    /// What level `k` sees when the region is at `corners`, px of the level.
    fn down(&self, corners: &Corners, k: usize) -> Option<Corners> {
        if !self.widen || k == 0 {
            return Some(scaled(corners, shrink(k)));
        }
        let motion = homography::from_corners(&self.base, corners)?;
        let seen = homography::apply_corners(&motion, &self.seen(k));
        Some(scaled(&seen, shrink(k)))
    }

    /// Where the region is when level `k` sees `corners`, px of the level.
    fn up(&self, corners: &Corners, k: usize) -> Option<Corners> {
        let seen = scaled(corners, 1.0 / shrink(k));
        if !self.widen || k == 0 {
            return Some(seen);
        }
        let motion = homography::from_corners(&self.seen(k), &seen)?;
        Some(homography::apply_corners(&motion, &self.base))
    }

    /// Where level `k` is to go, px of the level.
    fn target(&self, k: usize, corners: &Corners) -> Result<Corners, TrackError> {
        self.down(corners, k)
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))
    }

    /// Moves level `k` to where the region is. A level that cannot go there searches from where it was.
    fn move_level(&mut self, k: usize, corners: &Corners) -> Result<(), TrackError> {
        let seen = self.target(k, corners)?;
        self.levels[k].set_region(&seen)
    }

    fn level<'f>(&self, frame: &'f Frame, k: usize) -> &'f Frame {
        frame.level(k, self.levels[k].channels())
    }
}

impl Tracker for Pyramid {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        let side = (0..4).map(|i| {
            let (a, b) = (corners.0[i], corners.0[(i + 1) % 4]);
            ((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])).sqrt()
        });
        let shortest = side.fold(f64::INFINITY, f64::min);
        let widen = self.widen;
        let fits = |k: &usize| k < &frame.levels() && (widen || shortest * shrink(*k) >= MIN_SIDE);
        self.used = 0;
        self.base = *corners;
        for k in 0..(0..self.makes.len()).take_while(fits).count().max(1) {
            interrupt::check()?;
            self.populate(k)?;
            let level = frame.level(k, self.levels[k].channels());
            let seen = scaled(&self.seen(k), shrink(k));
            let started = self.levels[k].init(level, &seen);
            match started {
                Ok(()) => self.used = k + 1,
                // What is too small to see on a coarse level is tracked on the finer ones.
                Err(_) if k > 0 && !interrupt::requested() => break,
                Err(e) => return Err(e),
            }
        }
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        if self.used == 0 {
            return Err(TrackError::NotInitialised);
        }
        let mut iterations = 0;
        let mut answer: Option<Update> = None;
        let mut error = TrackError::NotInitialised;
        for k in (0..self.used).rev() {
            let level = self.level(frame, k);
            if let Some(coarse) = &answer {
                let _ = self.move_level(k, &coarse.corners);
            }
            match self.levels[k].update(level) {
                Ok(update) => {
                    iterations += update.iterations;
                    if let Some(corners) = self.up(&update.corners, k) {
                        answer = Some(Update { corners, ..update });
                    }
                }
                Err(e) => error = e,
            }
        }
        interrupt::check()?;
        let update = answer.ok_or(error)?;
        let top = self.used - 1;
        let _ = self.move_level(top, &update.corners);
        Ok(Update {
            stop: Stop::Done,
            iterations,
            ..update
        })
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        (0..self.used).try_for_each(|k| self.move_level(k, corners))
    }

    fn skip(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        (0..self.used).try_for_each(|k| {
            let seen = self.target(k, corners)?;
            let level = self.level(frame, k);
            self.levels[k].skip(level, &seen)
        })
    }

    fn corners(&self) -> Corners {
        self.levels[0].corners()
    }

    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        self.levels[0].place(x)
    }

    fn reseed(&mut self, seed: u64) {
        self.seed = Some(seed);
        self.levels.reseed(seed);
    }

    fn set_threads(&mut self, threads: usize) {
        self.threads = threads;
        self.levels.set_threads(threads);
    }

    fn channels(&self) -> usize {
        self.levels.channels()
    }

    fn memory(&self) -> usize {
        let to_come = if self.used == 0 { self.to_come() } else { 0 };
        self.levels.memory().saturating_add(to_come)
    }

    fn memory_needed(&self) -> usize {
        self.memory().saturating_add(self.levels.passing())
    }
}
