//! Sparse pyramidal Lucas-Kanade flow (Lucas & Kanade 1981; Bouguet 2000): per point and level, coarse to fine,
//! `v <- v + G⁻¹ Σ (I(x) - J(x + g + v)) ∇I(x)` over a window, `G = Σ ∇I ∇Iᵀ`, then `g <- 2 (g + v)`. The gradient is
//! that of the first image (inverse compositional), so each level needs it once.

use crate::image::{Frame, Image};
use crate::interrupt;
use crate::kernels::{self, FlowWindow, Place};
use crate::threads::in_shares;

crate::params! {
    /// Parameters of pyramidal Lucas-Kanade flow.
    pub struct KltParams {
        /// Side of the window, px; made odd.
        klt_window: usize = 21, in 3..=101;
        /// Highest level of the pyramid; 0: the image alone.
        klt_levels: usize = 4, in 0..=10, paper 2 => "large motion is found: AUC of `flow` .858 against .856";
        /// Most iterations per level.
        klt_iters: usize = 30, in 1..=1000;
        /// Converged when a step is shorter than this, px.
        klt_epsilon: f64 = 0.01, in 1e-6..=1.0;
        /// Points whose windows have a smaller normalised cross-correlation in the end are lost.
        klt_min_ncc: f64 = 0.3, in -1.0..=1.0, paper -1.0 => "windows that are covered are left out: AUC of `flow` .858 against .857";
        /// Grids of points: passes over each frame, all but the first with windows warped as the fit before says.
        klt_passes: usize = 2, in 1..=10, paper 1 => "windows warped as the object are found better: AUC of `flow` .858 against .843";
        /// Grids of points: share of those with texture that must agree after one pass over the lowest levels for the rest to be
        /// left out; 0: it never is.
        klt_enough: f64 = 0.85, in 0.0..=1.0, paper 0.0 => "less work where most points agree; AUC of `flow` .858 against .860";
        /// Points whose window has a structure matrix (mean of ∇I ∇Iᵀ) with a smaller eigenvalue are lost, (intensity/px)².
        klt_min_eigen: f64 = 0.1, in 0.0..=1e6;
    }
}

/// What became of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointStatus {
    /// Found.
    Tracked,
    /// Its window has no texture in some direction.
    Flat,
    /// It, or most of its window, has left the image.
    Outside,
    /// What was found does not look like it.
    Unlike,
}

/// A point in the second frame.
#[derive(Clone, Copy, Debug)]
pub struct Tracked {
    /// Where it is, px; meaningful when tracked.
    pub at: [f64; 2],
    /// What became of it.
    pub status: PointStatus,
    /// Mean absolute difference of the windows, intensity.
    pub residual: f64,
    /// Smaller eigenvalue of the structure matrix, (intensity/px)².
    pub min_eigen: f64,
}

impl Tracked {
    /// Whether it was found.
    pub fn ok(&self) -> bool {
        self.status == PointStatus::Tracked
    }
}

/// Steps at levels above the image need not be finer than this, px of the level.
const COARSE_EPSILON: f64 = 0.03;
/// At levels above the image, points may be this far outside, px of the level.
const COARSE_SLACK: f64 = 2.0;
/// Steps that undo the last one within this end the iterations half way, px.
const OSCILLATION: f64 = 0.01;
/// Windows are not seen through maps with larger entries.
const MAX_STRETCH: f64 = 4.0;
/// Least fraction of a window's samples inside the image.
const MIN_INSIDE: f64 = 0.5;

/// Pyramidal Lucas-Kanade flow with its scratch.
#[derive(Clone, Debug)]
pub struct Klt {
    params: KltParams,
    window: FlowWindow,
    back: Vec<Tracked>,
    ahead: Vec<[f64; 2]>,
    /// With more threads than one: what follows each share of the points, and what became of them.
    helpers: Vec<(Klt, Vec<Tracked>)>,
}

impl Klt {
    /// With parameters.
    pub fn new(params: KltParams) -> Self {
        let window = FlowWindow::new(params.klt_window | 1);
        Klt {
            params,
            window,
            back: Vec::new(),
            ahead: Vec::new(),
            helpers: Vec::new(),
        }
    }

    /// Parameters.
    pub fn params(&self) -> &KltParams {
        &self.params
    }

