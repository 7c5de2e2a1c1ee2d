//! Dense ground truth, `groundtruth_grid.csv`: a row per frame, its file name (or its number, from 0), then `x,y` of every
//! point of a grid on the object, px. A header line is optional.

use super::annotation::{Annotations, is_near};
use super::format::TruthFile;
use super::storage::{File, Folder};
use super::{DatasetError, DatasetErrorKind, rows};
use std::collections::HashMap;

/// File in a sequence's folder with dense ground truth.
pub const DENSE_FILE: &str = "groundtruth_grid.csv";

/// Adds the dense truth of `frames`, when `folder` has any; faulty rows are left out and reported.
///
/// # Errors
/// The file cannot be read.
pub(super) fn read(
    folder: &Folder,
    frames: &[File],
    annotations: &mut Annotations,
) -> Result<(), DatasetError> {
    if let Some(file) = folder.file(DENSE_FILE) {
        let names: Vec<&str> = frames.iter().map(File::name).collect();
        parse(&TruthFile::read(&file)?, &names, annotations);
    }
    Ok(())
}

fn parse(file: &TruthFile, frames: &[&str], annotations: &mut Annotations) {
    let index: HashMap<&str, usize> = frames.iter().enumerate().map(|(i, name)| (*name, i)).collect();
    let mut count = None;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(file.bytes());
    for (k, record) in reader.records().enumerate() {
        let Ok(record) = record else {
            annotations.fault(file.fault(DatasetErrorKind::NotText));
            return;
        };
        let name = &record[0];
        let line = record.position().map_or(k + 1, |p| p.line() as usize);
        let fault = |kind| file.at_line(line).fault(kind);
        let by_number = || name.parse().ok().filter(|&i: &usize| i < frames.len());
        let Some(i) = index.get(name).copied().or_else(by_number) else {
            // The first line may say what the columns are.
            if k > 0 || record.iter().any(|word| word.parse::<f64>().is_ok()) {
                annotations.fault(fault(DatasetErrorKind::UnknownFrame { frame: name.into() }));
            }
            continue;
        };
        if annotations.frames()[i].dense.is_some() {
            annotations.fault(fault(DatasetErrorKind::DuplicateRow { frame: name.into() }));
            continue;
        }
        match points(&record, count) {
            Ok(points) => {
                count = Some(2 * points.len());
                annotations.set_dense(i, points);
            }
            Err(kind) => annotations.fault(fault(kind)),
        }
    }
}

fn points(record: &csv::StringRecord, count: Option<usize>) -> Result<Box<[[f64; 2]]>, DatasetErrorKind> {
    let found = record.len() - 1;
    let expected = count.unwrap_or_else(|| found.next_multiple_of(2).max(2));
    let words: Vec<&str> = record.iter().skip(1).collect();
    let numbers = rows::numbers(&words, expected)?;
    if numbers.iter().any(|v| !v.is_finite()) {
        return Err(DatasetErrorKind::NotFinite);
    }
    let points: Box<[[f64; 2]]> = numbers.chunks_exact(2).map(|c| [c[0], c[1]]).collect();
    if !points.iter().all(is_near) {
        return Err(DatasetErrorKind::TooFar);
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &[u8]) -> (Annotations, Vec<String>) {
        let mut annotations = Annotations::new(3);
        let file = TruthFile::of("g", text.to_vec());
        parse(&file, &["a.png", "b.png", "c.png"], &mut annotations);
        let faults = annotations.faults().iter().map(ToString::to_string).collect();
        (annotations, faults)
    }

    #[test]
    fn rows_follow_names_or_numbers() {
        let (annotations, faults) = read(b"frame,x1,y1,x2,y2\nb.png,1,2,3,4.5\n0,5,6,7,8\n");
        assert!(faults.is_empty(), "{faults:?}");
        let points = |k: usize| annotations.frames()[k].dense.as_deref();
        assert_eq!(points(0), Some(&[[5.0, 6.0], [7.0, 8.0]][..]));
        assert_eq!(points(1), Some(&[[1.0, 2.0], [3.0, 4.5]][..]));
        assert_eq!(points(2), None);
    }

    #[test]
    fn each_fault_is_told_with_its_line() {
        for (text, start) in [
            ("a.png,1,2,3,4\nb.png,1,2,3\n", "g:2: 3 numbers instead of 4"),
            ("a.png,1,2,3\n", "g:1: 3 numbers instead of 4"),
            ("a.png\n", "g:1: 0 numbers instead of 2"),
            ("a.png,1,x\n", "g:1: `x` is not a number"),
            ("a.png,1,nan\n", "g:1: a coordinate is not finite"),
            ("a.png,1,-1e12\n", "g:1: a coordinate is beyond 1000000 px"),
            ("a.png,1,2\na.png,1,2\n", "g:2: a second row for frame `a.png`"),
            ("z.png,1,2\n", "g:1: there is no frame `z.png`"),
            ("7,1,2\n", "g:1: there is no frame `7`"),
        ] {
            let (_, faults) = read(text.as_bytes());
            assert_eq!(faults.len(), 1, "{text}: {faults:?}");
            assert!(faults[0].starts_with(start), "{faults:?}");
        }
        assert_eq!(read(b"\xff\xfe").1.len(), 1);
    }
}
