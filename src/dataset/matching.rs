//! Which frame a row of ground truth belongs to: by the frame's name, by number, or in order.
//!
//! Depends on the names of frames and on annotations.

use super::annotation::Annotations;
use super::format::TruthFile;
use super::names::{FrameNames, Numbering};
use super::{DatasetError, DatasetErrorKind};
use std::collections::HashMap;

/// A line that may be a row.
pub(super) trait Line: Copy {
    /// Its number in the file, from 1.
    fn number(&self) -> usize;
    /// There is nothing in it but separators.
    fn is_empty(&self) -> bool;
    /// There is nothing in it, not even separators.
    fn is_blank(&self) -> bool;
}

/// The frame of each row that counts frames: that of this number, else, where the rows count on and are as many as frames,
/// the one in this place.
pub(super) fn by_count(counts: &[u64], names: &FrameNames<'_>) -> Vec<Option<usize>> {
    let numbers = names.numbers().unwrap_or_default();
    let frames: HashMap<u64, usize> = numbers.into_iter().zip(0..).collect();
    let found: Vec<Option<usize>> = counts.iter().map(|n| frames.get(n).copied()).collect();
    let counts_on = counts.windows(2).all(|pair| pair[0] + 1 == pair[1]);
    if counts_on && counts.len() == names.names().len() && found.contains(&None) {
        return (0..counts.len()).map(Some).collect();
    }
    found
}

/// Each of the `lines` that is a row, and its frame, as an index into `frames`; `None` where that is not there. What is wrong but does not make other rows
/// doubtful is a fault.
///
/// # Errors
/// Rows and frames are not as many, and nothing says which belong together.
pub(super) fn in_order<L: Line>(
    lines: &[L],
    file: &TruthFile,
    frames: &[&str],
    annotations: &mut Annotations,
) -> Result<Vec<(L, Option<usize>)>, DatasetError> {
    let numbering = FrameNames::new(frames.iter().copied()).numbers();
    let numbering = numbering.and_then(Numbering::new);
    let candidates = Candidates::new(lines);
    let order = |rows: Vec<L>| rows.into_iter().zip((0..).map(Some)).collect();
    if annotations.asked.rows.is_given() {
        return as_told(&candidates, file, frames, numbering.as_ref(), annotations);
    }
    if let Some((rows, blank)) = candidates.of(frames.len()) {
        let warnings = numbering
            .as_ref()
            .map(|n| irregular(n, frames))
            .unwrap_or_default();
        annotations
            .warnings
            .extend(warnings.into_iter().map(|kind| file.fault(kind)));
        annotations.warnings.extend(blank.map(|kind| file.fault(kind)));
        return Ok(order(rows));
    }
    let rows = &candidates.written;
    let (count, at) = (rows.len(), rows.last().map_or(0, Line::number));
    match &numbering {
        Some(numbering) if numbering.shared.is_some() => {
            let shared = irregular(numbering, frames).swap_remove(0);
            return Err(file.at_line(at).fault(DatasetErrorKind::TwiceTheFrames {
                rows: count,
                frames: frames.len(),
                shared: shared.to_string(),
            }));
        }
        Some(numbering) if !numbering.gaps.is_empty() => {
            let span = numbering.span().and_then(|n| usize::try_from(n).ok());
            if let Some((rows, blank)) = span.and_then(|n| candidates.of(n)) {
                annotations.warnings.extend(blank.map(|kind| file.fault(kind)));
                let number = |k: usize| numbering.numbers[0] + k as u64 * numbering.step;
                return Ok(by_number(rows, number, &numbering.numbers, file, annotations));
            }
        }
        _ => {}
    }
    Err(if count > frames.len() {
        file.at_line(rows[frames.len()].number())
            .fault(DatasetErrorKind::MoreRows {
                rows: count,
                frames: frames.len(),
            })
    } else {
        let first = numbering.as_ref().map_or(1, |n| n.numbers[0]);
        file.at_line(at).fault(DatasetErrorKind::FewerRows {
            rows: count,
            frames: frames.len(),
            hints: hints(count, frames.len(), first, numbering.map_or(1, |n| n.step)),
        })
    })
}

/// Rows with and without those that are blank lines.
struct Candidates<L> {
    /// Without, up to the last one that says something.
    written: Vec<L>,
    /// With blank lines, as far; the same as `written` when there are none.
    spaced: Vec<L>,
    /// Empty rows after that.
    after: Vec<L>,
}

impl<L: Line> Candidates<L> {
    fn new(lines: &[L]) -> Self {
        let first = lines.iter().position(|line| !line.is_blank()).unwrap_or(0);
        let end = lines
            .iter()
            .rposition(|line| !line.is_empty())
            .map_or(0, |last| last + 1);
        let (until, after) = lines.split_at(end);
        let written = |lines: &[L]| -> Vec<L> { lines.iter().copied().filter(|l| !l.is_blank()).collect() };
        // That blank lines are rows shows between others only: at either end they are there by accident.
        let between = until.iter().skip(first).any(Line::is_blank);
        let [spaced, after] =
            [until, after].map(|lines| if between { lines.to_vec() } else { written(lines) });
        Candidates {
            written: written(until),
            spaced,
            after,
        }
    }

