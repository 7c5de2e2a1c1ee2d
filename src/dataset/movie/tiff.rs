//! Pages of a TIFF file, each read as if it were the first: the header leads to it.

use super::{Head, MovieKind, Picture, Pictures, Stream};
use crate::dataset::decode::other::{error_of, remarks_of, size_of, upright};
use crate::dataset::decode::{ImageError, Remark};
use image::codecs::tiff::TiffDecoder;
use image::error::DecodingError;
use image::{ImageDecoder, ImageError as Error, ImageFormat};
use std::collections::{BTreeSet, HashSet};
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use tiff::TiffError;
use tiff::decoder::Decoder;

const NAME: &str = "TIFF";

pub(super) const KIND: MovieKind = MovieKind {
    name: NAME,
    recognises: |magic| is_big(magic) || image::guess_format(magic).is_ok_and(|f| f == ImageFormat::Tiff),
    count: |stream, most| Ok(directories(stream, most)?.len()),
    head,
    open: |mut stream, from| {
        let offsets = directories(stream.as_mut(), usize::MAX).map_err(|e| error_of(NAME, e))?;
        let next = from.min(offsets.len());
        Ok((
            next,
            Box::new(Pages {
                stream,
                offsets,
                next,
            }),
        ))
    },
};

/// Whether a file begins like one with offsets of 64 bits, for files beyond 4 GiB.
pub(super) fn is_big(magic: &[u8]) -> bool {
    magic.starts_with(b"II\x2b\0") || magic.starts_with(b"MM\0\x2b")
}

/// Where the directories of the pages are.
fn directories(stream: &mut dyn Stream, most: usize) -> Result<Vec<u64>, Error> {
    stream.rewind()?;
    let mut decoder = Decoder::new(stream).map_err(error)?;
    let (mut offsets, mut seen) = (Vec::new(), HashSet::new());
    let mut next = decoder.ifd_pointer();
    while let Some(pointer) = next.filter(|_| offsets.len() < most) {
        if !seen.insert(pointer.0) {
            let detail = "its pages lead back to an earlier one";
            return Err(Error::Decoding(DecodingError::new(
                ImageFormat::Tiff.into(),
                detail,
            )));
        }
        next = decoder.read_directory(pointer).map_err(error)?.next();
        offsets.push(pointer.0);
    }
    Ok(offsets)
}

fn error(error: TiffError) -> Error {
    match error {
        TiffError::IoError(e) => Error::IoError(e),
        other => Error::Decoding(DecodingError::new(ImageFormat::Tiff.into(), other)),
    }
}

fn head(mut stream: Box<dyn Stream>) -> Result<Head, ImageError> {
    let offsets = directories(stream.as_mut(), usize::MAX).map_err(|e| error_of(NAME, e))?;
    let mut size = None;
    let mut remarks: BTreeSet<Remark> = BTreeSet::new();
    for offset in offsets {
        // What is wrong with a later page is told when it is read.
        match page(stream.as_mut(), offset) {
            Ok(mut decoder) => {
                size.get_or_insert_with(|| size_of(&mut decoder));
                remarks.extend(remarks_of(&mut decoder));
            }
            Err(e) if size.is_none() => return Err(e),
            Err(_) => {}
        }
    }
    Ok(Head {
        size: size.unwrap_or_default(),
        remarks: remarks.into_iter().collect(),
    })
}

/// The pages from one on.
struct Pages {
    stream: Box<dyn Stream>,
    offsets: Vec<u64>,
    next: usize,
}

impl Pictures for Pages {
    fn next(&mut self) -> Result<Picture, ImageError> {
        // Fewer than were counted.
        let offset = *self
            .offsets
            .get(self.next)
            .ok_or(ImageError::Truncated { format: NAME })?;
        self.next += 1;
        upright(NAME, page(self.stream.as_mut(), offset)?).map(Picture::Decoded)
    }

    fn skip(&mut self) -> Result<(), ImageError> {
        self.next += 1;
        Ok(())
    }
}

/// The page whose directory is at `offset`.
fn page(stream: &mut dyn Stream, offset: u64) -> Result<impl ImageDecoder, ImageError> {
    let view = View::new(stream, offset)?;
    TiffDecoder::new(BufReader::new(view)).map_err(|e| error_of(NAME, e))
}

/// A file whose header leads to another directory than its own.
struct View<'a> {
    stream: &'a mut dyn Stream,
    /// Where reading goes on.
    at: u64,
    /// Where the header says which directory is the first.
    begin: u64,
    first: Vec<u8>,
}

impl<'a> View<'a> {
    fn new(stream: &'a mut dyn Stream, offset: u64) -> io::Result<View<'a>> {
        let mut header = [0; 4];
        stream.rewind()?;
        stream.read_exact(&mut header)?;
        stream.rewind()?;
        let big = is_big(&header);
        let mut first = offset.to_be_bytes().to_vec();
        if !big {
            first.drain(..4);
        }
        if header.starts_with(b"II") {
            first.reverse();
        }
        let begin = if big { 8 } else { 4 };
        Ok(View {
            stream,
            at: 0,
            begin,
            first,
        })
    }
}

impl Read for View<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let read = self.stream.read(out)?;
        for (byte, at) in out[..read].iter_mut().zip(self.at..) {
            let index = at.checked_sub(self.begin).and_then(|i| usize::try_from(i).ok());
            if let Some(&other) = index.and_then(|i| self.first.get(i)) {
                *byte = other;
            }
            if at >= self.begin + self.first.len() as u64 {
                break;
            }
        }
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for View<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.stream.seek(to)?;
        Ok(self.at)
    }
}
