//! The formats that the `image` crate reads.

use super::{Depth16, ImageError, ImageKind, Remark, check_size, is_turned, one_line};
use crate::dataset::movie;
use image::ColorType::{L16, La16, Rgb16, Rgba16};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use mtf::image::Pixels;
use std::io::{Cursor, ErrorKind};

pub(super) const fn kind(
    name: &'static str,
    extensions: &'static [&'static str],
    format: ImageFormat,
) -> ImageKind {
    ImageKind {
        name,
        extensions,
        format,
        size,
        decode,
        remarks,
    }
}

fn size(kind: &ImageKind, bytes: &[u8]) -> Result<(usize, usize), ImageError> {
    Ok(size_of(&mut opened(kind, bytes)?))
}

/// Width and height of the upright picture.
pub(in crate::dataset) fn size_of(decoder: &mut impl ImageDecoder) -> (usize, usize) {
    let (width, height) = decoder.dimensions();
    let (width, height) = match is_turned(orientation(decoder)) {
        true => (height, width),
        false => (width, height),
    };
    (width as usize, height as usize)
}

/// How the picture is to be turned, as its tags say.
fn orientation(decoder: &mut impl ImageDecoder) -> Orientation {
    decoder.orientation().unwrap_or(Orientation::NoTransforms)
}

fn remarks(kind: &ImageKind, bytes: &[u8]) -> Vec<Remark> {
    let Ok(mut decoder) = opened(kind, bytes) else {
        return Vec::new();
    };
    let mut remarks = remarks_of(&mut decoder);
    if movie::has_several(bytes) {
        remarks.push(Remark::Several);
    }
    remarks
}

/// What is out of the ordinary about one picture.
pub(in crate::dataset) fn remarks_of(decoder: &mut impl ImageDecoder) -> Vec<Remark> {
    let deep = matches!(decoder.color_type(), L16 | La16 | Rgb16 | Rgba16);
    let turned = Remark::turned(orientation(decoder));
    turned
        .into_iter()
        .chain(deep.then_some(Remark::SixteenBits))
        .collect()
}

fn opened<'a>(kind: &ImageKind, bytes: &'a [u8]) -> Result<impl ImageDecoder + 'a, ImageError> {
    let reader = ImageReader::with_format(Cursor::new(bytes), kind.format);
    let decoder = reader.into_decoder().map_err(|e| error_of(kind.name, e))?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    Ok(decoder)
}

fn decode(kind: &ImageKind, bytes: &[u8], colour: bool, depth: Depth16) -> Result<Pixels, ImageError> {
    let image = upright(kind.name, opened(kind, bytes)?)?;
    pixels(kind.name, image, colour, depth)
}

/// The picture, turned as its tags say.
pub(in crate::dataset) fn upright(
    format: &'static str,
    mut decoder: impl ImageDecoder,
) -> Result<DynamicImage, ImageError> {
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    let orientation = orientation(&mut decoder);
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| error_of(format, e))?;
    image.apply_orientation(orientation);
    Ok(image)
}

/// The pixels of an upright picture, with R, G, B when asked for; 16 bits brought to 8 by the rule.
pub(in crate::dataset) fn pixels(
    format: &'static str,
    mut image: DynamicImage,
    colour: bool,
    depth: Depth16,
) -> Result<Pixels, ImageError> {
    depth.apply(&mut image);
    let (width, height) = (image.width() as usize, image.height() as usize);
    if width == 0 || height == 0 {
        return Err(ImageError::Corrupt {
            format,
            detail: "it has no pixels".into(),
        });
    }
    Ok(if !image.color().has_color() {
        Pixels::from_gray(width, height, image.into_luma8().into_raw())
    } else {
        let decoded = Pixels::from_rgb(width, height, image.into_rgb8().into_raw());
        if colour { decoded } else { decoded.without_colour() }
    })
}

/// An error of the `image` crate about a file of the kind `format`.
pub(in crate::dataset) fn error_of(format: &'static str, error: image::ImageError) -> ImageError {
    use image::ImageError as E;
    match error {
        E::IoError(e) if e.kind() == ErrorKind::UnexpectedEof => ImageError::Truncated { format },
        E::Unsupported(e) => ImageError::Unsupported {
            format,
            detail: one_line(&e.to_string()),
        },
        other => ImageError::Corrupt {
            format,
            detail: one_line(&other.to_string()),
        },
    }
}