    /// Where the points `from` (px) of frame `first` are in frame `second`, in order, into `out`. The search starts
    /// where they were, on level `highest` at most.
    pub fn track(
        &mut self,
        first: &Frame,
        second: &Frame,
        from: &[[f64; 2]],
        highest: usize,
        out: &mut Vec<Tracked>,
    ) {
        self.track_each(from.len(), out, |klt, i| {
            klt.descend(first, second, from[i], from[i], None, highest)
        });
    }

    /// Threads of the current `rayon` pool that follow points at once. Never changes a result.
    pub fn set_threads(&mut self, threads: usize) {
        let helper = (Klt::new(self.params.clone()), Vec::new());
        self.helpers = vec![helper; if threads > 1 { threads } else { 0 }];
    }

    /// What `point` makes of each of `count` points, in order, into `out`.
    pub fn track_each(
        &mut self,
        count: usize,
        out: &mut Vec<Tracked>,
        point: impl Fn(&mut Klt, usize) -> Tracked + Sync,
    ) {
        out.clear();
        if self.helpers.is_empty() {
            out.extend((0..count).map(|i| point(self, i)));
            return;
        }
        in_shares(&mut self.helpers, count, |(klt, tracked), share| {
            tracked.clear();
            tracked.extend(share.map(|i| point(klt, i)));
        });
        out.extend(self.helpers.iter().flat_map(|(_, tracked)| tracked));
    }

    /// One point, searched from `guess` on.
    pub fn track_point(&mut self, first: &Frame, second: &Frame, x: [f64; 2], guess: [f64; 2]) -> Tracked {
        self.descend(first, second, x, guess, None, usize::MAX)
    }

    /// One point near `guess` whose surroundings move by the 2x2 matrix `a` (row-major): what is at `x + d` in the first
    /// frame is at `guess + a d` in the second. The window of the first frame is seen through `a`. The search starts on
    /// level `highest` at most.
    pub fn track_warped(
        &mut self,
        first: &Frame,
        second: &Frame,
        x: [f64; 2],
        guess: [f64; 2],
        a: [f64; 4],
        highest: usize,
    ) -> Tracked {
        let det = a[0] * a[3] - a[1] * a[2];
        let back = [a[3] / det, -a[1] / det, -a[2] / det, a[0] / det];
        let sound = back.iter().all(|v| v.abs() < MAX_STRETCH);
        // A map that is of no use says nothing about the motion either.
        let (back, highest) = if sound {
            (Some(back), highest)
        } else {
            (None, usize::MAX)
        };
        self.descend(first, second, x, guess, back, highest)
    }

    fn descend(
        &mut self,
        first: &Frame,
        second: &Frame,
        x: [f64; 2],
        guess: [f64; 2],
        back: Option<[f64; 4]>,
        highest: usize,
    ) -> Tracked {
        let top = self
            .params
            .klt_levels
            .min(highest)
            .min(first.levels() - 1)
            .min(second.levels() - 1);
        let mut found = Tracked {
            at: guess,
            status: PointStatus::Outside,
            residual: f64::INFINITY,
            min_eigen: 0.0,
        };
        let near = inside(first.gray(), x, 0.0) && guess.iter().all(|v| v.is_finite());
        // Interrupted, no point is found.
        if !near || interrupt::requested() {
            return found;
        }
        for level in (0..=top).rev() {
            let scale = 1.0 / f64::from(1u32 << level);
            let images = (first.level(level, 1).gray(), second.level(level, 1).gray());
            let at = found.at.map(|v| v * scale);
            let step = self.search(images, x.map(|v| v * scale), at, back, level);
            // What a coarse level cannot tell (it leaves the point where it was), a finer one may.
            found = Tracked {
                at: step.at.map(|v| v / scale),
                ..step
            };
        }
        found
    }

