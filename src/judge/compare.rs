//! Two run directories side by side: first what is equal to the last digit, by tracker, data set, sequence, start and
//! protocol; then, for the trackers that changed, whether the change is more than chance (see [`crate::judge::stats`]).

mod ranking;

pub use ranking::{PairTest, Ranked, Ranking, rank_all};

use crate::files::{self, Kind};
use crate::judge::change::{Change, Matched, equal};
use crate::judge::pairing::{OtherSettings, pairs};
use crate::judge::stats::{Pair, Side, benjamini_hochberg, difference};
use crate::metric::aggregate::{Average, Results, SequenceRow};
use crate::metric::{Figure, MetricSet, Score};
use crate::plan::DataNotes;
use crate::store::held::{Finished, finished};
use crate::store::summary::{Summary, Thresholds};
use crate::store::{FileError, StoreError};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Sequences below which intervals say little.
pub const FEW_SEQUENCES: usize = 10;

/// Names of the figures that can be compared: means over frames, which is what pooling over sequences needs.
pub fn comparable(metrics: &MetricSet) -> Vec<&str> {
    let figures = metrics.figures().iter().filter(|f| f.frame_mean.is_some());
    figures.map(|f| f.name.as_str()).collect()
}

/// Checks the name of a figure to be compared.
///
/// # Errors
/// A message with what there is.
pub fn parse_figure(metrics: &MetricSet, name: &str) -> Result<String, String> {
    let name = name.to_ascii_lowercase();
    let why = match metrics.figure(&name) {
        Some(figure) if figure.frame_mean.is_some() => return Ok(name),
        Some(_) => format!("{name} is no mean over frames, so sequences cannot be pooled"),
        None => format!("no figure '{name}'"),
    };
    Err(format!("{why}; one of {}", comparable(metrics).join(", ")))
}

/// A finished run, read back.
#[derive(Clone, Debug)]
pub struct FinishedRun {
    /// Its directory, as given.
    pub name: String,
    results: Results,
    thresholds: Thresholds,
    description: Value,
    /// Data that was not read as it stands.
    pub data: DataNotes,
}

impl FinishedRun {
    /// Reads a run directory for a program with `metrics`.
    ///
    /// # Errors
    /// `summary.json` or `run.json` is missing or damaged, or the run has not got to its end.
    pub fn read(dir: &Path, metrics: &MetricSet) -> Result<FinishedRun, StoreError> {
        let Finished { summary, data, .. } = finished(dir, metrics)?;
        let Summary {
            results, thresholds, ..
        } = summary;
        let path = dir.join("run.json");
        let text = files::read(&path, Kind::RESULTS).map_err(|e| FileError::io(&path, e))?;
        let description = serde_json::from_slice(&text).map_err(|e| FileError::format(&path, e))?;
        Ok(FinishedRun {
            name: dir.display().to_string(),
            results,
            thresholds,
            description,
            data,
        })
    }

    /// Whether the run measured the metric of `figure`.
    fn has(&self, figure: &Figure) -> bool {
        let metric = &self.results.metrics.metrics()[figure.metric()];
        self.thresholds.contains_key(metric.name)
    }

    /// Fingerprint of the data of each sequence, by `dataset/sequence`.
    fn fingerprints(&self) -> BTreeMap<String, &str> {
        let list = self.description["sequences"].as_array();
        let entry = |s: &'_ Value| Some(format!("{}/{}", s["dataset"].as_str()?, s["sequence"].as_str()?));
        list.into_iter()
            .flatten()
            .filter_map(|s| Some((entry(s)?, s["fingerprint"].as_str()?)))
            .collect()
    }

    /// Parameters of each tracker, by id.
    fn parameters(&self) -> BTreeMap<&str, &Value> {
        let list = self.description["trackers"].as_array();
        list.into_iter()
            .flatten()
            .filter_map(|t| Some((t["id"].as_str()?, &t["parameters"])))
            .collect()
    }

    /// The figures of a tracker in the table of the run.
    fn table(&self, tracker: &str, protocol: &str, average: Average) -> Option<&Score> {
        let mut rows = self.results.summary.iter();
        let row = rows.find(|r| r.tracker.id == tracker && r.protocol == protocol && r.average == average)?;
        Some(&row.score)
    }

