//! Selective pixel integration: which points of the patch a search uses, judged anew with each patch.
//!
//! | rule | keeps a point when |
//! |---|---|
//! | pixel | the patches differ there by less than a share of the template's range, in the model's own units (its feature) |
//! | gradient | the image gradient is steeper than a threshold |
//! | gftt | it is near a corner of the patch (Shi & Tomasi 1994), found once per frame |
//!
//! A composite may hold points back besides, by marks on a grid over the object: those of RKLT's leader that agree.
//!
//! When fewer than four points per parameter, or a tenth of all, remain, all are used. Of several channels, `pixel` asks all
//! of them, `gradient` any; corners are those of the channels' summed structure tensors.

use crate::am::{AppearanceModel, PatchShape};
use crate::kernels;
use crate::params::{Resolution, param_enum};
use crate::sm::workspace::Buffers;
use crate::tracker::{Marks, TrackError};

param_enum! {
    /// Which points of the patch are used.
    pub enum PointRule {
        /// All.
        None = "none",
        /// Where the patches are similar.
        Pixel = "pixel",
        /// Where the image has a gradient.
        Gradient = "gradient",
        /// Near corners of the patch.
        Gftt = "gftt",
    }
}

crate::params! {
    /// Parameters of selective pixel integration.
    pub struct MaskParams {
        /// Points used: none (no selection), pixel (small difference), gradient (steep), gftt (near good features).
        spi: PointRule = PointRule::None;
        /// Rule pixel: largest difference, as a share of the template's range of gray levels.
        spi_difference: f64 = 0.25, in 1e-6..=1.0;
        /// Rule gradient: least gradient, gray levels per px.
        spi_gradient: f64 = 0.5, in 0.0..=255.0;
        /// Rule gftt: least quality of a corner, as a share of the best one's.
        spi_quality: f64 = 0.001, in 1e-9..=1.0;
        /// Rule gftt: most corners.
        spi_corners: usize = 1000, in 1..=1_000_000;
        /// Rule gftt: points up to this many grid points from a corner along each axis are kept.
        spi_reach: usize = 2, in 0..=100;
        /// Rules gradient and gftt: points that pass on the template are kept as well.
        spi_union: bool = false;
    }
}

/// The points in use.
#[derive(Debug, Default)]
pub(super) struct Mask {
    params: MaskParams,
    /// 1 for each point of the template that passes; empty without `spi_union`.
    of_template: Vec<f32>,
    /// Features of both patches.
    template: Vec<f32>,
    current: Vec<f32>,
    limit: f32,
    /// 1 for each value in use.
    values: Vec<f32>,
    /// 1 for each point that is not held back; empty when none is. Whether that is new.
    free: Vec<f32>,
    changed: bool,
    /// The patch to come is the first of its frame.
    new_frame: bool,
    corners: Corners,
}

impl Mask {
    pub fn new(params: MaskParams) -> Self {
        Mask {
            params,
            ..Mask::default()
        }
    }

    /// Whether points are selected at all.
    pub fn selects(&self) -> bool {
        self.params.spi != PointRule::None || self.changed || !self.free.is_empty()
    }

    /// Holds back the points of a patch whose nearest point of a grid over the object is not marked; none with `None`. Allocates
    /// the first time.
    pub fn hold(&mut self, shape: PatchShape, marked: Option<Marks<'_>>) {
        self.changed = marked.is_some() || !self.free.is_empty();
        self.free.clear();
        let Some(Marks { size, marks }) = marked else {
            return;
        };
        let Resolution { cols, rows } = shape.res;
        for y in 0..rows {
            let row = &marks[y * size.rows / rows * size.cols..][..size.cols];
            self.free
                .extend((0..cols).map(|x| f32::from(row[x * size.cols / cols])));
        }
        self.values.resize(shape.len(), 1.0);
    }

    /// Whether the rule reads image gradients.
    pub fn reads_gradient(&self) -> bool {
        self.params.spi == PointRule::Gradient
    }

