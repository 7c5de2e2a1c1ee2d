//! What lies beside a sequence for all formats: words that say what is hard about it, in `tags.txt` and the list `tags` of
//! `meta.json`, and how its truth is to be read, in `origin`, `box`, `truth_start` and `truth_step` of `meta.json`.

use super::annotation::Annotations;
use super::reading::{Origin, Reading};
use super::storage::{File, Folder};
use super::{DatasetError, DatasetErrorKind};
use crate::files::Kind;
use serde_json::Value;

/// What else is known of a sequence, for programs.
pub(super) const META: &str = "meta.json";

fn bad(file: &File, detail: impl ToString) -> DatasetError {
    let detail = detail.to_string();
    DatasetError::new(file.path(), DatasetErrorKind::BadMeta { detail })
}

/// What `meta.json` says: null when it cannot be read or is no JSON, `None` without one.
pub(super) fn meta(folder: &Folder) -> Option<Value> {
    let bytes = folder.file(META)?.read_as(Kind::SETTINGS).unwrap_or_default();
    Some(serde_json::from_slice(&bytes).unwrap_or_default())
}

/// How `meta.json` asks the truth to be read: a number `origin`, a word `box`, whole numbers `truth_start` and
/// `truth_step`. Other values of the first two are somebody
/// else's, and a file that cannot be read is left to [`read`].
///
/// # Errors
/// A number or word that means nothing.
pub(super) fn reading(folder: &Folder) -> Result<Reading, DatasetError> {
    let mut reading = Reading::default();
    let Some((file, meta)) = folder.file(META).zip(meta(folder)) else {
        return Ok(reading);
    };
    let number = |value: &Value| value.as_f64().or_else(|| value.as_str()?.parse().ok());
    if let Some(origin) = meta.get("origin").and_then(number) {
        reading.origin = Some(Origin::try_from(origin).map_err(|e| bad(&file, e))?);
    }
    if let Some(form) = meta.get("box").and_then(Value::as_str) {
        reading.boxes = Some(form.parse().map_err(|e: String| bad(&file, e))?);
    }
    for (word, number) in [
        ("truth_start", &mut reading.rows.start),
        ("truth_step", &mut reading.rows.step),
    ] {
        let Some(value) = meta.get(word) else { continue };
        let least = u64::from(word == "truth_step");
        *number = value.as_u64().filter(|n| *n >= least);
        if number.is_none() {
            return Err(bad(&file, format!("{word}: {value}")));
        }
    }
    Ok(reading)
}

/// Adds the words of `tags.txt` and of `tags` in `meta.json`, in order, each once.
///
/// # Errors
/// One of the files cannot be read, or the second is not what it should be.
pub(super) fn read(folder: &Folder, annotations: &mut Annotations) -> Result<(), DatasetError> {
    let mut tags: Vec<String> = Vec::new();
    if let Some(file) = folder.file("tags.txt") {
        let bytes = file.read_as(Kind::SETTINGS)?;
        let text = String::from_utf8_lossy(&bytes);
        let words = text
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|w| !w.is_empty());
        tags.extend(words.map(String::from));
    }
    if let Some(file) = folder.file(META) {
        #[derive(serde::Deserialize)]
        struct Meta {
            #[serde(default)]
            tags: Vec<String>,
        }
        let meta: Meta = serde_json::from_slice(&file.read_as(Kind::SETTINGS)?).map_err(|e| bad(&file, e))?;
        tags.extend(meta.tags);
    }
    for tag in tags {
        annotations.tag(&tag);
    }
    Ok(())
}
