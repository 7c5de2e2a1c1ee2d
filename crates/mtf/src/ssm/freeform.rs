//! Non-rigid warps: every point follows a weighted sum of the displacements of control points,
//! `w(x; p) = x + Σ_j W_j(x) d_j`, `p = (d_0x, d_0y, d_1x, ...)`, S twice the number of control points.
//!
//! The warp is linear in `p`, so `w_p` is the same at every state and additive methods are exact. Two such warps do not
//! compose within the family, and it has no inverses: compositional methods are refused. `w_x = Id + Σ_j d_j ∇W_j` is
//! exact, and with it the Jacobian of the inverse additive method. Where the image shows nothing, control points are held
//! by a penalty on the bending of their net (second differences of what `d` is beyond the motion of a plane), as far as
//! the frame before did not show it already.

use super::frame::BaseFrame;
use super::{
    Estimable, Gradient, ImageHessian, Increment, JacobianKind, NonRigid, Points, Reference, SecondOrder,
    SsmCapabilities, StateSpaceModel,
};
use crate::consensus::{Estimator, Homographies};
use crate::entry::Part;
use crate::geom::fit::Moments;
use crate::geom::solve::{SymMatrix, solve_negative};
use crate::geom::{Corners, Mat3, homography};
use crate::kernels::{self, Jacobian};
use crate::params::{Params, Resolution};
use crate::tracker::TrackError;
use nalgebra::Matrix2;
use std::cell::RefCell;

/// Weight of one control point at a place, and its derivatives there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Weight {
    /// `W_j(x)`.
    pub w: f64,
    /// `∂W_j/∂x`.
    pub dx: f64,
    /// `∂W_j/∂y`.
    pub dy: f64,
}

/// The weights of a family of non-rigid warps.
pub trait Basis: Clone + Default + Send + 'static {
    /// Its parameters.
    type Params: Params;
    /// Name.
    const NAME: &'static str;
    /// Other names.
    const ALIASES: &'static [&'static str];
    /// One line for `list ssm`.
    const SUMMARY: &'static str;

    /// Builds it.
    fn new(params: Self::Params) -> Self;
    /// Places the control points for a frame with a grid.
    fn place(&mut self, frame: &BaseFrame) -> Result<(), TrackError>;
    /// Control points per row, and rows.
    fn net(&self) -> Resolution;
    /// Control points in the base frame, row by row.
    fn control(&self) -> &[[f64; 2]];
    /// Weights of all control points at a place of the base frame.
    fn weights_into(&self, x: [f64; 2], out: &mut [Weight]);
    /// How bending is held back.
    fn penalty(&self) -> BendPenalty;
}

/// Penalty on unexpected bending of the net from one frame to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BendPenalty {
    /// Weight relative to the mean diagonal of the data's normal equations.
    pub weight: f64,
    /// Fraction of a frame's bend that is expected in the next one.
    pub memory: f64,
}

/// Weights of one control point on the stretch of the grid where they are not zero.
#[derive(Clone, Debug)]
struct Stretch {
    start: usize,
    w: Vec<f32>,
    dx: Vec<f32>,
    dy: Vec<f32>,
}

impl Stretch {
    fn new(all: &[Weight]) -> Self {
        let used = |v: &Weight| *v != Weight::default();
        let start = all.iter().position(used).unwrap_or(0);
        let end = all.iter().rposition(used).map_or(start, |e| e + 1);
        let column = |f: fn(&Weight) -> f64| all[start..end].iter().map(|v| f(v) as f32).collect();
        Stretch {
            start,
            w: column(|v| v.w),
            dx: column(|v| v.dx),
            dy: column(|v| v.dy),
        }
    }
    fn range(&self) -> std::ops::Range<usize> {
        self.start..self.start + self.w.len()
    }
}

/// A non-rigid warp with its base frame and state.
#[derive(Clone, Debug, Default)]
pub struct FreeForm<B> {
    basis: B,
    frame: BaseFrame,
    p: Vec<f64>,
    /// Scratch of a step.
    next: Vec<f64>,
    stretches: Vec<Stretch>,
    /// Weights at the four corners.
    at_corners: [Vec<f64>; 4],
    /// Bending energy `dᵀ R d` of one coordinate of the net.
    bending: SymMatrix,
    /// `w_x` (four numbers per point) and gradients carried through it.
    scratch: RefCell<[Vec<f32>; 6]>,
    fit: RefCell<FitScratch>,
    /// Warped control points, and what of their displacement is beyond the motion of a plane.
    bend: RefCell<(Vec<[f64; 2]>, Vec<[f64; 2]>)>,
    /// The latter as expected for the present frame.
    expected: RefCell<Vec<[f64; 2]>>,
}

