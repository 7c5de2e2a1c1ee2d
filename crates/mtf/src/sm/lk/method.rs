//! What makes a member of the Lucas-Kanade family.

use super::kit::Kit;
use super::params::Hessian;
use crate::am::{Normal, Side};
use crate::params::Params;
use crate::ssm::{Increment, StateSpaceModel};

/// One of the Lucas-Kanade family.
pub trait LkMethod: Send + Sized + 'static {
    /// Parameters of its own.
    type Extra: Params;
    /// Name.
    const NAME: &'static str;
    /// Other names.
    const ALIASES: &'static [&'static str];
    /// One line for `list sm`.
    const SUMMARY: &'static str;
    /// Algorithm of the paper, if it is one.
    const PUBLISHED: Option<&'static str> = None;
    /// Hessians it allows, its default first.
    const HESSIANS: &'static [Hessian];
    /// How its step is applied.
    const INCREMENT: Increment;
    /// Groups that include it.
    const GROUPS: &'static [&'static str] = &["gradient"];
    /// Searches per frame, each until it converges.
    const STAGES: usize = 1;
    /// Whether it must be told the ground truth of each frame.
    const NEEDS_TRUTH: bool = false;

    /// Builds it.
    fn new(extra: Self::Extra) -> Self;
    /// Whether iterations read image gradients at the current points.
    fn reads_gradient(hess: Hessian) -> bool;
    /// Whether it reads gradients of the warped image, which `chained_warp` chooses.
    fn reads_warped_gradient(_: Hessian) -> bool {
        true
    }
    /// Whether it reads derivatives of the similarity on that side.
    fn reads_side(_: Hessian, _: Side) -> bool {
        true
    }
    /// Computes what stays constant while the template and the base frame do.
    fn prepare<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>);
    /// Told which of its searches of a frame begins.
    fn begin_stage(&mut self, _stage: usize) {}
    /// Shown the frame with the patch and the state of the ground truth, before the search.
    fn visit_truth<S: StateSpaceModel>(&mut self, _kit: &mut Kit<'_, S>) {}
    /// Gradient and Hessian at the current state.
    fn linearise<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>, out: &mut Normal);
    /// Whether it keeps a Jacobian of the template, with the Hessian given.
    fn keeps_jacobian(_hess: Hessian) -> bool {
        true
    }
    /// Bytes kept between frames.
    fn memory(&self) -> usize;
}
