//! The runner with trackers that are made for its tests.

use super::*;
use crate::dataset::{self, LoadOptions, Sequence};
use crate::metric::MetricSet;
use crate::metric::aggregate::TrackerName;
use crate::plan::{FrameLogs, PlanError, Protocol, Protocols, RunRequest, TrackerEntry, Unit};
use crate::report::Exporters;
use crate::run::RunError;
use crate::store::StoreError;
use crate::store::journal::{EntryStatus, Journal};
use mtf::geom::Corners;
use mtf::image::{Frame, Identity};
use mtf::tracker::{Stop, TrackError, Tracker, Update};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// What a test tracker does in its `at`-th update.
#[derive(Clone, Copy)]
enum Trick {
    Nothing,
    Panic {
        at: usize,
    },
    Lose {
        at: usize,
    },
    Infinite {
        at: usize,
    },
    /// Goes 30 px away.
    Jump {
        at: usize,
    },
    NoStart,
    /// Goes on until it is interrupted: in `init` where that is 0.
    Endless {
        at: usize,
    },
    /// Takes more memory than there is.
    Huge,
    /// Does not start on that frame of the first sequence.
    Refuse {
        frame: usize,
    },
}

/// Stays where it started but for a seeded offset.
struct Still {
    corners: Corners,
    offset: f64,
    updates: usize,
    trick: Trick,
    channels: usize,
}

impl Tracker for Still {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        let index = (frame.gray().get(0, 3, 3) as usize - 60) / 3;
        match self.trick {
            Trick::NoStart => return Err(TrackError::Template("flat")),
            Trick::Endless { at: 0 } => endless()?,
            Trick::Huge => panic!("started"),
            Trick::Refuse { frame } if frame == index => return Err(TrackError::Template("flat")),
            _ => {}
        }
        self.corners = *corners;
        Ok(())
    }
    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        self.updates += 1;
        let value = f64::from(frame.with_channels(self.channels).get(0, 3, 3));
        match self.trick {
            Trick::Panic { at } if at == self.updates => panic!("as told"),
            Trick::Lose { at } if at == self.updates => return Err(TrackError::Outside),
            Trick::Endless { at } if at == self.updates => endless()?,
            Trick::Infinite { at } if at == self.updates => {
                let corners = Corners::rect(f64::NAN, 0.0, 1.0, 1.0);
                return Ok(Update {
                    corners,
                    stop: Stop::Done,
                    iterations: 0,
                    similarity: value,
                });
            }
            Trick::Jump { at } if at == self.updates => self.corners = self.corners.translated(30.0, 0.0),
            _ => self.corners = self.corners.translated(self.offset, 1.0 / 3.0),
        }
        Ok(Update {
            corners: self.corners,
            stop: Stop::Converged,
            iterations: 2,
            similarity: value,
        })
    }
    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.corners = *corners;
        Ok(())
    }
    fn corners(&self) -> Corners {
        self.corners
    }
    fn reseed(&mut self, seed: u64) {
        self.offset = (seed % 1000) as f64 / 1000.0;
    }
    fn channels(&self) -> usize {
        self.channels
    }
    fn memory(&self) -> usize {
        size_of::<Self>()
    }
    fn memory_needed(&self) -> usize {
        match self.trick {
            Trick::Huge => 8_700_000_000,
            _ => self.memory(),
        }
    }
}

