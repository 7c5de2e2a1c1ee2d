//! How the object's plane moves: warps of the frame within a model, zero motion at the first frame.
//!
//! A warp acts on points relative to the object's centre `c` at the first frame:
//! `W = T(c) T(tx, ty) R(angle) S(exp scale) A(stretch, shear) P(tilt) T(-c)`,
//! with `A = [e^s k; 0 e^-s]` and `P` the identity but for its last row `(vx, vy, 1)`. Each model is a prefix of these
//! factors, so every warp lies exactly in the model. Depends on `geom` only.

use super::random::Random;
use mtf::geom::Mat3;

/// The family of warps that the motion stays in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd)]
pub enum Model {
    /// Shift: 2 degrees of freedom.
    Translation,
    /// Shift and rotation: 3.
    Isometry,
    /// Shift, rotation, uniform scale: 4.
    Similitude,
    /// Shift, rotation, scale, stretch, shear: 6.
    Affine,
    /// All plane projective warps: 8.
    Homography,
}

impl Model {
    /// All, by growing degrees of freedom.
    pub const ALL: [Model; 5] = [
        Model::Translation,
        Model::Isometry,
        Model::Similitude,
        Model::Affine,
        Model::Homography,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Model::Translation => "translation",
            Model::Isometry => "isometry",
            Model::Similitude => "similitude",
            Model::Affine => "affine",
            Model::Homography => "homography",
        }
    }

    /// Number of parameters: how many entries of a [`Pose`] may differ from zero.
    pub fn dof(self) -> usize {
        match self {
            Model::Translation => 2,
            Model::Isometry => 3,
            Model::Similitude => 4,
            Model::Affine => 6,
            Model::Homography => 8,
        }
    }
}

/// The shift by `(x, y)` px.
pub(crate) fn shift(x: f64, y: f64) -> Mat3 {
    Mat3::new(1.0, 0.0, x, 0.0, 1.0, y, 0.0, 0.0, 1.0)
}

/// Warp parameters: `tx, ty` (px), `angle` (rad, clockwise on screen), `scale` (natural logarithm), `stretch`
/// (logarithm), `shear`, `vx, vy` (1/px).
pub type Pose = [f64; 8];

/// The warp of a pose about `centre` (px), frame 0 to the current frame.
pub fn warp(pose: &Pose, centre: [f64; 2]) -> Mat3 {
    let [tx, ty, angle, scale, stretch, shear, vx, vy] = *pose;
    let (sin, cos) = libm::sincos(angle);
    let s = libm::exp(scale);
    let place = Mat3::new(
        s * cos,
        -s * sin,
        tx + centre[0],
        s * sin,
        s * cos,
        ty + centre[1],
        0.0,
        0.0,
        1.0,
    );
    let affine = Mat3::new(
        libm::exp(stretch),
        shear,
        0.0,
        0.0,
        libm::exp(-stretch),
        0.0,
        0.0,
        0.0,
        1.0,
    );
    let tilt = Mat3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, vx, vy, 1.0);
    place * affine * tilt * shift(-centre[0], -centre[1])
}

/// Largest value of each pose entry; see [`Pose`] for units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amplitudes(pub Pose);

impl Amplitudes {
    /// Entries that move the corners of a `width` x `height` box by about `pixels` in all, most of it by shift;
    /// entries beyond the model's are zero.
    pub fn balanced(model: Model, pixels: f64, [width, height]: [f64; 2]) -> Self {
        let radius = (width * width + height * height).sqrt() / 2.0;
        let unit = pixels / radius;
        let tilt = 0.35 * unit * 2.0;
        let all = [
            pixels,
            pixels,
            0.5 * unit,
            0.4 * unit,
            0.25 * unit,
            0.3 * unit,
            tilt / width,
            tilt / height,
        ];
        Self::within(model, all)
    }

    /// `pose` with the entries beyond the model's set to zero.
    pub fn within(model: Model, mut pose: Pose) -> Self {
        pose[model.dof()..].fill(0.0);
        Amplitudes(pose)
    }
}

/// Eight smooth functions of time that vanish at t = 0 and stay within -1..1 over the sequence:
/// `c(t) = n sum_k a_k (sin(2 pi k f t + b_k) - sin b_k)`, k = 1..3.
#[derive(Clone, Debug)]
pub struct Curves {
    waves: [[[f64; 2]; 3]; 8],
    /// Factor that brings each curve's peak to 1.
    norm: Pose,
    /// Cycles per frame of the slowest wave.
    rate: f64,
}

