//! Finds sequences in a folder and below it. Formats are detected, never configured.

use super::borrowed::{self, Borrowed};
use super::error::Searched;
use super::format::{Format, Formats, Found, Place};
use super::nearest::Inventory;
use super::order::natural;
use super::storage::Folder;
use super::{DatasetError, DatasetErrorKind};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Deepest level of folders below the given one that may hold frames: `root/actor/sequence`. Formats know of deeper ones
/// below the top of their data.
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
    /// Where its frames and their truth come from; `None`: from its own folder.
    pub borrowed: Option<Borrowed>,
}

impl Unread {
    /// The folder of its frames and their truth.
    pub fn data(&self) -> &Folder {
        self.borrowed.as_ref().map_or(&self.folder, |b| &b.from)
    }
}

/// A link that leads nowhere, where a sequence or a part of one may have been.
pub(super) struct DeadLink {
    /// Name of the dataset that a sequence there would belong to.
    pub dataset: String,
    /// Name that the sequence has or would have.
    pub name: String,
    /// It lies in a sequence that was found.
    pub in_sequence: bool,
    /// What is to say about it.
    pub fault: DatasetError,
}

/// What is in a folder and below it.
#[derive(Default)]
pub(super) struct Finds {
    /// Sequences, in natural order.
    pub sequences: Vec<Unread>,
    /// Links that lead nowhere.
    pub dead: Vec<DeadLink>,
    /// Folders too deep to be searched.
    pub deeper: Vec<Folder>,
}

impl Finds {
    /// A warning when a folder with images is among those that were not searched.
    pub fn too_deep(&self) -> Option<DatasetError> {
        let images = |folder: &&Folder| Place::new(folder).is_ok_and(|place| !place.images().is_empty());
        let folder = self.deeper.iter().find(images)?;
        Some(DatasetError::new(
            folder.path(),
            DatasetErrorKind::TooDeep { depth: DEPTH },
        ))
    }
}

/// Every sequence in `root` and up to two levels below it, in natural order. Frames without ground truth are found too. A
/// folder that several links lead to, or a link to a folder around it, counts once.
pub(super) fn find(root: &Folder, formats: &Formats) -> Result<Finds, DatasetError> {
    let dataset = root.parent().unwrap_or_else(|| root.clone());
    let mut walk = Walk {
        formats,
        seen: HashSet::from([root.identity()]),
        finds: Finds::default(),
    };
    walk.visit(root, dataset.name(), 0, DEPTH)?;
    let mut finds = walk.finds;
    // A folder that holds nothing but the ground truth of a sequence elsewhere is no sequence.
    let complete = finds.sequences.iter().filter(|s| !s.parts.frames.is_empty());
    let files = complete.flat_map(|s| &s.parts.truth);
    let used: HashSet<PathBuf> = files.map(|file| file.path().to_path_buf()).collect();
    let is_used = |s: &Unread| s.parts.truth.iter().any(|file| used.contains(file.path()));
    finds
        .sequences
        .retain(|s| !s.parts.frames.is_empty() || !is_used(s));
    if finds.sequences.is_empty() {
        if !finds.dead.is_empty() {
            return Err(finds.dead.swap_remove(0).fault);
        }
        let kind = if Place::new(root)?.is_empty() {
            DatasetErrorKind::EmptyFolder
        } else {
            let inventory = Inventory::below(root, DEPTH)?;
            DatasetErrorKind::NoSequences(Box::new(Searched {
                depth: DEPTH,
                deeper: finds.deeper.first().map(|folder| folder.path().to_path_buf()),
                formats: formats.names(),
                found: inventory.found(),
                nearest: inventory.nearest(formats),
            }))
        };
        return Err(DatasetError::new(root.path(), kind));
    }
    if let [one] = &finds.sequences[..]
        && one.format.is_none()
        && one.folder.path() == root.path()
        && let Some(whole) = frames_of(root, formats)?
    {
        let kind = DatasetErrorKind::FramesOfSequence { whole };
        return Err(DatasetError::new(root.path(), kind));
    }
    Ok(finds)
}