    /// Takes the template's patch; all points are in use. `am` has it as template.
    pub fn start<A: AppearanceModel>(
        &mut self,
        shape: PatchShape,
        b: &Buffers,
        am: &mut A,
    ) -> Result<(), TrackError> {
        if self.params.spi == PointRule::None {
            return Ok(());
        }
        if am.masking().is_none() {
            return Err(TrackError::Unable(
                "the appearance model has no weights of single pixels",
            ));
        }
        self.values = vec![1.0; shape.len()];
        self.of_template = Vec::new();
        match self.params.spi {
            PointRule::None => {}
            PointRule::Pixel => {
                let distances = am
                    .distances()
                    .ok_or(TrackError::Unable("the appearance model has no feature"))?;
                self.template = vec![0.0; distances.feature_len()];
                self.current = self.template.clone();
                distances.feature_into(&b.values, &mut self.template);
                let low = self.template.iter().copied().fold(f32::INFINITY, f32::min);
                let high = self.template.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                self.limit = self.params.spi_difference as f32 * (high - low);
            }
            PointRule::Gradient => {
                if self.params.spi_union {
                    self.of_template = vec![0.0; shape.res.len()];
                    steep(&self.params, b, &mut self.of_template);
                }
            }
            PointRule::Gftt => {
                self.corners.resize(shape);
                if self.params.spi_union {
                    self.of_template = vec![0.0; shape.res.len()];
                    self.corners
                        .mark(&self.params, shape, &b.values, &mut self.of_template);
                }
            }
        }
        Ok(())
    }

    pub fn begin_frame(&mut self) {
        self.new_frame = true;
    }

    /// Selects points for the patch in `b` and tells the model; `dof` is the number of parameters of the search.
    pub fn apply<A: AppearanceModel>(&mut self, shape: PatchShape, b: &Buffers, dof: usize, am: &mut A) {
        let (changed, new_frame) = (
            std::mem::take(&mut self.changed),
            std::mem::take(&mut self.new_frame),
        );
        match self.params.spi {
            PointRule::None if !changed => return,
            PointRule::None if self.free.is_empty() => {
                if let Some(model) = am.masking() {
                    model.set_mask(&[]);
                }
                return;
            }
            PointRule::Gftt if !(new_frame || changed) => return,
            _ => {}
        }
        let points = shape.res.len();
        let (first, rest) = self.values.split_at_mut(points);
        match self.params.spi {
            PointRule::None => first.fill(1.0),
            PointRule::Pixel => {
                if let Some(distances) = am.distances() {
                    distances.feature_into(&b.values, &mut self.current);
                }
                first.fill(1.0);
                for (current, template) in self
                    .current
                    .chunks_exact(points)
                    .zip(self.template.chunks_exact(points))
                {
                    kernels::keep_close(current, template, self.limit, first);
                }
            }
            PointRule::Gradient => {
                first.fill(0.0);
                steep(&self.params, b, first);
            }
            PointRule::Gftt => {
                first.fill(0.0);
                self.corners.mark(&self.params, shape, &b.values, first);
            }
        }
        for (v, t) in first.iter_mut().zip(&self.of_template) {
            *v = v.max(*t);
        }
        for (v, free) in first.iter_mut().zip(&self.free) {
            *v *= free;
        }
        let kept = kernels::sum(first);
        let enough = kept >= (4 * dof) as f64 && kept >= 0.1 * points as f64;
        rest.chunks_exact_mut(points)
            .for_each(|c| c.copy_from_slice(first));
        if let Some(model) = am.masking() {
            model.set_mask(if enough { &self.values } else { &[] });
        }
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        let lists = [
            &self.of_template,
            &self.template,
            &self.current,
            &self.values,
            &self.free,
        ];
        4 * lists.iter().map(|l| l.len()).sum::<usize>() + self.corners.memory()
    }
}

/// Marks points of steep gradient in any channel.
fn steep(params: &MaskParams, b: &Buffers, out: &mut [f32]) {
    let n = out.len();
    for (gx, gy) in b.gx.chunks_exact(n).zip(b.gy.chunks_exact(n)) {
        kernels::add_steep(gx, gy, params.spi_gradient as f32, out);
    }
}

/// Corner detector on the grid of a patch.
#[derive(Debug, Default)]
struct Corners {
    /// Products of derivatives `xx, xy, yy`, summed over channels.
    tensor: [Vec<f32>; 3],
    /// Smaller eigenvalue of the tensor summed over 3x3 points.
    strength: Vec<f32>,
    found: Vec<usize>,
}

