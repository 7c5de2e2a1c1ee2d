//! ESM and AESM, efficient second-order minimisation (Benhimane & Malis 2007): uses the Jacobians of both patches, `J` of the
//! current one and `J0` of the template. ESM takes compositional steps, `p <- p ∘ Δ`; AESM additive ones, `p <- p + Δ`, with
//! the additive Jacobian of the current patch and the template's gradient carried to the current warp.
//!
//! `jac=diff`: gradient `½ (f_t J - f_0 J0)`; `jac=original`: `f_t (J0 + J)/2`. They coincide for SSD. The halves go
//! with Hessians of one patch, see [`Hessian`].

use super::fclk::initial_self;
use super::kit::Kit;
use super::method::LkMethod;
use super::params::Hessian;
use crate::am::{Normal, Side};
use crate::geom::solve::SymMatrix;
use crate::kernels::Jacobian;
use crate::params::param_enum;
use crate::ssm::{Increment, JacobianKind, StateSpaceModel};

param_enum! {
    /// How ESM forms its gradient.
    pub enum EsmJacobian {
        /// Half the difference of the two sides' gradients.
        Diff = "diff",
        /// Current gradient with the mean Jacobian.
        Original = "original",
    }
}

crate::params! {
    /// Parameters of ESM alone.
    pub struct EsmParams {
        /// Gradient: diff (difference of Jacobians) or original (mean Jacobian).
        jac: EsmJacobian = EsmJacobian::Diff;
    }
}

/// Hessians of both, the default first.
pub(super) const HESSIANS: &[Hessian] = &[
    Hessian::SumOfSelf,
    Hessian::InitialSelf,
    Hessian::CurrentSelf,
    Hessian::Original,
    Hessian::SumOfStd,
    Hessian::Std,
];

/// What uses both patches: gradient and Hessian from a Jacobian on either side.
pub(super) struct Symmetric {
    params: EsmParams,
    j0: Jacobian,
    initial: SymMatrix,
    other: Normal,
}

impl Symmetric {
    pub(super) fn new(params: EsmParams) -> Self {
        Symmetric {
            params,
            j0: Jacobian::default(),
            initial: SymMatrix::new(0),
            other: Normal::new(0),
        }
    }

    pub(super) fn prepare<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>) {
        initial_self(kit, JacobianKind::Template, (&mut self.j0, &mut self.initial));
        self.other.reset(kit.dof());
    }

    /// `current` and `template`: kinds of the two Jacobians.
    pub(super) fn linearise<S: StateSpaceModel>(
        &mut self,
        kit: &mut Kit<'_, S>,
        current: JacobianKind,
        template: JacobianKind,
        out: &mut Normal,
    ) {
        if template == JacobianKind::Template {
            kit.follow_template(&mut self.j0, &mut self.initial);
        } else {
            kit.template_jacobian(template, &mut self.j0);
            kit.template_self_hessian(template, &self.j0, &mut self.initial);
        }
        kit.compute_jacobian(current);
        match kit.hess {
            Hessian::InitialSelf => {
                kit.gradient(Side::Current, &mut out.gradient);
                out.hessian.copy_from(&self.initial);
            }
            Hessian::Original => kit.gradient(Side::Current, &mut out.gradient),
            _ => kit.linearise(Side::Current, current, out),
        }
        // The template's share of the Hessian.
        match kit.hess {
            Hessian::SumOfSelf => out.hessian.blend(0.5, 0.5, &self.initial),
            Hessian::SumOfStd => {
                kit.linearise_with(Side::Template, template, &self.j0, &mut self.other);
                out.hessian.blend(0.5, 0.5, &self.other.hessian);
            }
            _ => {}
        }
        if self.params.jac == EsmJacobian::Diff {
            kit.gradient_with(Side::Template, &self.j0, &mut self.other.gradient);
            for (g, g0) in out.gradient.iter_mut().zip(&self.other.gradient) {
                *g = 0.5 * (*g - g0);
            }
        }
        if self.params.jac == EsmJacobian::Original || kit.hess == Hessian::Original {
            kit.jacobian().average_with(&self.j0);
            if self.params.jac == EsmJacobian::Original {
                kit.gradient(Side::Current, &mut out.gradient);
            }
            if kit.hess == Hessian::Original {
                kit.hessian(Side::Current, &mut out.hessian);
                kit.add_second_order(Side::Current, current, 0.5, &mut out.hessian);
                kit.add_second_order(Side::Current, template, 0.5, &mut out.hessian);
            }
        }
    }

    pub(super) fn memory(&self) -> usize {
        self.j0.memory()
    }
}

/// Efficient second-order minimisation.
pub struct EsmMethod(Symmetric);

impl LkMethod for EsmMethod {
    type Extra = EsmParams;
    const NAME: &'static str = "esm";
    const PUBLISHED: Option<&'static str> = Some("algorithm 3");
    const ALIASES: &'static [&'static str] = &[];
    const SUMMARY: &'static str = "efficient second-order minimisation";
    const HESSIANS: &'static [Hessian] = HESSIANS;
    const GROUPS: &'static [&'static str] = &["lk", "gradient"];
    const INCREMENT: Increment = Increment::Compositional;

    fn new(params: EsmParams) -> Self {
        EsmMethod(Symmetric::new(params))
    }
    fn reads_gradient(_: Hessian) -> bool {
        true
    }
    fn prepare<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>) {
        self.0.prepare(kit);
    }
    fn linearise<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>, out: &mut Normal) {
        self.0
            .linearise(kit, JacobianKind::Warped, JacobianKind::Template, out);
    }
    fn memory(&self) -> usize {
        self.0.memory()
    }
}

/// ESM with additive steps.
pub struct AesmMethod(Symmetric);

impl LkMethod for AesmMethod {
    type Extra = EsmParams;
    const NAME: &'static str = "aesm";
    const ALIASES: &'static [&'static str] = &[];
    const SUMMARY: &'static str = "efficient second-order minimisation, additive steps";
    const HESSIANS: &'static [Hessian] = HESSIANS;
    const INCREMENT: Increment = Increment::Additive;

    fn new(params: EsmParams) -> Self {
        AesmMethod(Symmetric::new(params))
    }
    fn reads_gradient(_: Hessian) -> bool {
        true
    }
    fn prepare<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>) {
        self.0.prepare(kit);
    }
    fn linearise<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>, out: &mut Normal) {
        self.0
            .linearise(kit, JacobianKind::Additive, JacobianKind::Approximate, out);
    }
    fn memory(&self) -> usize {
        self.0.memory()
    }
}
