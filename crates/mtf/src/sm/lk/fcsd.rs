//! FCSD, forward compositional steepest ascent: `Δ = η D⁻¹ Jᵀ`, `p <- p ∘ Δ`, with the gradient `J` of FCLK.
//!
//! `D` is the diagonal of the negated Hessian, so that no parameter stalls because of its unit. `η` is fixed, or climbs to the
//! top of the parabola along the step: `η = (g·d) / (dᵀ (-H) d)` with `d = D⁻¹ g`.

use super::fclk::{Constant, forward, initial_self};
use super::kit::Kit;
use super::method::LkMethod;
use super::params::Hessian;
use super::relaxation::dot;
use crate::am::{Normal, Side};
use crate::ssm::{Increment, JacobianKind, StateSpaceModel};

crate::params! {
    /// Parameters of steepest ascent.
    pub struct FcsdParams {
        /// Factor of the gradient that is the step; 0: from the curvature along it.
        learning_rate: f64 = 0.0, in 0.0..=1e3;
    }
}

/// Forward compositional steepest ascent.
pub struct FcsdMethod {
    params: FcsdParams,
    initial: Constant,
    direction: Vec<f64>,
}

impl LkMethod for FcsdMethod {
    type Extra = FcsdParams;
    const NAME: &'static str = "fcsd";
    const ALIASES: &'static [&'static str] = &[];
    const SUMMARY: &'static str = "forward compositional steepest ascent (many iterations)";
    const HESSIANS: &'static [Hessian] = &[Hessian::CurrentSelf, Hessian::InitialSelf, Hessian::Std];
    const INCREMENT: Increment = Increment::Compositional;

    fn new(params: FcsdParams) -> Self {
        FcsdMethod {
            params,
            initial: Constant::default(),
            direction: Vec::new(),
        }
    }
    fn reads_gradient(_: Hessian) -> bool {
        true
    }
    fn reads_side(hess: Hessian, side: Side) -> bool {
        side == Side::Current || hess == Hessian::InitialSelf
    }
    fn prepare<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>) {
        self.direction = vec![0.0; kit.dof()];
        if kit.hess == Hessian::InitialSelf {
            let (j0, h) = &mut self.initial;
            initial_self(kit, JacobianKind::Template, (j0, h));
        }
    }
    fn linearise<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>, out: &mut Normal) {
        forward(kit, JacobianKind::Warped, &mut self.initial, out);
        let h = &mut out.hessian;
        let s = h.order();
        let mut rate = self.params.learning_rate;
        if rate == 0.0 {
            for (k, d) in self.direction.iter_mut().enumerate() {
                *d = out.gradient[k] / h.get(k, k).abs();
            }
            let d = &self.direction;
            let along = |i: usize| (0..s).map(|j| d[i] * h.get(i, j) * d[j]).sum::<f64>();
            rate = dot(&out.gradient, d) / -(0..s).map(along).sum::<f64>();
            // Uphill of an inflexion there is no top; a vanishing gradient needs no step.
            if !(rate > 0.0 && rate.is_finite()) {
                rate = 1.0;
            }
        }
        // The step that this Hessian makes of the gradient is the one wanted.
        h.fill_from(|i, j, v| if i == j { -v.abs() / rate } else { 0.0 });
    }
    fn keeps_jacobian(hess: Hessian) -> bool {
        hess == Hessian::InitialSelf
    }
    fn memory(&self) -> usize {
        self.initial.0.memory()
    }
}
