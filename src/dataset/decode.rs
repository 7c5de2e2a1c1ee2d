//! Decoding of image files into 8-bit pixels. Formats are recognised by content, never by name.
//!
//! A format is a line in [`KINDS`], and a file in `decode/` unless the decoder of the others reads it.

mod entropy;
mod jpeg;
mod other;

use crate::files::{self, Kind, Refused};
use image::ImageFormat;
use mtf::image::Pixels;
use std::path::Path;

/// A file format of images.
struct ImageKind {
    /// Name in messages.
    name: &'static str,
    /// What names of its files end in, lower case.
    extensions: &'static [&'static str],
    /// What its first bytes are recognised as.
    format: ImageFormat,
    /// Width and height in pixels from the header alone.
    size: fn(&ImageKind, &[u8]) -> Result<(usize, usize), ImageError>,
    /// The pixels, with R, G, B when asked for.
    decode: fn(&ImageKind, &[u8], bool) -> Result<Pixels, ImageError>,
}

/// Every format.
const KINDS: &[ImageKind] = &[
    jpeg::KIND,
    other::kind("PNG", &["png"], ImageFormat::Png),
    other::kind("PNM", &["pgm", "ppm", "pbm", "pnm"], ImageFormat::Pnm),
    other::kind("BMP", &["bmp"], ImageFormat::Bmp),
    other::kind("TIFF", &["tif", "tiff"], ImageFormat::Tiff),
    other::kind("GIF", &["gif"], ImageFormat::Gif),
];

/// Most pixels an image may have.
pub const MAX_PIXELS: u64 = 1 << 26;

/// Why an image cannot be decoded. The messages are fragments that follow the file's name.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// There are no bytes at all.
    #[error("the image file is empty (0 bytes); copy it again")]
    Empty,
    /// The first bytes are those of no supported format.
    #[error("not an image in a supported format; use {}", image_formats())]
    UnknownFormat,
    /// The file ends before the image does.
    #[error("the {format} image is truncated; copy it again")]
    Truncated {
        /// Name of the file format.
        format: &'static str,
    },
    /// The header claims more pixels than [`MAX_PIXELS`]; nothing was allocated for them.
    #[error("the image header claims {width}x{height} pixels, more than the limit of {limit}; the file is corrupt or must be scaled down", limit = MAX_PIXELS)]
    TooLarge {
        /// Claimed width in pixels.
        width: u64,
        /// Claimed height in pixels.
        height: u64,
    },
    /// The bytes break the rules of their format.
    #[error("the {format} image is corrupt ({detail}); copy it again or leave it out")]
    Corrupt {
        /// Name of the file format.
        format: &'static str,
        /// What the decoder met.
        detail: String,
    },
    /// A variant of the format that is not supported.
    #[error("this kind of {format} image is not supported ({detail}); convert it to PNG")]
    Unsupported {
        /// Name of the file format.
        format: &'static str,
        /// What is not supported.
        detail: String,
    },
    /// It is no regular file, or larger than an image can be.
    #[error("{0}")]
    Refused(Refused),
    /// The file cannot be read.
    #[error("cannot read the image: {0}")]
    Io(std::io::Error),
}

impl From<std::io::Error> for ImageError {
    fn from(error: std::io::Error) -> Self {
        Refused::of(&error).map_or_else(|| ImageError::Io(error), ImageError::Refused)
    }
}

/// Decodes the image in `bytes`; with `colour` also keeps its R, G, B. The gray plane is the same to the bit either way.
pub fn decode(bytes: &[u8], colour: bool) -> Result<Pixels, ImageError> {
    let kind = kind_of(bytes)?;
    (kind.decode)(kind, bytes, colour)
}

/// [`decode`] of a file's content.
pub fn decode_file(path: &Path, colour: bool) -> Result<Pixels, ImageError> {
    decode(&files::read(path, Kind::IMAGE)?, colour)
}

/// Width and height in pixels that the header in `bytes` claims, without decoding.
pub fn dimensions(bytes: &[u8]) -> Result<(usize, usize), ImageError> {
    let kind = kind_of(bytes)?;
    (kind.size)(kind, bytes)
}

/// Whether a file of this name is taken for an image.
pub(super) fn is_image_name(name: &str) -> bool {
    let extension = name.rsplit_once('.').map(|(_, e)| e.to_ascii_lowercase());
    extension.is_some_and(|e| KINDS.iter().any(|kind| kind.extensions.contains(&e.as_str())))
}

/// The names of all formats, for messages.
pub(super) fn image_formats() -> String {
    let names: Vec<&str> = KINDS.iter().map(|kind| kind.name).collect();
    match &names[..] {
        [several @ .., last] if !several.is_empty() => format!("{} or {last}", several.join(", ")),
        few => few.concat(),
    }
}