impl Curves {
    /// Random curves for a sequence of `frames` frames, the slowest wave making `rate` cycles per frame.
    pub(crate) fn new(random: &mut Random, frames: usize, rate: f64) -> Self {
        let mut waves = [[[0.0; 2]; 3]; 8];
        for (k, wave) in waves.iter_mut().flatten().enumerate() {
            let strength = random.range(0.5, 1.0) / (k % 3 + 1) as f64;
            *wave = [strength, random.range(0.0, std::f64::consts::TAU)];
        }
        Curves {
            waves,
            norm: [1.0; 8],
            rate,
        }
        .at_rate(frames, rate)
    }

    /// The same waves at another rate, scaled anew.
    pub(crate) fn at_rate(&self, frames: usize, rate: f64) -> Self {
        let mut curves = Curves {
            norm: [1.0; 8],
            rate,
            ..self.clone()
        };
        let mut peak = [1e-9f64; 8];
        for i in 0..frames {
            for (p, v) in peak.iter_mut().zip(curves.at(i as f64)) {
                *p = p.max(v.abs());
            }
        }
        curves.norm = peak.map(|p| 1.0 / p);
        curves
    }

    /// All curves at time `t`, in frames.
    pub fn at(&self, t: f64) -> Pose {
        let mut out = [0.0; 8];
        for ((v, waves), norm) in out.iter_mut().zip(&self.waves).zip(&self.norm) {
            for (k, [strength, phase]) in waves.iter().enumerate() {
                let angle = std::f64::consts::TAU * (k + 1) as f64 * self.rate * t;
                *v += norm * strength * (libm::sin(angle + phase) - libm::sin(*phase));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mtf::geom::Corners;
    use proptest::prelude::*;

    fn moved(pose: &Pose, points: &[[f64; 2]; 4]) -> [[f64; 2]; 4] {
        let m = warp(pose, [150.0, 110.0]);
        points.map(|[x, y]| {
            let p = m * nalgebra::Vector3::new(x, y, 1.0);
            [p.x / p.z, p.y / p.z]
        })
    }

    proptest! {
        #[test]
        fn each_model_keeps_its_invariants(v in prop::array::uniform8(-1.0f64..1.0)) {
            let square = Corners::rect(100.0, 60.0, 100.0, 100.0).0;
            let scale = [20.0, 20.0, 0.6, 0.4, 0.2, 0.2, 1e-3, 1e-3];
            let full: Pose = std::array::from_fn(|k| v[k] * scale[k]);
            let dist = |p: &[[f64; 2]; 4], i: usize, j: usize| {
                ((p[i][0] - p[j][0]).powi(2) + (p[i][1] - p[j][1]).powi(2)).sqrt()
            };
            for model in Model::ALL {
                let p = moved(&Amplitudes::within(model, full).0, &square);
                let sides = [dist(&p, 0, 1), dist(&p, 1, 2), dist(&p, 2, 3), dist(&p, 3, 0)];
                prop_assert!(Corners(p).is_convex());
                if model <= Model::Affine {
                    prop_assert!((p[0][0] - p[1][0] + p[2][0] - p[3][0]).abs() < 1e-9);
                }
                if model <= Model::Similitude {
                    prop_assert!(sides.iter().all(|s| (s - sides[0]).abs() < 1e-9));
                    prop_assert!((dist(&p, 0, 2) - sides[0] * 2f64.sqrt()).abs() < 1e-9);
                }
                if model <= Model::Isometry {
                    prop_assert!((sides[0] - 100.0).abs() < 1e-9);
                }
                if model == Model::Translation {
                    prop_assert!((p[1][1] - p[0][1]).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn curves_start_at_zero_and_peak_at_one() {
        let curves = Curves::new(&mut Random::new(3, 1), 60, 1.0 / 60.0);
        assert_eq!(curves.at(0.0), [0.0; 8]);
        for k in 0..8 {
            let peak = (0..60)
                .map(|i| curves.at(f64::from(i))[k].abs())
                .fold(0.0, f64::max);
            assert!((peak - 1.0).abs() < 1e-12);
        }
    }
}
