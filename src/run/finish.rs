//! From a run directory's journal and frame logs to its result files.
//!
//! The result files are always made from what is on disk, never from memory, so that a run that was interrupted any
//! number of times, or done in shards, ends with the same bytes as one that was not.

use crate::files::{self, Kind};
use crate::judge::ranking::Speeds;
use crate::measure::machine::cpu_name;
use crate::metric::aggregate::{ALL_DATASETS, POOLED, Results, UnitResult, UnitStatus, aggregate_tracker};
use crate::metric::{Errors, MetricSet};
use crate::plan::{Plan, Unit, UnitKeys};
use crate::report::{About, Exporters, text};
use crate::run::error::RunError;
use crate::store::Durable;
use crate::store::StoreError;
use crate::store::framelog::score_log;
use crate::store::held::{Endings, ending};
use crate::store::host::{build, host_name};
use crate::store::journal::{Entry, EntryStatus, Journal, UnitTime};
use crate::store::rundir::{Recorded, RunDir, digest};
use crate::store::truth::{self, KeptTruth};
use rayon::prelude::*;
use serde_json::{Map, Value};
use std::path::PathBuf;

/// Most units of a run whose files hold the success curves of each sequence and metric.
const CURVE_UNITS: usize = 1000;

/// All there is to make results from.
pub(crate) struct ResultSource<'a> {
    pub dir: &'a RunDir,
    pub plan: &'a Plan,
    pub keys: &'a UnitKeys,
    pub metrics: &'a MetricSet,
    pub truth: &'a [KeptTruth],
    pub journal: &'a Journal,
}

/// What becomes of units that have no result on disk that can be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lacking {
    /// There should be none.
    Error,
    /// They are left out.
    LeftOut,
}

/// Units without a result: what they are, and why.
pub type Failed = Vec<(String, String)>;

/// What is made from units that have ended.
pub(crate) struct Gathered {
    pub results: Results,
    /// Of [`Endings`].
    made_from: String,
    pub times: Vec<(Unit, UnitTime)>,
    failed: Failed,
}

impl Gathered {
    /// Units that it is made from.
    pub fn units(&self) -> usize {
        self.times.len() + self.failed.len()
    }

    /// The speed of each tracker.
    pub fn speeds(&self, plan: &Plan) -> Speeds {
        speeds(plan, &self.times)
    }
}

impl ResultSource<'_> {
    /// Writes `timing.csv` and the result files of `units`, which are in the order of the plan.
    pub fn finish(
        &self,
        exporters: &Exporters,
        units: &[Unit],
        pool: &rayon::ThreadPool,
    ) -> Result<(Results, Speeds, Failed), RunError> {
        let all = self.gather(units, pool, Lacking::Error)?;
        write_timing(self.dir, self.plan, &all.times)?;
        let about = About {
            all_curves: units.len() <= CURVE_UNITS,
            made_from: all.made_from.clone(),
            ..About::default()
        };
        exporters.write(self.dir.path(), &all.results, &about)?;
        let speeds = all.speeds(self.plan);
        Ok((all.results, speeds, all.failed))
    }

    /// Aggregates `units`, which are in the order of the plan.
    pub fn gather(
        &self,
        units: &[Unit],
        pool: &rayon::ThreadPool,
        lacking: Lacking,
    ) -> Result<Gathered, RunError> {
        // A tracker at a time, so that the errors of all frames of all trackers are never in memory together.
        let trackers: Vec<&[Unit]> = units.chunk_by(|a, b| a.tracker == b.tracker).collect();
        let parts: Vec<(Vec<u64>, Vec<(Unit, UnitTime)>, Failed, Results)> = pool.install(|| {
            let load = |units: &&[Unit]| -> Result<_, RunError> {
                let (mut endings, mut times, mut failed) = (Vec::new(), Vec::new(), Vec::new());
                let mut loaded: Vec<(&Unit, UnitResult)> = Vec::new();
                for unit in *units {
                    let (ending, entry, result) = match self.load(unit) {
                        Err(_) if lacking == Lacking::LeftOut => continue,
                        other => other?,
                    };
                    endings.push(ending);
                    match entry.reason {
                        Some(reason) => failed.push((self.plan.describe(unit), reason)),
                        None => times.push((*unit, entry.time)),
                    }
                    loaded.push((unit, result));
                }
                let mut results = Results::new(self.metrics);
                for (index, protocol) in self.plan.protocol.iter().enumerate() {
                    let mut own = Vec::new();
                    for (unit, result) in &mut loaded {
                        if self.plan.belongs(unit, index) {
                            result.protocol = protocol.to_string();
                            result.restarted = protocol.restarts_on_failure();
                            own.push(&*result);
                        }
                    }
                    results.extend(aggregate_tracker(self.metrics, &own));
                }
                Ok((endings, times, failed, results))
            };
            trackers.par_iter().map(load).collect::<Result<_, _>>()
        })?;
        let mut results = Results::new(self.metrics);
        let (mut made_from, mut times, mut failed) = (Endings::default(), Vec::new(), Vec::new());
        for (endings, part_times, part_failed, part) in parts {
            endings.into_iter().for_each(|ending| made_from.add(ending));
            times.extend(part_times);
            failed.extend(part_failed);
            results.extend(part);
        }
        let tagged = self.plan.sequences.iter().filter(|s| !s.tags.is_empty());
        results.tags = tagged.map(|s| (s.id(), s.tags.clone())).collect();
        Ok(Gathered {
            results,
            made_from: made_from.finish(),
            times,
            failed,
        })
    }

    /// How the unit ended, its line and its result, as they stand on disk.
    fn load(&self, unit: &Unit) -> Result<(u64, Entry, UnitResult), StoreError> {
        let damaged = |path: PathBuf, reason: String| StoreError::Damaged { path, reason };
        let sequence = &self.plan.sequences[unit.sequence as usize];
        let tracker = &self.plan.trackers[unit.tracker as usize];
        let truth = &self.truth[unit.sequence as usize];
        let journal = || self.dir.journal();
        let mut entry = self
            .journal
            .get(&self.keys.of(unit))?
            .ok_or_else(|| damaged(journal(), format!("no line for {}", self.plan.describe(unit))))?;
        let (ending, start) = (ending(&entry), unit.start as usize);
        let errors = match (&entry.status, &entry.log, entry.errors.take()) {
            (EntryStatus::Failed, ..) => Errors::lost(self.metrics, truth.scored(start), truth.dense(start)),
            (_, Some(_), _) => {
                let path = self.dir.log(self.plan, unit);
                let bytes = files::read(&path, Kind::RESULTS).map_err(|e| StoreError::io(&path, e))?;
                files::unpack(bytes)
                    .and_then(|text| score_log(self.metrics, &text, |i| truth.at(i).is_some()))
                    .map_err(|reason| damaged(path, reason))?
            }
            (_, None, Some(errors)) => {
                let errors = Errors::from_rows(self.metrics, &errors, &entry.grid);
                errors.ok_or_else(|| damaged(journal(), "errors of other metrics".into()))?
            }
            (_, None, None) => return Err(damaged(journal(), "a line has neither log nor errors".into())),
        };
        let status = match &entry.reason {
            Some(reason) => UnitStatus::Failed(reason.clone()),
            None => UnitStatus::Ok,
        };
        let result = UnitResult {
            tracker: tracker.name(),
            dataset: sequence.dataset.clone(),
            sequence: sequence.sequence.clone(),
            start,
            protocol: self.plan.course(unit).to_string(),
            restarted: self.plan.course(unit).restarts_on_failure(),
            boxes: !tracker.answers.are_corners(),
            status,
            errors,
        };
        Ok((ending, entry, result))
    }
}

