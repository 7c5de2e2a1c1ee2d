//! Efficient second-order minimisation of `Σ_b w_b Σ_i (T̂_i - Î_i)²` over a homography, coarse to fine: in every block
//! `b` of the template (or, in even light, in all of them together), values are normalised to the same mean and contrast,
//! whose effect on the normal equations is projected out, so that light may change from place to place (Malis 2004;
//! Evangelidis & Psarakis 2008 for the normalised residual).
//!
//! The correlation `z_b` of a block with the image tells how far to trust it: `w_b` is Tukey's weight of `√(1 - z_b)`
//! against the lower part of its distribution, so up to about two thirds of the object may be covered.

mod score;
mod step;

pub(super) use score::Score;

use super::constants::K;
use super::smear::Smear;
use super::view::{Base, View, WARP, columns};
use crate::geom::solve::SymMatrix;
use crate::geom::{Corners, Mat3, homography};
use crate::image::Frame;
use crate::kernels::{self, Column};
use score::Seen;

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
    /// Motion blur of the views.
    pub smear: Smear,
    columns: Option<[Column; WARP]>,
    /// Inverse of the pose that the alignment started from.
    anchor: Mat3,
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
        self.quad = Corners(corners.0.map(|c| self.base.of_image(c)));
        self.columns = Some(columns());
        let Some(square) = homography::from_corners(&Corners::rect(0.0, 0.0, 1.0, 1.0), &self.quad) else {
            return false;
        };
        let at = |k: usize| (k as f64 + 0.5) / K.sight_grid as f64;
        self.grid.clear();
        self.grid.extend(
            (0..K.sight_grid * K.sight_grid)
                .map(|k| homography::apply(&square, [at(k % K.sight_grid), at(k / K.sight_grid)])),
        );
        let base = self.base;
        self.views.clear();
        let levels = 0..frame.levels();
        self.views
            .extend(levels.map_while(|level| View::new(frame, corners, &base, level, most)));
        self.smear.learn(frame, &self.views);
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

    /// Pose at which the object is as in the template, in the middle of the image.
    pub fn upright(&self, frame: &Frame) -> Mat3 {
        let (x, y) = (frame.width() as f64 / 2.0, frame.height() as f64 / 2.0);
        let unit = self.base.unit;
        Mat3::new(unit, 0.0, x, 0.0, unit, y, 0.0, 0.0, 1.0)
    }

    /// The object's corners at a pose, px.
    pub fn corners(&self, pose: &Mat3) -> Corners {
        homography::apply_corners(pose, &self.quad)
    }

    /// Place in the base frame of a place in the template's frame, px.
    pub fn to_base(&self, x: [f64; 2]) -> [f64; 2] {
        self.base.of_image(x)
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
        let ahead = |c: &[f64; 2]| Self::depth(pose, *c) > K.nearest_depth;
        corners.is_finite()
            && corners.is_convex()
            && corners.signed_area() * self.quad.signed_area() > 0.0
            && pose[(2, 2)] > 0.0
            && self.quad.0.iter().all(ahead)
            && Self::stretch(pose) < K.stretch_limit
            && self.zoom(pose, frame).is_some_and(|z| z.abs() < K.zoom_limit)
    }

    /// Whether a sound pose is an ordinary one, which the object may be found at out of nothing.
    pub fn ordinary(&self, pose: &Mat3) -> bool {
        self.quad
            .0
            .iter()
            .all(|c| Self::depth(pose, *c) > K.ordinary_depth)
            && Self::stretch(pose) < K.ordinary_stretch
    }

    /// Depth of a place, as a fraction of that of the object's middle.
    fn depth(pose: &Mat3, [x, y]: [f64; 2]) -> f64 {
        (pose[(2, 0)] * x + pose[(2, 1)] * y) / pose[(2, 2)] + 1.0
    }

    /// Ratio of the largest to the smallest magnification in the middle of the object.
    fn stretch(pose: &Mat3) -> f64 {
        let [x, y] = homography::apply(pose, [0.0; 2]);
        let entry = |r: usize, c: usize, v: f64| (pose[(r, c)] - v * pose[(2, c)]) / pose[(2, 2)];
        let (a, b, c, d) = (entry(0, 0, x), entry(0, 1, x), entry(1, 0, y), entry(1, 1, y));
        let (sum, product) = (a * a + b * b + c * c + d * d, (a * d - b * c).abs());
        // Singular values s, t: s² + t² and s t.
        let root = (sum * sum - 4.0 * product * product).max(0.0).sqrt();
        (sum + root) / (2.0 * product)
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

    /// Blurs a view as the motion to a pose does.
    fn expose(&mut self, pose: &Mat3, view: usize) {
        self.smear.apply(&mut self.views[view], view, &self.base, pose);
    }

    /// How far the object has moved since the frame before, px of the template's frame.
    pub fn way(&self, pose: &Mat3) -> f64 {
        self.smear.way(&self.base, pose)
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

    /// Aligns from a pose, coarse to fine; the pose and its score, and iterations.
    pub fn align(&mut self, frame: &Frame, start: &Mat3, points: usize) -> Option<(Mat3, Score, u32)> {
        let (mut pose, mut score, mut iterations) = self.coarse(frame, start, points, K.coarse_steps)?;
        if score.best >= K.nothing_best {
            self.fine(frame, (&mut pose, &mut score, &mut iterations), points);
        }
        Some((pose, score, iterations))
    }

    /// Aligns from a pose at the coarse levels, down to that at which poses are judged, by at most `most` steps at each.
    pub fn coarse(
        &mut self,
        frame: &Frame,
        start: &Mat3,
        points: usize,
        most: u32,
    ) -> Option<(Mat3, Score, u32)> {
        if !self.sound(start, frame) {
            return None;
        }
        self.anchor = start.try_inverse()?;
        let mut pose = *start;
        let mut iterations = 0;
        let judge = self.judge(&pose, frame, points);
        let first = self.assess(frame, start, points);
        let mut score = first;
        for k in (judge..=self.top(&pose, frame)).rev() {
            let mut next = pose;
            let Some(n) = self.refine(frame, &mut next, k, most, K.coarse_epsilon) else {
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
        Some((pose, score, iterations))
    }

    /// Aligns further, at the fine levels.
    pub fn fine(
        &mut self,
        frame: &Frame,
        (pose, score, iterations): (&mut Mat3, &mut Score, &mut u32),
        points: usize,
    ) {
        for k in (0..self.judge(pose, frame, points)).rev() {
            let mut finer = *pose;
            let epsilon = if k == 0 {
                K.finest_epsilon
            } else {
                K.coarse_epsilon
            };
            let Some(n) = self.refine(frame, &mut finer, k, K.fine_steps, epsilon) else {
                break;
            };
            *iterations += n;
            let now = self.assess(frame, &finer, points);
            // Where motion blurs the image, there may be nothing to see at finer levels.
            if now.total < score.total - K.finer_loss {
                break;
            }
            (*pose, *score) = (finer, now);
        }
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        self.views.iter().map(View::memory).sum::<usize>() + self.smear.memory() + 20 * self.px.capacity()
    }
}
