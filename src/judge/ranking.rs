//! Which trackers of one or several runs are best: the order by a figure, the best of each kind, the Pareto set of accuracy
//! and speed, and figures by tag, sequence or part of the tracker.

use crate::judge::compare::side;
use crate::judge::stats::{Pair, Side, benjamini_hochberg, difference, interval_of};
use crate::metric::aggregate::{Average, CurveRow, Results, SequenceRow, SummaryRow, TrackerName};
use crate::metric::figure::Kind;
use crate::metric::{Direction, Figure, MetricSet, quantile};
use mtf::registry::{hint, suggest};
use std::collections::{BTreeMap, BTreeSet};

/// Frames per second of update time of each tracker, by id, over all its units.
pub type Speeds = BTreeMap<String, f64>;

/// The sort key of frames per second.
pub const FPS: &str = "fps";
/// The sort key of the tracker's id.
const TRACKER: &str = "tracker";
/// The figure of accuracy where trackers are sorted by something else.
const ACCURACY: &str = "auc";
/// Bootstrap samples of an interval: its ends vary by a few percent of its length.
const RESAMPLES: usize = 2000;
/// Share of false ones among the trackers that are told apart from the first.
const FALSE_DISCOVERIES: f64 = 0.05;
/// What stands for a part that a tracker does not have.
const NO_PART: &str = "-";
/// What stands for sequences without a tag.
const NO_TAG: &str = "(no tag)";

/// What trackers can be sorted by: id, speed or any figure.
pub fn sort_keys(metrics: &MetricSet) -> impl Iterator<Item = &str> {
    let figures = metrics.figures().iter().map(|f| f.name.as_str());
    [TRACKER, FPS].into_iter().chain(figures)
}

/// Checks a sort key.
///
/// # Errors
/// A message with the nearest valid key.
pub fn parse_sort(metrics: &MetricSet, key: &str) -> Result<String, String> {
    let key = key.to_ascii_lowercase();
    if sort_keys(metrics).any(|k| k == key) {
        return Ok(key);
    }
    let hint = hint(suggest(&key, sort_keys(metrics)).as_deref());
    Err(format!(
        "no column '{key}'{hint} (one of {})",
        sort_keys(metrics).collect::<Vec<_>>().join(", ")
    ))
}

/// The figure that is compared when trackers are sorted by `key`: accuracy, unless it is a figure itself.
pub fn figure<'m>(metrics: &'m MetricSet, key: &str) -> Option<&'m Figure> {
    metrics.figure(key).or_else(|| metrics.figure(ACCURACY))
}

/// A part of a tracker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// Search method
    Sm,
    /// Appearance model
    Am,
    /// State space model
    Ssm,
    /// Illumination model
    Ilm,
}

impl Part {
    fn of(self, tracker: &TrackerName) -> &str {
        let name = match self {
            Part::Sm => &tracker.sm,
            Part::Am => &tracker.am,
            Part::Ssm => &tracker.ssm,
            Part::Ilm => &tracker.ilm,
        };
        if name.is_empty() { NO_PART } else { name }
    }
}

/// What figures can be grouped by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Group {
    /// Tags of sequences
    Tag,
    /// Sequences
    Sequence,
    /// Search methods
    Sm,
    /// Appearance models
    Am,
    /// State space models
    Ssm,
    /// Illumination models
    Ilm,
}

impl Group {
    /// Its name.
    pub fn word(self) -> &'static str {
        match self {
            Group::Tag => "tag",
            Group::Sequence => "sequence",
            Group::Sm => "sm",
            Group::Am => "am",
            Group::Ssm => "ssm",
            Group::Ilm => "ilm",
        }
    }

    /// The part of trackers; `None` when sequences are grouped.
    pub fn part(self) -> Option<Part> {
        match self {
            Group::Tag | Group::Sequence => None,
            Group::Sm => Some(Part::Sm),
            Group::Am => Some(Part::Am),
            Group::Ssm => Some(Part::Ssm),
            Group::Ilm => Some(Part::Ilm),
        }
    }

    /// Whether `figure` can be had by this group.
    ///
    /// # Errors
    /// It is neither a count nor a mean over frames, so that those of sequences cannot be joined.
    pub fn takes(self, figure: &Figure) -> Result<(), String> {
        let joins = figure.kind == Kind::Count || figure.frame_mean.is_some();
        match joins || self != Group::Tag {
            true => Ok(()),
            false => Err(format!(
                "{} of several sequences cannot be joined by tag, as it is neither a count nor a mean over frames; take \
                 another column, such as auc, sr_5 or al_mean",
                figure.name
            )),
        }
    }
}