    /// Ids of its trackers.
    fn ids(&self) -> BTreeSet<String> {
        let rows = self.results.sequences.iter();
        rows.map(|row| row.tracker.id.clone()).collect()
    }

    /// Rows of each tracker under each protocol.
    fn trackers(&self) -> BTreeMap<(&str, &str), Vec<&SequenceRow>> {
        let mut trackers: BTreeMap<(&str, &str), Vec<&SequenceRow>> = BTreeMap::new();
        for row in &self.results.sequences {
            let key = (row.tracker.id.as_str(), row.protocol.as_str());
            trackers.entry(key).or_default().push(row);
        }
        trackers
    }
}

/// Why two runs are not compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// They measure different things.
    #[error("not comparable: {}", .0.join("; "))]
    NotComparable(Vec<String>),
    /// The tracker to compare with was not run.
    #[error("no tracker '{tracker}' in {runs}{}", mtf::registry::hint(.suggestion.as_deref()))]
    NoReference {
        /// The runs of which one should have it.
        runs: String,
        /// The tracker.
        tracker: String,
        /// A tracker of the runs with a similar id.
        suggestion: Option<String>,
    },
}

/// What to look at, and how strictly.
#[derive(Clone, Debug)]
pub struct Options {
    /// Names of figures, of those that are [`comparable`].
    pub figures: Vec<String>,
    /// Over frames or over sequences.
    pub average: Average,
    /// Share of false ones among the changes called significant.
    pub fdr: f64,
    /// Bootstrap samples of an interval.
    pub resamples: usize,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Compare every tracker with this one of the first run, rather than with itself.
    pub reference: Option<String>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            figures: ["auc", "sr_5", "al_mean"].map(str::to_owned).to_vec(),
            average: Average::Pooled,
            fdr: 0.05,
            resamples: 10_000,
            seed: 0,
            reference: None,
        }
    }
}

/// What is said of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The second is better, beyond chance.
    Better,
    /// The second is worse, beyond chance.
    Worse,
    /// The interval spans 0, or a change this large is to be expected among so many trackers.
    #[serde(rename = "~")]
    Unclear,
}

impl Verdict {
    /// `better`, `worse` or `~`.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Better => "better",
            Verdict::Worse => "worse",
            Verdict::Unclear => "~",
        }
    }
}

/// Why a change is [`Verdict::Unclear`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Doubt {
    /// There is no interval: fewer than two sequences.
    #[serde(rename = "no interval")]
    NoInterval,
    /// The interval spans 0.
    #[serde(rename = "interval spans 0")]
    SpansZero,
    /// The interval, which is of one change alone, leaves out 0; but over so few sequences or among so many changes q
    /// exceeds the false discovery rate.
    #[serde(rename = "q exceeds the rate")]
    Many,
}

impl Doubt {
    /// One word for tables; none where the interval speaks for itself.
    pub fn word(self) -> Option<&'static str> {
        match self {
            Doubt::NoInterval | Doubt::SpansZero => None,
            Doubt::Many => Some("q"),
        }
    }
}

/// One figure of a tracker that changed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FigureChange {
    /// Which.
    pub figure: String,
    /// Its value in the first run: that of the run's table where both have the same units, else over those that both have.
    pub a: f64,
    /// Its value in the second.
    pub b: f64,
    /// Ends of the 95 % interval of `b - a`; NaN with fewer than two sequences.
    pub interval: [f64; 2],
    /// Probability of a difference at least as large by chance.
    pub p: f64,
    /// `p` adjusted for the number of changed trackers and of figures.
    pub q: f64,
    /// What to make of it.
    pub verdict: Verdict,
    /// Why nothing can be made of it.
    pub doubt: Option<Doubt>,
}

/// A tracker whose results differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrackerChange {
    /// Its id in the second run.
    pub tracker: String,
    /// What it is compared with: its id in the first run, which may have other settings, or the reference.
    pub tracker_a: String,
    /// The protocol.
    pub protocol: String,
    /// Units that both runs have.
    pub units: usize,
    /// Of those, units with other figures.
    pub units_changed: usize,
    /// Sequences of those units, which are what is drawn from.
    pub sequences: usize,
    /// Of those, sequences with other figures.
    pub sequences_changed: usize,
    /// Units that failed to run in the first and in the second run.
    pub failed: [usize; 2],
    /// The figures asked for.
    pub figures: Vec<FigureChange>,
}

