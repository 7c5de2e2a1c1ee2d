//! The regression gate: a run against a baseline.
//!
//! Results are reproducible to the byte, so tolerances only say which changes are too small to matter.

use crate::judge::baseline::{Baseline, Figure, Key, Line};
pub use crate::judge::tolerances::Tolerances;
use crate::plan::Protocol;
use std::collections::{BTreeMap, BTreeSet};

/// A figure that differs from the baseline.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Tracker and sequence.
    pub key: Key,
    /// Which figure.
    pub figure: Figure,
    /// Its value in the baseline.
    pub baseline: f64,
    /// Its value in the run.
    pub now: f64,
}

impl Change {
    /// How much worse the run is, in the figure's unit; negative when it is better.
    pub fn worse_by(&self) -> f64 {
        match self.figure {
            Figure::Sr5 | Figure::Auc => self.baseline - self.now,
            Figure::AlMedian => self.now - self.baseline,
        }
    }
}

/// What [`Baseline::compare`] concludes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing got worse.
    Passed,
    /// A figure got worse than its tolerance allows, or a run failed.
    Dropped,
    /// The run is not of the same experiment.
    NotComparable,
    /// The run lacks trackers or sequences of the baseline.
    Incomplete,
}

/// A run against a baseline.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Figures that got worse by more than their tolerance, the worst (in tolerances) first.
    pub drops: Vec<Change>,
    /// Figures that got better by more than their tolerance, the best first.
    pub improved: Vec<Change>,
    /// Figures within their tolerance.
    pub unchanged: usize,
    /// Runs that failed now and did not in the baseline.
    pub failed: Vec<Key>,
    /// In the baseline but not in the run.
    pub missing: Vec<Key>,
    /// In the run but not in the baseline; they do not count.
    pub added: Vec<Key>,
    /// Figures over another number of frames than in the baseline: they differ but say nothing.
    pub unjudged: Vec<Change>,
    /// Why the run is not of the same experiment.
    pub not_comparable: Vec<String>,
}

impl Comparison {
    /// The conclusion; what prevents a comparison comes before what it finds.
    pub fn verdict(&self) -> Verdict {
        if !self.not_comparable.is_empty() {
            Verdict::NotComparable
        } else if !self.missing.is_empty() {
            Verdict::Incomplete
        } else if !self.drops.is_empty() || !self.failed.is_empty() {
            Verdict::Dropped
        } else {
            Verdict::Passed
        }
    }
}

impl Baseline {
    /// Compares a run (`now`) with this baseline. Pooled figures are judged only when both are over the same number of
    /// frames, so sequences that the baseline does not know do not blur them.
    pub fn compare(&self, now: &Baseline, tolerances: &Tolerances) -> Comparison {
        let mut result = Comparison::default();
        let lines: BTreeMap<&Key, &Line> = now.figures.iter().map(|l| (&l.key, l)).collect();
        let known: BTreeSet<&Key> = self.figures.iter().map(|l| &l.key).collect();
        let mut other_frames = BTreeSet::new();
        for base in &self.figures {
            let Some(line) = lines.get(&base.key) else {
                result.missing.push(base.key.clone());
                continue;
            };
            if line.failed && !base.failed {
                result.failed.push(base.key.clone());
            }
            // Where failures end a stretch, how many frames there are is a result.
            let restarted = base.key.protocol.parse();
            let restarted = restarted.is_ok_and(|p: Protocol| p.restarts_on_failure());
            let same_frames = line.frames == base.frames || (restarted && !base.key.is_pooled());
            if !same_frames && !line.failed && !base.failed && !base.key.is_pooled() {
                other_frames.insert(format!(
                    "{}: {} frames in the baseline, {} in the run",
                    base.key.place(),
                    base.frames,
                    line.frames
                ));
            }
            for figure in Figure::ALL {
                let (baseline, now) = (base.get(figure), line.get(figure));
                let change = Change {
                    key: base.key.clone(),
                    figure,
                    baseline,
                    now,
                };
                // Figures have six decimals; half of the last one absorbs the rounding of the difference.
                let limit = tolerances.of(&base.key, figure) + 5e-7;
                if baseline == now || (baseline.is_nan() && now.is_nan()) {
                    result.unchanged += 1;
                } else if !same_frames || baseline.is_nan() || now.is_nan() {
                    result.unjudged.push(change);
                } else if change.worse_by() > limit {
                    result.drops.push(change);
                } else if change.worse_by() < -limit {
                    result.improved.push(change);
                } else {
                    result.unchanged += 1;
                }
            }
        }
        // Stable, so equal changes stay in the baseline's order.
        let in_tolerances = |c: &Change| c.worse_by() / tolerances.of(&c.key, c.figure).max(1e-6);
        result
            .drops
            .sort_by(|a, b| in_tolerances(b).total_cmp(&in_tolerances(a)));
        result
            .improved
            .sort_by(|a, b| in_tolerances(a).total_cmp(&in_tolerances(b)));
        result.added = now
            .figures
            .iter()
            .map(|l| &l.key)
            .filter(|k| !known.contains(k))
            .cloned()
            .collect();
        result.not_comparable = self.obstacles(now, &result);
        result.not_comparable.extend(other_frames);
        result
    }

