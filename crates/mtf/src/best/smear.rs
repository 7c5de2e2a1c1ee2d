//! The template as a moving camera would see it: each point averaged along the way it goes while the shutter is open.
//!
//! If the object's pose was `A` in the frame before and is `B` now, then a pixel that shows `B x` has seen the template at
//! `x + τ (A⁻¹ B x - x)`, `τ` from `-e/2` to `e/2`, with the exposure `e` as a fraction of the time between frames.

use super::constants::K;
use super::view::{Base, TEMPLATE, View, WARP, columns};
use crate::geom::{Mat3, homography};
use crate::image::Frame;
use crate::kernels::{self, Border, Covectors};

/// The object's corners, about.
const AROUND: [[f64; 2]; 4] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];

/// A view's template as it is at rest, and the way it was last averaged along.
#[derive(Clone, Debug)]
pub(super) struct Rest {
    view: View,
    way: [[f64; 2]; 4],
}

/// Averages the views of a template.
#[derive(Debug, Default)]
pub(super) struct Smear {
    template: Option<Frame>,
    rest: Vec<Rest>,
    /// From a pose to where each point of the base frame was in the frame before.
    pub back: Option<Mat3>,
    /// Exposure as a fraction of the time between frames.
    pub exposure: f64,
    ways: Vec<[f32; 2]>,
    x: Vec<f32>,
    y: Vec<f32>,
    sample: [Vec<f32>; 3],
    sum: [Vec<f32>; 3],
}

impl Smear {
    /// Learns the views of a template.
    pub fn learn(&mut self, frame: &Frame, views: &[View]) {
        self.template = Some(frame.clone());
        let rest = |view: &View| Rest {
            view: view.clone(),
            way: [[0.0; 2]; 4],
        };
        self.rest = views.iter().map(rest).collect();
        self.back = None;
        self.exposure = 0.0;
    }

    /// How far the object moves in the template's frame while the shutter is open, px, were it always open.
    pub fn way(&self, base: &Base, pose: &Mat3) -> f64 {
        let Some(back) = self.back else { return 0.0 };
        let m = back * pose;
        let far = AROUND.map(|x| {
            let y = homography::apply(&m, x);
            libm::hypot(y[0] - x[0], y[1] - x[1])
        });
        base.unit * far.iter().sum::<f64>() / 4.0
    }

    /// Averages a view, that of the template's level `level`, as the motion to `pose` calls for.
    pub fn apply(&mut self, view: &mut View, level: usize, base: &Base, pose: &Mat3) {
        let (Some(template), Some(rest)) = (&self.template, self.rest.get_mut(level)) else {
            return;
        };
        let unit = f64::from(1u32 << level);
        let motion = self.back.map(|b| b * pose).filter(|_| self.exposure > 0.0);
        let way = |x: [f64; 2]| {
            let Some(m) = &motion else { return [0.0; 2] };
            let y = homography::apply(m, x);
            let d = [y[0] - x[0], y[1] - x[1]].map(|v| v * self.exposure);
            let cut = (K.smear_longest / libm::hypot(d[0], d[1])).min(1.0);
            d.map(|v| v * cut)
        };
        let scale = base.unit / unit;
        let mut ways = AROUND.map(way);
        let length = |w: &[f64; 2]| libm::hypot(w[0], w[1]) * scale;
        let longest = ways.iter().map(length).fold(0.0, f64::max);
        if longest.is_nan() || longest < K.sharp {
            ways = [[0.0; 2]; 4];
        }
        let changed = |(a, b): (&[f64; 2], &[f64; 2])| length(&[a[0] - b[0], a[1] - b[1]]) > K.smear_same;
        let still = ways == [[0.0; 2]; 4];
        if rest.way == ways || !still && !ways.iter().zip(&rest.way).any(changed) {
            return;
        }
        rest.way = ways;
        if still {
            view.copy_template(&rest.view);
            return;
        }
        let n = view.len();
        let places = (longest.ceil() as usize).clamp(2, K.smear_places);
        self.ways.clear();
        let points = view.x.iter().zip(&view.y);
        self.ways.extend(points.map(|(x, y)| {
            let d = way([f64::from(*x), f64::from(*y)]);
            d.map(|v| (v * scale) as f32)
        }));
        let centre = base.centre.map(|v| (v / unit) as f32);
        for buffer in self
            .sum
            .iter_mut()
            .chain(&mut self.sample)
            .chain([&mut self.x, &mut self.y])
        {
            buffer.clear();
            buffer.resize(n, 0.0);
        }
        let image = template.level(level, 1).gray();
        let scale = scale as f32;
        for k in 0..places {
            let t = (k as f32 + 0.5) / places as f32 - 0.5;
            for i in 0..n {
                self.x[i] = centre[0] + scale * view.x[i] + t * self.ways[i][0];
                self.y[i] = centre[1] + scale * view.y[i] + t * self.ways[i][1];
            }
            let [value, gx, gy] = &mut self.sample;
            kernels::sample_gradient(image.view(0), Border::Replicate, &self.x, &self.y, value, gx, gy);
            for (sum, sample) in self.sum.iter_mut().zip(&self.sample) {
                sum.iter_mut().zip(sample).for_each(|(s, v)| *s += v);
            }
        }
        let share = 1.0 / places as f32;
        self.sum.iter_mut().flatten().for_each(|v| *v *= share);
        for i in 0..n {
            self.x[i] = centre[0] + scale * view.x[i];
            self.y[i] = centre[1] + scale * view.y[i];
        }
        let [value, gx, gy] = &self.sum;
        let covectors = Covectors {
            gx,
            gy,
            px: &self.x,
            py: &self.y,
            centre,
            scale,
            matrix: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            denominator: None,
        };
        kernels::steepest(&view.x, &view.y, &covectors, &columns(), 0, &mut view.own);
        view.work.col_mut(TEMPLATE).copy_from_slice(value);
        view.measure();
        debug_assert_eq!(view.own.cols(), WARP);
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        self.rest.iter().map(|r| r.view.memory()).sum::<usize>() + 40 * self.x.capacity()
    }
}
