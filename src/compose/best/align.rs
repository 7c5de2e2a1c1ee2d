//! Efficient second-order minimisation of `Σ_b w_b Σ_i (T̂_i - Î_i)²` over a homography: in every block `b` of the
//! template (or, in even light, in all of them together), values are normalised to the same mean and contrast, whose
//! effect on the normal equations is projected out, so that light may change from place to place (Malis 2004; Evangelidis & Psarakis 2008 for the normalised residual).
//!
//! The correlation `z_b` of a block with the image tells how far to trust it: `w_b` is Tukey's weight of `√(1 - z_b)`
//! against the lower part of its distribution, so up to about two thirds of the object may be covered.

use super::view::{Base, IMAGE, ONES, TEMPLATE, View, WARP, columns, plane};
use crate::geom::solve::{SymMatrix, solve_negative};
use crate::geom::{Corners, Mat3, homography};
use crate::image::{Frame, Image};
use crate::kernels::{self, Border, Column, Covectors};

/// Smallest and largest gain that a block's contrast is met with.
const GAIN: (f64, f64) = (0.1, 10.0);
/// Cut of the weights: multiple of the lower three tenths of the misfits, least and most.
const CUT: (f64, f64, f64) = (2.5, 0.4, 1.3);
/// The first iterations, and their least cut: blocks that are not yet aligned must not lose their say.
const WIDE: (u32, f64) = (2, 0.9);
/// Correlation from which a block agrees.
const AGREES: f64 = 0.7;
/// Largest change of size since the first frame, octaves.
const ZOOM: f64 = 3.0;
/// Least depth of a corner, as a fraction of that of the object's middle.
const NEAREST: f64 = 0.03;
/// How many times as much of the template is left unexplained with one gain and bias where light is uneven.
const UNEVEN: f64 = 2.0;
/// Places along a side of the grid that tells how much is seen.
const GRID: usize = 6;
/// Levenberg-Marquardt damping.
const DAMPING: f64 = 1e-4;
/// Points from which all eight parameters are found, else six.
const PROJECTIVE: usize = 250;
/// Least points that poses are searched with, and what a pose at the border of the search must be better by.
const SEARCH: usize = 180;
const NEARER: f64 = 0.02;
/// Mean correlation of the best blocks below which nothing is there.
const NOTHING: f64 = 0.35;
/// Largest step, as a fraction of half the object's side.
const STEP: f64 = 1.2;

/// How well the template agrees with the image at a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Score {
    /// Sum of the cubed correlations of the textured blocks inside the image, negative ones as 0, per such block;
    /// blocks outside count for a third of one.
    pub total: f64,
    /// Mean correlation of the best two fifths of the blocks inside.
    pub best: f64,
    /// Share of all textured blocks that agree.
    pub agree: f64,
    /// Number of blocks that agree.
    pub agreeing: usize,
}

/// A block in the present image.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    correlation: f64,
    gain: f64,
    visible: bool,
    weight: f64,
}

/// Normal equations with what gain and bias of the image may be projected out.
#[derive(Clone, Copy, Debug, Default)]
struct Equations {
    h: [[f64; WARP]; WARP],
    g: [f64; WARP],
    /// Sum of the squared residuals.
    left: f64,
}

impl Equations {
    /// Adds those of points whose columns have the Gram matrix `m`.
    fn add(&mut self, m: &SymMatrix, weight: f64, order: usize) {
        let centred = |a: usize, b: usize| m.get(a, b) - m.get(a, ONES) * m.get(b, ONES) / m.get(ONES, ONES);
        let contrast = centred(IMAGE, IMAGE);
        if contrast <= 0.0 || contrast.is_nan() {
            return;
        }
        let along: [f64; TEMPLATE + 1] = std::array::from_fn(|a| centred(a, IMAGE));
        let freed = |a: usize, b: usize| weight * (centred(a, b) - along[a] * along[b] / contrast);
        for a in 0..order {
            for b in a..order {
                self.h[a][b] += freed(a, b);
            }
            self.g[a] += freed(a, TEMPLATE);
        }
        self.left += freed(TEMPLATE, TEMPLATE);
    }
}

