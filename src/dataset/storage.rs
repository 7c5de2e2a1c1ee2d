//! Where the bytes of a dataset come from: folders and files of a storage, which is the disk or the program itself.
//!
//! A new storage is an implementation of [`Storage`]. Depends on nothing else but the errors and the order of names.

use super::{DatasetError, DatasetErrorKind, order::natural};
use include_dir::{Dir, DirEntry};
use std::borrow::Cow;
use std::ffi::OsStr;
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A tree of folders and files. Paths are those that messages show.
pub(super) trait Storage: std::fmt::Debug + Send + Sync {
    /// What is in the folder `path`, in any order: the name of each entry, and whether it is a folder.
    fn list(&self, path: &Path) -> Result<Vec<(String, bool)>, Error>;
    /// Content of the file `path`.
    fn read(&self, path: &Path) -> Result<Cow<'static, [u8]>, Error>;
    /// Length of the file `path` in bytes; `None` when there is no such file.
    fn size(&self, path: &Path) -> Option<u64>;
    /// The folder that holds the folder `path`; `None` at the top.
    fn parent(&self, path: &Path) -> Option<PathBuf>;
    /// `path` with a last component that is a name.
    fn named(&self, path: &Path) -> PathBuf {
        path.to_path_buf()
    }
}

/// The file system.
#[derive(Debug)]
pub(super) struct Disk;

impl Storage for Disk {
    fn list(&self, path: &Path) -> Result<Vec<(String, bool)>, Error> {
        let mut entries = Vec::new();
        for entry in std::fs::read_dir(path)? {
            let entry = entry?;
            // Follows links; an entry that vanished or leads nowhere is no file.
            if let Ok(meta) = std::fs::metadata(entry.path()) {
                entries.push((entry.file_name().to_string_lossy().into_owned(), meta.is_dir()));
            }
        }
        Ok(entries)
    }

    fn read(&self, path: &Path) -> Result<Cow<'static, [u8]>, Error> {
        std::fs::read(path).map(Cow::Owned)
    }

    fn size(&self, path: &Path) -> Option<u64> {
        let meta = std::fs::metadata(path).ok()?;
        (!meta.is_dir()).then_some(meta.len())
    }

    fn parent(&self, path: &Path) -> Option<PathBuf> {
        match path.file_name() {
            Some(_) if path.parent() == Some(Path::new("")) => Some(".".into()),
            Some(_) => path.parent().map(Path::to_path_buf),
            None => Some(path.canonicalize().ok()?.parent()?.to_path_buf()),
        }
    }

    /// Resolves paths that end in `.` or `..`.
    fn named(&self, path: &Path) -> PathBuf {
        match path.file_name() {
            Some(_) => path.to_path_buf(),
            None => path.canonicalize().unwrap_or_default(),
        }
    }
}

/// Files inside the program. Paths begin with the name that stands for the top.
#[derive(Debug)]
pub(super) struct Embedded {
    pub name: &'static str,
    pub top: &'static Dir<'static>,
}

impl Embedded {
    /// What is in the folder `path`.
    fn entries(&self, path: &Path) -> Result<&'static [DirEntry<'static>], Error> {
        let below = path.strip_prefix(self.name).map_err(|_| ErrorKind::NotFound)?;
        let mut entries = self.top.entries();
        // From name to name: much faster than to compare whole paths with those of every file.
        for name in below.iter() {
            entries = match find(entries, name) {
                Some(DirEntry::Dir(dir)) => dir.entries(),
                _ => return Err(ErrorKind::NotFound.into()),
            };
        }
        Ok(entries)
    }

    fn content(&self, path: &Path) -> Result<&'static [u8], Error> {
        let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
            return Err(ErrorKind::NotFound.into());
        };
        match find(self.entries(folder)?, name) {
            Some(DirEntry::File(file)) => Ok(file.contents()),
            _ => Err(ErrorKind::NotFound.into()),
        }
    }
}

fn find(entries: &'static [DirEntry<'static>], name: &OsStr) -> Option<&'static DirEntry<'static>> {
    entries.iter().find(|e| e.path().file_name() == Some(name))
}