/// Scratch of fits to point pairs.
#[derive(Clone, Debug, Default)]
struct FitScratch {
    pairs: Vec<([f64; 2], [f64; 2])>,
    from: Vec<[f64; 2]>,
    to: Vec<[f64; 2]>,
    h: SymMatrix,
    rhs: [Vec<f64>; 2],
    row: Vec<Weight>,
    d: Vec<f64>,
    work: Vec<f64>,
}

/// Sums of squared second differences of a net: along rows, along columns, and twice the mixed ones.
fn bending_energy(net: Resolution) -> SymMatrix {
    let n = net.len();
    let mut r = SymMatrix::new(n);
    let mut add = |terms: &[(usize, usize, f64)], weight: f64| {
        for (i, &(ra, ca, a)) in terms.iter().enumerate() {
            for &(rb, cb, b) in &terms[i..] {
                let (k, l) = (ra * net.cols + ca, rb * net.cols + cb);
                r.set(k, l, r.get(k, l) + weight * a * b);
            }
        }
    };
    for row in 0..net.rows {
        for col in 0..net.cols {
            if col + 2 < net.cols {
                add(&[(row, col, 1.0), (row, col + 1, -2.0), (row, col + 2, 1.0)], 1.0);
            }
            if row + 2 < net.rows {
                add(&[(row, col, 1.0), (row + 1, col, -2.0), (row + 2, col, 1.0)], 1.0);
            }
            if col + 1 < net.cols && row + 1 < net.rows {
                let corners = [
                    (row, col, 1.0),
                    (row, col + 1, -1.0),
                    (row + 1, col, -1.0),
                    (row + 1, col + 1, 1.0),
                ];
                add(&corners, 2.0);
            }
        }
    }
    r
}

fn mean_diagonal(h: &SymMatrix) -> f64 {
    (0..h.order()).map(|k| h.get(k, k).abs()).sum::<f64>() / h.order().max(1) as f64
}

/// Rounds of a robust fit, and the distance of an inlier in standard deviations of its error.
const ROUNDS: usize = 3;
const INLIER: f64 = 3.0;
/// Weight of the bending penalty in fits to point pairs.
const FIT_PENALTY: f64 = 1e-3;
const NO_FIT: TrackError = TrackError::BadRegion("points do not determine a state");

impl<B: Basis> FreeForm<B> {
    /// With default parameters.
    pub fn new() -> Self {
        Self::default()
    }

    /// The weights.
    pub fn basis(&self) -> &B {
        &self.basis
    }

    fn start(&mut self) -> Result<(), TrackError> {
        self.basis.place(&self.frame)?;
        let n = self.basis.control().len();
        let points = self.frame.x.len();
        let mut all = vec![Vec::with_capacity(points); n];
        let mut row = vec![Weight::default(); n];
        for i in 0..points {
            self.basis.weights_into(self.frame.grid_point(i), &mut row);
            all.iter_mut().zip(&row).for_each(|(c, w)| c.push(*w));
        }
        self.stretches = all.iter().map(|c| Stretch::new(c)).collect();
        self.at_corners = self.frame.corners.0.map(|c| {
            self.basis.weights_into(c, &mut row);
            row.iter().map(|v| v.w).collect()
        });
        self.bending = bending_energy(self.basis.net());
        self.scratch
            .borrow_mut()
            .iter_mut()
            .for_each(|s| s.resize(points, 0.0));
        self.p = vec![0.0; 2 * n];
        self.next = Vec::with_capacity(2 * n);
        self.expected.replace(vec![[0.0; 2]; n]);
        Ok(())
    }

    /// Corners in the base frame for a state.
    fn warped_corners(&self, p: &[f64]) -> Corners {
        Corners(std::array::from_fn(|i| {
            let mut c = self.frame.corners.0[i];
            for (d, w) in p.chunks_exact(2).zip(&self.at_corners[i]) {
                c[0] += w * d[0];
                c[1] += w * d[1];
            }
            c
        }))
    }

