//! The object's path: smooth or random warps, kept inside the frame, with the asked mean speed.
//!
//! Depends on `geom` only.

use super::motion::{Amplitudes, Curves, Pose, shift, warp};
use super::random::Random;
use super::spec::{Mode, SynthError, SynthSpec};
use mtf::geom::{Corners, Mat3};

/// Distance that corners keep from the frame's border, px.
const BORDER: f64 = 3.0;

/// Where the object is at any time.
pub(crate) struct Trajectory {
    /// Sheet (px, origin at the object's centre) to the first frame.
    start: Mat3,
    centre: [f64; 2],
    object: [f64; 2],
    motion: Motion,
}

enum Motion {
    Smooth {
        curves: Box<Curves>,
        amplitudes: Amplitudes,
    },
    Walk(Vec<Mat3>),
}

/// `m` applied to the point `p`; `None` at or behind the horizon.
pub(crate) fn project(m: &Mat3, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let w = m[(2, 0)] * x + m[(2, 1)] * y + m[(2, 2)];
    (w > 1e-9).then(|| {
        [
            (m[(0, 0)] * x + m[(0, 1)] * y + m[(0, 2)]) / w,
            (m[(1, 0)] * x + m[(1, 1)] * y + m[(1, 2)]) / w,
        ]
    })
}

impl Trajectory {
    /// Builds the path of `spec`.
    ///
    /// # Errors
    /// [`SynthError::Impossible`] when the box does not lie in the first frame, the speed cannot be reached with the
    /// amplitudes, or no random warp stays in the frame.
    pub fn new(spec: &SynthSpec, random: &mut Random) -> Result<Self, SynthError> {
        let middle = spec.size.map(|n| (n as f64 - 1.0) / 2.0);
        let offset = [random.range(-5.0, 5.0), random.range(-5.0, 5.0)];
        let centre = spec.at.unwrap_or([middle[0] + offset[0], middle[1] + offset[1]]);
        let [w, h] = spec.object;
        let first: Pose = [
            0.0,
            0.0,
            spec.turn.to_radians(),
            0.0,
            0.0,
            0.0,
            spec.lean / w,
            0.6 * spec.lean / h,
        ];
        let start = warp(&first, centre) * shift(centre[0], centre[1]);
        let mut path = Trajectory {
            start,
            centre,
            object: spec.object,
            motion: Motion::Walk(vec![Mat3::identity()]),
        };
        if !path.good(&start, spec, false) {
            return Err(SynthError::Impossible(format!(
                "the box {w}x{h} px does not lie in a frame of {}x{} px, {BORDER} px from its border",
                spec.size[0], spec.size[1]
            )));
        }
        path.motion = match spec.mode {
            Mode::Smooth => path.smooth(spec, random)?,
            Mode::Continuous | Mode::Independent => path.walk(spec, random)?,
        };
        Ok(path)
    }

    /// Warp of the frame from the first frame to time `t` (frames).
    fn warp(&self, t: f64) -> Mat3 {
        match &self.motion {
            Motion::Smooth { .. } => warp(&self.pose(t).unwrap_or_default(), self.centre),
            Motion::Walk(warps) => {
                let t = t.clamp(0.0, (warps.len() - 1) as f64);
                let i = t as usize;
                let rest = t - i as f64;
                if rest == 0.0 {
                    warps[i]
                } else {
                    warps[i] * (1.0 - rest) + warps[i + 1] * rest
                }
            }
        }
    }

    /// Sheet to frame at time `t`.
    pub fn placed(&self, t: f64) -> Mat3 {
        self.warp(t) * self.start
    }

    /// Warp parameters at time `t`; random walks have none.
    pub fn pose(&self, t: f64) -> Option<Pose> {
        match &self.motion {
            Motion::Smooth { curves, amplitudes } => {
                let c = curves.at(t);
                Some(std::array::from_fn(|k| c[k] * amplitudes.0[k]))
            }
            Motion::Walk(_) => None,
        }
    }

    /// Centre that poses refer to, px.
    pub fn centre(&self) -> [f64; 2] {
        self.centre
    }

    /// Corners of the tracked box at time `t`.
    pub fn corners(&self, t: f64) -> Corners {
        self.corners_of(&self.placed(t))
            .unwrap_or(Corners([[f64::NAN; 2]; 4]))
    }

    fn corners_of(&self, placed: &Mat3) -> Option<Corners> {
        let (w, h) = (self.object[0] / 2.0, self.object[1] / 2.0);
        let mut out = [[0.0; 2]; 4];
        for (o, p) in out.iter_mut().zip([[-w, -h], [w, -h], [w, h], [-w, h]]) {
            *o = project(placed, p)?;
        }
        Some(Corners(out))
    }