/// The views of a template and what aligning them takes.
#[derive(Debug, Default)]
pub(super) struct Aligner {
    base: Base,
    /// Corners of the object in the base frame.
    quad: Corners,
    /// A coarse grid over it.
    grid: Vec<[f64; 2]>,
    /// Finest first, one per level.
    pub views: Vec<View>,
    columns: Option<[Column; WARP]>,
    px: Vec<f32>,
    py: Vec<f32>,
    gx: Vec<f32>,
    gy: Vec<f32>,
    value: Vec<f32>,
    moments: Vec<[f64; 3]>,
    seen: Vec<Seen>,
    sorted: Vec<f64>,
    misfits: Vec<f64>,
    gram: SymMatrix,
    sum: SymMatrix,
    system: SymMatrix,
}

impl Aligner {
    /// Learns the template; false when there is nothing to track.
    pub fn learn(&mut self, frame: &Frame, corners: &Corners, most: usize) -> bool {
        self.base = Base::of(corners);
        self.quad = Corners(corners.0.map(|c| self.base.from_image(c)));
        self.columns = Some(columns());
        let Some(square) = homography::from_corners(&Corners::rect(0.0, 0.0, 1.0, 1.0), &self.quad) else {
            return false;
        };
        let at = |k: usize| (k as f64 + 0.5) / GRID as f64;
        self.grid.clear();
        self.grid
            .extend((0..GRID * GRID).map(|k| homography::apply(&square, [at(k % GRID), at(k / GRID)])));
        let base = self.base;
        self.views.clear();
        let levels = 0..frame.levels();
        self.views
            .extend(levels.map_while(|level| View::new(frame, corners, &base, level, most)));
        let n = self.views.iter().map(View::len).max().unwrap_or(0);
        for buffer in [
            &mut self.px,
            &mut self.py,
            &mut self.gx,
            &mut self.gy,
            &mut self.value,
        ] {
            buffer.resize(n, 0.0);
        }
        self.gram = SymMatrix::new(WARP + 3);
        self.sum = SymMatrix::new(WARP + 3);
        self.views.iter().any(|v| v.blocks.iter().any(|b| b.textured))
    }

    /// Pose at which the object is at `corners`.
    pub fn pose_at(&self, corners: &Corners) -> Option<Mat3> {
        homography::from_corners(&self.quad, corners)
    }

    /// The object's corners at a pose, px.
    pub fn corners(&self, pose: &Mat3) -> Corners {
        homography::apply_corners(pose, &self.quad)
    }

    /// Place in the base frame of a place in the template's frame, px.
    pub fn to_base(&self, x: [f64; 2]) -> [f64; 2] {
        self.base.from_image(x)
    }