    fn check(&self, p: &[f64]) -> Result<(), TrackError> {
        if p.iter().any(|v| !v.is_finite()) {
            return Err(TrackError::NotFinite("state"));
        }
        self.frame.check(&self.warped_corners(p))?;
        let net = self.basis.net();
        let at = |r: usize, c: usize| {
            let k = r * net.cols + c;
            let [x, y] = self.basis.control()[k];
            [x + p[2 * k], y + p[2 * k + 1]]
        };
        let orientation = self.frame.corners.signed_area();
        for r in 0..net.rows - 1 {
            for c in 0..net.cols - 1 {
                let cell = Corners([at(r, c), at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)]);
                if cell.signed_area() * orientation <= 0.0 {
                    return Err(TrackError::Degenerate("the control net folds over itself"));
                }
            }
        }
        Ok(())
    }

    /// Image in the base frame of any place of it.
    fn warp(&self, p: &[f64], x: [f64; 2], row: &mut [Weight]) -> [f64; 2] {
        self.basis.weights_into(x, row);
        p.chunks_exact(2)
            .zip(row)
            .fold(x, |u, (d, w)| [u[0] + w.w * d[0], u[1] + w.w * d[1]])
    }

    /// Displacements of the control points under a motion of the plane.
    fn carried(&self, m: &Mat3) -> impl Iterator<Item = [f64; 2]> {
        self.basis.control().iter().map(move |&c| {
            let u = homography::apply(m, c);
            [u[0] - c[0], u[1] - c[1]]
        })
    }

    /// Penalised least squares over pairs of the base frame that `keep` lets through, around a motion of the plane.
    fn solve(
        &self,
        plane: &Mat3,
        pairs: &[([f64; 2], [f64; 2])],
        keep: impl Fn(usize) -> bool,
        p: &mut [f64],
    ) -> Result<(), TrackError> {
        let n = self.basis.control().len();
        let FitScratch {
            h, rhs, row, d, work, ..
        } = &mut *self.fit.borrow_mut();
        h.reset(n);
        for values in rhs.iter_mut().chain([&mut *d]) {
            values.clear();
            values.resize(n, 0.0);
        }
        row.resize(n, Weight::default());
        work.resize(n * n + n, 0.0);
        for (d, p) in self.carried(plane).zip(p.chunks_exact_mut(2)) {
            p.copy_from_slice(&d);
        }
        for (_, (x, u)) in pairs.iter().enumerate().filter(|(i, _)| keep(*i)) {
            let w = self.warp(p, *x, row);
            h.fill_from(|k, l, sum| sum - row[k].w * row[l].w);
            for c in 0..2 {
                let r = u[c] - w[c];
                rhs[c].iter_mut().zip(&*row).for_each(|(b, w)| *b -= w.w * r);
            }
        }
        let diagonal = mean_diagonal(h);
        if diagonal <= 0.0 {
            return Err(NO_FIT);
        }
        // A trace of a pull towards the plane's motion settles what neither data nor bending do.
        let pull = diagonal * 1e-9;
        let bending = FIT_PENALTY * diagonal;
        h.fill_from(|k, l, v| v - bending * self.bending.get(k, l) - if k == l { pull } else { 0.0 });
        for c in 0..2 {
            if !solve_negative(h, 0.0, &rhs[c], d, work) {
                return Err(NO_FIT);
            }
            p.iter_mut()
                .skip(c)
                .step_by(2)
                .zip(&*d)
                .for_each(|(p, d)| *p += d);
        }
        Ok(())
    }

    fn pairs(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
        let frame = &self.frame;
        from.iter()
            .zip(to)
            .map(|(a, b)| (frame.point_to_frame(*a), frame.point_to_frame(*b)))
    }

    /// Computes what the control points do beyond the motion of the plane that fits them best.
    fn update_bend(&self) {
        let (moved, bend) = &mut *self.bend.borrow_mut();
        let control = self.basis.control();
        moved.clear();
        let at = control.iter().zip(self.p.chunks_exact(2));
        moved.extend(at.map(|(c, d)| [c[0] + d[0], c[1] + d[1]]));
        let plane = homography::from_points(control, moved).unwrap_or_else(Mat3::identity);
        bend.clear();
        bend.extend(control.iter().zip(moved.iter()).map(|(c, u)| {
            let on_plane = homography::apply(&plane, *c);
            [u[0] - on_plane[0], u[1] - on_plane[1]]
        }));
    }

    /// `w_x` of every point into the scratch.
    fn spatial(&self, w: &mut [Vec<f32>; 6]) {
        for (k, w) in w.iter_mut().take(4).enumerate() {
            w.fill(if k == 0 || k == 3 { 1.0 } else { 0.0 });
        }
        for (s, d) in self.stretches.iter().zip(self.p.chunks_exact(2)) {
            for (c, d) in d.iter().enumerate() {
                kernels::accumulate(&s.dx, *d as f32, &mut w[2 * c][s.range()]);
                kernels::accumulate(&s.dy, *d as f32, &mut w[2 * c + 1][s.range()]);
            }
        }
    }
}

