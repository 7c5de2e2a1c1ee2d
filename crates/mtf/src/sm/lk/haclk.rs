//! HACLK, "Hessian after convergence": FCLK whose Hessian is taken at the *true* location of each frame.
//!
//! For analysis: it shows what a method would gain from knowing the Hessian where its search ought to end. `hess=current_self`
//! is the Gauss-Newton form there, `std` Newton's, with `second_order` its second-order terms.

use super::kit::Kit;
use super::method::LkMethod;
use super::params::Hessian;
use crate::am::{Normal, Side};
use crate::params::NoParams;
use crate::ssm::{Increment, JacobianKind, StateSpaceModel};

/// FCLK with the Hessian of the ground truth.
pub struct HaclkMethod {
    truth: Normal,
}

impl LkMethod for HaclkMethod {
    type Extra = NoParams;
    const NAME: &'static str = "haclk";
    const ALIASES: &'static [&'static str] = &[];
    const SUMMARY: &'static str = "FCLK with the Hessian at each frame's ground truth (analysis)";
    const HESSIANS: &'static [Hessian] = &[Hessian::CurrentSelf, Hessian::Std];
    const INCREMENT: Increment = Increment::Compositional;
    const GROUPS: &'static [&'static str] = &[];
    const NEEDS_TRUTH: bool = true;

    fn new(_: NoParams) -> Self {
        HaclkMethod {
            truth: Normal::new(0),
        }
    }
    fn reads_gradient(_: Hessian) -> bool {
        true
    }
    fn reads_side(hess: Hessian, side: Side) -> bool {
        side == Side::Current || hess == Hessian::InitialSelf
    }
    fn prepare<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>) {
        self.truth.reset(kit.dof());
    }
    fn visit_truth<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>) {
        kit.compute_jacobian(JacobianKind::Warped);
        kit.linearise(Side::Current, JacobianKind::Warped, &mut self.truth);
    }
    fn linearise<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>, out: &mut Normal) {
        kit.compute_jacobian(JacobianKind::Warped);
        kit.gradient(Side::Current, &mut out.gradient);
        out.hessian.copy_from(&self.truth.hessian);
    }
    fn keeps_jacobian(_hess: Hessian) -> bool {
        false
    }
    fn memory(&self) -> usize {
        0
    }
}