/// Goes on until it is interrupted.
fn endless() -> Result<(), TrackError> {
    loop {
        mtf::interrupt::check()?;
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

fn tracker(id: &str, trick: Trick, channels: usize) -> TrackerEntry {
    TrackerEntry {
        name: TrackerName {
            id: id.into(),
            sm: id.into(),
            ..TrackerName::default()
        },
        slug: id.into(),
        parameters: serde_json::json!({ "channels": channels }),
        answers: Default::default(),
        make: Arc::new(move |_| {
            let corners = Corners::rect(0.0, 0.0, 1.0, 1.0);
            Ok(Box::new(Still {
                corners,
                offset: 0.0,
                updates: 0,
                trick,
                channels,
            }))
        }),
    }
}

/// Writes a data set of `lengths.len()` sequences of small images; the object moves a pixel to the right per frame.
fn write_data(root: &Path, lengths: &[usize]) {
    for (s, &frames) in lengths.iter().enumerate() {
        let folder = root.join(format!("seq{s}"));
        fs::create_dir_all(&folder).unwrap();
        let mut text = "frame ulx uly urx ury lrx lry llx lly\n".to_string();
        for f in 0..frames {
            let name = format!("frame{:05}.png", f + 1);
            let pixel =
                |x: u32, y: u32| image::Luma([((x * 7 + y * 13 + f as u32 * 3 + s as u32) % 256) as u8]);
            image::GrayImage::from_fn(32, 24, pixel)
                .save(folder.join(&name))
                .unwrap();
            let x = 5.0 + f as f64 * 0.25;
            text += &format!("{name} {x} 5 {} 5 {} 15 {x} 15\n", x + 10.0, x + 10.0);
        }
        fs::write(root.join(format!("seq{s}.txt")), text).unwrap();
    }
}

mod protocols;

struct Bench {
    dir: tempfile::TempDir,
    sequences: Vec<Sequence>,
}

impl Bench {
    fn new(lengths: &[usize]) -> Bench {
        let dir = tempfile::tempdir().unwrap();
        write_data(&dir.path().join("data"), lengths);
        let sequences = dataset::load(&dir.path().join("data"), &LoadOptions::default())
            .unwrap()
            .sequences;
        assert_eq!(sequences.len(), lengths.len());
        Bench { dir, sequences }
    }

    fn request(&self, out: &str, trackers: Vec<TrackerEntry>) -> RunRequest {
        RunRequest {
            data_notes: Default::default(),
            trackers,
            sequences: self.sequences.clone(),
            pre: Arc::new(Identity),
            protocol: Protocol::Ope.into(),
            seed: 7,
            metrics: MetricSet::builtin(),
            threads_per_tracker: 1,
            shard: None,
            threads: 2,
            memory: 1 << 30,
            out: self.dir.path().join(out),
            force: false,
            mix_builds: false,
            frame_logs: FrameLogs::Csv,
            hurry: false,
            timeout: None,
            grace: std::time::Duration::ZERO,
            about: serde_json::Map::new(),
            host: serde_json::Map::new(),
        }
    }
}

fn go(request: &RunRequest) -> Result<RunReport, RunError> {
    run(request, &Exporters::builtin(), &Silent, &AtomicBool::new(false))
}

fn many(count: usize) -> Vec<TrackerEntry> {
    (0..count)
        .map(|k| tracker(&format!("t{k}"), Trick::Nothing, 1))
        .collect()
}

/// Every file that must not depend on how the run went.
fn files(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![dir.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(dir).unwrap().to_path_buf();
            if path.is_dir() {
                folders.push(path);
            } else if !["timing.csv", "journal.jsonl", "run.json", ".lock"].contains(&name.to_str().unwrap())
            {
                found.insert(name, fs::read(path).unwrap());
            }
        }
    }
    let mut run: serde_json::Value =
        serde_json::from_slice(&fs::read(dir.join("run.json")).unwrap()).unwrap();
    run.as_object_mut().unwrap().remove("host").unwrap();
    found.insert("run.json".into(), run.to_string().into_bytes());
    found
}

#[test]
fn each_frame_is_decoded_once_for_all_trackers() {
    let bench = Bench::new(&[40, 17]);
    let mut trackers = many(30);
    trackers.push(tracker("colour", Trick::Nothing, 3));
    go(&bench.request("out", trackers)).unwrap();
    let counts: Vec<usize> = bench.sequences.iter().map(Sequence::decoded_count).collect();
    assert_eq!(counts, [40, 17]);
}

#[test]
fn a_small_budget_makes_more_groups_and_the_same_files() {
    let bench = Bench::new(&[20]);
    go(&bench.request("wide", many(6))).unwrap();
    let before = bench.sequences[0].decoded_count();
    let mut request = bench.request("narrow", many(6));
    // Neither for the frames of the sequence nor for the rows of all trackers.
    request.memory = 1 << 13;
    go(&request).unwrap();
    let decoded = bench.sequences[0].decoded_count() - before;
    assert!(decoded > 20 && decoded.is_multiple_of(20), "{decoded}");
    assert_eq!(
        files(&bench.dir.path().join("wide")),
        files(&bench.dir.path().join("narrow"))
    );
}

#[test]
fn threads_order_and_company_do_not_change_a_file() {
    let bench = Bench::new(&[33, 5, 18]);
    let mut trackers = many(4);
    trackers.push(tracker("panics", Trick::Panic { at: 4 }, 1));
    let mut one = bench.request("one", trackers.clone());
    one.threads = 1;
    go(&one).unwrap();
    let mut three = bench.request("three", trackers.clone());
    three.threads = 3;
    three.trackers.reverse();
    three.sequences.reverse();
    go(&three).unwrap();
    let mut steps = bench.request("steps", trackers[2..3].to_vec());
    go(&steps).unwrap();
    steps.trackers = trackers;
    let report = go(&steps).unwrap();
    assert_eq!((report.units, report.resumed), (15, 3));
    assert_eq!(files(&one.out), files(&three.out));
    assert_eq!(files(&one.out), files(&steps.out));
}

#[test]
fn failures_concern_their_unit_only_and_are_tried_again() {
    let bench = Bench::new(&[12]);
    let request = bench.request(
        "out",
        vec![
            tracker("good", Trick::Nothing, 1),
            tracker("infinite", Trick::Infinite { at: 3 }, 1),
            tracker("loses", Trick::Lose { at: 2 }, 1),
            tracker("no_start", Trick::NoStart, 1),
            tracker("panics", Trick::Panic { at: 5 }, 1),
        ],
    );
    let report = go(&request).unwrap();
    let failed: Vec<&str> = report
        .failed
        .iter()
        .map(|(unit, _)| unit.split(' ').next().unwrap())
        .collect();
    assert_eq!(failed, ["no_start", "panics"]);
    assert!(report.failed[0].1.contains("flat"), "{:?}", report.failed);
    assert!(
        report.failed[1].1.contains("frame 5: as told"),
        "{:?}",
        report.failed
    );
    let log = |slug: &str| {
        let dataset = bench.sequences[0].dataset();
        fs::read_to_string(
            request
                .out
                .join("frames")
                .join(slug)
                .join(dataset)
                .join("seq0.csv"),
        )
    };
    assert!(log("panics").is_err() && log("no_start").is_err());
    let lost = log("loses").unwrap();
    assert_eq!(lost.lines().count(), 13);
    assert!(
        lost.lines()
            .nth(1)
            .unwrap()
            .starts_with("0,frame00001.png,init,5.000000,"),
        "{lost}"
    );
    assert!(lost.lines().nth(3).unwrap().contains(",outside,"), "{lost}");
    assert!(lost.lines().nth(4).unwrap().contains(",converged,"), "{lost}");
    assert!(
        log("infinite")
            .unwrap()
            .lines()
            .nth(4)
            .unwrap()
            .contains(",not_finite,,,,,,,,,,,,,")
    );

    let again = go(&request).unwrap();
    assert_eq!(again.resumed, 3);
    assert_eq!(again.failed, report.failed);
    let journal = fs::read_to_string(request.out.join("journal.jsonl")).unwrap();
    assert_eq!(journal.lines().count(), 7);
}

#[test]
fn without_frame_logs_the_figures_are_the_same() {
    let bench = Bench::new(&[15, 9]);
    let with = bench.request("with", many(3));
    go(&with).unwrap();
    let mut without = bench.request("without", many(3));
    without.frame_logs = FrameLogs::None;
    go(&without).unwrap();
    let (mut a, mut b) = (files(&with.out), files(&without.out));
    // Logs, and parameters beside them.
    a.retain(|path, _| !path.starts_with("frames"));
    for files in [&mut a, &mut b] {
        let run = files.get_mut(Path::new("run.json")).unwrap();
        let mut value: serde_json::Value = serde_json::from_slice(run).unwrap();
        value.as_object_mut().unwrap().remove("frame_logs").unwrap();
        *run = value.to_string().into_bytes();
        // It says what it is made from.
        let summary = files.get_mut(Path::new("summary.json")).unwrap();
        let mut value: serde_json::Value = serde_json::from_slice(summary).unwrap();
        value.as_object_mut().unwrap().remove("made_from").unwrap();
        *summary = value.to_string().into_bytes();
    }
    assert!(a == b);
    assert_eq!(go(&without).unwrap().resumed, 6);
    without.frame_logs = FrameLogs::Csv;
    assert_eq!(go(&without).unwrap().resumed, 0);
    assert!(files(&with.out) == files(&without.out));
}

#[test]
fn what_can_change_a_result_makes_a_new_unit_and_logs_are_checked() {
    let bench = Bench::new(&[9]);
    let mut request = bench.request("out", many(2));
    go(&request).unwrap();
    let reference = files(&request.out);
    assert_eq!(go(&request).unwrap().resumed, 2);
    request.seed = 8;
    assert!(differences(&request)[0].contains("seed 7 against 8"));
    request.force = true;
    assert_eq!(go(&request).unwrap().resumed, 0);
    assert_ne!(files(&request.out), reference);
    request.seed = 7;
    assert_eq!(go(&request).unwrap().resumed, 0);
    request.force = false;
    assert_eq!(go(&request).unwrap().resumed, 2);
    assert_eq!(files(&request.out), reference);
    let log = request
        .out
        .join("frames/t0")
        .join(bench.sequences[0].dataset())
        .join("seq0.csv");
    fs::write(&log, "edited").unwrap();
    assert_eq!(go(&request).unwrap().resumed, 1);
    fs::remove_file(&log).unwrap();
    assert_eq!(go(&request).unwrap().resumed, 1);
    request.force = true;
    assert_eq!(go(&request).unwrap().resumed, 0);
    assert_eq!(files(&request.out), reference);
}

/// What keeps the request from going on in its directory.
fn differences(request: &RunRequest) -> Vec<String> {
    match go(request) {
        Err(RunError::Store(StoreError::OtherExperiment { differences, .. })) => differences,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_smaller_grid_leaves_the_rest_on_disk_but_out_of_the_figures() {
    let bench = Bench::new(&[9]);
    go(&bench.request("out", many(3))).unwrap();
    let report = go(&bench.request("out", many(1))).unwrap();
    assert_eq!((report.units, report.resumed), (1, 1));
    let summary = fs::read_to_string(report.path.join("summary.csv")).unwrap();
    assert!(summary.contains("t0") && !summary.contains("t1"));
    assert!(report.path.join("frames/t1").exists());
    // Others in their place are another experiment; more of them are not.
    let others = many(4).into_iter().skip(1);
    assert_eq!(
        differences(&bench.request("out", others.collect())),
        ["tracker t0 is not in the new one"]
    );
    let report = go(&bench.request("out", many(4))).unwrap();
    assert_eq!((report.units, report.resumed), (4, 3));
}

#[test]
fn an_unreadable_frame_fails_its_sequence_only() {
    let bench = Bench::new(&[10, 10]);
    let bad = bench.dir.path().join("data/seq1/frame00007.png");
    fs::write(&bad, "not an image").unwrap();
    let report = go(&bench.request("out", many(3))).unwrap();
    assert_eq!(report.failed.len(), 3);
    for (unit, reason) in &report.failed {
        assert!(
            unit.contains("seq1") && reason.contains("frame00007.png"),
            "{unit}: {reason}"
        );
    }
}

/// Stops the run after some units.
struct StopAfter<'a> {
    units: AtomicUsize,
    after: usize,
    stop: &'a AtomicBool,
}

impl Observer for StopAfter<'_> {
    fn unit(&self, _: &crate::store::journal::Entry, _: &dyn Fn() -> crate::metric::Errors) {
        if self.units.fetch_add(1, Ordering::Relaxed) + 1 >= self.after {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

#[test]
fn an_interrupted_run_goes_on_where_it_stopped() {
    let bench = Bench::new(&[12, 13, 14, 15]);
    go(&bench.request("whole", many(3))).unwrap();
    let mut request = bench.request("parts", many(3));
    request.threads = 1;
    let stop = AtomicBool::new(false);
    let observer = StopAfter {
        units: AtomicUsize::new(0),
        after: 4,
        stop: &stop,
    };
    match run(&request, &Exporters::builtin(), &observer, &stop) {
        Err(RunError::Interrupted { done, total, .. }) => assert!((4..12).contains(&done) && total == 12),
        other => panic!("{other:?}"),
    }
    let journal = Journal::read(&request.out.join("journal.jsonl")).unwrap();
    let keys = crate::plan::UnitKeys::new(&request.plan().unwrap());
    let ended = |unit: &Unit| journal.status(&keys.of(unit));
    assert!(
        request
            .plan()
            .unwrap()
            .units()
            .filter_map(|u| ended(&u))
            .all(|s| s == EntryStatus::Ok)
    );
    let report = go(&request).unwrap();
    assert_eq!(report.resumed, journal.len());
    assert_eq!(files(&bench.dir.path().join("whole")), files(&request.out));
}

/// Stops the run after some tracked frames.
struct StopAfterFrames<'a> {
    frames: AtomicUsize,
    after: usize,
    stop: &'a AtomicBool,
}

impl Observer for StopAfterFrames<'_> {
    fn frames(&self, _: u32, count: u64, _: f64) {
        if self.frames.fetch_add(count as usize, Ordering::Relaxed) + count as usize >= self.after {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// Runs the request in slots of `after` tracked frames, without grace, until it is done; returns the units that each slot
/// ended.
fn in_slots(request: &RunRequest, after: usize) -> Vec<usize> {
    let mut ended = Vec::new();
    let mut before = 0;
    loop {
        let stop = AtomicBool::new(false);
        let observer = StopAfterFrames {
            frames: AtomicUsize::new(0),
            after,
            stop: &stop,
        };
        match run(request, &Exporters::builtin(), &observer, &stop) {
            Ok(_) => return ended,
            Err(RunError::Interrupted { done, .. }) => {
                ended.push(done - before);
                before = done;
            }
            Err(other) => panic!("{other:?}"),
        }
        assert!(ended.len() < 200, "no progress: {ended:?}");
    }
}

#[test]
fn every_slot_that_fits_a_unit_gets_one_done() {
    let bench = Bench::new(&[40]);
    go(&bench.request("whole", many(30))).unwrap();
    // Time for 4 of 30 units.
    let request = bench.request("kept", many(30));
    let ended = in_slots(&request, 4 * 40);
    assert!(ended.iter().all(|&n| n > 0) && ended.len() >= 5, "{ended:?}");
    assert_eq!(files(&bench.dir.path().join("whole")), files(&request.out));

    // Without room for the frames, the first slot may go without: units begin together. The next ones may not.
    let mut tight = bench.request("tight", many(30));
    tight.memory = 100_000;
    let ended = in_slots(&tight, 4 * 40);
    assert!(ended.iter().skip(1).all(|&n| n > 0), "{ended:?}");
    assert_eq!(files(&bench.dir.path().join("whole")), files(&tight.out));
    // One that says that it may be stopped does not either.
    let mut hurried = bench.request("hurried", many(30));
    (hurried.memory, hurried.hurry) = (100_000, true);
    let ended = in_slots(&hurried, 4 * 40);
    assert!(ended.iter().all(|&n| n > 0), "{ended:?}");
    assert_eq!(files(&bench.dir.path().join("whole")), files(&hurried.out));
}

/// Frames that are done when the first unit ends.
#[derive(Default)]
struct FirstEnd {
    frames: AtomicUsize,
    first: std::sync::OnceLock<usize>,
}

impl Observer for FirstEnd {
    fn frames(&self, _: u32, count: u64, _: f64) {
        self.frames.fetch_add(count as usize, Ordering::Relaxed);
    }
    fn unit(&self, _: &crate::store::journal::Entry, _: &dyn Fn() -> crate::metric::Errors) {
        let _ = self.first.set(self.frames.load(Ordering::Relaxed));
    }
}

#[test]
fn units_end_from_early_on_and_every_frame_is_told() {
    let bench = Bench::new(&[40]);
    // With room for the frames of the sequence, and without.
    for memory in [1 << 30, 100_000] {
        let mut trackers = many(39);
        trackers.push(tracker("panics", Trick::Panic { at: 5 }, 1));
        let mut request = bench.request(&memory.to_string(), trackers);
        request.memory = memory;
        let watch = FirstEnd::default();
        run(&request, &Exporters::builtin(), &watch, &AtomicBool::new(false)).unwrap();
        let all = 40 * 40;
        assert_eq!(watch.frames.into_inner(), all);
        let first = watch.first.into_inner().unwrap();
        assert!(first <= all / 4, "{first} of {all} frames");
    }
}

#[test]
fn gray_and_colour_share_a_sequence_that_is_kept() {
    let bench = Bench::new(&[12, 9]);
    let trackers = || -> Vec<TrackerEntry> {
        (0..9)
            .map(|k| tracker(&format!("t{k}"), Trick::Nothing, if k % 3 == 2 { 3 } else { 1 }))
            .collect()
    };
    go(&bench.request("kept", trackers())).unwrap();
    let mut tight = bench.request("tight", trackers());
    tight.memory = 100_000;
    go(&tight).unwrap();
    assert_eq!(files(&bench.dir.path().join("kept")), files(&tight.out));
}

#[test]
fn requests_that_cannot_work_are_refused_before_anything_is_written() {
    let bench = Bench::new(&[5]);
    assert!(matches!(
        go(&bench.request("out", Vec::new())),
        Err(RunError::Plan(PlanError::Nothing(_)))
    ));
    let mut none = bench.request("out", many(1));
    none.sequences.clear();
    assert!(matches!(go(&none), Err(RunError::Plan(PlanError::Nothing(_)))));
    assert!(!none.out.exists());
    let other = Bench::new(&[6]);
    let mut both = bench.request("out", many(1));
    both.sequences.extend(other.sequences.iter().cloned());
    assert!(matches!(go(&both), Err(RunError::Plan(PlanError::Ambiguous(_)))));
    both.sequences.truncate(1);
    both.sequences.extend(bench.sequences.iter().cloned());
    assert_eq!(go(&both).unwrap().units, 1);
}

#[test]
fn a_timeout_fails_the_unit() {
    let bench = Bench::new(&[5]);
    let mut request = bench.request("out", many(1));
    request.timeout = Some(std::time::Duration::from_nanos(1));
    let report = go(&request).unwrap();
    assert!(report.failed[0].1.contains("longer than"), "{:?}", report.failed);
}

#[test]
fn a_timeout_ends_long_starts_and_updates() {
    let bench = Bench::new(&[5, 4]);
    let mut trackers = many(2);
    trackers.push(tracker("starts", Trick::Endless { at: 0 }, 1));
    trackers.push(tracker("updates", Trick::Endless { at: 2 }, 1));
    let mut request = bench.request("out", trackers);
    request.timeout = Some(std::time::Duration::from_millis(100));
    let report = go(&request).unwrap();
    assert_eq!((report.units, report.failed.len()), (8, 4));
    for (unit, reason) in &report.failed {
        assert_eq!(reason, "longer than 0.1 s", "{unit}");
    }
}

#[test]
fn a_halt_ends_long_starts_and_updates_and_leaves_them_undone() {
    let bench = Bench::new(&[5]);
    for at in [0, 2] {
        let request = bench.request(
            &format!("out{at}"),
            vec![tracker("long", Trick::Endless { at }, 1)],
        );
        let stop = AtomicBool::new(false);
        let halted = std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(std::time::Duration::from_millis(100));
                stop.store(true, Ordering::Relaxed);
            });
            run(&request, &Exporters::builtin(), &Silent, &stop)
        });
        assert!(
            matches!(
                halted,
                Err(RunError::Interrupted {
                    done: 0,
                    total: 1,
                    ..
                })
            ),
            "{halted:?}"
        );
        assert_eq!(
            Journal::read(&request.out.join("journal.jsonl")).unwrap().len(),
            0
        );
    }
}

#[test]
fn a_tracker_beyond_the_memory_is_refused_before_its_start() {
    let bench = Bench::new(&[5]);
    let mut trackers = many(2);
    trackers.push(tracker("huge", Trick::Huge, 1));
    let mut request = bench.request("out", trackers);
    request.memory = 500 << 20;
    for resumed in [0, 2] {
        let report = go(&request).unwrap();
        assert_eq!(
            (report.units, report.resumed, report.failed.len()),
            (3, resumed, 1)
        );
        assert_eq!(
            report.failed[0].1,
            "needs about 8.1 GiB, more than allowed (500 MiB); use fewer samples or patches, or more --memory"
        );
    }
}

#[test]
fn the_first_reason_of_a_failure_stays() {
    let bench = Bench::new(&[20]);
    fs::write(bench.dir.path().join("data/seq0/frame00019.png"), "not an image").unwrap();
    let trackers = vec![
        tracker("good", Trick::Nothing, 1),
        tracker("panics", Trick::Panic { at: 3 }, 1),
    ];
    let failed = go(&bench.request("out", trackers)).unwrap().failed;
    assert!(failed[0].1.contains("frame00019.png"), "{failed:?}");
    assert!(failed[1].1.contains("frame 3: as told"), "{failed:?}");
}

#[test]
fn frames_are_not_read_for_trackers_that_have_all_failed() {
    let bench = Bench::new(&[90]);
    go(&bench.request("out", vec![tracker("no_start", Trick::NoStart, 1)])).unwrap();
    let decoded = bench.sequences[0].decoded_count();
    assert!(decoded < 45, "{decoded}");
}

#[test]
fn sequences_at_once_share_the_memory() {
    let (one, two) = (Bench::new(&[20]), Bench::new(&[20, 20]));
    let decoded = |bench: &Bench, memory: u64| -> Vec<usize> {
        let before: Vec<usize> = bench.sequences.iter().map(Sequence::decoded_count).collect();
        let mut request = bench.request("out", many(6));
        request.memory = memory;
        request.force = true;
        go(&request).unwrap();
        let now = bench.sequences.iter().map(Sequence::decoded_count);
        now.zip(before).map(|(now, before)| now - before).collect()
    };
    // The least power of two in which the trackers of one sequence go together.
    let enough = (10..20)
        .map(|k| 1 << k)
        .find(|&memory| decoded(&one, memory) == [20])
        .unwrap();
    assert_eq!(decoded(&two, 2 * enough), [20, 20]);
    let halves = decoded(&two, enough);
    assert!(halves.iter().all(|&n| n > 20), "{halves:?}");
}

#[test]
fn a_description_of_another_version_is_replaced_only_where_nothing_is_lost() {
    let bench = Bench::new(&[12]);
    let request = bench.request("out", many(1));
    go(&request).unwrap();
    let path = request.out.join("run.json");
    let mut run: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    run["schema_version"] = 0.into();
    run["host"].as_object_mut().unwrap().remove("sum");
    let sum = twox_hash::XxHash64::oneshot(0, &serde_json::to_vec(&run).unwrap());
    run["host"]["sum"] = format!("{sum:016x}").into();
    fs::write(&path, serde_json::to_vec(&run).unwrap()).unwrap();
    match go(&request) {
        Err(RunError::Store(StoreError::OtherExperiment { differences, .. })) => {
            assert_eq!(differences, ["run.json is of another version of the program"]);
        }
        other => panic!("{other:?}"),
    }
    fs::remove_file(request.out.join("journal.jsonl")).unwrap();
    assert_eq!(go(&request).unwrap().resumed, 0);
}

#[test]
fn results_of_units_that_ended_otherwise_are_stale() {
    let bench = Bench::new(&[12]);
    let of = |out: &str, trick: Trick| {
        let request = bench.request(out, vec![tracker("t", trick, 1)]);
        go(&request).unwrap();
        request.out
    };
    let finished = |path: &Path| crate::store::held::finished(path, &MetricSet::builtin());
    let (a, b) = (of("a", Trick::Nothing), of("b", Trick::Jump { at: 2 }));
    assert!(finished(&a).unwrap().whole && finished(&b).unwrap().whole);
    // The same unit, which ended otherwise.
    fs::copy(a.join("journal.jsonl"), b.join("journal.jsonl")).unwrap();
    let found = finished(&b);
    assert!(matches!(found, Err(StoreError::Stale { .. })), "{found:?}");
}

/// Frames that are kept for the trackers that go first may be gray, and later ones need colour.
#[test]
fn colour_does_not_depend_on_who_goes_first() {
    let bench = Bench::new(&[12]);
    for k in 1..=12 {
        let path = bench.dir.path().join(format!("data/seq0/frame{k:05}.png"));
        let gray = image::open(&path).unwrap().into_luma8();
        let red = |x, y| {
            let v = gray.get_pixel(x, y)[0];
            image::Rgb([v.saturating_add(50), v, v.saturating_add(9)])
        };
        image::RgbImage::from_fn(gray.width(), gray.height(), red)
            .save(&path)
            .unwrap();
    }
    let similarities = |out: &str, mut trackers: Vec<TrackerEntry>| -> String {
        trackers.push(tracker("z", Trick::Nothing, 3));
        let mut request = bench.request(out, trackers);
        request.threads = 1;
        assert_eq!(go(&request).unwrap().failed, []);
        let logs = files(&request.out);
        let log = logs.iter().find(|(name, _)| name.starts_with("frames/z"));
        String::from_utf8(log.unwrap().1.clone()).unwrap()
    };
    assert_eq!(similarities("alone", vec![]), similarities("company", many(5)));
}
