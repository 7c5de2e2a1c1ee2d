//! Formats of datasets: where the parts of a sequence lie, and what its ground truth says.
//!
//! A format is an implementation of [`Format`]. One of the project's own is a file in `format/` and a line in
//! [`Formats::builtin`]; a program adds its own with [`Formats::with`]. What formats share is beside them: rows of
//! numbers in [`rows`](super::rows), dense truth in `groundtruth_grid.csv`, tags in `tags.txt` and `meta.json` (these
//! two are read whatever the format). Depends on `geom` and on where files come from.

mod alov;
mod apart;
mod film;
mod folder;
mod got10k;
mod homographies;
mod lasot;
mod mot;
mod mpot;
mod mtf_text;
mod nfs;
mod otb;
mod otb_attributes;
mod planartrack;
mod poic;
mod pot;
mod table;
mod tcolor128;
mod trackingnet;
mod uav123;
mod vot;

use super::annotation::{Annotations, Location};
use super::decode::is_image_name;
use super::movie::film_stem;
use super::order::sort_frames;
use super::storage::{File, Folder, Listing};
use super::{DatasetError, DatasetErrorKind};
use super::{rows, text};
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

/// What a format is, in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Description {
    /// Name in listings: a lower-case word.
    pub name: &'static str,
    /// Which data has this format, in a line.
    pub summary: &'static str,
    /// The files that it is recognised by, as a noun phrase that can follow "expected".
    pub layout: &'static str,
    /// Where the origin is, in which order corners come, what stands for a frame without annotation.
    pub conventions: &'static str,
}

/// A format of datasets: knows which sequences lie in a folder, and makes their annotations of any number of files.
pub trait Format: Send + Sync {
    /// What it is.
    fn describe(&self) -> Description;

    /// Whether a folder of this format is a dataset, whose name its sequences have, and not a sequence.
    fn holds_sequences(&self) -> bool {
        false
    }

    /// The sequences in the folder `place`, none when it is not of this format. Looks at names only, as every folder
    /// is offered to every format. Several sequences may share frames: objects in one video.
    ///
    /// # Errors
    /// A folder that cannot be listed.
    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError>;

    /// Reads the annotations of `sequence` from the content of its truth files, in the order in which
    /// [`recognise`](Self::recognise) gave them. What is wrong with a frame goes to `annotations`. Unless a format says
    /// otherwise, its one file has rows of corners or boxes.
    ///
    /// # Errors
    /// The fault that made it impossible to go on: such a sequence is not used.
    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let frames = || sequence.frames.iter().enumerate();
        truth
            .iter()
            .try_for_each(|file| rows::read(file, rows::ANY, frames(), annotations))
    }

    /// How many levels below `place` sequences may lie, where that is the top of such data and more than two. Looks at names
    /// only.
    fn levels_below(&self, place: &Place) -> usize {
        let _ = place;
        0
    }

    /// Whether `place` is a part of such data that holds pictures and no sequence. Looks at names only.
    fn holds_no_sequence(&self, place: &Place) -> bool {
        let _ = place;
        false
    }

    /// What is not certain about how `sequence`, which lies in `place`, was read.
    fn doubt(&self, place: &Place, sequence: &Found, annotations: &Annotations) -> Option<DatasetError> {
        let _ = (place, sequence, annotations);
        None
    }
}

/// A sequence that a format has found: where its parts lie.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Its name, unique in its dataset.
    pub name: String,
    /// Image files in the order of time; without any the sequence is faulty.
    pub frames: Vec<File>,
    /// The files that the ground truth is made of. Their bytes count towards the sequence's fingerprint, in this
    /// order.
    pub truth: Vec<File>,
    /// Files that say something else about it, such as its attributes. [`Format::read`] may read them; they do not count
    /// towards the fingerprint.
    pub about: Vec<File>,
    /// What the truth calls the object, where it is that of several objects.
    pub object: Option<String>,
    /// Words that its name or place says about it.
    pub tags: Vec<String>,
    /// The dataset that it belongs to; `None`: the one that is called like the folder around its own.
    pub dataset: Option<String>,
    /// The video or archive that its frames are in, where they are not images yet.
    pub packed: Option<File>,
}

/// A file of ground truth and its content.
#[derive(Debug)]
pub struct TruthFile {
    file: File,
    bytes: Cow<'static, [u8]>,
}

/// A folder that may hold sequences, and what is in it and around it.
#[derive(Debug)]
pub struct Place {
    folder: Folder,
    listing: Listing,
}

/// The formats a program knows. Cheap to clone.
#[derive(Clone)]
pub struct Formats(Vec<Arc<dyn Format>>);

