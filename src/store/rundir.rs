//! A run directory: its lock, its atomic writes and its file names.

use crate::plan::{FrameLogs, Plan, RUN_FORMAT_VERSION, Unit};
use crate::store::error::StoreError;
use crate::store::lock::{self, Holder};
use crate::store::{Durable, write_atomic};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Files at the top of a run directory, besides result files, that a fresh start removes.
const TOP_FILES: [&str; 4] = ["run.json", "truth.csv", "timing.csv", "journal.jsonl"];

/// Names in a run directory that are no result file's.
pub(crate) const RESERVED: [&str; 5] = [TOP_FILES[0], TOP_FILES[1], TOP_FILES[2], TOP_FILES[3], "frames"];

/// Most entries of a folder.
const FAN_OUT: usize = 10_000;

/// A run directory, held under its lock or just looked at.
#[derive(Debug)]
pub struct RunDir {
    path: PathBuf,
    lock: Option<File>,
    logs: FrameLogs,
    /// Trackers are spread over folders.
    fan_trackers: bool,
    /// Logs of a tracker on a data set are.
    fan_logs: bool,
}

impl RunDir {
    /// Creates or opens the directory at `path`, takes its lock and makes sure it can be written to. A `fresh` start removes
    /// what an earlier run wrote there; its result files go by the names `results`. Also returns who held the lock and died, if so.
    ///
    /// # Errors
    /// The directory is locked, holds other things than a run, cannot be created or written to, or the disk is full.
    pub fn open(path: &Path, fresh: bool, results: &[&str]) -> Result<(RunDir, Option<Holder>), StoreError> {
        fs::create_dir_all(path).map_err(|e| StoreError::io(path, e))?;
        let lock_path = path.join(".lock");
        if !lock_path.exists() && !path.join("journal.jsonl").exists() && !path.join("run.json").exists() {
            let mut others = fs::read_dir(path).map_err(|e| StoreError::io(path, e))?;
            if others.next().is_some() {
                return Err(StoreError::NotARunDirectory(path.to_path_buf()));
            }
        }
        let (lock, dead) = lock::take(path, &lock_path)?;
        let mut dir = RunDir::view(path);
        dir.lock = Some(lock);
        dir.sweep()?;
        if fresh {
            dir.clear(results)?;
        }
        Ok((dir, dead))
    }

    /// The directory at `path` to be read only, whoever holds it.
    pub fn view(path: &Path) -> RunDir {
        RunDir {
            path: path.to_path_buf(),
            lock: None,
            logs: FrameLogs::Csv,
            fan_trackers: false,
            fan_logs: false,
        }
    }

    /// Takes the places of frame logs from the plan. Folders that would get more than 10,000 entries are spread over
    /// subfolders named by the first two digits of a hash.
    pub fn lay_out(&mut self, plan: &Plan) {
        let mut logs = std::collections::BTreeMap::<&str, usize>::new();
        for unit in plan.passes() {
            let sequence = &plan.sequences[unit.sequence as usize];
            *logs.entry(&sequence.dataset).or_default() += 1;
        }
        self.logs = plan.frame_logs;
        // One entry is the description of the tracker.
        self.fan_trackers = plan.trackers.len() > FAN_OUT;
        self.fan_logs = logs.values().any(|&n| n > FAN_OUT);
    }

