//! Files that are either complete or absent.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Whether a file must survive a loss of power once it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durable {
    /// It is synced before it gets its name.
    Now,
    /// Somebody else syncs it, or can tell when it is damaged.
    Later,
}

/// Ending of the names of files that are not complete yet.
pub(crate) const UNFINISHED: &str = ".tmp";

/// Writes `path` through `write` so that its name never shows part of it: to a temporary name beside it, synced, renamed
/// over `path`. Missing folders are made. The temporary name is this write's own and is never followed as a link, so
/// that any number of processes may write one file; the last one stays.
///
/// # Errors
/// What the system says; the temporary file is removed and `path` left as it was.
pub fn write_atomic(
    path: &Path,
    durable: Durable,
    write: impl Fn(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    match replace(path, durable, &write) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            path.parent().map_or(Ok(()), fs::create_dir_all)?;
            replace(path, durable, &write)
        }
        other => other,
    }
}

/// [`write_atomic`] into a folder that is there.
pub(crate) fn replace(
    path: &Path,
    durable: Durable,
    write: &dyn Fn(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let (temporary, file) = unfinished(path)?;
    let attempt = || -> io::Result<()> {
        let mut out = BufWriter::new(file);
        write(&mut out)?;
        let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
        if durable == Durable::Now {
            file.sync_all()?;
        }
        fs::rename(&temporary, path)?;
        // The rename itself is durable once the directory is synced; not every file system can.
        if let Some(dir) = path
            .parent()
            .filter(|d| durable == Durable::Now && !d.as_os_str().is_empty())
        {
            let _ = File::open(dir).and_then(|d| d.sync_all());
        }
        Ok(())
    };
    attempt().inspect_err(|_| {
        let _ = fs::remove_file(&temporary);
    })
}

/// A new file beside `path` with a name that nothing else has.
fn unfinished(path: &Path) -> io::Result<(PathBuf, File)> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let own = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
    loop {
        let mut name = own.to_os_string();
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        name.push(format!(".{}-{count}{UNFINISHED}", std::process::id()));
        let temporary = path.with_file_name(name);
        match File::create_new(&temporary) {
            // Left by a process of the same number, perhaps on another machine.
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
            other => return Ok((temporary, other?)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("deep/er/a.csv");
        write_atomic(&path, Durable::Later, |w| w.write_all(b"old")).unwrap();
        let failed = write_atomic(&path, Durable::Now, |w| {
            w.write_all(b"half")?;
            Err(io::Error::other("disk full"))
        });
        assert_eq!(failed.unwrap_err().to_string(), "disk full");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        assert!(write_atomic(Path::new("/"), Durable::Now, |_| Ok(())).is_err());
    }

    #[test]
    fn many_may_write_one_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        let texts: Vec<String> = (0..4).map(|k| k.to_string().repeat(1000)).collect();
        std::thread::scope(|scope| {
            for text in &texts {
                let path = &path;
                scope.spawn(move || {
                    for _ in 0..50 {
                        write_atomic(path, Durable::Later, |w| w.write_all(text.as_bytes())).unwrap();
                    }
                });
            }
        });
        assert!(texts.contains(&fs::read_to_string(&path).unwrap()));
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    /// The name is given to another file: who reads the old one reads it to its end.
    #[cfg(unix)]
    #[test]
    fn what_is_being_read_stays_whole() {
        use std::io::Read;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.csv");
        write_atomic(&path, Durable::Now, |w| w.write_all(b"old and long")).unwrap();
        let mut reader = File::open(&path).unwrap();
        write_atomic(&path, Durable::Now, |w| w.write_all(b"new")).unwrap();
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        assert_eq!(
            (text.as_str(), &*fs::read_to_string(&path).unwrap()),
            ("old and long", "new")
        );
    }

    #[cfg(unix)]
    #[test]
    fn links_are_replaced_and_not_followed() {
        let dir = tempfile::tempdir().unwrap();
        let (target, link) = (dir.path().join("thesis.tex"), dir.path().join("a.csv"));
        fs::write(&target, "x").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write_atomic(&link, Durable::Now, |w| w.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"x");
        assert_eq!(fs::read(&link).unwrap(), b"new");
        assert!(!link.is_symlink());
    }
}
