//! Pixels as they come from a file or a camera.

use super::Image;
use crate::kernels::gray::{gray_and_rgb_from_ycbcr, gray_from_rgb};

/// 8-bit pixels: always a gray plane, and interleaved R, G, B where there is colour and it was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    width: usize,
    height: usize,
    gray: Vec<u8>,
    rgb: Option<Vec<u8>>,
}

impl Pixels {
    /// From row-major gray pixels; panics unless `gray.len() == width * height`.
    pub fn from_gray(width: usize, height: usize, gray: Vec<u8>) -> Self {
        assert_eq!(gray.len(), width * height, "one value per pixel");
        Pixels {
            width,
            height,
            gray,
            rgb: None,
        }
    }

    /// From row-major interleaved R, G, B; gray is BT.601, rounded. Panics unless `rgb.len() == 3 * width * height`.
    pub fn from_rgb(width: usize, height: usize, rgb: Vec<u8>) -> Self {
        let mut gray = vec![0; width * height];
        gray_from_rgb(&rgb, &mut gray);
        Pixels {
            width,
            height,
            gray,
            rgb: Some(rgb),
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }
    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }
    /// Row-major gray pixels: the Y plane of a JPEG, BT.601 of other colour images, the pixels of a gray one.
    pub fn gray(&self) -> &[u8] {
        &self.gray
    }
    /// Row-major interleaved R, G, B; `None` when the file is gray or colour was not asked for.
    pub fn rgb(&self) -> Option<&[u8]> {
        self.rgb.as_deref()
    }

    /// From row-major interleaved Y, Cb, Cr (JFIF, full range): gray is the Y plane; R, G, B are kept if `colour`. Panics
    /// unless `ycbcr.len() == 3 * width * height`.
    pub fn from_ycbcr(width: usize, height: usize, mut ycbcr: Vec<u8>, colour: bool) -> Self {
        let mut gray = vec![0; width * height];
        gray_and_rgb_from_ycbcr(&mut ycbcr, &mut gray);
        Pixels {
            width,
            height,
            gray,
            rgb: colour.then_some(ycbcr),
        }
    }

    /// The same image without its colour.
    pub fn without_colour(mut self) -> Self {
        self.rgb = None;
        self
    }

    /// Float planes, rounded.
    pub(crate) fn from_image(image: &Image) -> Self {
        let byte = |v: f32| v.round().clamp(0.0, 255.0) as u8;
        let (width, height) = (image.width(), image.height());
        if image.channels() == 1 {
            let rows = (0..height).flat_map(|y| image.row(0, y));
            return Pixels::from_gray(width, height, rows.map(|v| byte(*v)).collect());
        }
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let rgb = places.flat_map(|(x, y)| [0, 1, 2].map(|c| byte(image.get(c, x, y))));
        Pixels::from_rgb(width, height, rgb.collect())
    }

    pub(crate) fn to_gray(&self) -> Image {
        let mut image = Image::new(self.width, self.height, 1);
        for (y, row) in self.gray.chunks_exact(self.width).enumerate() {
            for (v, &p) in image.row_mut(0, y).iter_mut().zip(row) {
                *v = f32::from(p);
            }
        }
        image
    }

    pub(crate) fn to_colour(&self) -> Image {
        let mut image = Image::new(self.width, self.height, 3);
        for c in 0..3 {
            for y in 0..self.height {
                let at = y * self.width;
                let out = image.row_mut(c, y).iter_mut();
                match &self.rgb {
                    Some(rgb) => {
                        let row = rgb[3 * at..3 * (at + self.width)].chunks_exact(3);
                        out.zip(row).for_each(|(v, p)| *v = f32::from(p[c]));
                    }
                    None => {
                        let row = &self.gray[at..at + self.width];
                        out.zip(row).for_each(|(v, &p)| *v = f32::from(p));
                    }
                }
            }
        }
        image
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn float_planes() {
        let decoded = Pixels::from_rgb(2, 1, vec![10, 20, 30, 40, 50, 60]);
        let (gray, colour) = (decoded.to_gray(), decoded.to_colour());
        assert_eq!(gray.row(0, 0), [18.0, 48.0]);
        assert_eq!(
            [colour.row(0, 0), colour.row(1, 0), colour.row(2, 0)],
            [[10.0, 40.0], [20.0, 50.0], [30.0, 60.0]]
        );
        assert_eq!(Pixels::from_image(&gray), decoded.without_colour());
        let repeated = Pixels::from_gray(1, 1, vec![9]).to_colour();
        assert_eq!(
            [
                repeated.get(0, 0, 0),
                repeated.get(1, 0, 0),
                repeated.get(2, 0, 0)
            ],
            [9.0; 3]
        );
    }
}
