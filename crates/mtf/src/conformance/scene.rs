//! What models are checked on: smooth analytic patches and frames under known motion.

use crate::am::PatchShape;
use crate::diagnose::{PatchPair, Waves};
use crate::geom::{Corners, Mat3, homography};
use crate::image::{Frame, Image};
use crate::params::Resolution;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Size of the frames, px.
pub(super) const SIZE: (usize, usize) = (240, 200);

/// Grid of the patches.
pub(super) const GRID: Resolution = Resolution { cols: 13, rows: 11 };

/// Where the object is in the first frame.
pub(super) const QUAD: Corners = Corners([[71.3, 60.2], [164.7, 55.9], [170.1, 140.4], [66.6, 145.0]]);

pub(super) fn rng(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// A patch of a scene, moved by `dx` px, its contrast changed by `gain`.
pub(super) fn patch(waves: &Waves, shape: PatchShape, dx: f64, gain: f64) -> Vec<f32> {
    let value = |i: usize| {
        let (c, p) = (i / GRID.len(), i % GRID.len());
        let (x, y) = ((p % GRID.cols) as f64 * 4.0, (p / GRID.cols) as f64 * 4.0);
        let at = [x + dx + 90.0 * c as f64, y];
        (gain * (waves.at(at) - 128.0) + 120.0) as f32
    };
    (0..shape.len()).map(value).collect()
}

/// Two patches of the same scene, a few pixels and a little gain apart.
pub(super) fn pair(channels: usize, seed: u64) -> PatchPair {
    let shape = PatchShape { res: GRID, channels };
    let waves = Waves::new(seed);
    PatchPair {
        shape,
        template: patch(&waves, shape, 0.0, 1.0),
        current: patch(&waves, shape, 2.5, 0.9),
    }
}

/// Frame of the waves after the plane has moved by `m`: `I(m x) = waves(x)`.
fn moved(waves: &Waves, m: &Mat3) -> Frame {
    let back = m.try_inverse().unwrap_or_else(Mat3::identity);
    let value = |x: usize, y: usize| waves.at(homography::apply(&back, [x as f64, y as f64])) as f32;
    Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, value))
}

/// Two frames and where the object is in the second.
pub(super) struct Scene {
    pub first: Frame,
    pub next: Frame,
    pub truth: Corners,
}

impl Scene {
    /// The object goes from [`QUAD`] to `truth`, a convex quadrilateral.
    pub fn new(seed: u64, truth: Corners) -> Self {
        let waves = Waves::new(seed);
        let motion = homography::from_corners(&QUAD, &truth).unwrap_or_else(Mat3::identity);
        Scene {
            first: moved(&waves, &Mat3::identity()),
            next: moved(&waves, &motion),
            truth,
        }
    }

    /// Each corner has moved in a random direction, by `distance` px RMS.
    pub fn random(seed: u64, distance: f64) -> Self {
        Scene::new(seed, Scene::corners_near(seed, distance))
    }

    /// [`QUAD`] with each corner moved in a random direction, by `distance` px RMS.
    pub fn corners_near(seed: u64, distance: f64) -> Corners {
        let mut r = rng(seed);
        let mut d: [f64; 8] = std::array::from_fn(|_| r.random_range(-1.0..1.0));
        let rms = (d.iter().map(|v| v * v).sum::<f64>() / 4.0).sqrt();
        d.iter_mut().for_each(|v| *v *= distance / rms);
        let corner = |i: usize| [QUAD.0[i][0] + d[2 * i], QUAD.0[i][1] + d[2 * i + 1]];
        Corners(std::array::from_fn(corner))
    }
}

/// A frame with one value everywhere.
pub(super) fn uniform(value: f32) -> Frame {
    Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, |_, _| value))
}

/// RMS distance of corners, px.
pub(super) fn distance(a: &Corners, b: &Corners) -> f64 {
    (a.distance_squared(b) / 4.0).sqrt()
}
