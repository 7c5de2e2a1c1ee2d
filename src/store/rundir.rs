//! A run directory: its lock, its atomic writes and its file names.

use crate::files::{self, Kind};
use crate::plan::{FrameLogs, Plan, PlannedTracker, RUN_FORMAT_VERSION, Shard, Sharding, Unit};
use crate::store::Durable;
use crate::store::atomic::{UNFINISHED, replace};
use crate::store::error::StoreError;
use crate::store::journal;
use crate::store::lock::{self, Holder};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use twox_hash::XxHash64;

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

/// What `run.json` records.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// The run.
    pub plan: Plan,
    /// SHA-256 of `truth.csv`.
    pub truth: String,
    /// The machine and the execution.
    pub host: Map<String, Value>,
}

/// Where `run.json` has its own checksum, and the digests of result files once they are written.
const HOST: &str = "host";
const SUM: &str = "sum";
const FILES: &str = "files";

/// The checksum of a description that does not have it: XXH64, 16 hexadecimal digits.
fn sum(description: &Map<String, Value>) -> String {
    // Strings and numbers always serialise.
    let text = serde_json::to_vec(description).unwrap_or_default();
    format!("{:016x}", XxHash64::oneshot(0, &text))
}

/// As a file of JSON for people.
pub(crate) fn pretty(value: &Value) -> Vec<u8> {
    format!("{value:#}\n").into_bytes()
}

/// As a file of JSON for people in which each object of a list at the top has a line.
fn lines(run: &Map<String, Value>) -> Vec<u8> {
    let field = |(key, value): (&String, &Value)| {
        let key = Value::from(key.as_str());
        let rows = value
            .as_array()
            .filter(|rows| !rows.is_empty() && rows.iter().all(Value::is_object));
        match rows {
            Some(rows) => {
                let rows: Vec<String> = rows.iter().map(Value::to_string).collect();
                format!("  {key}: [\n    {}\n  ]", rows.join(",\n    "))
            }
            // Within strings, the end of a line is escaped.
            None => format!("  {key}: {}", format!("{value:#}").replace('\n', "\n  ")),
        }
    };
    let fields: Vec<String> = run.iter().map(field).collect();
    format!("{{\n{}\n}}\n", fields.join(",\n")).into_bytes()
}

/// Reads back what [`Recorded::to_bytes`] wrote.
fn described(bytes: &[u8]) -> Result<Map<String, Value>, String> {
    let mut value: Map<String, Value> = serde_json::from_slice(bytes).map_err(|e| e.to_string())?;
    let host = value.get_mut(HOST).and_then(Value::as_object_mut);
    let found = host.and_then(|host| host.remove(SUM));
    match found {
        Some(found) if found == sum(&value) => Ok(value),
        _ => Err("its checksum is not that of what it says".into()),
    }
}

impl Recorded {
    /// Checksum of `truth.csv`.
    pub fn truth_sum(&self) -> &str {
        &self.truth
    }

    /// The file.
    pub(crate) fn to_bytes(&self) -> serde_json::Result<Vec<u8>> {
        let Value::Object(mut run) = serde_json::to_value(&self.plan)? else {
            return Ok(Vec::new());
        };
        run.insert(HOST.into(), self.host.clone().into());
        run.insert("truth".into(), self.truth.as_str().into());
        let sum = sum(&run);
        run[HOST][SUM] = sum.into();
        Ok(lines(&run))
    }

    /// SHA-256 of each result file, once the run has ended.
    pub(crate) fn set_files(&mut self, files: impl IntoIterator<Item = (String, String)>) {
        let files: Map<String, Value> = files
            .into_iter()
            .map(|(name, digest)| (name, digest.into()))
            .collect();
        self.host.insert(FILES.into(), files.into());
    }

    /// SHA-256 of the result file `name`; `None` when the run has not ended.
    pub fn digest_of(&self, name: &str) -> Option<&str> {
        self.host.get(FILES)?.get(name)?.as_str()
    }

    /// The part of the plan that the directory is for; all of it without.
    pub fn shard(&self) -> Option<Shard> {
        let shard = self.host.get("shard").and_then(Value::as_str);
        shard.and_then(|s| s.parse().ok())
    }

    /// The units that the directory is for: those of its shard.
    pub fn units(&self) -> Vec<Unit> {
        let plan = &self.plan;
        match self.shard() {
            None => plan.units().collect(),
            Some(Shard { cut, index, count }) => {
                let sharding = Sharding::new(plan, cut, count);
                plan.units().filter(|unit| sharding.of(unit) == index).collect()
            }
        }
    }
}

