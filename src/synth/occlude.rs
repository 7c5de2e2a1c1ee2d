//! Patches that cross the object and cover a given part of it at most.
//!
//! Depends on `geom` only.

use super::random::Random;
use super::spec::SynthSpec;
use super::trajectory::{Trajectory, project};
use mtf::geom::Mat3;

/// A rectangular patch on a straight course.
pub(crate) struct Occluder {
    /// Place (px) and time (frames) at which it passes the object.
    meets: ([f64; 2], f64),
    /// Velocity, px per frame.
    velocity: [f64; 2],
    /// Angle at the meeting (rad) and its rate (rad per frame).
    angle: [f64; 2],
    /// Half width and height, px.
    pub half: [f64; 2],
}

impl Occluder {
    /// Patch coordinates (px, origin at its middle) to the frame at time `t`.
    pub fn placed(&self, t: f64) -> Mat3 {
        let since = t - self.meets.1;
        let (sin, cos) = libm::sincos(self.angle[0] + self.angle[1] * since);
        let [x, y] = [0, 1].map(|k| self.meets.0[k] + self.velocity[k] * since);
        Mat3::new(cos, -sin, x, sin, cos, y, 0.0, 0.0, 1.0)
    }

    fn covers(&self, t: f64, p: [f64; 2]) -> bool {
        let since = t - self.meets.1;
        let (sin, cos) = libm::sincos(self.angle[0] + self.angle[1] * since);
        let [x, y] = [0, 1].map(|k| p[k] - self.meets.0[k] - self.velocity[k] * since);
        (cos * x + sin * y).abs() <= self.half[0] && (cos * y - sin * x).abs() <= self.half[1]
    }
}

/// Fraction of the object covered at frame `t`, from a 48 x 48 grid over it.
pub(crate) fn covered(occluders: &[Occluder], path: &Trajectory, object: [f64; 2], t: f64) -> f64 {
    const N: usize = 48;
    let placed = path.placed(t);
    let at = |i: usize, n: f64| ((i as f64 + 0.5) / N as f64 - 0.5) * n;
    let hidden = (0..N * N).filter(|i| {
        let p = project(&placed, [at(i % N, object[0]), at(i / N, object[1])]);
        p.is_some_and(|p| occluders.iter().any(|o| o.covers(t, p)))
    });
    hidden.count() as f64 / (N * N) as f64
}

/// Two patches that meet the object at about a third and three quarters of the sequence and cover at most
/// `spec.occlude` of it, nothing in the first frame.
pub(crate) fn place(spec: &SynthSpec, path: &Trajectory, random: &mut Random) -> Vec<Occluder> {
    if spec.occlude <= 0.0 {
        return vec![];
    }
    let frames = spec.frames as f64;
    let [w, h] = spec.size.map(|n| n as f64);
    let reach = 0.5 * (w * w + h * h).sqrt() + spec.object[0].max(spec.object[1]);
    let mut occluders: Vec<Occluder> = [(0.34, 0.3), (0.76, 0.22)]
        .into_iter()
        .enumerate()
        .map(|(k, (when, window))| {
            let time = when * frames;
            let heading = random.range(-0.5, 0.5) + if k == 0 { 0.0 } else { 2.2 };
            let (sin, cos) = libm::sincos(heading);
            let speed = reach / (window * frames).max(1.0);
            let middle = path.corners(time).centroid();
            let aside = random.range(-0.12, 0.12) * spec.object[1];
            Occluder {
                meets: ([middle[0] - sin * aside, middle[1] + cos * aside], time),
                velocity: [cos * speed, sin * speed],
                angle: [random.range(-0.4, 0.4), random.range(-0.02, 0.02)],
                half: [0.0; 2],
            }
        })
        .collect();
    // Each is as large as its own passage allows.
    let (low, high) = (0.0, 1.0);
    for o in &mut occluders {
        let (mut low, mut high): (f64, f64) = (low, high);
        for _ in 0..12 {
            let size = (low + high) / 2.0;
            o.half = [size * spec.object[0] * 0.75, size * spec.object[1] * 0.85];
            let alone = std::slice::from_ref(&*o);
            let most = (0..spec.frames)
                .map(|i| covered(alone, path, spec.object, i as f64))
                .fold(0.0, f64::max);
            if most > spec.occlude {
                high = size
            } else {
                low = size
            }
        }
        o.half = [low * spec.object[0] * 0.75, low * spec.object[1] * 0.85];
    }
    // Two at once must not cover more either.
    for _ in 0..60 {
        let worst = |o: &[Occluder]| {
            (0..spec.frames)
                .map(|i| covered(o, path, spec.object, i as f64))
                .fold(0.0, f64::max)
        };
        if worst(&occluders) <= spec.occlude && covered(&occluders, path, spec.object, 0.0) == 0.0 {
            break;
        }
        occluders
            .iter_mut()
            .for_each(|o| o.half = o.half.map(|v| v * 0.93));
    }
    occluders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_peaks_at_the_asked_fraction() {
        let spec = SynthSpec {
            occlude: 0.4,
            speed: 1.0,
            ..SynthSpec::default()
        };
        let path = Trajectory::new(&spec, &mut Random::new(2, 2)).unwrap();
        let occluders = place(&spec, &path, &mut Random::new(2, 5));
        let all: Vec<f64> = (0..60)
            .map(|i| covered(&occluders, &path, spec.object, f64::from(i)))
            .collect();
        let most = all.iter().copied().fold(0.0, f64::max);
        assert_eq!(all[0], 0.0);
        assert!(most <= 0.4 && most > 0.3, "{most}");
    }
}
