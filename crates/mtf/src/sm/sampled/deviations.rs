//! What random states are drawn with: deviations as given, or estimated from a motion in pixels.

use crate::params::{Built, ParamError, ParamValue};
use crate::ssm::{Perturbation, SampleUnit, Sampler, SigmaSets, StateSpaceModel};
use crate::tracker::TrackError;

/// The parameters of the searches that draw states.
pub(super) struct Deviations<'a> {
    pub perturb: Perturbation,
    pub unit: SampleUnit,
    pub sigma: &'a SigmaSets,
    /// Motions, a set each; `0` alone where `sigma` holds.
    pub pix_sigma: &'a SigmaSets,
}

impl Deviations<'_> {
    /// Motions that deviations are estimated from, if they are.
    fn motions(&self) -> Option<Vec<f64>> {
        let motions = self.pix_sigma.0.concat();
        (motions != [0.0]).then_some(motions)
    }

    /// Sets of deviations.
    pub fn sets(&self) -> usize {
        self.motions().map_or(self.sigma.0.len(), |motions| motions.len())
    }

    /// Draws states of `ssm`, which has started.
    ///
    /// # Errors
    /// The deviations do not fit the warp.
    pub fn sampler<S: StateSpaceModel + ?Sized>(&self, ssm: &S) -> Result<Sampler, TrackError> {
        match self.motions() {
            Some(motions) => Sampler::of_motion(ssm, &motions),
            None => {
                let sampler = Sampler::new(self.perturb, self.unit, self.sigma.clone());
                sampler.check(ssm).map(|()| sampler)
            }
        }
    }

    /// Fails where a warp that has not started will not have such samples.
    pub fn suit(&self, ssm: &dyn StateSpaceModel) -> Built<()> {
        let unusable = |name, value, reason: &str| {
            let reason = reason.to_owned();
            Err(ParamError::Unusable { name, value, reason })
        };
        if self.motions().is_some() {
            if self.pix_sigma.0.iter().any(|set| set.len() != 1) {
                let reason = "a motion is one number; separate several by '|'";
                return unusable("pix_sigma", self.pix_sigma.text(), reason);
            }
            if matches!(self.perturb, Perturbation::Points | Perturbation::Geometric) {
                let reason = "pix_sigma disturbs the parameters; leave out one of the two";
                return unusable("perturb", self.perturb.text(), reason);
            }
            return Ok(());
        }
        if self.perturb == Perturbation::Geometric && ssm.geometric().is_none() {
            let reason = "the state space model has no geometric parameters; affine and similitude have";
            return unusable("perturb", self.perturb.text(), reason);
        }
        let allowed = self.perturb.deviations(ssm);
        // Some warps have their parameters only when they have started.
        if ssm.dof() == 0 || self.sigma.0.iter().all(|set| allowed.contains(&set.len())) {
            return Ok(());
        }
        let counts: Vec<String> = allowed.iter().map(usize::to_string).collect();
        let (counts, perturb) = (counts.join(" or "), self.perturb.text());
        Err(ParamError::Value {
            name: "sigma",
            value: self.sigma.text(),
            allowed: format!("{counts} numbers in each set with perturb={perturb}"),
        })
    }
}
