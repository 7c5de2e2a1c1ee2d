//! Everything that warps with a 3x3 matrix share: the base frame, updates, Jacobians and Hessians, fitting.
//!
//! A model gives its matrix `M(p)`, the way back, and the derivatives of `M`; the rest follows.

use super::{Gradient, ImageHessian, Increment, JacobianKind, Points, SsmModel, StateSpaceModel};
use crate::geom::solve::SymMatrix;
use crate::geom::{Corners, Mat3, homography};
use crate::kernels::{self, Column, Covectors, Jacobian};
use crate::params::{Params, Resolution};
use crate::tracker::TrackError;
use nalgebra::{Matrix2, Vector2, Vector3};

/// Largest number of parameters of a projective model.
pub const MAX_DOF: usize = 8;

/// The algebra of a projective warp: `w(x; p) = M(p) (x, y, 1)` divided by its third component. `M(0)` is the identity.
pub trait ProjectiveModel: Clone + Default + Send + 'static {
    /// Its parameters.
    type Params: Params;
    /// Name.
    const NAME: &'static str;
    /// Other names.
    const ALIASES: &'static [&'static str];
    /// One line for `list ssm`.
    const SUMMARY: &'static str;
    /// Number of parameters S.
    const DOF: usize;
    /// Point pairs that determine a state.
    const MIN_POINTS: usize;

    /// Builds it.
    fn new(params: Self::Params) -> Self;
    /// `M(p)`.
    fn matrix(&self, p: &[f64]) -> Mat3;
    /// State of a matrix of the model's family; `None` when it has none.
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()>;
    /// `dM/dp_k`.
    fn derivative(&self, p: &[f64], k: usize) -> Mat3;
    /// `d²M/dp_k dp_l`, `None` for zero.
    fn second_derivative(&self, _p: &[f64], _k: usize, _l: usize) -> Option<Mat3> {
        None
    }
    /// Matrix of the inverse of `M(p)`, by a stable closed form where there is one.
    fn inverse(&self, p: &[f64]) -> Option<Mat3> {
        self.matrix(p).try_inverse()
    }
    /// Least-squares state of point pairs in the base frame; `None` when they do not determine one.
    fn fit(&self, from: &[[f64; 2]], to: &[[f64; 2]], p: &mut [f64]) -> Option<()>;
}

/// Means of two point sets, and the points relative to them.
pub(super) struct Centred {
    pub mean_from: [f64; 2],
    pub mean_to: [f64; 2],
    pub pairs: Vec<([f64; 2], [f64; 2])>,
}

impl Centred {
    pub fn new(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Self> {
        if from.is_empty() || from.len() != to.len() {
            return None;
        }
        let mean = |s: &[[f64; 2]]| {
            let n = s.len() as f64;
            s.iter().fold([0.0; 2], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n])
        };
        let (mean_from, mean_to) = (mean(from), mean(to));
        let minus = |p: &[f64; 2], m: [f64; 2]| [p[0] - m[0], p[1] - m[1]];
        let pairs = from
            .iter()
            .zip(to)
            .map(|(a, b)| (minus(a, mean_from), minus(b, mean_to)))
            .collect();
        Some(Centred {
            mean_from,
            mean_to,
            pairs,
        })
    }
    /// Translation that, after the linear part `a`, takes one mean to the other.
    pub fn translation(&self, a: &Matrix2<f64>) -> [f64; 2] {
        let m = a * Vector2::from(self.mean_from);
        [self.mean_to[0] - m[0], self.mean_to[1] - m[1]]
    }
    /// `(1 + a, b)` of the least-squares similarity `[1+a -b; b 1+a]` between the centred points.
    pub fn similarity(&self) -> Option<(f64, f64)> {
        let (mut xx, mut dot, mut cross) = (0.0, 0.0, 0.0);
        for ([x, y], [u, v]) in &self.pairs {
            xx += x * x + y * y;
            dot += x * u + y * v;
            cross += x * v - y * u;
        }
        (xx > 0.0).then(|| (dot / xx, cross / xx))
    }
}

/// A projective model with its base frame and state.
#[derive(Clone, Debug, Default)]
pub struct Projective<W> {
    model: W,
    centre: [f64; 2],
    radius: f64,
    /// Corners in the base frame.
    base: Corners,
    res: Option<Resolution>,
    /// Grid in the base frame.
    x: Vec<f32>,
    y: Vec<f32>,
    p: [f64; MAX_DOF],
    matrix: Mat3,
    identity_columns: [Column; MAX_DOF],
}

