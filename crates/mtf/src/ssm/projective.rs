//! Everything that warps with a 3x3 matrix share: the base frame, updates, Jacobians and Hessians, fitting.
//!
//! A model gives its matrix `M(p)`, the way back, and the derivatives of `M`; the rest follows.

use super::frame::BaseFrame;
use super::{
    Estimable, Geometric, Gradient, ImageHessian, Increment, JacobianKind, MatrixGroup, Points, Reference,
    SecondOrder, SsmCapabilities, StateSpaceModel,
};
use crate::consensus::{Estimator, PointModel};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::geom::{Corners, Mat3, homography, lie};
use crate::kernels::{self, Column, Covectors, Jacobian};
use crate::params::{Params, Resolution};
use crate::tracker::TrackError;
use nalgebra::{Matrix2, Vector2, Vector3};

/// Largest number of parameters of a projective model.
pub const MAX_DOF: usize = 8;

/// A step or a drawn sample that a search must invert and cannot.
const NO_INVERSE: TrackError = TrackError::Degenerate(
    "a step has no inverse in the state space model; use a search that inverts none (fclk, esm), another state space \
     model, or a smaller sigma where samples are drawn",
);
/// A product of warps that is none of the model.
const NO_STATE: TrackError = TrackError::Degenerate(
    "a step leads out of the state space model; use another state space model, or a smaller sigma where samples are \
     drawn",
);
/// Most steps of the Karcher mean, and the squared norm of one that ends it.
const MEAN_ITERATIONS: usize = 10;
const MEAN_EPSILON: f64 = 1e-16;
const NO_FIT: TrackError = TrackError::BadRegion("points do not determine a state");

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
    /// Whether products of the family's matrices stay in it. If not, [`state`](Self::state) projects them.
    const GROUP: bool = true;

    /// Builds it.
    fn new(params: Self::Params) -> Self;
    /// Takes the corners of the base frame, for models whose parameters refer to them.
    fn set_base(&mut self, _corners: &Corners) {}
    /// `M(p)`.
    fn matrix(&self, p: &[f64]) -> Mat3;
    /// State of a matrix of the model's family; `None` when it has none.
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()>;
    /// Replaces a state by another of the same warp, where that is a better one to differentiate at.
    fn canonical(&self, _p: &mut [f64]) {}
    /// `dM/dp_k`.
    fn derivative(&self, p: &[f64], k: usize) -> Mat3;
    /// All S derivatives of `M`, for models that share work between them.
    fn derivatives(&self, p: &[f64], out: &mut [Mat3; MAX_DOF]) {
        for (k, out) in out.iter_mut().enumerate().take(Self::DOF) {
            *out = self.derivative(p, k);
        }
    }
    /// `d²M/dp_k dp_l`, `None` for zero.
    fn second_derivative(&self, _p: &[f64], _k: usize, _l: usize) -> Option<Mat3> {
        None
    }
    /// Matrix of the inverse of `M(p)`, by a stable closed form where there is one.
    fn inverse(&self, p: &[f64]) -> Option<Mat3> {
        self.matrix(p).try_inverse()
    }
    /// Least-squares matrix of the family for point pairs; `None` when they do not determine one.
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3>;
    /// The same for exactly [`MIN_POINTS`](Self::MIN_POINTS) pairs, where there is a faster way.
    fn minimal(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        self.fit_matrix(from, to)
    }
    /// Matrix of least reprojection error, starting from `m`. The default is right where `fit_matrix` is already that.
    fn refine(&self, _m: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], _iterations: usize) -> Option<Mat3> {
        self.fit_matrix(from, to)
    }
    /// Its geometric parameters, if it has such.
    fn geometric(&self) -> Option<&dyn Geometric> {
        None
    }
    /// Least-squares state of point pairs in the base frame; `None` when they do not determine one.
    fn fit(&self, from: &[[f64; 2]], to: &[[f64; 2]], p: &mut [f64]) -> Option<()> {
        self.state(&self.fit_matrix(from, to)?, p)
    }
}

/// Sampling consensus over the matrices of a model.
struct Fitter<'a, W>(&'a W);

