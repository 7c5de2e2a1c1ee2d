//! Where the bytes of a dataset come from: files on disk or files embedded in the program.

use super::{DatasetError, DatasetErrorKind, order::natural};
use include_dir::Dir;
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// A folder on disk or embedded.
#[derive(Clone, Debug)]
pub(super) enum Folder {
    Disk(PathBuf),
    Embedded {
        dir: &'static Dir<'static>,
        path: PathBuf,
    },
}

/// A file on disk or embedded.
#[derive(Clone, Debug)]
pub(super) enum File {
    Disk(PathBuf),
    Embedded { bytes: &'static [u8], path: PathBuf },
}

/// Files and folders in a folder, each in natural order of names; hidden ones are left out.
#[derive(Default)]
pub(super) struct Listing {
    pub files: Vec<(String, File)>,
    pub folders: Vec<(String, Folder)>,
}

impl Listing {
    /// The file called `name`.
    pub fn file(&self, name: &str) -> Option<&File> {
        self.files.iter().find(|(n, _)| n == name).map(|(_, file)| file)
    }

    /// Nothing in it.
    pub fn is_empty(&self) -> bool {
        self.files.is_empty() && self.folders.is_empty()
    }
}

impl Folder {
    /// What messages call it.
    pub fn path(&self) -> &Path {
        match self {
            Folder::Disk(path) | Folder::Embedded { path, .. } => path,
        }
    }

    /// Its own name, resolved when the path ends in `.` or `..`.
    pub fn name(&self) -> String {
        let last = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned());
        let resolved = match self {
            Folder::Disk(path) => last(path).or_else(|| last(&path.canonicalize().ok()?)),
            Folder::Embedded { path, .. } => last(path),
        };
        resolved.unwrap_or_else(|| "data".into())
    }

    /// The folder that holds this one.
    pub fn parent(&self) -> Option<Folder> {
        match self {
            Folder::Disk(path) => match path.file_name() {
                Some(_) if path.parent() == Some(Path::new("")) => Some(Folder::Disk(".".into())),
                Some(_) => path.parent().map(|p| Folder::Disk(p.to_path_buf())),
                None => Some(Folder::Disk(path.canonicalize().ok()?.parent()?.to_path_buf())),
            },
            Folder::Embedded { .. } => None,
        }
    }

    /// Its files and folders.
    pub fn list(&self) -> Result<Listing, DatasetError> {
        let mut listing = Listing::default();
        match self {
            Folder::Disk(path) => {
                let fail = |e: std::io::Error| DatasetError::new(path, e.into());
                for entry in std::fs::read_dir(path).map_err(fail)? {
                    let entry = entry.map_err(fail)?;
                    let name = entry.file_name().to_string_lossy().into_owned();
                    if name.starts_with('.') {
                        continue;
                    }
                    // Follows links; an entry that vanished or leads nowhere is no file.
                    match std::fs::metadata(entry.path()) {
                        Ok(meta) if meta.is_dir() => listing.folders.push((name, Folder::Disk(entry.path()))),
                        Ok(_) => listing.files.push((name, File::Disk(entry.path()))),
                        Err(_) => {}
                    }
                }
            }
            Folder::Embedded { dir, path } => {
                let name = |p: &Path| p.file_name().unwrap_or_default().to_string_lossy().into_owned();
                for file in dir.files() {
                    let name = name(file.path());
                    let file = File::Embedded {
                        bytes: file.contents(),
                        path: path.join(&name),
                    };
                    listing.files.push((name, file));
                }
                for dir in dir.dirs() {
                    let name = name(dir.path());
                    let folder = Folder::Embedded {
                        dir,
                        path: path.join(&name),
                    };
                    listing.folders.push((name, folder));
                }
            }
        }
        listing.files.sort_by(|a, b| natural(&a.0, &b.0));
        listing.folders.sort_by(|a, b| natural(&a.0, &b.0));
        Ok(listing)
    }
}

impl File {
    /// What messages call it.
    pub fn path(&self) -> &Path {
        match self {
            File::Disk(path) | File::Embedded { path, .. } => path,
        }
    }

    /// Its content.
    pub fn read(&self) -> Result<Cow<'static, [u8]>, DatasetError> {
        match self {
            File::Disk(path) => match std::fs::read(path) {
                Ok(bytes) => Ok(Cow::Owned(bytes)),
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                    Err(DatasetError::new(path, DatasetErrorKind::Missing))
                }
                Err(e) => Err(DatasetError::new(path, e.into())),
            },
            File::Embedded { bytes, .. } => Ok(Cow::Borrowed(bytes)),
        }
    }

    /// Its length in bytes; `None` when it cannot be asked.
    pub fn size(&self) -> Option<u64> {
        match self {
            File::Disk(path) => std::fs::metadata(path).ok().map(|m| m.len()),
            File::Embedded { bytes, .. } => Some(bytes.len() as u64),
        }
    }
}