fn kind_of(bytes: &[u8]) -> Result<&'static ImageKind, ImageError> {
    if bytes.is_empty() {
        return Err(ImageError::Empty);
    }
    let format = image::guess_format(bytes).map_err(|_| ImageError::UnknownFormat)?;
    let kind = KINDS.iter().find(|kind| kind.format == format);
    kind.ok_or(ImageError::UnknownFormat)
}

fn check_size(width: u64, height: u64) -> Result<(), ImageError> {
    if width * height > MAX_PIXELS {
        return Err(ImageError::TooLarge { width, height });
    }
    Ok(())
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::DynamicImage;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use std::io::Cursor;

    fn fixture(name: &str) -> Vec<u8> {
        std::fs::read(format!("{}/tests/data/{name}.jpg", env!("CARGO_MANIFEST_DIR"))).unwrap()
    }

    fn encode(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut out = Cursor::new(Vec::new());
        image.write_to(&mut out, format).unwrap();
        out.into_inner()
    }

    fn colourful(width: u32, height: u32) -> DynamicImage {
        image::RgbImage::from_fn(width, height, |x, y| {
            image::Rgb([(x * 7 + y * 3) as u8, (x * x / 3 + y) as u8, (255 - x * 2) as u8])
        })
        .into()
    }

    #[test]
    fn jpeg_gray_is_its_luma_with_and_without_colour() {
        let luma = decode(&fixture("ycc_444"), false).unwrap();
        assert_eq!((luma.width(), luma.height()), (37, 29));
        for name in [
            "444",
            "422",
            "440",
            "420",
            "411",
            "440_prog",
            "420_rst",
            "420_prog_rst",
        ]
        .map(|s| format!("ycc_{s}"))
        {
            let bytes = fixture(&name);
            let (gray, colour) = (decode(&bytes, false).unwrap(), decode(&bytes, true).unwrap());
            assert_eq!(gray, luma, "{name}");
            assert_eq!(colour.gray(), luma.gray(), "{name}");
            let rgb = colour.rgb().unwrap();
            let again = Pixels::from_rgb(37, 29, rgb.to_vec());
            let off: u32 = again
                .gray()
                .iter()
                .zip(luma.gray())
                .map(|(a, b)| u32::from(a.abs_diff(*b)))
                .sum();
            assert!(
                off < 4 * rgb.len() as u32,
                "{name}: gray of the colours is far from luma: {off}"
            );
        }
    }

    #[test]
    fn jpegs_without_luma_go_through_rgb() {
        for name in ["rgb", "cmyk", "ycck"] {
            let (gray, colour) = (
                decode(&fixture(name), false).unwrap(),
                decode(&fixture(name), true).unwrap(),
            );
            assert_eq!(gray.gray(), colour.gray(), "{name}");
            assert_eq!(
                colour,
                Pixels::from_rgb(37, 29, colour.rgb().unwrap().to_vec()),
                "{name}"
            );
        }
        assert!(decode(&fixture("gray"), true).unwrap().rgb().is_none());
    }

    #[test]
    fn unusual_chroma_is_refused() {
        let error = decode(&fixture("ycc_410"), false).unwrap_err();
        assert!(
            matches!(error, ImageError::Unsupported { format: "JPEG", .. }),
            "{error}"
        );
    }

    #[test]
    fn other_formats_keep_their_pixels() {
        let image = colourful(37, 29);
        let expected = Pixels::from_rgb(37, 29, image.to_rgb8().into_raw());
        for format in [
            ImageFormat::Png,
            ImageFormat::Pnm,
            ImageFormat::Bmp,
            ImageFormat::Tiff,
        ] {
            let bytes = encode(&image, format);
            assert_eq!(decode(&bytes, true).unwrap(), expected, "{format:?}");
            assert_eq!(
                decode(&bytes, false).unwrap(),
                expected.clone().without_colour(),
                "{format:?}"
            );
            assert_eq!(dimensions(&bytes).unwrap(), (37, 29));
            let gray = DynamicImage::from(image.to_luma8());
            assert_eq!(
                decode(&encode(&gray, format), true).unwrap().gray(),
                gray.as_bytes(),
                "{format:?}"
            );
        }
    }

    #[test]
    fn sixteen_bits_are_scaled_to_eight() {
        let deep = image::ImageBuffer::from_fn(4, 1, |x, _| {
            image::Luma([[0u16, 257, 32_896, 65_535][x as usize]])
        });
        let decoded = decode(&encode(&deep.into(), ImageFormat::Png), false).unwrap();
        assert_eq!(decoded.gray(), [0, 1, 128, 255]);
        let text = b"P1\n3 1\n1 0 1\n";
        assert_eq!(decode(text, false).unwrap().gray(), [0, 255, 0]);
    }

    #[test]
    fn every_truncation_is_an_error() {
        let image = colourful(37, 29);
        let mut files: Vec<Vec<u8>> = ["ycc_420", "ycc_440_prog", "gray", "ycc_420_rst"]
            .iter()
            .map(|n| fixture(n))
            .collect();
        files.extend([ImageFormat::Png, ImageFormat::Pnm, ImageFormat::Tiff].map(|f| encode(&image, f)));
        for bytes in files {
            // The last bytes of a PNG are its end chunk, which decoders need not read.
            let last = if bytes.starts_with(b"\x89PNG") {
                bytes.len() - 16
            } else {
                bytes.len() - 1
            };
            for n in 0..=last {
                for colour in [false, true] {
                    assert!(
                        decode(&bytes[..n], colour).is_err(),
                        "{n} of {} bytes",
                        bytes.len()
                    );
                }
            }
        }
        let half = &fixture("ycc_420")[..600];
        assert!(matches!(
            decode(half, false),
            Err(ImageError::Truncated { format: "JPEG" })
        ));
        assert!(matches!(decode(&[], false), Err(ImageError::Empty)));
        assert!(matches!(
            decode(b"no image at all", false),
            Err(ImageError::UnknownFormat)
        ));
    }

    /// Where the entropy-coded data between two markers lies, for each scan and restart interval.
    fn intervals(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
        let (mut all, mut at) = (Vec::new(), 2);
        loop {
            assert_eq!(bytes[at], 0xff);
            let marker = bytes[at + 1];
            at += 2;
            match marker {
                0xd9 => return all,
                0xd0..=0xd7 => {}
                _ => at += usize::from(u16::from_be_bytes([bytes[at], bytes[at + 1]])),
            }
            if matches!(marker, 0xda | 0xd0..=0xd7) {
                let from = at;
                while bytes[at] != 0xff || bytes[at + 1] == 0 {
                    at += 1;
                }
                all.push(from..at);
            }
        }
    }

    #[test]
    fn scans_that_end_early_are_errors() {
        for name in [
            "gray",
            "ycc_444",
            "ycc_420",
            "ycc_420_rst",
            "ycc_440_prog",
            "ycc_420_prog_rst",
            "cmyk",
        ] {
            let bytes = fixture(name);
            let all = intervals(&bytes);
            assert_eq!(
                all.len() > 1,
                name.contains("_prog") || name.contains("_rst"),
                "{name}"
            );
            for (k, interval) in all.iter().enumerate() {
                let lengths = interval
                    .clone()
                    .filter(|n| all.len() == 1 || n % 7 == 0 || n + 3 > interval.end);
                for end in lengths {
                    let short = [&bytes[..end], &bytes[interval.end..]].concat();
                    let error = decode(&short, false).expect_err("data that ends early");
                    assert!(
                        matches!(error, ImageError::Truncated { .. }),
                        "{name}, interval {k}, {end}: {error}"
                    );
                }
            }
        }
        // What only zeros can follow is found as well: black from the first block on.
        let flat = DynamicImage::from(image::GrayImage::from_pixel(64, 64, image::Luma([128])));
        let bytes = encode(&flat, ImageFormat::Jpeg);
        assert!(decode(&bytes, false).is_ok());
        let data = intervals(&bytes)[0].clone();
        let short = [&bytes[..data.start + 1], &bytes[data.end..]].concat();
        assert!(matches!(
            decode(&short, false),
            Err(ImageError::Truncated { format: "JPEG" })
        ));
    }

    #[test]
    fn huge_claims_are_refused_before_any_allocation() {
        let mut jpeg = fixture("ycc_420");
        let sof = jpeg.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
        jpeg[sof + 5..sof + 9].copy_from_slice(&[0xea, 0x60, 0xea, 0x60]);
        let mut png = encode(&colourful(8, 8), ImageFormat::Png);
        png[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
        let mut crc = u32::MAX;
        for &b in &png[12..29] {
            crc ^= u32::from(b);
            (0..8).for_each(|_| crc = (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 });
        }
        png[29..33].copy_from_slice(&(!crc).to_be_bytes());
        for bytes in [&jpeg[..], &png[..], b"P5 60000 60000 255\n0000"] {
            for error in [decode(bytes, true).unwrap_err(), dimensions(bytes).unwrap_err()] {
                assert!(
                    matches!(
                        error,
                        ImageError::TooLarge {
                            width: 60_000,
                            height: 60_000
                        }
                    ),
                    "{error}"
                );
            }
        }
    }

    proptest! {
        #[test]
        fn corrupt_bytes_never_panic(
            which in 0usize..9, hits in 1usize..20, seed: u64, colour: bool
        ) {
            let formats = [ImageFormat::Png, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::Gif];
            let names = ["ycc_420", "ycc_440_prog", "cmyk", "ycck", "ycc_420_prog_rst"];
            let mut bytes =
                if which < 4 { encode(&colourful(19, 11), formats[which]) } else { fixture(names[which - 4]) };
            let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
            for _ in 0..hits {
                let at = rng.random_range(0..bytes.len());
                bytes[at] = rng.random_range(0..=255);
            }
            if let Ok(decoded) = decode(&bytes, colour) {
                prop_assert_eq!(decoded.gray().len(), decoded.width() * decoded.height());
            }
        }
    }
}