impl<W: ProjectiveModel> PointModel for Fitter<'_, W> {
    fn min_points(&self) -> usize {
        W::MIN_POINTS
    }
    fn minimal(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        self.0.minimal(from, to)
    }
    fn fit(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        self.0.fit_matrix(from, to)
    }
    fn refine(&self, m: &Mat3, from: &[[f64; 2]], to: &[[f64; 2]], iterations: usize) -> Option<Mat3> {
        self.0.refine(m, from, to, iterations)
    }
}

/// A projective model with its base frame and state.
#[derive(Clone, Debug, Default)]
pub struct Projective<W> {
    model: W,
    frame: BaseFrame,
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

    /// The identity in the present frame.
    fn start(&mut self) {
        self.model.set_base(&self.frame.corners);
        self.p = [0.0; MAX_DOF];
        let at_zero = Derivatives::new(&self.model, &self.p[..W::DOF]);
        self.matrix = at_zero.m;
        self.identity_columns = Self::columns(&at_zero.first);
    }

    /// Takes the matrix of a new state if its region is sound.
    fn accept(&mut self, p: [f64; MAX_DOF]) -> Result<(), TrackError> {
        if p.iter().any(|v| !v.is_finite()) {
            return Err(TrackError::NotFinite("state"));
        }
        let m = self.model.matrix(&p[..W::DOF]);
        // D is linear over the base quadrilateral, so its smallest value is at a corner.
        let in_front = |c: &[f64; 2]| m[(2, 0)] * c[0] + m[(2, 1)] * c[1] + m[(2, 2)] > 1e-6;
        if !self.frame.corners.0.iter().all(in_front) {
            return Err(TrackError::Degenerate("part of the region is behind the camera"));
        }
        self.frame
            .check(&homography::apply_corners(&m, &self.frame.corners))?;
        self.p = p;
        self.matrix = m;
        Ok(())
    }

    /// 2 x S Jacobian `dw/dp` at base point `x0` for the state `p`, in the base frame.
    pub fn warp_jacobian(&self, p: &[f64], x0: [f64; 2]) -> [[f64; MAX_DOF]; 2] {
        Derivatives::new(&self.model, p).jacobian(x0)
    }

    /// Second derivatives `d²w_c/dp_k dp_l` of both components at base point `x0` for the state `p`.
    pub fn warp_hessian(&self, p: &[f64], x0: [f64; 2], k: usize, l: usize) -> [f64; 2] {
        let second = self.model.second_derivative(p, k, l);
        Derivatives::new(&self.model, p).hessian(x0, k, l, second.as_ref())
    }

    fn warp_with(&self, m: &Mat3, x: &mut [f32], y: &mut [f32]) {
        kernels::warp_projective(
            &to_f32(m),
            self.frame.centre.map(|c| c as f32),
            self.frame.radius as f32,
            &self.frame.x,
            &self.frame.y,
            x,
            y,
        );
    }

    fn columns(derivatives: &[Mat3; MAX_DOF]) -> [Column; MAX_DOF] {
        std::array::from_fn(|k| {
            if k < W::DOF {
                Column::new(row_major(&derivatives[k]))
            } else {
                Column::default()
            }
        })
    }

    /// `dM/dΔ_k` of the projected product `M(p) M(Δ)` at `Δ = 0`, for a family that is no group.
    fn projected_products(&self) -> [Mat3; MAX_DOF] {
        let at_zero = Derivatives::new(&self.model, &[0.0; MAX_DOF][..W::DOF]);
        let here = Derivatives::new(&self.model, self.state());
        let (mut origin, mut moved) = ([0.0; MAX_DOF], [0.0; MAX_DOF]);
        // The projection is affine in the matrix, so differences of it are exact.
        let _ = self.model.state(&self.matrix, &mut origin[..W::DOF]);
        std::array::from_fn(|k| {
            let product = self.matrix + self.matrix * at_zero.first[k];
            let _ = self.model.state(&product, &mut moved[..W::DOF]);
            (0..W::DOF).fold(Mat3::zeros(), |m, l| m + here.first[l] * (moved[l] - origin[l]))
        })
    }
}

/// `M(p)` and its derivatives.
struct Derivatives {
    m: Mat3,
    first: [Mat3; MAX_DOF],
}

impl Derivatives {
    fn new<W: ProjectiveModel>(model: &W, p: &[f64]) -> Self {
        let mut first = [Mat3::zeros(); MAX_DOF];
        model.derivatives(p, &mut first);
        Derivatives {
            m: model.matrix(p),
            first,
        }
    }

