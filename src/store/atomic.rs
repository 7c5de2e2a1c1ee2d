//! Files that are either complete or absent.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Whether a file must survive a loss of power once it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durable {
    /// It is synced before it gets its name.
    Now,
    /// Somebody else syncs it, or can tell when it is damaged.
    Later,
}

/// Writes `path` through `write` so that its name never shows part of it: to a temporary name beside it, synced, renamed
/// over `path`. Missing folders are made. The temporary name is always the same, so what a killed program leaves is
/// replaced by the next; one program at a time may write a file (run directories are locked).
///
/// # Errors
/// What the system says; the temporary file is removed and `path` left as it was.
pub fn write_atomic(
    path: &Path,
    durable: Durable,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let mut name = path
        .file_name()
        .ok_or(io::ErrorKind::InvalidInput)?
        .to_os_string();
    name.push(".tmp");
    let temporary = path.with_file_name(name);
    let attempt = || -> io::Result<()> {
        let file = match File::create(&temporary) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                path.parent().map_or(Ok(()), fs::create_dir_all)?;
                File::create(&temporary)?
            }
            other => other?,
        };
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
}
