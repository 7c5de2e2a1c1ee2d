//! What a run records about data that was not read as it stands.

use crate::dataset::{DatasetError, LeftOut, Remark, Sequence, Severity, Standing};
use serde::{Deserialize, Serialize};

/// Sequences that were left out, repaired or are doubtful, each with its reasons.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DataNotes {
    /// Sequences that are not part of the run because their data is faulty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<DataNote>,
    /// Sequences of which something was left out or made up.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub repaired: Vec<DataNote>,
    /// Sequences of which recorded results lack frames, which count as failures.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<DataNote>,
    /// Sequences that may not be what they are taken for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub doubtful: Vec<DataNote>,
    /// Sequences that were read as they stand, in a way that is worth knowing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub noted: Vec<DataNote>,
}

/// What there is to say about one sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DataNote {
    /// Name of its dataset.
    pub dataset: String,
    /// Its name.
    pub sequence: String,
    /// At least one.
    pub reasons: Vec<String>,
}

impl DataNotes {
    /// About a sequence that is left out.
    pub fn leave_out(&mut self, left_out: &LeftOut) {
        self.left_out.push(DataNote {
            dataset: left_out.dataset.clone(),
            sequence: left_out.sequence.clone(),
            reasons: left_out.reasons.iter().map(ToString::to_string).collect(),
        });
    }

    /// About a sequence of the run and its [remarks](Sequence::remarks).
    pub fn add(&mut self, sequence: &Sequence, remarks: &[(Remark, DatasetError)]) {
        let (mut repaired, mut doubtful, mut noted) = (Vec::new(), Vec::new(), Vec::new());
        for note in sequence.notes() {
            match note.severity {
                Severity::Error => repaired.push(note.to_string()),
                Severity::Warning => noted.push(note.to_string()),
            }
        }
        for (remark, fault) in remarks {
            let list = match remark.standing() {
                Standing::Repaired => &mut repaired,
                Standing::Doubtful => &mut doubtful,
                Standing::AsItSays => &mut noted,
            };
            list.push(fault.to_string());
        }
        let lists = [
            (repaired, &mut self.repaired),
            (doubtful, &mut self.doubtful),
            (noted, &mut self.noted),
        ];
        for (reasons, list) in lists.into_iter().filter(|(reasons, _)| !reasons.is_empty()) {
            list.push(DataNote {
                dataset: sequence.dataset().to_owned(),
                sequence: sequence.name().to_owned(),
                reasons,
            });
        }
    }

    /// With what is known of another run's data, each note once.
    pub(super) fn join(&mut self, other: &DataNotes) {
        for (list, more) in [
            (&mut self.left_out, &other.left_out),
            (&mut self.repaired, &other.repaired),
            (&mut self.doubtful, &other.doubtful),
            (&mut self.noted, &other.noted),
        ] {
            let new = more.iter().filter(|note| !list.contains(note));
            let new: Vec<DataNote> = new.cloned().collect();
            list.extend(new);
            list.sort_by(|a, b| (&a.dataset, &a.sequence).cmp(&(&b.dataset, &b.sequence)));
        }
    }

    /// What stands below each table of the run; `None` when all data was read as it stands.
    pub fn line(&self) -> Option<String> {
        let part = |notes: &[DataNote], what: &str| {
            let first = notes.first()?;
            let reason = first.reasons.first()?;
            let plural = if notes.len() == 1 { "" } else { "s" };
            let more = if notes.len() == 1 { "" } else { ", ..." };
            let id = format!("{}/{}", first.dataset, first.sequence);
            Some(format!(
                "{} sequence{plural} {what} ({id}: {reason}{more})",
                notes.len()
            ))
        };
        let parts = [
            part(&self.left_out, "left out"),
            part(&self.repaired, "repaired"),
            part(&self.doubtful, "doubtful"),
            part(
                &self.missing,
                "with frames that have no result and count as failures",
            ),
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        (!parts.is_empty()).then(|| format!("data: {}; run.json has all", parts.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_counts_and_gives_a_reason() {
        let note = |sequence: &str| DataNote {
            dataset: "d".into(),
            sequence: sequence.into(),
            reasons: vec!["d/x: bad".into(), "d/y: worse".into()],
        };
        let mut notes = DataNotes {
            noted: vec![note("n")],
            ..DataNotes::default()
        };
        assert_eq!(notes.line(), None);
        notes.left_out = vec![note("a"), note("b")];
        notes.repaired = vec![note("c")];
        let line = "data: 2 sequences left out (d/a: d/x: bad, ...), 1 sequence repaired (d/c: d/x: bad); run.json has all";
        assert_eq!(notes.line().as_deref(), Some(line));
    }
}
