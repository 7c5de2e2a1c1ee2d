//! The formats that the `image` crate reads.

use super::{ImageError, ImageKind, check_size, one_line};
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
    }
}

fn size(kind: &ImageKind, bytes: &[u8]) -> Result<(usize, usize), ImageError> {
    let (width, height) = opened(kind, bytes)?.dimensions();
    Ok((width as usize, height as usize))
}

fn opened<'a>(kind: &ImageKind, bytes: &'a [u8]) -> Result<impl ImageDecoder + 'a, ImageError> {
    let reader = ImageReader::with_format(Cursor::new(bytes), kind.format);
    let decoder = reader.into_decoder().map_err(|e| error_of(kind.name, e))?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    Ok(decoder)
}

fn decode(kind: &ImageKind, bytes: &[u8], colour: bool) -> Result<Pixels, ImageError> {
    let decoder = opened(kind, bytes)?;
    let image = DynamicImage::from_decoder(decoder).map_err(|e| error_of(kind.name, e))?;
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
