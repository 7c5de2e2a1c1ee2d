//! A colour canvas with anti-aliased shapes given by signed distances, in texels.
//!
//! Depends on nothing else in the crate.

use image::RgbImage;
use rayon::prelude::*;

/// Red, green, blue, each 0–255.
pub(crate) type Colour = [f64; 3];

/// `#rrggbb` as a [`Colour`].
pub(crate) const fn rgb(hex: u32) -> Colour {
    [
        ((hex >> 16) & 255) as f64,
        ((hex >> 8) & 255) as f64,
        (hex & 255) as f64,
    ]
}

/// `a` for `t = 0`, `b` for `t = 1`, clamped.
pub(crate) fn mix(a: Colour, b: Colour, t: f64) -> Colour {
    let t = t.clamp(0.0, 1.0);
    [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * t)
}

/// Brightness multiplied by `s`.
pub(crate) fn shade(c: Colour, s: f64) -> Colour {
    c.map(|v| v * s)
}

/// Colour at `t` of a ramp through equally spaced colours, `t` clamped to [0, 1].
pub(crate) fn ramp(colours: &[Colour], t: f64) -> Colour {
    let at = t.clamp(0.0, 1.0) * (colours.len() - 1) as f64;
    let i = (at as usize).min(colours.len() - 2);
    mix(colours[i], colours[i + 1], at - i as f64)
}

/// The canvas: row-major texels, centres at integers.
pub(crate) struct Canvas {
    pub width: usize,
    pub height: usize,
    texels: Vec<Colour>,
}

impl Canvas {
    /// Every texel `(x, y)` coloured by `f`.
    pub fn from_fn(width: usize, height: usize, f: impl Fn(f64, f64) -> Colour + Sync) -> Self {
        let mut texels = vec![[0.0; 3]; width * height];
        texels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, t) in row.iter_mut().enumerate() {
                *t = f(x as f64, y as f64);
            }
        });
        Canvas {
            width,
            height,
            texels,
        }
    }

    /// Colour of texel `(x, y)`, clamped to the canvas.
    pub fn get(&self, x: f64, y: f64) -> Colour {
        let clamp = |v: f64, n: usize| v.clamp(0.0, (n - 1) as f64) as usize;
        self.texels[clamp(y, self.height) * self.width + clamp(x, self.width)]
    }

    /// Blends `f(x, y) = (opacity, colour)` into the texels of the box `[x0, y0, x1, y1]`.
    pub fn blend(&mut self, bounds: [f64; 4], f: impl Fn(f64, f64) -> (f64, Colour)) {
        let clamp = |v: f64, n: usize| v.clamp(0.0, n as f64) as usize;
        let (x0, x1) = (
            clamp(bounds[0].floor(), self.width),
            clamp(bounds[2].ceil() + 1.0, self.width),
        );
        let (y0, y1) = (
            clamp(bounds[1].floor(), self.height),
            clamp(bounds[3].ceil() + 1.0, self.height),
        );
        for y in y0..y1 {
            for x in x0..x1 {
                let (alpha, colour) = f(x as f64, y as f64);
                if alpha > 0.0 {
                    let t = &mut self.texels[y * self.width + x];
                    *t = mix(*t, colour, alpha);
                }
            }
        }
    }

    /// Changes every texel.
    pub fn map(&mut self, f: impl Fn(f64, f64, Colour) -> Colour + Sync) {
        let width = self.width;
        self.texels
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, row)| {
                for (x, t) in row.iter_mut().enumerate() {
                    *t = f(x as f64, y as f64, *t);
                }
            });
    }

    /// Fills the shape where the signed distance is negative, edges one texel soft.
    pub fn shape(
        &mut self,
        bounds: [f64; 4],
        distance: impl Fn(f64, f64) -> f64,
        colour: Colour,
        opacity: f64,
    ) {
        self.blend(bounds, |x, y| {
            (opacity * (0.5 - distance(x, y)).clamp(0.0, 1.0), colour)
        });
    }

    /// Filled disc.
    pub fn disc(&mut self, x: f64, y: f64, radius: f64, colour: Colour, opacity: f64) {
        let r = radius + 1.0;
        self.shape(
            [x - r, y - r, x + r, y + r],
            |u, v| length(u - x, v - y) - radius,
            colour,
            opacity,
        );
    }

    /// Filled upright rectangle `[x0, y0, x1, y1]` with rounded corners.
    pub fn rect(&mut self, [x0, y0, x1, y1]: [f64; 4], radius: f64, colour: Colour, opacity: f64) {
        let d = |x: f64, y: f64| rect_distance(x, y, [x0, y0, x1, y1], radius);
        self.shape([x0 - 1.0, y0 - 1.0, x1 + 1.0, y1 + 1.0], d, colour, opacity);
    }

    /// Outline of an upright rectangle.
    pub fn frame(&mut self, [x0, y0, x1, y1]: [f64; 4], radius: f64, thickness: f64, colour: Colour) {
        let d = |x: f64, y: f64| rect_distance(x, y, [x0, y0, x1, y1], radius).abs() - thickness / 2.0;
        let t = thickness + 1.0;
        self.shape([x0 - t, y0 - t, x1 + t, y1 + t], d, colour, 1.0);
    }

    /// Line with round ends through the points.
    pub fn line(&mut self, points: &[[f64; 2]], thickness: f64, colour: Colour, opacity: f64) {
        let half = thickness / 2.0;
        let bounds = bounds_of(points, half + 1.0);
        let d = |x: f64, y: f64| {
            let far = points.windows(2).map(|s| segment_distance(x, y, s[0], s[1]));
            far.fold(f64::MAX, f64::min) - half
        };
        self.shape(bounds, d, colour, opacity);
    }

    /// Filled polygon (any simple outline).
    pub fn polygon(&mut self, points: &[[f64; 2]], colour: Colour, opacity: f64) {
        self.shape(
            bounds_of(points, 1.0),
            |x, y| polygon_distance(x, y, points),
            colour,
            opacity,
        );
    }

    /// Rounded to 8 bits.
    pub fn to_image(&self) -> RgbImage {
        RgbImage::from_fn(self.width as u32, self.height as u32, |x, y| {
            let t = self.texels[y as usize * self.width + x as usize];
            image::Rgb(t.map(|v| v.round().clamp(0.0, 255.0) as u8))
        })
    }
}