/// Which trackers are looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pick {
    /// Only the best of each kind, by this part.
    pub best_per: Option<Part>,
    /// Only those that no other tracker beats in both accuracy and speed.
    pub pareto: bool,
    /// Only those whose updates take less than this on average, s.
    pub under: Option<f64>,
    /// Figures by group besides.
    pub by: Option<Group>,
}

impl Pick {
    /// Whether speed has a say.
    pub fn is_by_speed(&self) -> bool {
        self.pareto || self.under.is_some()
    }
}

/// A run whose trackers are ranked.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its figures.
    pub results: &'a Results,
    /// The speed of its trackers.
    pub speeds: &'a Speeds,
}

/// A tracker under a protocol in a run.
#[derive(Clone, Debug)]
pub struct Entrant<'a> {
    /// The run's name.
    pub run: &'a str,
    /// The tracker's figures over all frames.
    pub row: &'a SummaryRow,
    /// Its units, those of a sequence beside each other.
    pub units: Vec<&'a SequenceRow>,
    /// Updates per second; NaN when unknown.
    pub fps: f64,
    results: &'a Results,
}

/// Units that are figures of one sequence: its start frames.
fn by_sequence<'a, 'u>(units: &'u [&'a SequenceRow]) -> impl Iterator<Item = &'u [&'a SequenceRow]> {
    units.chunk_by(|a, b| (&a.dataset, &a.sequence) == (&b.dataset, &b.sequence))
}

/// The figure over several units. NaN where they cannot be joined, or have none.
fn joined(units: &[&SequenceRow], figure: &Figure) -> f64 {
    let name = figure.name.as_str();
    match (units, figure.kind) {
        ([], _) => f64::NAN,
        ([one], _) => one.score[name],
        (_, Kind::Count) => units.iter().map(|unit| unit.score[name]).sum(),
        (_, Kind::Number) => side(units.iter().map(|u| &u.score), figure, Average::Pooled).mean(),
    }
}

/// The 95 % interval of a figure that is a mean over frames, over the sequences of `units`; NaN of others, and with fewer
/// than two sequences.
fn interval(units: &[&SequenceRow], figure: &Figure) -> [f64; 2] {
    if figure.frame_mean.is_none() {
        return [f64::NAN; 2];
    }
    let side = |units: &[&SequenceRow]| side(units.iter().map(|u| &u.score), figure, Average::Pooled);
    let sides: Vec<Side> = by_sequence(units).map(side).filter(|s| s.weight > 0.0).collect();
    interval_of(&sides, RESAMPLES, 0)
}

impl Entrant<'_> {
    /// The metrics that its figures are of.
    pub fn metrics(&self) -> &MetricSet {
        &self.results.metrics
    }

    /// The figure over all frames.
    pub fn value(&self, figure: &Figure) -> f64 {
        self.row.score[figure.name.as_str()]
    }

    /// Its 95 % interval over sequences; NaN where there is none.
    pub fn interval(&self, figure: &Figure) -> [f64; 2] {
        interval(&self.units, figure)
    }
}

