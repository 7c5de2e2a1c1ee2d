//! Robust Gauss-Newton steps at one level of the pyramid.
//!
//! This is a second ESM beside that of `sm`, for two reasons. Blocks that are weighed whole need their own Gram matrices,
//! and a start is judged and given up before it costs fine levels. With the shared ESM in its place
//! (`pyramid(esm/zncc/homography{res=60x60}; levels=4)`, thirteen sequences of `scripts/best`, 403 frames) `best` takes
//! 13.3 ms of the processor per frame instead of 7.5, decoding included; 93.8 % of the frames are within 5 px instead of
//! 96.0 %, and the mean error is 1.24 px instead of 1.02.

use super::Aligner;
use crate::best::constants::K;
use crate::best::view::{IMAGE, ONES, TEMPLATE, WARP};
use crate::geom::solve::{SymMatrix, solve_negative};
use crate::geom::{Mat3, homography};
use crate::image::Frame;
use crate::kernels::{self, Border, Covectors};

/// Normal equations with what gain and bias of the image may be projected out.
#[derive(Clone, Copy, Debug, Default)]
struct Equations {
    h: [[f64; WARP]; WARP],
    g: [f64; WARP],
    /// Sum of the squared residuals.
    left: f64,
}

impl Equations {
    /// Adds those of points whose columns have the Gram matrix `m`.
    fn add(&mut self, m: &SymMatrix, weight: f64, order: usize) {
        let centred = |a: usize, b: usize| m.get(a, b) - m.get(a, ONES) * m.get(b, ONES) / m.get(ONES, ONES);
        let contrast = centred(IMAGE, IMAGE);
        if contrast <= 0.0 || contrast.is_nan() {
            return;
        }
        let along: [f64; TEMPLATE + 1] = std::array::from_fn(|a| centred(a, IMAGE));
        let freed = |a: usize, b: usize| weight * (centred(a, b) - along[a] * along[b] / contrast);
        for a in 0..order {
            for b in a..order {
                self.h[a][b] += freed(a, b);
            }
            self.g[a] += freed(a, TEMPLATE);
        }
        self.left += freed(TEMPLATE, TEMPLATE);
    }
}

/// Pairs of entries whose sum and difference over two are expected to be small, with the kinds of what is expected: shift, scale
/// and stretch, turn and shear, perspective.
const KINDS: [(usize, usize, usize, usize); 4] = [(2, 5, 0, 0), (0, 4, 1, 2), (3, 1, 2, 1), (6, 7, 3, 3)];

impl Equations {
    /// Adds that the warp since the start, `I + deviation`, is expected to be small, with residuals of variance `noise`.
    fn expect(&mut self, deviation: &Mat3, noise: f64) {
        let entry = |k: usize| deviation[(k / 3, k % 3)];
        let expected = [
            K.expected_shift,
            K.expected_turn,
            K.expected_stretch,
            K.expected_tilt,
        ];
        for (a, b, sum, difference) in KINDS {
            let [u, v] = [sum, difference].map(|k| K.alike * noise / (expected[k] * expected[k]) / 2.0);
            // u (p_a + p_b)² / 2 + v (p_a - p_b)² / 2
            let (same, cross) = ((u + v) / 2.0, (u - v) / 2.0);
            self.h[a][a] += same;
            self.h[b][b] += same;
            self.h[a.min(b)][a.max(b)] += cross;
            self.g[a] -= same * entry(a) + cross * entry(b);
            self.g[b] -= same * entry(b) + cross * entry(a);
        }
    }
}

impl Aligner {
    /// Weighs the blocks with a cut of at least `least`; what blocks beside it say counts for a third of a block's misfit,
    /// for what covers an object is connected.
    fn weigh(&mut self, view: usize, least: f64) {
        let view = &self.views[view];
        let counts = |k: usize| view.blocks[k].textured && self.seen[k].visible;
        self.misfits.clear();
        for (k, s) in self.seen.iter().enumerate() {
            let own = (1.0 - s.correlation).sqrt();
            let (mut sum, mut n) = (0.0, 0.0);
            for &b in view.beside(k).iter().filter(|b| counts(**b)) {
                sum += (1.0 - self.seen[b].correlation).sqrt();
                n += 1.0;
            }
            let around = if n > 0.0 { sum / n } else { own };
            self.misfits
                .push((K.own_weight * own + around.max(own)) / (K.own_weight + 1.0));
        }
        self.sorted.clear();
        let counted = (0..self.seen.len()).filter(|k| counts(*k));
        self.sorted.extend(counted.map(|k| self.misfits[k]));
        if self.sorted.is_empty() {
            return;
        }
        let rank = self.sorted.len() * K.low_tenths / 10;
        let low = *self.sorted.select_nth_unstable_by(rank, f64::total_cmp).1;
        let cut = (K.cut_ratio * low).clamp(least, K.cut_most.max(least));
        for ((b, s), misfit) in view.blocks.iter().zip(&mut self.seen).zip(&self.misfits) {
            let t = 1.0 - (misfit / cut).powi(2);
            s.weight = if b.textured && s.visible && t > 0.0 {
                t * t
            } else {
                0.0
            };
        }
    }

