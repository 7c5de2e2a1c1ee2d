//! FCLK, forward compositional Lucas-Kanade (Shum & Szeliski 2000): `J = ∇I_t w_x(p) w_p(0)`, gradient `f_t J`,
//! `p <- p ∘ Δ`.

use super::kit::Kit;
use super::method::LkMethod;
use super::params::Hessian;
use crate::am::{Normal, Side};
use crate::geom::solve::SymMatrix;
use crate::kernels::Jacobian;
use crate::params::NoParams;
use crate::ssm::{Increment, JacobianKind, StateSpaceModel};

/// Jacobian and self Hessian of the template.
pub(super) type Constant = (Jacobian, SymMatrix);

/// Self Hessian of the template with its own Jacobian: the constant Hessian of type `initial_self`.
pub(super) fn initial_self<S: StateSpaceModel>(
    kit: &mut Kit<'_, S>,
    kind: JacobianKind,
    (j0, h): (&mut Jacobian, &mut SymMatrix),
) {
    kit.template_jacobian(kind, j0);
    h.reset(kit.dof());
    kit.template_self_hessian(kind, j0, h);
}

/// One forward linearisation, additive or compositional.
pub(super) fn forward<S: StateSpaceModel>(
    kit: &mut Kit<'_, S>,
    kind: JacobianKind,
    initial: &mut Constant,
    out: &mut Normal,
) {
    if kit.hess == Hessian::InitialSelf {
        kit.follow_template(&mut initial.0, &mut initial.1);
        kit.compute_jacobian(kind);
        kit.gradient(Side::Current, &mut out.gradient);
        out.hessian.copy_from(&initial.1);
    } else {
        kit.compute_jacobian(kind);
        kit.linearise(Side::Current, kind, out);
    }
}

/// Forward compositional method.
pub struct FclkMethod {
    initial: Constant,
}

impl LkMethod for FclkMethod {
    type Extra = NoParams;
    const NAME: &'static str = "fclk";
    const PUBLISHED: Option<&'static str> = Some("algorithm 2");
    const ALIASES: &'static [&'static str] = &["fc"];
    const SUMMARY: &'static str = "forward compositional Lucas-Kanade";
    const HESSIANS: &'static [Hessian] = &[Hessian::CurrentSelf, Hessian::InitialSelf, Hessian::Std];
    const GROUPS: &'static [&'static str] = &["lk", "gradient"];
    const INCREMENT: Increment = Increment::Compositional;

    fn new(_: NoParams) -> Self {
        FclkMethod {
            initial: Constant::default(),
        }
    }
    fn reads_gradient(_: Hessian) -> bool {
        true
    }
    fn reads_side(hess: Hessian, side: Side) -> bool {
        side == Side::Current || hess == Hessian::InitialSelf
    }
    fn prepare<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>) {
        if kit.hess == Hessian::InitialSelf {
            let (j0, h) = &mut self.initial;
            initial_self(kit, JacobianKind::Template, (j0, h));
        }
    }
    fn linearise<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>, out: &mut Normal) {
        forward(kit, JacobianKind::Warped, &mut self.initial, out);
    }
    fn keeps_jacobian(hess: Hessian) -> bool {
        hess == Hessian::InitialSelf
    }
    fn memory(&self) -> usize {
        self.initial.0.memory()
    }
}
