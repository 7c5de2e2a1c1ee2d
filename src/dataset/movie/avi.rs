//! AVI films coded as Motion-JPEG: each picture is a JPEG image in a chunk of its own.
//!
//! The file is a tree of chunks: a name of four letters, a length, so many bytes, a byte more where the length is odd. Lists
//! (`LIST`, `RIFF`) hold further chunks. `strh` and `strf` say what each stream is; the pictures of stream `NN` are the chunks
//! `NNdc` and `NNdb` of the lists `movi`. Long films go on in further lists `RIFF`.

use super::{Head, MovieKind, Picture, Pictures, Stream};
use crate::dataset::decode::{ImageError, dimensions};
use crate::files::Kind;
use image::error::DecodingError;
use image::{ImageError as Error, ImageFormat};
use std::io::{self, Read, SeekFrom};

const NAME: &str = "AVI";

pub(super) const KIND: MovieKind = MovieKind {
    name: NAME,
    recognises: |magic| magic.starts_with(b"RIFF") && magic.get(8..12) == Some(b"AVI "),
    count: |stream, most| Ok(contents(stream, most)?.pictures.len()),
    head,
    open: |mut stream, from| {
        let contents = contents(stream.as_mut(), usize::MAX).map_err(told)?;
        let next = from.min(contents.pictures.len());
        Ok((
            next,
            Box::new(Chunks {
                stream,
                contents,
                next,
            }),
        ))
    },
};

/// Names of Motion-JPEG.
const CODINGS: [&[u8; 4]; 5] = [b"MJPG", b"mjpg", b"AVRn", b"JPEG", b"jpeg"];
/// Lists in lists, at most: a film has three levels.
const DEPTH: usize = 6;

/// Where the pictures are.
#[derive(Default)]
struct Contents {
    /// Number, height and coding of the stream of pictures.
    video: Option<(u32, u32, [u8; 4])>,
    /// Begin and length of each picture. One without bytes is the one before it once more.
    pictures: Vec<(u64, u64)>,
}

fn corrupt(detail: &'static str) -> Error {
    Error::Decoding(DecodingError::new(ImageFormat::Jpeg.into(), detail))
}

/// In the words of this program.
fn told(error: Error) -> ImageError {
    match error {
        Error::Unsupported(e) => ImageError::Unsupported {
            format: NAME,
            detail: e.to_string(),
        },
        other => super::error_of(NAME, other),
    }
}

/// What the file holds, up to `most` pictures. What is missing at its end is left out.
fn contents(stream: &mut dyn Stream, most: usize) -> Result<Contents, Error> {
    let end = stream.seek(SeekFrom::End(0))?;
    let mut walk = Walk {
        stream,
        most,
        streams: 0,
        kind: None,
        found: Contents::default(),
    };
    walk.list(0, end, 0)?;
    let Contents { video, pictures } = walk.found;
    let Some((_, _, coding)) = video else {
        return Err(corrupt("it has no stream of pictures"));
    };
    if !CODINGS.contains(&&coding) {
        let coding = String::from_utf8_lossy(&coding).replace(|c: char| c.is_control(), "?");
        let detail = format!("its pictures are coded as {coding}, not as Motion-JPEG");
        let hint = image::error::ImageFormatHint::Name(detail);
        return Err(Error::Unsupported(image::error::UnsupportedError::from(hint)));
    }
    match pictures.first() {
        Some((_, 0)) => Err(corrupt("its first picture is empty")),
        _ => Ok(Contents { video, pictures }),
    }
}

struct Walk<'a> {
    stream: &'a mut dyn Stream,
    most: usize,
    /// Streams so far.
    streams: u32,
    /// The stream that is described last is one of pictures, in this coding.
    kind: Option<[u8; 4]>,
    found: Contents,
}