/// The trackers of `fields` that `pick` leaves, best first by `key`, one of [`sort_keys`]; ties by `auc` and id. Trackers of
/// unknown speed are the slowest.
pub fn ranked<'a>(fields: &[Field<'a>], key: &str, pick: &Pick) -> Vec<Entrant<'a>> {
    let mut entrants: Vec<Entrant<'a>> = fields.iter().flat_map(entrants).collect();
    let Some(metrics) = fields.first().map(|f| &f.results.metrics) else {
        return entrants;
    };
    let accuracy = |e: &Entrant<'_>| e.row.score[ACCURACY];
    entrants.sort_by(|a, b| {
        let better = Direction::LargerIsBetter.order(accuracy(a), accuracy(b));
        better.then_with(|| a.row.tracker.cmp(&b.row.tracker))
    });
    match metrics.figure(key) {
        _ if key == TRACKER => entrants.sort_by(|a, b| a.row.tracker.cmp(&b.row.tracker)),
        _ if key == FPS => entrants.sort_by(|a, b| Direction::LargerIsBetter.order(a.fps, b.fps)),
        Some(figure) => entrants.sort_by(|a, b| figure.better.order(a.value(figure), b.value(figure))),
        None => {}
    }
    if let Some(limit) = pick.under {
        entrants.retain(|e| 1.0 / e.fps < limit);
    }
    if let Some(part) = pick.best_per {
        let mut seen = BTreeSet::new();
        entrants.retain(|e| seen.insert((part.of(&e.row.tracker), e.row.protocol.as_str())));
    }
    if let Some(figure) = figure(metrics, key).filter(|_| pick.pareto) {
        retain_pareto(&mut entrants, figure);
    }
    entrants
}

/// The tables and curves of several runs as one; of several, trackers have the name of their run behind their id.
pub fn together(fields: &[Field<'_>]) -> Results {
    let Some(first) = fields.first() else {
        return Results::default();
    };
    let mut all = Results::new(&first.results.metrics);
    for field in fields {
        let named = |tracker: &TrackerName| match fields.len() {
            1 => tracker.clone(),
            _ => TrackerName {
                id: format!("{} ({})", tracker.id, field.name),
                ..tracker.clone()
            },
        };
        let Results {
            summary,
            curves,
            sequences,
            ..
        } = field.results;
        all.sequences.extend(sequences.iter().map(|row| SequenceRow {
            tracker: named(&row.tracker),
            ..row.clone()
        }));
        all.summary.extend(summary.iter().map(|row| SummaryRow {
            tracker: named(&row.tracker),
            ..row.clone()
        }));
        all.curves.extend(curves.iter().map(|row| CurveRow {
            tracker: named(&row.tracker),
            ..row.clone()
        }));
    }
    all
}

/// The trackers of a run.
fn entrants<'a>(field: &Field<'a>) -> Vec<Entrant<'a>> {
    let mut units: BTreeMap<(&str, &str), Vec<&'a SequenceRow>> = BTreeMap::new();
    for row in &field.results.sequences {
        let key = (row.tracker.id.as_str(), row.protocol.as_str());
        units.entry(key).or_default().push(row);
    }
    let pooled = field
        .results
        .summary
        .iter()
        .filter(|r| r.average == Average::Pooled);
    let entrant = |row: &'a SummaryRow| Entrant {
        run: field.name,
        row,
        units: units
            .remove(&(row.tracker.id.as_str(), row.protocol.as_str()))
            .unwrap_or_default(),
        fps: field.speeds.get(&row.tracker.id).copied().unwrap_or(f64::NAN),
        results: field.results,
    };
    pooled.map(entrant).collect()
}

/// Keeps those that no other under the same protocol equals or beats in both figure and speed, one of them truly.
fn retain_pareto(entrants: &mut Vec<Entrant<'_>>, figure: &Figure) {
    let mut order: Vec<usize> = (0..entrants.len()).filter(|&i| entrants[i].fps > 0.0).collect();
    order.sort_by(|&i, &j| {
        let (a, b) = (&entrants[i], &entrants[j]);
        let faster = Direction::LargerIsBetter.order(a.fps, b.fps);
        let better = figure.better.order(a.value(figure), b.value(figure));
        a.row.protocol.cmp(&b.row.protocol).then(faster).then(better)
    });
    let mut kept = vec![false; entrants.len()];
    let mut last: Option<usize> = None;
    for i in order {
        let e = &entrants[i];
        let value = e.value(figure);
        if value.is_nan() {
            continue;
        }
        kept[i] = last.map(|j| &entrants[j]).is_none_or(|best| {
            let gain = figure.better.gain(best.value(figure), value);
            best.row.protocol != e.row.protocol || gain > 0.0 || (gain == 0.0 && best.fps == e.fps)
        });
        if kept[i] {
            last = Some(i);
        }
    }
    let mut kept = kept.into_iter();
    entrants.retain(|_| kept.next().unwrap_or(false));
}

