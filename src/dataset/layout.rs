//! How sequences lie in folders. Layouts are detected, never configured.
//!
//! A layout is one file here with a function that recognises one sequence, and one line in [`LAYOUTS`].

mod folder;
mod mtf;

use super::source::{File, Folder, Listing};
use super::{DatasetError, DatasetErrorKind};

/// Deepest level of folders below the given one that may hold frames: `root/actor/sequence`.
const DEPTH: usize = 2;

/// One sequence as it lies on disk, nothing read yet.
#[derive(Debug)]
pub(super) struct Found {
    /// Name of the dataset: the folder around the sequence's.
    pub dataset: String,
    /// Name of the sequence's folder.
    pub name: String,
    /// The sequence's folder.
    pub folder: Folder,
    /// Frames in natural order of names.
    pub frames: Vec<(String, File)>,
    /// The ground truth; none is a fault.
    pub truth: Option<File>,
    /// The form that the layout prescribes for its ground truth, when its content cannot tell.
    pub form: Option<&'static str>,
}

/// What recognisers look at: a folder, what is in it, and how to look around it.
struct Candidate<'a> {
    folder: &'a Folder,
    listing: &'a Listing,
}

/// Where a sequence keeps its parts.
struct Parts {
    frames: Vec<(String, File)>,
    truth: File,
    form: Option<&'static str>,
}

/// A layout: recognises whether a folder is a sequence of its kind.
struct Layout {
    recognise: fn(&Candidate<'_>) -> Result<Option<Parts>, DatasetError>,
}

/// Every layout, tried in this order.
const LAYOUTS: &[Layout] = &[folder::LAYOUT, mtf::LAYOUT];

/// Names that end in these are frames.
const EXTENSIONS: &[&str] = &[
    "jpg", "jpeg", "png", "bmp", "pgm", "ppm", "pbm", "pnm", "tif", "tiff", "gif",
];

/// The frames among the files of a folder.
fn frames_in(listing: &Listing) -> Vec<(String, File)> {
    let is_frame = |name: &str| {
        let extension = name.rsplit_once('.').map(|(_, e)| e.to_ascii_lowercase());
        extension.is_some_and(|e| EXTENSIONS.contains(&e.as_str()))
    };
    listing
        .files
        .iter()
        .filter(|(name, _)| is_frame(name))
        .cloned()
        .collect()
}

/// Every sequence in `root` and up to two levels below it, in natural order. Frames without ground truth are found too.
pub(super) fn find(root: &Folder) -> Result<Vec<Found>, DatasetError> {
    let dataset = root.parent().map_or_else(|| root.name(), |p| p.name());
    let mut found = Vec::new();
    walk(root, &dataset, 0, &mut found)?;
    if found.is_empty() {
        let empty = root.list()?.is_empty();
        let kind = if empty {
            DatasetErrorKind::EmptyFolder
        } else {
            DatasetErrorKind::NoSequences
        };
        return Err(DatasetError::new(root.path(), kind));
    }
    Ok(found)
}

fn walk(folder: &Folder, dataset: &str, depth: usize, found: &mut Vec<Found>) -> Result<(), DatasetError> {
    let listing = folder.list()?;
    let candidate = Candidate {
        folder,
        listing: &listing,
    };
    let one = |frames, truth, form| Found {
        dataset: dataset.to_string(),
        name: folder.name(),
        folder: folder.clone(),
        frames,
        truth,
        form,
    };
    for layout in LAYOUTS {
        if let Some(parts) = (layout.recognise)(&candidate)? {
            found.push(one(parts.frames, Some(parts.truth), parts.form));
            return Ok(());
        }
    }
    let before = found.len();
    if depth < DEPTH {
        let name = folder.name();
        for (_, child) in &listing.folders {
            walk(child, &name, depth + 1, found)?;
        }
    }
    let frames = frames_in(&listing);
    if found.len() == before && !frames.is_empty() {
        found.push(one(frames, None, None));
    }
    Ok(())
}