    /// One level: `x` and the start `at` in px of the level.
    fn search(
        &mut self,
        (first, second): (&Image, &Image),
        x: [f64; 2],
        at: [f64; 2],
        back: Option<[f64; 4]>,
        level: usize,
    ) -> Tracked {
        let (epsilon, slack) = if level == 0 {
            (self.params.klt_epsilon, 0.0)
        } else {
            (self.params.klt_epsilon.max(COARSE_EPSILON), COARSE_SLACK)
        };
        let side = self.window.side();
        let area = (side * side) as f64;
        let radius = (side / 2) as f64;
        let window_at = |image, p: [f64; 2]| place(image, p[0] - radius, p[1] - radius);
        let warped = back.and_then(|b| warped_window(first, x, b, radius + 1.0));
        let [xx, xy, yy] = match warped {
            Some(map) => kernels::flow_window_warped(first.view(0), map, &mut self.window),
            None => kernels::flow_window(window_at(first, x), &mut self.window),
        };
        let min_eigen = smaller_eigenvalue([xx, xy, yy]) / area;
        let mut found = Tracked {
            at,
            status: PointStatus::Flat,
            residual: f64::INFINITY,
            min_eigen,
        };
        let determinant = xx * yy - xy * xy;
        // Also when it is not a number.
        if !(min_eigen >= self.params.klt_min_eigen && determinant > 0.0) {
            return found;
        }
        found.status = PointStatus::Outside;
        if !inside(second, at, slack) {
            return found;
        }
        let mut last = [0.0; 2];
        for _ in 0..self.params.klt_iters {
            let place = window_at(second, found.at);
            let [cols, rows] = place.valid(side, side);
            if ((cols.len() * rows.len()) as f64) < MIN_INSIDE * area {
                return found;
            }
            let [bx, by] = kernels::flow_mismatch(place, &self.window);
            let step = [
                (yy * bx - xy * by) / determinant,
                (xx * by - xy * bx) / determinant,
            ];
            let undone = [last[0] + step[0], last[1] + step[1]];
            let share = if last != [0.0; 2] && squared(undone) < OSCILLATION * OSCILLATION {
                0.5
            } else {
                1.0
            };
            found.at = [found.at[0] + share * step[0], found.at[1] + share * step[1]];
            if !inside(second, found.at, slack) {
                return found;
            }
            if share < 1.0 || squared(step) < epsilon * epsilon {
                break;
            }
            last = step;
        }
        found.status = PointStatus::Tracked;
        if level == 0 {
            let alike = kernels::flow_match(window_at(second, found.at), &self.window);
            found.residual = alike.residual;
            if alike.ncc.is_nan() || alike.ncc < self.params.klt_min_ncc {
                found.status = PointStatus::Unlike;
            }
        }
        found
    }

    /// Squared distance, px², by which each point misses its origin when it is tracked back from `second` to `first`;
    /// infinite for points that are lost on the way. On level `highest` at most.
    pub fn forward_backward(
        &mut self,
        first: &Frame,
        second: &Frame,
        from: &[[f64; 2]],
        tracked: &[Tracked],
        highest: usize,
        out: &mut Vec<f64>,
    ) {
        let mut ahead = std::mem::take(&mut self.ahead);
        let mut back = std::mem::take(&mut self.back);
        ahead.clear();
        ahead.extend(tracked.iter().map(|t| t.at));
        self.track(second, first, &ahead, highest, &mut back);
        out.clear();
        out.extend(from.iter().zip(tracked).zip(&back).map(|((x, t), b)| {
            if t.ok() && b.ok() {
                (b.at[0] - x[0]).powi(2) + (b.at[1] - x[1]).powi(2)
            } else {
                f64::INFINITY
            }
        }));
        (self.ahead, self.back) = (ahead, back);
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        let side = self.window.side();
        16 * side * (side + 8) + 64 * self.back.capacity()
    }
}

/// Smaller eigenvalue of the symmetric matrix of `xx`, `xy`, `yy`.
fn smaller_eigenvalue([xx, xy, yy]: [f64; 3]) -> f64 {
    let (mean, half) = ((xx + yy) / 2.0, (xx - yy) / 2.0);
    mean - (half * half + xy * xy).sqrt()
}

/// How much texture windows hold.
#[derive(Clone, Debug)]
pub struct Texture {
    window: FlowWindow,
}

impl Texture {
    /// Of windows `side` px wide; made odd.
    pub fn new(side: usize) -> Self {
        Texture {
            window: FlowWindow::new(side | 1),
        }
    }

    /// Smaller eigenvalue of the structure matrix (mean of ∇I ∇Iᵀ) of the window around `x` (px), (intensity/px)².
    pub fn min_eigen(&mut self, image: &Image, x: [f64; 2]) -> f64 {
        let side = self.window.side();
        let radius = (side / 2) as f64;
        let matrix = kernels::flow_window(place(image, x[0] - radius, x[1] - radius), &mut self.window);
        smaller_eigenvalue(matrix) / (side * side) as f64
    }
}