/// Two runs, or a run and a tracker of another.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Comparison {
    /// The first run.
    pub a: String,
    /// The second run.
    pub b: String,
    /// The tracker that all are compared with, if one was named.
    pub reference: Option<String>,
    /// Trackers compared.
    pub trackers: usize,
    /// The same, a tracker under each protocol counting as one.
    pub cases: usize,
    /// Units compared.
    pub units: usize,
    /// Of those, units equal in every figure.
    pub identical: usize,
    /// Trackers that differ under at least one protocol.
    pub trackers_changed: usize,
    /// What differs, each protocol apart: significant changes first, then by the size of the first figure's change.
    pub changed: Vec<TrackerChange>,
    /// Trackers of the first run alone.
    pub only_a: Vec<String>,
    /// Trackers of the second run alone.
    pub only_b: Vec<String>,
    /// Units of compared trackers that only the first run has.
    pub units_only_a: usize,
    /// Units of compared trackers that only the second run has.
    pub units_only_b: usize,
    /// Settings that differ: what may explain the changes.
    pub settings: Vec<String>,
    /// What to keep in mind.
    pub warnings: Vec<String>,
}

/// Figures that both runs have, by number.
type Shared = Vec<usize>;

/// Equal in every figure that both runs have.
fn same(a: &SequenceRow, b: &SequenceRow, shared: &Shared) -> bool {
    let (x, y) = (a.score.values(), b.score.values());
    a.status == b.status && shared.iter().all(|&i| equal(x[i], y[i]))
}

/// Compares every run but the first with the first. With `references`: the trackers of every run with each of them, which
/// is taken from the first run that has it; a run that holds it alone is not compared with itself if there are others.
///
/// # Errors
/// [`CompareError`]: other protocol, data, thresholds; nothing in common.
pub fn compare_all(
    runs: &[FinishedRun],
    references: &[String],
    options: &Options,
) -> Result<Vec<Comparison>, CompareError> {
    let Some((first, others)) = runs.split_first() else {
        return Ok(Vec::new());
    };
    if references.is_empty() {
        return others.iter().map(|run| compare(first, run, options)).collect();
    }
    let mut found = Vec::new();
    for reference in references {
        let options = Options {
            reference: Some(reference.clone()),
            ..options.clone()
        };
        let has = |run: &&FinishedRun| run.ids().contains(reference);
        let Some(home) = runs.iter().find(has) else {
            let names: Vec<&str> = runs.iter().map(|run| run.name.as_str()).collect();
            let ids: BTreeSet<String> = runs.iter().flat_map(FinishedRun::ids).collect();
            return Err(CompareError::NoReference {
                runs: names.join(", "),
                tracker: reference.clone(),
                suggestion: mtf::registry::suggest(reference, ids.iter().map(String::as_str)),
            });
        };
        for run in runs {
            let alone = run.name == home.name && home.ids().len() == 1;
            if !alone || runs.len() == 1 {
                found.push(compare(home, run, &options)?);
            }
        }
    }
    Ok(found)
}