impl Walk<'_> {
    /// The chunks from `at` to before `end`.
    fn list(&mut self, mut at: u64, end: u64, depth: usize) -> Result<(), Error> {
        while at + 8 <= end && self.found.pictures.len() < self.most {
            let name: [u8; 4] = self.bytes(at)?;
            let length = u64::from(u32::from_le_bytes(self.bytes(at + 4)?));
            let (begin, stop) = (at + 8, at.saturating_add(8 + length));
            match &name {
                b"RIFF" | b"LIST" if depth < DEPTH && begin + 4 <= end => {
                    self.list(begin + 4, stop.min(end), depth + 1)?;
                }
                b"strh" if begin + 8 <= end => {
                    let kind: [u8; 4] = self.bytes(begin)?;
                    self.kind = if &kind == b"vids" {
                        Some(self.bytes(begin + 4)?)
                    } else {
                        None
                    };
                    self.streams += 1;
                }
                // The header of a bitmap: size, width, height, planes and depth, coding.
                b"strf" if begin + 20 <= end => {
                    if let Some(handler) = self.kind.take().filter(|_| self.found.video.is_none()) {
                        let height = i32::from_le_bytes(self.bytes(begin + 8)?).unsigned_abs();
                        let coding: [u8; 4] = self.bytes(begin + 16)?;
                        let known = CODINGS.contains(&&coding);
                        let coding = if known { coding } else { handler };
                        self.found.video = Some((self.streams - 1, height, coding));
                    }
                }
                // A picture whose end is missing is told when it is read.
                [a, b, b'd', b'c' | b'b'] if self.is_video([*a, *b]) && begin < end => {
                    self.found.pictures.push((begin, length.min(end - begin)));
                }
                _ => {}
            }
            at = stop.saturating_add(length % 2);
        }
        Ok(())
    }

    fn is_video(&self, number: [u8; 2]) -> bool {
        let number = std::str::from_utf8(&number).ok().and_then(|n| n.parse().ok());
        self.found
            .video
            .is_some_and(|(stream, ..)| number == Some(stream))
    }

    fn bytes<const N: usize>(&mut self, at: u64) -> io::Result<[u8; N]> {
        let mut bytes = [0; N];
        self.stream.seek(SeekFrom::Start(at))?;
        self.stream.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

fn head(mut stream: Box<dyn Stream>) -> Result<Head, ImageError> {
    let contents = contents(stream.as_mut(), 1).map_err(told)?;
    let size = match contents.pictures.first() {
        Some(&picture) => dimensions(&jpeg(stream.as_mut(), picture)?)?,
        None => (0, 0),
    };
    if contents
        .video
        .is_some_and(|(_, height, _)| size.1 > 0 && height as usize == 2 * size.1)
    {
        return Err(ImageError::Unsupported {
            format: NAME,
            detail: "its pictures are interlaced".into(),
        });
    }
    Ok(Head {
        size,
        remarks: Vec::new(),
    })
}

/// The bytes of a picture.
fn jpeg(stream: &mut dyn Stream, (begin, length): (u64, u64)) -> Result<Vec<u8>, ImageError> {
    Kind::IMAGE.within(length).map_err(ImageError::Refused)?;
    stream.seek(SeekFrom::Start(begin))?;
    let mut bytes = Vec::new();
    stream.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

struct Chunks {
    stream: Box<dyn Stream>,
    contents: Contents,
    next: usize,
}

impl Pictures for Chunks {
    fn next(&mut self) -> Result<Picture, ImageError> {
        let until = self.contents.pictures.get(..=self.next);
        let until = until.ok_or(ImageError::Truncated { format: NAME })?;
        let picture = until.iter().rev().find(|(_, length)| *length > 0);
        let picture = *picture.ok_or(ImageError::Truncated { format: NAME })?;
        self.next += 1;
        Ok(Picture::Coded(jpeg(self.stream.as_mut(), picture)?))
    }

    fn skip(&mut self) -> Result<(), ImageError> {
        self.next += 1;
        Ok(())
    }
}
