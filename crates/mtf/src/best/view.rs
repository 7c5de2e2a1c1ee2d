//! The template at one level of the image pyramid: points on the pixels of that level inside the object, in blocks.

use super::constants::K;
use crate::geom::{Corners, homography};
use crate::image::{Frame, Image};
use crate::kernels::{self, Border, Column, Covectors, Jacobian};

/// Parameters of the homography group about the identity: every entry of the matrix but the last.
pub(super) const WARP: usize = 8;
/// Columns of a view's Jacobian beyond those: image, template and ones.
pub(super) const IMAGE: usize = WARP;
pub(super) const TEMPLATE: usize = WARP + 1;
pub(super) const ONES: usize = WARP + 2;
/// Origin and unit of the base frame in the template's frame, px: its coordinates are about -1 to 1.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Base {
    pub centre: [f64; 2],
    pub unit: f64,
}

impl Base {
    /// Centre and half the side of the square of the same area.
    pub fn of(corners: &Corners) -> Self {
        Base {
            centre: corners.centroid(),
            unit: corners.signed_area().abs().sqrt() / 2.0,
        }
    }

    pub fn of_image(&self, x: [f64; 2]) -> [f64; 2] {
        [
            (x[0] - self.centre[0]) / self.unit,
            (x[1] - self.centre[1]) / self.unit,
        ]
    }
}

/// A block of neighbouring points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    /// Its centre in the base frame.
    pub centre: [f64; 2],
    /// Number of points.
    pub count: f64,
    /// Mean of the template.
    pub mean: f64,
    /// Its standard deviation.
    pub deviation: f64,
    /// Whether there is anything to see.
    pub textured: bool,
    /// Column and row of the block.
    cell: (usize, usize),
}

/// Template, points and Jacobian of one level.
#[derive(Clone, Debug)]
pub(super) struct View {
    /// Points in the base frame.
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    /// Where each block ends.
    pub ends: Vec<usize>,
    pub blocks: Vec<Block>,
    /// Next to each block: where its neighbours end in the list of all neighbours.
    neighbour_ends: Vec<usize>,
    neighbours: Vec<usize>,
    /// Steepest-descent images of the template.
    pub own: Jacobian,
    /// The same averaged with those of an image, the image, the template, and ones.
    pub work: Jacobian,
}

/// The eight entries of the matrix of the homography group.
pub(super) fn columns() -> [Column; WARP] {
    std::array::from_fn(|k| Column::new(std::array::from_fn(|e| if e == k { 1.0 } else { 0.0 })))
}

/// Variance of the image over points.
fn variance(image: &Image, points: &[([f64; 2], usize, usize)]) -> f64 {
    let n = points.len().max(1) as f64;
    let value = |p: &([f64; 2], usize, usize)| f64::from(image.get(0, p.1, p.2));
    let mean = points.iter().map(value).sum::<f64>() / n;
    points.iter().map(|p| (value(p) - mean).powi(2)).sum::<f64>() / n
}