    /// The plan and host stamp that `run.json` records.
    ///
    /// # Errors
    /// There is none, or it is of another version of the program's formats.
    pub fn plan(&self) -> Result<(Plan, Map<String, Value>), StoreError> {
        let no_run = |reason: String| StoreError::NoRun {
            path: self.path.clone(),
            reason,
        };
        let path = self.path.join("run.json");
        let bytes = match fs::read(&path) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Err(no_run("no run.json".into())),
            other => other.map_err(|e| StoreError::io(&path, e))?,
        };
        let mut value: Map<String, Value> =
            serde_json::from_slice(&bytes).map_err(|e| no_run(format!("run.json: {e}")))?;
        let host = match value.remove("host") {
            Some(Value::Object(host)) => host,
            _ => Map::new(),
        };
        match value.get("schema_version").and_then(Value::as_u64) {
            Some(version) if version == u64::from(RUN_FORMAT_VERSION) => {}
            _ => return Err(no_run("run.json is of another version of the program".into())),
        }
        let plan =
            serde_json::from_value(Value::Object(value)).map_err(|e| no_run(format!("run.json: {e}")))?;
        Ok((plan, host))
    }

    /// Removes temporary files that a killed run left at the top.
    fn sweep(&self) -> Result<(), StoreError> {
        for entry in fs::read_dir(&self.path)
            .map_err(|e| StoreError::io(&self.path, e))?
            .flatten()
        {
            if entry.file_name().to_string_lossy().ends_with(".tmp") {
                let _ = fs::remove_file(entry.path());
            }
        }
        Ok(())
    }

    fn clear(&self, results: &[&str]) -> Result<(), StoreError> {
        let gone = |path: &Path, result: io::Result<()>| match result {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(StoreError::io(path, e)),
            _ => Ok(()),
        };
        // The journal goes first: without it nothing else counts, however far this gets.
        for name in TOP_FILES.iter().rev().chain(results) {
            let path = self.path.join(name);
            gone(&path, fs::remove_file(&path))?;
        }
        let frames = self.path.join("frames");
        gone(&frames, fs::remove_dir_all(&frames))
    }

    /// The directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of the journal.
    pub fn journal(&self) -> PathBuf {
        self.path.join("journal.jsonl")
    }

    /// Path of the folder of a tracker's logs.
    pub fn tracker_dir(&self, slug: &str) -> PathBuf {
        let frames = self.path.join("frames");
        match self.fan_trackers {
            true => frames.join(fan(slug)).join(file_name(slug)),
            false => frames.join(file_name(slug)),
        }
    }

    /// Path of the frame log of a unit of `plan`: `sequence[@start][@course]`, where neither file names of sequences nor
    /// those of courses have an `@`.
    pub fn log(&self, plan: &Plan, unit: &Unit) -> PathBuf {
        let tracker = &plan.trackers[unit.tracker as usize];
        let sequence = &plan.sequences[unit.sequence as usize];
        let mut name = file_name(&sequence.sequence);
        if unit.start > 0 {
            name += &format!("@{}", unit.start);
        }
        if let Some(course) = plan.course_name(unit) {
            name += &format!("@{}", course.replace(':', "-"));
        }
        let name = format!("{name}.{}", self.logs.extension());
        let folder = self.tracker_dir(&tracker.slug).join(file_name(&sequence.dataset));
        match self.fan_logs {
            true => folder.join(fan(&name)).join(name),
            false => folder.join(name),
        }
    }

    /// Writes `path` durably, unless it has these bytes already.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
        self.put(path, bytes, Durable::Now)
    }

    /// Writes `path`, unless it has these bytes already.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn put(&self, path: &Path, bytes: &[u8], durable: Durable) -> Result<(), StoreError> {
        if fs::read(path).is_ok_and(|old| old == bytes) {
            return Ok(());
        }
        write_atomic(path, durable, |w| w.write_all(bytes)).map_err(|e| StoreError::io(path, e))
    }
}

impl Drop for RunDir {
    fn drop(&mut self) {
        if let Some(lock) = &self.lock {
            // The file stays (removing a lock file is a race) but says nothing any more.
            let _ = lock.set_len(0);
            let _ = lock.unlock();
        }
    }
}

