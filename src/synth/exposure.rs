//! Exposure that jumps, as of a camera that sets it anew: a factor on the whole frame that is constant for 5 to 12 frames.
//!
//! `I' = f(t) I` with `f` = 1 at first and then `F^u`, `u` uniform in -1..1 but not within 0.4 of the one before: the jump
//! can be seen. Depends on nothing else in the crate.

use super::random::Random;
use super::spec::SynthSpec;

/// Least and greatest number of frames between jumps.
const HOLD: [usize; 2] = [5, 12];
/// Least jump, relative to the logarithm of the greatest factor.
const JUMP: f64 = 0.4;

/// The factor of each frame; empty when `spec` asks for none.
pub(crate) fn factors(spec: &SynthSpec, random: &mut Random) -> Vec<f64> {
    let mut all = Vec::new();
    if spec.exposure <= 1.0 {
        return all;
    }
    let mut level = 0.0f64;
    while all.len() < spec.frames {
        let hold = HOLD[0] + random.below(HOLD[1] - HOLD[0] + 1);
        all.extend(std::iter::repeat_n(
            libm::exp(level * libm::log(spec.exposure)),
            hold,
        ));
        let before = level;
        while (level - before).abs() < JUMP {
            level = random.range(-1.0, 1.0);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_begins_neutral_holds_and_jumps() {
        let mut spec = SynthSpec::default();
        assert!(factors(&spec, &mut Random::new(3, 7)).is_empty());
        spec.exposure = 2.0;
        let all = factors(&spec, &mut Random::new(3, 7));
        assert!(all[..5].iter().all(|f| *f == 1.0));
        assert!(all.iter().all(|f| (0.5..=2.0).contains(f)));
        let jumps: Vec<f64> = all[..60]
            .windows(2)
            .map(|f| f[1] / f[0])
            .filter(|r| *r != 1.0)
            .collect();
        assert!(jumps.len() >= 4, "{jumps:?}");
        assert!(jumps.iter().all(|r| r.max(1.0 / r) > 1.3), "{jumps:?}");
    }
}