impl View {
    /// The object at `corners` of `frame` at a level, with at most about `most` points; `None` when that is too small.
    pub fn new(frame: &Frame, corners: &Corners, base: &Base, level: usize, most: usize) -> Option<Self> {
        if level >= frame.levels() {
            return None;
        }
        let unit = f64::from(1u32 << level);
        let image = frame.level(level, 1).gray();
        let quad = Corners(corners.0.map(|c| c.map(|v| v / unit)));
        let square = homography::from_corners(&quad, &Corners::rect(0.0, 0.0, 1.0, 1.0))?;
        let side = |a: usize, b: usize| libm::hypot(quad.0[a][0] - quad.0[b][0], quad.0[a][1] - quad.0[b][1]);
        let sides = [(side(0, 1) + side(2, 3)) / 2.0, (side(1, 2) + side(3, 0)) / 2.0];
        let mut stride = 1usize;
        while sides[0] * sides[1] > (most * stride * stride) as f64 {
            stride += 1;
        }
        // What is next to the object at the border is not part of it.
        let inset = sides.map(|s| (K.view_inset / s).min(K.view_inset_share));
        let bounds = |c: usize, size: usize| {
            let low = quad.0.iter().map(|p| p[c]).fold(f64::INFINITY, f64::min);
            let high = quad.0.iter().map(|p| p[c]).fold(f64::NEG_INFINITY, f64::max);
            let last = (size - 1) as f64;
            (low.ceil().clamp(0.0, last) as usize)..=(high.floor().clamp(0.0, last) as usize)
        };
        let mut points = Vec::new();
        for y in bounds(1, image.height()).step_by(stride) {
            for x in bounds(0, image.width()).step_by(stride) {
                let at = homography::apply(&square, [x as f64, y as f64]);
                let within = |c: usize| at[c] >= inset[c] && at[c] <= 1.0 - inset[c];
                if within(0) && within(1) {
                    points.push((at, x, y));
                }
            }
        }
        // Blocks so large that there is something to see in most of them.
        let mut side = K.block_side;
        let (mut px, mut py, mut ends, mut cells);
        loop {
            let grid = sides.map(|s| {
                let points = s / stride as f64;
                let least = if side == K.block_side {
                    K.blocks_least
                } else {
                    K.blocks_plain
                };
                let wanted = (points / side).round().clamp(least, K.blocks_most.max(least));
                wanted.min((points / K.block_pitch).floor()).max(1.0)
            });
            let cell = |p: &([f64; 2], usize, usize)| {
                (p.0[1] * grid[1]) as usize * grid[0] as usize + (p.0[0] * grid[0]) as usize
            };
            points.sort_by_key(|p| (cell(p), p.2, p.1));
            (px, py, ends, cells) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
            let (mut within, mut blocks) = (Vec::new(), 0.0);
            for block in points.chunk_by(|a, b| cell(a) == cell(b)) {
                if block.len() >= K.block_points {
                    px.extend(block.iter().map(|p| p.1 as f32));
                    py.extend(block.iter().map(|p| p.2 as f32));
                    ends.push(px.len());
                    let cell = cell(&block[0]);
                    cells.push((cell % grid[0] as usize, cell / grid[0] as usize));
                    within.push(variance(image, block));
                    blocks += 1.0;
                }
            }
            within.sort_unstable_by(f64::total_cmp);
            let usual = within.get(within.len() / 2).copied().unwrap_or(0.0);
            if usual >= K.block_content * variance(image, &points)
                || blocks <= K.blocks_plain * K.blocks_plain
            {
                break;
            }
            side *= K.block_growth;
        }
        let n = px.len();
        if n < K.view_points {
            return None;
        }
        let (mut value, mut gx, mut gy) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let grid = image.view(0);
        kernels::sample_gradient(grid, Border::Replicate, &px, &py, &mut value, &mut gx, &mut gy);
        let to_base = |v: f32, c: usize| ((f64::from(v) * unit - base.centre[c]) / base.unit) as f32;
        let x: Vec<f32> = px.iter().map(|&v| to_base(v, 0)).collect();
        let y: Vec<f32> = py.iter().map(|&v| to_base(v, 1)).collect();
        let covectors = Covectors {
            gx: &gx,
            gy: &gy,
            px: &px,
            py: &py,
            centre: base.centre.map(|v| (v / unit) as f32),
            scale: (base.unit / unit) as f32,
            matrix: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            denominator: None,
        };
        let mut own = Jacobian::new(n, WARP);
        kernels::steepest(&x, &y, &covectors, &columns(), 0, &mut own);
        let mut work = Jacobian::new(n, WARP + 3);
        work.col_mut(TEMPLATE).copy_from_slice(&value);
        work.col_mut(ONES).fill(1.0);
        let mut first = 0;
        let blocks = ends.iter().zip(cells).map(|(&last, cell)| {
            let range = first..last;
            first = last;
            let mean =
                |v: &[f32]| v[range.clone()].iter().map(|v| f64::from(*v)).sum::<f64>() / range.len() as f64;
            Block {
                centre: [mean(&x), mean(&y)],
                count: range.len() as f64,
                mean: 0.0,
                deviation: 0.0,
                textured: false,
                cell,
            }
        });
        let blocks: Vec<Block> = blocks.collect();
        let (mut neighbours, mut neighbour_ends) = (Vec::new(), Vec::new());
        for a in &blocks {
            let beside = |b: &Block| a.cell.0.abs_diff(b.cell.0) + a.cell.1.abs_diff(b.cell.1) == 1;
            neighbours.extend((0..blocks.len()).filter(|&k| beside(&blocks[k])));
            neighbour_ends.push(neighbours.len());
        }
        let mut view = View {
            x,
            y,
            ends,
            blocks,
            neighbour_ends,
            neighbours,
            own,
            work,
        };
        view.measure();
        Some(view)
    }

    /// Takes note of mean and contrast of the template in each block.
    pub fn measure(&mut self) {
        let mut first = 0;
        let value = self.work.col(TEMPLATE);
        for (block, &last) in self.blocks.iter_mut().zip(&self.ends) {
            let values = value[first..last].iter().map(|v| f64::from(*v));
            first = last;
            block.mean = values.clone().sum::<f64>() / block.count;
            let squares = values.map(|v| (v - block.mean).powi(2)).sum::<f64>();
            block.deviation = (squares / block.count).sqrt();
            block.textured = block.deviation >= K.texture;
        }
    }

    /// Takes over the template of a view with the same points.
    pub fn copy_template(&mut self, other: &View) {
        self.work
            .col_mut(TEMPLATE)
            .copy_from_slice(other.work.col(TEMPLATE));
        self.own.copy_from(&other.own);
        self.blocks.copy_from_slice(&other.blocks);
    }

    /// The blocks beside a block.
    pub fn beside(&self, block: usize) -> &[usize] {
        let first = if block == 0 {
            0
        } else {
            self.neighbour_ends[block - 1]
        };
        &self.neighbours[first..self.neighbour_ends[block]]
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        self.own.memory() + self.work.memory() + 8 * self.len() + 64 * self.blocks.len()
    }
}