impl<B: Basis> StateSpaceModel for FreeForm<B> {
    fn dof(&self) -> usize {
        self.p.len()
    }

    fn base(&self) -> &BaseFrame {
        &self.frame
    }

    fn capabilities(&self) -> SsmCapabilities {
        SsmCapabilities {
            compositional: false,
            invertible: false,
            group: false,
            min_points: 4,
        }
    }

    fn init(&mut self, corners: &Corners, res: Resolution) -> Result<(), TrackError> {
        self.frame.set(corners, res)?;
        self.start()
    }

    fn state(&self) -> &[f64] {
        &self.p
    }

    fn set_state(&mut self, p: &[f64]) -> Result<(), TrackError> {
        self.check(p)?;
        self.p.copy_from_slice(p);
        Ok(())
    }

    fn update(&mut self, how: Increment, delta: &[f64]) -> Result<(), TrackError> {
        if how != Increment::Additive {
            return Err(TrackError::Degenerate("the warp does not compose"));
        }
        let mut next = std::mem::take(&mut self.next);
        next.clear();
        next.extend(self.p.iter().zip(delta).map(|(p, d)| p + d));
        let sound = self.check(&next);
        if sound.is_ok() {
            self.p.copy_from_slice(&next);
        }
        self.next = next;
        sound
    }

    fn corners_at(&self, p: &[f64]) -> Corners {
        self.frame.to_image(&self.warped_corners(p))
    }

    /// The net moves as the plane through the corners does, and keeps its bend.
    fn fit_corners(&mut self, corners: &Corners) -> Result<f64, TrackError> {
        let target = self.frame.to_frame(corners);
        let m = homography::from_corners(&self.warped_corners(&self.p), &target)
            .ok_or(TrackError::BadRegion("corners do not determine a state"))?;
        let mut p = self.p.clone();
        for (c, d) in self.basis.control().iter().zip(p.chunks_exact_mut(2)) {
            let u = homography::apply(&m, [c[0] + d[0], c[1] + d[1]]);
            d.copy_from_slice(&[u[0] - c[0], u[1] - c[1]]);
        }
        self.set_state(&p)?;
        Ok((self.corners().distance_squared(corners) / 4.0).sqrt())
    }

    fn fit_into(&self, from: &[[f64; 2]], to: &[[f64; 2]], p: &mut [f64]) -> Result<(), TrackError> {
        let mut scratch = self.fit.take();
        let FitScratch {
            pairs,
            from: a,
            to: b,
            ..
        } = &mut scratch;
        pairs.clear();
        pairs.extend(self.pairs(from, to));
        a.clear();
        a.extend(pairs.iter().map(|pair| pair.0));
        b.clear();
        b.extend(pairs.iter().map(|pair| pair.1));
        let plane = homography::from_points(a, b).or_else(|| Moments::new(a, b)?.affine());
        let pairs = std::mem::take(pairs);
        self.fit.replace(scratch);
        let solved = plane
            .ok_or(NO_FIT)
            .and_then(|plane| self.solve(&plane, &pairs, |_| true, p));
        self.fit.borrow_mut().pairs = pairs;
        solved
    }

    fn relative_into(&self, p: &[f64], q: &[f64], out: &mut [f64]) -> Result<(), TrackError> {
        for ((out, p), q) in out.iter_mut().zip(p).zip(q) {
            *out = q - p;
        }
        Ok(())
    }

    fn rebase(&mut self, corners: &Corners) -> Result<Mat3, TrackError> {
        let (frame, carry) = self.frame.rebased(corners)?;
        self.frame = frame;
        self.start()?;
        Ok(carry)
    }

