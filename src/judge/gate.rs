//! The regression gate: a run against a baseline.
//!
//! Results are reproducible to the byte, so tolerances only say which changes are too small to matter.

use crate::judge::baseline::{Baseline, Line};
use crate::judge::change::{Change, Matched, Subject};
use crate::judge::pairing::{OtherSettings, pairs};
use crate::judge::tolerances::Tolerances;
use crate::metric::{Direction, Figure};
use crate::plan::Protocol;
use std::collections::BTreeSet;

/// A figure that differs from the baseline.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Tracker and sequence.
    pub subject: Subject,
    /// From the baseline to the run.
    pub change: Change,
}

/// What the gate concludes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conclusion {
    /// Nothing got worse.
    Passed,
    /// A figure got worse than its tolerance allows, or a run failed.
    Dropped,
    /// The run is not of the same experiment.
    NotComparable,
    /// The run lacks trackers or sequences of the baseline.
    Incomplete,
}

/// What the gate finds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Findings {
    /// Figures that got worse by more than their tolerance, the worst (in tolerances) first.
    pub drops: Vec<Finding>,
    /// Figures that got better by more than their tolerance, the best first.
    pub improved: Vec<Finding>,
    /// Figures within their tolerance.
    pub unchanged: usize,
    /// Runs that failed now and did not in the baseline.
    pub failed: Vec<Subject>,
    /// In the baseline but not in the run.
    pub missing: Vec<Subject>,
    /// In the run but not in the baseline; they do not count.
    pub added: Vec<Subject>,
    /// Trackers of the baseline that the run has with other settings. What they were judged on is missing, and what they
    /// are now is added.
    pub other_settings: Vec<OtherSettings>,
    /// Every difference fails, for better or worse.
    pub exact: bool,
    /// Gated figures that the baseline lacks; they do not count.
    pub added_figures: Vec<String>,
    /// Figures over another number of frames than in the baseline: they differ but say nothing.
    pub unjudged: Vec<Finding>,
    /// Why the run is not of the same experiment.
    pub not_comparable: Vec<String>,
}

impl Findings {
    /// Whether anything else than a drop stands against an exact comparison.
    fn differs(&self) -> bool {
        self.exact && !(self.improved.is_empty() && self.unjudged.is_empty() && self.added.is_empty())
    }

    /// The conclusion; what prevents a comparison comes before what it finds.
    pub fn conclusion(&self) -> Conclusion {
        if !self.not_comparable.is_empty() {
            Conclusion::NotComparable
        } else if !self.missing.is_empty() {
            Conclusion::Incomplete
        } else if !self.drops.is_empty() || !self.failed.is_empty() || self.differs() {
            Conclusion::Dropped
        } else {
            Conclusion::Passed
        }
    }
}

