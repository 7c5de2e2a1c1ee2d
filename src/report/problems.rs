//! What stands against a run in the regression gate, a tracker on a sequence at a time: what the reports for CI services are
//! made of.

use crate::judge::cases::Case;
use crate::judge::change::Subject;
use crate::judge::gate::{Finding, Findings};
use crate::judge::tolerances::Tolerances;
use std::collections::{BTreeMap, BTreeSet};

/// Error above which a frame is named as one that went wrong, px: the threshold of the success rate that is gated.
const FAR_PX: f64 = 5.0;
/// Frames named, the worst.
const WORST: usize = 3;

/// What kind of problem it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A value got worse by more than its tolerance, or differs where nothing may.
    Drop,
    /// The tracker failed to run.
    Failed,
    /// The run does not have it.
    Missing,
    /// The baseline does not have it, where nothing may differ.
    Added,
}

impl Kind {
    /// One word for machines.
    pub fn word(self) -> &'static str {
        match self {
            Kind::Drop => "drop",
            Kind::Failed => "failed",
            Kind::Missing => "missing",
            Kind::Added => "not in the baseline",
        }
    }
}

/// What stands against a tracker on a sequence.
pub(super) struct Problem {
    pub kind: Kind,
    pub message: String,
}

/// The problems by subject.
pub(super) fn problems<'a>(
    findings: &'a Findings,
    tolerances: &Tolerances,
    cases: &BTreeMap<Subject, Case>,
) -> BTreeMap<&'a Subject, Problem> {
    let mut found = BTreeMap::new();
    let mut put = |subject: &'a Subject, kind, message: String| {
        found.entry(subject).or_insert(Problem { kind, message });
    };
    let other_settings: BTreeMap<&str, &str> = findings
        .other_settings
        .iter()
        .map(|o| (o.before.as_str(), o.difference.as_str()))
        .collect();
    for subject in &findings.missing {
        let why = other_settings.get(subject.tracker.as_str());
        let why = why.map(|difference| format!("run with other settings, {difference}"));
        put(
            subject,
            Kind::Missing,
            why.unwrap_or_else(|| "not in the run".to_owned()),
        );
    }
    for subject in &findings.failed {
        let reason = cases.get(subject).and_then(|case| case.reason.as_deref());
        let why = reason.map_or(String::new(), |reason| format!(": {reason}"));
        put(subject, Kind::Failed, format!("the tracker failed to run{why}"));
    }
    let mut drops: BTreeMap<&Subject, Vec<String>> = BTreeMap::new();
    for finding in failing(findings) {
        let Finding { subject, change } = finding;
        let tolerance = match findings.exact {
            true => "exact".to_owned(),
            false => format!("tolerance {}", tolerances.at(subject, &change.figure)),
        };
        let line = format!(
            "{} {:.4} -> {:.4} ({tolerance})",
            change.figure, change.before, change.after
        );
        drops.entry(subject).or_default().push(line);
    }
    for (subject, mut lines) in drops {
        lines.extend(cases.get(subject).and_then(|case| far_frames(&case.frames)));
        put(subject, Kind::Drop, lines.join("; "));
    }
    if findings.exact {
        let renamed: BTreeSet<&str> = findings.other_settings.iter().map(|o| o.after.as_str()).collect();
        for subject in findings
            .added
            .iter()
            .filter(|s| !renamed.contains(s.tracker.as_str()))
        {
            put(subject, Kind::Added, "not in the baseline".to_owned());
        }
    }
    found
}

/// Values that fail: what got worse, and every other one that differs where nothing may.
fn failing(findings: &Findings) -> impl Iterator<Item = &Finding> {
    let others = findings.improved.iter().chain(&findings.unjudged);
    findings.drops.iter().chain(others.filter(|_| findings.exact))
}

/// Subjects whose frames a report names.
pub fn with_frames(findings: &Findings) -> BTreeSet<&Subject> {
    failing(findings)
        .map(|finding| &finding.subject)
        .filter(|subject| !subject.is_pooled())
        .collect()
}

/// The first frame that went wrong, how many did, and the worst with their errors. `None` without frames.
fn far_frames(frames: &[(usize, f64)]) -> Option<String> {
    let error = |error: f64| match error.is_infinite() {
        true => "no output".to_owned(),
        false => format!("{error:.1} px"),
    };
    let mut worst: Vec<&(usize, f64)> = frames.iter().collect();
    worst.sort_by(|x, y| y.1.total_cmp(&x.1).then(x.0.cmp(&y.0)));
    worst.truncate(WORST);
    let worst: Vec<String> = worst
        .iter()
        .map(|(frame, e)| format!("{frame} ({})", error(*e)))
        .collect();
    let far = || frames.iter().filter(|(_, e)| *e > FAR_PX);
    let first = match far().next() {
        None if frames.is_empty() => return None,
        None => format!("no frame above {FAR_PX} px"),
        Some((frame, _)) => {
            format!(
                "first frame above {FAR_PX} px: {frame}, {} of {} in all",
                far().count(),
                frames.len()
            )
        }
    };
    Some(format!("{first}; worst frames: {}", worst.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_went_wrong_are_named() {
        let frames = [(1, 0.5), (2, 5.5), (3, f64::INFINITY), (4, 7.25), (6, 31.0)];
        assert_eq!(
            far_frames(&frames).unwrap(),
            "first frame above 5 px: 2, 4 of 5 in all; worst frames: 3 (no output), 6 (31.0 px), 4 (7.2 px)"
        );
        assert_eq!(
            far_frames(&frames[..1]).unwrap(),
            "no frame above 5 px; worst frames: 1 (0.5 px)"
        );
        assert_eq!(far_frames(&[]), None);
    }
}