    fn warp_into(&self, x: &mut [f32], y: &mut [f32]) {
        let f = &self.frame;
        for (c, (out, base)) in [(x, &f.x), (y, &f.y)].into_iter().enumerate() {
            out.copy_from_slice(base);
            for (s, d) in self.stretches.iter().zip(self.p.chunks_exact(2)) {
                kernels::accumulate(&s.w, d[c] as f32, &mut out[s.range()]);
            }
            kernels::scale_shift(f.radius as f32, f.centre[c] as f32, out);
        }
    }

    fn jacobian_into(
        &self,
        kind: JacobianKind,
        gradient: Gradient<'_>,
        _: Points<'_>,
        row: usize,
        j: &mut Jacobian,
    ) {
        let n = self.frame.x.len();
        let r = if kind.of_template() {
            1.0
        } else {
            self.frame.radius as f32
        };
        let mut scratch = self.scratch.borrow_mut();
        let carried = matches!(kind, JacobianKind::Warped | JacobianKind::Approximate);
        if carried {
            self.spatial(&mut scratch);
            let [a, b, c, d, x, y] = &mut *scratch;
            let inverse = kind == JacobianKind::Approximate;
            kernels::row_times(gradient.x, gradient.y, [a, b, c, d], inverse, 1.0, x, y);
        }
        let g = if carried {
            [&scratch[4][..], &scratch[5][..]]
        } else {
            [gradient.x, gradient.y]
        };
        for (k, s) in self.stretches.iter().enumerate() {
            for (c, g) in g.iter().enumerate() {
                let column = &mut j.col_mut(2 * k + c)[row..row + n];
                let at = s.range();
                column[..at.start].fill(0.0);
                column[at.end..].fill(0.0);
                kernels::product(&g[at.clone()], &s.w, r, &mut column[at]);
            }
        }
    }

    fn memory(&self) -> usize {
        let stretches: usize = self.stretches.iter().map(|s| 12 * s.w.len()).sum();
        let scratch: usize = self.scratch.borrow().iter().map(|s| 4 * s.capacity()).sum();
        self.frame.memory() + stretches + scratch + 8 * self.bending.order() * self.bending.order()
    }

    fn estimable(&mut self) -> Option<&mut dyn Estimable> {
        Some(self)
    }

    fn non_rigid(&self) -> Option<&dyn NonRigid> {
        Some(self)
    }

    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }

    fn second_order(&self) -> Option<&dyn SecondOrder> {
        Some(self)
    }
}

impl<B: Basis> Estimable for FreeForm<B> {
    /// Outliers are those of a plane at first (three times the threshold, for the bend), then those of the warp itself.
    fn estimate(
        &mut self,
        estimator: &mut Estimator,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
    ) -> Result<(), TrackError> {
        let thresh = estimator.params.est_thresh;
        estimator.params.est_thresh = 3.0 * thresh;
        // Non-rigid fits start from the motion of the plane.
        let plane = estimator.estimate(&Homographies, from, to);
        estimator.params.est_thresh = thresh;
        let plane = self.frame.matrix_to_frame(&plane?);
        let pairs: Vec<_> = self.pairs(from, to).collect();
        let mut row = vec![Weight::default(); self.basis.control().len()];
        let mut errors = Vec::with_capacity(pairs.len());
        let mut p = self.p.clone();
        // Bends look like noise to the plane's own judgement of its inliers.
        let mut limit = 3.0 * thresh / self.frame.radius;
        let plane_error = |(x, u): &([f64; 2], [f64; 2])| {
            let w = homography::apply(&plane, *x);
            libm::hypot(w[0] - u[0], w[1] - u[1])
        };
        errors.extend(pairs.iter().map(plane_error));
        for round in 0..=ROUNDS {
            if errors.iter().filter(|e| **e <= limit).count() < 4 {
                return Err(NO_FIT);
            }
            self.solve(&plane, &pairs, |i| errors[i] <= limit, &mut p)?;
            if round == ROUNDS {
                break;
            }
            errors.clear();
            for (x, u) in &pairs {
                let w = self.warp(&p, *x, &mut row);
                errors.push(libm::hypot(w[0] - u[0], w[1] - u[1]));
            }
            let mut sorted = errors.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            let spread = sorted[sorted.len() / 2] / (2.0 * std::f64::consts::LN_2).sqrt();
            limit = (INLIER * spread).clamp(1e-6, thresh / self.frame.radius);
        }
        estimator.set_inliers(errors.iter().map(|e| *e <= limit));
        self.set_state(&p)
    }
}