    /// Convex, not mirrored, neither tiny nor huge, and inside the frame unless that is not asked for.
    fn good(&self, placed: &Mat3, spec: &SynthSpec, outside: bool) -> bool {
        let Some(c) = self.corners_of(placed) else {
            return false;
        };
        let area = c.signed_area() / (self.object[0] * self.object[1]);
        let inside =
            |p: &[f64; 2]| (0..2).all(|k| p[k] >= BORDER && p[k] <= spec.size[k] as f64 - 1.0 - BORDER);
        c.is_finite() && c.is_convex() && (0.05..20.0).contains(&area) && (outside || c.0.iter().all(inside))
    }

    fn smooth(&self, spec: &SynthSpec, random: &mut Random) -> Result<Motion, SynthError> {
        let [w, h] = spec.object;
        let mut a = Amplitudes::balanced(spec.model, spec.amplitude, spec.object).0;
        let mut fix = |entries: &[(usize, f64)]| entries.iter().for_each(|&(k, v)| a[k] = v);
        spec.shift.inspect(|&v| fix(&[(0, v), (1, v)]));
        spec.rotate.inspect(|&v| fix(&[(2, v.to_radians())]));
        spec.zoom.inspect(|&v| fix(&[(3, libm::log(v))]));
        spec.stretch.inspect(|&v| fix(&[(4, v), (5, v)]));
        spec.tilt.inspect(|&v| fix(&[(6, v / w), (7, v / h)]));
        let mut amplitudes = Amplitudes::within(spec.model, a);
        let n = spec.frames;
        let mut curves = Box::new(Curves::new(random, n, 0.5 / n as f64));
        // Smaller and smaller motion until the object stays inside and even the slowest curves are slow enough.
        for _ in 0..160 {
            let mut path = Trajectory {
                motion: Motion::Smooth {
                    curves: curves.clone(),
                    amplitudes,
                },
                start: self.start,
                ..*self
            };
            if n > 1 && amplitudes.0 != [0.0; 8] {
                let rate = path.rate_for(spec.speed, n).ok_or_else(|| {
                    SynthError::Impossible(format!(
                        "a speed of {} px/frame cannot be had with these amplitudes inside the frame: \
                         raise --amplitude, shrink --box, or lower --speed",
                        spec.speed
                    ))
                })?;
                *curves = curves.at_rate(n, rate);
                path.motion = Motion::Smooth {
                    curves: curves.clone(),
                    amplitudes,
                };
            }
            let slow = n < 2 || path.mean_speed(n) <= 1.02 * spec.speed;
            if slow && (0..n).all(|i| path.good(&path.placed(i as f64), spec, spec.allow_outside)) {
                return Ok(path.motion);
            }
            amplitudes = Amplitudes(amplitudes.0.map(|v| v * 0.95));
        }
        Err(SynthError::Impossible(
            "no motion of this kind keeps the object inside the frame".into(),
        ))
    }

    /// Mean corner motion between successive frames, px.
    pub fn mean_speed(&self, frames: usize) -> f64 {
        let steps = self.steps(frames);
        steps.iter().sum::<f64>() / steps.len().max(1) as f64
    }

    /// Greatest mean corner motion between successive frames, px.
    pub fn max_speed(&self, frames: usize) -> f64 {
        self.steps(frames).into_iter().fold(0.0, f64::max)
    }

    /// Mean distance of the four corners from frame to frame, px.
    pub fn steps(&self, frames: usize) -> Vec<f64> {
        let all: Vec<Corners> = (0..frames).map(|i| self.corners(i as f64)).collect();
        let distance = |a: &[f64; 2], b: &[f64; 2]| {
            let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
            (dx * dx + dy * dy).sqrt()
        };
        let mean = |p: &[Corners]| {
            p[0].0
                .iter()
                .zip(&p[1].0)
                .map(|(a, b)| distance(a, b))
                .sum::<f64>()
                / 4.0
        };
        all.windows(2).map(mean).collect()
    }

    /// Rate of the curves that gives the mean speed; `None` if none does.
    fn rate_for(&self, speed: f64, frames: usize) -> Option<f64> {
        let Motion::Smooth { curves, amplitudes } = &self.motion else {
            return None;
        };
        let speed_at = |rate: f64| {
            let curves = Box::new(curves.at_rate(frames, rate));
            let motion = Motion::Smooth {
                curves,
                amplitudes: *amplitudes,
            };
            Trajectory {
                motion,
                start: self.start,
                ..*self
            }
            .mean_speed(frames)
        };
        let (mut low, mut high) = (0.1 / frames as f64, 0.1 / frames as f64);
        while speed_at(high) < speed {
            low = high;
            high *= 1.15;
            if high > 0.2 {
                return None;
            }
        }
        for _ in 0..30 {
            let middle = (low + high) / 2.0;
            if speed_at(middle) >= speed {
                high = middle
            } else {
                low = middle
            }
        }
        Some(high)
    }

