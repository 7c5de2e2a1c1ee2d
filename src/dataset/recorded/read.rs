//! Reads a file of results as what a tracker said of each frame.

use super::super::annotation::{Annotations, Location, Region};
use super::super::storage::File;
use super::super::{DatasetError, DatasetErrorKind, Origin, Sequence, TruthFile, rows, text};
use super::log::{is_log, logged_frames};
use super::trajectory::{self, Code};
use super::{Answer, Direction, RecordedOptions, Track};
use crate::files;
use mtf::geom::{Corners, Mat3, homography};
use std::collections::HashMap;

/// A first row this near to the truth of the first frame, px, is the region that the tracker was started on: it is copied
/// from there, with few decimals perhaps. The least motion between two frames of a sequence is hardly ever so small.
const SAME: f64 = 0.02;

/// What `file` says of `sequence`.
pub(super) fn track(
    file: &File,
    sequence: &Sequence,
    options: &RecordedOptions,
) -> Result<Track, DatasetError> {
    let fault = |kind| DatasetError::new(file.path(), kind);
    let bytes = files::unpack(file.read()?.into_owned())
        .map_err(|reason| fault(DatasetErrorKind::Packed { reason }))?;
    let content = TruthFile::new(file, bytes);
    let text = match trajectory::text_of(&content) {
        Some(text) => text.map_err(fault)?,
        None => content.text()?.into_owned(),
    };
    if is_log(&text) {
        return frame_log(file, &text, sequence);
    }
    let (text, codes) = trajectory::without_codes(&text);
    let restarted = codes
        .iter()
        .find(|(row, code)| *code == Code::Failed || *row > 0 && *code == Code::Started);
    if let Some((row, _)) = restarted {
        return Err(DatasetError::at_line(
            file.path(),
            row + 1,
            DatasetErrorKind::Restarted,
        ));
    }
    let content = TruthFile::new(file, text.into_bytes());
    let Placed {
        annotations,
        mut notes,
    } = match options.homographies {
        Some(direction) => homographies(&content, sequence, options, direction)?,
        None => regions(&content, sequence, options)?,
    };
    let answers: Vec<Answer> = annotations
        .frames()
        .iter()
        .map(|frame| answer(&frame.region))
        .collect();
    let boxes = annotations.boxes();
    let origin = annotations.origin();
    if let Some(form) = boxes {
        notes.push(format!(
            "boxes, read as {form} with the first pixel's centre at {origin}"
        ));
    } else if origin != Origin::CENTRE {
        notes.push(format!("read with the first pixel's centre at {origin}"));
    }
    let beside = |endings: &[&str]| numbers_beside(file, endings, sequence, &answers);
    Ok(Track {
        path: Some(file.path().to_path_buf()),
        confidence: beside(&["_confidence.value", "_confidence.txt", "_score.txt"]),
        seconds: beside(&["_time.value", "_time.txt"]),
        boxes: boxes.is_some(),
        answers,
        notes,
    })
}

fn answer(region: &Region) -> Answer {
    match region {
        Region::Corners(corners) => Answer::Corners(*corners),
        Region::Absent => Answer::Absent(None),
        Region::Unknown => Answer::Missing,
    }
}

/// Rows with the frames that they are for.
struct Placed {
    annotations: Annotations,
    notes: Vec<String>,
}

/// Regions of the frames that rows of corners or boxes are for.
fn regions(
    content: &TruthFile,
    sequence: &Sequence,
    options: &RecordedOptions,
) -> Result<Placed, DatasetError> {
    let mut reading = options.reading;
    // Results of a benchmark come as its truth does.
    let usual = sequence.origin() == Origin::CENTRE && sequence.boxes().is_none();
    reading.origin = reading.origin.or((!usual).then_some(sequence.origin()));
    reading.boxes = reading.boxes.or(sequence.boxes());
    reading.rows = Default::default();
    let text = content.text()?;
    let first = text::lines(&text)
        .zip(1..)
        .find(|(line, _)| text::words(line).next().is_some());
    let matrix = |(line, _): &(&str, usize)| {
        numbers(line).is_some_and(|n| n.len() == 9 && n[8] == 1.0 || n.len() == 3)
    };
    if let Some((_, line)) = first.filter(|line| matrix(line) && !counts(&text)) {
        return Err(content.at_line(line).fault(DatasetErrorKind::Homographies));
    }
    place(
        content,
        sequence,
        options,
        &|frames, annotations: &mut Annotations| {
            annotations.ask(reading);
            rows::read(content, rows::ANY, frames.iter().copied(), annotations)
        },
    )
}

/// The numbers of a line, if there is nothing else in it.
fn numbers(line: &str) -> Option<Vec<f64>> {
    text::words(line).map(|word| word.parse().ok()).collect()
}

/// Whether the first number of each line is larger than that of the line before: it counts frames.
fn counts(text: &str) -> bool {
    let first = text::lines(text).filter_map(|line| text::words(line).next()?.parse::<f64>().ok());
    let first: Vec<f64> = first.collect();
    first.len() > 1 && first.windows(2).all(|pair| pair[0] < pair[1])
}