    /// Improves a pose at one level by at most `iterations` steps; how many it took, or `None` when it fails.
    pub(super) fn refine(
        &mut self,
        frame: &Frame,
        pose: &mut Mat3,
        k: usize,
        iterations: u32,
        epsilon: f64,
    ) -> Option<u32> {
        let (view, level) = self.pair(pose, frame, k);
        let image = frame.level(level, 1).gray();
        let unit = f64::from(1u32 << level);
        let columns = self.columns?;
        self.expose(pose, view);
        for iteration in 1..=iterations {
            let (matrix, centre, scale) = self.place(pose, view, level);
            let n = self.views[view].len();
            let outside = kernels::sample_gradient(
                image.view(0),
                Border::Constant,
                &self.px[..n],
                &self.py[..n],
                &mut self.value[..n],
                &mut self.gx[..n],
                &mut self.gy[..n],
            );
            self.look(view, image, outside);
            self.weigh(
                view,
                if iteration <= K.wide_steps {
                    K.wide_cut
                } else {
                    K.cut_least
                },
            );
            let v = &mut self.views[view];
            let mut first = 0;
            for (s, &last) in self.seen.iter().zip(&v.ends) {
                let gain = s.gain as f32;
                for g in self.gx[first..last].iter_mut().chain(&mut self.gy[first..last]) {
                    *g *= gain;
                }
                first = last;
            }
            let covectors = Covectors {
                gx: &self.gx[..n],
                gy: &self.gy[..n],
                px: &self.px[..n],
                py: &self.py[..n],
                centre,
                scale,
                matrix,
                denominator: Some([matrix[6], matrix[7], matrix[8]]),
            };
            kernels::steepest(&v.x, &v.y, &covectors, &columns, 0, &mut v.work);
            for k in 0..WARP {
                for (a, b) in v.work.col_mut(k).iter_mut().zip(v.own.col(k)) {
                    *a = 0.5 * (*a + b);
                }
            }
            v.work.col_mut(IMAGE).copy_from_slice(&self.value[..n]);
            let order = if n < K.projective_points { 6 } else { WARP };
            let deviation = self.anchor * *pose;
            let deviation = deviation / deviation[(2, 2)] - Mat3::identity();
            let step = self.step(view, order, &deviation)?;
            let p = Mat3::new(
                step[0], step[1], step[2], step[3], step[4], step[5], step[6], step[7], 0.0,
            );
            let next = *pose * (Mat3::identity() + p + p * p * 0.5);
            let next = next / next[(2, 2)];
            if !self.sound(&next, frame) {
                return None;
            }
            // How far what is seen moves.
            let (mut sum, mut n) = (0.0, 0.0);
            for x in self.inside(pose, frame) {
                let (a, b) = (homography::apply(pose, x), homography::apply(&next, x));
                sum += (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
                n += 1.0;
            }
            let moved = (sum / n).sqrt();
            // No point in sight leaves no number.
            if moved.is_nan() || moved >= K.step_limit * self.base.unit * libm::exp2(self.zoom(pose, frame)?)
            {
                return None;
            }
            *pose = next;
            if moved < epsilon * unit {
                return Some(iteration);
            }
        }
        Some(iterations)
    }

    /// The Gauss-Newton step of the weighted blocks in the first `order` parameters. One gain and bias serve all blocks,
    /// which keeps what tells blocks apart, unless the light calls for one of each block.
    fn step(&mut self, view: usize, order: usize, deviation: &Mat3) -> Option<[f64; WARP]> {
        let v = &self.views[view];
        let mut each = Equations::default();
        self.sum.scale(0.0);
        let mut first = 0;
        for (s, &last) in self.seen.iter().zip(&v.ends) {
            let rows = (first, last);
            first = last;
            if s.weight > 0.0 {
                kernels::block_gram(&v.work, rows.0, rows.1, &mut self.gram);
                each.add(&self.gram, s.weight, order);
                self.sum.blend(1.0, s.weight, &self.gram);
            }
        }
        let mut one = Equations::default();
        one.add(&self.sum, 1.0, order);
        let used = if one.left < K.uneven * each.left {
            &mut one
        } else {
            &mut each
        };
        let noise = (used.left / self.sum.get(ONES, ONES).max(1.0)).max(K.noise);
        used.expect(deviation, noise);
        if self.system.order() != order {
            self.system = SymMatrix::new(order);
        }
        self.system.fill(|a, b| -used.h[a.min(b)][a.max(b)]);
        let (mut x, mut work) = ([0.0; WARP], [0.0; WARP * WARP + WARP]);
        let g = used.g.map(|v| -v);
        solve_negative(&self.system, K.damping, &g[..order], &mut x[..order], &mut work).then_some(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Jacobian;

    #[test]
    fn gain_and_bias_leave_nothing_to_explain() {
        let n = 40;
        let mut columns = Jacobian::new(n, WARP + 3);
        for i in 0..n {
            for k in 0..WARP {
                columns.col_mut(k)[i] = ((i * (2 * k + 3) + k) % 19) as f32 - 9.0;
            }
            let template = ((i * i + 3 * i) % 23) as f32;
            columns.col_mut(TEMPLATE)[i] = template;
            columns.col_mut(IMAGE)[i] = 0.6 * template + 31.0;
            columns.col_mut(ONES)[i] = 1.0;
        }
        let mut gram = SymMatrix::new(WARP + 3);
        kernels::block_gram(&columns, 0, n, &mut gram);
        let mut equations = Equations::default();
        equations.add(&gram, 1.0, WARP);
        assert!(equations.left.abs() < 0.1, "{}", equations.left);
        let steepest = |k: usize| equations.g[k].abs() / equations.h[k][k].sqrt();
        assert!((0..WARP).all(|k| steepest(k) < 0.05), "{equations:?}");
        // An image without contrast says nothing.
        columns.col_mut(IMAGE).fill(7.0);
        kernels::block_gram(&columns, 0, n, &mut gram);
        let mut nothing = Equations::default();
        nothing.add(&gram, 1.0, WARP);
        assert_eq!(nothing.left, 0.0);
    }
}
