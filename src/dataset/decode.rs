//! Decoding of image files into 8-bit pixels. Formats are recognised by content, never by name.
//!
//! A format is a line in [`KINDS`], and a file in `decode/` unless the decoder of the others reads it.

mod depth;
mod entropy;
mod huffman;
mod jpeg;
pub(super) mod other;
mod remark;

pub use depth::Depth16;
pub use remark::{Remark, Standing};

use crate::files::{self, Kind, Refused};
use image::metadata::Orientation;
use image::{DynamicImage, GrayImage, ImageFormat, RgbImage};
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
    /// The pixels, with R, G, B when asked for; 16 bits brought to 8 by the rule.
    decode: fn(&ImageKind, &[u8], bool, Depth16) -> Result<Pixels, ImageError>,
    /// What is out of the ordinary, as far as it shows without the pixels.
    remarks: fn(&ImageKind, &[u8]) -> Vec<Remark>,
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
/// Turned upright as the file's orientation tag says; of several images in a file, the first.
pub fn decode(bytes: &[u8], colour: bool) -> Result<Pixels, ImageError> {
    decode_by(bytes, colour, Depth16::default())
}

/// [`decode`] that brings 16 bits per channel to 8 by the rule `depth`.
pub(super) fn decode_by(bytes: &[u8], colour: bool, depth: Depth16) -> Result<Pixels, ImageError> {
    let kind = kind_of(bytes)?;
    (kind.decode)(kind, bytes, colour, depth)
}