/// Whether each of `entrants` is told apart from the first by `figure` over the same sequences: paired, with a rate of 5 % of
/// false ones among those that are. `None` where the two have no frames in common, or no mean over frames is compared.
pub fn apart_from_first(entrants: &[Entrant<'_>], figure: &Figure) -> Vec<Option<bool>> {
    let sides = |e: &Entrant<'_>| -> BTreeMap<(String, String), Side> {
        let own = by_sequence(&e.units).filter_map(|units| {
            let first = units.first()?;
            let side = side(units.iter().map(|u| &u.score), figure, Average::Pooled);
            Some(((first.dataset.clone(), first.sequence.clone()), side))
        });
        own.collect()
    };
    let Some((first, _)) = entrants.split_first().filter(|_| figure.frame_mean.is_some()) else {
        return vec![None; entrants.len()];
    };
    let of_first = sides(first);
    let p = entrants.iter().enumerate().map(|(i, e)| {
        if i == 0 || e.row.protocol != first.row.protocol {
            return None;
        }
        let own = sides(e);
        let pairs = of_first.iter().filter_map(|(key, a)| {
            Some(Pair {
                a: *a,
                b: *own.get(key)?,
            })
        });
        difference(&pairs.collect::<Vec<_>>(), 0, 0).map(|d| d.p)
    });
    let p: Vec<Option<f64>> = p.collect();
    let q = benjamini_hochberg(&p.iter().flatten().copied().collect::<Vec<_>>());
    let mut q = q.into_iter();
    let apart = p
        .iter()
        .map(|p| p.and_then(|_| q.next()).map(|q| q <= FALSE_DISCOVERIES));
    apart.collect()
}

/// What is said of a group.
#[derive(Clone, Debug)]
pub struct GroupRow<'a> {
    /// Its name.
    pub group: String,
    /// The protocol.
    pub protocol: &'a str,
    /// Trackers in it, or sequences.
    pub members: usize,
    /// Median of the figure over trackers.
    pub median: f64,
    /// The best tracker.
    pub best: Entrant<'a>,
    /// Its figure in the group.
    pub value: f64,
    /// The 95 % interval of that over sequences.
    pub interval: [f64; 2],
}

/// Figures by group.
#[derive(Clone, Debug)]
pub struct Grouping<'a> {
    /// The groups of sequences; empty when trackers are grouped.
    pub columns: Vec<String>,
    /// For each entrant its figure in each of them; NaN where it has none.
    pub cells: Vec<Vec<f64>>,
    /// What is said of each group, by name and protocol.
    pub groups: Vec<GroupRow<'a>>,
}

/// The figures of `entrants` by group.
pub fn grouped<'a>(entrants: &[Entrant<'a>], by: Group, figure: &Figure) -> Grouping<'a> {
    match by.part() {
        Some(part) => Grouping {
            columns: Vec::new(),
            cells: vec![Vec::new(); entrants.len()],
            groups: by_part(entrants, part, figure),
        },
        None => by_sequences(entrants, by, figure),
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.retain(|v| !v.is_nan());
    values.sort_unstable_by(f64::total_cmp);
    quantile::linear(&values, 0.5)
}

fn by_part<'a>(entrants: &[Entrant<'a>], part: Part, figure: &Figure) -> Vec<GroupRow<'a>> {
    let mut groups: BTreeMap<(&'a str, &'a str), Vec<&Entrant<'a>>> = BTreeMap::new();
    for e in entrants {
        let key = (part.of(&e.row.tracker), e.row.protocol.as_str());
        groups.entry(key).or_default().push(e);
    }
    let row = |((group, protocol), members): ((&'a str, &'a str), Vec<&Entrant<'a>>)| {
        let better =
            |a: &&&Entrant<'a>, b: &&&Entrant<'a>| figure.better.order(a.value(figure), b.value(figure));
        let best = (*members.iter().min_by(better)?).clone();
        Some(GroupRow {
            group: group.to_owned(),
            protocol,
            members: members.len(),
            median: median(members.iter().map(|e| e.value(figure)).collect()),
            value: best.value(figure),
            interval: best.interval(figure),
            best,
        })
    };
    groups.into_iter().filter_map(row).collect()
}

