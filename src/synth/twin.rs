//! A second object that looks like the first, turns and grows with it, and circles it, behind it.
//!
//! Its middle is at `D (w cos a, h sin a)` px from the object's, with `D` a number of boxes, `w x h` the box in the first frame
//! and `a` an angle that makes 0.8 turns over the sequence. Depends on nothing else in the crate.

use super::random::Random;
use super::spec::SynthSpec;

/// Turns around the object over the sequence.
const TURNS: f64 = 0.8;

/// The way of the twin.
#[derive(Clone, Copy)]
pub(crate) struct Twin {
    reach: [f64; 2],
    start: f64,
    /// rad per frame
    rate: f64,
}

impl Twin {
    /// The twin that `spec` asks for; `None` when it asks for none.
    pub fn new(spec: &SynthSpec, random: &mut Random) -> Option<Self> {
        let start = random.range(0.0, std::f64::consts::TAU);
        (spec.twin > 0.0).then(|| Twin {
            reach: spec.object.map(|n| spec.twin * n),
            start,
            rate: TURNS * std::f64::consts::TAU / spec.frames as f64,
        })
    }

    /// How far its middle is from the object's at frame `t`, px.
    pub fn offset(&self, t: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.start + self.rate * t);
        [self.reach[0] * cos, self.reach[1] * sin]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_twin_keeps_its_distance() {
        let mut spec = SynthSpec::default();
        assert!(Twin::new(&spec, &mut Random::new(1, 8)).is_none());
        spec.twin = 1.2;
        let twin = Twin::new(&spec, &mut Random::new(1, 8)).unwrap();
        for t in 0..60 {
            let [x, y] = twin.offset(f64::from(t));
            let boxes = (x / spec.object[0]).hypot(y / spec.object[1]);
            assert!((boxes - 1.2).abs() < 1e-9);
        }
    }
}
