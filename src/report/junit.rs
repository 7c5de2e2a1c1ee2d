//! The regression gate's findings as JUnit XML, which every CI service shows: a test suite per tracker, a test case per
//! sequence and for the pooled figures.

use super::ReportError;
use super::problems::{Kind, problems};
use crate::judge::baseline::Baseline;
use crate::judge::cases::Case;
use crate::judge::change::Subject;
use crate::judge::gate::Findings;
use crate::judge::tolerances::Tolerances;
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// The report on a run against `baseline`, with the times and frames of `cases`. A value that dropped or a tracker that failed
/// to run is a failure, its message naming the frames; what is missing or not comparable is an error; what is over other
/// frames or not in the baseline is skipped, unless no difference passes.
///
/// # Errors
/// The XML cannot be written.
pub fn junit(
    baseline: &Baseline,
    findings: &Findings,
    tolerances: &Tolerances,
    cases: &BTreeMap<Subject, Case>,
) -> Result<String, ReportError> {
    let problems = problems(findings, tolerances, cases);
    let named: BTreeSet<&str> = findings.other_settings.iter().map(|o| o.after.as_str()).collect();
    let unjudged: BTreeSet<&Subject> = findings.unjudged.iter().map(|f| &f.subject).collect();
    let status = |subject: &Subject| {
        if let Some(found) = problems.get(subject) {
            let kind = match found.kind {
                Kind::Missing => NonSuccessKind::Error,
                Kind::Drop | Kind::Failed | Kind::Added => NonSuccessKind::Failure,
            };
            problem(kind, found.kind.word(), found.message.clone())
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
        .map(|subject| match problems.contains_key(subject) {
            true => (subject, status(subject)),
            false => (subject, skipped("not in the baseline")),
        });
    let mut suites: BTreeMap<&str, TestSuite> = BTreeMap::new();
    let mut times: BTreeMap<&str, Duration> = BTreeMap::new();
    for (subject, status) in lines.chain(added) {
        let mut case = TestCase::new(subject.place(), status);
        case.set_classname(subject.tracker.clone());
        let known = cases.get(subject);
        if let Some(time) = known.and_then(|case| Duration::try_from_secs_f64(case.seconds).ok()) {
            case.set_time(time);
            *times.entry(&subject.tracker).or_default() += time;
        }
        let suite = suites
            .entry(&subject.tracker)
            .or_insert_with(|| TestSuite::new(subject.tracker.clone()));
        suite.add_test_case(case);
    }
    for (tracker, time) in &times {
        if let Some(suite) = suites.get_mut(tracker) {
            suite.set_time(*time);
        }
    }
    let mut report = Report::new("mtf-eval check");
    if !times.is_empty() {
        report.set_time(times.values().sum());
    }
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
        let findings = gate(&then, &baseline(&now), &tolerances);
        let dropped = findings
            .drops
            .iter()
            .map(|d| d.subject.clone())
            .find(|s| !s.is_pooled())
            .unwrap();
        let case = Case {
            seconds: 0.25,
            frames: vec![(1, 0.0), (2, 9.0)],
            ..Case::default()
        };
        let cases = BTreeMap::from([(dropped, case)]);
        let xml = junit(&then, &findings, &tolerances, &cases).unwrap();
        assert!(
            xml.contains(r#"tests="8" skipped="1" failures="2" errors="1""#),
            "{xml}"
        );
        for part in [
            r#"<testsuite name="iclk/ssd/affine" tests="3" skipped="1""#,
            r#"<testcase name="builtin/book" classname="esm/ssd/homography" time="0.250">"#,
            "first frame above 5 px: 2, 1 of 2 in all; worst frames: 2 (9.0 px), 1 (0.0 px)",
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
        let xml = junit(&then, &gate(&then, &other, &tolerances), &tolerances, &cases).unwrap();
        assert!(xml.contains(r#"<testsuite name="comparison""#), "{xml}");
    }
}