/// Compares a run (`now`) with a baseline. Pooled figures are judged only when both are over the same number of frames, so
/// sequences that the baseline does not know do not blur them.
pub fn gate(baseline: &Baseline, now: &Baseline, tolerances: &Tolerances) -> Findings {
    let mut result = Findings {
        exact: tolerances.exact,
        ..Findings::default()
    };
    let matched = Matched::new(&baseline.lines, &now.lines, |line| &line.subject);
    let subjects = |lines: &[&Line]| lines.iter().map(|l| l.subject.clone()).collect();
    result.missing = subjects(&matched.only_before);
    result.added = subjects(&matched.only_after);
    fn trackers(b: &Baseline) -> BTreeSet<&str> {
        b.lines.iter().map(|l| l.subject.tracker.as_str()).collect()
    }
    let (then, today) = (trackers(baseline), trackers(now));
    result.other_settings = pairs(then.difference(&today).copied(), today.difference(&then).copied());
    let mut other_frames = BTreeSet::new();
    for (base, line) in &matched.both {
        let subject = &base.subject;
        if line.failed && !base.failed {
            result.failed.push(subject.clone());
        }
        // Where failures end a stretch, how many frames there are is a result.
        let restarted = subject.protocol.parse();
        let restarted = restarted.is_ok_and(|p: Protocol| p.restarts_on_failure());
        let same_frames = line.frames == base.frames || (restarted && !subject.is_pooled());
        if !same_frames && !line.failed && !base.failed && !subject.is_pooled() {
            other_frames.insert(format!(
                "{}: {} frames in the baseline, {} in the run",
                subject.place(),
                base.frames,
                line.frames
            ));
        }
        for (name, value) in &base.figures {
            let (Some(figure), Some(current)) = (now.metrics.figure(name), line.get(name)) else {
                continue;
            };
            let change = Change::new(figure, *value, current);
            // Figures have six decimals; half of the last one absorbs the rounding of the difference.
            let limit = tolerances.at(subject, name).limit(*value) + 5e-7;
            let gain = change.gain();
            let list = if change.is_none() {
                None
            } else if !same_frames || !change.is_defined() {
                Some(&mut result.unjudged)
            } else if gain < -limit {
                Some(&mut result.drops)
            } else if gain > limit {
                Some(&mut result.improved)
            } else {
                None
            };
            match list {
                Some(list) => list.push(Finding {
                    subject: subject.clone(),
                    change,
                }),
                None => result.unchanged += 1,
            }
        }
    }
    // Stable, so equal changes stay in the baseline's order.
    let in_tolerances = |f: &Finding| {
        let tolerance = tolerances.at(&f.subject, &f.change.figure);
        f.change.gain() / tolerance.limit(f.change.before).max(1e-6)
    };
    let by_gain = |a: &Finding, b: &Finding| in_tolerances(a).total_cmp(&in_tolerances(b));
    result.drops.sort_by(by_gain);
    result.improved.sort_by(|a, b| by_gain(b, a));
    let names = |b: &Baseline| -> Vec<String> {
        let figures = b.lines.first().map_or(&[][..], |line| &line.figures);
        figures.iter().map(|(name, _)| name.clone()).collect()
    };
    let (then, today) = (names(baseline), names(now));
    if !then.is_empty() {
        result.added_figures = today
            .iter()
            .filter(|name| !then.contains(name))
            .cloned()
            .collect();
    }
    result.not_comparable = obstacles(baseline, now, &result);
    let other_data = |(id, print): (&String, &String)| now.data.get(id).is_some_and(|other| other != print);
    let changed = baseline.data.iter().filter(|pair| other_data(*pair));
    let changed = changed
        .map(|(id, _)| format!("{id}: other frames or ground truth (fingerprint) than in the baseline"));
    result.not_comparable.extend(changed);
    if !today.is_empty() {
        let lacking = then.iter().filter(|name| !today.contains(name));
        let lacking = lacking.map(|name| format!("the run has no figure '{name}'"));
        result.not_comparable.extend(lacking);
    }
    result.not_comparable.extend(other_frames);
    result
}

/// How many rates of a baseline's sequences are within their default tolerance of 1, and how many rates there are.
///
/// Trackers that get worse on sequences as easy as that may keep their rates, so a gate on them guards little.
pub fn at_ceiling(baseline: &Baseline) -> (usize, usize) {
    let (mut at, mut all) = (0, 0);
    for line in baseline
        .lines
        .iter()
        .filter(|l| !l.subject.is_pooled() && l.frames > 0)
    {
        for (name, value) in &line.figures {
            let rate = |f: &&Figure| f.better == Direction::LargerIsBetter && f.unit.is_empty();
            let figure = baseline.metrics.figure(name).filter(rate);
            if let Some(figure) = figure.filter(|_| value.is_finite()) {
                all += 1;
                at += usize::from(*value >= 1.0 - figure.tolerance.unwrap_or(0.0));
            }
        }
    }
    (at, all)
}

