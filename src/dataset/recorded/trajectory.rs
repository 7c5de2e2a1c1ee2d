//! Trajectories of the VOT toolkit: text with codes among the regions, and its binary form.
//!
//! A code stands for a frame: 0 for one that is not known, 1 for one that the tracker was started on, 2 for a failure. The
//! binary form is, little endian: `i16` 1, `u32` number of regions, then for each `u8` its kind and its numbers: 0 a code
//! (`u32`), 1 a box (4 `f32`), 2 a polygon (`u16` n, 2 n `f32`), 3 a mask, 4 a point. Source: vot-toolkit 0.9.

use super::super::{DatasetErrorKind, TruthFile, text};
use std::fmt::Write as _;

/// A code in place of a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Code {
    Unknown,
    Started,
    Failed,
}

impl Code {
    fn of(number: f64) -> Option<Code> {
        [Code::Unknown, Code::Started, Code::Failed]
            .into_iter()
            .find(|code| f64::from(*code as u8) == number)
    }
}

/// A text in which each code is replaced by a row that says nothing, and the codes with their rows, from 0. Without codes, and
/// so for all that is no trajectory, the text is as it was.
pub(super) fn without_codes(text: &str) -> (String, Vec<(usize, Code)>) {
    let (mut rest, mut codes, mut row) = (String::with_capacity(text.len()), Vec::new(), 0);
    for line in text::lines(text) {
        let words: Vec<&str> = text::words(line).collect();
        let code = match words[..] {
            [word] => word.parse().ok().and_then(Code::of),
            _ => None,
        };
        match code {
            Some(code) => {
                codes.push((row, code));
                rest.push_str("unknown");
            }
            None => rest.push_str(line),
        }
        rest.push('\n');
        row += usize::from(!words.is_empty());
    }
    (rest, codes)
}

/// The text of a binary trajectory; `None` for bytes that are none.
///
/// # Errors
/// It ends early, or has regions that are no boxes and quadrilaterals.
pub(super) fn text_of(file: &TruthFile) -> Option<Result<String, DatasetErrorKind>> {
    let bytes = file.bytes().strip_prefix(&[1, 0])?;
    let mut left = Bytes(bytes);
    let count = left.number(u32::from_le_bytes)?;
    // Text that begins like this has no room for so many.
    if count as usize > bytes.len() {
        return None;
    }
    Some(regions(&mut left, count))
}

fn regions(left: &mut Bytes<'_>, count: u32) -> Result<String, DatasetErrorKind> {
    let mut text = String::new();
    for row in 1..=count as usize {
        let short = || DatasetErrorKind::ShortTrajectory { row };
        let numbers = match left.number(u8::from_le_bytes).ok_or_else(short)? {
            0 => {
                let code = left.number(u32::from_le_bytes).ok_or_else(short)?;
                let _ = writeln!(text, "{code}");
                continue;
            }
            1 => 4,
            2 => 2 * usize::from(left.number(u16::from_le_bytes).ok_or_else(short)?),
            3 => return Err(DatasetErrorKind::MaskResult { row }),
            _ => return Err(DatasetErrorKind::OtherRegion { row }),
        };
        let values = (0..numbers).map(|_| left.number(f32::from_le_bytes));
        let values: Vec<f32> = values.collect::<Option<_>>().ok_or_else(short)?;
        let words: Vec<String> = values.iter().map(f32::to_string).collect();
        let _ = writeln!(text, "{}", words.join(","));
    }
    Ok(text)
}

struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn number<const N: usize, T>(&mut self, read: impl Fn([u8; N]) -> T) -> Option<T> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(read(*first))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_stand_for_rows() {
        let (text, codes) = without_codes("1\n1,2,3,4\n\n0\n2\n");
        assert_eq!(codes, [(0, Code::Started), (2, Code::Unknown), (3, Code::Failed)]);
        assert_eq!(text.lines().nth(1), Some("1,2,3,4"));
        let plain = "1 2 3 4\n5 6 7 8";
        assert_eq!(without_codes(plain).1, []);
    }

    #[test]
    fn binary_is_as_text() {
        let mut bytes = vec![1, 0, 3, 0, 0, 0, 0, 1, 0, 0, 0, 1];
        [1.5f32, 2.0, 30.0, 40.0]
            .iter()
            .for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend([2, 4, 0]);
        (0..8).for_each(|v| bytes.extend((v as f32).to_le_bytes()));
        let read = |bytes: &[u8]| text_of(&TruthFile::of("t.bin", bytes.to_vec()));
        let text = read(&bytes).unwrap().unwrap();
        assert_eq!(text, "1\n1.5,2,30,40\n0,1,2,3,4,5,6,7\n");
        assert!(matches!(
            read(&bytes[..bytes.len() - 1]),
            Some(Err(DatasetErrorKind::ShortTrajectory { row: 3 }))
        ));
        assert!(matches!(
            read(&[1, 0, 1, 0, 0, 0, 3]),
            Some(Err(DatasetErrorKind::MaskResult { row: 1 }))
        ));
        assert!(read(b"1 2 3 4\n").is_none());
    }
}