    /// So many rows, and a warning where blank lines are among them.
    fn of(&self, count: usize) -> Option<(Vec<L>, Option<DatasetErrorKind>)> {
        if self.written.len() == count {
            return Some((self.written.clone(), None));
        }
        let more = count.checked_sub(self.spaced.len())?;
        Some(with_warning([&self.spaced[..], self.after.get(..more)?].concat()))
    }

    /// The rows of at most `count` frames.
    fn up_to(&self, count: usize) -> (Vec<L>, Option<DatasetErrorKind>) {
        let between = self.spaced.iter().skip(1).step_by(2);
        let double_spaced =
            self.spaced.len() + 1 == 2 * self.written.len() && between.into_iter().all(Line::is_blank);
        self.of(count).unwrap_or_else(|| match double_spaced {
            true => (self.written.clone(), None),
            false => with_warning(self.spaced.clone()),
        })
    }
}

fn with_warning<L: Line>(rows: Vec<L>) -> (Vec<L>, Option<DatasetErrorKind>) {
    let blank = rows.iter().filter(|row| row.is_blank()).count();
    let warning = (blank > 0).then_some(DatasetErrorKind::BlankRows { blank });
    (rows, warning)
}

/// Rows where [`TruthRows`] says.
fn as_told<L: Line>(
    candidates: &Candidates<L>,
    file: &TruthFile,
    frames: &[&str],
    numbering: Option<&Numbering>,
    annotations: &mut Annotations,
) -> Result<Vec<(L, Option<usize>)>, DatasetError> {
    let told = annotations.asked.rows;
    let numbers = match numbering {
        Some(n) if n.shared.is_some() => return Err(file.fault(irregular(n, frames).swap_remove(0))),
        Some(n) => n.numbers.clone(),
        None => (1..=frames.len() as u64).collect(),
    };
    let (first, last) = match &numbers[..] {
        [] => return Ok(vec![]),
        [first, ..] => (*first, numbers[numbers.len() - 1]),
    };
    let (start, step) = (told.start.unwrap_or(first), told.step.unwrap_or(1).max(1));
    // A row of a frame that is lost may be the first.
    if start > last || start + step * (candidates.spaced.len() as u64) <= first {
        let kind = DatasetErrorKind::NoFrameOfNumber { start, first, last };
        return Err(file.fault(kind));
    }
    let places = usize::try_from((last - start) / step + 1).unwrap_or(usize::MAX);
    let (rows, blank) = candidates.up_to(places);
    annotations.warnings.extend(blank.map(|kind| file.fault(kind)));
    let number = |k: usize| start.saturating_add(step.saturating_mul(k as u64));
    Ok(by_number(rows, number, &numbers, file, annotations))
}

/// Row `k` for the frame of number `number(k)`. Rows of frames that are not there are faults.
fn by_number<L: Line>(
    rows: Vec<L>,
    number: impl Fn(usize) -> u64,
    numbers: &[u64],
    file: &TruthFile,
    annotations: &mut Annotations,
) -> Vec<(L, Option<usize>)> {
    let frames: HashMap<u64, usize> = numbers.iter().copied().zip(0..).collect();
    let last = numbers.last().copied().unwrap_or(0);
    let mut placed = Vec::new();
    let (mut lost, mut surplus) = (Vec::new(), Vec::new());
    for (k, row) in rows.into_iter().enumerate() {
        let frame = frames.get(&number(k)).copied();
        placed.push((row, frame));
        match frame {
            Some(_) => {}
            None if number(k) > last => surplus.push(row),
            None => lost.push((row, number(k))),
        }
    }
    if let Some((row, number)) = lost.first() {
        annotations.fault(file.at_line(row.number()).fault(DatasetErrorKind::LostFrame {
            number: *number,
            others: lost.len() - 1,
        }));
    }
    if let Some(row) = surplus.first() {
        let rows = surplus.len();
        annotations.fault(
            file.at_line(row.number())
                .fault(DatasetErrorKind::SurplusRows { rows, last }),
        );
    }
    placed
}

/// What is odd about the numbers of frames.
pub(super) fn irregular(numbering: &Numbering, frames: &[&str]) -> Vec<DatasetErrorKind> {
    let shared = numbering.shared.map(|i| DatasetErrorKind::SharedNumber {
        first: frames[i].to_owned(),
        second: frames[i + 1].to_owned(),
    });
    let gap = numbering.gaps.first().map(|&i| DatasetErrorKind::NumberGap {
        before: frames[i].to_owned(),
        after: frames[i + 1].to_owned(),
        others: numbering.gaps.len() - 1,
    });
    shared.into_iter().chain(gap).collect()
}

/// Which frames so few rows may be for, in words.
fn hints(rows: usize, frames: usize, first: u64, distance: u64) -> String {
    let late = first + (frames - rows) as u64 * distance;
    let step = (2..=frames).find(|step| frames.div_ceil(*step) == rows && rows > 1);
    let step = step.map_or(String::new(), |step| {
        let distance = step as u64 * distance;
        format!(", --truth-step {distance} if for one frame in {step}")
    });
    format!(
        "--truth-start {first} if they are for the first frames, --truth-start {late} if for the last{step}"
    )
}
