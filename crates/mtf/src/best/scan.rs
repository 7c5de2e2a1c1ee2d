//! The template, turned and scaled, compared block by block with a coarse level of the image at every place there.

use super::constants::K;
use super::view::Base;
use crate::geom::{Corners, Mat3, homography};
use crate::image::Frame;
use crate::interrupt;
use crate::kernels::{self, Border, SCAN_SLACK};

/// A pose at which the template agrees better than around it, and by how much: the mean of the cubed correlations of blocks
/// above that of all places, in standard deviations of those.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub pose: Mat3,
    pub contrast: f32,
}

/// Points of one block: where they end, and the box around them relative to the middle.
#[derive(Clone, Copy, Debug)]
struct Block {
    end: usize,
    low: [isize; 2],
    high: [isize; 2],
}

/// A point of the template: its block, its place relative to the middle, and in the template's image.
type Point = (usize, [isize; 2], [f32; 2]);

/// The template, and what comparing it takes.
#[derive(Debug, Default)]
pub(super) struct Scanner {
    template: Option<Frame>,
    base: Base,
    quad: Corners,
    points: Vec<Point>,
    tx: Vec<f32>,
    ty: Vec<f32>,
    value: Vec<f32>,
    blocks: Vec<Block>,
    offsets: Vec<usize>,
    values: Vec<f32>,
    plane: Vec<f32>,
    totals: Vec<f32>,
    inside: Vec<f32>,
}

impl Scanner {
    /// Learns the object at `corners`.
    pub fn learn(&mut self, frame: &Frame, corners: &Corners) {
        self.base = Base::of(corners);
        self.quad = Corners(corners.0.map(|c| self.base.of_image(c)));
        self.template = Some(frame.clone());
    }

    /// Level of the image for an object of some area, px²: the coarsest with enough points.
    fn level(frame: &Frame, area: f64) -> usize {
        let octaves = libm::log2((area / K.scan_points).max(1.0)) / 2.0;
        (octaves as usize).min(frame.levels() - 1)
    }

    /// Puts the template, as it looks at a pose, into blocks of pixels of a level around `middle`.
    fn carve(&mut self, pose: &Mat3, level: usize, middle: [isize; 2], width: usize) -> Option<()> {
        let unit = f64::from(1u32 << level);
        let corners = homography::apply_corners(pose, &self.quad);
        let area = corners.signed_area().abs();
        // The template's level of about the same sharpness.
        let zoom = libm::log2(area.sqrt() / (2.0 * self.base.unit));
        let template = self.template.as_ref()?;
        let from = (level as f64 - zoom)
            .round()
            .clamp(0.0, (template.levels() - 1) as f64) as usize;
        let from_unit = f64::from(1u32 << from);
        let back = pose.try_inverse()?;
        let square = homography::from_corners(&self.quad, &Corners::rect(0.0, 0.0, 1.0, 1.0))?;
        let along = (area.sqrt() / unit / K.scan_block)
            .round()
            .clamp(K.scan_blocks_least, K.scan_blocks_most);
        let range = |c: usize| {
            let values = corners.0.map(|p| p[c] / unit);
            let low = values.iter().fold(f64::INFINITY, |a, b| a.min(*b));
            let high = values.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
            low.ceil() as isize..=high.floor() as isize
        };
        self.points.clear();
        for y in range(1) {
            for x in range(0) {
                let at = homography::apply(&back, [x as f64 * unit, y as f64 * unit]);
                let st = homography::apply(&square, at);
                if st.iter().all(|v| (K.scan_inset..=1.0 - K.scan_inset).contains(v)) {
                    let block = (st[1] * along) as usize * along as usize + (st[0] * along) as usize;
                    let place = std::array::from_fn(|c| {
                        ((self.base.centre[c] + self.base.unit * at[c]) / from_unit) as f32
                    });
                    self.points.push((block, [x - middle[0], y - middle[1]], place));
                }
            }
        }
        // By block, and row by row in each: a sort that does not allocate does not keep the order.
        self.points.sort_unstable_by_key(|p| (p.0, p.1[1], p.1[0]));
        let image = template.level(from, 1).gray();
        self.tx.clear();
        self.ty.clear();
        self.tx.extend(self.points.iter().map(|p| p.2[0]));
        self.ty.extend(self.points.iter().map(|p| p.2[1]));
        self.value.resize(self.points.len(), 0.0);
        kernels::sample(
            image.view(0),
            Border::Replicate,
            &self.tx,
            &self.ty,
            &mut self.value,
        );
        self.blocks.clear();
        self.offsets.clear();
        self.values.clear();
        let mut first = 0;
        for points in self.points.chunk_by(|a, b| a.0 == b.0) {
            let values = &self.value[first..first + points.len()];
            first += points.len();
            let n = points.len() as f32;
            let mean = values.iter().sum::<f32>() / n;
            let norm = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>().sqrt();
            if points.len() < K.scan_block_points || norm < K.scan_texture * n.sqrt() {
                continue;
            }
            let bound = |c: usize, better: fn(isize, isize) -> isize| {
                points.iter().map(|p| p.1[c]).fold(points[0].1[c], better)
            };
            let low = [bound(0, isize::min), bound(1, isize::min)];
            let high = [bound(0, isize::max), bound(1, isize::max)];
            let offset = |p: &Point| (p.1[1] - low[1]) as usize * width + (p.1[0] - low[0]) as usize;
            self.offsets.extend(points.iter().map(offset));
            self.values.extend(values.iter().map(|v| (v - mean) / norm));
            let end = self.values.len();
            self.blocks.push(Block { end, low, high });
        }
        (!self.blocks.is_empty()).then_some(())
    }