impl RunDir {
    /// Creates or opens the directory at `path`, takes its lock and makes sure it can be written to. A `fresh` start removes
    /// what an earlier run wrote there; its result files go by the names `results`. Also returns who held the lock and died, if so.
    ///
    /// # Errors
    /// The directory is locked, holds other things than a run, cannot be created or written to, or the disk is full.
    pub fn open(path: &Path, fresh: bool, results: &[&str]) -> Result<(RunDir, Option<Holder>), StoreError> {
        fs::create_dir_all(path).map_err(|e| StoreError::io(path, e))?;
        // First of all, so that whoever comes second learns that, whatever state the directory is in.
        let taken = lock::take(path, &path.join(".lock"))?;
        if let Err(error) = recognise(path, results) {
            taken.give_back();
            return Err(error);
        }
        let (lock, dead) = taken.sign()?;
        let mut dir = RunDir::view(path);
        dir.lock = Some(lock);
        dir.sweep(dead.is_some())?;
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

    /// What `run.json` records.
    ///
    /// # Errors
    /// There is none, or it is of another version of the program's formats.
    pub fn recorded(&self) -> Result<Recorded, StoreError> {
        let no_run = |reason: String| StoreError::NoRun {
            path: self.path.clone(),
            reason,
        };
        let path = self.path.join("run.json");
        let bytes = match files::read(&path, Kind::RESULTS) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Err(no_run("no run.json".into())),
            other => other.map_err(|e| StoreError::io(&path, e))?,
        };
        let damaged = |reason| StoreError::Damaged {
            path: path.clone(),
            reason,
        };
        let mut value = described(&bytes).map_err(damaged)?;
        let host = match value.remove(HOST) {
            Some(Value::Object(host)) => host,
            _ => Map::new(),
        };
        let truth = match value.remove("truth") {
            Some(Value::String(truth)) => truth,
            _ => return Err(no_run("run.json does not say of which ground truth it is".into())),
        };
        match value.get("schema_version").and_then(Value::as_u64) {
            Some(version) if version == u64::from(RUN_FORMAT_VERSION) => {}
            _ => return Err(no_run("run.json is of another version of the program".into())),
        }
        let plan =
            serde_json::from_value(Value::Object(value)).map_err(|e| no_run(format!("run.json: {e}")))?;
        Ok(Recorded { plan, truth, host })
    }

    /// Files besides the journal and frame logs that are not as the run that `recorded` describes wrote them, or are gone.
    pub fn altered(&self, recorded: &Recorded) -> Vec<PathBuf> {
        let is = |path: &Path, digest_: &str| {
            files::read(path, Kind::RESULTS).is_ok_and(|b| digest(&b) == digest_)
        };
        let results = recorded.host.get(FILES).and_then(Value::as_object);
        let results = results
            .into_iter()
            .flatten()
            .map(|(name, digest)| (name.as_str(), digest.as_str()));
        let truth = ("truth.csv", Some(recorded.truth.as_str()));
        let mut altered: Vec<PathBuf> = results
            .chain([truth])
            .filter(|(name, digest)| !is(&self.path.join(name), digest.unwrap_or_default()))
            .map(|(name, _)| self.path.join(name))
            .collect();
        for tracker in self.described_trackers(&recorded.plan, &recorded.units()) {
            let (path, bytes) = self.tracker_file(&recorded.plan.trackers[tracker as usize]);
            if !files::read(&path, Kind::RESULTS).is_ok_and(|found| found == bytes) {
                altered.push(path);
            }
        }
        altered
    }

    /// The trackers of `units` whose parameters are described beside their frame logs; none where there are no logs, as
    /// `run.json` says it all.
    pub(crate) fn described_trackers(&self, plan: &Plan, units: &[Unit]) -> BTreeSet<u32> {
        match plan.frame_logs {
            FrameLogs::None => BTreeSet::new(),
            _ => units.iter().map(|unit| unit.tracker).collect(),
        }
    }

    /// Path and content of the description of a tracker.
    pub(crate) fn tracker_file(&self, tracker: &PlannedTracker) -> (PathBuf, Vec<u8>) {
        let path = self.tracker_dir(&tracker.slug).join("tracker.json");
        // Strings and numbers always serialise.
        (path, pretty(&serde_json::to_value(tracker).unwrap_or_default()))
    }