    fn jacobian(&self, x0: [f64; 2]) -> [[f64; MAX_DOF]; 2] {
        [[1.0, 0.0], [0.0, 1.0]].map(|g| {
            self.first
                .map(|dm| kernels::steepest_reference(x0, g, &self.m, &dm))
        })
    }

    fn hessian(&self, x0: [f64; 2], k: usize, l: usize, second: Option<&Mat3>) -> [f64; 2] {
        let x = Vector3::new(x0[0], x0[1], 1.0);
        let h = self.m * x;
        let (hk, hl) = (self.first[k] * x, self.first[l] * x);
        let hkl = second.map_or(Vector3::zeros(), |m| m * x);
        let d = h[2];
        std::array::from_fn(|c| {
            let w = h[c] / d;
            let (wk, wl) = ((hk[c] - w * hk[2]) / d, (hl[c] - w * hl[2]) / d);
            (hkl[c] - w * hkl[2] - wk * hl[2] - wl * hk[2]) / d
        })
    }
}

impl<W: ProjectiveModel> StateSpaceModel for Projective<W> {
    fn dof(&self) -> usize {
        W::DOF
    }

    fn base(&self) -> &BaseFrame {
        &self.frame
    }

    fn capabilities(&self) -> SsmCapabilities {
        SsmCapabilities {
            compositional: true,
            invertible: true,
            group: W::GROUP,
            min_points: W::MIN_POINTS,
        }
    }

    fn init(&mut self, corners: &Corners, res: Resolution) -> Result<(), TrackError> {
        self.frame.set(corners, res)?;
        self.start();
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
                self.model.canonical(&mut p[..W::DOF]);
            }
            Increment::Compositional | Increment::InverseCompositional => {
                if delta.iter().any(|v| !v.is_finite()) {
                    return Err(TrackError::NotFinite("increment"));
                }
                let step = match how {
                    Increment::InverseCompositional => self.model.inverse(delta).ok_or(NO_INVERSE)?,
                    _ => self.model.matrix(delta),
                };
                self.model
                    .state(&(self.matrix * step), &mut p[..W::DOF])
                    .ok_or(NO_STATE)?;
            }
        }
        self.accept(p)
    }

    fn corners(&self) -> Corners {
        self.frame
            .to_image(&homography::apply_corners(&self.matrix, &self.frame.corners))
    }

    fn corners_at(&self, p: &[f64]) -> Corners {
        let m = self.model.matrix(p);
        self.frame
            .to_image(&homography::apply_corners(&m, &self.frame.corners))
    }

    fn fit_corners(&mut self, corners: &Corners) -> Result<f64, TrackError> {
        let target = self.frame.to_frame(corners);
        let mut p = [0.0; MAX_DOF];
        self.model
            .fit(&self.frame.corners.0, &target.0, &mut p[..W::DOF])
            .ok_or(TrackError::BadRegion("corners do not determine a state"))?;
        self.accept(p)?;
        Ok((self.corners().distance_squared(corners) / 4.0).sqrt())
    }

    fn fit_into(&self, from: &[[f64; 2]], to: &[[f64; 2]], p: &mut [f64]) -> Result<(), TrackError> {
        // Closed forms centre their points, so the fit may run in pixels; the frame is a similarity away.
        let m = if from.len() == W::MIN_POINTS {
            self.model.minimal(from, to)
        } else {
            self.model.fit_matrix(from, to)
        };
        let m = self.frame.matrix_to_frame(&m.ok_or(NO_FIT)?);
        self.model.state(&m, p).ok_or(NO_FIT)
    }

    fn relative_into(&self, p: &[f64], q: &[f64], out: &mut [f64]) -> Result<(), TrackError> {
        let step = self.model.inverse(p).ok_or(NO_INVERSE)? * self.model.matrix(q);
        self.model.state(&step, out).ok_or(NO_STATE)
    }

    fn rebase(&mut self, corners: &Corners) -> Result<Mat3, TrackError> {
        let (frame, carry) = self.frame.rebased(corners)?;
        self.frame = frame;
        self.start();
        Ok(carry)
    }

    fn warp_into(&self, x: &mut [f32], y: &mut [f32]) {
        self.warp_with(&self.matrix, x, y);
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
            JacobianKind::Warped if W::GROUP => *m,
            // A state is only accepted when its region has positive area, so M has an inverse.
            JacobianKind::Approximate => m.try_inverse().unwrap_or(identity),
            JacobianKind::Template if !W::GROUP => m.try_inverse().unwrap_or(identity),
            JacobianKind::Template | JacobianKind::Additive | JacobianKind::Warped => identity,
        };
        let (px, py, centre, scale, denominator) = if kind.of_template() {
            (&self.frame.x[..], &self.frame.y[..], [0.0; 2], 1.0, None)
        } else {
            let d = [m[(2, 0)] as f32, m[(2, 1)] as f32, m[(2, 2)] as f32];
            let projective = (d != [0.0, 0.0, 1.0]).then_some(d);
            (
                points.x,
                points.y,
                self.frame.centre.map(|c| c as f32),
                self.frame.radius as f32,
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
            JacobianKind::Template | JacobianKind::Warped if !W::GROUP => {
                Self::columns(&self.projected_products())
            }
            JacobianKind::Template | JacobianKind::Warped => self.identity_columns,
            JacobianKind::Additive | JacobianKind::Approximate => {
                let mut first = [Mat3::zeros(); MAX_DOF];
                self.model.derivatives(self.state(), &mut first);
                Self::columns(&first)
            }
        };
        kernels::steepest(&self.frame.x, &self.frame.y, &q, &columns[..W::DOF], row, j);
    }

    fn memory(&self) -> usize {
        self.frame.memory() + size_of::<Self>()
    }

    fn estimable(&mut self) -> Option<&mut dyn Estimable> {
        Some(self)
    }

    fn matrix_group(&self) -> Option<&dyn MatrixGroup> {
        Some(self)
    }

    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }

    fn second_order(&self) -> Option<&dyn SecondOrder> {
        Some(self)
    }

    fn geometric(&self) -> Option<&dyn Geometric> {
        self.model.geometric()
    }
}

