//! Dense ground truth, `groundtruth_grid.csv`: a row per frame, its file name (or its number, from 0), then `x,y` of every
//! point of a grid on the object, px. A header line is optional.

use super::{DatasetError, DatasetErrorKind};
use std::collections::HashMap;
use std::path::Path;

/// File in a sequence's folder with dense ground truth.
pub const GRID_FILE: &str = "groundtruth_grid.csv";

/// Points of each frame; `None` where there is no row.
pub(super) type Grid = Vec<Option<Box<[[f64; 2]]>>>;

/// Reads `bytes` of the file `path` as dense truth of the frames called `frames`; faulty rows are left out and reported.
pub(super) fn parse(bytes: &[u8], path: &Path, frames: &[&str], faults: &mut Vec<DatasetError>) -> Grid {
    let index: HashMap<&str, usize> = frames.iter().enumerate().map(|(i, name)| (*name, i)).collect();
    let mut grid = Grid::new();
    grid.resize_with(frames.len(), || None);
    let mut count = None;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(bytes);
    for (k, record) in reader.records().enumerate() {
        let Ok(record) = record else {
            faults.push(DatasetError::new(path, DatasetErrorKind::NotText));
            return grid;
        };
        let name = &record[0];
        let line = record.position().map_or(k + 1, |p| p.line() as usize);
        let mut fault = |kind| faults.push(DatasetError::at_line(path, line, kind));
        let by_number = || name.parse().ok().filter(|&i: &usize| i < frames.len());
        let Some(i) = index.get(name).copied().or_else(by_number) else {
            // The first line may say what the columns are.
            if k > 0 || record.iter().any(|word| word.parse::<f64>().is_ok()) {
                fault(DatasetErrorKind::UnknownFrame { frame: name.into() });
            }
            continue;
        };
        if grid[i].is_some() {
            fault(DatasetErrorKind::DuplicateRow { frame: name.into() });
            continue;
        }
        match points(&record, count) {
            Ok(points) => {
                count = Some(2 * points.len());
                grid[i] = Some(points);
            }
            Err(kind) => fault(kind),
        }
    }
    grid
}

fn points(record: &csv::StringRecord, count: Option<usize>) -> Result<Box<[[f64; 2]]>, DatasetErrorKind> {
    let found = record.len() - 1;
    let expected = count.unwrap_or_else(|| found.next_multiple_of(2).max(2));
    if found != expected {
        return Err(DatasetErrorKind::WrongCount { found, expected });
    }
    let mut numbers = Vec::with_capacity(found);
    for word in record.iter().skip(1) {
        let number: f64 = word
            .parse()
            .map_err(|_| DatasetErrorKind::NotANumber { word: word.into() })?;
        if !number.is_finite() {
            return Err(DatasetErrorKind::NotFinite);
        }
        numbers.push(number);
    }
    Ok(numbers.chunks_exact(2).map(|c| [c[0], c[1]]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (Grid, Vec<String>) {
        let mut faults = Vec::new();
        let grid = parse(
            text.as_bytes(),
            Path::new("g"),
            &["a.png", "b.png", "c.png"],
            &mut faults,
        );
        (grid, faults.iter().map(ToString::to_string).collect())
    }

    #[test]
    fn rows_follow_names_or_numbers() {
        let (grid, faults) = read("frame,x1,y1,x2,y2\nb.png,1,2,3,4.5\n0,5,6,7,8\n");
        assert!(faults.is_empty(), "{faults:?}");
        let points = |k: usize| grid[k].as_deref();
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
            ("a.png,1,2\na.png,1,2\n", "g:2: a second row for frame `a.png`"),
            ("z.png,1,2\n", "g:1: there is no frame `z.png`"),
            ("7,1,2\n", "g:1: there is no frame `7`"),
        ] {
            let (_, faults) = read(text);
            assert_eq!(faults.len(), 1, "{text}: {faults:?}");
            assert!(faults[0].starts_with(start), "{faults:?}");
        }
        let mut faults = Vec::new();
        parse(b"\xff\xfe", Path::new("g"), &["a.png"], &mut faults);
        assert_eq!(faults.len(), 1);
    }
}