fn to_f32(m: &Mat3) -> [f32; 9] {
    std::array::from_fn(|i| m[(i / 3, i % 3)] as f32)
}

fn row_major(m: &Mat3) -> [f64; 9] {
    std::array::from_fn(|i| m[(i / 3, i % 3)])
}

impl<W: ProjectiveModel> Projective<W> {
    /// With default parameters.
    pub fn new() -> Self {
        Self::default()
    }

    /// The algebra.
    pub fn model(&self) -> &W {
        &self.model
    }

    /// Current matrix in the base frame.
    pub fn matrix(&self) -> &Mat3 {
        &self.matrix
    }

    fn to_frame(&self, c: &Corners) -> Corners {
        Corners(c.0.map(|[x, y]| {
            [
                (x - self.centre[0]) / self.radius,
                (y - self.centre[1]) / self.radius,
            ]
        }))
    }

    fn to_image(&self, c: &Corners) -> Corners {
        Corners(c.0.map(|[x, y]| [self.centre[0] + self.radius * x, self.centre[1] + self.radius * y]))
    }

    /// Takes the matrix of a new state if its region is sound.
    fn accept(&mut self, p: [f64; MAX_DOF]) -> Result<(), TrackError> {
        if p.iter().any(|v| !v.is_finite()) {
            return Err(TrackError::NotFinite("state"));
        }
        let m = self.model.matrix(&p[..W::DOF]);
        // D is linear over the base quadrilateral, so its smallest value is at a corner.
        let in_front = |c: &[f64; 2]| m[(2, 0)] * c[0] + m[(2, 1)] * c[1] + m[(2, 2)] > 1e-6;
        if !self.base.0.iter().all(in_front) {
            return Err(TrackError::Degenerate("part of the region is behind the camera"));
        }
        let corners = homography::apply_corners(&m, &self.base);
        if !corners.is_finite() {
            return Err(TrackError::NotFinite("corners"));
        }
        if !corners.is_convex() || corners.signed_area() * self.base.signed_area() <= 0.0 {
            return Err(TrackError::Degenerate("region is not convex"));
        }
        if corners.signed_area().abs() * self.radius * self.radius < 1.0 {
            return Err(TrackError::Degenerate("region is smaller than one pixel"));
        }
        self.p = p;
        self.matrix = m;
        Ok(())
    }

    /// 2 x S Jacobian `dw/dp` at base point `x0` for the state `p`, in the base frame.
    pub fn warp_jacobian(&self, p: &[f64], x0: [f64; 2]) -> [[f64; MAX_DOF]; 2] {
        let m = self.model.matrix(p);
        let mut out = [[0.0; MAX_DOF]; 2];
        for k in 0..W::DOF {
            let dm = self.model.derivative(p, k);
            out[0][k] = kernels::steepest_reference(x0, [1.0, 0.0], &m, &dm);
            out[1][k] = kernels::steepest_reference(x0, [0.0, 1.0], &m, &dm);
        }
        out
    }

    /// Second derivatives `d²w_c/dp_k dp_l` of both components at base point `x0` for the state `p`.
    pub fn warp_hessian(&self, p: &[f64], x0: [f64; 2], k: usize, l: usize) -> [f64; 2] {
        let x = Vector3::new(x0[0], x0[1], 1.0);
        let h = self.model.matrix(p) * x;
        let (hk, hl) = (self.model.derivative(p, k) * x, self.model.derivative(p, l) * x);
        let hkl = self
            .model
            .second_derivative(p, k, l)
            .map_or(Vector3::zeros(), |m| m * x);
        let d = h[2];
        std::array::from_fn(|c| {
            let w = h[c] / d;
            let (wk, wl) = ((hk[c] - w * hk[2]) / d, (hl[c] - w * hl[2]) / d);
            (hkl[c] - w * hkl[2] - wk * hl[2] - wl * hk[2]) / d
        })
    }

    fn columns(&self, p: &[f64]) -> [Column; MAX_DOF] {
        std::array::from_fn(|k| {
            if k < W::DOF {
                Column::new(row_major(&self.model.derivative(p, k)))
            } else {
                Column::default()
            }
        })
    }
}

impl<W: ProjectiveModel> StateSpaceModel for Projective<W> {
    fn dof(&self) -> usize {
        W::DOF
    }