impl<W: ProjectiveModel> Estimable for Projective<W> {
    fn estimate(
        &mut self,
        estimator: &mut Estimator,
        from: &[[f64; 2]],
        to: &[[f64; 2]],
    ) -> Result<(), TrackError> {
        let m = estimator.estimate(&Fitter(&self.model), from, to)?;
        let mut p = [0.0; MAX_DOF];
        self.model
            .state(&self.frame.matrix_to_frame(&m), &mut p[..W::DOF])
            .ok_or(NO_FIT)?;
        self.accept(p)
    }
}

impl<W: ProjectiveModel> MatrixGroup for Projective<W> {
    fn mean_into(&self, states: &[f64], weights: &[f64], out: &mut [f64]) -> Result<(), TrackError> {
        let lost = TrackError::Degenerate("states have no mean");
        let unit = |p: &[f64]| {
            let m = self.model.matrix(p);
            // Only a projective matrix has a free scale; the others have m22 = 1 and stay as they are.
            let k = if m[(2, 0)] == 0.0 && m[(2, 1)] == 0.0 {
                1.0
            } else {
                libm::cbrt(m.determinant())
            };
            m / k
        };
        let heaviest = (0..weights.len())
            .max_by(|&a, &b| weights[a].total_cmp(&weights[b]).then(b.cmp(&a)))
            .ok_or(lost)?;
        let total: f64 = weights.iter().sum();
        let s = W::DOF;
        let mut mean = unit(&states[heaviest * s..][..s]);
        for _ in 0..MEAN_ITERATIONS {
            let back = mean.try_inverse().ok_or(lost)?;
            let mut sum = Mat3::zeros();
            for (p, w) in states.chunks_exact(s).zip(weights) {
                let mut step = back * unit(p);
                if step[(2, 0)] != 0.0 || step[(2, 1)] != 0.0 {
                    step /= libm::cbrt(step.determinant());
                }
                sum += lie::log(&step).ok_or(lost)? * (w / total);
            }
            mean *= lie::exp(&sum);
            if sum.norm_squared() < MEAN_EPSILON {
                break;
            }
        }
        self.model.state(&mean, out).ok_or(lost)
    }