impl<B: Basis> NonRigid for FreeForm<B> {
    fn motion_squared(&self, state: &[f64]) -> f64 {
        let moved: f64 = self.p.iter().zip(state).map(|(a, b)| (a - b) * (a - b)).sum();
        // As many squared pixels as four points would have moved.
        moved * self.frame.radius * self.frame.radius * 8.0 / self.p.len().max(1) as f64
    }

    fn begin_frame(&self) {
        let memory = self.basis.penalty().memory;
        self.update_bend();
        let (_, bend) = &*self.bend.borrow();
        let mut now = self.expected.borrow_mut();
        now.clear();
        now.extend(bend.iter().map(|b| [memory * b[0], memory * b[1]]));
    }

    fn regularise(&self, gradient: &mut [f64], hessian: &mut SymMatrix) {
        let k = self.basis.penalty().weight * mean_diagonal(hessian);
        let n = self.bending.order();
        self.update_bend();
        let (_, bend) = &*self.bend.borrow();
        let expected = &*self.expected.borrow();
        for a in 0..n {
            for (b, (bend, expected)) in bend.iter().zip(expected).enumerate() {
                let r = k * self.bending.get(a, b);
                for c in 0..2 {
                    gradient[2 * a + c] -= r * (bend[c] - expected[c]);
                    if b >= a {
                        let at = (2 * a + c, 2 * b + c);
                        hessian.set(at.0, at.1, hessian.get(at.0, at.1) - r);
                    }
                }
            }
        }
    }

    fn place(&self, x: [f64; 2]) -> [f64; 2] {
        let mut row = vec![Weight::default(); self.basis.control().len()];
        let warped = self.warp(&self.p, self.frame.point_to_frame(x), &mut row);
        self.frame.point_to_image(warped)
    }
}

impl<B: Basis> Reference for FreeForm<B> {
    fn point(&self, i: usize) -> [f64; 2] {
        let mut row = vec![Weight::default(); self.basis.control().len()];
        self.frame
            .point_to_image(self.warp(&self.p, self.frame.grid_point(i), &mut row))
    }
}

impl<B: Basis> SecondOrder for FreeForm<B> {
    /// The second derivatives of `w` by `p` vanish; those by `x` are left out of the approximate and warped kinds.
    fn curvature_into(
        &self,
        kind: JacobianKind,
        weights: &[f32],
        _: Gradient<'_>,
        hessian: ImageHessian<'_>,
        h: &mut SymMatrix,
    ) {
        let r = if kind.of_template() {
            1.0
        } else {
            self.frame.radius
        };
        let mut scratch = self.scratch.borrow_mut();
        self.spatial(&mut scratch);
        let mut active = Vec::with_capacity(self.stretches.len());
        for i in 0..self.frame.x.len() {
            let (xx, xy, yy) = (hessian.xx[i], hessian.xy[i], hessian.yy[i]);
            let mut q = Matrix2::new(xx, xy, xy, yy).map(f64::from) * (r * r * f64::from(weights[i]));
            let w: [f64; 4] = std::array::from_fn(|k| scratch[k][i].into());
            let wx = Matrix2::new(w[0], w[1], w[2], w[3]);
            match kind {
                JacobianKind::Template | JacobianKind::Additive => {}
                JacobianKind::Warped => q = wx.transpose() * q * wx,
                JacobianKind::Approximate => {
                    let inverse = wx.try_inverse().unwrap_or_else(Matrix2::zeros);
                    q = inverse.transpose() * q * inverse;
                }
            }
            active.clear();
            let used = self
                .stretches
                .iter()
                .enumerate()
                .filter(|(_, s)| s.range().contains(&i));
            active.extend(used.map(|(k, s)| (k, f64::from(s.w[i - s.start]))));
            for &(k, a) in &active {
                for &(l, b) in active.iter().filter(|(l, _)| *l >= k) {
                    for c in 0..2 {
                        for d in 0..2 {
                            let at = (2 * k + c, 2 * l + d);
                            if at.1 >= at.0 {
                                h.set(at.0, at.1, h.get(at.0, at.1) + a * b * q[(c, d)]);
                            }
                        }
                    }
                }
            }
        }
    }
}

impl<B: Basis> Part for FreeForm<B> {
    type Params = B::Params;
    const NAME: &'static str = B::NAME;
    const ALIASES: &'static [&'static str] = B::ALIASES;
    const SUMMARY: &'static str = B::SUMMARY;
    fn new(params: B::Params) -> Self {
        FreeForm {
            basis: B::new(params),
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests;