/// Compares `b` with `a`.
///
/// # Errors
/// [`CompareError`]: other protocol, data, thresholds; nothing in common.
pub fn compare(a: &FinishedRun, b: &FinishedRun, options: &Options) -> Result<Comparison, CompareError> {
    let (of_a, of_b) = (a.trackers(), b.trackers());
    let (ids_a, ids_b) = (a.ids(), b.ids());
    if let Some(id) = options.reference.as_ref().filter(|id| !ids_a.contains(*id)) {
        return Err(CompareError::NoReference {
            runs: a.name.clone(),
            tracker: id.clone(),
            suggestion: mtf::registry::suggest(id, ids_a.iter().map(String::as_str)),
        });
    }
    fn lacking<'a>(
        these: &'a BTreeSet<String>,
        those: &'a BTreeSet<String>,
    ) -> impl Iterator<Item = &'a str> {
        these.difference(those).map(String::as_str)
    }
    let other_settings = match options.reference {
        Some(_) => Vec::new(),
        None => pairs(lacking(&ids_a, &ids_b), lacking(&ids_b, &ids_a)),
    };
    let before: BTreeMap<&str, &str> = other_settings
        .iter()
        .map(|p| (p.after.as_str(), p.before.as_str()))
        .collect();
    let after: BTreeMap<&str, &str> = before.iter().map(|(after, before)| (*before, *after)).collect();
    // What a tracker is compared with: itself, itself with other settings, or the reference.
    fn partner<'a>(options: &'a Options, before: &BTreeMap<&str, &'a str>, id: &'a str) -> &'a str {
        let reference = options.reference.as_deref();
        reference.unwrap_or_else(|| before.get(id).copied().unwrap_or(id))
    }
    // The reference itself is left out where it would meet itself.
    let itself = |id: &str| options.reference.as_deref() == Some(id) && a.name == b.name;
    type Case<'a> = (
        (&'a str, &'a str),
        &'a Vec<&'a SequenceRow>,
        &'a Vec<&'a SequenceRow>,
    );
    let partners: Vec<Case<'_>> = of_b
        .iter()
        .filter(|((id, _), _)| !itself(id))
        .filter_map(|(case, rows)| {
            Some((
                *case,
                of_a.get(&(partner(options, &before, case.0), case.1))?,
                rows,
            ))
        })
        .collect();
    let compared = |id: &String| !itself(id) && ids_a.contains(partner(options, &before, id));
    let figures = a.results.metrics.figures();
    let both_have = |f: &Figure| a.has(f) && b.has(f);
    let mut obstacles = obstacles(a, b);
    if !ids_b.iter().any(compared) {
        obstacles.push(match &options.reference {
            Some(id) => format!(
                "{} has no tracker but {id}, so there is none to compare with it",
                b.name
            ),
            None => "no tracker in common (--reference TRACKER compares with one tracker)".to_owned(),
        });
    }
    for name in &options.figures {
        if !figures.iter().any(|f| f.name == *name && both_have(f)) {
            obstacles.push(format!("not both runs have the figure {name}"));
        }
    }
    if !obstacles.is_empty() {
        return Err(CompareError::NotComparable(obstacles));
    }
    let shared: Shared = (0..figures.len()).filter(|&i| both_have(&figures[i])).collect();
    let mut result = Comparison {
        a: a.name.clone(),
        b: b.name.clone(),
        reference: options.reference.clone(),
        trackers: partners
            .iter()
            .map(|((id, _), ..)| id)
            .collect::<BTreeSet<_>>()
            .len(),
        cases: partners.len(),
        settings: settings(a, b, &other_settings, options.reference.is_some()),
        ..Comparison::default()
    };
    let compared: Vec<(Matched<SequenceRow>, Option<TrackerChange>)> = partners
        .par_iter()
        .map(|((id, protocol), rows_a, rows_b)| {
            let matched = matched(rows_a, rows_b);
            let whole = matched.only_before.is_empty() && matched.only_after.is_empty();
            let partner = partner(options, &before, id);
            let tables = || {
                let first = a.table(partner, protocol, options.average)?;
                Some([first, b.table(id, protocol, options.average)?])
            };
            let tables = if whole { tables() } else { None };
            let change = change([partner, id], &matched.both, tables, figures, &shared, options);
            (matched, change)
        })
        .collect();
    for (matched, change) in compared {
        result.units += matched.both.len();
        let same = |(a, b): &&(&SequenceRow, &SequenceRow)| same(a, b, &shared);
        result.identical += matched.both.iter().filter(same).count();
        result.units_only_a += matched.only_before.len();
        result.units_only_b += matched.only_after.len();
        result.changed.extend(change);
    }
    if result.units == 0 {
        let nothing = "no sequence that both runs tracked with the same trackers".to_owned();
        return Err(CompareError::NotComparable(vec![nothing]));
    }
    if options.reference.is_none() {
        type Others<'a> = BTreeMap<&'a str, &'a str>;
        let only = |these: &BTreeSet<String>, those: &BTreeSet<String>, paired: &Others<'_>| -> Vec<String> {
            let alone = lacking(these, those).filter(|id| !paired.contains_key(id));
            alone.map(str::to_owned).collect()
        };
        (result.only_a, result.only_b) = (only(&ids_a, &ids_b, &after), only(&ids_b, &ids_a, &before));
        // Trackers that both have, under protocols that one has.
        type Rows<'a> = BTreeMap<(&'a str, &'a str), Vec<&'a SequenceRow>>;
        let alone =
            |these: &Rows<'_>, those: &Rows<'_>, ids: &BTreeSet<String>, paired: &Others<'_>| -> usize {
                let lacking = these.iter().filter(|((id, protocol), _)| {
                    let id = paired.get(id).copied().unwrap_or(id);
                    ids.contains(id) && !those.contains_key(&(id, *protocol))
                });
                lacking.map(|(_, rows)| rows.len()).sum()
            };
        result.units_only_a += alone(&of_a, &of_b, &ids_b, &after);
        result.units_only_b += alone(&of_b, &of_a, &ids_a, &before);
    }
    let changed: BTreeSet<&String> = result.changed.iter().map(|c| &c.tracker).collect();
    result.trackers_changed = changed.len();
    judge(&mut result.changed, options.fdr);
    result.warnings = warnings(&result, options);
    result.warnings.extend(not_compared(a, b));
    Ok(result)
}

