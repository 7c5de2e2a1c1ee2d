//! How patches are sampled: what every search method that looks at pixels has in common.

use super::workspace::Buffers;
use crate::am::PatchShape;
use crate::image::Image;
use crate::kernels::{self, Border};
use crate::params::{Resolution, param_enum};
use crate::ssm::StateSpaceModel;
use crate::tracker::TrackError;

param_enum! {
    /// Image planes that are sampled.
    pub enum Channels {
        /// Gray.
        One = "1",
        /// Red, green, blue.
        Three = "3",
    }
}

impl Channels {
    /// As a number.
    pub fn count(self) -> usize {
        match self {
            Channels::One => 1,
            Channels::Three => 3,
        }
    }
}

param_enum! {
    /// What lies outside the image.
    pub enum BorderMode {
        /// 128, without gradient.
        Constant = "constant",
        /// The nearest pixel of the image.
        Replicate = "replicate",
    }
}

crate::params! {
    /// Parameters of patch sampling.
    pub struct SamplingParams {
        /// Sampling grid over the region, columns x rows.
        res: Resolution = Resolution { cols: 50, rows: 50 };
        /// Image planes: 1 (gray) or 3 (red, green, blue).
        channels: Channels = Channels::One;
        /// Samples outside the image: constant (128) or replicate (nearest pixel).
        border: BorderMode = BorderMode::Constant;
    }
}

/// Largest fraction of samples that may lie outside the image.
const MAX_OUTSIDE: f64 = 0.9;

impl SamplingParams {
    /// Shape of the patches.
    pub fn shape(&self) -> PatchShape {
        PatchShape {
            res: self.res,
            channels: self.channels.count(),
        }
    }

    fn border(&self) -> Border {
        match self.border {
            BorderMode::Constant => Border::Constant,
            BorderMode::Replicate => Border::Replicate,
        }
    }

    /// Samples values, and gradients if asked for, at the points in `b`. Fails when nearly all lie outside.
    pub(super) fn sample(&self, image: &Image, b: &mut Buffers, gradient: bool) -> Result<(), TrackError> {
        let n = b.x.len();
        let mut outside = 0;
        for c in 0..self.channels.count() {
            let plane = image.view(c);
            let at = c * n..(c + 1) * n;
            let out = &mut b.values[at.clone()];
            outside = if gradient {
                let (gx, gy) = (&mut b.gx[at.clone()], &mut b.gy[at]);
                kernels::sample_gradient(plane, self.border(), &b.x, &b.y, out, gx, gy)
            } else {
                kernels::sample(plane, self.border(), &b.x, &b.y, out)
            };
        }
        if outside as f64 > MAX_OUTSIDE * n as f64 {
            Err(TrackError::Outside)
        } else {
            Ok(())
        }
    }

    /// Gradient of the warped image in the base frame, by central differences over one pixel of the base: into the
    /// gradients of `b`, whose values stay.
    pub(super) fn sample_warped_gradient<S: StateSpaceModel>(&self, image: &Image, ssm: &S, b: &mut Buffers) {
        let n = b.x.len();
        let r = ssm.base().radius;
        let group = ssm.matrix_group();
        let h = 0.5 / r;
        let half = r as f32;
        for axis in 0..2 {
            for side in [1.0, -1.0] {
                let mut offset = [0.0; 2];
                offset[axis] = side * h;
                match group {
                    Some(warp) => warp.warp_offset_into(offset, &mut b.x, &mut b.y),
                    // The warped points move alike: right where the warp is a translation.
                    None => {
                        ssm.warp_into(&mut b.x, &mut b.y);
                        for (out, d) in [&mut b.x, &mut b.y].into_iter().zip(offset) {
                            out.iter_mut().for_each(|v| *v += (r * d) as f32);
                        }
                    }
                }
                for c in 0..self.channels.count() {
                    let at = c * n..(c + 1) * n;
                    let g = if axis == 0 { &mut b.gx } else { &mut b.gy };
                    let out = &mut g[at.clone()];
                    if side > 0.0 {
                        kernels::sample(image.view(c), self.border(), &b.x, &b.y, out);
                    } else {
                        let before = &mut b.scratch[at];
                        kernels::sample(image.view(c), self.border(), &b.x, &b.y, before);
                        out.iter_mut()
                            .zip(before)
                            .for_each(|(g, v)| *g = half * (*g - *v));
                    }
                }
            }
        }
        ssm.warp_into(&mut b.x, &mut b.y);
    }

    /// Image Hessians at the points in `b`, whose values have been sampled.
    pub(super) fn sample_hessian(&self, image: &Image, b: &mut Buffers) {
        let n = b.x.len();
        for h in &mut b.hessian {
            h.resize(n * self.channels.count(), 0.0);
        }
        for c in 0..self.channels.count() {
            let at = c * n..(c + 1) * n;
            let [xx, xy, yy] = &mut b.hessian;
            let out = [&mut xx[at.clone()], &mut xy[at.clone()], &mut yy[at.clone()]];
            kernels::image_hessian(image.view(c), self.border(), 1.0, &b.x, &b.y, &b.values[at], out);
        }
    }
}