/// `name` as one component of a path: letters, digits and `-_.,+=` stay, the rest becomes `_` and a hash of the name is
/// added so that two names never share a file.
pub fn file_name(name: &str) -> String {
    const LONGEST: usize = 120;
    let kept: String = name
        .chars()
        .enumerate()
        .map(|(i, c)| match c {
            '.' if i > 0 => c,
            c if c.is_alphanumeric() || "-_,+=".contains(c) => c,
            _ => '_',
        })
        .collect();
    if kept == name && !name.is_empty() && name.len() <= LONGEST {
        return kept;
    }
    let short: String = kept.chars().take(LONGEST / 4).collect();
    format!("{short}-{}", &digest(name.as_bytes())[..8])
}

/// First two hexadecimal digits of the hash of a name: where it goes in a folder that has too many entries.
fn fan(name: &str) -> String {
    hex::encode(&Sha256::digest(name)[..1])
}

/// SHA-256 of a file's bytes, hexadecimal.
pub fn digest(bytes: &[u8]) -> String {
    hex::encode(Sha256::digest(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_are_safe_and_distinct() {
        assert_eq!(file_name("nl_bookI_s3"), "nl_bookI_s3");
        assert_eq!(file_name("esm_ssd+gb_affine{max_iters=50}").len(), 30 + 9);
        for bad in ["", ".", "..", "a/b", "../x", ".hidden", "a b", &"x".repeat(300)] {
            let name = file_name(bad);
            assert!(
                !name.contains('/') && !name.starts_with('.') && !name.is_empty() && name.len() < 140,
                "{name}"
            );
        }
        assert_ne!(file_name("a/b"), file_name("a_b"));
        assert_ne!(file_name("a/b"), file_name("a:b"));
    }

    #[test]
    fn a_second_opener_learns_who_holds_the_lock() {
        let dir = tempfile::tempdir().unwrap();
        let (held, dead) = RunDir::open(dir.path(), false, &[]).unwrap();
        assert!(dead.is_none());
        match RunDir::open(dir.path(), false, &[]) {
            Err(StoreError::Locked { holder, .. }) => {
                let pid = format!("pid {}", std::process::id());
                assert!(holder.contains(&pid), "{holder}")
            }
            other => panic!("{other:?}"),
        }
        drop(held);
        assert!(RunDir::open(dir.path(), false, &[]).is_ok());
    }

    #[test]
    fn logs_have_a_place_of_their_own() {
        let starts = vec![vec![0, 3], vec![3]];
        let plan = serde_json::json!({
            "schema_version": 1, "tool": "t", "version": "1", "protocol": "reinit:2.5:5,subseq:2", "seed": 0,
            "pre": "none", "frame_logs": "csv",
            "trackers": [{"id": "a", "sm": "", "am": "", "ssm": "", "ilm": "", "slug": "a", "parameters": null}],
            "sequences": [
                {"dataset": "d", "sequence": "s", "frames": 9, "starts": starts, "fingerprint": ""}
            ],
        });
        let plan: Plan = serde_json::from_value(plan).unwrap();
        let mut dir = RunDir::view(Path::new("out"));
        let logs = |dir: &RunDir| -> Vec<String> {
            let log = |unit: Unit| dir.log(&plan, &unit).to_string_lossy().into_owned();
            plan.units().map(log).collect()
        };
        let names = ["s@reinit-2.5-5.csv", "s@3@reinit-2.5-5.csv", "s@3.csv"];
        assert_eq!(logs(&dir), names.map(|n| format!("out/frames/a/d/{n}")));
        dir.fan_trackers = true;
        assert_eq!(logs(&dir)[2], "out/frames/ca/a/d/s@3.csv");
        dir.fan_logs = true;
        assert_eq!(
            logs(&dir)[2],
            format!("out/frames/ca/a/d/{}/s@3.csv", fan("s@3.csv"))
        );
    }

    #[test]
    fn other_peoples_folders_are_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("thesis.tex"), "x").unwrap();
        assert!(matches!(
            RunDir::open(dir.path(), true, &[]),
            Err(StoreError::NotARunDirectory(_))
        ));
        assert!(dir.path().join("thesis.tex").exists());
    }
}
