//! Specular highlights that wander over the object.
//!
//! `I' = I + G r(t) sum_k exp(-d_k(x, y, t)^2 / 2)` on the object, with `G` the intensity (0-255) that a highlight adds at its
//! middle, `d_k` the distance from highlight `k` in units of its size (a sixth of the box's width and height) and `r` a ramp
//! from 0 in the first frame to 1 in the eighth. Sums above 255 are clipped: the object cannot be seen there. Depends on the
//! motion's curves only.

use super::motion::Curves;
use super::random::Random;
use super::spec::SynthSpec;

/// Frames until the highlights are as bright as they get.
const RAMP: f64 = 8.0;
/// How far a highlight's middle goes from the object's, relative to the box.
const REACH: f64 = 0.4;
/// Size of a highlight (its Gaussian's standard deviation) relative to the box.
const SIZE: f64 = 1.0 / 6.0;

/// The highlights of a whole sequence.
pub(crate) struct Glare {
    strength: f64,
    object: [f64; 2],
    curves: Curves,
}

/// The highlights of one frame.
pub(crate) struct GlareAt {
    strength: f64,
    middles: [[f64; 2]; 2],
    size: [f64; 2],
}

impl Glare {
    /// The highlights that `spec` asks for; `None` when it asks for none.
    pub fn new(spec: &SynthSpec, random: &mut Random) -> Option<Self> {
        (spec.glare > 0.0).then(|| Glare {
            strength: spec.glare,
            object: spec.object,
            curves: Curves::new(random, spec.frames, 1.5 / spec.frames as f64),
        })
    }

    /// The highlights at frame `t` on an object whose middle is at `centre`, px.
    pub fn at(&self, t: f64, centre: [f64; 2]) -> GlareAt {
        let c = self.curves.at(t);
        let middle = |k: usize| [0, 1].map(|i| centre[i] + REACH * c[2 * k + i] * self.object[i]);
        GlareAt {
            strength: self.strength * (t / RAMP).clamp(0.0, 1.0),
            middles: [middle(0), middle(1)],
            size: self.object.map(|n| SIZE * n),
        }
    }
}

impl GlareAt {
    /// Intensity that is added to the object's at pixel `(x, y)`.
    pub fn local(&self, x: f64, y: f64) -> f64 {
        let lobe = |m: &[f64; 2]| {
            let (dx, dy) = ((x - m[0]) / self.size[0], (y - m[1]) / self.size[1]);
            libm::exp(-0.5 * (dx * dx + dy * dy))
        };
        self.strength * self.middles.iter().map(lobe).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn highlights_begin_dark_and_stay_near_the_object() {
        let mut spec = SynthSpec::default();
        assert!(Glare::new(&spec, &mut Random::new(1, 6)).is_none());
        spec.glare = 200.0;
        let glare = Glare::new(&spec, &mut Random::new(1, 6)).unwrap();
        assert_eq!(glare.at(0.0, [160.0, 120.0]).local(160.0, 120.0), 0.0);
        for t in 8..60 {
            let at = glare.at(f64::from(t), [160.0, 120.0]);
            let [m, _] = at.middles;
            assert!(at.local(m[0], m[1]) >= 200.0, "frame {t}");
            assert!((m[0] - 160.0).abs() <= 0.41 * spec.object[0] && at.local(10.0, 10.0) < 1.0);
        }
    }
}