/// The first corners moved by the homography of each row: nine numbers, row by row, or three lines of three.
fn homographies(
    content: &TruthFile,
    sequence: &Sequence,
    options: &RecordedOptions,
    direction: Direction,
) -> Result<Placed, DatasetError> {
    let first = (0..sequence.len()).find_map(|i| sequence.truth(i));
    let first = first.ok_or_else(|| {
        content.fault(DatasetErrorKind::NoInitialTruth {
            frame: sequence.frame_name(0).into(),
        })
    })?;
    let text = content.text()?;
    let mut matrices: Vec<(usize, Vec<f64>)> = Vec::new();
    for (line, k) in text::lines(&text).zip(1..) {
        let words: Vec<&str> = text::words(line).collect();
        let numbers: Vec<f64> = words.iter().filter_map(|word| word.parse().ok()).collect();
        match (numbers.len(), matrices.last_mut()) {
            (0, _) => {}
            (3, Some((_, begun))) if begun.len() < 9 => begun.extend(numbers),
            (3 | 9, _) => matrices.push((k, numbers)),
            // The number or name of the frame comes first.
            (10, _) => matrices.push((k, numbers[1..].to_vec())),
            (found, _) => {
                let kind = DatasetErrorKind::WrongCount { found, expected: 9 };
                return Err(content.at_line(k).fault(kind));
            }
        }
    }
    place(
        content,
        sequence,
        options,
        &|frames, annotations: &mut Annotations| {
            check_count(matrices.len(), frames.len(), content)?;
            for ((line, numbers), (index, _)) in matrices.iter().zip(frames) {
                let location = content.at_line(*line);
                let region = moved(&first, numbers, direction);
                annotations.set(
                    *index,
                    location,
                    region.map_or(Ok(Region::Unknown), |c| Ok(Region::Corners(c))),
                );
            }
            Ok(())
        },
    )
}

/// `corners` moved by a homography of nine numbers; `None` for numbers that are none.
fn moved(corners: &Corners, numbers: &[f64], direction: Direction) -> Option<Corners> {
    let matrix = (numbers.len() == 9).then(|| Mat3::from_row_slice(numbers))?;
    let matrix = match direction {
        Direction::FromFirst => matrix,
        Direction::ToFirst => matrix.try_inverse()?,
    };
    Some(homography::apply_corners(&matrix, corners)).filter(Corners::is_finite)
}

fn check_count(rows: usize, frames: usize, content: &TruthFile) -> Result<(), DatasetError> {
    let kind = match rows.cmp(&frames) {
        std::cmp::Ordering::Equal => return Ok(()),
        std::cmp::Ordering::Less => DatasetErrorKind::FewerRows {
            rows,
            frames,
            hints: String::new(),
        },
        std::cmp::Ordering::Greater => DatasetErrorKind::MoreRows { rows, frames },
    };
    Err(content.fault(kind))
}

/// Frames with their indices, of which the annotations are wanted.
type Frames<'a> = [(usize, &'a File)];

/// Finds the frames that the rows of `content` are for: all of the video or those of the selection; where there are fewer
/// rows, the first of these, or those after the first. `read` reads the rows for as many frames.
fn place(
    content: &TruthFile,
    sequence: &Sequence,
    options: &RecordedOptions,
    read: &dyn Fn(&Frames<'_>, &mut Annotations) -> Result<(), DatasetError>,
) -> Result<Placed, DatasetError> {
    let count = sequence.len();
    let chosen: Vec<&File> = (0..count).map(|i| sequence.frame(i)).collect();
    let attempt = |files: &[&File], from: usize, len: usize| {
        let frames: Vec<(usize, &File)> = files.iter().copied().enumerate().skip(from).take(len).collect();
        let mut annotations = Annotations::of_results(files.len());
        read(&frames, &mut annotations).map(|()| annotations)
    };
    let mut notes = Vec::new();
    let first = match options.first_included {
        Some(false) => 1,
        _ => 0,
    };
    let all = sequence.all_frames();
    if all.len() != count {
        match attempt(&all, first, all.len()) {
            Ok(mut whole) => {
                whole.select((0..count).map(|i| sequence.index(i)));
                notes.push(format!(
                    "rows for all {} frames of the video, of which {count} count",
                    all.len()
                ));
                return finish(whole, notes, content);
            }
            Err(error) if !is_count(&error.kind) => return Err(error),
            Err(_) => {}
        }
    }
    let error = match attempt(&chosen, first, count) {
        Ok(annotations) => return finish(annotations, notes, content),
        Err(error) => error,
    };
    let rows = match error.kind {
        DatasetErrorKind::FewerRows { rows, .. } => rows,
        DatasetErrorKind::MoreRows { rows, frames } => {
            return Err(content.fault(DatasetErrorKind::MoreResults { rows, frames }));
        }
        _ => return Err(error),
    };
    if first == 1 {
        return finish(attempt(&chosen, 1, rows)?, notes, content);
    }
    let annotations = attempt(&chosen, 0, rows)?;
    let included = options.first_included.is_some() || {
        let (told, truth) = (annotations.frames()[0].corners(), sequence.truth(0));
        told.zip(truth).is_some_and(|(told, truth)| {
            let near = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).abs().max((a[1] - b[1]).abs()) <= SAME;
            let hull = if annotations.boxes().is_some() {
                hull(&truth)
            } else {
                truth
            };
            told.0.iter().zip(&hull.0).all(near)
        })
    };
    if !included {
        let kind = DatasetErrorKind::FirstFrame { rows, frames: count };
        return Err(content.fault(kind));
    }
    finish(annotations, notes, content)
}

