//! Parameters of all Lucas-Kanade methods.

use crate::params::param_enum;
use crate::sm::template::Learning;

param_enum! {
    /// Where the Hessian comes from. `J0`, `J`: Jacobian of the template, of the current patch.
    pub enum Hessian {
        /// The method's own default.
        Auto = "auto",
        /// Self Hessian of the template with `J0`, computed once.
        InitialSelf = "initial_self",
        /// Self Hessian of the current patch with `J`.
        CurrentSelf = "current_self",
        /// Hessian of the similarity as it stands.
        Std = "std",
        /// ESM: mean of the two self Hessians.
        SumOfSelf = "sum_of_self",
        /// ESM: Hessian of the current side with the mean Jacobian.
        Original = "original",
        /// ESM: mean of the Hessians of both sides.
        SumOfStd = "sum_of_std",
    }
}

impl Hessian {
    /// Whether it is of the similarity as it stands, not of a patch compared with itself.
    pub fn is_standard(self) -> bool {
        matches!(self, Hessian::Std | Hessian::SumOfStd | Hessian::Original)
    }
}

crate::params! {
    /// Parameters of all gradient search methods.
    pub struct LkParams {
        /// Most iterations per frame.
        max_iters: usize = 30, in 1..=100_000;
        /// Converged when the corners' squared motion, summed over all eight coordinates, falls below this; px².
        epsilon: f64 = 1e-4, in 0.0..=1e6;
        /// Hessian: auto (the method's own default), initial_self, current_self, std; ESM also sum_of_self, original, sum_of_std.
        hess: Hessian = Hessian::Auto;
        /// Second-order terms in the Hessian; self Hessians have them with models whose gradient does not vanish at alignment.
        second_order: bool = false;
        /// Levenberg-Marquardt damping, steps accepted by the similarity (centred models: by the size of the gradient).
        leven_marq: bool = false;
        /// Levenberg-Marquardt: initial damping, as a share of the Hessian's diagonal.
        lm_init: f64 = 0.01, in 1e-10..=1e10;
        /// Levenberg-Marquardt: factor by which the damping grows and falls.
        lm_factor: f64 = 10.0, in 1.01..=1e6;
        /// Compositional Jacobians from the image's gradient carried through the warp (1), or from differences of the warped
        /// image (0).
        chained_warp: bool = true;
        /// The appearance model learns from each tracked frame: auto (models that need it), 0 or 1.
        enable_learning: Learning = Learning::Auto;
    }
}
