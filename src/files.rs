//! Reading of the files that a user names or puts into a folder: regular files only, each kind up to a size.
//!
//! A named pipe, a socket or a device is refused before it is opened, because opening or reading one may wait or go on
//! for ever. A file larger than its kind can be is refused before it is read. Depends on nothing.

use ruzstd::decoding::StreamingDecoder;
use std::fs::{self, FileType, Metadata};
use std::io::{self, Read};
use std::path::Path;

/// A kind of file, and how large one of it may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    about: &'static str,
    most: u64,
}

impl Kind {
    /// Refuses so many bytes where that is more than one of its kind can have.
    pub(crate) fn within(self, bytes: u64) -> Result<(), Refused> {
        let Kind { about, most } = self;
        match bytes > most {
            true => Err(Refused::TooLarge { bytes, most, about }),
            false => Ok(()),
        }
    }

    /// An image: 512 MiB. The largest that is decoded has 2^26 pixels, which take 8 bytes each with R, G, B and alpha of 16
    /// bits.
    pub const IMAGE: Kind = Kind {
        about: "an image",
        most: 1 << 29,
    };
    /// Ground truth: 512 MiB. A row with the points of a dense grid takes some 50 kB, so this is 10,000 frames of them,
    /// or five million rows of four corners.
    pub const TRUTH: Kind = Kind {
        about: "ground truth",
        most: 1 << 29,
    };
    /// Settings that people write, in TOML, JSON or words: 16 MiB, far more than anybody writes.
    pub const SETTINGS: Kind = Kind {
        about: "settings",
        most: 1 << 24,
    };
    /// Results that this program writes as one document, such as a baseline: 512 MiB. A tracker on a sequence takes some
    /// 200 bytes, so this is two million of them.
    pub const RESULTS: Kind = Kind {
        about: "results",
        most: 1 << 29,
    };
}

/// Why a file is not read. Inside the [`io::Error`] of [`read`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// It is something else than a regular file.
    #[error("not a regular file but {0}; give a regular file")]
    Irregular(&'static str),
    /// It is larger than its kind can be.
    #[error("the file has {bytes} bytes, more than the limit of {most} for {about}; give a smaller one")]
    TooLarge {
        /// Its size in bytes.
        bytes: u64,
        /// The limit in bytes.
        most: u64,
        /// What it was read as.
        about: &'static str,
    },
}

impl Refused {
    /// The refusal inside an error of [`read`]; `None` when the system said no.
    pub fn of(error: &io::Error) -> Option<Refused> {
        error.get_ref()?.downcast_ref().copied()
    }
}

impl From<Refused> for io::Error {
    fn from(refused: Refused) -> io::Error {
        io::Error::new(io::ErrorKind::InvalidInput, refused)
    }
}

/// What something is that is no regular file; `None` for one that is.
pub fn irregular(kind: FileType) -> Option<&'static str> {
    if kind.is_file() {
        return None;
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return Some("a named pipe");
        }
        if kind.is_socket() {
            return Some("a socket");
        }
        if kind.is_block_device() || kind.is_char_device() {
            return Some("a device");
        }
    }
    Some(if kind.is_symlink() {
        "a link"
    } else if kind.is_dir() {
        "a folder"
    } else {
        "something else"
    })
}

/// Content of the file at `path`, links followed.
///
/// # Errors
/// [`Refused`] for what is no regular file or too large for its `kind`; else what the system says.
pub fn read(path: &Path, kind: Kind) -> io::Result<Vec<u8>> {
    // Before it is opened: opening a named pipe waits for somebody to write into it.
    check(&fs::metadata(path)?, kind)?;
    let file = fs::File::open(path)?;
    // Another file may have taken the name since.
    let meta = file.metadata()?;
    check(&meta, kind)?;
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(meta.len() as usize)?;
    // It may grow while it is read, and some systems' own files have a size of 0.
    file.take(kind.most + 1).read_to_end(&mut bytes)?;
    kind.within(bytes.len() as u64)?;
    Ok(bytes)
}

/// `bytes` without their compression (Zstandard), if they have one.
///
/// # Errors
/// What is wrong with the compressed bytes.
pub fn unpack(bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
    if !bytes.starts_with(&MAGIC) {
        return Ok(bytes);
    }
    let mut text = Vec::new();
    let mut decoder = StreamingDecoder::new(bytes.as_slice()).map_err(|e| e.to_string())?;
    decoder.read_to_end(&mut text).map_err(|e| e.to_string())?;
    Ok(text)
}

/// The file at `path` to be read piece by piece, links followed.
///
/// # Errors
/// [`Refused`] for what is no regular file; else what the system says.
pub fn open(path: &Path) -> io::Result<fs::File> {
    match irregular(fs::metadata(path)?.file_type()) {
        Some(what) => Err(Refused::Irregular(what).into()),
        None => fs::File::open(path),
    }
}

/// [`read`] of a text.
///
/// # Errors
/// As [`read`], and when it is not UTF-8.
pub fn read_text(path: &Path, kind: Kind) -> io::Result<String> {
    let bytes = read(path, kind)?;
    String::from_utf8(bytes).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "not a text in UTF-8"))
}

fn check(meta: &Metadata, kind: Kind) -> Result<(), Refused> {
    match irregular(meta.file_type()) {
        Some(what) => Err(Refused::Irregular(what)),
        None => kind.within(meta.len()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_regular_file_is_refused_without_opening_it() {
        let dir = tempfile::tempdir().unwrap();
        let refusal = |path: &Path| Refused::of(&read(path, Kind::TRUTH).unwrap_err());
        assert_eq!(refusal(dir.path()), Some(Refused::Irregular("a folder")));
        assert_eq!(refusal(&dir.path().join("none")), None);
        #[cfg(unix)]
        {
            let socket = dir.path().join("socket");
            let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
            assert_eq!(refusal(&socket), Some(Refused::Irregular("a socket")));
            assert!(open(&socket).is_err());
            assert_eq!(
                refusal(Path::new("/dev/zero")),
                Some(Refused::Irregular("a device"))
            );
        }
    }

    #[test]
    fn files_are_read_up_to_the_size_of_their_kind() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        let small = Kind {
            about: "a test",
            most: 4,
        };
        fs::write(&path, "four").unwrap();
        assert_eq!(read_text(&path, small).unwrap(), "four");
        fs::write(&path, "fifth").unwrap();
        let error = read(&path, small).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the file has 5 bytes, more than the limit of 4 for a test; give a smaller one"
        );
        // Mostly holes: a size without content.
        fs::File::create(&path).unwrap().set_len(1 << 40).unwrap();
        for kind in [Kind::IMAGE, Kind::TRUTH, Kind::SETTINGS, Kind::RESULTS] {
            assert!(matches!(
                Refused::of(&read(&path, kind).unwrap_err()),
                Some(Refused::TooLarge { .. })
            ));
        }
        fs::write(&path, b"\xff").unwrap();
        assert!(read_text(&path, small).unwrap_err().to_string().contains("UTF-8"));
    }
}