/// Euclidean length.
pub(crate) fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// Signed distance to an upright rounded rectangle.
pub(crate) fn rect_distance(x: f64, y: f64, [x0, y0, x1, y1]: [f64; 4], radius: f64) -> f64 {
    let dx = (x - (x0 + x1) / 2.0).abs() - (x1 - x0) / 2.0 + radius;
    let dy = (y - (y0 + y1) / 2.0).abs() - (y1 - y0) / 2.0 + radius;
    length(dx.max(0.0), dy.max(0.0)) + dx.max(dy).min(0.0) - radius
}

/// Distance to the segment from `a` to `b`.
pub(crate) fn segment_distance(x: f64, y: f64, a: [f64; 2], b: [f64; 2]) -> f64 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let t = (((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy).max(1e-12)).clamp(0.0, 1.0);
    length(x - a[0] - t * dx, y - a[1] - t * dy)
}

/// Signed distance to a simple polygon.
pub(crate) fn polygon_distance(x: f64, y: f64, points: &[[f64; 2]]) -> f64 {
    let (mut inside, mut far) = (false, f64::MAX);
    let mut a = points[points.len() - 1];
    for &b in points {
        far = far.min(segment_distance(x, y, a, b));
        if (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
            inside = !inside;
        }
        a = b;
    }
    if inside { -far } else { far }
}

fn bounds_of(points: &[[f64; 2]], margin: f64) -> [f64; 4] {
    let start = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    let b = points.iter().fold(start, |b, p| {
        [b[0].min(p[0]), b[1].min(p[1]), b[2].max(p[0]), b[3].max(p[1])]
    });
    [b[0] - margin, b[1] - margin, b[2] + margin, b[3] + margin]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_have_the_right_sign() {
        let square = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]];
        assert_eq!(polygon_distance(5.0, 5.0, &square), -5.0);
        assert_eq!(polygon_distance(13.0, 14.0, &square), 5.0);
        assert_eq!(rect_distance(5.0, 5.0, [0.0, 0.0, 10.0, 10.0], 2.0), -5.0);
        assert_eq!(segment_distance(5.0, 3.0, [0.0, 0.0], [10.0, 0.0]), 3.0);
    }

    #[test]
    fn a_disc_covers_its_area() {
        let mut canvas = Canvas::from_fn(64, 64, |_, _| [0.0; 3]);
        canvas.disc(31.5, 31.5, 20.0, [255.0; 3], 1.0);
        let image = canvas.to_image();
        let area: f64 = image.pixels().map(|p| f64::from(p[0]) / 255.0).sum();
        assert!((area - std::f64::consts::PI * 400.0).abs() < 5.0, "{area}");
    }
}