fn obstacles(baseline: &Baseline, now: &Baseline, found: &Findings) -> Vec<String> {
    fn protocols(b: &Baseline) -> BTreeSet<&str> {
        b.lines.iter().map(|l| l.subject.protocol.as_str()).collect()
    }
    let (then, today) = (protocols(baseline), protocols(now));
    if baseline.lines.is_empty() {
        vec!["the baseline holds no figures".to_owned()]
    } else if today.is_empty() {
        vec!["the run holds no figures".to_owned()]
    } else if let Some(which) = [(baseline, "baseline"), (now, "run")]
        .into_iter()
        .find_map(|(b, which)| {
            b.lines
                .iter()
                .all(|l| l.frames == 0 && !l.failed)
                .then_some(which)
        })
    {
        vec![format!(
            "the {which} is over no frame: none after the start of a tracker has ground truth"
        )]
    } else if !then.is_subset(&today) {
        let list = |p: BTreeSet<&str>| p.into_iter().collect::<Vec<_>>().join(", ");
        vec![format!(
            "protocol: {} in the baseline, {} in the run",
            list(then),
            list(today)
        )]
    } else if found.missing.len() == baseline.lines.len() {
        vec![match found.other_settings.is_empty() {
            true => "the run has no tracker on any sequence of the baseline".to_owned(),
            false => "the run has no tracker with the settings of the baseline".to_owned(),
        }]
    } else {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::MetricSet;
    use crate::metric::aggregate::{UnitResult, UnitStatus, example};

    fn baseline(units: &[UnitResult]) -> Baseline {
        Baseline::new(&example::of(units), Vec::new())
    }

    #[test]
    fn other_data_is_not_comparable() {
        let of = |print: &str| {
            let data = [("builtin/wall".to_owned(), print.to_owned())];
            let units = [example::unit("esm/ssd/homography", "wall", &[Some(0.5)])];
            baseline(&units).with_data(data.into())
        };
        let findings = |old: &Baseline| gate(old, &of("1"), &usual()).not_comparable;
        assert_eq!(findings(&of("1")), [""; 0]);
        assert!(findings(&of("2"))[0].contains("builtin/wall: other frames"));
        // A baseline that does not know its data is taken at its figures.
        assert_eq!(findings(&of("2").with_data(Default::default())), [""; 0]);
    }

    fn usual() -> Tolerances {
        Tolerances::of(&MetricSet::builtin())
    }

    fn compare(then: &[UnitResult], now: &[UnitResult]) -> Findings {
        gate(&baseline(then), &baseline(now), &usual())
    }

    fn one(shifts: &[Option<f64>]) -> Vec<UnitResult> {
        vec![example::unit("esm/ssd/affine", "wall", shifts)]
    }

    #[test]
    fn same_run_passes() {
        let c = compare(&example::units(), &example::units());
        assert_eq!((c.conclusion(), c.unchanged), (Conclusion::Passed, 3 * (3 + 5)));
        assert_eq!(
            c,
            Findings {
                unchanged: 24,
                ..Findings::default()
            }
        );
    }

    #[test]
    fn drops_and_improvements() {
        let c = compare(&one(&[Some(1.0), Some(1.0)]), &one(&[Some(1.0), Some(8.0)]));
        assert_eq!(c.conclusion(), Conclusion::Dropped);
        // sr_5 1 -> 0.5, auc falls, median 1 -> 4.5, each pooled and on the sequence.
        assert_eq!((c.drops.len(), c.unchanged), (6, 0));
        let worst = &c.drops[0].change;
        assert_eq!(
            (worst.figure.as_str(), worst.before, worst.after),
            ("al_median", 1.0, 4.5)
        );
        assert!(c.drops[0].subject.is_pooled());
        let back = compare(&one(&[Some(1.0), Some(6.0)]), &one(&[Some(1.0), Some(1.0)]));
        assert_eq!((back.conclusion(), back.improved.len()), (Conclusion::Passed, 6));
    }

    #[test]
    fn tolerance_is_inclusive() {
        let then = baseline(&one(&[Some(1.0)]));
        let mut now = then.clone();
        for line in &mut now.lines {
            for ((_, value), by) in line.figures.iter_mut().zip([-0.01, -0.005, 0.05]) {
                *value += by;
            }
        }
        let c = gate(&then, &now, &usual());
        assert_eq!((c.conclusion(), c.unchanged), (Conclusion::Passed, 6));
        let none = Tolerances::none(&MetricSet::builtin());
        assert_eq!(gate(&then, &now, &none).drops.len(), 6);
    }

    #[test]
    fn a_little_more_than_the_tolerance_counts_in_both_directions() {
        let then = baseline(&one(&[Some(1.0), Some(3.0)]));
        // The tolerances of sr_5, auc and al_median, of which the last is an error.
        let moved = |share: f64| {
            let mut now = then.clone();
            for line in &mut now.lines {
                for ((_, value), by) in line.figures.iter_mut().zip([-0.01, -0.005, 0.05]) {
                    *value += share * by;
                }
            }
            let c = gate(&then, &now, &usual());
            [c.drops.len(), c.improved.len(), c.unchanged]
        };
        assert_eq!(moved(1.01), [6, 0, 0]);
        assert_eq!(moved(0.99), [0, 0, 6]);
        assert_eq!(moved(-0.99), [0, 0, 6]);
        assert_eq!(moved(-1.01), [0, 6, 0]);
    }

    #[test]
    fn an_exact_comparison_fails_for_better_or_worse() {
        let (then, now) = (one(&[Some(1.0), Some(1.001)]), one(&[Some(1.0), Some(1.0)]));
        assert_eq!(compare(&then, &now).conclusion(), Conclusion::Passed);
        let exact = |then: &[UnitResult], now: &[UnitResult]| {
            let exact = Tolerances::exact(&MetricSet::builtin());
            gate(&baseline(then), &baseline(now), &exact).conclusion()
        };
        assert_eq!(exact(&then, &now), Conclusion::Dropped);
        assert_eq!(exact(&now, &then), Conclusion::Dropped);
        assert_eq!(exact(&then, &then), Conclusion::Passed);
        let all = example::units();
        assert_eq!(exact(&all[1..], &all), Conclusion::Dropped, "added");
    }

    #[test]
    fn relative_tolerances() {
        let (then, now) = (baseline(&one(&[Some(4.0)])), baseline(&one(&[Some(4.3)])));
        let median = |tolerance: &str| {
            let mut tolerances = usual();
            tolerances.set("al_median", tolerance.parse().unwrap());
            let drops = gate(&then, &now, &tolerances).drops;
            drops.iter().any(|d| d.change.figure == "al_median")
        };
        assert_eq!(
            ["0.3", "0.29", "7.5%", "7%"].map(median),
            [false, true, false, true]
        );
    }

    #[test]
    fn trackers_with_other_settings_are_named_as_such() {
        let all = example::units();
        let set = |units: &[UnitResult]| -> Vec<UnitResult> {
            let mut units = units.to_vec();
            for unit in units.iter_mut().filter(|u| u.tracker.id == "esm/ssd/homography") {
                unit.tracker.id += "{max_iters=2}";
            }
            units
        };
        let c = compare(&all, &set(&all));
        assert_eq!(c.conclusion(), Conclusion::Incomplete);
        assert_eq!(
            (c.missing.len(), c.added.len(), c.other_settings.len()),
            (3, 3, 1)
        );
        assert_eq!(c.other_settings[0].difference, "max_iters: default -> 2");
        let one = one(&[Some(1.0)]);
        let mut other = one.clone();
        other[0].tracker.id += "{max_iters=2}";
        let c = compare(&one, &other);
        assert_eq!(c.conclusion(), Conclusion::NotComparable);
        assert_eq!(
            c.not_comparable,
            ["the run has no tracker with the settings of the baseline"]
        );
    }

    #[test]
    fn rates_at_their_ceiling() {
        let of = |shifts: &[Option<f64>]| at_ceiling(&baseline(&one(shifts)));
        assert_eq!(of(&[Some(0.0), Some(0.0)]), (2, 2));
        assert_eq!(of(&[Some(4.0), Some(4.0)]), (1, 2));
        assert_eq!(of(&[Some(9.0), Some(9.0)]), (0, 2));
    }

    #[test]
    fn infinite_medians() {
        let (tracked, lost) = (one(&[Some(1.0), Some(1.0)]), one(&[Some(1.0), None]));
        let c = compare(&tracked, &lost);
        assert!(
            c.drops
                .iter()
                .any(|d| d.change.figure == "al_median" && d.change.after.is_infinite())
        );
        assert_eq!(compare(&lost, &lost).conclusion(), Conclusion::Passed);
        assert_eq!(compare(&lost, &tracked).improved.len(), 6);
    }

    #[test]
    fn missing_is_incomplete_and_added_is_not() {
        let all = example::units();
        let c = compare(&all, &all[2..]);
        assert_eq!((c.conclusion(), c.missing.len()), (Conclusion::Incomplete, 3));
        let c = compare(&all[1..], &all);
        assert_eq!((c.conclusion(), c.added.len()), (Conclusion::Passed, 1));
        // The pooled figures of the tracker with one more sequence are not judged.
        assert!(c.unjudged.iter().all(|u| u.subject.is_pooled()) && !c.unjudged.is_empty());
    }

    #[test]
    fn not_comparable() {
        let then = one(&[Some(1.0), Some(1.0)]);
        let mut other = then.clone();
        other[0].protocol = "reinit:20:5".to_owned();
        assert_eq!(compare(&then, &other).conclusion(), Conclusion::NotComparable);
        let c = compare(&then, &one(&[Some(1.0)]));
        assert_eq!(
            c.not_comparable,
            ["builtin/wall: 2 frames in the baseline, 1 in the run"]
        );
        let elsewhere = [example::unit("nn/ssd/affine", "book", &[Some(1.0)])];
        assert_eq!(compare(&then, &elsewhere).conclusion(), Conclusion::NotComparable);
        assert_eq!(compare(&[], &then).conclusion(), Conclusion::NotComparable);
        assert_eq!(compare(&then, &[]).conclusion(), Conclusion::NotComparable);
    }

    #[test]
    fn figures_over_no_frame_are_no_evidence() {
        let (some, none) = (one(&[Some(1.0)]), one(&[]));
        for (then, now, which) in [
            (&none, &none, "baseline"),
            (&some, &none, "run"),
            (&none, &some, "baseline"),
        ] {
            let c = compare(then, now);
            assert_eq!(c.conclusion(), Conclusion::NotComparable);
            let expected = format!("the {which} is over no frame");
            assert!(
                c.not_comparable[0].starts_with(&expected),
                "{:?}",
                c.not_comparable
            );
        }
    }

    #[test]
    fn frames_that_failures_cost_are_a_result() {
        let reinit = |shifts: &[Option<f64>]| {
            let mut units = one(shifts);
            units[0].protocol = "reinit:20:5".to_owned();
            units
        };
        let (then, now) = (reinit(&[Some(1.0); 9]), reinit(&[Some(1.0), None, Some(1.0)]));
        let c = compare(&then, &now);
        assert_eq!((c.conclusion(), c.drops.len()), (Conclusion::Dropped, 2));
        assert!(c.not_comparable.is_empty() && c.unjudged.iter().all(|u| u.subject.is_pooled()));
        assert_eq!(compare(&now, &then).conclusion(), Conclusion::Passed);
        // Nothing but failures: no median error, in memory and read back.
        let lost = baseline(&reinit(&[None]));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("baseline.json");
        lost.write(&path).unwrap();
        let read = Baseline::read(&path, &lost.metrics).unwrap();
        let c = gate(&read, &lost, &usual());
        assert_eq!((c.conclusion(), c.unchanged), (Conclusion::Passed, 6));
        assert_eq!(compare(&then, &reinit(&[None])).drops.len(), 3);
    }

    #[test]
    fn a_run_that_died_is_a_drop() {
        let then = one(&[Some(1.0), Some(1.0)]);
        let mut now = one(&[]);
        now[0].status = UnitStatus::Failed("panicked".to_owned());
        let c = compare(&then, &now);
        assert_eq!(
            (c.conclusion(), c.failed.len(), c.not_comparable.len()),
            (Conclusion::Dropped, 1, 0)
        );
    }

    #[test]
    fn added_figures_are_named_and_do_not_count() {
        let then = baseline(&example::units());
        let mut more = then.clone();
        for line in &mut more.lines {
            line.figures.push(("angle_median".to_owned(), 1.0));
        }
        let c = gate(&then, &more, &usual());
        assert_eq!((c.conclusion(), c.unchanged), (Conclusion::Passed, 24));
        assert_eq!(c.added_figures, ["angle_median"]);
        let c = gate(&more, &then, &usual());
        assert_eq!(c.not_comparable, ["the run has no figure 'angle_median'"]);
    }
}
