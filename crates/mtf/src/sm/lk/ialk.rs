//! IALK, inverse additive Lucas-Kanade (Hager & Belhumeur 1998): the template's gradient stands in for the image's,
//! `J = ∇T w_x(p)⁻¹ w_p(p)`, gradient `-f_0 J`, `p <- p + Δ`.
//!
//! The gradient is taken on the template side because `J` is made of template gradients; for SSD and ZNCC this is the
//! same as `f_t J`.

use super::kit::Kit;
use super::method::LkMethod;
use super::params::Hessian;
use crate::am::{Normal, Side};
use crate::params::NoParams;
use crate::ssm::{Increment, JacobianKind, StateSpaceModel};

/// Inverse additive method.
pub struct IalkMethod;

impl LkMethod for IalkMethod {
    type Extra = NoParams;
    const NAME: &'static str = "ialk";
    const PUBLISHED: Option<&'static str> = Some("algorithm 4");
    const ALIASES: &'static [&'static str] = &["ia"];
    const SUMMARY: &'static str = "inverse additive Lucas-Kanade";
    const HESSIANS: &'static [Hessian] = &[Hessian::InitialSelf, Hessian::Std];
    const GROUPS: &'static [&'static str] = &["lk", "gradient"];
    const INCREMENT: Increment = Increment::Additive;

    fn new(_: NoParams) -> Self {
        IalkMethod
    }
    fn reads_gradient(_: Hessian) -> bool {
        false
    }
    fn reads_side(hess: Hessian, side: Side) -> bool {
        side == Side::Template || hess == Hessian::CurrentSelf
    }
    fn prepare<S: StateSpaceModel>(&mut self, _: &mut Kit<'_, S>) {}
    fn linearise<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>, out: &mut Normal) {
        kit.compute_jacobian(JacobianKind::Approximate);
        kit.linearise(Side::Template, JacobianKind::Approximate, out);
        out.gradient.iter_mut().for_each(|g| *g = -*g);
    }
    fn keeps_jacobian(_hess: Hessian) -> bool {
        false
    }
    fn memory(&self) -> usize {
        0
    }
}