    /// Places of a coarse grid over the object, in the base frame, that a pose puts into the image.
    fn inside<'a>(&'a self, pose: &'a Mat3, frame: &'a Frame) -> impl Iterator<Item = [f64; 2]> + 'a {
        let (right, bottom) = ((frame.width() - 1) as f64, (frame.height() - 1) as f64);
        self.grid.iter().copied().filter(move |x| {
            let [u, v] = homography::apply(pose, *x);
            u >= 0.0 && v >= 0.0 && u <= right && v <= bottom
        })
    }

    /// Octaves by which what is seen of the object is larger than in the template; `None` when none of it is seen.
    fn zoom(&self, pose: &Mat3, frame: &Frame) -> Option<f64> {
        let determinant = pose.determinant();
        let (mut sum, mut n) = (0.0, 0.0);
        for x in self.inside(pose, frame) {
            // Area in the image per area of the base.
            let depth = pose[(2, 0)] * x[0] + pose[(2, 1)] * x[1] + pose[(2, 2)];
            sum += libm::log2(determinant / (depth * depth * depth));
            n += 1.0;
        }
        let zoom = sum / n / 2.0 - libm::log2(self.base.unit);
        zoom.is_finite().then_some(zoom)
    }

    /// Whether a pose shows the front of the object before the camera, some of it in the image, at a sensible size.
    pub fn sound(&self, pose: &Mat3, frame: &Frame) -> bool {
        let corners = self.corners(pose);
        let ahead =
            |c: &[f64; 2]| pose[(2, 0)] * c[0] + pose[(2, 1)] * c[1] + pose[(2, 2)] > NEAREST * pose[(2, 2)];
        corners.is_finite()
            && corners.is_convex()
            && corners.signed_area() * self.quad.signed_area() > 0.0
            && pose[(2, 2)] > 0.0
            && self.quad.0.iter().all(ahead)
            && self.zoom(pose, frame).is_some_and(|z| z.abs() < ZOOM)
    }

    /// How many octaves the object is larger than in the template, rounded.
    fn octaves(&self, pose: &Mat3, frame: &Frame) -> i32 {
        self.zoom(pose, frame).unwrap_or(0.0).round() as i32
    }

    /// View and level of the image for a level of the pyramid as a whole, the finest being 0.
    fn pair(&self, pose: &Mat3, frame: &Frame, k: usize) -> (usize, usize) {
        let octaves = self.octaves(pose, frame);
        let view = k + (-octaves).max(0) as usize;
        let level = k + octaves.max(0) as usize;
        (view.min(self.views.len() - 1), level.min(frame.levels() - 1))
    }

    /// The coarsest level for a pose.
    fn top(&self, pose: &Mat3, frame: &Frame) -> usize {
        (self.views.len() - 1).saturating_sub((-self.octaves(pose, frame)).max(0) as usize)
    }

    /// The level at which poses are judged: the coarsest with `points` points or more.
    fn judge(&self, pose: &Mat3, frame: &Frame, points: usize) -> usize {
        let enough = self.views.iter().rposition(|v| v.len() >= points).unwrap_or(0);
        enough
            .saturating_sub((-self.octaves(pose, frame)).max(0) as usize)
            .min(self.top(pose, frame))
    }

    /// Puts a view's points into the image at a level.
    fn place(&mut self, pose: &Mat3, view: usize, level: usize) -> ([f32; 9], [f32; 2], f32) {
        let unit = f64::from(1u32 << level);
        let centre = homography::apply(pose, [0.0; 2]).map(|v| (v / unit) as f32);
        let scale = ((pose.determinant() / pose[(2, 2)].powi(3)).sqrt() / unit) as f32;
        let (s, cx, cy) = (
            f64::from(scale) * unit,
            f64::from(centre[0]) * unit,
            f64::from(centre[1]) * unit,
        );
        let back = Mat3::new(1.0 / s, 0.0, -cx / s, 0.0, 1.0 / s, -cy / s, 0.0, 0.0, 1.0);
        let m = back * pose;
        let m = m / m[(2, 2)];
        let matrix: [f32; 9] = std::array::from_fn(|k| m[(k / 3, k % 3)] as f32);
        let v = &self.views[view];
        let n = v.len();
        kernels::warp_projective(
            &matrix,
            centre,
            scale,
            &v.x,
            &v.y,
            &mut self.px[..n],
            &mut self.py[..n],
        );
        (matrix, centre, scale)
    }

    /// Correlation, gain and visibility of each block, from the sampled values.
    fn look(&mut self, view: usize, image: &Image, outside: usize) {
        let v = &self.views[view];
        let n = v.len();
        self.moments.resize(v.blocks.len(), [0.0; 3]);
        kernels::block_moments(v.work.col(TEMPLATE), &self.value[..n], &v.ends, &mut self.moments);
        self.seen.clear();
        let mut first = 0;
        let (right, bottom) = ((image.width() - 1) as f32, (image.height() - 1) as f32);
        for ((block, m), &last) in v.blocks.iter().zip(&self.moments).zip(&v.ends) {
            let within = |i: usize| {
                self.px[i] >= 0.0 && self.px[i] <= right && self.py[i] >= 0.0 && self.py[i] <= bottom
            };
            let visible = outside == 0 || (first..last).all(within);
            first = last;
            let mean = m[0] / block.count;
            let deviation = (m[1] / block.count - mean * mean).max(0.0).sqrt();
            let covariance = m[2] / block.count - mean * block.mean;
            // Contrast below the noise of rounding is none.
            let flat = deviation < 0.05 || block.deviation < 0.05;
            self.seen.push(Seen {
                correlation: if flat {
                    0.0
                } else {
                    (covariance / (deviation * block.deviation)).clamp(-1.0, 1.0)
                },
                gain: (block.deviation / deviation.max(0.05)).clamp(GAIN.0, GAIN.1),
                visible,
                weight: 0.0,
            });
        }
    }

    /// The score of what was last looked at.
    fn score(&mut self, view: usize) -> Score {
        let blocks = &self.views[view].blocks;
        let (mut outside, mut sum) = (0.0, 0.0);
        self.sorted.clear();
        for (_, s) in blocks.iter().zip(&self.seen).filter(|p| p.0.textured) {
            if s.visible {
                let z = s.correlation.max(0.0);
                sum += z * z * z;
                self.sorted.push(z);
            } else {
                outside += 1.0;
            }
        }
        if self.sorted.is_empty() {
            return Score::default();
        }
        self.sorted.sort_unstable_by(|a, b| b.total_cmp(a));
        let inside = self.sorted.len();
        let part = (inside * 2).div_ceil(5);
        let agreeing = self.sorted.iter().filter(|z| **z >= AGREES).count();
        Score {
            total: sum / (inside as f64 + outside / 3.0),
            best: self.sorted[..part].iter().sum::<f64>() / part as f64,
            agree: agreeing as f64 / (inside as f64 + outside),
            agreeing,
        }
    }

    /// Score of a pose on `points` points or more.
    pub fn assess(&mut self, frame: &Frame, pose: &Mat3, points: usize) -> Score {
        if !self.sound(pose, frame) {
            return Score::default();
        }
        let (view, level) = self.pair(pose, frame, self.judge(pose, frame, points));
        let image = frame.level(level, 1).gray();
        self.place(pose, view, level);
        let n = self.views[view].len();
        let (px, py) = (&self.px[..n], &self.py[..n]);
        let outside = kernels::sample(plane(image), Border::Constant, px, py, &mut self.value[..n]);
        self.look(view, image, outside);
        self.score(view)
    }

    /// The pose shifted within `radius` px of the image so that it agrees best on a coarse level, in whole pixels of that
    /// level; and how well.
    pub fn search(&mut self, frame: &Frame, pose: &Mat3, radius: f64) -> Option<(Mat3, f64)> {
        if !self.sound(pose, frame) {
            return None;
        }
        let mut k = self.top(pose, frame);
        while k > 0 && self.views[self.pair(pose, frame, k).0].len() < SEARCH {
            k -= 1;
        }
        let (view, level) = self.pair(pose, frame, k);
        let image = frame.level(level, 1).gray();
        let unit = f64::from(1u32 << level);
        self.place(pose, view, level);
        let n = self.views[view].len();
        let reach = (radius / unit).ceil() as i32;
        let (mut best, mut at) = (f64::NEG_INFINITY, [0, 0]);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                // Row by row from the upper left: each position is one pixel from the one before or at the next row's start.
                let step = match (dx == -reach, dy == -reach) {
                    (true, true) => [-reach as f32, -reach as f32],
                    (true, false) => [-2.0 * reach as f32, 1.0],
                    _ => [1.0, 0.0],
                };
                self.px[..n].iter_mut().for_each(|v| *v += step[0]);
                self.py[..n].iter_mut().for_each(|v| *v += step[1]);
                let (px, py) = (&self.px[..n], &self.py[..n]);
                let outside = kernels::sample(plane(image), Border::Constant, px, py, &mut self.value[..n]);
                self.look(view, image, outside);
                let far = f64::from(dx * dx + dy * dy).sqrt() / f64::from(reach.max(1));
                let total = self.score(view).total - NEARER * far;
                if total > best {
                    (best, at) = (total, [dx, dy]);
                }
            }
        }
        let [dx, dy] = at.map(|v| f64::from(v) * unit);
        let shift = Mat3::new(1.0, 0.0, dx, 0.0, 1.0, dy, 0.0, 0.0, 1.0);
        Some((shift * pose, best))
    }

    /// Blocks of the last assessed pose that agree: their centres in the base frame.
    pub fn agreeing(&self, frame: &Frame, pose: &Mat3, points: usize) -> impl Iterator<Item = [f64; 2]> + '_ {
        let (view, _) = self.pair(pose, frame, self.judge(pose, frame, points));
        let blocks = self.views[view].blocks.iter().zip(&self.seen);
        blocks
            .filter(|(b, s)| b.textured && s.visible && s.correlation >= AGREES)
            .map(|(b, _)| b.centre)
    }

    /// Weighs the blocks with a cut of at least `least`; what blocks beside it say counts for a third of a block's misfit,
    /// for what covers an object is connected.
    fn weigh(&mut self, view: usize, least: f64) {
        let view = &self.views[view];
        let counts = |k: usize| view.blocks[k].textured && self.seen[k].visible;
        self.misfits.clear();
        for (k, s) in self.seen.iter().enumerate() {
            let own = (1.0 - s.correlation).sqrt();
            let (mut sum, mut n) = (0.0, 0.0);
            for &b in view.beside(k).iter().filter(|b| counts(**b)) {
                sum += (1.0 - self.seen[b].correlation).sqrt();
                n += 1.0;
            }
            let around = if n > 0.0 { sum / n } else { own };
            self.misfits.push((2.0 * own + around.max(own)) / 3.0);
        }
        self.sorted.clear();
        let counted = (0..self.seen.len()).filter(|k| counts(*k));
        self.sorted.extend(counted.map(|k| self.misfits[k]));
        if self.sorted.is_empty() {
            return;
        }
        let rank = self.sorted.len() * 3 / 10;
        let low = *self.sorted.select_nth_unstable_by(rank, f64::total_cmp).1;
        let cut = (CUT.0 * low).clamp(least, CUT.2);
        for ((b, s), misfit) in view.blocks.iter().zip(&mut self.seen).zip(&self.misfits) {
            let t = 1.0 - (misfit / cut).powi(2);
            s.weight = if b.textured && s.visible && t > 0.0 {
                t * t
            } else {
                0.0
            };
        }
    }

    /// Improves a pose at one level by at most `iterations` steps; how many it took, or `None` when it fails.
    fn refine(
        &mut self,
        frame: &Frame,
        pose: &mut Mat3,
        k: usize,
        iterations: u32,
        epsilon: f64,
    ) -> Option<u32> {
        let (view, level) = self.pair(pose, frame, k);
        let image = frame.level(level, 1).gray();
        let unit = f64::from(1u32 << level);
        let columns = self.columns?;
        for iteration in 1..=iterations {
            let (matrix, centre, scale) = self.place(pose, view, level);
            let n = self.views[view].len();
            let outside = kernels::sample_gradient(
                plane(image),
                Border::Constant,
                &self.px[..n],
                &self.py[..n],
                &mut self.value[..n],
                &mut self.gx[..n],
                &mut self.gy[..n],
            );
            self.look(view, image, outside);
            self.weigh(view, if iteration <= WIDE.0 { WIDE.1 } else { CUT.1 });
            let v = &mut self.views[view];
            let mut first = 0;
            for (s, &last) in self.seen.iter().zip(&v.ends) {
                let gain = s.gain as f32;
                for g in self.gx[first..last].iter_mut().chain(&mut self.gy[first..last]) {
                    *g *= gain;
                }
                first = last;
            }
            let covectors = Covectors {
                gx: &self.gx[..n],
                gy: &self.gy[..n],
                px: &self.px[..n],
                py: &self.py[..n],
                centre,
                scale,
                matrix,
                denominator: Some([matrix[6], matrix[7], matrix[8]]),
            };
            kernels::steepest(&v.x, &v.y, &covectors, &columns, 0, &mut v.work);
            for k in 0..WARP {
                for (a, b) in v.work.col_mut(k).iter_mut().zip(v.own.col(k)) {
                    *a = 0.5 * (*a + b);
                }
            }
            v.work.col_mut(IMAGE).copy_from_slice(&self.value[..n]);
            let order = if n < PROJECTIVE { 6 } else { WARP };
            let step = self.step(view, order)?;
            let p = Mat3::new(
                step[0], step[1], step[2], step[3], step[4], step[5], step[6], step[7], 0.0,
            );
            let next = *pose * (Mat3::identity() + p + p * p * 0.5);
            let next = next / next[(2, 2)];
            if !self.sound(&next, frame) {
                return None;
            }
            // How far what is seen moves.
            let (mut sum, mut n) = (0.0, 0.0);
            for x in self.inside(pose, frame) {
                let (a, b) = (homography::apply(pose, x), homography::apply(&next, x));
                sum += (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
                n += 1.0;
            }
            let moved = (sum / n).sqrt();
            if !(moved < STEP * self.base.unit * libm::exp2(self.zoom(pose, frame)?)) {
                return None;
            }
            *pose = next;
            if moved < epsilon * unit {
                return Some(iteration);
            }
        }
        Some(iterations)
    }

    /// The Gauss-Newton step of the weighted blocks in the first `order` parameters. One gain and bias serve all blocks,
    /// which keeps what tells blocks apart, unless the light calls for one of each block.
    fn step(&mut self, view: usize, order: usize) -> Option<[f64; WARP]> {
        let v = &self.views[view];
        let mut each = Equations::default();
        self.sum.scale(0.0);
        let mut first = 0;
        for (s, &last) in self.seen.iter().zip(&v.ends) {
            let rows = (first, last);
            first = last;
            if s.weight > 0.0 {
                kernels::block_gram(&v.work, rows.0, rows.1, &mut self.gram);
                each.add(&self.gram, s.weight, order);
                self.sum.blend(1.0, s.weight, &self.gram);
            }
        }
        let mut one = Equations::default();
        one.add(&self.sum, 1.0, order);
        let used = if one.left < UNEVEN * each.left {
            &one
        } else {
            &each
        };
        if self.system.order() != order {
            self.system = SymMatrix::new(order);
        }
        self.system.fill(|a, b| -used.h[a][b]);
        let (mut x, mut work) = ([0.0; WARP], [0.0; WARP * WARP + WARP]);
        let g = used.g.map(|v| -v);
        solve_negative(&self.system, DAMPING, &g[..order], &mut x[..order], &mut work).then_some(x)
    }

    /// Aligns from a pose, coarse to fine; the pose and its score, and iterations.
    pub fn align(&mut self, frame: &Frame, start: &Mat3, points: usize) -> Option<(Mat3, Score, u32)> {
        if !self.sound(start, frame) {
            return None;
        }
        let mut pose = *start;
        let mut iterations = 0;
        let judge = self.judge(&pose, frame, points);
        let first = self.assess(frame, start, points);
        let mut score = first;
        for k in (judge..=self.top(&pose, frame)).rev() {
            let mut next = pose;
            let Some(n) = self.refine(frame, &mut next, k, 10, 0.03) else {
                continue;
            };
            (pose, iterations) = (next, iterations + n);
            // Coarse levels, with their few blocks, can do harm when much is covered.
            if k <= judge + 1 {
                score = self.assess(frame, &pose, points);
                if score.total < first.total {
                    (pose, score) = (*start, first);
                }
            }
        }
        if score.best < NOTHING {
            return Some((pose, score, iterations));
        }
        for k in (0..self.judge(&pose, frame, points)).rev() {
            let mut finer = pose;
            let Some(n) = self.refine(frame, &mut finer, k, 8, if k == 0 { 0.01 } else { 0.03 }) else {
                break;
            };
            iterations += n;
            let now = self.assess(frame, &finer, points);
            // Where motion blurs the image, there may be nothing to see at finer levels.
            if now.total < score.total - 0.03 {
                break;
            }
            (pose, score) = (finer, now);
        }
        Some((pose, score, iterations))
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        self.views.iter().map(View::memory).sum::<usize>() + 20 * self.px.capacity()
    }
}
