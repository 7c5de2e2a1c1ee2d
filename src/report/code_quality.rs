//! The regression gate's findings as a code quality report of GitLab: a JSON array of issues, each at the line of the
//! baseline that it is about (<https://docs.gitlab.com/ci/testing/code_quality/>).

use super::json_text;
use super::problems::{Kind, problems};
use crate::judge::cases::Case;
use crate::judge::change::Subject;
use crate::judge::gate::Findings;
use crate::judge::tolerances::Tolerances;
use crate::store::rundir::digest;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The report on findings against the baseline that the repository has at `path`, of which `text` is the content.
pub fn code_quality(
    path: &str,
    text: &str,
    findings: &Findings,
    tolerances: &Tolerances,
    cases: &BTreeMap<Subject, Case>,
) -> String {
    let lines = lines(text);
    let issue = |name: &str, severity: &str, about: &str, description: String, line: usize| -> Value {
        // The same as long as the problem is, whatever its numbers are.
        let fingerprint = digest(format!("{name}\n{about}").as_bytes());
        json!({
            "description": description,
            "check_name": format!("mtf-eval/{name}"),
            "fingerprint": fingerprint,
            "severity": severity,
            "location": { "path": path, "lines": { "begin": line } },
        })
    };
    let mut issues: Vec<Value> = findings
        .not_comparable
        .iter()
        .map(|reason| {
            issue(
                "not-comparable",
                "blocker",
                reason,
                format!("not comparable: {reason}"),
                1,
            )
        })
        .collect();
    for (subject, problem) in problems(findings, tolerances, cases) {
        let (name, severity) = match problem.kind {
            Kind::Drop => ("drop", "major"),
            Kind::Failed => ("failed", "critical"),
            Kind::Missing => ("missing", "critical"),
            Kind::Added => ("added", "minor"),
        };
        let Subject {
            tracker, protocol, ..
        } = subject;
        let about = format!("{tracker}\n{}\n{protocol}", subject.place());
        let description = format!("{tracker} on {}: {}", subject.place(), problem.message);
        let line = lines.get(subject).copied().unwrap_or(1);
        issues.push(issue(name, severity, &about, description, line));
    }
    json_text(&issues, true)
}

/// The number of the line, from 1, that holds each subject; those of a file that was laid out anew are unknown.
fn lines(text: &str) -> BTreeMap<Subject, usize> {
    let subject = |line: &str| serde_json::from_str::<Subject>(line.trim().trim_end_matches(',')).ok();
    (1..)
        .zip(text.lines())
        .filter_map(|(number, line)| Some((subject(line)?, number)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::baseline::Baseline;
    use crate::judge::gate::gate;
    use crate::metric::MetricSet;
    use crate::metric::aggregate::example;

    #[test]
    fn issues_stand_at_the_line_they_are_about() {
        let units = example::units();
        let baseline = |units: &[_]| Baseline::new(&example::of(units), Vec::new());
        let mut now = units.clone();
        now[3] = example::unit("esm/ssd/homography", "book", &[Some(0.0), Some(9.0)]);
        now.remove(0);
        let (then, tolerances) = (baseline(&units), Tolerances::of(&MetricSet::builtin()));
        let (text, findings) = (then.to_json(), gate(&then, &baseline(&now), &tolerances));
        let issues = |findings: &Findings| -> Vec<Value> {
            let report = code_quality("ci/base.json", &text, findings, &tolerances, &BTreeMap::new());
            serde_json::from_str(&report).unwrap()
        };
        let found = issues(&findings);
        let about = |what: &str| {
            let mut of = found
                .iter()
                .filter(|i| i["description"].as_str().unwrap().starts_with(what));
            of.next().unwrap_or_else(|| panic!("{what}: {found:#?}"))
        };
        let drop = about("esm/ssd/homography on builtin/book: ");
        let description = drop["description"].as_str().unwrap();
        assert!(description.contains("sr_5 1.0000 -> 0.5000"), "{description}");
        assert_eq!(
            (&drop["check_name"], &drop["severity"]),
            (&"mtf-eval/drop".into(), &"major".into())
        );
        assert_eq!(drop["location"]["path"], "ci/base.json");
        let line = drop["location"]["lines"]["begin"].as_u64().unwrap() as usize;
        let line = text.lines().nth(line - 1).unwrap();
        assert!(
            line.contains("\"esm/ssd/homography\"") && line.contains("\"book\""),
            "{line}"
        );
        assert_eq!(
            found.iter().filter(|i| i["severity"] == "critical").count(),
            findings.missing.len()
        );
        let prints: std::collections::BTreeSet<String> =
            found.iter().map(|i| i["fingerprint"].to_string()).collect();
        assert_eq!(prints.len(), found.len());
        assert!(issues(&Findings::default()).is_empty());
    }
}
