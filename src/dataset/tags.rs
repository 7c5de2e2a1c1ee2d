//! Words that say what is hard about a sequence: `tags.txt` and the list `tags` of `meta.json`.

use super::annotation::Annotations;
use super::storage::Folder;
use super::{DatasetError, DatasetErrorKind};
use crate::files::Kind;

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
    if let Some(file) = folder.file("meta.json") {
        #[derive(serde::Deserialize)]
        struct Meta {
            #[serde(default)]
            tags: Vec<String>,
        }
        let meta: Meta = serde_json::from_slice(&file.read_as(Kind::SETTINGS)?).map_err(|e| {
            DatasetError::new(
                file.path(),
                DatasetErrorKind::BadMeta {
                    detail: e.to_string(),
                },
            )
        })?;
        tags.extend(meta.tags);
    }
    for tag in tags {
        annotations.tag(&tag);
    }
    Ok(())
}