    fn init(&mut self, corners: &Corners, res: Resolution) -> Result<(), TrackError> {
        if !corners.is_finite() {
            return Err(TrackError::NotFinite("corners"));
        }
        if !corners.is_convex() {
            return Err(TrackError::BadRegion("corners are not a convex quadrilateral"));
        }
        if corners.signed_area().abs() < 1.0 {
            return Err(TrackError::BadRegion("region is smaller than one pixel"));
        }
        self.centre = corners.centroid();
        let [cx, cy] = self.centre;
        let spread: f64 = corners
            .0
            .iter()
            .map(|[x, y]| (x - cx).powi(2) + (y - cy).powi(2))
            .sum();
        self.radius = (spread / 4.0).sqrt();
        self.base = self.to_frame(corners);
        let square = Corners::rect(-0.5, -0.5, 1.0, 1.0);
        let to_base = homography::from_corners(&square, &self.base)
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        self.x.clear();
        self.y.clear();
        let step = |i: usize, n: usize| {
            if n > 1 {
                i as f64 / (n - 1) as f64 - 0.5
            } else {
                0.0
            }
        };
        for row in 0..res.rows {
            for col in 0..res.cols {
                let [x, y] = homography::apply(&to_base, [step(col, res.cols), step(row, res.rows)]);
                self.x.push(x as f32);
                self.y.push(y as f32);
            }
        }
        self.res = Some(res);
        self.p = [0.0; MAX_DOF];
        self.matrix = self.model.matrix(&self.p[..W::DOF]);
        self.identity_columns = self.columns(&[0.0; MAX_DOF][..W::DOF]);
        Ok(())
    }

    fn state(&self) -> &[f64] {
        &self.p[..W::DOF]
    }

    fn set_state(&mut self, p: &[f64]) -> Result<(), TrackError> {
        let mut full = [0.0; MAX_DOF];
        full[..W::DOF].copy_from_slice(p);
        self.accept(full)
    }

    fn update(&mut self, how: Increment, delta: &[f64]) -> Result<(), TrackError> {
        let mut p = self.p;
        match how {
            Increment::Additive => {
                for (p, d) in p.iter_mut().zip(delta) {
                    *p += d;
                }
            }
            Increment::Compositional | Increment::InverseCompositional => {
                if delta.iter().any(|v| !v.is_finite()) {
                    return Err(TrackError::NotFinite("increment"));
                }
                let step = match how {
                    Increment::InverseCompositional => self.model.inverse(delta),
                    _ => Some(self.model.matrix(delta)),
                };
                step.and_then(|m| self.model.state(&(self.matrix * m), &mut p[..W::DOF]))
                    .ok_or(TrackError::Degenerate("increment has no inverse in the model"))?;
            }
        }
        self.accept(p)
    }

    fn corners(&self) -> Corners {
        self.to_image(&homography::apply_corners(&self.matrix, &self.base))
    }

    fn fit_corners(&mut self, corners: &Corners) -> Result<f64, TrackError> {
        let target = self.to_frame(corners);
        let mut p = [0.0; MAX_DOF];
        self.model
            .fit(&self.base.0, &target.0, &mut p[..W::DOF])
            .ok_or(TrackError::BadRegion("corners do not determine a state"))?;
        self.accept(p)?;
        Ok((self.corners().distance_squared(corners) / 4.0).sqrt())
    }

    fn rebase(&mut self, corners: &Corners) -> Result<Mat3, TrackError> {
        let res = self.res.ok_or(TrackError::NotInitialised)?;
        let mut fresh = Projective {
            model: self.model.clone(),
            ..Self::default()
        };
        fresh.init(corners, res)?;
        let carry = homography::from_corners(&fresh.base, &self.base)
            .ok_or(TrackError::BadRegion("corners are not a convex quadrilateral"))?;
        *self = fresh;
        Ok(carry)
    }