impl Corners {
    fn resize(&mut self, shape: PatchShape) {
        let n = shape.res.len();
        self.tensor = std::array::from_fn(|_| vec![0.0; n]);
        self.strength = vec![0.0; n];
        self.found = Vec::with_capacity(n);
    }

    fn memory(&self) -> usize {
        4 * self.strength.len() * 4 + 8 * self.found.capacity()
    }

    /// Sets `out` to 1 around each corner of a patch.
    fn mark(&mut self, params: &MaskParams, shape: PatchShape, patch: &[f32], out: &mut [f32]) {
        let (w, h) = (shape.res.cols, shape.res.rows);
        let around = |k: usize, n: usize, r: usize| k.saturating_sub(r)..(k + r + 1).min(n);
        let [xx, xy, yy] = &mut self.tensor;
        for t in [&mut *xx, &mut *xy, &mut *yy] {
            t.fill(0.0);
        }
        for plane in patch.chunks_exact(w * h) {
            for y in 0..h {
                for x in 0..w {
                    let (dx, dy) = (around(x, w, 1), around(y, h, 1));
                    let gx = (plane[y * w + dx.end - 1] - plane[y * w + dx.start]) / (dx.len() - 1) as f32;
                    let gy = (plane[(dy.end - 1) * w + x] - plane[dy.start * w + x]) / (dy.len() - 1) as f32;
                    let i = y * w + x;
                    xx[i] += gx * gx;
                    xy[i] += gx * gy;
                    yy[i] += gy * gy;
                }
            }
        }
        let mut best = 0.0f32;
        for y in 0..h {
            for x in 0..w {
                let sum = |t: &[f32]| {
                    let rows = around(y, h, 1).map(|v| t[v * w..][around(x, w, 1)].iter().sum::<f32>());
                    rows.sum::<f32>()
                };
                let (a, b, c) = (sum(xx), sum(xy), sum(yy));
                let strength = 0.5 * (a + c) - (0.25 * (a - c) * (a - c) + b * b).sqrt();
                self.strength[y * w + x] = strength;
                best = best.max(strength);
            }
        }
        let least = params.spi_quality as f32 * best;
        let strength = &self.strength;
        let peak = |i: usize| {
            let (x, y) = (i % w, i / w);
            let highest = around(y, h, 1)
                .flat_map(|v| strength[v * w..][around(x, w, 1)].iter())
                .all(|s| *s <= strength[i]);
            highest && strength[i] > least
        };
        self.found.clear();
        self.found.extend((0..w * h).filter(|&i| peak(i)));
        // Strongest first, the upper left one of equals.
        self.found
            .sort_unstable_by(|&i, &j| strength[j].total_cmp(&strength[i]).then(i.cmp(&j)));
        for &i in self.found.iter().take(params.spi_corners) {
            let (x, y) = (i % w, i / w);
            for v in around(y, h, params.spi_reach) {
                out[v * w..][around(x, w, params.spi_reach)].fill(1.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::am::Ssd;
    use crate::params::Resolution;

    /// Whether a search of `dof` parameters uses the selection when `kept` of 400 points pass.
    fn selected(kept: usize, dof: usize) -> bool {
        let shape = PatchShape {
            res: Resolution { cols: 20, rows: 20 },
            channels: 1,
        };
        let template: Vec<f32> = (0..400).map(|i| (i * 37 % 101) as f32).collect();
        let mut am = Ssd::default();
        am.set_template(shape, &template).unwrap();
        let mut b = Buffers {
            values: template,
            ..Buffers::default()
        };
        let mut mask = Mask::new(MaskParams {
            spi: PointRule::Pixel,
            ..MaskParams::default()
        });
        mask.start(shape, &b, &mut am).unwrap();
        // The points that pass are those of the template; the others are far from it.
        b.values.iter_mut().skip(kept).for_each(|v| *v += 200.0);
        mask.apply(shape, &b, dof, &mut am);
        am.set_current(&b.values);
        am.similarity() == 0.0
    }

    #[test]
    fn four_points_a_parameter_and_a_tenth_of_all_must_remain() {
        assert_eq!([39, 40, 41].map(|kept| selected(kept, 8)), [false, true, true]);
        assert_eq!([59, 60, 61].map(|kept| selected(kept, 15)), [false, true, true]);
        assert!(selected(400, 8) && !selected(0, 8));
    }
}