/// What `run.json` says about this machine and execution.
pub(crate) fn host(threads: usize) -> Map<String, Value> {
    let mut host = Map::new();
    host.insert("name".into(), host_name().into());
    host.insert("cpu".into(), cpu_name().into());
    host.insert("os".into(), std::env::consts::OS.into());
    host.insert("arch".into(), std::env::consts::ARCH.into());
    host.insert("threads".into(), threads.into());
    host.insert("build".into(), build().into());
    host.insert("started".into(), crate::store::host::utc_now().into());
    host
}

/// Writes `run.json`, `truth.csv` and, beside frame logs, the `tracker.json` of each tracker of `units`; returns what `run.json` says.
pub(crate) fn describe(
    dir: &RunDir,
    plan: &Plan,
    units: &[Unit],
    truth: &[KeptTruth],
    host: Map<String, Value>,
) -> Result<Recorded, StoreError> {
    for tracker in dir.described_trackers(plan, units) {
        let (path, bytes) = dir.tracker_file(&plan.trackers[tracker as usize]);
        // Written again by the next run if a loss of power damages it.
        dir.put(&path, &bytes, Durable::Later)?;
    }
    let truth = truth::format(&plan.sequences, truth);
    let recorded = Recorded {
        plan: plan.clone(),
        truth: digest(&truth),
        host,
    };
    dir.put(&dir.path().join("truth.csv"), &truth, Durable::Now)?;
    write_description(dir, &recorded)?;
    Ok(recorded)
}

/// Writes the digests of all result files into `run.json`: the run has ended.
pub(crate) fn seal(dir: &RunDir, mut recorded: Recorded, exporters: &Exporters) -> Result<(), StoreError> {
    let digest_of = |name: &str| -> Result<(String, String), StoreError> {
        let path = dir.path().join(name);
        let bytes = files::read(&path, Kind::RESULTS).map_err(|e| StoreError::io(&path, e))?;
        Ok((name.to_owned(), digest(&bytes)))
    };
    let digests: Vec<_> = exporters
        .files()
        .chain([TIMING])
        .map(digest_of)
        .collect::<Result<_, _>>()?;
    recorded.set_files(digests);
    write_description(dir, &recorded)
}

fn write_description(dir: &RunDir, recorded: &Recorded) -> Result<(), StoreError> {
    let path = dir.path().join("run.json");
    let bytes = recorded.to_bytes().map_err(|e| StoreError::io(&path, e.into()))?;
    dir.put(&path, &bytes, Durable::Now)
}