impl Storage for Embedded {
    fn list(&self, path: &Path) -> Result<Vec<(String, bool)>, Error> {
        let entry = |entry: &DirEntry<'_>| {
            let name = entry.path().file_name().unwrap_or_default();
            (name.to_string_lossy().into_owned(), entry.as_dir().is_some())
        };
        Ok(self.entries(path)?.iter().map(entry).collect())
    }

    fn read(&self, path: &Path) -> Result<Cow<'static, [u8]>, Error> {
        self.content(path).map(Cow::Borrowed)
    }

    fn size(&self, path: &Path) -> Option<u64> {
        Some(self.content(path).ok()?.len() as u64)
    }

    fn parent(&self, path: &Path) -> Option<PathBuf> {
        let parent = path.parent()?;
        parent.starts_with(self.name).then(|| parent.to_path_buf())
    }
}

/// A folder that a dataset may lie in.
#[derive(Clone, Debug)]
pub struct Folder {
    storage: Arc<dyn Storage>,
    path: PathBuf,
    name: String,
}

/// A file of a dataset.
#[derive(Clone, Debug)]
pub struct File {
    storage: Arc<dyn Storage>,
    path: PathBuf,
    name: String,
}

/// Files and folders in a folder, each in natural order of names; hidden ones are left out.
#[derive(Debug, Default)]
pub(super) struct Listing {
    pub files: Vec<File>,
    pub folders: Vec<Folder>,
}

impl Folder {
    pub(super) fn new(storage: Arc<dyn Storage>, path: PathBuf) -> Self {
        let named = storage.named(&path);
        let name = named
            .file_name()
            .map_or_else(|| "data".into(), |n| n.to_string_lossy().into_owned());
        Folder { storage, path, name }
    }

    /// What messages call it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its own name, resolved when the path ends in `.` or `..`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The folder that holds this one.
    pub fn parent(&self) -> Option<Folder> {
        let path = self.storage.parent(&self.path)?;
        Some(Folder::new(self.storage.clone(), path))
    }

    /// The file called `name` in it. Looks for this one file and does not list the folder.
    pub fn file(&self, name: &str) -> Option<File> {
        let path = self.path.join(name);
        self.storage.size(&path)?;
        Some(File {
            storage: self.storage.clone(),
            path,
            name: name.into(),
        })
    }

    /// Its files and folders.
    pub(super) fn list(&self) -> Result<Listing, DatasetError> {
        let mut listing = Listing::default();
        let entries = self.storage.list(&self.path);
        for (name, is_folder) in entries.map_err(|e| DatasetError::new(&self.path, e.into()))? {
            if name.starts_with('.') {
                continue;
            }
            let (storage, path) = (self.storage.clone(), self.path.join(&name));
            if is_folder {
                listing.folders.push(Folder { storage, path, name });
            } else {
                listing.files.push(File { storage, path, name });
            }
        }
        listing.files.sort_by(|a, b| natural(&a.name, &b.name));
        listing.folders.sort_by(|a, b| natural(&a.name, &b.name));
        Ok(listing)
    }
}

impl File {
    /// What messages call it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its own name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its content.
    ///
    /// # Errors
    /// It is not there, or cannot be read.
    pub fn read(&self) -> Result<Cow<'static, [u8]>, DatasetError> {
        self.storage.read(&self.path).map_err(|e| {
            let kind = match e.kind() {
                ErrorKind::NotFound => DatasetErrorKind::Missing,
                _ => e.into(),
            };
            DatasetError::new(&self.path, kind)
        })
    }

    /// Its length in bytes; `None` when it cannot be asked.
    pub fn size(&self) -> Option<u64> {
        self.storage.size(&self.path)
    }
}

/// A file that is nowhere but in a test.
#[cfg(test)]
impl File {
    pub(super) fn of(name: &str, bytes: Vec<u8>) -> Self {
        #[derive(Debug)]
        struct Memory(Vec<u8>);

        impl Storage for Memory {
            fn list(&self, _: &Path) -> Result<Vec<(String, bool)>, Error> {
                Err(ErrorKind::NotFound.into())
            }
            fn read(&self, _: &Path) -> Result<Cow<'static, [u8]>, Error> {
                Ok(Cow::Owned(self.0.clone()))
            }
            fn size(&self, _: &Path) -> Option<u64> {
                Some(self.0.len() as u64)
            }
            fn parent(&self, _: &Path) -> Option<PathBuf> {
                None
            }
        }

        File {
            storage: Arc::new(Memory(bytes)),
            path: name.into(),
            name: name.into(),
        }
    }
}