    fn grid(&self) -> Points<'_> {
        Points {
            x: &self.x,
            y: &self.y,
        }
    }

    fn point(&self, i: usize) -> [f64; 2] {
        let [u, v] = homography::apply(&self.matrix, [self.x[i].into(), self.y[i].into()]);
        [self.centre[0] + self.radius * u, self.centre[1] + self.radius * v]
    }

    fn warp_into(&self, x: &mut [f32], y: &mut [f32]) {
        let centre = self.centre.map(|c| c as f32);
        kernels::warp_projective(
            &to_f32(&self.matrix),
            centre,
            self.radius as f32,
            &self.x,
            &self.y,
            x,
            y,
        );
    }

    fn jacobian_into(
        &self,
        kind: JacobianKind,
        gradient: Gradient<'_>,
        points: Points<'_>,
        row: usize,
        j: &mut Jacobian,
    ) {
        let identity = Mat3::identity();
        let m = &self.matrix;
        let matrix = match kind {
            JacobianKind::Template | JacobianKind::Additive => identity,
            JacobianKind::Warped => *m,
            // A state is only accepted when its region has positive area, so M has an inverse.
            JacobianKind::Approximate => m.try_inverse().unwrap_or(identity),
        };
        let (px, py, centre, scale, denominator) = if kind.of_template() {
            (&self.x[..], &self.y[..], [0.0; 2], 1.0, None)
        } else {
            let d = [m[(2, 0)] as f32, m[(2, 1)] as f32, m[(2, 2)] as f32];
            let projective = (d != [0.0, 0.0, 1.0]).then_some(d);
            (
                points.x,
                points.y,
                self.centre.map(|c| c as f32),
                self.radius as f32,
                projective,
            )
        };
        let q = Covectors {
            gx: gradient.x,
            gy: gradient.y,
            px,
            py,
            centre,
            scale,
            matrix: to_f32(&matrix),
            denominator,
        };
        let columns = match kind {
            JacobianKind::Template | JacobianKind::Warped => self.identity_columns,
            JacobianKind::Additive | JacobianKind::Approximate => self.columns(&self.p[..W::DOF]),
        };
        kernels::steepest(&self.x, &self.y, &q, &columns[..W::DOF], row, j);
    }

    fn curvature_into(
        &self,
        kind: JacobianKind,
        weights: &[f32],
        gradient: Gradient<'_>,
        hessian: ImageHessian<'_>,
        h: &mut SymMatrix,
    ) {
        let zero = [0.0; MAX_DOF];
        let at = match kind {
            JacobianKind::Template | JacobianKind::Warped => &zero[..W::DOF],
            JacobianKind::Additive | JacobianKind::Approximate => &self.p[..W::DOF],
        };
        let r = if kind.of_template() { 1.0 } else { self.radius };
        for i in 0..self.x.len() {
            let x0 = [f64::from(self.x[i]), f64::from(self.y[i])];
            let mut g = Vector2::new(f64::from(gradient.x[i]), f64::from(gradient.y[i])) * r;
            let (xx, xy, yy) = (hessian.xx[i], hessian.xy[i], hessian.yy[i]);
            let mut q = Matrix2::new(xx, xy, xy, yy).map(f64::from) * (r * r);
            let (wx, omega) = homography::spatial_derivatives(&self.matrix, x0);
            match kind {
                JacobianKind::Template | JacobianKind::Additive => {}
                JacobianKind::Warped => {
                    q = wx.transpose() * q * wx + omega[0] * g[0] + omega[1] * g[1];
                    g = wx.transpose() * g;
                }
                JacobianKind::Approximate => {
                    let inverse = wx.try_inverse().unwrap_or_else(Matrix2::zeros);
                    g = inverse.transpose() * g;
                    q = inverse.transpose() * (q - omega[0] * g[0] - omega[1] * g[1]) * inverse;
                }
            }
            let wp = self.warp_jacobian(at, x0);
            let weight = f64::from(weights[i]);
            h.fill_from(|k, l, sum| {
                let (a, b) = (Vector2::new(wp[0][k], wp[1][k]), Vector2::new(wp[0][l], wp[1][l]));
                let second = self.warp_hessian(at, x0, k, l);
                sum + weight * ((a.transpose() * q * b)[0] + g[0] * second[0] + g[1] * second[1])
            });
        }
    }

    fn radius(&self) -> f64 {
        self.radius
    }

    fn memory(&self) -> usize {
        8 * self.x.capacity() + size_of::<Self>()
    }
}

impl<W: ProjectiveModel> SsmModel for Projective<W> {
    type Params = W::Params;
    const NAME: &'static str = W::NAME;
    const ALIASES: &'static [&'static str] = W::ALIASES;
    const SUMMARY: &'static str = W::SUMMARY;
    fn new(params: W::Params) -> Self {
        Projective {
            model: W::new(params),
            ..Self::default()
        }
    }
}
