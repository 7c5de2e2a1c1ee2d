//! Textures drawn by code. A new one is a function `fn(&mut Random) -> Canvas` and a line in [`TEXTURES`].
//!
//! All are 640 x 480 texels and depend on the seed alone.

mod artificial;
mod natural;
mod printed;

use super::canvas::Canvas;
use super::random::Random;
use image::RgbImage;

/// Size of every texture, texels.
pub(crate) const SIZE: (usize, usize) = (640, 480);

/// A texture the project draws.
pub struct Texture {
    /// Name on the command line.
    pub name: &'static str,
    /// What it shows.
    pub about: &'static str,
    draw: fn(&mut Random) -> Canvas,
}

impl Texture {
    /// Draws it, 640 x 480; the same seed gives the same texels on every machine.
    pub fn draw(&self, seed: u64) -> RgbImage {
        (self.draw)(&mut Random::new(seed, 0x7e47)).to_image()
    }
}

const fn texture(name: &'static str, about: &'static str, draw: fn(&mut Random) -> Canvas) -> Texture {
    Texture { name, about, draw }
}

/// All textures, in the order they are listed.
pub const TEXTURES: &[Texture] = &[
    texture("rock", "weathered stone with cracks and lichen", natural::rock),
    texture("foliage", "layers of leaves", natural::foliage),
    texture("painting", "a landscape in brush strokes", natural::painting),
    texture(
        "soft",
        "smooth gradients and a few blurred blobs: hardly any texture",
        natural::soft,
    ),
    texture(
        "page",
        "a printed page: headline, columns, boxes, a chart",
        printed::page,
    ),
    texture(
        "poster",
        "a poster of bold shapes and large letters",
        printed::poster,
    ),
    texture("map", "a street map with labels", printed::map),
    texture(
        "bricks",
        "a brick wall, each brick a little different",
        artificial::bricks,
    ),
    texture(
        "tiles",
        "ornamental tiles that repeat exactly but for wear",
        artificial::tiles,
    ),
    texture(
        "metal",
        "a brushed metal panel with engraving, screws, scratches",
        artificial::metal,
    ),
    texture(
        "circuit",
        "a circuit board: tracks, pads, chips, white legend",
        artificial::circuit,
    ),
];

/// The texture called `name`.
pub fn find(name: &str) -> Option<&'static Texture> {
    TEXTURES.iter().find(|t| t.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_texture_is_reproducible_coloured_and_varied() {
        for t in TEXTURES {
            let a = t.draw(7);
            assert_eq!(a.dimensions(), (SIZE.0 as u32, SIZE.1 as u32));
            assert_eq!(a, t.draw(7), "{}", t.name);
            assert_ne!(a, t.draw(8), "{} ignores its seed", t.name);
            let gray = |p: &image::Rgb<u8>| {
                f64::from(p[0]) * 0.299 + f64::from(p[1]) * 0.587 + f64::from(p[2]) * 0.114
            };
            let n = f64::from(a.width() * a.height());
            let mean = a.pixels().map(gray).sum::<f64>() / n;
            let sigma = (a
                .pixels()
                .map(|p| (gray(p) - mean) * (gray(p) - mean))
                .sum::<f64>()
                / n)
                .sqrt();
            assert!(
                (50.0..225.0).contains(&mean) && sigma > 8.0,
                "{}: mean {mean}, sigma {sigma}",
                t.name
            );
            assert!(
                a.pixels().any(|p| p[0].abs_diff(p[2]) > 12),
                "{} has no colour",
                t.name
            );
        }
    }

    #[test]
    fn names_are_unique() {
        for (i, t) in TEXTURES.iter().enumerate() {
            assert!(TEXTURES[..i].iter().all(|u| u.name != t.name));
            assert!(find(t.name).is_some());
        }
    }
}
