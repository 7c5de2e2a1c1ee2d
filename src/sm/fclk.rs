//! FCLK, forward compositional Lucas-Kanade (Shum & Szeliski 2000): `J = ∇I_t w_x(p) w_p(0)`, gradient `f_t J`,
//! `p <- p ∘ Δ`.

use super::gradient::{Hessian, Kit, LkMethod};
use crate::am::{AppearanceModel, Normal, Side};
use crate::geom::solve::SymMatrix;
use crate::kernels::Jacobian;
use crate::params::NoParams;
use crate::ssm::{Increment, JacobianKind, StateSpaceModel};

/// Self Hessian of the template with its own Jacobian: the constant Hessian of type `initial_self`.
pub(super) fn initial_self<A: AppearanceModel, S: StateSpaceModel>(
    kit: &mut Kit<'_, A, S>,
    kind: JacobianKind,
) -> (Jacobian, SymMatrix) {
    let mut j0 = Jacobian::default();
    kit.template_jacobian(kind, &mut j0);
    let mut h = SymMatrix::new(kit.ssm.dof());
    kit.am.self_hessian_into(Side::Template, &j0, &mut h);
    (j0, h)
}

/// One forward linearisation, additive or compositional.
pub(super) fn forward<A: AppearanceModel, S: StateSpaceModel>(
    kit: &mut Kit<'_, A, S>,
    kind: JacobianKind,
    initial: &SymMatrix,
    out: &mut Normal,
) {
    kit.compute_jacobian(kind);
    if kit.hess == Hessian::InitialSelf {
        kit.gradient(Side::Current, &mut out.gradient);
        out.hessian.copy_from(initial);
    } else {
        kit.linearise(Side::Current, kind, out);
    }
}

/// Forward compositional method.
pub struct FclkMethod {
    initial: SymMatrix,
}

impl LkMethod for FclkMethod {
    type Extra = NoParams;
    const NAME: &'static str = "fclk";
    const ALIASES: &'static [&'static str] = &["fc"];
    const SUMMARY: &'static str = "forward compositional Lucas-Kanade";
    const HESSIANS: &'static [Hessian] = &[Hessian::CurrentSelf, Hessian::InitialSelf, Hessian::Std];
    const GROUPS: &'static [&'static str] = &["lk", "gradient"];
    const INCREMENT: Increment = Increment::Compositional;

    fn new(_: NoParams) -> Self {
        FclkMethod {
            initial: SymMatrix::new(0),
        }
    }
    fn reads_gradient(_: Hessian) -> bool {
        true
    }
    fn prepare<A: AppearanceModel, S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, A, S>) {
        if kit.hess == Hessian::InitialSelf {
            self.initial = initial_self(kit, JacobianKind::Template).1;
        }
    }
    fn linearise<A: AppearanceModel, S: StateSpaceModel>(
        &mut self,
        kit: &mut Kit<'_, A, S>,
        out: &mut Normal,
    ) {
        forward(kit, JacobianKind::Warped, &self.initial, out);
    }
    fn memory(&self) -> usize {
        0
    }
}