/// What is out of the ordinary about the image in `bytes`, as far as it shows without decoding.
pub(super) fn remarks(bytes: &[u8]) -> Vec<Remark> {
    kind_of(bytes).map_or_else(|_| Vec::new(), |kind| (kind.remarks)(kind, bytes))
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

/// Whether width and height change places.
fn is_turned(orientation: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    matches!(orientation, Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH)
}

/// Row-major pixels of 1 or 3 channels, turned; with their width and height.
fn turn(
    width: usize,
    height: usize,
    channels: usize,
    pixels: Vec<u8>,
    orientation: Orientation,
) -> (usize, usize, Vec<u8>) {
    if orientation == Orientation::NoTransforms {
        return (width, height, pixels);
    }
    let (w, h) = (width as u32, height as u32);
    let image = match channels {
        1 => GrayImage::from_raw(w, h, pixels).map(DynamicImage::from),
        _ => RgbImage::from_raw(w, h, pixels).map(DynamicImage::from),
    };
    // Callers have counted the pixels.
    let mut image = image.unwrap_or_default();
    image.apply_orientation(orientation);
    (
        image.width() as usize,
        image.height() as usize,
        image.into_bytes(),
    )
}

pub(super) fn check_size(width: u64, height: u64) -> Result<(), ImageError> {
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
            // The last bytes of a PNG are its end chunk, which decoders need not read; those of a JPEG are its end mark.
            let last = match bytes[..2] {
                [0x89, b'P'] => bytes.len() - 16,
                [0xff, 0xd8] => bytes.len() - 3,
                _ => bytes.len() - 1,
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
    fn a_jpeg_without_end_mark_is_read_when_its_codes_are_whole() {
        let names = [
            "gray",
            "ycc_444",
            "ycc_420",
            "ycc_420_rst",
            "ycc_440_prog",
            "ycc_420_prog_rst",
            "cmyk",
        ];
        for name in names {
            let bytes = fixture(name);
            let expected = decode(&bytes, true).unwrap();
            assert_eq!(remarks(&bytes), [], "{name}");
            for cut in [1, 2] {
                let short = &bytes[..bytes.len() - cut];
                assert_eq!(decode(short, true).unwrap(), expected, "{name}, {cut}");
                assert_eq!(remarks(short), [Remark::NoEndMark], "{name}");
            }
            // As cameras pad them.
            let padded = [&bytes[..bytes.len() - 2], &[0; 40]].concat();
            assert_eq!(decode(&padded, true).unwrap(), expected, "{name}");
        }
    }

    #[test]
    fn a_jpeg_without_tables_is_read_with_the_standard_ones() {
        for image in [
            colourful(37, 29),
            DynamicImage::from(colourful(37, 29).to_luma8()),
        ] {
            let whole = encode(&image, ImageFormat::Jpeg);
            let (mut bare, mut at) = (whole[..2].to_vec(), 2);
            while whole[at + 1] != 0xda {
                let end = at + 2 + usize::from(u16::from_be_bytes([whole[at + 2], whole[at + 3]]));
                if whole[at + 1] != 0xc4 {
                    bare.extend_from_slice(&whole[at..end]);
                }
                at = end;
            }
            bare.extend_from_slice(&whole[at..]);
            assert!(bare.len() < whole.len());
            assert_eq!(decode(&bare, true).unwrap(), decode(&whole, true).unwrap());
            assert_eq!(dimensions(&bare).unwrap(), (37, 29));
            assert_eq!(remarks(&bare), [Remark::StandardTables]);
            let half = &bare[..bare.len() - 90];
            assert!(matches!(decode(half, true), Err(ImageError::Truncated { .. })));
        }
    }

    /// The file with an Exif segment that says `tag`, for JPEG; PNG and TIFF have it in places of their own.
    fn tagged(image: &DynamicImage, format: ImageFormat, tag: u8) -> Vec<u8> {
        let exif = [
            b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".as_slice(),
            &[tag, 0, 0, 0, 0, 0, 0, 0],
        ]
        .concat();
        let bytes = encode(image, format);
        match format {
            ImageFormat::Jpeg => {
                let length = (2 + 6 + exif.len() as u16).to_be_bytes();
                [
                    &bytes[..2],
                    &[0xff, 0xe1],
                    &length,
                    b"Exif\0\0",
                    &exif,
                    &bytes[2..],
                ]
                .concat()
            }
            ImageFormat::Png => {
                let mut out = Vec::new();
                let mut encoder = image::codecs::png::PngEncoder::new(&mut out);
                image::ImageEncoder::set_exif_metadata(&mut encoder, exif).unwrap();
                image.write_with_encoder(encoder).unwrap();
                out
            }
            _ => tiff_pages(image, 1, tag),
        }
    }

    fn tiff_pages(image: &DynamicImage, pages: usize, tag: u8) -> Vec<u8> {
        use tiff::{encoder::TiffEncoder, encoder::colortype::RGB8, tags::Tag};
        let mut out = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut out).unwrap();
        for _ in 0..pages {
            let mut page = encoder.new_image::<RGB8>(image.width(), image.height()).unwrap();
            page.encoder()
                .write_tag(Tag::Orientation, u16::from(tag))
                .unwrap();
            page.write_data(image.as_bytes()).unwrap();
        }
        out.into_inner()
    }

    #[test]
    fn images_are_turned_as_their_tags_say() {
        let image = colourful(37, 29);
        for format in [ImageFormat::Jpeg, ImageFormat::Png, ImageFormat::Tiff] {
            let plain = decode(&tagged(&image, format, 1), true).unwrap();
            assert_eq!(plain, decode(&encode(&image, format), true).unwrap());
            for tag in 1..=8 {
                let bytes = tagged(&image, format, tag);
                let turned = decode(&bytes, true).unwrap();
                let (w, h) = (turned.width(), turned.height());
                assert_eq!(
                    (w, h),
                    if tag < 5 { (37, 29) } else { (29, 37) },
                    "{format:?} {tag}"
                );
                assert_eq!(dimensions(&bytes).unwrap(), (w, h));
                // Where each pixel of the upright picture is in the file: what row 0 and column 0 of it show (Exif 2.3, 4.6.4).
                let place = |x: usize, y: usize| match tag {
                    1 => (x, y),
                    2 => (36 - x, y),
                    3 => (36 - x, 28 - y),
                    4 => (x, 28 - y),
                    5 => (y, x),
                    6 => (y, 28 - x),
                    7 => (36 - y, 28 - x),
                    _ => (36 - y, x),
                };
                let gray = decode(&bytes, false).unwrap();
                for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
                    let (px, py) = place(x, y);
                    let (at, from) = (y * w + x, py * 37 + px);
                    assert_eq!(turned.gray()[at], plain.gray()[from], "{format:?} {tag} {x},{y}");
                    assert_eq!(gray.gray()[at], plain.gray()[from], "{format:?} {tag} {x},{y}");
                    assert_eq!(turned.rgb().unwrap()[3 * at], plain.rgb().unwrap()[3 * from]);
                }
                let remark = (tag > 1).then_some(Remark::Turned(tag));
                assert_eq!(
                    remarks(&bytes),
                    remark.into_iter().collect::<Vec<_>>(),
                    "{format:?}"
                );
            }
        }
    }

    #[test]
    fn files_of_several_images_are_told() {
        let image = colourful(9, 7);
        assert_eq!(remarks(&tiff_pages(&image, 1, 1)), []);
        assert_eq!(remarks(&tiff_pages(&image, 2, 1)), [Remark::Several]);
        let gif = |frames: usize| {
            let mut out = Vec::new();
            let mut encoder = image::codecs::gif::GifEncoder::new(&mut out);
            let frame = || image::Frame::new(image.to_rgba8());
            encoder.encode_frames((0..frames).map(|_| frame())).unwrap();
            drop(encoder);
            out
        };
        assert_eq!(remarks(&gif(1)), []);
        assert_eq!(remarks(&gif(3)), [Remark::Several]);
        let png = encode(&image, ImageFormat::Png);
        assert_eq!(remarks(&png), []);
        // A chunk acTL after the header makes an animation of it.
        let control = [b"acTL".as_slice(), &[0, 0, 0, 2, 0, 0, 0, 0]].concat();
        let mut crc = u32::MAX;
        for &b in &control {
            crc ^= u32::from(b);
            (0..8).for_each(|_| crc = (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 });
        }
        let animated = [
            &png[..33],
            &[0, 0, 0, 8],
            &control,
            &(!crc).to_be_bytes(),
            &png[33..],
        ]
        .concat();
        assert_eq!(remarks(&animated), [Remark::Several]);
        assert_eq!(decode(&animated, true).unwrap(), decode(&png, true).unwrap());
    }

    #[test]
    fn sixteen_bits_are_told() {
        let deep = image::ImageBuffer::from_fn(40, 30, |x, y| image::Luma([51_241 + (x + y) as u16]));
        let bytes = encode(&deep.into(), ImageFormat::Png);
        assert_eq!(remarks(&bytes), [Remark::SixteenBits]);
        let by = |rule: &str| decode_by(&bytes, false, rule.parse().unwrap()).unwrap();
        assert_eq!(Remark::sliver(&by("scale")), Some(Remark::Sliver(2)));
        assert_eq!(Remark::sliver(&by("minmax")), None);
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
