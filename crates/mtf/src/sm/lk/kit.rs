//! What a Lucas-Kanade method works with during an iteration: Jacobians, gradients and Hessians of the current side and
//! of the template's, with or without an illumination model.

use super::light::Light;
use super::params::Hessian;
use crate::am::{Curvature, Derivatives, Normal, Side};
use crate::geom::solve::SymMatrix;
use crate::geom::{Mat3, homography};
use crate::image::Image;
use crate::kernels::Jacobian;
use crate::sm::sampling::SamplingParams;
use crate::sm::workspace::Buffers;
use crate::ssm::{Gradient, ImageHessian, JacobianKind, Points, StateSpaceModel};
use nalgebra::{Matrix2, Vector2};

/// Template gradient (and Hessian) in the base frame, channel-planar.
#[derive(Clone, Debug, Default)]
pub(super) struct Template {
    pub gx: Vec<f32>,
    pub gy: Vec<f32>,
    /// Empty unless second-order terms are wanted.
    pub hessian: [Vec<f32>; 3],
}

/// What a method works with during one iteration.
pub struct Kit<'a, S> {
    /// Derivatives of the appearance model, its current patch set.
    pub am: &'a mut dyn Derivatives,
    /// Warp.
    pub ssm: &'a mut S,
    /// Chosen Hessian, never `Auto`.
    pub hess: Hessian,
    pub(super) image: &'a Image,
    pub(super) sampling: &'a SamplingParams,
    pub(super) second_order: bool,
    pub(super) chained: bool,
    pub(super) template: &'a Template,
    pub(super) buffers: &'a mut Buffers,
    pub(super) light: Option<&'a mut Light>,
}

