//! How well the template agrees with an image at a pose, block by block.

use super::Aligner;
use crate::best::constants::K;
use crate::best::view::TEMPLATE;
use crate::geom::Mat3;
use crate::image::{Frame, Image};
use crate::kernels::{self, Border};

/// How well the template agrees with the image at a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::best) struct Score {
    /// Sum of the cubed correlations of the textured blocks inside the image, negative ones as 0, per such block;
    /// blocks outside count for a third of one.
    pub total: f64,
    /// Mean correlation of the best two fifths of the blocks inside.
    pub best: f64,
    /// Share of all textured blocks that agree.
    pub agree: f64,
    /// Number of blocks that agree.
    pub agreeing: usize,
}

/// A block in the present image.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    pub correlation: f64,
    pub gain: f64,
    pub visible: bool,
    pub weight: f64,
}

impl Aligner {
    /// Correlation, gain and visibility of each block, from the sampled values.
    pub(super) fn look(&mut self, view: usize, image: &Image, outside: usize) {
        let v = &self.views[view];
        let n = v.len();
        self.moments.resize(v.blocks.len(), [0.0; 3]);
        kernels::block_moments(v.work.col(TEMPLATE), &self.value[..n], &v.ends, &mut self.moments);
        self.seen.clear();
        let mut first = 0;
        let (right, bottom) = ((image.width() - 1) as f32, (image.height() - 1) as f32);
        for ((block, m), &last) in v.blocks.iter().zip(&self.moments).zip(&v.ends) {
            let within = |i: usize| {
                self.px[i] >= 0.0 && self.px[i] <= right && self.py[i] >= 0.0 && self.py[i] <= bottom
            };
            let visible = outside == 0 || (first..last).all(within);
            first = last;
            let mean = m[0] / block.count;
            let deviation = (m[1] / block.count - mean * mean).max(0.0).sqrt();
            let covariance = m[2] / block.count - mean * block.mean;
            let flat = deviation < K.flat || block.deviation < K.flat;
            self.seen.push(Seen {
                correlation: if flat {
                    0.0
                } else {
                    (covariance / (deviation * block.deviation)).clamp(-1.0, 1.0)
                },
                gain: (block.deviation / deviation.max(K.flat)).clamp(K.gain_least, K.gain_most),
                visible,
                weight: 0.0,
            });
        }
    }

    /// The score of what was last looked at.
    fn score(&mut self, view: usize) -> Score {
        let blocks = &self.views[view].blocks;
        let (mut outside, mut sum) = (0.0, 0.0);
        self.sorted.clear();
        for (_, s) in blocks.iter().zip(&self.seen).filter(|p| p.0.textured) {
            if s.visible {
                let z = s.correlation.max(0.0);
                sum += z * z * z;
                self.sorted.push(z);
            } else {
                outside += 1.0;
            }
        }
        if self.sorted.is_empty() {
            return Score::default();
        }
        self.sorted.sort_unstable_by(|a, b| b.total_cmp(a));
        let inside = self.sorted.len();
        let part = (inside * K.best_fifths).div_ceil(5);
        let agreeing = self.sorted.iter().filter(|z| **z >= K.agrees).count();
        Score {
            total: sum / (inside as f64 + outside / K.outside_blocks),
            best: self.sorted[..part].iter().sum::<f64>() / part as f64,
            agree: agreeing as f64 / (inside as f64 + outside),
            agreeing,
        }
    }

    /// Score of a pose on `points` points or more.
    pub fn assess(&mut self, frame: &Frame, pose: &Mat3, points: usize) -> Score {
        if !self.sound(pose, frame) {
            return Score::default();
        }
        let (view, level) = self.pair(pose, frame, self.judge(pose, frame, points));
        let image = frame.level(level, 1).gray();
        self.expose(pose, view);
        self.place(pose, view, level);
        let n = self.views[view].len();
        let (px, py) = (&self.px[..n], &self.py[..n]);
        let outside = kernels::sample(image.view(0), Border::Constant, px, py, &mut self.value[..n]);
        self.look(view, image, outside);
        self.score(view)
    }

    /// Blocks of the last assessed pose that agree: their centres in the base frame.
    pub fn agreeing(&self, frame: &Frame, pose: &Mat3, points: usize) -> impl Iterator<Item = [f64; 2]> + '_ {
        let (view, _) = self.pair(pose, frame, self.judge(pose, frame, points));
        let blocks = self.views[view].blocks.iter().zip(&self.seen);
        blocks
            .filter(|(b, s)| b.textured && s.visible && s.correlation >= K.agrees)
            .map(|(b, _)| b.centre)
    }
}
