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

#[cfg(test)]
mod tests {
    use super::*;

    /// The slope that is left after a step from a slope of 1 on a parabola whose curvature is `curvature` times the one
    /// expected, and the length of the step after it.
    fn second_step(curvature: f64) -> (f64, f64) {
        let mut relaxation = Relaxation {
            promise: 1.0,
            ..Relaxation::default()
        };
        let left = 1.0 - relaxation.gain * curvature;
        relaxation.adapt(left);
        (left, relaxation.gain)
    }

    #[test]
    fn the_second_step_ends_at_the_top_of_a_parabola() {
        for curvature in [0.5, 0.55, 0.7, 0.9, 1.0, 1.3, 1.9, 2.0] {
            let (left, gain) = second_step(curvature);
            assert!(
                (left - gain * curvature * left).abs() < 1e-12,
                "{curvature} {gain}"
            );
        }
    }

    #[test]
    fn steps_are_at_most_doubled_and_halved() {
        let gains = [-1.0, 0.0, 0.2, 4.0, f64::NAN].map(|curvature| second_step(curvature).1);
        assert_eq!(gains, [2.0, 2.0, 2.0, 0.5, 1.0]);
    }
}