/// The folder around `folder` if it is a sequence whose frames lie in `folder`.
fn frames_of(folder: &Folder, formats: &Formats) -> Result<Option<PathBuf>, DatasetError> {
    let Some(around) = folder.parent() else {
        return Ok(None);
    };
    let Some((_, found)) = formats.recognise(&Place::new(&around)?)? else {
        return Ok(None);
    };
    let mut frames = found.iter().flat_map(|sequence| &sequence.frames);
    let name = |path: &Path| {
        path.parent()?
            .file_name()
            .map(|n| n.to_string_lossy().into_owned())
    };
    let inside = frames.any(|frame| name(frame.path()).as_deref() == Some(folder.name()));
    Ok(inside.then(|| around.path().to_path_buf()))
}

struct Walk<'a> {
    formats: &'a Formats,
    /// Folders that are visited or about to be, by identity.
    seen: HashSet<PathBuf>,
    finds: Finds,
}

impl Walk<'_> {
    /// Looks into `folder`, `depth` levels below the given one, and below it down to level `deepest`.
    fn visit(
        &mut self,
        folder: &Folder,
        dataset: &str,
        depth: usize,
        deepest: usize,
    ) -> Result<(), DatasetError> {
        let place = Place::new(folder)?;
        let unread = |dataset: &str, format, parts: Found| Unread {
            dataset: parts.dataset.clone().unwrap_or_else(|| dataset.to_owned()),
            folder: folder.clone(),
            format,
            parts,
            borrowed: None,
        };
        if let Some((format, found)) = self.formats.recognise(&place)? {
            let dataset = match format.holds_sequences() {
                true => folder.name(),
                false => dataset,
            };
            let found = found.into_iter();
            let found = found.map(|parts| unread(dataset, Some(format.clone()), parts));
            self.finds.sequences.extend(found);
            self.bury(&place, dataset, Some(place.name()));
            return Ok(());
        }
        if let Some(borrowed) = borrowed::recognise(&place, dataset, self.formats) {
            self.finds.sequences.push(borrowed);
            return Ok(());
        }
        if self.formats.hold_no_sequence(&place) {
            return Ok(());
        }
        self.bury(&place, folder.name(), None);
        let before = self.finds.sequences.len();
        let deepest = deepest.max(depth + self.formats.levels_below(&place));
        if depth < deepest {
            for inner in self.new_folders(&place) {
                self.visit(inner, folder.name(), depth + 1, deepest)?;
            }
        } else if place.images().is_empty() {
            self.finds.deeper.extend_from_slice(place.folders());
        }
        let frames = place.images();
        if self.finds.sequences.len() == before && !frames.is_empty() {
            let bare = unread(dataset, None, place.sequence(frames, vec![]));
            self.finds.sequences.push(bare);
        }
        Ok(())
    }

    /// The folders in `place` that were not seen before. Of several names of one folder its own counts, else the first.
    fn new_folders<'p>(&mut self, place: &'p Place) -> Vec<&'p Folder> {
        let here = place.folder().identity();
        let folders = place.folders().iter().map(|f| (f, f.identity()));
        let (own, links): (Vec<_>, Vec<_>) = folders
            .partition(|(f, identity)| f.path().file_name().is_some_and(|n| *identity == here.join(n)));
        let mut new = own;
        new.extend(links);
        new.retain(|(_, identity)| self.seen.insert(identity.clone()));
        let mut new: Vec<&Folder> = new.into_iter().map(|(f, _)| f).collect();
        new.sort_by(|a, b| natural(a.name(), b.name()));
        new
    }

    /// Keeps the dead links of `place`, as parts of the sequence `name` or else as sequences of `dataset`.
    fn bury(&mut self, place: &Place, dataset: &str, name: Option<&str>) {
        let dead = place.dead_links().iter().filter_map(|link| {
            Some(DeadLink {
                dataset: dataset.to_owned(),
                name: name.unwrap_or(link.name()).to_owned(),
                in_sequence: name.is_some(),
                fault: link.fault()?,
            })
        });
        self.finds.dead.extend(dead);
    }
}
