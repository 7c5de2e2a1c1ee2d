//! A folder with its ground truth inside: `groundtruth.txt` and frames beside it, OTB's `groundtruth_rect.txt` and
//! `img/`, VOT's `groundtruth.txt` and `color/` or frames beside a `sequence` file.

use super::{Candidate, Layout, Parts, frames_in};
use crate::dataset::DatasetError;

pub(super) const LAYOUT: Layout = Layout { recognise };

const TRUTH: &[&str] = &["groundtruth.txt", "groundtruth_rect.txt"];
const FRAME_FOLDERS: &[&str] = &["img", "color"];

fn recognise(candidate: &Candidate<'_>) -> Result<Option<Parts>, DatasetError> {
    let listing = candidate.listing;
    let Some(truth) = TRUTH.iter().find_map(|name| listing.file(name)) else {
        return Ok(None);
    };
    let mut frames = frames_in(listing);
    let mut vot = listing
        .files
        .iter()
        .any(|(name, _)| name == "sequence" || name.ends_with(".tag"));
    if frames.is_empty() {
        let inner = listing
            .folders
            .iter()
            .find(|(name, _)| FRAME_FOLDERS.contains(&name.as_str()));
        if let Some((name, folder)) = inner {
            vot |= name == "color";
            frames = frames_in(&folder.list()?);
        }
    }
    // Eight numbers are corners in pixels unless the files around them are VOT's.
    Ok(Some(Parts {
        frames,
        truth: truth.clone(),
        form: vot.then_some("vot-polygon"),
    }))
}