fn by_sequences<'a>(entrants: &[Entrant<'a>], by: Group, figure: &Figure) -> Grouping<'a> {
    let datasets: BTreeSet<&str> = entrants
        .iter()
        .flat_map(|e| &e.units)
        .map(|u| u.dataset.as_str())
        .collect();
    let names = |results: &'a Results, unit: &SequenceRow| -> Vec<String> {
        if by == Group::Sequence {
            return vec![match datasets.len() {
                1 => unit.sequence.clone(),
                _ => format!("{}/{}", unit.dataset, unit.sequence),
            }];
        }
        match results.tags_of(&unit.dataset, &unit.sequence) {
            [] => vec![NO_TAG.to_owned()],
            tags => tags.to_vec(),
        }
    };
    // The units of each entrant in each group.
    let split: Vec<BTreeMap<String, Vec<&'a SequenceRow>>> = entrants
        .iter()
        .map(|e| {
            let mut groups: BTreeMap<String, Vec<&'a SequenceRow>> = BTreeMap::new();
            for units in by_sequence(&e.units) {
                for name in names(e.results, units[0]) {
                    groups.entry(name).or_default().extend(units);
                }
            }
            groups
        })
        .collect();
    let columns: BTreeSet<&String> = split.iter().flat_map(BTreeMap::keys).collect();
    let columns: Vec<String> = columns.into_iter().cloned().collect();
    let value = |groups: &BTreeMap<String, Vec<&SequenceRow>>, name: &String| {
        groups.get(name).map_or(f64::NAN, |units| joined(units, figure))
    };
    let cells: Vec<Vec<f64>> = split
        .iter()
        .map(|groups| columns.iter().map(|name| value(groups, name)).collect())
        .collect();
    let protocols: BTreeSet<&'a str> = entrants.iter().map(|e| e.row.protocol.as_str()).collect();
    let mut rows = Vec::new();
    for (c, name) in columns.iter().enumerate() {
        for &protocol in &protocols {
            let among = |i: &usize| entrants[*i].row.protocol == protocol && split[*i].contains_key(name);
            let members: Vec<usize> = (0..entrants.len()).filter(among).collect();
            let better = |i: &&usize, j: &&usize| figure.better.order(cells[**i][c], cells[**j][c]);
            let Some(&best) = members.iter().min_by(better) else {
                continue;
            };
            let units = &split[best][name];
            rows.push(GroupRow {
                group: name.clone(),
                protocol,
                members: by_sequence(units).count(),
                median: median(members.iter().map(|&i| cells[i][c]).collect()),
                best: entrants[best].clone(),
                value: cells[best][c],
                interval: interval(units, figure),
            });
        }
    }
    Grouping {
        columns,
        cells,
        groups: rows,
    }
}

