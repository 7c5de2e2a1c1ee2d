//! Key points and descriptors of a part of a frame, over scales.

use super::detect::{Corner, Picker};
use super::pattern::{TURNS, describe};
use crate::image::{Frame, Image};
use crate::kernels::{self, Bits, Border, CENTROID_RADIUS, blur};

/// Number of scales, a third of an octave apart.
pub const SCALES: usize = 8;
/// Ratio of successive scales, `2^(1/3)`.
const STEP: f64 = 1.259_921_049_894_873_2;
/// Each scale has this share of the points of the one below it.
const SHARE: f64 = 0.8;
/// Least distance of a key point from the border of its image, px there.
const MARGIN: usize = CENTROID_RADIUS + 1;
/// Least response of a corner, (intensity/px)².
const LEAST: f32 = 1.0;
/// Smoothing before corners are sought and brightness is compared.
const SMOOTH: [f32; 7] = [
    0.036_633, 0.111_281, 0.216_745, 0.270_682, 0.216_745, 0.111_281, 0.036_633,
];

/// A key point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyPoint {
    /// Place in the frame, px.
    pub at: [f32; 2],
    /// Scale, in thirds of an octave: it was found in the frame reduced by `2^(scale/3)`.
    pub scale: u8,
    /// Direction of the intensity centroid, in 64ths of a turn.
    pub turn: u8,
}

/// Part of a frame: columns `x0..=x1`, rows `y0..=y1`, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// First column.
    pub x0: f64,
    /// First row.
    pub y0: f64,
    /// Last column.
    pub x1: f64,
    /// Last row.
    pub y1: f64,
}

impl Region {
    /// All of a frame.
    pub fn whole(frame: &Frame) -> Self {
        Region {
            x0: 0.0,
            y0: 0.0,
            x1: (frame.width() - 1) as f64,
            y1: (frame.height() - 1) as f64,
        }
    }

    /// The smallest one around `points`, grown by `margin` px on each side.
    pub fn around(points: &[[f64; 2]], margin: f64) -> Self {
        let least = |c: usize| points.iter().map(|p| p[c]).fold(f64::INFINITY, f64::min) - margin;
        let most = |c: usize| points.iter().map(|p| p[c]).fold(f64::NEG_INFINITY, f64::max) + margin;
        Region {
            x0: least(0),
            y0: least(1),
            x1: most(0),
            y1: most(1),
        }
    }

    /// Whether this part of the frame holds the points, those outside the frame moved to its border.
    pub fn holds(&self, points: &[[f64; 2]], frame: &Frame) -> bool {
        let whole = Region::whole(frame);
        points.iter().all(|p| {
            let x = p[0].clamp(whole.x0, whole.x1);
            let y = p[1].clamp(whole.y0, whole.y1);
            self.contains(x, y)
        })
    }

    fn contains(&self, x: f64, y: f64) -> bool {
        x >= self.x0 && x <= self.x1 && y >= self.y0 && y <= self.y1
    }
}

/// Finds and describes key points; owns its scratch and its results.
#[derive(Clone, Debug)]
pub struct Extractor {
    points: Vec<KeyPoint>,
    descriptors: Vec<Bits>,
    image: Image,
    xs: Vec<f32>,
    ys: Vec<f32>,
    response: Vec<f32>,
    scratch: Vec<f32>,
    corners: Vec<Corner>,
    picker: Picker,
}

impl Default for Extractor {
    fn default() -> Self {
        Extractor {
            points: Vec::new(),
            descriptors: Vec::new(),
            image: Image::new(1, 1, 1),
            xs: Vec::new(),
            ys: Vec::new(),
            response: Vec::new(),
            scratch: Vec::new(),
            corners: Vec::new(),
            picker: Picker::default(),
        }
    }
}

impl Extractor {
    /// Key points of the last frame.
    pub fn points(&self) -> &[KeyPoint] {
        &self.points
    }

