//! Light over time and place: gain, bias, a crossing shadow, a roaming spot, a vignette.
//!
//! Depends on nothing else in the crate.

use super::motion::Curves;
use super::random::Random;
use super::spec::{Light, SynthSpec};

/// The light of a whole sequence.
pub(crate) struct Lighting {
    light: Light,
    curves: Curves,
    /// Least and greatest value of the gain's and the bias' curve.
    extremes: [[f64; 2]; 2],
    /// Direction the shadow moves in.
    direction: [f64; 2],
    size: [f64; 2],
    frames: f64,
}

/// The light of one frame.
pub(crate) struct LightAt<'a> {
    all: &'a Lighting,
    gain: f64,
    bias: f64,
    stripe: f64,
    spot: [f64; 2],
}

impl Lighting {
    /// The light that `spec` asks for; `None` when it asks for none.
    pub fn new(spec: &SynthSpec, random: &mut Random) -> Option<Self> {
        let curves = Curves::new(random, spec.frames, 1.2 / spec.frames as f64);
        let mut extremes = [[-1e-9f64, 1e-9]; 2];
        for i in 0..spec.frames {
            let c = curves.at(i as f64);
            for (e, v) in extremes.iter_mut().zip(c) {
                *e = [e[0].min(v), e[1].max(v)];
            }
        }
        let (sin, cos) = libm::sincos(random.range(-0.6, 0.6));
        let idle = SynthSpec::default().light;
        let active = Light {
            object_only: idle.object_only,
            ..spec.light
        } != idle;
        active.then(|| Lighting {
            light: spec.light,
            curves,
            extremes,
            direction: [cos, sin],
            size: spec.size.map(|n| n as f64),
            frames: spec.frames as f64,
        })
    }

    /// Whether only the object's pixels change.
    pub fn object_only(&self) -> bool {
        self.light.object_only
    }

    fn diagonal(&self) -> f64 {
        (self.size[0] * self.size[0] + self.size[1] * self.size[1]).sqrt()
    }

    /// The light at frame `t`.
    pub fn at(&self, t: f64) -> LightAt<'_> {
        let c = self.curves.at(t);
        // -1..1, reaching both ends over the sequence.
        let swing = |k: usize| {
            if c[k] < 0.0 {
                -c[k] / self.extremes[k][0]
            } else {
                c[k] / self.extremes[k][1]
            }
        };
        let gain = swing(0);
        let far = self.light.gain[usize::from(gain > 0.0)];
        let across = t / (self.frames - 1.0).max(1.0);
        LightAt {
            all: self,
            gain: libm::exp(gain.abs() * libm::log(far)),
            bias: self.light.bias * swing(1),
            stripe: (across - 0.5) * 1.6 * self.diagonal(),
            spot: [0, 1].map(|k| self.size[k] * (0.5 + 0.35 * c[4 + k])),
        }
    }
}

impl LightAt<'_> {
    /// `I' = factor I + bias` at pixel `(x, y)`: `(factor, bias)`.
    pub fn local(&self, x: f64, y: f64) -> (f64, f64) {
        let Lighting {
            light,
            direction,
            size,
            ..
        } = self.all;
        let diagonal = self.all.diagonal();
        let (cx, cy) = (x - size[0] / 2.0, y - size[1] / 2.0);
        let mut factor = self.gain;
        if light.shadow > 0.0 {
            let off = (cx * direction[0] + cy * direction[1] - self.stripe).abs() / diagonal;
            factor *= 1.0 - light.shadow * super::random::smoothstep(0.22, 0.12, off);
        }
        if light.spot > 0.0 {
            let (dx, dy) = ((x - self.spot[0]) / diagonal, (y - self.spot[1]) / diagonal);
            factor *= 1.0 + light.spot * libm::exp(-(dx * dx + dy * dy) / 0.06);
        }
        if light.vignette > 0.0 {
            factor *= 1.0 - light.vignette * 4.0 * (cx * cx + cy * cy) / (diagonal * diagonal);
        }
        (factor, self.bias)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gain_and_bias_start_neutral_and_reach_their_ends() {
        let mut spec = SynthSpec::default();
        assert!(Lighting::new(&spec, &mut Random::new(1, 3)).is_none());
        spec.set("light", "gain=0.5..1.6,bias=30,shadow=0.5").unwrap();
        let light = Lighting::new(&spec, &mut Random::new(4, 3)).unwrap();
        assert_eq!(light.at(0.0).local(160.0, 120.0), (1.0, 0.0));
        let all: Vec<_> = (0..60)
            .map(|i| light.at(f64::from(i)))
            .map(|l| [l.gain, l.bias])
            .collect();
        let low = all.iter().map(|g| g[0]).fold(f64::MAX, f64::min);
        let high = all.iter().map(|g| g[0]).fold(0.0, f64::max);
        let bias = all.iter().map(|g| g[1].abs()).fold(0.0, f64::max);
        assert!(
            (low - 0.5).abs() < 1e-9 || (high - 1.6).abs() < 1e-9,
            "{low} {high}"
        );
        assert!((bias - 30.0).abs() < 1e-9);
        // The shadow passes the middle half way.
        assert!(light.at(29.5).local(160.0, 120.0).0 < 0.55 * light.at(29.5).gain);
    }
}