/// Whether all of `entrants` are of the same sequences from the same starts.
pub fn are_of_the_same(entrants: &[Entrant<'_>]) -> bool {
    fn place<'a>(unit: &&'a SequenceRow) -> (&'a str, &'a str, usize) {
        (&unit.dataset, &unit.sequence, unit.start)
    }
    let mut of_protocol: BTreeMap<&str, Vec<(&str, &str, usize)>> = BTreeMap::new();
    entrants.iter().all(|e| {
        let own: Vec<_> = e.units.iter().map(place).collect();
        *of_protocol.entry(&e.row.protocol).or_insert_with(|| own.clone()) == own
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::example::{of, unit};

    /// Four trackers on three sequences: `esm/ssd` the most accurate, `fclk/ncc` the fastest, `iclk/ssd` beaten in both by
    /// `esm/ssd`, and one that has no speed.
    fn results() -> Results {
        let mut results = of(&[
            unit("esm/ssd/affine", "book", &[Some(0.0), Some(1.0)]),
            unit("esm/ssd/affine", "wall", &[Some(1.0), Some(3.0)]),
            unit("esm/ssd/affine", "yard", &[Some(1.0)]),
            unit("iclk/ssd/affine", "book", &[Some(2.0), Some(2.0)]),
            unit("iclk/ssd/affine", "wall", &[Some(4.0), None]),
            unit("iclk/ssd/affine", "yard", &[Some(6.0)]),
            unit("fclk/ncc/affine", "book", &[Some(0.0), Some(0.0)]),
            unit("fclk/ncc/affine", "wall", &[None, None]),
            unit("fclk/ncc/affine", "yard", &[Some(9.0)]),
            unit("nn/mi/affine", "book", &[None, None]),
        ]);
        let tags = |tags: &[&str]| tags.iter().map(|t| (*t).to_owned()).collect();
        results
            .tags
            .insert("builtin/book".into(), tags(&["plain", "quick"]));
        results.tags.insert("builtin/wall".into(), tags(&["quick"]));
        results
    }

    fn speeds() -> Speeds {
        let speeds = [
            ("esm/ssd/affine", 500.0),
            ("iclk/ssd/affine", 400.0),
            ("fclk/ncc/affine", 900.0),
        ];
        speeds.map(|(id, fps)| (id.to_owned(), fps)).into()
    }

    fn names(key: &str, pick: &Pick) -> String {
        let (results, speeds) = (results(), speeds());
        let field = Field {
            name: "a",
            results: &results,
            speeds: &speeds,
        };
        let names: Vec<&str> = ranked(&[field], key, pick)
            .iter()
            .map(|e| e.row.tracker.sm.as_str())
            .collect();
        names.join(" ")
    }

    #[test]
    fn trackers_are_ranked_by_any_column() {
        let all = Pick::default();
        assert_eq!(names("auc", &all), "esm iclk fclk nn");
        assert_eq!(names("fps", &all), "fclk esm iclk nn");
        assert_eq!(names("tracker", &all), "esm fclk iclk nn");
        assert_eq!(names("al_median", &all), "esm iclk fclk nn");
        assert_eq!(names("al_tracked", &all), "esm fclk iclk nn");
        let parse = |key: &str| parse_sort(&MetricSet::builtin(), key);
        assert_eq!(parse("SR_5").unwrap(), "sr_5");
        assert!(parse("sr5").unwrap_err().contains("did you mean 'sr_5'"));
    }

    #[test]
    fn the_best_of_each_kind_and_what_nothing_beats() {
        let pick = Pick::default();
        let best_per = Pick {
            best_per: Some(Part::Am),
            ..pick
        };
        assert_eq!(names("auc", &best_per), "esm fclk nn");
        let pareto = Pick { pareto: true, ..pick };
        assert_eq!(names("auc", &pareto), "esm fclk");
        assert_eq!(names("fps", &pareto), "fclk esm");
        let under = |seconds: f64| Pick {
            under: Some(seconds),
            ..pick
        };
        assert_eq!(names("auc", &under(0.0021)), "esm fclk");
        assert_eq!(names("auc", &under(0.002)), "fclk");
        assert_eq!(
            names(
                "auc",
                &Pick {
                    pareto: true,
                    ..under(0.0001)
                }
            ),
            ""
        );
    }

    /// Of a set by two numbers, those that no other equals or beats in both, by looking at all pairs.
    #[test]
    fn the_pareto_set_is_that_of_all_pairs() {
        let points = [
            (1.0, 9.0),
            (2.0, 8.0),
            (2.0, 8.0),
            (2.0, 9.0),
            (5.0, 3.0),
            (4.0, 3.0),
            (5.0, 2.0),
            (0.5, 9.0),
        ];
        let id = |k: usize| format!("t{k}/ssd/affine");
        let units: Vec<_> = points
            .iter()
            .enumerate()
            .map(|(k, p)| unit(&id(k), "wall", &[Some(20.0 - p.1)]))
            .collect();
        let results = of(&units);
        let speeds: Speeds = points.iter().enumerate().map(|(k, p)| (id(k), p.0)).collect();
        let field = Field {
            name: "",
            results: &results,
            speeds: &speeds,
        };
        let pick = Pick {
            pareto: true,
            ..Pick::default()
        };
        let mut found: Vec<String> = ranked(&[field], "auc", &pick)
            .iter()
            .map(|e| e.row.tracker.id.clone())
            .collect();
        found.sort();
        let beaten = |p: &(f64, f64)| points.iter().any(|q| q.0 >= p.0 && q.1 >= p.1 && q != p);
        let expected: Vec<String> = (0..points.len())
            .filter(|&k| !beaten(&points[k]))
            .map(id)
            .collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn figures_by_tag_are_those_of_its_frames() {
        let (results, speeds) = (results(), speeds());
        let field = Field {
            name: "",
            results: &results,
            speeds: &speeds,
        };
        let entrants = ranked(&[field], "auc", &Pick::default());
        let sr_2 = results.metrics.figure("sr_2").unwrap();
        let by_tag = grouped(&entrants, Group::Tag, sr_2);
        assert_eq!(by_tag.columns, ["(no tag)", "plain", "quick"]);
        assert_eq!(by_tag.cells[0], [1.0, 1.0, 0.75]);
        assert_eq!(by_tag.cells[1], [0.0, 1.0, 0.5]);
        // Not on the sequence without tags.
        assert!(by_tag.cells[3][0].is_nan());
        let quick = &by_tag.groups[2];
        assert_eq!(
            (quick.best.row.tracker.sm.as_str(), quick.members, quick.value),
            ("esm", 2, 0.75)
        );
        assert_eq!(quick.median, 0.5);
        let failures = results.metrics.figure("failures").unwrap();
        let by_tag = grouped(&entrants, Group::Tag, failures);
        assert_eq!(by_tag.cells[2], [0.0, 0.0, 2.0]);
        let by_sequence = grouped(
            &entrants,
            Group::Sequence,
            results.metrics.figure("al_median").unwrap(),
        );
        assert_eq!(by_sequence.columns, ["book", "wall", "yard"]);
        assert_eq!(by_sequence.cells[0], [0.5, 2.0, 1.0]);
        let by_am = grouped(&entrants, Group::Am, sr_2);
        let of = |g: &GroupRow<'_>| format!("{} {} {}", g.group, g.members, g.best.row.tracker.sm);
        let groups: Vec<String> = by_am.groups.iter().map(of).collect();
        assert_eq!(groups, ["mi 1 nn", "ncc 1 fclk", "ssd 2 esm"]);
        assert!(
            Group::Tag
                .takes(results.metrics.figure("al_median").unwrap())
                .is_err()
        );
        assert!(Group::Tag.takes(failures).is_ok());
    }

    #[test]
    fn the_first_is_told_apart_from_what_is_worse_everywhere() {
        let sequences: Vec<String> = (0..12).map(|k| format!("s{k}")).collect();
        let of_tracker = |id: &'static str, error: f64| {
            sequences
                .iter()
                .enumerate()
                .map(move |(k, s)| unit(id, s, &[Some(error + k as f64 / 10.0)]))
        };
        let units: Vec<_> = of_tracker("a/ssd/affine", 0.0)
            .chain(of_tracker("b/ssd/affine", 9.0))
            .chain(sequences.iter().enumerate().map(|(k, s)| {
                let error = if k % 2 == 0 { 0.0 } else { 2.2 };
                unit("c/ssd/affine", s, &[Some(error)])
            }))
            .collect();
        let results = of(&units);
        let speeds = Speeds::new();
        let field = Field {
            name: "",
            results: &results,
            speeds: &speeds,
        };
        let entrants = ranked(&[field], "auc", &Pick::default());
        let auc = results.metrics.figure("auc").unwrap();
        let ids: Vec<&str> = entrants.iter().map(|e| e.row.tracker.sm.as_str()).collect();
        assert_eq!(ids, ["a", "c", "b"]);
        assert_eq!(apart_from_first(&entrants, auc), [None, Some(false), Some(true)]);
        assert!(are_of_the_same(&entrants));
        let [low, high] = entrants[1].interval(auc);
        assert!(low < entrants[1].value(auc) && entrants[1].value(auc) < high);
    }
}
