//! FALK, forward additive Lucas-Kanade (Lucas & Kanade 1981): `J = ∇I_t w_p(p)`, gradient `f_t J`, `p <- p + Δ`.

use super::fclk::{Constant, forward, initial_self};
use super::kit::Kit;
use super::method::LkMethod;
use super::params::Hessian;
use crate::am::{Normal, Side};
use crate::params::NoParams;
use crate::ssm::{Increment, JacobianKind, StateSpaceModel};

/// Forward additive method.
pub struct FalkMethod {
    initial: Constant,
}

impl LkMethod for FalkMethod {
    type Extra = NoParams;
    const NAME: &'static str = "falk";
    const PUBLISHED: Option<&'static str> = Some("algorithm 5");
    const ALIASES: &'static [&'static str] = &["fa"];
    const SUMMARY: &'static str = "forward additive Lucas-Kanade";
    const HESSIANS: &'static [Hessian] = &[Hessian::CurrentSelf, Hessian::InitialSelf, Hessian::Std];
    const GROUPS: &'static [&'static str] = &["lk", "gradient"];
    const INCREMENT: Increment = Increment::Additive;

    fn new(_: NoParams) -> Self {
        FalkMethod {
            initial: Constant::default(),
        }
    }
    fn reads_gradient(_: Hessian) -> bool {
        true
    }
    /// The current side's gradient is the image's; only the template's is warped.
    fn reads_warped_gradient(hess: Hessian) -> bool {
        hess == Hessian::InitialSelf
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
        forward(kit, JacobianKind::Additive, &mut self.initial, out);
    }
    fn keeps_jacobian(hess: Hessian) -> bool {
        hess == Hessian::InitialSelf
    }
    fn memory(&self) -> usize {
        self.initial.0.memory()
    }
}