impl<S: StateSpaceModel> Kit<'_, S> {
    fn gradients<'g>(gx: &'g [f32], gy: &'g [f32], c: usize, n: usize) -> Gradient<'g> {
        Gradient {
            x: &gx[c * n..(c + 1) * n],
            y: &gy[c * n..(c + 1) * n],
        }
    }

    /// Number of parameters: the warp's, then those of the illumination.
    pub fn dof(&self) -> usize {
        self.ssm.dof() + self.light.as_ref().map_or(0, |l| l.dof())
    }

    /// Writes a Jacobian made of template gradients.
    pub fn template_jacobian(&mut self, kind: JacobianKind, j: &mut Jacobian) {
        let dof = self.dof();
        let b = &mut *self.buffers;
        let n = b.x.len();
        j.resize(n * self.sampling.channels.count(), dof);
        for c in 0..self.sampling.channels.count() {
            let g = Self::gradients(&self.template.gx, &self.template.gy, c, n);
            self.ssm
                .jacobian_into(kind, g, Points { x: &b.x, y: &b.y }, c * n, j);
        }
        if let Some(light) = &mut self.light {
            light.extend_template(&mut b.scratch, j);
        }
    }

    /// Self Hessian of the template with a Jacobian of its own, of that kind, with second-order terms if wanted.
    pub fn template_self_hessian(&mut self, kind: JacobianKind, j0: &Jacobian, h: &mut SymMatrix) {
        self.am.self_hessian_into(Side::Template, j0, h);
        self.add_second_order_with(Side::Template, Curvature::SelfHessian, kind, j0, 1.0, h);
    }

    /// Brings the template's Jacobian and self Hessian up to date where they change with the present state: for warps
    /// that are no group, for illumination on the current side, for models that weigh values.
    pub fn follow_template(&mut self, j0: &mut Jacobian, initial: &mut SymMatrix) {
        let moves = !self.ssm.capabilities().group || self.light.as_ref().is_some_and(|l| !l.on_template);
        if moves {
            self.template_jacobian(JacobianKind::Template, j0);
        }
        if moves || self.am.weighted() {
            self.template_self_hessian(JacobianKind::Template, j0, initial);
        }
    }

    /// Computes the Jacobian of the current image gradients (or of the template's, for kinds made of those).
    pub fn compute_jacobian(&mut self, kind: JacobianKind) {
        let mut j = std::mem::take(&mut self.buffers.j);
        let unchained = kind == JacobianKind::Warped && !self.chained;
        if unchained {
            self.sampling
                .sample_warped_gradient(self.image, self.ssm, self.buffers);
        }
        if kind.of_template() {
            self.template_jacobian(kind, &mut j);
        } else {
            // A gradient in the base frame is one that has been carried through the warp already.
            let kind = if unchained { JacobianKind::Template } else { kind };
            let b = &*self.buffers;
            let n = b.x.len();
            for c in 0..self.sampling.channels.count() {
                let g = Self::gradients(&b.gx, &b.gy, c, n);
                self.ssm
                    .jacobian_into(kind, g, Points { x: &b.x, y: &b.y }, c * n, &mut j);
            }
            if let Some(light) = &self.light {
                light.extend_current(&b.raw, &b.values, &mut j);
            }
        }
        self.buffers.j = j;
        if unchained && self.second_order {
            // Second-order terms are made of image gradients. The points have just been sampled; the patch stays what it is
            // under the present light.
            let b = &mut *self.buffers;
            b.scratch.clone_from(&b.values);
            let _ = self.sampling.sample(self.image, b, true);
            std::mem::swap(&mut b.scratch, &mut b.values);
        }
    }

    /// `out = f_side J` with the computed Jacobian and the chosen first-order Hessian of that side, plus its
    /// second-order terms if wanted (`kind` is that of the Jacobian).
    pub fn linearise(&mut self, side: Side, kind: JacobianKind, out: &mut Normal) {
        let curvature = self.curvature();
        let b = &mut *self.buffers;
        self.am.linearise(side, curvature, &b.j, &mut b.scratch, out);
        self.add_second_order(side, kind, 1.0, &mut out.hessian);
    }

    fn curvature(&self) -> Curvature {
        match self.hess.is_standard() {
            true => Curvature::Standard,
            false => Curvature::SelfHessian,
        }
    }

    /// `out = f_side J` alone, with the computed Jacobian.
    pub fn gradient(&mut self, side: Side, out: &mut [f64]) {
        let b = &mut *self.buffers;
        self.am.project_gradient(side, &b.j, &mut b.scratch, out);
    }

    /// `out = f_side J` with a Jacobian of the caller's.
    pub fn gradient_with(&mut self, side: Side, j: &Jacobian, out: &mut [f64]) {
        self.am.project_gradient(side, j, &mut self.buffers.scratch, out);
    }

    /// Same as [`linearise`](Self::linearise) with a Jacobian of the caller's.
    pub fn linearise_with(&mut self, side: Side, kind: JacobianKind, j: &Jacobian, out: &mut Normal) {
        let curvature = self.curvature();
        self.am
            .linearise(side, curvature, j, &mut self.buffers.scratch, out);
        self.add_second_order_with(side, curvature, kind, j, 1.0, &mut out.hessian);
    }

    /// First-order standard Hessian of a side with the computed Jacobian.
    pub fn hessian(&mut self, side: Side, h: &mut SymMatrix) {
        self.am.hessian_into(side, &self.buffers.j, h);
    }

    /// The computed Jacobian.
    pub fn jacobian(&mut self) -> &mut Jacobian {
        &mut self.buffers.j
    }

    /// Adds `factor Σ_i f_side[i] K_i` to `h` when second-order terms are wanted; for a self Hessian `f_side` is the
    /// gradient of the side's patch compared with itself. The computed Jacobian is of that kind.
    pub fn add_second_order(&mut self, side: Side, kind: JacobianKind, factor: f32, h: &mut SymMatrix) {
        let j = std::mem::take(&mut self.buffers.j);
        self.add_second_order_with(side, self.curvature(), kind, &j, factor, h);
        self.buffers.j = j;
    }

    fn add_second_order_with(
        &mut self,
        side: Side,
        curvature: Curvature,
        kind: JacobianKind,
        j: &Jacobian,
        factor: f32,
        h: &mut SymMatrix,
    ) {
        if !self.second_order {
            return;
        }
        let Some(terms) = self.ssm.second_order() else {
            return;
        };
        let weights = &mut self.buffers.scratch;
        match (curvature, self.am.self_gradient()) {
            (Curvature::Standard, _) => self.am.gradient_into(side, weights),
            (Curvature::SelfHessian, Some(own)) => own.self_gradient_into(side, weights),
            (Curvature::SelfHessian, None) => return,
        }
        self.buffers.scratch.iter_mut().for_each(|w| *w *= factor);
        if !kind.of_template() {
            self.sampling.sample_hessian(self.image, self.buffers);
        }
        let b = &mut *self.buffers;
        // With illumination, the warp's part goes to a matrix of its own.
        let mut warp = self
            .light
            .as_mut()
            .map(|light| light.add_mixed(kind, &mut b.scratch, j, h));
        let n = b.x.len();
        for c in 0..self.sampling.channels.count() {
            let at = c * n..(c + 1) * n;
            let (gx, gy, hessian) = if kind.of_template() {
                (&self.template.gx, &self.template.gy, &self.template.hessian)
            } else {
                (&b.gx, &b.gy, &b.hessian)
            };
            let [xx, xy, yy] = hessian;
            let q = ImageHessian {
                xx: &xx[at.clone()],
                xy: &xy[at.clone()],
                yy: &yy[at.clone()],
            };
            terms.curvature_into(
                kind,
                &b.scratch[at],
                Self::gradients(gx, gy, c, n),
                q,
                warp.as_deref_mut().unwrap_or(h),
            );
        }
        if let Some(block) = warp {
            h.add_block(block);
        }
    }
}