    /// Their descriptors.
    pub fn descriptors(&self) -> &[Bits] {
        &self.descriptors
    }

    /// Finds up to about `count` key points of `frame` within `region` that `wanted` accepts (places in px).
    pub fn extract(
        &mut self,
        frame: &Frame,
        region: Region,
        count: usize,
        wanted: impl Fn([f64; 2]) -> bool,
    ) {
        self.points.clear();
        self.descriptors.clear();
        let total: f64 = (0..SCALES).map(|s| SHARE.powi(s as i32)).sum();
        for scale in 0..SCALES {
            let count = (count as f64 * SHARE.powi(scale as i32) / total).round() as usize;
            if !self.extract_scale(frame, region, scale, count, &wanted) {
                break;
            }
        }
    }

    /// One scale; false when nothing fits into the frame at this one or any coarser one.
    fn extract_scale(
        &mut self,
        frame: &Frame,
        region: Region,
        scale: usize,
        count: usize,
        wanted: &impl Fn([f64; 2]) -> bool,
    ) -> bool {
        let octave = scale / 3;
        if octave >= frame.levels() {
            return false;
        }
        let base = frame.level(octave, 1).gray();
        let unit = f64::from(1u32 << octave);
        // Pixels of the octave per pixel here.
        let step = STEP.powi((scale % 3) as i32);
        let reach = (MARGIN + 1) as f64 * step;
        let range = |low: f64, high: f64, size: usize| {
            let first = (low / unit - reach).clamp(0.0, (size - 1) as f64).floor();
            let last = (high / unit + reach).clamp(first, (size - 1) as f64);
            (first, ((last - first) / step).floor() as usize + 1)
        };
        let (x0, width) = range(region.x0, region.x1, base.width());
        let (y0, height) = range(region.y0, region.y1, base.height());
        if width <= 2 * MARGIN || height <= 2 * MARGIN {
            // A region at the frame's border may still reach farther into it at a coarser scale.
            return true;
        }
        self.resample(base, [x0, y0], step, width, height);
        self.response.resize(width * height, 0.0);
        grow(&mut self.scratch, kernels::corner_scratch_len(width));
        let stride = self.image.stride();
        kernels::corner_response(
            self.image.plane(0),
            width,
            height,
            stride,
            &mut self.response,
            &mut self.scratch,
        );
        let place = |x: f64, y: f64| [(x0 + x * step) * unit, (y0 + y * step) * unit];
        let accepted = |x: usize, y: usize| {
            let p = place(x as f64, y as f64);
            region.contains(p[0], p[1]) && wanted(p)
        };
        self.corners.clear();
        self.picker.pick(
            &self.response,
            width,
            MARGIN,
            LEAST,
            count,
            accepted,
            &mut self.corners,
        );
        for corner in &self.corners {
            let [x, y] = corner.pixel;
            let [mx, my] = kernels::centroid(self.image.plane(0), stride, x, y);
            let angle = libm::atan2(my, mx) / std::f64::consts::TAU;
            let turn = (angle * TURNS as f64).round().rem_euclid(TURNS as f64) as usize % TURNS;
            self.descriptors
                .push(describe(self.image.plane(0), stride, y * stride + x, turn));
            self.points.push(KeyPoint {
                at: place(corner.at[0].into(), corner.at[1].into()).map(|v| v as f32),
                scale: scale as u8,
                turn: turn as u8,
            });
        }
        true
    }

