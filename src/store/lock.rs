//! The lock of a run directory: who writes to it, and whether they still live.
//!
//! The lock proper is the system's (released by it when the process ends, however it ends); the file says who holds it.
//! Where the file system has no locks, what the file says has to do.

use crate::files::{self, Kind};
use crate::store::error::StoreError;
use crate::store::host::host_name;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};

/// A process that holds or held a directory, as its lock file names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// `pid 17 on host since time`.
    pub text: String,
    /// Whether it lives; unknown of other hosts.
    pub alive: Option<bool>,
}

impl Holder {
    /// This process.
    fn me() -> String {
        let pid = std::process::id();
        let began = began(pid).map_or(String::new(), |t| format!(" (started at tick {t})"));
        format!(
            "pid {pid} on {} since {}{began}",
            host_name(),
            crate::store::host::utc_now()
        )
    }

    fn parse(text: &str) -> Option<Holder> {
        let text = text.trim();
        if text.is_empty() {
            return None;
        }
        let number = |before: &str| -> Option<u64> {
            let rest = &text[text.find(before)? + before.len()..];
            let digits = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
            rest[..digits].parse().ok()
        };
        let pid = number("pid ").and_then(|pid| u32::try_from(pid).ok());
        let here = text.contains(&format!(" on {} since ", host_name()));
        let alive = pid.filter(|_| here && cfg!(target_os = "linux")).map(|pid| {
            // A later process may have got the same number.
            began(pid).is_some_and(|t| number("at tick ").is_none_or(|then| then == t))
        });
        Some(Holder {
            text: text.to_owned(),
            alive,
        })
    }

    /// Who the lock file of the run directory `dir` names; nobody when its last run ended in order.
    pub fn of(dir: &Path) -> Option<Holder> {
        Holder::parse(&files::read_text(&dir.join(".lock"), Kind::SETTINGS).ok()?)
    }
}

/// When a living process of this machine started, in ticks since the machine did.
fn began(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name before may hold anything, but ends with the last parenthesis.
    let mut fields = stat[stat.rfind(')')? + 1..].split_whitespace();
    let state = fields.next()?;
    let ticks = fields.nth(18)?.parse().ok()?;
    // A zombie has ended.
    (state != "Z").then_some(ticks)
}

/// Whether `text` is what a lock file holds: a holder, or nothing once its run has ended.
pub(crate) fn is_lock(text: &str) -> bool {
    Holder::parse(text).is_none_or(|holder| holder.text.starts_with("pid "))
}

/// The lock of a directory, taken but not signed yet.
pub(crate) struct Taken {
    file: File,
    path: PathBuf,
    /// It was not there before.
    created: bool,
    /// Who held it and died.
    dead: Option<Holder>,
}

/// Takes the lock of the directory `dir`, kept in `path`.
pub(crate) fn take(dir: &Path, path: &Path) -> Result<Taken, StoreError> {
    let io = |e| StoreError::io(path, e);
    // What a link leads to belongs to somebody else and would be emptied, and a pipe waits for ever.
    let known = path.symlink_metadata().map(|meta| meta.file_type());
    if let Some(what) = known.ok().and_then(files::irregular) {
        return Err(StoreError::NotARunDirectory {
            path: dir.to_path_buf(),
            reason: format!("its .lock is not a file but {what}"),
        });
    }
    let mut options = OpenOptions::new();
    options.read(true).write(true);
    let (mut file, created) = match options.clone().create_new(true).open(path) {
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => (options.open(path).map_err(io)?, false),
        other => (other.map_err(io)?, true),
    };
    let locked = file.try_lock();
    let mut text = String::new();
    let _ = file.read_to_string(&mut text);
    let holder = Holder::parse(&text);
    let refuse = |text: String| {
        Err(StoreError::Locked {
            path: dir.to_path_buf(),
            holder: text,
        })
    };
    match (locked, &holder) {
        (Ok(()), _) => {}
        (Err(TryLockError::WouldBlock), Some(holder)) => return refuse(holder.text.clone()),
        (Err(TryLockError::WouldBlock), None) => return refuse("holder unknown".into()),
        // Some network file systems have no locks, or their server has none to give; no other answer means that somebody
        // holds it. What the file says decides.
        (Err(TryLockError::Error(_)), holder) => {
            if let Some(holder) = holder.as_ref().filter(|h| h.alive != Some(false)) {
                return refuse(format!(
                    "{}; if that is over, remove {}",
                    holder.text,
                    path.display()
                ));
            }
        }
    }
    Ok(Taken {
        file,
        path: path.to_path_buf(),
        created,
        dead: holder,
    })
}

impl Taken {
    /// Writes down that this process holds it; also tells who held it and died.
    pub fn sign(mut self) -> Result<(File, Option<Holder>), StoreError> {
        let text = format!("{}\n", Holder::me());
        self.file
            .set_len(0)
            .and_then(|()| self.file.rewind())
            .and_then(|()| self.file.write_all(text.as_bytes()))
            .and_then(|()| self.file.sync_data())
            .map_err(|e| StoreError::io(&self.path, e))?;
        Ok((self.file, self.dead))
    }

    /// Gives it back: everything is as it was.
    pub fn give_back(self) {
        if self.created {
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_living_are_told_from_the_dead() {
        let me = Holder::parse(&Holder::me()).unwrap();
        assert_eq!(Holder::parse(" \n"), None);
        assert_eq!(
            Holder::parse("pid 3 on elsewhere since noon").unwrap().alive,
            None
        );
        if cfg!(target_os = "linux") {
            assert_eq!(me.alive, Some(true));
            let other = me.text.replace("at tick ", "at tick 9");
            assert_eq!(Holder::parse(&other).unwrap().alive, Some(false));
            let none = format!("pid {} on {} since noon", u32::MAX, host_name());
            assert_eq!(Holder::parse(&none).unwrap().alive, Some(false));
        }
    }

    #[test]
    fn a_lock_left_by_the_dead_is_taken() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(".lock");
        fs::write(&path, "pid 4294967295 on elsewhere since noon").unwrap();
        let (_file, dead) = take(dir.path(), &path).unwrap().sign().unwrap();
        assert!(dead.unwrap().text.starts_with("pid 4294967295"));
        assert!(
            Holder::of(dir.path())
                .unwrap()
                .text
                .contains(&format!("pid {}", std::process::id()))
        );
    }
}
