//! A textured plane at the resolution it is seen at: level choice, defocus, bilinear sampling with mirrored borders.
//!
//! Depends on `geom` only.

use image::RgbImage;
use mtf::geom::Mat3;

/// Texels of one surface. Sheet coordinates are pixels of the first frame with the origin at the image's middle.
pub(crate) struct Surface {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
    /// Sheet coordinates to texel coordinates of the stored level.
    pub to_texels: Mat3,
}

impl Surface {
    /// `density`: image pixels per frame pixel at the first frame. The stored level has 1.5 to 3 texels per pixel (or
    /// twice the image's), so that a few bilinear samples per pixel average over all of them. `defocus`: sigma of a
    /// Gaussian, frame pixels. `tone`: intensities that 0 and 255 become.
    pub fn new(image: &RgbImage, density: f64, defocus: f64, tone: [f64; 2]) -> Self {
        let (w, h) = (image.width() as usize, image.height() as usize);
        let slope = ((tone[1] - tone[0]) / 255.0) as f32;
        let texels = image
            .pixels()
            .map(|p| p.0.map(|v| tone[0] as f32 + slope * f32::from(v)))
            .collect();
        let middle = |n: usize| (n as f64 - 1.0) / 2.0;
        let to_texels = Mat3::new(density, 0.0, middle(w), 0.0, density, middle(h), 0.0, 0.0, 1.0);
        let mut surface = Surface {
            width: w,
            height: h,
            texels,
            to_texels,
        };
        let mut level = density;
        if level < 1.5 {
            surface = surface.doubled();
            level *= 2.0;
        }
        while level >= 3.0 && surface.width > 1 && surface.height > 1 {
            surface = surface.halved();
            level /= 2.0;
        }
        if defocus > 0.0 {
            surface.blurred(defocus * level)
        } else {
            surface
        }
    }

    fn at(&self, x: i64, y: i64) -> [f32; 3] {
        self.texels[mirror(y, self.height) * self.width + mirror(x, self.width)]
    }

    /// Half the size; each texel the mean of four.
    fn halved(&self) -> Surface {
        let (w, h) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut texels = Vec::with_capacity(w * h);
        for y in 0..h as i64 {
            for x in 0..w as i64 {
                let (a, b) = (self.at(2 * x, 2 * y), self.at(2 * x + 1, 2 * y));
                let (c, d) = (self.at(2 * x, 2 * y + 1), self.at(2 * x + 1, 2 * y + 1));
                texels.push([0, 1, 2].map(|k| 0.25 * (a[k] + b[k] + c[k] + d[k])));
            }
        }
        let to_texels = Mat3::new(0.5, 0.0, -0.25, 0.0, 0.5, -0.25, 0.0, 0.0, 1.0) * self.to_texels;
        Surface {
            width: w,
            height: h,
            texels,
            to_texels,
        }
    }

    /// Twice the size by Catmull-Rom interpolation.
    fn doubled(&self) -> Surface {
        // Weights of the four neighbours at 1/4 and 3/4 between the middle two.
        const NEAR: [f32; 4] = [-0.070_312_5, 0.867_187_5, 0.226_562_5, -0.023_437_5];
        let taps = |i: i64| {
            let half = i.div_euclid(2);
            if i.rem_euclid(2) == 0 {
                // Texel 2j lies a quarter left of j: between j-1 and j.
                (half - 2, [NEAR[3], NEAR[2], NEAR[1], NEAR[0]])
            } else {
                (half - 1, NEAR)
            }
        };
        let (w, h) = (2 * self.width, 2 * self.height);
        let mut wide = Vec::with_capacity(w * self.height);
        for y in 0..self.height as i64 {
            for x in 0..w as i64 {
                let (first, weights) = taps(x);
                wide.push(weighted(&weights, |k| self.at(first + k, y)));
            }
        }
        let mut texels = Vec::with_capacity(w * h);
        for y in 0..h as i64 {
            let (first, weights) = taps(y);
            for x in 0..w {
                texels.push(weighted(&weights, |k| {
                    wide[mirror(first + k, self.height) * w + x]
                }));
            }
        }
        let to_texels = Mat3::new(2.0, 0.0, 0.5, 0.0, 2.0, 0.5, 0.0, 0.0, 1.0) * self.to_texels;
        Surface {
            width: w,
            height: h,
            texels,
            to_texels,
        }
    }

