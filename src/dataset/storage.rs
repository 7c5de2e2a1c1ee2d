//! Where the bytes of a dataset come from: folders and files of a storage, which is the disk or the program itself.
//!
//! A new storage is an implementation of [`Storage`]. Depends on the reading of files, the errors and the order of names.

use super::decode::is_image_name;
use super::{DatasetError, DatasetErrorKind, order::natural};
use crate::files::{self, Kind, Refused};
use include_dir::{Dir, DirEntry};
use std::borrow::Cow;
use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::io::{BufRead, BufReader, Cursor, Error, ErrorKind, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The content of a file, to be read piece by piece.
pub(super) trait Stream: BufRead + Seek + Send {}

impl<T: BufRead + Seek + Send> Stream for T {}

/// A tree of folders and files. Paths are those that messages show.
pub(super) trait Storage: std::fmt::Debug + Send + Sync {
    /// What is in the folder `path`, in any order: each entry's name and what it is.
    fn list(&self, path: &Path) -> Result<Vec<(OsString, Entry)>, Error>;
    /// Content of the file `path`, which is of kind `kind`.
    fn read(&self, path: &Path, kind: Kind) -> Result<Cow<'static, [u8]>, Error>;
    /// Content of the file `path`, piece by piece.
    fn open(&self, path: &Path) -> Result<Box<dyn Stream>, Error>;
    /// Length of the file `path` in bytes; `None` when there is no such file.
    fn size(&self, path: &Path) -> Option<u64>;
    /// The folder that holds the folder `path`; `None` at the top.
    fn parent(&self, path: &Path) -> Option<PathBuf>;
    /// The one path of the folder `path`, whatever links lead to it.
    fn identity(&self, path: &Path) -> PathBuf {
        path.to_path_buf()
    }
    /// `path` with a last component that is a name.
    fn named(&self, path: &Path) -> PathBuf {
        path.to_path_buf()
    }
}

/// What an entry of a folder is, links followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Entry {
    /// A folder.
    Folder,
    /// A regular file.
    File,
    /// A pipe, a socket or a device.
    Irregular(&'static str),
    /// A link that leads to nothing.
    DeadLink,
}

/// The file system.
#[derive(Debug)]
pub(super) struct Disk;

impl Storage for Disk {
    fn list(&self, path: &Path) -> Result<Vec<(OsString, Entry)>, Error> {
        let mut entries = Vec::new();
        for entry in std::fs::read_dir(path)? {
            let entry = entry?;
            let is = match std::fs::metadata(entry.path()) {
                Ok(meta) if meta.is_dir() => Entry::Folder,
                Ok(meta) => files::irregular(meta.file_type()).map_or(Entry::File, Entry::Irregular),
                // An entry that has vanished since is none.
                Err(_) if entry.file_type().is_ok_and(|t| t.is_symlink()) => Entry::DeadLink,
                Err(_) => continue,
            };
            entries.push((entry.file_name(), is));
        }
        Ok(entries)
    }

    fn read(&self, path: &Path, kind: Kind) -> Result<Cow<'static, [u8]>, Error> {
        files::read(path, kind).map(Cow::Owned)
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Stream>, Error> {
        Ok(Box::new(BufReader::new(files::open(path)?)))
    }

    fn identity(&self, path: &Path) -> PathBuf {
        path.canonicalize().unwrap_or_else(|_| path.to_path_buf())
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

/// The file system where a folder holds, of images and folders, one image alone.
#[derive(Debug)]
pub(super) struct Alone {
    /// Name of the image.
    pub image: OsString,
}

impl Storage for Alone {
    fn list(&self, path: &Path) -> Result<Vec<(OsString, Entry)>, Error> {
        let mut entries = Disk.list(path)?;
        entries.retain(|(name, is)| {
            *name == self.image || (*is != Entry::Folder && !is_image_name(&name.to_string_lossy()))
        });
        Ok(entries)
    }

    fn read(&self, path: &Path, kind: Kind) -> Result<Cow<'static, [u8]>, Error> {
        Disk.read(path, kind)
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Stream>, Error> {
        Disk.open(path)
    }

    fn size(&self, path: &Path) -> Option<u64> {
        Disk.size(path)
    }

    fn parent(&self, path: &Path) -> Option<PathBuf> {
        Disk.parent(path)
    }

    fn identity(&self, path: &Path) -> PathBuf {
        Disk.identity(path)
    }

    fn named(&self, path: &Path) -> PathBuf {
        Disk.named(path)
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
    fn list(&self, path: &Path) -> Result<Vec<(OsString, Entry)>, Error> {
        let entry = |entry: &DirEntry<'_>| {
            let is = entry.as_dir().map_or(Entry::File, |_| Entry::Folder);
            (entry.path().file_name().unwrap_or_default().to_owned(), is)
        };
        Ok(self.entries(path)?.iter().map(entry).collect())
    }

    fn read(&self, path: &Path, _: Kind) -> Result<Cow<'static, [u8]>, Error> {
        self.content(path).map(Cow::Borrowed)
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Stream>, Error> {
        Ok(Box::new(Cursor::new(self.content(path)?)))
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

/// A file of a dataset, or a picture in one that holds several.
#[derive(Clone, Debug)]
pub struct File {
    storage: Arc<dyn Storage>,
    path: PathBuf,
    name: String,
    is: Entry,
    /// What messages call the picture: `path#number`.
    picture: Option<PathBuf>,
}

/// Files and folders in a folder, each in natural order of names; hidden ones are left out.
#[derive(Debug, Default)]
pub(super) struct Listing {
    pub files: Vec<File>,
    pub folders: Vec<Folder>,
    /// Links that lead nowhere. Those that are called like images are among the files: a frame is missing.
    pub dead: Vec<File>,
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
        self.file_below(Path::new(name))
    }

    /// The file at `path` below it.
    pub(super) fn file_below(&self, path: &Path) -> Option<File> {
        let name = path.file_name()?.to_string_lossy().into_owned();
        let path = self.path.join(path);
        self.storage.size(&path)?;
        Some(File {
            storage: self.storage.clone(),
            path,
            name,
            is: Entry::File,
            picture: None,
        })
    }

    /// The file beside it that is called like it and ends in `suffix`, whatever bytes its name is made of.
    pub(super) fn file_beside(&self, suffix: &str) -> Option<File> {
        let mut name = self.storage.named(&self.path).file_name()?.to_owned();
        name.push(suffix);
        let path = self.storage.parent(&self.path)?.join(&name);
        self.storage.size(&path)?;
        Some(File {
            storage: self.storage.clone(),
            path,
            name: name.to_string_lossy().into_owned(),
            is: Entry::File,
            picture: None,
        })
    }

    /// A file of this name in it, which need not be there.
    pub(super) fn unread(&self, name: String) -> File {
        File {
            storage: self.storage.clone(),
            path: self.path.join(&name),
            name,
            is: Entry::File,
            picture: None,
        }
    }

    /// The one path that it has, whatever links lead to it.
    pub(super) fn identity(&self) -> PathBuf {
        self.storage.identity(&self.path)
    }

    /// Its files and folders.
    ///
    /// # Errors
    /// It cannot be listed, or has names that cannot be told apart as texts.
    pub(super) fn list(&self) -> Result<Listing, DatasetError> {
        let mut listing = Listing::default();
        let mut names: HashMap<String, OsString> = HashMap::new();
        let entries = self.storage.list(&self.path);
        for (raw, is) in entries.map_err(|e| DatasetError::new(&self.path, e.into()))? {
            let name = raw.to_string_lossy().into_owned();
            if name.starts_with('.') {
                continue;
            }
            let (storage, path) = (self.storage.clone(), self.path.join(&raw));
            if let Some(other) = names.insert(name.clone(), raw) {
                let kind = DatasetErrorKind::same_text(&other, &path);
                return Err(DatasetError::new(&self.path, kind));
            }
            if is == Entry::Folder {
                listing.folders.push(Folder { storage, path, name });
                continue;
            }
            let file = File {
                storage,
                path,
                name,
                is,
                picture: None,
            };
            if is == Entry::DeadLink && !is_image_name(&file.name) {
                listing.dead.push(file);
            } else {
                listing.files.push(file);
            }
        }
        listing.files.sort_by(|a, b| natural(&a.name, &b.name));
        listing.dead.sort_by(|a, b| natural(&a.name, &b.name));
        listing.folders.sort_by(|a, b| natural(&a.name, &b.name));
        Ok(listing)
    }
}

impl File {
    /// What messages call it.
    pub fn path(&self) -> &Path {
        self.picture.as_ref().unwrap_or(&self.path)
    }

    /// Its own name; of a picture in a file, `name#number`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Picture `number` in the file, counted from 1. Its content is that of the whole file.
    pub(super) fn picture(&self, number: usize) -> File {
        let numbered = |of: &OsStr| {
            let mut name = of.to_owned();
            name.push(format!("#{number}"));
            name
        };
        let name = numbered(OsStr::new(&self.name));
        File {
            name: name.to_string_lossy().into_owned(),
            picture: Some(numbered(self.path.as_os_str()).into()),
            ..self.clone()
        }
    }

    /// The file called `name` in the same folder.
    pub(super) fn beside(&self, name: &str) -> Option<File> {
        let around = self.path.parent()?.to_path_buf();
        Folder::new(self.storage.clone(), around).file(name)
    }

    /// Its content: that of an image when it is called so, else a text of ground truth.
    ///
    /// # Errors
    /// It is not there, is no regular file, is larger than such a file can be, or cannot be read.
    pub fn read(&self) -> Result<Cow<'static, [u8]>, DatasetError> {
        self.read_as(if self.picture.is_some() || is_image_name(&self.name) {
            Kind::IMAGE
        } else {
            Kind::TRUTH
        })
    }

    /// Its content, piece by piece.
    ///
    /// # Errors
    /// It is not there, is no regular file, or cannot be opened.
    pub(super) fn open(&self) -> Result<Box<dyn Stream>, DatasetError> {
        let opened = self.storage.open(&self.path);
        opened.map_err(|e| DatasetError::new(self.path(), e.into()))
    }

    /// Its content, which is of kind `kind`.
    pub(super) fn read_as(&self, kind: Kind) -> Result<Cow<'static, [u8]>, DatasetError> {
        self.storage.read(&self.path, kind).map_err(|e| {
            let kind = match e.kind() {
                ErrorKind::NotFound => self.unusable().unwrap_or(DatasetErrorKind::Missing),
                _ => e.into(),
            };
            DatasetError::new(self.path(), kind)
        })
    }

    /// Why it cannot be read, as far as its folder tells.
    pub(super) fn fault(&self) -> Option<DatasetError> {
        Some(DatasetError::new(self.path(), self.unusable()?))
    }

    fn unusable(&self) -> Option<DatasetErrorKind> {
        match self.is {
            Entry::Folder | Entry::File => None,
            Entry::Irregular(what) => Some(DatasetErrorKind::Refused(Refused::Irregular(what))),
            Entry::DeadLink => Some(DatasetErrorKind::DeadLink),
        }
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
            fn list(&self, _: &Path) -> Result<Vec<(OsString, Entry)>, Error> {
                Err(ErrorKind::NotFound.into())
            }
            fn read(&self, _: &Path, _: Kind) -> Result<Cow<'static, [u8]>, Error> {
                Ok(Cow::Owned(self.0.clone()))
            }
            fn open(&self, _: &Path) -> Result<Box<dyn Stream>, Error> {
                Ok(Box::new(Cursor::new(self.0.clone())))
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
            is: Entry::File,
            picture: None,
        }
    }
}
