//! Errors of frames as a short text, exact to the bit: most of a run directory without frame logs.
//!
//! Values are multiples of 1e-6, and those of a frame are near those of the frame before. The text is Base64 of a sequence of
//! whole numbers of 7 bits per byte, least first, the eighth bit set where more follow: the number of values per frame; the
//! lengths of the stretches of frames with and without output in turn; then, value by value of a frame, the difference to
//! the frame with output before, in units of 1e-6, negative ones as odd numbers (zigzag).

use base64::Engine;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Values per evaluated frame; `None` without output.
pub type Rows = Vec<Option<Vec<f64>>>;

/// How [`Rows`] stand in the journal: packed, or as they are where they cannot be packed exactly.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Kept {
    Packed(String),
    Plain(Rows),
}

/// Writes them packed.
pub(crate) fn serialize<S: Serializer>(rows: &Option<Rows>, serializer: S) -> Result<S::Ok, S::Error> {
    let kept = rows.as_ref().map(|rows| match pack(rows) {
        Some(text) => Kept::Packed(text),
        None => Kept::Plain(rows.clone()),
    });
    kept.serialize(serializer)
}

/// Reads what [`serialize`] wrote.
pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Rows>, D::Error> {
    match Option::<Kept>::deserialize(deserializer)? {
        None => Ok(None),
        Some(Kept::Plain(rows)) => Ok(Some(rows)),
        Some(Kept::Packed(text)) => match unpack(&text) {
            Some(rows) => Ok(Some(rows)),
            None => Err(serde::de::Error::custom("errors that cannot be unpacked")),
        },
    }
}

/// A value in units of 1e-6, if that is exact.
fn whole(value: f64) -> Option<i64> {
    const LARGEST: f64 = (1u64 << 52) as f64;
    let scaled = (value * 1e6).round();
    let number = scaled as i64;
    (scaled.abs() < LARGEST && (number as f64 / 1e6).to_bits() == value.to_bits()).then_some(number)
}

fn put(bytes: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

fn take(bytes: &mut &[u8]) -> Option<u64> {
    let mut number = 0;
    for shift in (0..64).step_by(7) {
        let (&first, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(first & 0x7f) << shift;
        if first & 0x80 == 0 {
            return Some(number);
        }
    }
    None
}

/// The text of `rows`; `None` where a value would not come back exactly.
fn pack(rows: &Rows) -> Option<String> {
    let width = rows.iter().flatten().next().map_or(0, Vec::len);
    let mut bytes = Vec::new();
    put(&mut bytes, width as u64);
    let stretches: Vec<_> = rows.chunk_by(|a, b| a.is_some() == b.is_some()).collect();
    put(&mut bytes, stretches.len() as u64);
    // The first has output, or is empty.
    let lost_first = rows.first().is_some_and(Option::is_none);
    put(&mut bytes, u64::from(lost_first));
    stretches.iter().for_each(|s| put(&mut bytes, s.len() as u64));
    let mut before = vec![0; width];
    for row in rows.iter().flatten() {
        if row.len() != width {
            return None;
        }
        for (before, &value) in before.iter_mut().zip(row) {
            let now = whole(value)?;
            let step: i64 = now - *before;
            put(&mut bytes, ((step << 1) ^ (step >> 63)) as u64);
            *before = now;
        }
    }
    Some(STANDARD_NO_PAD.encode(bytes))
}

/// Most frames that a text may be of: more than any sequence has.
const MOST: u64 = 1 << 32;

/// Reads what [`pack`] wrote.
fn unpack(text: &str) -> Option<Rows> {
    let bytes = STANDARD_NO_PAD.decode(text).ok()?;
    let mut bytes = bytes.as_slice();
    let width = take(&mut bytes)? as usize;
    let stretches = take(&mut bytes)?;
    let mut output = take(&mut bytes)? == 0;
    let mut lengths = Vec::new();
    for _ in 0..stretches {
        lengths.push(take(&mut bytes)?);
    }
    if lengths.iter().try_fold(0u64, |sum, n| sum.checked_add(*n))? > MOST {
        return None;
    }
    let (mut rows, mut before) = (Rows::new(), Vec::new());
    for length in lengths {
        for _ in 0..length {
            if !output {
                rows.push(None);
                continue;
            }
            let mut row = Vec::new();
            for k in 0..width {
                let step = take(&mut bytes)?;
                let step = (step >> 1) as i64 ^ -((step & 1) as i64);
                if k == before.len() {
                    before.push(0i64);
                }
                before[k] = before[k].checked_add(step)?;
                row.push(before[k] as f64 / 1e6);
            }
            rows.push(Some(row));
        }
        output = !output;
    }
    bytes.is_empty().then_some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize, Deserialize, Debug, PartialEq)]
    struct Line {
        #[serde(with = "super", default)]
        errors: Option<Rows>,
    }

    fn back(rows: Rows) -> String {
        let line = Line { errors: Some(rows) };
        let text = serde_json::to_string(&line).unwrap();
        assert_eq!(serde_json::from_str::<Line>(&text).unwrap(), line, "{text}");
        text
    }

    #[test]
    fn every_value_comes_back_to_the_bit() {
        for rows in [
            vec![],
            vec![None],
            vec![None, None, Some(vec![0.1, 2.0]), None],
            vec![Some(vec![0.123456, 20.0, 0.0]), Some(vec![0.123457, 1e9, -3.5])],
            vec![Some(vec![]), Some(vec![]), None],
        ] {
            assert!(back(rows).contains("\"errors\":\""));
        }
        let many = (0..2000).map(|k| Some(vec![f64::from(k * k) / 1e6, 1234.567891 / 1.0]));
        assert!(back(many.collect()).len() < 2000 * 8);
        // What has no such form stays as it is.
        for rows in [
            vec![Some(vec![1.0 / 3.0])],
            vec![Some(vec![1e300])],
            vec![Some(vec![1.0]), Some(vec![1.0, 2.0])],
        ] {
            assert!(back(rows).contains("\"errors\":[["));
        }
        // The sign of zero counts.
        let text = back(vec![Some(vec![-0.0])]);
        let line: Line = serde_json::from_str(&text).unwrap();
        assert!(line.errors.unwrap()[0].as_ref().unwrap()[0].is_sign_negative());
    }

    #[test]
    fn damaged_texts_are_refused() {
        let text = pack(&vec![Some(vec![1.0, 2.0]), None, Some(vec![1.5, 2.5])]).unwrap();
        assert!(unpack(&text).is_some());
        for cut in 0..text.len() {
            assert_eq!(unpack(&text[..cut]), None);
        }
        assert_eq!(unpack(&format!("{text}AA")), None);
        assert_eq!(unpack("?"), None);
        // More frames than there can be.
        let mut bytes = vec![0, 1, 1];
        put(&mut bytes, u64::MAX);
        assert_eq!(unpack(&STANDARD_NO_PAD.encode(bytes)), None);
    }
}