/// Units of a tracker that both runs have: by data set, sequence, start and protocol.
fn matched<'a>(a: &[&'a SequenceRow], b: &[&'a SequenceRow]) -> Matched<'a, SequenceRow> {
    fn key(row: &SequenceRow) -> (&str, &str, usize, &str) {
        (&row.dataset, &row.sequence, row.start, &row.protocol)
    }
    let mut a = a.to_vec();
    a.sort_by_key(|row| key(row));
    Matched::new(a, b.iter().copied(), key)
}

/// The change of a tracker over units that are sorted by data set and sequence, which are what `tables` are of, if they are
/// given; q values and verdicts are still to come. `None` when nothing changed.
fn change(
    [id_a, id]: [&str; 2],
    units: &[(&SequenceRow, &SequenceRow)],
    tables: Option<[&Score; 2]>,
    figures: &[Figure],
    shared: &Shared,
    options: &Options,
) -> Option<TrackerChange> {
    let same = |(a, b): &(&SequenceRow, &SequenceRow)| same(a, b, shared);
    let units_changed = units.iter().filter(|pair| !same(pair)).count();
    if units_changed == 0 {
        return None;
    }
    // The start frames of a sequence are neighbours.
    let sequence = |row: &SequenceRow| (row.dataset.clone(), row.sequence.clone());
    let sequences: Vec<_> = units.chunk_by(|a, b| sequence(a.0) == sequence(b.0)).collect();
    let changes = options.figures.iter().filter_map(|name| {
        let figure = figures.iter().find(|f| f.name == *name)?;
        let pair = |units: &&[(&SequenceRow, &SequenceRow)]| Pair {
            a: side(units.iter().map(|(a, _)| &a.score), figure, options.average),
            b: side(units.iter().map(|(_, b)| &b.score), figure, options.average),
        };
        let pairs: Vec<Pair> = sequences
            .iter()
            .map(pair)
            .filter(|p| *p != Pair::default())
            .collect();
        let found = difference(&pairs, options.resamples, options.seed)?;
        // Figures of rows are rounded; those of the table were made before that.
        let [a, b] = tables.map_or([found.a, found.b], |tables| {
            tables.map(|score| score[name.as_str()])
        });
        let change = Change::new(figure, a, b);
        let verdict = match (found.excludes_zero(), change.gain() > 0.0) {
            (false, _) => Verdict::Unclear,
            (true, true) => Verdict::Better,
            (true, false) => Verdict::Worse,
        };
        Some(FigureChange {
            figure: change.figure,
            a: change.before,
            b: change.after,
            interval: found.interval,
            p: found.p,
            q: found.p,
            verdict,
            doubt: match found.interval[0].is_nan() {
                _ if found.excludes_zero() => None,
                true => Some(Doubt::NoInterval),
                false => Some(Doubt::SpansZero),
            },
        })
    });
    let changed = |units: &&&[(&SequenceRow, &SequenceRow)]| !units.iter().all(same);
    Some(TrackerChange {
        tracker: id.to_owned(),
        tracker_a: id_a.to_owned(),
        protocol: units.first().map_or(String::new(), |(a, _)| a.protocol.clone()),
        units: units.len(),
        units_changed,
        sequences: sequences.len(),
        sequences_changed: sequences.iter().filter(changed).count(),
        failed: [
            units.iter().filter(|(a, _)| a.status.is_failed()).count(),
            units.iter().filter(|(_, b)| b.status.is_failed()).count(),
        ],
        figures: changes.collect(),
    })
}

/// A figure of a sequence over all its start frames.
fn side<'a>(scores: impl Iterator<Item = &'a Score>, figure: &Figure, average: Average) -> Side {
    let mut side = Side::default();
    for score in scores {
        let (weight, value) = (figure.weight(score), score[figure.name.as_str()]);
        if weight > 0.0 && value.is_finite() {
            side += Side::new(weight, value);
        }
    }
    match average {
        Average::SeqMean if side.weight > 0.0 => Side::new(1.0, side.mean()),
        _ => side,
    }
}