fn squared([x, y]: [f64; 2]) -> f64 {
    x * x + y * y
}

/// Whether a point is in the image, or outside by no more than `slack` px.
fn inside(image: &Image, [x, y]: [f64; 2], slack: f64) -> bool {
    let within = |v: f64, n: usize| v >= -slack && v <= (n - 1) as f64 + slack;
    within(x, image.width()) && within(y, image.height())
}

/// Where the samples of a window around `x`, `radius` px to each side with its margin, lie in the image: `x + b d`.
/// `None` when some are outside.
fn warped_window(image: &Image, x: [f64; 2], b: [f64; 4], radius: f64) -> Option<[f64; 6]> {
    let at = |u: f64, v: f64| [x[0] + b[0] * u + b[1] * v, x[1] + b[2] * u + b[3] * v];
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let all = corners
        .iter()
        .all(|[u, v]| inside(image, at(radius * u, radius * v), 0.0));
    let [left, top] = at(1.0 - radius, 1.0 - radius);
    all.then_some([left, b[0], b[1], top, b[2], b[3]])
}

fn place(image: &Image, x: f64, y: f64) -> Place<'_> {
    Place::new(image.view(0), x, y)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth texture of several wavelengths at `(x, y)`.
    fn texture(x: f64, y: f64) -> f64 {
        let wave = |a: f64, b: f64, c: f64| libm::sin(a * x + b * y + c);
        128.0
            + 30.0 * wave(0.21, 0.13, 0.4)
            + 25.0 * wave(-0.11, 0.27, 1.9)
            + 25.0 * wave(0.033, -0.041, 2.2)
            + 20.0 * wave(0.051, 0.024, 0.7)
            + 15.0 * wave(0.4, -0.33, 5.0)
    }

    /// The texture seen through `p -> a p + t` (row-major `a`): what is at `x` in the first frame is at `a x + t`.
    fn frame(a: [f64; 4], t: [f64; 2]) -> Frame {
        let det = a[0] * a[3] - a[1] * a[2];
        Frame::from_gray(Image::from_fn(320, 240, |x, y| {
            let (u, v) = (x as f64 - t[0], y as f64 - t[1]);
            texture((a[3] * u - a[1] * v) / det, (a[0] * v - a[2] * u) / det) as f32
        }))
    }

    const IDENTITY: [f64; 4] = [1.0, 0.0, 0.0, 1.0];

    fn points() -> Vec<[f64; 2]> {
        (0..100)
            .map(|i| [80.3 + 16.0 * f64::from(i % 10), 60.7 + 12.0 * f64::from(i / 10)])
            .collect()
    }

    #[test]
    fn translations_are_found() {
        let first = frame(IDENTITY, [0.0; 2]);
        for t in [[0.3, -0.7], [3.4, 2.2], [-11.6, 7.3], [24.5, -18.25]] {
            let second = frame(IDENTITY, t);
            let (mut klt, mut out, mut back) = (Klt::new(KltParams::default()), Vec::new(), Vec::new());
            klt.track(&first, &second, &points(), usize::MAX, &mut out);
            for (x, p) in points().iter().zip(&out) {
                assert!(p.ok(), "{t:?} {p:?}");
                let miss = (p.at[0] - x[0] - t[0]).hypot(p.at[1] - x[1] - t[1]);
                assert!(miss < 0.05 && p.residual < 2.0, "{t:?} {miss} {p:?}");
            }
            klt.forward_backward(&first, &second, &points(), &out, usize::MAX, &mut back);
            assert!(back.iter().all(|d| *d < 0.05 * 0.05), "{back:?}");
        }
    }

    #[test]
    fn affine_motion_moves_the_centres_of_windows() {
        let a = [1.02, -0.03, 0.025, 0.985];
        let t = [2.0, -5.0];
        let (first, second) = (frame(IDENTITY, [0.0; 2]), frame(a, t));
        let (mut klt, mut out) = (Klt::new(KltParams::default()), Vec::new());
        klt.track(&first, &second, &points(), usize::MAX, &mut out);
        let misses: Vec<f64> = points()
            .iter()
            .zip(&out)
            .map(|(x, p)| {
                assert!(p.ok());
                let want = [a[0] * x[0] + a[1] * x[1] + t[0], a[2] * x[0] + a[3] * x[1] + t[1]];
                (p.at[0] - want[0]).hypot(p.at[1] - want[1])
            })
            .collect();
        let mean = misses.iter().sum::<f64>() / 100.0;
        assert!(mean < 0.05, "{mean} {misses:?}");
    }

    #[test]
    fn windows_seen_through_the_motion_follow_large_ones() {
        let (s, c) = (libm::sin(0.5), libm::cos(0.5));
        let a = [1.2 * c, -1.2 * s, 1.2 * s, 1.2 * c];
        let map = |x: [f64; 2]| {
            [
                a[0] * x[0] + a[1] * x[1] + 60.0,
                a[2] * x[0] + a[3] * x[1] - 130.0,
            ]
        };
        let (first, second) = (frame(IDENTITY, [0.0; 2]), frame(a, [60.0, -130.0]));
        let mut klt = Klt::new(KltParams::default());
        for x in [[150.0, 120.0], [180.0, 105.0], [120.5, 130.25], [160.0, 140.0]] {
            let want = map(x);
            let guess = [want[0] + 2.0, want[1] - 1.5];
            let near = |p: Tracked| p.ok() && (p.at[0] - want[0]).hypot(p.at[1] - want[1]) < 0.05;
            assert!(near(klt.track_warped(&first, &second, x, guess, a, 2)), "{x:?}");
            assert!(!near(klt.track_point(&first, &second, x, guess)), "{x:?}");
        }
        // A map that is none.
        let lost = klt.track_warped(&first, &first, [150.0, 120.0], [150.0, 120.0], [0.0; 4], 2);
        assert!(lost.ok());
    }

    #[test]
    fn the_pyramid_reaches_farther() {
        let (first, second) = (frame(IDENTITY, [0.0; 2]), frame(IDENTITY, [22.0, 9.0]));
        let found = |klt_levels, highest| {
            let mut klt = Klt::new(KltParams {
                klt_levels,
                ..KltParams::default()
            });
            let mut out = Vec::new();
            klt.track(&first, &second, &points(), highest, &mut out);
            let near = |(x, p): &(&[f64; 2], &Tracked)| {
                p.ok() && (p.at[0] - x[0] - 22.0).hypot(p.at[1] - x[1] - 9.0) < 0.1
            };
            points().iter().zip(&out).filter(near).count()
        };
        assert_eq!(found(0, usize::MAX), found(4, 0));
        let counts = [found(0, usize::MAX), found(4, usize::MAX)];
        assert!(counts[0] < 20 && counts[1] > 80, "{counts:?}");
    }

    #[test]
    fn lost_points_say_why() {
        let (first, second) = (frame(IDENTITY, [0.0; 2]), frame(IDENTITY, [30.0, 0.0]));
        let flat = Frame::from_gray(Image::from_fn(320, 240, |_, _| 90.0));
        let edge = Frame::from_gray(Image::from_fn(
            320,
            240,
            |x, _| if x < 160 { 20.0 } else { 200.0 },
        ));
        let mut klt = Klt::new(KltParams::default());
        let mut status = |a: &Frame, b: &Frame, x| klt.track_point(a, b, x, x).status;
        assert_eq!(status(&first, &second, [308.0, 120.0]), PointStatus::Outside);
        assert_eq!(status(&first, &second, [-1.0, 120.0]), PointStatus::Outside);
        assert_eq!(status(&first, &second, [f64::NAN, 120.0]), PointStatus::Outside);
        assert_eq!(status(&flat, &flat, [160.0, 120.0]), PointStatus::Flat);
        // Along an edge nothing holds it.
        assert_eq!(status(&edge, &edge, [160.0, 120.0]), PointStatus::Flat);
        // Next to the border the part of the window inside suffices.
        assert_eq!(status(&first, &first, [2.0, 2.0]), PointStatus::Outside);
        assert_eq!(status(&first, &first, [6.0, 120.0]), PointStatus::Tracked);
        // Nothing there looks like it.
        assert!(
            !klt.track_point(&first, &flat, [160.0, 120.0], [160.0, 120.0])
                .ok()
        );
        let tiny = Frame::from_gray(Image::from_fn(9, 7, |x, y| (x * y) as f32));
        assert!(!klt.track_point(&tiny, &tiny, [4.0, 3.0], [4.0, 3.0]).at[0].is_nan());
    }

    /// Prints the time of 100 points: `cargo test --release -- --ignored --nocapture klt`.
    #[test]
    #[ignore = "prints a time"]
    fn time_of_100_points() {
        let (first, second) = (frame(IDENTITY, [0.0; 2]), frame(IDENTITY, [3.4, 2.2]));
        for klt_levels in [0, 3, 4] {
            let mut klt = Klt::new(KltParams {
                klt_levels,
                ..KltParams::default()
            });
            let mut out = Vec::new();
            let times = (0..200).map(|_| {
                let start = std::time::Instant::now();
                klt.track(&first, &second, &points(), usize::MAX, &mut out);
                start.elapsed()
            });
            println!("100 points, levels 0..={klt_levels}: {:?}", times.skip(1).min());
        }
    }

    #[test]
    fn texture_is_the_smaller_eigenvalue_of_the_mean_structure() {
        let product = Image::from_fn(40, 40, |x, y| (x * y) as f32 / 8.0);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for y in 13..=19 {
            for x in 17..=23 {
                let (gx, gy) = (f64::from(y) / 8.0, f64::from(x) / 8.0);
                (xx, xy, yy) = (xx + gx * gx / 49.0, xy + gx * gy / 49.0, yy + gy * gy / 49.0);
            }
        }
        let smaller = nalgebra::Matrix2::new(xx, xy, xy, yy)
            .symmetric_eigenvalues()
            .min();
        let found = Texture::new(7).min_eigen(&product, [20.0, 16.0]);
        assert!((found - smaller).abs() < 1e-4, "{found} {smaller}");
        let ramp = Image::from_fn(40, 40, |x, _| x as f32);
        assert!(Texture::new(7).min_eigen(&ramp, [20.0, 16.0]).abs() < 1e-6);
    }

    #[test]
    fn what_is_found_must_correlate_by_the_least_that_is_asked() {
        let first = frame(IDENTITY, [0.0; 2]);
        // Something that the texture knows nothing of lies over it.
        let second = Frame::from_gray(Image::from_fn(320, 240, |x, y| {
            first.gray().get(0, x, y) + 30.0 * libm::sin(0.9 * x as f64 + 1.1 * y as f64) as f32
        }));
        let x = [160.0, 120.0];
        let track = |klt_min_ncc: f64| {
            let params = KltParams {
                klt_min_ncc,
                ..KltParams::default()
            };
            Klt::new(params).track_point(&first, &second, x, x)
        };
        let free = track(-1.0);
        assert!(free.ok());
        // The correlation of both windows of 21x21 px, between pixels by bilinear interpolation.
        let window = |image: &Image, [cx, cy]: [f64; 2]| -> Vec<f64> {
            let at = |x: f64, y: f64| {
                let (i, j) = (x.floor(), y.floor());
                let (u, v) = (x - i, y - j);
                let p = |dx: usize, dy: usize| f64::from(image.get(0, i as usize + dx, j as usize + dy));
                (1.0 - v) * ((1.0 - u) * p(0, 0) + u * p(1, 0)) + v * ((1.0 - u) * p(0, 1) + u * p(1, 1))
            };
            (0..441)
                .map(|k| at(cx + f64::from(k % 21) - 10.0, cy + f64::from(k / 21) - 10.0))
                .collect()
        };
        let (a, b) = (window(first.gray(), x), window(second.gray(), free.at));
        let mean = |v: &[f64]| v.iter().sum::<f64>() / 441.0;
        let (ma, mb) = (mean(&a), mean(&b));
        let product =
            |f: &dyn Fn(f64, f64) -> f64| a.iter().zip(&b).map(|(a, b)| f(a - ma, b - mb)).sum::<f64>();
        let ncc = product(&|a, b| a * b) / (product(&|a, _| a * a) * product(&|_, b| b * b)).sqrt();
        assert!((0.4..0.98).contains(&ncc), "{ncc}");
        for (least, status) in [
            (ncc - 1e-3, PointStatus::Tracked),
            (ncc + 1e-3, PointStatus::Unlike),
        ] {
            let found = track(least);
            assert_eq!((found.at, found.status), (free.at, status), "{least}");
        }
    }
}
