//! How long the steps of a search are whose model has no merit function.

/// `a · b`.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Length of steps for models without a merit function, whose Hessian is that of perfect alignment: far from it, and under
/// blur, the gradient changes less along a step than the Hessian says, sometimes more.
///
/// A step of `gain` times Newton's that leaves the share `s` of the slope along itself has met `(1 - s)/gain` of the curvature
/// expected; the next step is as many times longer as that is too small (Aitken's relaxation), within bounds.
pub(super) struct Relaxation {
    pub gain: f64,
    /// Slope along the last step at its start.
    pub promise: f64,
}

impl Default for Relaxation {
    fn default() -> Self {
        Relaxation {
            gain: 1.0,
            promise: 0.0,
        }
    }
}

impl Relaxation {
    const GAIN: std::ops::RangeInclusive<f64> = 0.5..=2.0;

    /// Takes the slope that is left along the last step.
    pub fn adapt(&mut self, slope: f64) {
        let met = 1.0 - slope / self.promise;
        let (low, high) = (*Self::GAIN.start(), *Self::GAIN.end());
        self.gain = if met.is_nan() {
            1.0
        } else if met * high <= self.gain {
            high
        } else {
            (self.gain / met).max(low)
        };
    }
}
