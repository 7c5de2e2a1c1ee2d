//! Frame logs of this program, as far as they say where the object was found. Depends on `geom` alone.

use mtf::geom::Corners;

/// First columns of a frame log.
const COLUMNS: &str = "frame,file,status,x1,";

/// A row of a frame log.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedFrame {
    /// Frame of the sequence, from 0.
    pub frame: usize,
    /// Name of its file.
    pub file: String,
    /// How the frame ended: a word.
    pub status: String,
    /// Corners UL UR LR LL, px; `None` where the tracker gave none.
    pub corners: Option<Corners>,
    /// How sure the tracker was, by its own measure; NaN where it has none.
    pub similarity: f64,
}

/// A row that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct LogFault {
    /// Line, from 1.
    pub line: usize,
    /// What is wrong.
    pub reason: String,
}

/// Whether a text begins as a frame log does.
pub fn is_log(text: &str) -> bool {
    text.starts_with(COLUMNS)
}

/// The rows of a frame log.
///
/// # Errors
/// The first row that cannot be read.
pub fn logged_frames(text: &[u8]) -> Result<Vec<LoggedFrame>, LogFault> {
    let fault = |line: usize, reason: String| LogFault { line, reason };
    let mut reader = csv::Reader::from_reader(text);
    let headers = reader.headers().map_err(|e| fault(1, e.to_string()))?;
    let similarity = headers.iter().position(|name| name == "similarity");
    let row = |(record, line): (Result<csv::StringRecord, csv::Error>, usize)| {
        let record = record.map_err(|e| fault(line, e.to_string()))?;
        let cell = |k: usize| record.get(k).unwrap_or_default();
        let corners = match cell(3).is_empty() {
            true => None,
            false => {
                let numbers: Option<Vec<f64>> = (3..11).map(|k| cell(k).parse().ok()).collect();
                let corners = numbers.and_then(|v| Some(Corners::from_array(v.try_into().ok()?)));
                let corners = corners.filter(Corners::is_finite);
                Some(corners.ok_or_else(|| fault(line, "eight corner coordinates are missing".into()))?)
            }
        };
        Ok(LoggedFrame {
            frame: cell(0)
                .parse()
                .map_err(|_| fault(line, format!("bad frame number {:?}", cell(0))))?,
            file: cell(1).to_owned(),
            status: cell(2).to_owned(),
            corners,
            similarity: similarity.and_then(|k| cell(k).parse().ok()).unwrap_or(f64::NAN),
        })
    };
    reader.records().zip(2..).map(row).collect()
}