    /// Makes the smoothed image of one scale: its pixel `(i, j)` is at `origin + step (i, j)` of `base`.
    fn resample(&mut self, base: &Image, origin: [f64; 2], step: f64, width: usize, height: usize) {
        self.image.reshape(width, height, 1);
        let stride = self.image.stride();
        if step == 1.0 {
            let (x, y) = (origin[0] as usize, origin[1] as usize);
            for row in 0..height {
                self.image
                    .row_mut(0, row)
                    .copy_from_slice(&base.row(0, y + row)[x..x + width]);
            }
        } else {
            self.xs.clear();
            self.xs
                .extend((0..width).map(|i| (origin[0] + step * i as f64) as f32));
            self.ys.resize(width, 0.0);
            let plane = base.view(0);
            for row in 0..height {
                self.ys.fill((origin[1] + step * row as f64) as f32);
                let out = self.image.row_mut(0, row);
                kernels::sample(plane, Border::Replicate, &self.xs, &self.ys, out);
            }
        }
        grow(&mut self.scratch, blur::scratch_len(width, SMOOTH.len()));
        let plane = self.image.plane_mut(0);
        blur::separable_in_place(plane, width, height, stride, &SMOOTH, &mut self.scratch);
    }

    /// Bytes kept between frames.
    pub fn memory(&self) -> usize {
        let image = self.image.stride() * self.image.height();
        4 * (image + self.response.capacity() + self.scratch.capacity()) + 48 * self.points.capacity()
    }
}

fn grow(buffer: &mut Vec<f32>, len: usize) {
    if buffer.len() < len {
        buffer.resize(len, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> Frame {
        let mut state = 1u64;
        let blocks: Vec<f32> = (0..64 * 48)
            .map(|_| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as f32
            })
            .collect();
        Frame::from_gray(Image::from_fn(640, 480, |x, y| blocks[y / 10 * 64 + x / 10]))
    }

    #[test]
    fn points_lie_in_their_region_and_repeat() {
        let frame = frame();
        let region = Region {
            x0: 150.0,
            y0: 100.0,
            x1: 420.0,
            y1: 330.0,
        };
        let mut e = Extractor::default();
        e.extract(&frame, region, 500, |p| p[0] < 400.0);
        assert!((300..=510).contains(&e.points().len()), "{}", e.points().len());
        assert_eq!(e.points().len(), e.descriptors().len());
        for p in e.points() {
            let slack = 0.6 * STEP.powi(i32::from(p.scale));
            let [x, y] = p.at.map(f64::from);
            assert!(x >= 150.0 - slack && x < 400.0 + slack && y >= 100.0 - slack && y <= 330.0 + slack);
        }
        let first = (e.points().to_vec(), e.descriptors().to_vec());
        e.extract(&frame, Region::whole(&frame), 800, |_| true);
        let scales: std::collections::BTreeSet<u8> = e.points().iter().map(|p| p.scale).collect();
        assert_eq!(scales.len(), SCALES);
        e.extract(&frame, region, 500, |p| p[0] < 400.0);
        assert_eq!(first, (e.points().to_vec(), e.descriptors().to_vec()));
    }

    #[test]
    fn tiny_and_flat_frames_have_none() {
        let mut e = Extractor::default();
        for frame in [
            Frame::from_gray(Image::from_fn(1, 1, |_, _| 3.0)),
            Frame::from_gray(Image::from_fn(33, 20, |x, _| x as f32)),
            Frame::from_gray(Image::from_fn(200, 200, |_, _| 90.0)),
            Frame::from_gray(Image::from_fn(200, 200, |_, _| f32::NAN)),
        ] {
            e.extract(&frame, Region::whole(&frame), 500, |_| true);
            assert!(e.points().is_empty());
        }
        let outside = Region::around(&[[-400.0, -300.0]], 20.0);
        e.extract(&self::frame(), outside, 500, |_| true);
        assert!(e.points().is_empty());
    }

    /// Prints the time of 800 points: `cargo test --release -- --ignored --nocapture extract`.
    #[test]
    #[ignore = "prints a time"]
    fn time_of_640x480() {
        let frame = frame();
        frame.level(3, 1);
        let mut e = Extractor::default();
        let times = (0..50).map(|_| {
            let start = std::time::Instant::now();
            e.extract(&frame, Region::whole(&frame), 800, |_| true);
            start.elapsed()
        });
        println!("{:?} for {} points", times.skip(1).min(), e.points().len());
    }
}
