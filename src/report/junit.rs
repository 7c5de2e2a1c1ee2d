//! The regression gate's findings as JUnit XML, which every CI service shows: a test suite per tracker, a test case per
//! sequence and for the pooled figures.

use super::OutputError;
use crate::judge::baseline::{Baseline, Key};
use crate::judge::gate::{Change, Comparison, Tolerances};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use std::collections::{BTreeMap, BTreeSet};

/// The report on a comparison with `baseline`. A figure that dropped or a run that failed is a failure; what is missing or
/// not comparable is an error; what is over other frames or not in the baseline is skipped.
///
/// # Errors
/// The XML cannot be written.
pub fn junit(
    baseline: &Baseline,
    comparison: &Comparison,
    tolerances: &Tolerances,
) -> Result<String, OutputError> {
    let mut drops: BTreeMap<&Key, Vec<&Change>> = BTreeMap::new();
    for drop in &comparison.drops {
        drops.entry(&drop.key).or_default().push(drop);
    }
    let missing: BTreeSet<&Key> = comparison.missing.iter().collect();
    let failed: BTreeSet<&Key> = comparison.failed.iter().collect();
    let unjudged: BTreeSet<&Key> = comparison.unjudged.iter().map(|c| &c.key).collect();
    let status = |key: &Key| {
        if missing.contains(key) {
            problem(NonSuccessKind::Error, "missing", "not in the run".to_owned())
        } else if failed.contains(key) {
            problem(NonSuccessKind::Failure, "failed", "the run failed".to_owned())
        } else if let Some(drops) = drops.get(key) {
            let line = |c: &&Change| {
                format!(
                    "{} {:.4} -> {:.4} (tolerance {})",
                    c.figure.name(),
                    c.baseline,
                    c.now,
                    tolerances.of(&c.key, c.figure)
                )
            };
            let lines: Vec<String> = drops.iter().map(line).collect();
            problem(NonSuccessKind::Failure, "drop", lines.join("; "))
        } else if unjudged.contains(key) {
            skipped("over other frames than the baseline")
        } else {
            TestCaseStatus::success()
        }
    };
    let lines = baseline.figures.iter().map(|line| (&line.key, status(&line.key)));
    let added = comparison
        .added
        .iter()
        .map(|key| (key, skipped("not in the baseline")));
    let mut suites: BTreeMap<&str, TestSuite> = BTreeMap::new();
    for (key, status) in lines.chain(added) {
        let mut case = TestCase::new(key.place(), status);
        case.set_classname(key.tracker.clone());
        let suite = suites
            .entry(&key.tracker)
            .or_insert_with(|| TestSuite::new(key.tracker.clone()));
        suite.add_test_case(case);
    }
    let mut report = Report::new("mtf-eval check");
    if !comparison.not_comparable.is_empty() {
        let mut suite = TestSuite::new("comparison");
        suite.add_test_cases(comparison.not_comparable.iter().map(|reason| {
            let status = problem(NonSuccessKind::Error, "not comparable", reason.clone());
            TestCase::new("comparable", status)
        }));
        report.add_test_suite(suite);
    }
    report.add_test_suites(suites.into_values());
    report.to_string().map_err(|e| OutputError::Report(e.to_string()))
}

fn problem(kind: NonSuccessKind, what: &str, message: String) -> TestCaseStatus {
    let mut status = TestCaseStatus::non_success(kind);
    status.set_type(what).set_message(message);
    status
}

fn skipped(why: &str) -> TestCaseStatus {
    let mut status = TestCaseStatus::skipped();
    status.set_message(why);
    status
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::{aggregate, example};

    #[test]
    fn report() {
        let units = example::units();
        let baseline = |units: &[_]| Baseline::new(&aggregate(units), Vec::new());
        let tolerances = Tolerances::default();
        let mut now = units.clone();
        now[3] = example::unit("esm/ssd/homography", "book", &[Some(0.0), Some(9.0)]);
        now.remove(0);
        let then = baseline(&units);
        let xml = junit(&then, &then.compare(&baseline(&now), &tolerances), &tolerances).unwrap();
        assert!(
            xml.contains(r#"tests="8" skipped="1" failures="2" errors="1""#),
            "{xml}"
        );
        for part in [
            r#"<testsuite name="iclk/ssd/affine" tests="3" skipped="1""#,
            r#"<testcase name="builtin/book" classname="esm/ssd/homography">"#,
            "sr_5 1.0000 -&gt; 0.5000 (tolerance 0.01)",
            "not in the run",
            "over other frames than the baseline",
        ] {
            assert!(xml.contains(part), "{part}: {xml}");
        }
        // Of another experiment.
        let mut other = baseline(&units);
        for line in &mut other.figures {
            line.key.protocol = "reinit".to_owned();
        }
        let xml = junit(&then, &then.compare(&other, &tolerances), &tolerances).unwrap();
        assert!(xml.contains(r#"<testsuite name="comparison""#), "{xml}");
    }
}
