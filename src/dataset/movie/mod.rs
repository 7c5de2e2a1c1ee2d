//! Files with several pictures, each a frame: pages of a TIFF file, an animated GIF or PNG file.
//!
//! A kind of such files is a file here and a line in [`KINDS`]. Pictures are decoded one after the other as frames are
//! asked for, and none is kept, so that a long film takes no more memory than a short one. Depends on decoding and on where
//! files come from.

mod ahead;
mod apng;
mod gif;
mod tiff;

use super::DatasetError;
use super::decode::other::{error_of, pixels};
use super::decode::{Depth16, ImageError, MAX_PIXELS, Remark};
use super::storage::{File, Stream};
use image::{DynamicImage, ImageFormat, Limits};
use mtf::image::Pixels;
use std::hash::Hasher;
use std::io::{Cursor, Read};
use std::sync::{Mutex, PoisonError};
use twox_hash::XxHash64;

/// A kind of files with several pictures.
struct MovieKind {
    /// Name in messages.
    name: &'static str,
    /// What the first bytes are recognised as.
    format: ImageFormat,
    /// Number of pictures, counted up to `most` without decoding any.
    count: fn(&mut dyn Stream, most: usize) -> Result<usize, image::ImageError>,
    /// What is known of the pictures without decoding any.
    head: fn(Box<dyn Stream>) -> Result<Head, ImageError>,
    /// The pictures from `from` (counted from 0) on or, where there is no way to begin there, from the first; and from
    /// which.
    open: fn(Box<dyn Stream>, from: usize) -> Result<(usize, Box<dyn Pictures>), ImageError>,
}

/// What is known of the pictures of a file without decoding any.
struct Head {
    /// Width and height of the first.
    size: (usize, usize),
    /// What is out of the ordinary about any.
    remarks: Vec<Remark>,
}

/// The pictures of a file, one after the other.
trait Pictures: Send {
    /// The next one, upright.
    fn next(&mut self) -> Result<DynamicImage, ImageError>;

    /// Passes over the next one.
    fn skip(&mut self) -> Result<(), ImageError> {
        self.next().map(drop)
    }
}

/// Every kind.
const KINDS: &[MovieKind] = &[tiff::KIND, gif::KIND, apng::KIND];

/// First bytes of a file that tell its kind.
const MAGIC: usize = 32;

/// So many readers of a file wait for their next picture at most: trackers that are at different places.
const IDLE: usize = 8;

/// What decoding an animation may allocate: some pictures of the largest size with R, G, B and alpha.
fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(4 * 4 * MAX_PIXELS);
    limits
}

fn kind_of(magic: &[u8]) -> Option<&'static MovieKind> {
    let format = match tiff::is_big(magic) {
        true => ImageFormat::Tiff,
        false => image::guess_format(magic).ok()?,
    };
    KINDS.iter().find(|kind| kind.format == format)
}

/// Whether there are more pictures in `bytes` than the first.
pub(super) fn has_several(bytes: &[u8]) -> bool {
    let count = |kind: &MovieKind| (kind.count)(&mut Cursor::new(bytes), 2);
    kind_of(bytes).is_some_and(|kind| count(kind).is_ok_and(|n| n > 1))
}

/// A file with several pictures.
pub(super) struct Movie {
    file: File,
    kind: &'static MovieKind,
    pictures: usize,
    head: Head,
    idle: Mutex<Vec<Reader>>,
}

/// A place in a file.
struct Reader {
    pictures: Box<dyn Pictures>,
    /// The picture that comes next.
    next: usize,
}

impl std::fmt::Debug for Movie {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "Movie({}, {} pictures)",
            self.file.path().display(),
            self.pictures
        )
    }
}

impl Movie {
    /// The pictures in `file`; `None` when it does not hold several.
    ///
    /// # Errors
    /// It holds several and is damaged.
    pub fn of(file: &File) -> Result<Option<Movie>, DatasetError> {
        // What cannot be read at all is told when it is read as an image.
        let mut magic = Vec::new();
        let read = |magic: &mut Vec<u8>| file.open().ok()?.take(MAGIC as u64).read_to_end(magic).ok();
        let Some(kind) = read(&mut magic).and_then(|_| kind_of(&magic)) else {
            return Ok(None);
        };
        let count =
            |most| (kind.count)(file.open()?.as_mut(), most).map_err(|e| fault(file, error_of(kind.name, e)));
        if !count(2).is_ok_and(|n| n > 1) {
            return Ok(None);
        }
        Ok(Some(Movie {
            pictures: count(usize::MAX)?,
            head: (kind.head)(file.open()?).map_err(|e| fault(file, e))?,
            file: file.clone(),
            kind,
            idle: Mutex::default(),
        }))
    }

    /// The pictures as frames.
    pub fn frames(&self) -> Vec<File> {
        (1..=self.pictures)
            .map(|number| self.file.picture(number))
            .collect()
    }

    /// Width and height of the first picture.
    pub fn size(&self) -> (usize, usize) {
        self.head.size
    }

    /// What is out of the ordinary about any of the pictures, as far as it shows without decoding.
    pub fn remarks(&self) -> &[Remark] {
        &self.head.remarks
    }

    /// Decodes a picture, counted from 0. Takes up where the picture before it was read, else begins anew. After the last
    /// picture that is `wanted` nothing is kept open.
    pub fn read(
        &self,
        picture: usize,
        colour: bool,
        depth: Depth16,
        wanted: bool,
    ) -> Result<Pixels, DatasetError> {
        let reader = match self.nearest(picture) {
            Some(reader) => Ok(reader),
            None => {
                let opened = (self.kind.open)(self.file.open()?, picture);
                opened.map(|(next, pictures)| Reader { pictures, next })
            }
        };
        let image = reader.and_then(|reader| self.advance(reader, picture, wanted));
        let pixels = image.and_then(|image| pixels(self.kind.name, image, colour, depth));
        pixels.map_err(|e| fault(&self.file.picture(picture + 1), e))
    }

    /// The picture, of a reader that stands before it; keeps the reader for the next one.
    fn advance(&self, mut reader: Reader, picture: usize, wanted: bool) -> Result<DynamicImage, ImageError> {
        while reader.next < picture {
            reader.pictures.skip()?;
            reader.next += 1;
        }
        let image = reader.pictures.next()?;
        reader.next += 1;
        if wanted && reader.next < self.pictures {
            let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
            if idle.len() == IDLE {
                idle.remove(0);
            }
            idle.push(reader);
        }
        Ok(image)
    }

    /// The reader that is nearest before a picture.
    fn nearest(&self, picture: usize) -> Option<Reader> {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let before = idle
            .iter()
            .enumerate()
            .filter(|(_, reader)| reader.next <= picture);
        let (at, _) = before.max_by_key(|(_, reader)| reader.next)?;
        Some(idle.remove(at))
    }

    /// Checksum of the file's bytes (XXH64).
    ///
    /// # Errors
    /// It cannot be read.
    pub fn checksum(&self) -> Result<u64, DatasetError> {
        let mut stream = self.file.open()?;
        let mut hasher = XxHash64::with_seed(0);
        loop {
            let bytes = stream
                .fill_buf()
                .map_err(|e| DatasetError::new(self.file.path(), e.into()))?;
            if bytes.is_empty() {
                return Ok(hasher.finish());
            }
            hasher.write(bytes);
            let read = bytes.len();
            stream.consume(read);
        }
    }
}

fn fault(file: &File, error: ImageError) -> DatasetError {
    DatasetError::new(file.path(), error.into())
}

#[cfg(test)]
mod tests;
