//! MTF and TMT: frames in `<root>/<seq>/`, ground truth in `<root>/<seq>.txt`, with or without a level of actors.

use super::{Candidate, Layout, Parts, frames_in};
use crate::dataset::DatasetError;
use crate::dataset::source::{File, Folder};

pub(super) const LAYOUT: Layout = Layout { recognise };

fn recognise(candidate: &Candidate<'_>) -> Result<Option<Parts>, DatasetError> {
    let frames = frames_in(candidate.listing);
    if frames.is_empty() {
        return Ok(None);
    }
    let name = format!("{}.txt", candidate.folder.name());
    let truth = match candidate.folder.parent() {
        Some(Folder::Disk(parent)) => parent.join(name),
        _ => return Ok(None),
    };
    let truth = truth.is_file().then_some(File::Disk(truth));
    Ok(truth.map(|truth| Parts {
        frames,
        truth,
        form: None,
    }))
}
