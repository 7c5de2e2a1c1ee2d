//! What is out of the ordinary about an image that is read all the same.

use image::metadata::Orientation;
use mtf::image::Pixels;
use std::fmt;

/// Fewer levels than this of 256 are a sliver.
const SLIVER: usize = 64;

/// Something about an image that its reader should know.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Remark {
    /// It was turned as its orientation tag, 2 to 8, says.
    Turned(u8),
    /// It has 16 bits per channel, which were brought to 8.
    SixteenBits,
    /// It has 16 bits per channel, and of the 256 levels they become no more than these are used.
    Sliver(usize),
    /// It has no mark of its end; all of the picture is there.
    NoEndMark,
    /// It has no Huffman tables; the standard ones were taken.
    StandardTables,
    /// There are more images in the file than the first, which was read.
    Several,
}

impl Remark {
    /// Of a tag, unless the image is upright.
    pub(super) fn turned(orientation: Orientation) -> Option<Remark> {
        (orientation != Orientation::NoTransforms).then(|| Remark::Turned(orientation.to_exif()))
    }

    /// Of the pixels of an image with 16 bits per channel. One value in 200 at either end does not count: dead pixels.
    pub(in crate::dataset) fn sliver(pixels: &Pixels) -> Option<Remark> {
        let mut counts = [0; 256];
        pixels.gray().iter().for_each(|&v| counts[usize::from(v)] += 1);
        let spare = pixels.gray().len() / 200;
        let end = |counts: &mut dyn Iterator<Item = usize>| {
            let mut passed = 0;
            let mut beyond = |count: usize| {
                passed += count;
                passed > spare
            };
            counts.take_while(|count| !beyond(*count)).count()
        };
        let low = end(&mut counts.iter().copied());
        let high = 255 - end(&mut counts.iter().rev().copied());
        let used = counts[low..=high].iter().filter(|count| **count > 0).count();
        (high - low < SLIVER).then_some(Remark::Sliver(used))
    }

    /// What the remark means for what is made of the image.
    pub fn standing(self) -> Standing {
        match self {
            Remark::Turned(_) | Remark::SixteenBits => Standing::AsItSays,
            Remark::NoEndMark | Remark::StandardTables => Standing::Repaired,
            Remark::Sliver(_) | Remark::Several => Standing::Doubtful,
        }
    }
}

/// What a [`Remark`] means for what is made of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// It was read as its file says.
    AsItSays,
    /// Something that its file lacks was added.
    Repaired,
    /// It may not be what it is taken for.
    Doubtful,
}

/// A fragment that follows the file's name: what; what was done.
impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Remark::Turned(tag) => write!(f, "turned as its orientation tag ({tag}) says"),
            Remark::SixteenBits => f.write_str("16 bits per channel, brought to 8"),
            Remark::Sliver(used) => write!(
                f,
                "its 16 bits per channel leave {used} of 256 levels; stretch them with --depth16 minmax or shift:N"
            ),
            Remark::NoEndMark => f.write_str("the JPEG image has no end mark; all of its data is there and was read"),
            Remark::StandardTables => {
                f.write_str("the JPEG image has no Huffman tables; read with the standard ones, as Motion JPEG")
            }
            Remark::Several => f.write_str(
                "the file holds several images (pages or an animation); the first was read; to have them as frames, name the file or give it a folder of its own",
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sliver_is_what_few_levels_hold() {
        let of = |values: &dyn Fn(usize) -> u8| {
            let pixels = (0..1000).map(values).collect();
            Remark::sliver(&Pixels::from_gray(1000, 1, pixels))
        };
        assert_eq!(of(&|i| (i % 256) as u8), None);
        assert_eq!(of(&|i| 200 + (i % 5) as u8), Some(Remark::Sliver(5)));
        // A dead pixel does not stretch it.
        assert_eq!(
            of(&|i| if i == 3 { 255 } else { 100 + (i % 5) as u8 }),
            Some(Remark::Sliver(5))
        );
        assert_eq!(of(&|_| 0), Some(Remark::Sliver(1)));
        assert_eq!(of(&|i| (i % 2) as u8 * 100), None);
    }
}
