//! How a Lucas-Kanade method estimates illumination along with the warp: parameters `[p, a]`, see [`crate::ilm`].

use crate::am::PatchShape;
use crate::geom::solve::SymMatrix;
use crate::ilm::IlluminationModel;
use crate::kernels::{self, Jacobian};
use crate::params::Resolution;
use crate::ssm::JacobianKind;
use crate::tracker::TrackError;

/// Share of the Hessian's photometric diagonal added to itself: regions without texture leave their gain and bias
/// undetermined, and rounding must not decide.
const TIKHONOV: f64 = 1e-5;

/// Squared change of intensity, in gray levels at white, that counts as much as a squared pixel of corner motion: common
/// image gradients are some ten gray levels per pixel.
const GRAY_PER_PIXEL_SQUARED: f64 = 100.0;

/// A shape of enough points for any model.
const SMALL: PatchShape = PatchShape {
    res: Resolution { cols: 32, rows: 32 },
    channels: 1,
};

/// An illumination model in a search.
pub(super) struct Light {
    pub model: Box<dyn IlluminationModel>,
    /// Increments are of the template's side, and their inverse is composed.
    pub on_template: bool,
    /// Template patch.
    template: Vec<f32>,
    /// State to return to.
    accepted: Vec<f64>,
    /// Second-order part of the warp alone, S x S.
    block: SymMatrix,
    weights: Vec<f32>,
    products: Vec<f64>,
}

impl Light {
    pub fn new(mut model: Box<dyn IlluminationModel>, on_template: bool) -> Self {
        // Some do not know how many parameters they have before they have seen a shape.
        let _ = model.init(SMALL, false);
        Light {
            model,
            on_template,
            template: Vec::new(),
            accepted: Vec::new(),
            block: SymMatrix::new(0),
            weights: Vec::new(),
            products: Vec::new(),
        }
    }

    /// Number of parameters A.
    pub fn dof(&self) -> usize {
        self.model.dof()
    }

    /// Bytes that it will keep for each value of the patch.
    pub fn bytes(&self) -> usize {
        let inverse = if self.on_template { 4 + self.dof() } else { 0 };
        4 * (4 + self.dof() + inverse)
    }

    /// State 0, for a warp of `s` parameters.
    pub fn start(&mut self, shape: PatchShape, relative: bool, s: usize) -> Result<(), TrackError> {
        self.model.init(shape, relative)?;
        self.accepted = self.model.state().to_vec();
        self.block = SymMatrix::new(s);
        self.products = vec![0.0; s + self.dof()];
        self.weights = vec![0.0; shape.len()];
        Ok(())
    }

    pub fn set_template(&mut self, patch: &[f32]) {
        self.template.clear();
        self.template.extend_from_slice(patch);
    }

    /// Keeps the present state to return to.
    pub fn accept(&mut self) {
        self.accepted.copy_from_slice(self.model.state());
    }

    /// Returns to the state kept.
    pub fn restore(&mut self) -> Result<(), TrackError> {
        self.model.set_state(&self.accepted)
    }

    /// Applies an increment; returns what it changes in terms of squared corner motion, px².
    pub fn step(&mut self, delta: &[f64]) -> Result<f64, TrackError> {
        if self.on_template {
            self.model.step_inverse(delta, &self.template)?;
        } else {
            self.model.step(delta)?;
        }
        Ok(self.model.change_squared(&self.accepted) / GRAY_PER_PIXEL_SQUARED)
    }

    /// Completes a Jacobian of current image gradients; `lit` is `g(raw; a)`.
    pub fn extend_current(&self, raw: &[f32], lit: &[f32], j: &mut Jacobian) {
        self.model.extend(if self.on_template { lit } else { raw }, j);
    }

    /// Completes a Jacobian of template gradients, which are at the template's light.
    pub fn extend_template(&self, scratch: &mut [f32], j: &mut Jacobian) {
        let first = j.cols() - self.dof();
        if self.on_template {
            self.model.jacobian_into(&self.template, first, j);
        } else {
            self.model.unlight(&self.template, scratch);
            self.model.jacobian_into(scratch, first, j);
        }
    }

    /// Adds `Σ_i f_i d²g_i/dI da J_i` to the mixed block of `h` and brings the weights `f` of the warp's own second-order
    /// terms to the light of that kind; returns the matrix for these, zero. `j` holds `J_i` at the light of `f`.
    pub fn add_mixed(
        &mut self,
        kind: JacobianKind,
        f: &mut [f32],
        j: &Jacobian,
        h: &mut SymMatrix,
    ) -> &mut SymMatrix {
        let (s, n) = (self.block.order(), self.model.gain().len());
        for k in 0..self.dof() {
            let Some(w) = self.model.mixed(k) else { continue };
            for (f, out) in f.chunks_exact(n).zip(self.weights.chunks_exact_mut(n)) {
                kernels::product(w, f, 1.0, out);
            }
            if !self.on_template {
                for (i, v) in self.weights.iter_mut().enumerate() {
                    *v /= self.model.gain()[i % n];
                }
            }
            kernels::project(j, &self.weights, &mut self.products);
            for (p, v) in self.products[..s].iter().enumerate() {
                h.set(p, s + k, h.get(p, s + k) + v);
            }
        }
        if !kind.of_template() {
            f.chunks_exact_mut(n)
                .for_each(|f| kernels::multiply(self.model.gain(), f));
        }
        self.block.scale(0.0);
        &mut self.block
    }

    /// Lets `regularise` see gradient and Hessian of the warp alone, and damps the photometric rest.
    pub fn regularise(
        &mut self,
        gradient: &mut [f64],
        h: &mut SymMatrix,
        regularise: impl FnOnce(&mut [f64], &mut SymMatrix),
    ) {
        let s = self.block.order();
        self.block.fill(|i, j| h.get(i, j));
        regularise(&mut gradient[..s], &mut self.block);
        h.fill_from(|i, j, v| match (i == j, i.max(j) < s) {
            (_, true) => self.block.get(i, j),
            (true, false) => v * (1.0 + TIKHONOV),
            _ => v,
        });
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        4 * (self.template.len() + self.weights.len()) + self.model.memory()
    }
}
