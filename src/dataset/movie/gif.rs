//! Animated GIF: frames over each other, as their disposal and transparency say.

use super::ahead::Ahead;
use super::{Head, MovieKind, Stream};
use crate::dataset::decode::other::{error_of, size_of};
use crate::dataset::decode::{ImageError, check_size};
use gif::DecodingError;
use image::codecs::gif::GifDecoder;
use image::{AnimationDecoder, ImageDecoder, ImageError as Error, ImageFormat};
use std::io::ErrorKind;

const NAME: &str = "GIF";

pub(super) const KIND: MovieKind = MovieKind {
    name: NAME,
    recognises: |magic| image::guess_format(magic).is_ok_and(|format| format == ImageFormat::Gif),
    count,
    head,
    open: |stream, _| {
        Ok((
            0,
            Box::new(Ahead::new(NAME, move || Ok(opened(stream)?.into_frames()))?),
        ))
    },
};

fn count(stream: &mut dyn Stream, most: usize) -> Result<usize, Error> {
    let mut options = gif::DecodeOptions::new();
    options.skip_frame_decoding(true);
    let mut decoder = options.read_info(stream).map_err(error)?;
    let mut count = 0;
    while count < most && decoder.next_frame_info().map_err(error)?.is_some() {
        count += 1;
    }
    Ok(count)
}

fn error(error: DecodingError) -> Error {
    match error {
        DecodingError::Io(e) => Error::IoError(e),
        DecodingError::UnexpectedEof => Error::IoError(ErrorKind::UnexpectedEof.into()),
        other => Error::Decoding(image::error::DecodingError::new(ImageFormat::Gif.into(), other)),
    }
}

fn head(stream: Box<dyn Stream>) -> Result<Head, ImageError> {
    let mut decoder = opened(stream).map_err(|e| error_of(NAME, e))?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    Ok(Head {
        size: size_of(&mut decoder),
        remarks: Vec::new(),
    })
}

/// A frame may claim more pixels than the picture has.
fn opened(stream: Box<dyn Stream>) -> Result<GifDecoder<Box<dyn Stream>>, Error> {
    let mut decoder = GifDecoder::new(stream)?;
    decoder.set_limits(super::limits())?;
    Ok(decoder)
}