impl Formats {
    /// The formats of this library, in the order in which they are tried.
    pub fn builtin() -> Self {
        Formats(vec![
            Arc::new(vot::Vot),
            Arc::new(lasot::Lasot),
            Arc::new(got10k::Got10k),
            Arc::new(folder::FrameFolder),
            Arc::new(otb::Otb),
            Arc::new(tcolor128::TColor128),
            Arc::new(mpot::Mpot),
            Arc::new(mot::Mot),
            Arc::new(nfs::Nfs),
            Arc::new(mtf_text::MtfText),
            Arc::new(homographies::Homographies),
            Arc::new(planartrack::PlanarTrack),
            Arc::new(pot::Pot),
            Arc::new(poic::Poic),
            Arc::new(alov::Alov),
            Arc::new(uav123::Uav123),
            Arc::new(trackingnet::TrackingNet),
            Arc::new(apart::Apart),
            Arc::new(film::Film),
        ])
    }

    /// With another one, which is tried before those that are there.
    pub fn with(mut self, format: impl Format + 'static) -> Self {
        self.0.insert(0, Arc::new(format));
        self
    }

    /// All, in the order in which they are tried.
    pub fn iter(&self) -> impl Iterator<Item = &dyn Format> {
        self.0.iter().map(|format| &**format)
    }

    /// The first format that finds sequences in `place`, and what it finds.
    pub(super) fn recognise(
        &self,
        place: &Place,
    ) -> Result<Option<(Arc<dyn Format>, Vec<Found>)>, DatasetError> {
        for format in &self.0 {
            let found = format.recognise(place)?;
            if !found.is_empty() {
                return Ok(Some((format.clone(), found)));
            }
        }
        Ok(None)
    }

    /// Whether a format knows that `place` holds no sequence.
    pub(super) fn hold_no_sequence(&self, place: &Place) -> bool {
        self.0.iter().any(|format| format.holds_no_sequence(place))
    }

    /// Their names, for messages.
    pub(super) fn names(&self) -> String {
        let names: Vec<&str> = self.iter().map(|format| format.describe().name).collect();
        names.join(", ")
    }

    /// How many levels below `place` sequences may lie, as far as a format knows it for the top of its data.
    pub(super) fn levels_below(&self, place: &Place) -> usize {
        let levels = self.0.iter().map(|format| format.levels_below(place));
        levels.max().unwrap_or(0)
    }
}

impl Default for Formats {
    fn default() -> Self {
        Formats::builtin()
    }
}

impl std::fmt::Debug for Formats {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names = self.iter().map(|format| format.describe().name);
        f.debug_list().entries(names).finish()
    }
}

impl Place {
    pub(super) fn new(folder: &Folder) -> Result<Self, DatasetError> {
        Ok(Place {
            listing: folder.list()?,
            folder: folder.clone(),
        })
    }

    /// Name of the folder.
    pub fn name(&self) -> &str {
        self.folder.name()
    }

    /// The folder itself.
    pub fn folder(&self) -> &Folder {
        &self.folder
    }

    /// Files in it, in natural order of names.
    pub fn files(&self) -> &[File] {
        &self.listing.files
    }

    /// Folders in it, in natural order of names.
    pub fn folders(&self) -> &[Folder] {
        &self.listing.folders
    }

    /// The file called `name` in it.
    pub fn file(&self, name: &str) -> Option<&File> {
        self.files().iter().find(|file| file.name() == name)
    }

    /// The first of the files called `names` that is in it.
    pub fn first_file(&self, names: &[&str]) -> Option<&File> {
        names.iter().find_map(|name| self.file(name))
    }

    /// The file called `name` beside the folder.
    pub fn file_beside(&self, name: &str) -> Option<File> {
        self.folder.parent()?.file(name)
    }

    /// The file beside the folder that is called like it and ends in `suffix`.
    pub fn file_beside_with(&self, suffix: &str) -> Option<File> {
        self.folder.file_beside(suffix)
    }

    /// The first of the files `names`, each a path in one of the folders `folders`, which lie beside the folder or beside the
    /// ones around it, up to `levels` of these.
    pub fn file_around(&self, levels: usize, folders: &[&str], names: &[String]) -> Option<File> {
        let around = std::iter::successors(self.folder.parent(), Folder::parent);
        let paths = || {
            folders
                .iter()
                .flat_map(|folder| names.iter().map(move |name| Path::new(folder).join(name)))
        };
        let first = |around: Folder| paths().find_map(|path| around.file_below(&path));
        around.take(levels).find_map(first)
    }

    /// As [`file_around`](Self::file_around), in the folder itself first.
    pub fn file_near(&self, levels: usize, folders: &[&str], names: &[String]) -> Option<File> {
        let mut paths = folders
            .iter()
            .flat_map(|folder| names.iter().map(move |name| Path::new(folder).join(name)));
        let here = paths.find_map(|path| self.folder.file_below(&path));
        here.or_else(|| self.file_around(levels, folders, names))
    }

    /// Whether it has folders of all these names.
    pub fn has_folders(&self, names: &[&str]) -> bool {
        let has = |name: &&str| self.folders().iter().any(|folder| folder.name() == *name);
        names.iter().all(has)
    }

    /// Names of the folder around it and of the one around that, empty at the top.
    pub fn names_around(&self) -> [String; 2] {
        let around = self.folder.parent();
        let name = |folder: &Option<Folder>| folder.as_ref().map_or(String::new(), |f| f.name().to_owned());
        let outer = around.as_ref().and_then(Folder::parent);
        [name(&around), name(&outer)]
    }