    fn obstacles(&self, now: &Baseline, result: &Comparison) -> Vec<String> {
        fn protocols(b: &Baseline) -> BTreeSet<&str> {
            b.figures.iter().map(|l| l.key.protocol.as_str()).collect()
        }
        let (then, today) = (protocols(self), protocols(now));
        if self.figures.is_empty() {
            vec!["the baseline holds no figures".to_owned()]
        } else if today.is_empty() {
            vec!["the run holds no figures".to_owned()]
        } else if !then.is_subset(&today) {
            let list = |p: BTreeSet<&str>| p.into_iter().collect::<Vec<_>>().join(", ");
            vec![format!(
                "protocol: {} in the baseline, {} in the run",
                list(then),
                list(today)
            )]
        } else if result.missing.len() == self.figures.len() {
            vec!["the run has no tracker on any sequence of the baseline".to_owned()]
        } else {
            Vec::new()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::{UnitResult, UnitStatus, aggregate, example};

    fn baseline(units: &[UnitResult]) -> Baseline {
        Baseline::new(&aggregate(units), Vec::new())
    }

    fn compare(then: &[UnitResult], now: &[UnitResult]) -> Comparison {
        baseline(then).compare(&baseline(now), &Tolerances::default())
    }

    fn one(shifts: &[Option<f64>]) -> Vec<UnitResult> {
        vec![example::unit("esm/ssd/affine", "wall", shifts)]
    }

    #[test]
    fn same_run_passes() {
        let c = compare(&example::units(), &example::units());
        assert_eq!((c.verdict(), c.unchanged), (Verdict::Passed, 3 * (3 + 5)));
        assert_eq!(
            c,
            Comparison {
                unchanged: 24,
                ..Comparison::default()
            }
        );
    }

    #[test]
    fn drops_and_improvements() {
        let c = compare(&one(&[Some(1.0), Some(1.0)]), &one(&[Some(1.0), Some(8.0)]));
        assert_eq!(c.verdict(), Verdict::Dropped);
        // sr_5 1 -> 0.5, auc falls, median 1 -> 4.5, each pooled and on the sequence.
        assert_eq!((c.drops.len(), c.unchanged), (6, 0));
        assert_eq!(
            (c.drops[0].figure, c.drops[0].baseline, c.drops[0].now),
            (Figure::AlMedian, 1.0, 4.5)
        );
        assert!(c.drops[0].key.is_pooled());
        let back = compare(&one(&[Some(1.0), Some(6.0)]), &one(&[Some(1.0), Some(1.0)]));
        assert_eq!((back.verdict(), back.improved.len()), (Verdict::Passed, 6));
    }

    #[test]
    fn tolerance_is_inclusive() {
        let then = baseline(&one(&[Some(1.0)]));
        let mut now = then.clone();
        for line in &mut now.figures {
            (line.sr_5, line.auc, line.al_median) =
                (line.sr_5 - 0.01, line.auc - 0.005, line.al_median + 0.05);
        }
        let c = then.compare(&now, &Tolerances::default());
        assert_eq!((c.verdict(), c.unchanged), (Verdict::Passed, 6));
        assert_eq!(then.compare(&now, &Tolerances::NONE).drops.len(), 6);
    }

    #[test]
    fn infinite_medians() {
        let (tracked, lost) = (one(&[Some(1.0), Some(1.0)]), one(&[Some(1.0), None]));
        let c = compare(&tracked, &lost);
        assert!(
            c.drops
                .iter()
                .any(|d| d.figure == Figure::AlMedian && d.now.is_infinite())
        );
        assert_eq!(compare(&lost, &lost).verdict(), Verdict::Passed);
        assert_eq!(compare(&lost, &tracked).improved.len(), 6);
    }

    #[test]
    fn missing_is_incomplete_and_added_is_not() {
        let all = example::units();
        let c = compare(&all, &all[2..]);
        assert_eq!((c.verdict(), c.missing.len()), (Verdict::Incomplete, 3));
        let c = compare(&all[1..], &all);
        assert_eq!((c.verdict(), c.added.len()), (Verdict::Passed, 1));
        // The pooled figures of the tracker with one more sequence are not judged.
        assert!(c.unjudged.iter().all(|u| u.key.is_pooled()) && !c.unjudged.is_empty());
    }

    #[test]
    fn not_comparable() {
        let then = one(&[Some(1.0), Some(1.0)]);
        let mut other = then.clone();
        other[0].protocol = "reinit:20:5".to_owned();
        assert_eq!(compare(&then, &other).verdict(), Verdict::NotComparable);
        let c = compare(&then, &one(&[Some(1.0)]));
        assert_eq!(
            c.not_comparable,
            ["builtin/wall: 2 frames in the baseline, 1 in the run"]
        );
        let elsewhere = [example::unit("nn/ssd/affine", "book", &[Some(1.0)])];
        assert_eq!(compare(&then, &elsewhere).verdict(), Verdict::NotComparable);
        assert_eq!(compare(&[], &then).verdict(), Verdict::NotComparable);
        assert_eq!(compare(&then, &[]).verdict(), Verdict::NotComparable);
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
        assert_eq!((c.verdict(), c.drops.len()), (Verdict::Dropped, 2));
        assert!(c.not_comparable.is_empty() && c.unjudged.iter().all(|u| u.key.is_pooled()));
        assert_eq!(compare(&now, &then).verdict(), Verdict::Passed);
        // Nothing but failures: no median error, in memory and read back.
        let lost = baseline(&reinit(&[None]));
        let read: Baseline = serde_json::from_str(&lost.to_json()).unwrap();
        let c = read.compare(&lost, &Tolerances::default());
        assert_eq!((c.verdict(), c.unchanged), (Verdict::Passed, 6));
        assert_eq!(compare(&then, &reinit(&[None])).drops.len(), 3);
    }

    #[test]
    fn a_run_that_died_is_a_drop() {
        let then = one(&[Some(1.0), Some(1.0)]);
        let mut now = one(&[]);
        now[0].status = UnitStatus::Failed("panicked".to_owned());
        let c = compare(&then, &now);
        assert_eq!(
            (c.verdict(), c.failed.len(), c.not_comparable.len()),
            (Verdict::Dropped, 1, 0)
        );
    }
}