    fn walk(&self, spec: &SynthSpec, random: &mut Random) -> Result<Motion, SynthError> {
        let [w, h] = spec.object;
        let radius = (w * w + h * h).sqrt() / 2.0;
        // RMS corner displacement per unit of each pose entry.
        let reach = [
            1.0,
            1.0,
            radius,
            radius,
            radius,
            h / 2.0,
            w / 2.0 * radius,
            h / 2.0 * radius,
        ];
        let dof = spec.model.dof();
        let sigma = reach.map(|r| spec.sigma * (2.0 / dof as f64).sqrt() / r);
        let mut warps = vec![Mat3::identity()];
        let mut last = Mat3::identity();
        while warps.len() < spec.frames {
            let mut tries = 0..2000;
            let next = loop {
                if tries.next().is_none() {
                    return Err(SynthError::Impossible(format!(
                        "no random warp of sigma {} px keeps the object inside the frame",
                        spec.sigma
                    )));
                }
                let drawn: Pose = std::array::from_fn(|k| sigma[k] * random.normal());
                let delta = warp(&Amplitudes::within(spec.model, drawn).0, self.centre);
                let next = last * delta;
                if self.good(&(next * self.start), spec, spec.allow_outside) {
                    break next / next[(2, 2)];
                }
            };
            warps.push(next);
            if spec.mode == Mode::Continuous {
                last = next;
            }
        }
        Ok(Motion::Walk(warps))
    }
}

/// Largest corner distance (px) between `now` and the best affine image of `first`: zero up to affine motion.
pub(crate) fn affine_misfit(first: &Corners, now: &Corners) -> f64 {
    // An affine map of four points leaves one residual direction: the null vector `n` of [x; y; 1].
    let p = &first.0;
    let area = |i: usize, j: usize, k: usize| {
        (p[j][0] - p[i][0]) * (p[k][1] - p[i][1]) - (p[k][0] - p[i][0]) * (p[j][1] - p[i][1])
    };
    let n = [area(1, 2, 3), -area(0, 2, 3), area(0, 1, 3), -area(0, 1, 2)];
    let norm = n.iter().map(|v| v * v).sum::<f64>();
    let e = [0, 1].map(|k| n.iter().zip(&now.0).map(|(n, c)| n * c[k]).sum::<f64>() / norm);
    n.iter().map(|v| v.abs()).fold(0.0, f64::max) * (e[0] * e[0] + e[1] * e[1]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::motion::Model;
    use super::*;

    fn path(change: impl Fn(&mut SynthSpec)) -> (SynthSpec, Trajectory) {
        let mut spec = SynthSpec::default();
        change(&mut spec);
        let path = Trajectory::new(&spec, &mut Random::new(spec.seed, 2)).unwrap();
        (spec, path)
    }

    #[test]
    fn smooth_paths_have_the_asked_speed_and_stay_inside() {
        for model in Model::ALL {
            for speed in [0.5, 3.0] {
                let (spec, p) = path(|s| {
                    s.model = model;
                    s.speed = speed;
                });
                assert!(
                    (p.mean_speed(spec.frames) - speed).abs() < 0.02 * speed,
                    "{model:?}"
                );
                for i in 0..spec.frames {
                    let c = p.corners(i as f64);
                    assert!(
                        c.is_convex()
                            && c.0
                                .iter()
                                .all(|[x, y]| (3.0..=316.0).contains(x) && (3.0..=236.0).contains(y))
                    );
                }
            }
        }
    }

    #[test]
    fn walks_accumulate_or_not() {
        for (mode, least) in [(Mode::Continuous, 4.0), (Mode::Independent, 0.0)] {
            let (spec, p) = path(|s| {
                s.mode = mode;
                s.sigma = 2.0;
                s.model = Model::Affine;
            });
            let far = (0..spec.frames).map(|i| p.corners(i as f64).distance_squared(&p.corners(0.0)).sqrt());
            let far = far.fold(0.0, f64::max);
            assert!(far > least && p.pose(1.0).is_none());
            if mode == Mode::Independent {
                assert!(far < 2.0 * 8f64.sqrt() * 4.0, "{far}");
            }
            assert!(affine_misfit(&p.corners(0.0), &p.corners(30.0)) < 1e-9);
        }
    }

    #[test]
    fn misfit_of_a_trapezoid() {
        let square = Corners::rect(0.0, 0.0, 100.0, 100.0);
        let trapezoid = Corners([[20.0, 0.0], [80.0, 0.0], [100.0, 100.0], [0.0, 100.0]]);
        assert!((affine_misfit(&square, &trapezoid) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn impossible_wishes_are_refused() {
        for change in [
            |s: &mut SynthSpec| s.object = [400.0, 100.0],
            |s: &mut SynthSpec| s.at = Some([10.0, 100.0]),
            |s: &mut SynthSpec| s.speed = 500.0,
        ] {
            let mut spec = SynthSpec::default();
            change(&mut spec);
            assert!(Trajectory::new(&spec, &mut Random::new(1, 2)).is_err());
        }
    }
}