impl Template {
    /// Carries base-frame derivatives to a new base frame, `from_new` the homography from the new frame to the old one:
    /// `g' = g W`, `Q' = Wᵀ Q W + Σ_c g_c Ω_c` at each point of the new grid.
    pub fn carry(&mut self, from_new: &Mat3, grid: Points<'_>) {
        let n = grid.x.len();
        for i in 0..self.gx.len() {
            let x0 = [f64::from(grid.x[i % n]), f64::from(grid.y[i % n])];
            let (w, omega) = homography::spatial_derivatives(from_new, x0);
            let g = Vector2::new(f64::from(self.gx[i]), f64::from(self.gy[i]));
            let carried = w.transpose() * g;
            (self.gx[i], self.gy[i]) = (carried[0] as f32, carried[1] as f32);
            let [xx, xy, yy] = &mut self.hessian;
            if !xx.is_empty() {
                let q = Matrix2::new(xx[i], xy[i], xy[i], yy[i]).map(f64::from);
                let q = w.transpose() * q * w + omega[0] * g[0] + omega[1] * g[1];
                (xx[i], xy[i], yy[i]) = (q[(0, 0)] as f32, q[(0, 1)] as f32, q[(1, 1)] as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth function of the plane.
    fn value([u, v]: [f64; 2]) -> f64 {
        libm::sin(1.3 * u + 0.4 * v) + 0.7 * libm::cos(0.9 * v - 0.5 * u) + 0.3 * u * v
    }

    /// Value, first and second derivatives `[x, y, xx, xy, yy]` of `f` at a place, by central differences.
    fn differences(f: impl Fn([f64; 2]) -> f64, [x, y]: [f64; 2]) -> [f64; 5] {
        const H: f64 = 1e-4;
        let at = |i: f64, j: f64| f([x + i * H, y + j * H]);
        let here = at(0.0, 0.0);
        [
            (at(1.0, 0.0) - at(-1.0, 0.0)) / (2.0 * H),
            (at(0.0, 1.0) - at(0.0, -1.0)) / (2.0 * H),
            (at(1.0, 0.0) - 2.0 * here + at(-1.0, 0.0)) / (H * H),
            (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0)) / (4.0 * H * H),
            (at(0.0, 1.0) - 2.0 * here + at(0.0, -1.0)) / (H * H),
        ]
    }

    #[test]
    fn carried_derivatives_are_those_of_the_function_seen_through_the_warp() {
        let from_new = Mat3::new(1.1, -0.2, 0.3, 0.25, 0.9, -0.1, 0.15, -0.2, 1.0);
        let places: Vec<[f64; 2]> = (0..25)
            .map(|i| [0.4 * f64::from(i % 5) - 0.8, 0.35 * f64::from(i / 5) - 0.7])
            .collect();
        let column = |f: &dyn Fn(usize) -> f64| (0..25).map(|i| f(i) as f32).collect::<Vec<f32>>();
        let old = |k: usize| column(&|i| differences(value, homography::apply(&from_new, places[i]))[k]);
        let mut template = Template {
            gx: old(0),
            gy: old(1),
            hessian: [old(2), old(3), old(4)],
        };
        let (x, y) = (column(&|i| places[i][0]), column(&|i| places[i][1]));
        template.carry(&from_new, Points { x: &x, y: &y });
        let [xx, xy, yy] = &template.hessian;
        for (i, place) in places.iter().enumerate() {
            let seen = differences(|p| value(homography::apply(&from_new, p)), *place);
            for (carried, exact) in [&template.gx, &template.gy, xx, xy, yy]
                .map(|v| v[i])
                .iter()
                .zip(seen)
            {
                assert!(
                    (f64::from(*carried) - exact).abs() < 1e-4,
                    "{i} {carried} {exact}"
                );
            }
        }
    }
}
