//! What the feature maps that [`super::Dfm`] compares must offer. Depends on `kernels` and the shape of patches.

use super::PatchShape;
use crate::kernels;
use crate::tracker::TrackError;

/// Gray levels that the default [`PatchFeatures::derivative`] moves values by, at most.
const STEP: f32 = 1.0;

/// Features of a patch: a number of maps of equal length, differentiable with respect to the patch's values, if only by
/// differences (the defaults, which allocate).
pub trait PatchFeatures: Send + dyn_clone::DynClone {
    /// Prepares for patches of a shape. Fails when they are too small.
    fn prepare(&mut self, shape: PatchShape) -> Result<(), TrackError>;
    /// Number of maps.
    fn maps(&self) -> usize;
    /// Values per map.
    fn map_len(&self) -> usize;
    /// All maps of a patch, one after the other.
    fn evaluate(&self, patch: &[f32], out: &mut [f32]);
    /// Change of all maps along a direction: `B d` at `patch`. By default a central difference.
    fn derivative(&self, patch: &[f32], direction: &[f32], out: &mut [f32]) {
        let largest = direction.iter().fold(0.0f32, |m, d| m.max(d.abs()));
        if largest == 0.0 {
            return out.fill(0.0);
        }
        let h = STEP / largest;
        let moved = |h: f32| -> Vec<f32> { patch.iter().zip(direction).map(|(p, d)| p + h * d).collect() };
        let mut down = vec![0.0; out.len()];
        self.evaluate(&moved(h), out);
        self.evaluate(&moved(-h), &mut down);
        for (o, d) in out.iter_mut().zip(&down) {
            *o = (*o - d) / (2.0 * h);
        }
    }
    /// Whether [`transposed`](Self::transposed) costs about as much as one evaluation.
    fn has_transpose(&self) -> bool {
        false
    }
    /// `Bᵀ w` at `patch`, for one number per feature. By default from a derivative per value of the patch.
    fn transposed(&self, patch: &[f32], weights: &[f32], out: &mut [f32]) {
        let (mut unit, mut change) = (vec![0.0; patch.len()], vec![0.0; weights.len()]);
        for (i, o) in out.iter_mut().enumerate() {
            unit[i] = 1.0;
            self.derivative(patch, &unit, &mut change);
            unit[i] = 0.0;
            *o = kernels::dot(&change, weights) as f32;
        }
    }
    /// Slow `f64` definition of [`evaluate`](Self::evaluate); by default that itself.
    fn reference(&self, patch: &[f64]) -> Vec<f64> {
        let patch: Vec<f32> = patch.iter().map(|&v| v as f32).collect();
        let mut out = vec![0.0; self.maps() * self.map_len()];
        self.evaluate(&patch, &mut out);
        out.into_iter().map(f64::from).collect()
    }
    /// Bytes kept.
    fn memory(&self) -> usize;
}

dyn_clone::clone_trait_object!(PatchFeatures);