    /// Removes unfinished files that a killed run left: at the top, and `below` it too.
    fn sweep(&self, below: bool) -> Result<(), StoreError> {
        let mut folders = vec![self.path.clone()];
        while let Some(folder) = folders.pop() {
            let entries = fs::read_dir(&folder).map_err(|e| StoreError::io(&folder, e))?;
            for entry in entries.flatten() {
                // Of the entry itself, not of what it leads to.
                let is_dir = entry.file_type().is_ok_and(|t| t.is_dir());
                if is_dir && below {
                    folders.push(entry.path());
                } else if !is_dir && entry.file_name().to_string_lossy().ends_with(UNFINISHED) {
                    let _ = fs::remove_file(entry.path());
                }
            }
        }
        Ok(())
    }

    /// Removes the result files `results` and `timing.csv`: they are of other units than those about to be run.
    ///
    /// # Errors
    /// One of them cannot be removed.
    pub fn discard_results(&self, results: &[&str]) -> Result<(), StoreError> {
        results
            .iter()
            .chain(&["timing.csv"])
            .try_for_each(|name| remove(&self.path.join(name)))
    }

    fn clear(&self, results: &[&str]) -> Result<(), StoreError> {
        // The journal goes first: without it nothing else counts, however far this gets.
        for name in TOP_FILES.iter().rev().chain(results) {
            remove(&self.path.join(name))?;
        }
        let frames = self.path.join("frames");
        match fs::remove_dir_all(&frames) {
            // A link goes itself, and not what it leads to.
            Err(_) if frames.is_symlink() => remove(&frames),
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(StoreError::io(&frames, e)),
            _ => Ok(()),
        }
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

    /// Writes the file `path` of the directory, unless it has these bytes already. Folders below the directory are made;
    /// the directory itself is not, so that one that was moved away is not begun anew beside it.
    ///
    /// # Errors
    /// The file cannot be written; [`StoreError::Gone`] when the directory is no longer there.
    pub fn put(&self, path: &Path, bytes: &[u8], durable: Durable) -> Result<(), StoreError> {
        if files::read(path, Kind::RESULTS).is_ok_and(|old| old == bytes) && !path.is_symlink() {
            return Ok(());
        }
        let write = |out: &mut dyn io::Write| out.write_all(bytes);
        let attempt = || match replace(path, durable, &write) {
            Err(e) if e.kind() == io::ErrorKind::NotFound && self.path.is_dir() => {
                path.parent().map_or(Ok(()), fs::create_dir_all)?;
                replace(path, durable, &write)
            }
            other => other,
        };
        attempt().map_err(|e| match e.kind() {
            io::ErrorKind::NotFound if !self.path.is_dir() => StoreError::Gone(self.path.clone()),
            _ => StoreError::io(path, e),
        })
    }
}

/// Removes a file, if it is there.
fn remove(path: &Path) -> Result<(), StoreError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(StoreError::io(path, e)),
        _ => Ok(()),
    }
}

/// Whether the folder `path` is a run directory, or empty: by what its files hold, since other programs have files of
/// these names, too. Its result files go by the names `results`.
fn recognise(path: &Path, results: &[&str]) -> Result<(), StoreError> {
    let refuse = |reason: &str| {
        Err(StoreError::NotARunDirectory {
            path: path.to_path_buf(),
            reason: reason.to_owned(),
        })
    };
    if is_run(&path.join("run.json")) {
        return Ok(());
    }
    if path.join("run.json").exists() && !journal::is_journal(&path.join("journal.jsonl")) {
        return refuse("its run.json is of another program");
    }
    // A run that was killed early, or one whose description was lost or damaged: nothing but files of a run, with their contents.
    let entries = fs::read_dir(path).map_err(|e| StoreError::io(path, e))?;
    for entry in entries.flatten() {
        let (name, file) = (entry.file_name().to_string_lossy().into_owned(), entry.path());
        let known = match name.as_str() {
            ".lock" => {
                !file.is_symlink()
                    && lock::is_lock(&files::read_text(&file, Kind::SETTINGS).unwrap_or_default())
            }
            "journal.jsonl" => journal::is_journal(&file),
            name => RESERVED.contains(&name) || results.contains(&name) || name.ends_with(UNFINISHED),
        };
        if !known {
            return refuse(&format!("it holds {}", name.escape_debug()));
        }
    }
    let own = |name: &str| path.join(name).exists();
    if own("frames") && !own("journal.jsonl") {
        return refuse("it holds frames, and no journal of a run");
    }
    Ok(())
}