/// The time that several units took together.
fn total<'a>(times: impl IntoIterator<Item = &'a UnitTime>) -> UnitTime {
    times.into_iter().fold(UnitTime::default(), |mut sum, time| {
        sum.updates += time.updates;
        sum.seconds += time.seconds;
        sum.input_seconds += time.input_seconds;
        sum.init_seconds += time.init_seconds;
        sum.threads = sum.threads.max(time.threads);
        sum
    })
}

/// Updates per second; `None` without updates.
fn rate(updates: usize, seconds: f64) -> Option<f64> {
    (updates > 0).then(|| updates as f64 / seconds.max(1e-9))
}

/// The speed of each tracker that has been timed. `times` are tracker by tracker.
fn speeds(plan: &Plan, times: &[(Unit, UnitTime)]) -> Speeds {
    let of_tracker = |times: &[(Unit, UnitTime)]| {
        let sum = total(times.iter().map(|(_, time)| time));
        let id = &plan.trackers[times[0].0.tracker as usize].id;
        Some((id.clone(), rate(sum.updates, sum.seconds)?))
    };
    let trackers = times.chunk_by(|a, b| a.0.tracker == b.0.tracker);
    trackers.filter_map(of_tracker).collect()
}

/// Speed of each tracker and unit.
const TIMING: &str = "timing.csv";

/// Writes `timing.csv`: the file that differs between machines. Before the rows of a tracker's units stands one of all
/// together, where medians and percentiles are left out.
fn write_timing(dir: &RunDir, plan: &Plan, times: &[(Unit, UnitTime)]) -> Result<(), StoreError> {
    let path = dir.path().join(TIMING);
    let cpu = cpu_name();
    let mut out = csv::Writer::from_writer(Vec::new());
    let mut write = |fields: &[&str]| {
        out.write_record(fields.iter().map(|c| text::cell(c).into_owned()))
            .map_err(|e| StoreError::io(&path, e.into()))
    };
    let header = "tracker,dataset,sequence,start,frames,seconds,fps,ms_median,ms_p95,fps_with_input,init_seconds,threads,comparable,cpu,course";
    write(&header.split(',').collect::<Vec<_>>())?;
    let per_second = |time: &UnitTime, seconds: f64| {
        rate(time.updates, seconds).map_or(String::new(), |rate| format!("{rate:.2}"))
    };
    let mut row = |what: [&str; 4], time: &UnitTime, ms: [String; 2], course: &str| {
        let [tracker, dataset, sequence, start] = what;
        let [ms_median, ms_p95] = ms;
        write(&[
            tracker,
            dataset,
            sequence,
            start,
            &time.updates.to_string(),
            &format!("{:.6}", time.seconds),
            &per_second(time, time.seconds),
            &ms_median,
            &ms_p95,
            &per_second(time, time.seconds + time.input_seconds),
            &format!("{:.6}", time.init_seconds),
            &time.threads.to_string(),
            if time.threads == 1 { "yes" } else { "no" },
            &cpu,
            course,
        ])
    };
    for times in times.chunk_by(|a, b| a.0.tracker == b.0.tracker) {
        let tracker = &plan.trackers[times[0].0.tracker as usize].id;
        let sum = total(times.iter().map(|(_, time)| time));
        row([tracker, ALL_DATASETS, POOLED, "0"], &sum, Default::default(), "")?;
        for (unit, time) in times {
            let sequence = &plan.sequences[unit.sequence as usize];
            row(
                [
                    tracker,
                    &sequence.dataset,
                    &sequence.sequence,
                    &unit.start.to_string(),
                ],
                time,
                [time.ms_median, time.ms_p95].map(|ms| format!("{ms:.4}")),
                &plan.course_name(unit).unwrap_or_default(),
            )?;
        }
    }
    let bytes = out
        .into_inner()
        .map_err(|e| StoreError::io(&path, e.into_error()))?;
    dir.put(&path, &bytes, Durable::Now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speed_is_of_all_updates_of_a_tracker() {
        let tracker = |id: &str| serde_json::json!({"id": id, "sm": "", "am": "", "ssm": "", "ilm": "", "slug": id, "parameters": null});
        let plan = serde_json::json!({
            "schema_version": 1, "tool": "t", "version": "1", "protocol": "ope", "seed": 0,
            "pre": "none", "frame_logs": "csv",
            "trackers": [tracker("a"), tracker("b"), tracker("c")],
            "sequences": [],
        });
        let plan: Plan = serde_json::from_value(plan).unwrap();
        let time = |tracker: u32, updates: usize, seconds: f64| {
            let time = UnitTime {
                updates,
                seconds,
                ..UnitTime::default()
            };
            let unit = Unit {
                tracker,
                course: 0,
                sequence: 0,
                start: 0,
            };
            (unit, time)
        };
        let times = [
            time(0, 30, 1.5),
            time(0, 50, 0.5),
            time(1, 10, 4.0),
            time(2, 0, 0.0),
        ];
        let expected = [("a".to_owned(), 40.0), ("b".to_owned(), 2.5)];
        assert_eq!(speeds(&plan, &times), expected.into_iter().collect());
    }
}