    /// Links in it that lead nowhere and are not called like images.
    pub(super) fn dead_links(&self) -> &[File] {
        &self.listing.dead
    }

    /// The image files in it, in natural order of names, decimal numbers by their values; without any, the film, if there is
    /// one alone.
    pub fn images(&self) -> Vec<File> {
        images(self.files())
    }

    /// The image files in it, in that order.
    pub(in crate::dataset) fn still_images(&self) -> Vec<File> {
        still_images(self.files())
    }

    /// The image files in it or, if there are none, in the first of its folders that has one of `names`; and the name
    /// of that folder.
    ///
    /// # Errors
    /// The inner folder cannot be listed.
    pub fn images_here_or_in(&self, names: &[&str]) -> Result<(Vec<File>, Option<&str>), DatasetError> {
        let here = self.images();
        let inner = self.folders().iter().find(|f| names.contains(&f.name()));
        match inner {
            Some(folder) if here.is_empty() => Ok((images(&folder.list()?.files), Some(folder.name()))),
            _ => Ok((here, None)),
        }
    }

    /// Nothing is in it.
    pub(super) fn is_empty(&self) -> bool {
        self.files().is_empty() && self.folders().is_empty()
    }

    /// One sequence, called like the folder.
    pub fn sequence(&self, frames: Vec<File>, truth: Vec<File>) -> Found {
        Found {
            name: self.name().into(),
            frames,
            truth,
            ..Found::default()
        }
    }
}

fn images(files: &[File]) -> Vec<File> {
    let images = still_images(files);
    let mut films = files.iter().filter(|file| film_stem(file.name()).is_some());
    match (images.is_empty(), films.next(), films.next()) {
        (true, Some(film), None) => vec![film.clone()],
        _ => images,
    }
}

fn still_images(files: &[File]) -> Vec<File> {
    let images = files.iter().filter(|file| is_image_name(file.name()));
    let mut images: Vec<File> = images.cloned().collect();
    sort_frames(&mut images, File::name);
    images
}

impl TruthFile {
    pub(super) fn read(file: &File) -> Result<Self, DatasetError> {
        Ok(TruthFile {
            bytes: file.read()?,
            file: file.clone(),
        })
    }

    /// With another content: text that was brought to another form.
    pub(super) fn new(file: &File, bytes: Vec<u8>) -> Self {
        TruthFile {
            bytes: Cow::Owned(bytes),
            file: file.clone(),
        }
    }

    #[cfg(test)]
    pub(super) fn of(name: &str, bytes: Vec<u8>) -> Self {
        TruthFile {
            file: File::of(name, vec![]),
            bytes: Cow::Owned(bytes),
        }
    }

    /// What messages call it.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Its name.
    pub fn name(&self) -> &str {
        self.file.name()
    }

    /// Its content.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Its content as text: UTF-8, UTF-16 or Latin-1, without byte order mark, blanks at its end and Ctrl-Z.
    ///
    /// # Errors
    /// It is no text.
    pub fn text(&self) -> Result<Cow<'_, str>, DatasetError> {
        text::decode(&self.bytes).ok_or_else(|| self.fault(DatasetErrorKind::NotText))
    }

    /// It with other lines: `change` gets the number (from 1) and the text of each, and says what stands in its place, `None`
    /// for the line itself.
    ///
    /// # Errors
    /// No text, or what `change` finds wrong with a line.
    pub fn with_lines(
        &self,
        mut change: impl FnMut(usize, &str) -> Result<Option<String>, DatasetErrorKind>,
    ) -> Result<TruthFile, DatasetError> {
        let text = self.text()?;
        let mut changed = String::with_capacity(text.len());
        for (number, line) in (1..).zip(text::lines(&text)) {
            let other = change(number, line).map_err(|kind| self.at_line(number).fault(kind))?;
            changed.push_str(other.as_deref().unwrap_or(line));
            changed.push('\n');
        }
        Ok(TruthFile {
            file: self.file.clone(),
            bytes: Cow::Owned(changed.into_bytes()),
        })
    }

    /// The whole of it, as the place of what it says.
    pub fn location(&self) -> Location {
        Location::file(self.path())
    }

    /// Its line `line` (from 1), as the place of what it says.
    pub fn at_line(&self, line: usize) -> Location {
        Location::line(self.path(), line)
    }

    /// A fault of the whole of it.
    pub fn fault(&self, kind: DatasetErrorKind) -> DatasetError {
        self.location().fault(kind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descriptions_are_complete_and_names_unique() {
        let all: Vec<Description> = Formats::builtin().iter().map(Format::describe).collect();
        let names: std::collections::BTreeSet<_> = all.iter().map(|d| d.name).collect();
        assert_eq!(names.len(), all.len());
        for d in all {
            assert!(
                d.name
                    .chars()
                    .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
            );
            for text in [d.summary, d.layout, d.conventions] {
                assert!(
                    !text.is_empty() && !text.ends_with('.') && !text.contains('\n'),
                    "{d:?}"
                );
            }
        }
    }
}
