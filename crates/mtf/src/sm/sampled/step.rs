//! How sampled states are changed.

use crate::params::param_enum;

param_enum! {
    /// How a step changes a state.
    pub enum Step {
        /// Added to it.
        Additive = "additive",
        /// Composed with it (warps that do not compose: added).
        Compositional = "compositional",
    }
}
