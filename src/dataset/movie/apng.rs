//! Animated PNG: frames over each other, as their blending and disposal say.

use super::ahead::Ahead;
use super::{Head, MovieKind, Stream};
use crate::dataset::decode::ImageError;
use crate::dataset::decode::check_size;
use crate::dataset::decode::other::{error_of, remarks_of, size_of};
use image::codecs::png::PngDecoder;
use image::error::DecodingError;
use image::{AnimationDecoder, ImageDecoder, ImageError as Error, ImageFormat};
use std::io::SeekFrom;

const NAME: &str = "PNG";

pub(super) const KIND: MovieKind = MovieKind {
    name: NAME,
    recognises: |magic| image::guess_format(magic).is_ok_and(|format| format == ImageFormat::Png),
    count,
    head,
    open: |stream, _| {
        Ok((
            0,
            Box::new(Ahead::new(NAME, move || {
                Ok(opened(stream)?.apng()?.into_frames())
            })?),
        ))
    },
};

/// Bytes before the first chunk.
const SIGNATURE: u64 = 8;

/// The number of frames that the chunk `acTL` announces; that there are as many is seen from the chunks `fcTL`.
fn count(stream: &mut dyn Stream, most: usize) -> Result<usize, Error> {
    stream.seek(SeekFrom::Start(SIGNATURE))?;
    let (mut announced, mut there) = (1, 0);
    loop {
        let mut head = [0; 8];
        stream.read_exact(&mut head)?;
        let [length, name] = [&head[..4], &head[4..]];
        let mut rest = i64::from(u32::from_be_bytes([length[0], length[1], length[2], length[3]])) + 4;
        match name {
            b"acTL" => {
                let mut number = [0; 4];
                stream.read_exact(&mut number)?;
                rest -= 4;
                announced = u32::from_be_bytes(number) as usize;
                if announced >= most {
                    return Ok(most);
                }
            }
            b"fcTL" => there += 1,
            // The animation is announced before the first picture.
            b"IDAT" if announced < 2 => return Ok(1),
            b"IEND" if there == announced => {
                stream.read_exact(&mut [0; 4])?;
                return Ok(announced);
            }
            b"IEND" => {
                let detail = format!("it announces {announced} pictures and holds {there}");
                return Err(Error::Decoding(DecodingError::new(
                    ImageFormat::Png.into(),
                    detail,
                )));
            }
            _ => {}
        }
        stream.seek_relative(rest)?;
    }
}

fn head(stream: Box<dyn Stream>) -> Result<Head, ImageError> {
    let mut decoder = opened(stream).map_err(|e| error_of(NAME, e))?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    Ok(Head {
        size: size_of(&mut decoder),
        remarks: remarks_of(&mut decoder),
    })
}

fn opened(stream: Box<dyn Stream>) -> Result<PngDecoder<Box<dyn Stream>>, Error> {
    PngDecoder::with_limits(stream, super::limits())
}