/// The upright box around `corners`.
fn hull(corners: &Corners) -> Corners {
    let side =
        |k: usize, from: f64, pick: fn(f64, f64) -> f64| corners.0.iter().map(|c| c[k]).fold(from, pick);
    let [x, y] = [0, 1].map(|k| side(k, f64::INFINITY, f64::min));
    let [right, below] = [0, 1].map(|k| side(k, f64::NEG_INFINITY, f64::max));
    Corners::rect(x, y, right - x, below - y)
}

fn is_count(kind: &DatasetErrorKind) -> bool {
    matches!(
        kind,
        DatasetErrorKind::FewerRows { .. } | DatasetErrorKind::MoreRows { .. }
    )
}

/// What cannot be read is an error; rows and frames that lack their counterpart are told.
fn finish(
    mut annotations: Annotations,
    mut notes: Vec<String>,
    content: &TruthFile,
) -> Result<Placed, DatasetError> {
    let mut strangers = 0;
    for fault in annotations.take_faults() {
        match fault.kind {
            DatasetErrorKind::MissingRow { .. } => {}
            DatasetErrorKind::UnknownFrame { .. } => strangers += 1,
            _ => return Err(fault),
        }
    }
    if strangers == annotations.frames().len() || annotations.frames().iter().all(|f| f.location.is_none()) {
        let (rows, frames) = (strangers, annotations.frames().len());
        return Err(content.fault(DatasetErrorKind::OtherFrames { rows, frames }));
    }
    if strangers > 0 {
        notes.push(format!("{strangers} rows are for other frames"));
    }
    Ok(Placed { annotations, notes })
}

/// One number per row in a file beside `file`, brought to the frames of its rows; empty where there is none, or not as many.
fn numbers_beside(file: &File, endings: &[&str], sequence: &Sequence, answers: &[Answer]) -> Vec<f64> {
    let stem = file.name().rsplit_once('.').map_or(file.name(), |(stem, _)| stem);
    let beside = endings
        .iter()
        .find_map(|ending| file.beside(&format!("{stem}{ending}")));
    let Some(text) = beside.and_then(|file| TruthFile::read(&file).ok()) else {
        return Vec::new();
    };
    let Ok(text) = text.text() else {
        return Vec::new();
    };
    let words = text::words(&text);
    let numbers: Vec<f64> = words.map(|word| word.parse().unwrap_or(f64::NAN)).collect();
    let whole = sequence.all_frames().len();
    match numbers.len() {
        n if n == answers.len() => numbers,
        n if n == whole => (0..answers.len()).map(|i| numbers[sequence.index(i)]).collect(),
        _ => Vec::new(),
    }
}

/// A frame log of this program.
fn frame_log(file: &File, text: &str, sequence: &Sequence) -> Result<Track, DatasetError> {
    let fault = |line: usize, reason: String| {
        Location::line(file.path(), line).fault(DatasetErrorKind::FrameLog { reason })
    };
    let indices: HashMap<&str, usize> = (0..sequence.len()).map(|i| (sequence.frame_name(i), i)).collect();
    let mut track = Track {
        path: Some(file.path().to_path_buf()),
        confidence: vec![f64::NAN; sequence.len()],
        ..Track::nothing(sequence.len())
    };
    let frames = logged_frames(text.as_bytes()).map_err(|e| fault(e.line, e.reason))?;
    let mut strangers = 0;
    for (logged, line) in frames.iter().zip(2..) {
        let Some(&i) = indices.get(logged.file.as_str()) else {
            strangers += 1;
            continue;
        };
        track.answers[i] = match (logged.status.as_str(), logged.corners) {
            ("failed" | "skipped" | "broken", _) => {
                return Err(fault(line, "restarted after failures, not one pass".into()));
            }
            ("absent", corners) => Answer::Absent(corners),
            (_, None) => Answer::Missing,
            (_, Some(corners)) => Answer::Corners(corners),
        };
        track.confidence[i] = logged.similarity;
    }
    if strangers > 0 {
        track.notes.push(format!("{strangers} rows are for other frames"));
    }
    Ok(track)
}
