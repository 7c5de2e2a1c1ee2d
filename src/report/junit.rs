//! The regression gate's findings as JUnit XML, which every CI service shows: a test suite per tracker, a test case per
//! sequence and for the pooled figures.

use super::ReportError;
use crate::judge::baseline::Baseline;
use crate::judge::change::Subject;
use crate::judge::gate::{Finding, Findings};
use crate::judge::tolerances::Tolerances;
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use std::collections::{BTreeMap, BTreeSet};

/// The report on a run against `baseline`. A figure that dropped or a run that failed is a failure; what is missing or
/// not comparable is an error; what is over other frames or not in the baseline is skipped.
///
/// # Errors
/// The XML cannot be written.
pub fn junit(
    baseline: &Baseline,
    findings: &Findings,
    tolerances: &Tolerances,
) -> Result<String, ReportError> {
    let mut drops: BTreeMap<&Subject, Vec<&Finding>> = BTreeMap::new();
    for drop in &findings.drops {
        drops.entry(&drop.subject).or_default().push(drop);
    }
    let missing: BTreeSet<&Subject> = findings.missing.iter().collect();
    let other_settings: BTreeMap<&str, String> = findings
        .other_settings
        .iter()
        .map(|o| {
            (
                o.before.as_str(),
                format!("run with other settings, {}", o.difference),
            )
        })
        .collect();
    let named: BTreeSet<&str> = findings.other_settings.iter().map(|o| o.after.as_str()).collect();
    let failed: BTreeSet<&Subject> = findings.failed.iter().collect();
    let unjudged: BTreeSet<&Subject> = findings.unjudged.iter().map(|f| &f.subject).collect();
    let status = |subject: &Subject| {
        if missing.contains(subject) {
            let why = other_settings.get(subject.tracker.as_str()).cloned();
            let why = why.unwrap_or_else(|| "not in the run".to_owned());
            problem(NonSuccessKind::Error, "missing", why)
        } else if failed.contains(subject) {
            problem(NonSuccessKind::Failure, "failed", "the run failed".to_owned())
        } else if let Some(drops) = drops.get(subject) {
            let line = |f: &&Finding| {
                format!(
                    "{} {:.4} -> {:.4} (tolerance {})",
                    f.change.figure,
                    f.change.before,
                    f.change.after,
                    tolerances.at(&f.subject, &f.change.figure)
                )
            };
            let lines: Vec<String> = drops.iter().map(line).collect();
            problem(NonSuccessKind::Failure, "drop", lines.join("; "))
        } else if unjudged.contains(subject) {
            skipped("over other frames than the baseline")
        } else {
            TestCaseStatus::success()
        }
    };
    let lines = baseline
        .lines
        .iter()
        .map(|line| (&line.subject, status(&line.subject)));
    let added = findings
        .added
        .iter()
        .filter(|subject| !named.contains(subject.tracker.as_str()))
        .map(|subject| (subject, skipped("not in the baseline")));
    let mut suites: BTreeMap<&str, TestSuite> = BTreeMap::new();
    for (subject, status) in lines.chain(added) {
        let mut case = TestCase::new(subject.place(), status);
        case.set_classname(subject.tracker.clone());
        let suite = suites
            .entry(&subject.tracker)
            .or_insert_with(|| TestSuite::new(subject.tracker.clone()));
        suite.add_test_case(case);
    }
    let mut report = Report::new("mtf-eval check");
    if !findings.not_comparable.is_empty() {
        let mut suite = TestSuite::new("comparison");
        suite.add_test_cases(findings.not_comparable.iter().map(|reason| {
            let status = problem(NonSuccessKind::Error, "not comparable", reason.clone());
            TestCase::new("comparable", status)
        }));
        report.add_test_suite(suite);
    }
    report.add_test_suites(suites.into_values());
    report.to_string().map_err(|e| ReportError::Junit(e.to_string()))
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
    use crate::judge::gate::gate;
    use crate::metric::MetricSet;
    use crate::metric::aggregate::example;

    #[test]
    fn report() {
        let units = example::units();
        let baseline = |units: &[_]| Baseline::new(&example::of(units), Vec::new());
        let tolerances = Tolerances::of(&MetricSet::builtin());
        let mut now = units.clone();
        now[3] = example::unit("esm/ssd/homography", "book", &[Some(0.0), Some(9.0)]);
        now.remove(0);
        let then = baseline(&units);
        let xml = junit(&then, &gate(&then, &baseline(&now), &tolerances), &tolerances).unwrap();
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
        for line in &mut other.lines {
            line.subject.protocol = "reinit".to_owned();
        }
        let xml = junit(&then, &gate(&then, &other, &tolerances), &tolerances).unwrap();
        assert!(xml.contains(r#"<testsuite name="comparison""#), "{xml}");
    }
}
