//! ICLK, inverse compositional Lucas-Kanade (Baker & Matthews 2001): constant Jacobian `J0 = ∇T w_p(0)`, gradient
//! `f_0 J0`, by default a constant Hessian, `p <- p ∘ Δ⁻¹`.

use super::fclk::initial_self;
use super::kit::Kit;
use super::method::LkMethod;
use super::params::Hessian;
use crate::am::{Normal, Side};
use crate::geom::solve::SymMatrix;
use crate::kernels::Jacobian;
use crate::params::NoParams;
use crate::ssm::{Increment, JacobianKind, StateSpaceModel};

/// Inverse compositional method.
pub struct IclkMethod {
    j0: Jacobian,
    initial: SymMatrix,
}

impl LkMethod for IclkMethod {
    type Extra = NoParams;
    const NAME: &'static str = "iclk";
    const PUBLISHED: Option<&'static str> = Some("algorithm 1");
    const ALIASES: &'static [&'static str] = &["ic"];
    const SUMMARY: &'static str = "inverse compositional Lucas-Kanade, constant Jacobian and Hessian";
    const HESSIANS: &'static [Hessian] = &[Hessian::InitialSelf, Hessian::CurrentSelf, Hessian::Std];
    const GROUPS: &'static [&'static str] = &["lk", "gradient"];
    const INCREMENT: Increment = Increment::InverseCompositional;

    fn new(_: NoParams) -> Self {
        IclkMethod {
            j0: Jacobian::default(),
            initial: SymMatrix::new(0),
        }
    }
    fn reads_gradient(hess: Hessian) -> bool {
        hess == Hessian::CurrentSelf
    }
    fn reads_side(hess: Hessian, side: Side) -> bool {
        side == Side::Template || hess == Hessian::CurrentSelf
    }
    fn prepare<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>) {
        initial_self(kit, JacobianKind::Template, (&mut self.j0, &mut self.initial));
    }
    fn linearise<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>, out: &mut Normal) {
        kit.follow_template(&mut self.j0, &mut self.initial);
        match kit.hess {
            Hessian::Std => kit.linearise_with(Side::Template, JacobianKind::Template, &self.j0, out),
            Hessian::CurrentSelf => {
                kit.compute_jacobian(JacobianKind::Warped);
                kit.linearise(Side::Current, JacobianKind::Warped, out);
                kit.gradient_with(Side::Template, &self.j0, &mut out.gradient);
            }
            _ => {
                kit.gradient_with(Side::Template, &self.j0, &mut out.gradient);
                out.hessian.copy_from(&self.initial);
            }
        }
    }
    fn memory(&self) -> usize {
        self.j0.memory()
    }
}