    fn warp_offset_into(&self, [dx, dy]: [f64; 2], x: &mut [f32], y: &mut [f32]) {
        let shift = Mat3::new(1.0, 0.0, dx, 0.0, 1.0, dy, 0.0, 0.0, 1.0);
        let m = self.matrix * shift;
        self.warp_with(&m, x, y);
    }
}

impl<W: ProjectiveModel> Reference for Projective<W> {
    fn point(&self, i: usize) -> [f64; 2] {
        self.frame
            .point_to_image(homography::apply(&self.matrix, self.frame.grid_point(i)))
    }
}

impl<W: ProjectiveModel> SecondOrder for Projective<W> {
    fn curvature_into(
        &self,
        kind: JacobianKind,
        weights: &[f32],
        gradient: Gradient<'_>,
        hessian: ImageHessian<'_>,
        h: &mut SymMatrix,
    ) {
        let (zero, asked) = ([0.0; MAX_DOF], kind);
        let at = match kind {
            JacobianKind::Template | JacobianKind::Warped if W::GROUP => &zero[..W::DOF],
            _ => self.state(),
        };
        let mut d = Derivatives::new(&self.model, at);
        // A projected product is linear in the increment: its second derivatives are those of the additive kinds.
        let kind = match kind {
            JacobianKind::Template if !W::GROUP => JacobianKind::Approximate,
            JacobianKind::Warped if !W::GROUP => JacobianKind::Additive,
            kind => kind,
        };
        if let (JacobianKind::Template | JacobianKind::Warped, false) = (asked, W::GROUP) {
            d.first = self.projected_products();
        }
        let second: [[Option<Mat3>; MAX_DOF]; MAX_DOF] = std::array::from_fn(|k| {
            std::array::from_fn(|l| {
                (k.max(l) < W::DOF)
                    .then(|| self.model.second_derivative(at, k, l))
                    .flatten()
            })
        });
        let r = if kind.of_template() {
            1.0
        } else {
            self.frame.radius
        };
        for i in 0..self.frame.x.len() {
            let x0 = self.frame.grid_point(i);
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
            let wp = d.jacobian(x0);
            let weight = f64::from(weights[i]);
            h.fill_from(|k, l, sum| {
                let (a, b) = (Vector2::new(wp[0][k], wp[1][k]), Vector2::new(wp[0][l], wp[1][l]));
                let bend = d.hessian(x0, k, l, second[k][l].as_ref());
                sum + weight * ((a.transpose() * q * b)[0] + g[0] * bend[0] + g[1] * bend[1])
            });
        }
    }
}

impl<W: ProjectiveModel> Part for Projective<W> {
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

#[cfg(test)]
mod tests {
    use crate::geom::Corners;
    use crate::params::Resolution;
    use crate::ssm::{Homography, SSMS, StateSpaceModel};
    use crate::tracker::TrackError;

    #[test]
    fn states_that_are_no_numbers_are_named_and_refused() {
        let mut tried = 0;
        for entry in SSMS {
            let mut ssm = (entry.build)(&[]).unwrap();
            let res = Resolution { cols: 5, rows: 4 };
            ssm.init(&Corners::rect(20.0, 10.0, 40.0, 30.0), res).unwrap();
            if ssm.matrix_group().is_none() {
                continue;
            }
            let sound = vec![0.01; ssm.dof()];
            ssm.set_state(&sound).unwrap();
            for k in 0..ssm.dof() {
                for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                    let mut state = sound.clone();
                    state[k] = bad;
                    let refused = Err(TrackError::NotFinite("state"));
                    assert_eq!(ssm.set_state(&state), refused, "{} {k}", entry.name);
                    assert_eq!(ssm.state(), sound);
                    tried += 1;
                }
            }
        }
        assert!(tried > 100, "{tried}");
    }

    #[test]
    fn a_step_without_inverse_says_what_to_do() {
        let ssm = Homography::new();
        let (mut flat, mut out) = ([0.0; 8], [0.0; 8]);
        // The first row of the matrix is 0.
        flat[0] = -1.0;
        let error = ssm
            .relative_into(&flat, &[0.0; 8], &mut out)
            .unwrap_err()
            .to_string();
        assert!(error.contains("no inverse") && !error.contains('\n'), "{error}");
        for remedy in ["fclk", "esm", "another state space model", "smaller sigma"] {
            assert!(error.contains(remedy), "{error}");
        }
    }
}