/// Adjusts the p values over all trackers and figures together, settles the verdicts, and sorts.
fn judge(changed: &mut [TrackerChange], fdr: f64) {
    let mut figures: Vec<&mut FigureChange> = changed.iter_mut().flat_map(|c| &mut c.figures).collect();
    let q = benjamini_hochberg(&figures.iter().map(|f| f.p).collect::<Vec<_>>());
    for (figure, q) in figures.iter_mut().zip(q) {
        figure.q = q;
        if q > fdr {
            figure.verdict = Verdict::Unclear;
            figure.doubt.get_or_insert(Doubt::Many);
        }
    }
    let unclear = |c: &TrackerChange| c.figures.iter().all(|f| f.verdict == Verdict::Unclear);
    let size = |c: &TrackerChange| c.figures.first().map_or(0.0, |f| (f.b - f.a).abs());
    changed.sort_by(|x, y| unclear(x).cmp(&unclear(y)).then(size(y).total_cmp(&size(x))));
}

/// What makes figures of the two runs mean different things.
fn obstacles(a: &FinishedRun, b: &FinishedRun) -> Vec<String> {
    const SHOWN: usize = 3;
    let mut found = Vec::new();
    let protocols = |run: &FinishedRun| -> BTreeSet<String> {
        let rows = run.results.sequences.iter();
        rows.map(|r| r.protocol.clone()).collect()
    };
    let (of_a, of_b) = (protocols(a), protocols(b));
    if of_a.is_disjoint(&of_b) && !of_a.is_empty() && !of_b.is_empty() {
        let list = |p: &BTreeSet<String>| p.iter().cloned().collect::<Vec<_>>().join(", ");
        found.push(format!(
            "protocol {} in {}, {} in {}",
            list(&of_a),
            a.name,
            list(&of_b),
            b.name
        ));
    }
    let differ = |(metric, x): (&String, &Value)| b.thresholds.get(metric).is_some_and(|y| x != y);
    if a.thresholds.iter().any(differ) {
        found.push(format!(
            "{} and {} have success rates at other thresholds",
            a.name, b.name
        ));
    }
    let (data_a, data_b) = (a.fingerprints(), b.fingerprints());
    let common: Vec<_> = data_a
        .iter()
        .filter_map(|(sequence, x)| Some((sequence, x, data_b.get(sequence)?)))
        .collect();
    if common.is_empty() {
        found.push("no sequence in common".to_owned());
    }
    let other: Vec<&String> = common
        .iter()
        .filter(|(_, x, y)| x != y)
        .map(|(s, ..)| *s)
        .collect();
    if !other.is_empty() {
        let shown: Vec<&str> = other.iter().take(SHOWN).map(|s| s.as_str()).collect();
        let more = match other.len() - shown.len() {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        found.push(format!(
            "other data or ground truth (fingerprint) in {}{more}",
            shown.join(", ")
        ));
    }
    found
}

/// Settings that differ between the runs; trackers whose parameters differ alike share a line.
fn settings(a: &FinishedRun, b: &FinishedRun, paired: &[OtherSettings], other_trackers: bool) -> Vec<String> {
    const SHOWN: usize = 5;
    const NAMED: usize = 2;
    let plain = |v: &Value| v.as_str().map_or_else(|| v.to_string(), str::to_owned);
    let mut found = Vec::new();
    let mut note = |name: &str, x: &Value, y: &Value| {
        if x != y {
            found.push(format!("{name}: {} -> {}", plain(x), plain(y)));
        }
    };
    for name in ["version", "seed", "pre"] {
        note(name, &a.description[name], &b.description[name]);
    }
    let revision = |run: &FinishedRun| run.description["host"]["revision"].clone();
    note("revision", &revision(a), &revision(b));
    if other_trackers {
        return found;
    }
    let (of_a, of_b) = (a.parameters(), b.parameters());
    let mut changed: Vec<(String, Vec<&str>)> = Vec::new();
    let mut change = |id, what: String| match changed.iter_mut().find(|(known, _)| *known == what) {
        Some((_, ids)) => ids.push(id),
        None => changed.push((what, vec![id])),
    };
    for (id, x) in &of_a {
        if let Some(y) = of_b.get(id).filter(|y| *y != x) {
            let mut differing = Vec::new();
            leaves("", x, y, &mut differing);
            change(id, differing.join(", "));
        }
    }
    for pair in paired {
        change(&pair.before, pair.difference.clone());
    }
    let more: usize = changed.iter().skip(SHOWN).map(|(_, ids)| ids.len()).sum();
    found.extend(changed.into_iter().take(SHOWN).map(|(what, ids)| {
        let others = match ids.len().saturating_sub(NAMED) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        let named: Vec<&str> = ids.into_iter().take(NAMED).collect();
        format!("parameters of {}{others}: {what}", named.join(", "))
    }));
    if more > 0 {
        found.push(format!("parameters of {more} more trackers"));
    }
    found
}

/// `path: x -> y` for each value that differs between two trees.
fn leaves(path: &str, x: &Value, y: &Value, found: &mut Vec<String>) {
    if x == y {
        return;
    }
    let below = |name: &str| {
        if path.is_empty() {
            name.to_owned()
        } else {
            format!("{path}.{name}")
        }
    };
    match (x, y) {
        (Value::Object(of_x), Value::Object(of_y)) => {
            let names: BTreeSet<&String> = of_x.keys().chain(of_y.keys()).collect();
            for name in names {
                leaves(&below(name), &x[name.as_str()], &y[name.as_str()], found);
            }
        }
        (Value::Array(of_x), Value::Array(of_y)) if of_x.len() == of_y.len() => {
            for (i, (x, y)) in of_x.iter().zip(of_y).enumerate() {
                leaves(&below(&i.to_string()), x, y, found);
            }
        }
        _ => found.push(format!("{path} {x} -> {y}")),
    }
}

/// Metrics that are not compared, and why.
fn not_compared(a: &FinishedRun, b: &FinishedRun) -> Vec<String> {
    let names = |of: &Thresholds| -> BTreeSet<String> { of.keys().cloned().collect() };
    let (of_a, of_b) = (names(&a.thresholds), names(&b.thresholds));
    let unknown = |name: &&String| a.results.metrics.metric(name).is_none();
    let mut found = Vec::new();
    let mut note = |metrics: Vec<&String>, why: &str| {
        if !metrics.is_empty() {
            let list: Vec<&str> = metrics.into_iter().map(String::as_str).collect();
            found.push(format!("not compared: {}, {why}", list.join(", ")));
        }
    };
    note(of_a.difference(&of_b).collect(), &format!("in {} alone", a.name));
    note(of_b.difference(&of_a).collect(), &format!("in {} alone", b.name));
    note(
        of_a.intersection(&of_b).filter(unknown).collect(),
        "which this program does not know",
    );
    found
}

fn warnings(found: &Comparison, options: &Options) -> Vec<String> {
    let mut warnings = Vec::new();
    let fewest = found.changed.iter().map(|c| c.sequences).min();
    if let Some(n) = fewest.filter(|n| *n < FEW_SEQUENCES) {
        let least = 2.0 / libm::exp2(n as f64);
        let never = if least > options.fdr {
            format!("; with {n} no p value is below {least}, so nothing can be significant")
        } else {
            String::new()
        };
        warnings.push(format!(
            "only {n} sequence{}: intervals over fewer than {FEW_SEQUENCES} say little{never}",
            if n == 1 { "" } else { "s" }
        ));
    }
    let lacking = [(found.units_only_a, &found.a), (found.units_only_b, &found.b)];
    for (units, run) in lacking.into_iter().filter(|(units, _)| *units > 0) {
        warnings.push(format!(
            "{units} units (one tracker on one sequence each) of compared trackers are in {run} alone and do not count"
        ));
    }
    let failed: usize = found.changed.iter().map(|c| c.failed[0] + c.failed[1]).sum();
    if failed > 0 {
        warnings.push(format!(
            "{failed} units (one tracker on one sequence each) failed in one of the two and count as lost in all frames"
        ));
    }
    warnings
}

#[cfg(test)]
mod tests;
