//! The formats that the `image` crate reads.

use super::{Depth16, ImageError, ImageKind, Remark, check_size, is_turned, one_line};
use image::ColorType::{L16, La16, Rgb16, Rgba16};
use image::codecs::{gif::GifDecoder, png::PngDecoder};
use image::metadata::Orientation;
use image::{AnimationDecoder, DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use mtf::image::Pixels;
use std::io::{Cursor, ErrorKind};
use tiff::decoder::Decoder as TiffDecoder;

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
    let mut decoder = opened(kind, bytes)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = match is_turned(orientation(&mut decoder)) {
        true => (height, width),
        false => (width, height),
    };
    Ok((width as usize, height as usize))
}

/// How the picture is to be turned, as its tags say.
fn orientation(decoder: &mut impl ImageDecoder) -> Orientation {
    decoder.orientation().unwrap_or(Orientation::NoTransforms)
}

fn remarks(kind: &ImageKind, bytes: &[u8]) -> Vec<Remark> {
    let Ok(mut decoder) = opened(kind, bytes) else {
        return Vec::new();
    };
    let mut remarks: Vec<Remark> = Remark::turned(orientation(&mut decoder)).into_iter().collect();
    if matches!(decoder.color_type(), L16 | La16 | Rgb16 | Rgba16) {
        remarks.push(Remark::SixteenBits);
    }
    if has_several(kind, bytes) {
        remarks.push(Remark::Several);
    }
    remarks
}

/// Whether the file holds more images than the one that is read.
fn has_several(kind: &ImageKind, bytes: &[u8]) -> bool {
    let bytes = Cursor::new(bytes);
    match kind.format {
        ImageFormat::Tiff => TiffDecoder::new(bytes).is_ok_and(|tiff| tiff.more_images()),
        ImageFormat::Png => PngDecoder::new(bytes)
            .and_then(|png| png.is_apng())
            .unwrap_or(false),
        ImageFormat::Gif => GifDecoder::new(bytes).is_ok_and(|gif| gif.into_frames().take(2).count() > 1),
        _ => false,
    }
}

fn opened<'a>(kind: &ImageKind, bytes: &'a [u8]) -> Result<impl ImageDecoder + 'a, ImageError> {
    let reader = ImageReader::with_format(Cursor::new(bytes), kind.format);
    let decoder = reader.into_decoder().map_err(|e| error_of(kind.name, e))?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    Ok(decoder)
}

fn decode(kind: &ImageKind, bytes: &[u8], colour: bool, depth: Depth16) -> Result<Pixels, ImageError> {
    let mut decoder = opened(kind, bytes)?;
    let orientation = orientation(&mut decoder);
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| error_of(kind.name, e))?;
    image.apply_orientation(orientation);
    depth.apply(&mut image);
    let (width, height) = (image.width() as usize, image.height() as usize);
    if width == 0 || height == 0 {
        return Err(ImageError::Corrupt {
            format: kind.name,
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

fn error_of(format: &'static str, error: image::ImageError) -> ImageError {
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
