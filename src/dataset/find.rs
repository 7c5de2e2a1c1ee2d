//! Finds sequences in a folder and below it. Formats are detected, never configured.

use super::format::{Format, Formats, Found, Place};
use super::storage::Folder;
use super::{DatasetError, DatasetErrorKind};
use std::sync::Arc;

/// Deepest level of folders below the given one that may hold frames: `root/actor/sequence`.
const DEPTH: usize = 2;

/// One sequence as it lies in its folder, nothing read yet.
pub(super) struct Unread {
    /// Name of the dataset: the folder around the sequence's.
    pub dataset: String,
    /// The sequence's folder.
    pub folder: Folder,
    /// The format that recognised it; `None` for frames that no format knows any ground truth of.
    pub format: Option<Arc<dyn Format>>,
    /// Its parts.
    pub parts: Found,
}

/// Every sequence in `root` and up to two levels below it, in natural order. Frames without ground truth are found too.
pub(super) fn find(root: &Folder, formats: &Formats) -> Result<Vec<Unread>, DatasetError> {
    let dataset = root.parent().unwrap_or_else(|| root.clone());
    let mut found = Vec::new();
    walk(root, dataset.name(), formats, 0, &mut found)?;
    if found.is_empty() {
        let kind = if Place::new(root)?.is_empty() {
            DatasetErrorKind::EmptyFolder
        } else {
            DatasetErrorKind::NoSequences {
                expected: formats.layouts(),
            }
        };
        return Err(DatasetError::new(root.path(), kind));
    }
    Ok(found)
}

fn walk(
    folder: &Folder,
    dataset: &str,
    formats: &Formats,
    depth: usize,
    all: &mut Vec<Unread>,
) -> Result<(), DatasetError> {
    let place = Place::new(folder)?;
    let unread = |format, parts| Unread {
        dataset: dataset.to_string(),
        folder: folder.clone(),
        format,
        parts,
    };
    if let Some((format, found)) = formats.recognise(&place)? {
        all.extend(found.into_iter().map(|parts| unread(Some(format.clone()), parts)));
        return Ok(());
    }
    let before = all.len();
    if depth < DEPTH {
        for inner in place.folders() {
            walk(inner, folder.name(), formats, depth + 1, all)?;
        }
    }
    let frames = place.images();
    if all.len() == before && !frames.is_empty() {
        all.push(unread(None, place.sequence(frames, vec![])));
    }
    Ok(())
}
