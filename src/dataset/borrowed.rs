//! Sequences made of another's frames: a folder with nothing but a `meta.json` that says
//! `{"frames_of": "NAME", "step": K, "tags": [...]}` is every `K`-th frame of the sequence `NAME` beside it, from the first on,
//! with their truth, absences and dense truth. Such a sequence is as hard as its object moves in `K` frames, and holds no
//! images of its own. Its tags are its own; how truth is to be read is the other's to say.
//!
//! Depends on formats and on where files come from.

use super::find::Unread;
use super::format::{Formats, Found, Place};
use super::storage::Folder;
use super::tags::{self, META};
use super::{DatasetError, DatasetErrorKind};
use serde_json::Value;

/// Where a sequence's frames come from, when not from its own folder.
pub(super) struct Borrowed {
    /// Folder of the other sequence.
    pub from: Folder,
    /// Name of the other sequence.
    pub name: String,
    /// Every so many-th frame.
    pub step: usize,
    /// Why it cannot be had.
    pub fault: Option<DatasetError>,
}

impl Borrowed {
    /// Keeps every [`step`](Self::step)-th of `all`.
    pub fn thin<T>(&self, all: &mut Vec<T>) {
        let mut place = 0..;
        all.retain(|_| place.next().is_none_or(|i: usize| i.is_multiple_of(self.step)));
    }
}

/// The sequence of dataset `dataset` that the folder `place` makes of another's frames; `None` when it is no such folder.
pub(super) fn recognise(place: &Place, dataset: &str, formats: &Formats) -> Option<Unread> {
    let meta = tags::meta(place.folder())?;
    let of = meta.get("frames_of")?;
    let other = other(place, of, &meta, formats);
    let unread = |format, parts: Found, borrowed| Unread {
        dataset: dataset.to_owned(),
        folder: place.folder().clone(),
        format,
        parts: Found {
            name: place.name().to_owned(),
            ..parts
        },
        borrowed: Some(borrowed),
    };
    Some(match other {
        Ok((other, step)) => {
            let borrowed = Borrowed {
                from: other.folder,
                name: other.parts.name.clone(),
                step,
                fault: None,
            };
            unread(other.format, other.parts, borrowed)
        }
        Err(fault) => {
            let borrowed = Borrowed {
                from: place.folder().clone(),
                name: place.name().to_owned(),
                step: 1,
                fault: Some(fault),
            };
            unread(None, place.sequence(vec![], vec![]), borrowed)
        }
    })
}

/// The sequence that `of` names, and the step.
fn other(
    place: &Place,
    of: &Value,
    meta: &Value,
    formats: &Formats,
) -> Result<(Unread, usize), DatasetError> {
    let bad = |detail: String| {
        let path = place.folder().path().join(META);
        DatasetError::new(&path, DatasetErrorKind::BadMeta { detail })
    };
    let step = match meta.get("step") {
        None => 1,
        Some(step) => match step.as_u64() {
            Some(step @ 1..) => step as usize,
            _ => return Err(bad(format!("step: {step} is not a whole number from 1 on"))),
        },
    };
    let missing = || {
        bad(format!(
            "frames_of: {of} is not the name of a sequence in the same folder"
        ))
    };
    let name = of.as_str().ok_or_else(missing)?;
    let around = place.folder().parent().ok_or_else(missing)?;
    let around = Place::new(&around)?;
    let folder = around.folders().iter().find(|f| f.name() == name);
    let folder = folder.ok_or_else(missing)?;
    let recognised = formats.recognise(&Place::new(folder)?)?;
    let (format, mut found) = recognised.ok_or_else(missing)?;
    if found.len() > 1 {
        return Err(bad(format!(
            "frames_of: {of} is the folder of {} sequences, not of one",
            found.len()
        )));
    }
    let parts = found.swap_remove(0);
    let unread = Unread {
        dataset: String::new(),
        folder: folder.clone(),
        format: Some(format),
        parts,
        borrowed: None,
    };
    Ok((unread, step))
}