/// Whether the file is the description of a run.
fn is_run(path: &Path) -> bool {
    #[derive(serde::Deserialize)]
    struct Tool {
        tool: String,
    }
    let text = files::read(path, Kind::RESULTS).unwrap_or_default();
    serde_json::from_slice::<Tool>(&text).is_ok_and(|run| run.tool == env!("CARGO_PKG_NAME"))
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
        let path = |name: &str| dir.path().join(name);
        let refused = || match RunDir::open(dir.path(), true, &[]) {
            Err(StoreError::NotARunDirectory { reason, .. }) => reason,
            other => panic!("{other:?}"),
        };
        // Files of other programs that go by the names of ours.
        for (name, text) in [
            ("thesis.tex", "x"),
            (".lock", "locked by make"),
            ("run.json", r#"{"run": 3}"#),
            ("journal.jsonl", "Dear diary\n"),
        ] {
            fs::write(path(name), text).unwrap();
            refused();
            assert_eq!(fs::read_to_string(path(name)).unwrap(), text);
            fs::remove_file(path(name)).unwrap();
        }
        fs::create_dir(path("frames")).unwrap();
        fs::write(path("frames/0001.png"), "x").unwrap();
        for name in [".lock", "journal.jsonl"] {
            fs::write(path(name), "").unwrap();
            if name == ".lock" {
                refused();
            }
        }
        assert!(path("frames/0001.png").exists());
    }

    #[cfg(unix)]
    #[test]
    fn a_lock_that_is_a_link_leaves_its_target() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("thesis.tex");
        fs::write(&target, "x").unwrap();
        let run = dir.path().join("run");
        fs::create_dir(&run).unwrap();
        std::os::unix::fs::symlink(&target, run.join(".lock")).unwrap();
        assert!(RunDir::open(&run, true, &[]).is_err());
        assert_eq!(fs::read_to_string(&target).unwrap(), "x");
    }

    #[test]
    fn a_directory_that_was_moved_away_is_not_begun_anew() {
        let dir = tempfile::tempdir().unwrap();
        let (before, after) = (dir.path().join("a"), dir.path().join("b"));
        let (run, _) = RunDir::open(&before, false, &[]).unwrap();
        run.put(&before.join("frames/x/y.csv"), b"1", Durable::Later)
            .unwrap();
        fs::rename(&before, &after).unwrap();
        let error = run.put(&before.join("frames/x/z.csv"), b"1", Durable::Later);
        assert!(matches!(error, Err(StoreError::Gone(_))), "{error:?}");
        assert!(!before.exists());
    }

    #[test]
    fn what_a_killed_run_left_unfinished_is_removed() {
        let dir = tempfile::tempdir().unwrap();
        drop(RunDir::open(dir.path(), false, &[]).unwrap());
        let log = dir.path().join("frames/a/b.csv.7-0.tmp");
        fs::create_dir_all(log.parent().unwrap()).unwrap();
        fs::write(&log, "half").unwrap();
        fs::write(dir.path().join("journal.jsonl"), "").unwrap();
        fs::write(dir.path().join(".lock"), "pid 4294967295 on elsewhere since noon").unwrap();
        drop(RunDir::open(dir.path(), false, &[]).unwrap());
        assert!(!log.exists());
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_of_logs_that_is_a_link_goes_without_what_it_leads_to() {
        let dir = tempfile::tempdir().unwrap();
        let (run, elsewhere) = (dir.path().join("run"), dir.path().join("elsewhere"));
        drop(RunDir::open(&run, false, &[]).unwrap());
        fs::create_dir(&elsewhere).unwrap();
        fs::write(elsewhere.join("s.csv"), "x").unwrap();
        std::os::unix::fs::symlink(&elsewhere, run.join("frames")).unwrap();
        fs::write(run.join("journal.jsonl"), "").unwrap();
        drop(RunDir::open(&run, true, &[]).unwrap());
        assert!(!run.join("frames").is_symlink() && !run.join("journal.jsonl").exists());
        // Nor is there anything to go.
        drop(RunDir::open(&run, true, &[]).unwrap());
        assert_eq!(fs::read_to_string(elsewhere.join("s.csv")).unwrap(), "x");
    }
}