    /// Gaussian of the given sigma, texels.
    fn blurred(self, sigma: f64) -> Surface {
        let reach = (3.0 * sigma).ceil() as i64;
        let raw: Vec<f64> = (-reach..=reach)
            .map(|k| libm::exp(-0.5 * (k as f64 / sigma) * (k as f64 / sigma)))
            .collect();
        let sum: f64 = raw.iter().sum();
        let weights: Vec<f32> = raw.iter().map(|v| (v / sum) as f32).collect();
        let pass = |p: &Surface, dx: i64, dy: i64| {
            let mut texels = Vec::with_capacity(p.texels.len());
            for y in 0..p.height as i64 {
                for x in 0..p.width as i64 {
                    texels.push(weighted(&weights, |k| {
                        p.at(x + dx * (k - reach), y + dy * (k - reach))
                    }));
                }
            }
            Surface { texels, ..*p }
        };
        pass(&pass(&self, 1, 0), 0, 1)
    }

    /// Bilinear value at texel coordinates, texel centres at integers, mirrored at the border.
    pub fn sample(&self, u: f64, v: f64) -> [f32; 3] {
        let (fu, fv) = (u.floor(), v.floor());
        let (x, y) = (fu as i64, fv as i64);
        let (du, dv) = ((u - fu) as f32, (v - fv) as f32);
        let inside = x >= 0 && y >= 0 && x + 1 < self.width as i64 && y + 1 < self.height as i64;
        let [a, b, c, d] = if inside {
            let i = y as usize * self.width + x as usize;
            let (top, bottom) = (
                &self.texels[i..i + 2],
                &self.texels[i + self.width..i + self.width + 2],
            );
            [top[0], top[1], bottom[0], bottom[1]]
        } else {
            [
                self.at(x, y),
                self.at(x + 1, y),
                self.at(x, y + 1),
                self.at(x + 1, y + 1),
            ]
        };
        [0, 1, 2].map(|k| {
            let (top, bottom) = (a[k] + du * (b[k] - a[k]), c[k] + du * (d[k] - c[k]));
            top + dv * (bottom - top)
        })
    }
}

fn weighted(weights: &[f32], value: impl Fn(i64) -> [f32; 3]) -> [f32; 3] {
    weights.iter().zip(0..).fold([0.0; 3], |s, (w, k)| {
        let v = value(k);
        [s[0] + w * v[0], s[1] + w * v[1], s[2] + w * v[2]]
    })
}

/// Index mirrored into `0..n`, border texels repeated once.
fn mirror(i: i64, n: usize) -> usize {
    let n = n as i64;
    let j = i.rem_euclid(2 * n);
    (if j < n { j } else { 2 * n - 1 - j }) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient_image() -> RgbImage {
        RgbImage::from_fn(64, 48, |x, y| image::Rgb([(2 * x + y) as u8, (3 * y) as u8, 100]))
    }

    #[test]
    fn every_level_shows_the_same_place() {
        // A linear ramp is reproduced by averaging, cubic interpolation and symmetric blur alike.
        for (density, defocus) in [(0.8, 0.0), (2.0, 0.0), (4.0, 0.0), (9.0, 0.0), (2.0, 1.5)] {
            let surface = Surface::new(&gradient_image(), density, defocus, [0.0, 255.0]);
            let sheet = nalgebra::Vector3::new(0.7 / density, -1.3 / density, 1.0);
            let t = surface.to_texels * sheet;
            let (x, y) = (31.5 + 0.7, 23.5 - 1.3);
            let [r, g, b] = surface.sample(t.x, t.y);
            assert!(
                (f64::from(r) - (2.0 * x + y)).abs() < 1e-3,
                "density {density}: {r}"
            );
            assert!((f64::from(g) - 3.0 * y).abs() < 1e-3 && (b - 100.0).abs() < 1e-3);
        }
    }

    #[test]
    fn borders_are_mirrored() {
        assert_eq!(
            (-3..6).map(|i| mirror(i, 3)).collect::<Vec<_>>(),
            [2, 1, 0, 0, 1, 2, 2, 1, 0]
        );
    }
}