    /// The best places for a pose that is shifted by up to `reach` px, its middle within the image, in whole pixels of a
    /// coarse level; appended to `found`. Interrupted, it finds none.
    pub fn scan(&mut self, frame: &Frame, pose: &Mat3, reach: f64, found: &mut Vec<Found>) {
        let area = homography::apply_corners(pose, &self.quad).signed_area().abs();
        if !area.is_finite() {
            return;
        }
        let level = Self::level(frame, area);
        let unit = f64::from(1u32 << level);
        let image = frame.level(level, 1).gray();
        let (width, height) = (image.width(), image.height());
        let centre = homography::apply(pose, [0.0; 2]).map(|v| v / unit);
        if !centre.iter().all(|v| v.abs() < 1e4) {
            return;
        }
        let middle = centre.map(|v| v.round() as isize);
        if self.carve(pose, level, middle, width).is_none() {
            return;
        }
        self.plane.clear();
        for y in 0..height {
            self.plane.extend(image.row(0, y).iter().map(|v| v - 128.0));
        }
        self.plane.resize(width * height + SCAN_SLACK, 0.0);
        let radius = (reach / unit).ceil().min((width + height) as f64) as isize;
        let range = |c: usize, size: usize| {
            let first = (middle[c] - radius).clamp(0, size as isize - 1);
            (first, (middle[c] + radius).clamp(first, size as isize - 1) + 1)
        };
        let ((left, right), (top, bottom)) = (range(0, width), range(1, height));
        let cols = (right - left) as usize;
        let count = cols * (bottom - top) as usize;
        self.totals.clear();
        self.totals.resize(count, 0.0);
        self.inside.clear();
        self.inside.resize(count, 0.0);
        let mut first = 0;
        for block in &self.blocks {
            if interrupt::requested() {
                return;
            }
            let points = first..block.end;
            first = block.end;
            // Places at which the block lies inside the image.
            let (a, b) = (left.max(-block.low[0]), right.min(width as isize - block.high[0]));
            let rows = top.max(-block.low[1])..bottom.min(height as isize - block.high[1]);
            if a >= b {
                continue;
            }
            for y in rows {
                let row = (y - top) as usize * cols;
                let at = row + (a - left) as usize..row + (b - left) as usize;
                let start = (y + block.low[1]) as usize * width + (a + block.low[0]) as usize;
                kernels::correlate_along(
                    &self.plane[start..],
                    &self.offsets[points.clone()],
                    &self.values[points.clone()],
                    &mut self.totals[at.clone()],
                );
                self.inside[at].iter_mut().for_each(|n| *n += 1.0);
            }
        }
        let blocks = self.blocks.len() as f32;
        let far = 1.0 / (radius * radius).max(1) as f32;
        for (i, (total, inside)) in self.totals.iter_mut().zip(&self.inside).enumerate() {
            let dx = left + (i % cols) as isize - middle[0];
            let dy = top + (i / cols) as isize - middle[1];
            *total /= inside + (blocks - inside) / K.scan_outside;
            *total -= K.scan_nearer * ((dx * dx + dy * dy) as f32 * far).sqrt();
        }
        // With few blocks more places look a little like the template.
        let n = count as f32;
        let mean = self.totals.iter().sum::<f32>() / n;
        let squares = self.totals.iter().map(|t| (t - mean) * (t - mean)).sum::<f32>();
        let spread = (squares / n).sqrt().max(K.scan_spread);
        let apart = ((K.scan_apart * area.sqrt() / unit) as isize).max(1);
        for _ in 0..K.scan_peaks {
            let best = (0..count).max_by(|a, b| self.totals[*a].total_cmp(&self.totals[*b]).then(b.cmp(a)));
            let Some(best) = best.filter(|b| self.totals[*b] > K.scan_faint) else {
                break;
            };
            let (x, y) = ((best % cols) as isize, (best / cols) as isize);
            let [dx, dy] = [left + x - middle[0], top + y - middle[1]].map(|d| d as f64 * unit);
            let shift = Mat3::new(1.0, 0.0, dx, 0.0, 1.0, dy, 0.0, 0.0, 1.0);
            found.push(Found {
                pose: shift * pose,
                contrast: (self.totals[best] - mean) / spread,
            });
            for y in (y - apart).max(0)..(y + apart + 1).min(bottom - top) {
                let row = y as usize * cols;
                let (a, b) = ((x - apart).max(0) as usize, (x + apart + 1) as usize);
                self.totals[row + a..row + b.min(cols)].fill(0.0);
            }
        }
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        4 * (self.plane.capacity() + 2 * self.totals.capacity()) + 64 * self.points.capacity()
    }
}
