//! Data of no known format: what lies there, and which format it is nearest to.
//!
//! A format's parts are the names in backquotes in its [`layout`](super::Description::layout): words in capitals and `*`
//! stand for any name. The nearest format is the one of which most parts are there. Depends on formats and storage.

use super::DatasetError;
use super::decode::is_image_name;
use super::format::{Formats, Place};
use super::storage::{File, Folder};
use std::collections::{BTreeMap, BTreeSet};

/// So many names are told of each kind.
const TOLD: usize = 4;

/// Names of what lies in folders.
#[derive(Debug, Default)]
pub(super) struct Inventory {
    folders: BTreeSet<String>,
    /// Names of all that is there or near, images apart.
    names: BTreeSet<String>,
    /// Files that are no images.
    others: BTreeMap<String, usize>,
    images: usize,
}

impl Inventory {
    /// Of `folder` and `levels` levels below it.
    ///
    /// # Errors
    /// A folder cannot be listed.
    pub fn below(folder: &Folder, levels: usize) -> Result<Self, DatasetError> {
        let mut inventory = Inventory::default();
        inventory.walk(folder, levels)?;
        Ok(inventory)
    }

    /// Of `place`; the two folders around it count for what is near.
    pub fn around(place: &Place) -> Self {
        let mut inventory = Inventory::default();
        inventory.add(place);
        for folder in std::iter::successors(place.folder().parent(), Folder::parent).take(2) {
            if let Ok(place) = Place::new(&folder) {
                inventory.note(&place);
            }
        }
        inventory
    }

    fn walk(&mut self, folder: &Folder, levels: usize) -> Result<(), DatasetError> {
        let place = Place::new(folder)?;
        self.add(&place);
        if levels > 0 {
            for inner in place.folders() {
                self.walk(inner, levels - 1)?;
            }
        }
        Ok(())
    }

    fn add(&mut self, place: &Place) {
        self.note(place);
        let folders = place.folders().iter().map(|folder| folder.name().to_owned());
        self.folders.extend(folders);
        for file in place.files() {
            if is_image_name(file.name()) {
                self.images += 1;
                continue;
            }
            let extension = file.name().rsplit_once('.').map_or("", |(_, e)| e);
            *self.others.entry(extension.to_owned()).or_default() += 1;
        }
    }

    fn note(&mut self, place: &Place) {
        let files = place.files().iter().map(File::name);
        let files = files.filter(|name| !is_image_name(name));
        let folders = place.folders().iter().map(Folder::name);
        self.names.extend(files.chain(folders).map(String::from));
    }

    /// What is there, in words.
    pub fn found(&self) -> String {
        let mut parts = Vec::new();
        if !self.folders.is_empty() {
            let more = if self.folders.len() > TOLD { ", ..." } else { "" };
            let names: Vec<String> = self.folders.iter().take(TOLD).map(|n| format!("`{n}`")).collect();
            parts.push(format!("folders {}{more}", names.join(", ")));
        }
        if self.images > 0 {
            parts.push(format!("{} images", self.images));
        }
        let mut others: Vec<(&String, &usize)> = self.others.iter().collect();
        others.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        for (extension, count) in others.into_iter().take(TOLD) {
            let what = match extension.as_str() {
                "" => "without extension".to_owned(),
                extension => format!("`.{extension}`"),
            };
            parts.push(format!("{count} {what}"));
        }
        match parts.is_empty() {
            true => "nothing".into(),
            false => parts.join(", "),
        }
    }

    /// The format of which most is there, in words; `None` when nothing is there of any.
    pub fn nearest(&self, formats: &Formats) -> Option<String> {
        let there = formats.iter().map(|format| {
            let description = format.describe();
            let parts = parts(description.layout);
            let there: Vec<String> = parts
                .iter()
                .filter(|part| self.has(part))
                .map(|part| format!("`{part}`"))
                .collect();
            (there, parts.len(), description)
        });
        // Of several, the one of which less is missing, then the first.
        let best = there.min_by_key(|(there, parts, _)| (std::cmp::Reverse(there.len()), *parts));
        let (there, _, description) = best.filter(|(there, ..)| !there.is_empty())?;
        Some(format!(
            "nearest is the format {} for {}, which has {}",
            description.name,
            there.join(", "),
            description.layout
        ))
    }

    fn has(&self, part: &str) -> bool {
        let pattern = pattern(part);
        self.names.iter().any(|name| matches(name, &pattern))
    }
}

/// The names that a layout speaks of, those that stand for any name left out.
fn parts(layout: &str) -> Vec<&str> {
    let quoted = layout.split('`').skip(1).step_by(2);
    let names = quoted
        .flat_map(|path| path.split('/'))
        .filter(|name| !name.is_empty());
    let mut parts: Vec<&str> = Vec::new();
    for name in names {
        let fixed: usize = pattern(name).iter().map(|piece| piece.len()).sum();
        let extension_alone = name.rsplit_once('.').is_some_and(|(_, e)| fixed <= e.len() + 1);
        if fixed > 1 && !extension_alone && !parts.contains(&name) {
            parts.push(name);
        }
    }
    parts
}

/// The fixed pieces of a name, between words in capitals or `*`.
fn pattern(name: &str) -> Vec<String> {
    let mut pieces = vec![String::new()];
    let stands = |word: &str| word.len() > 2 && word.chars().all(|c| c.is_ascii_uppercase()) && word != "GOT";
    for (k, word) in name.split_inclusive(['_', '.', '-', '*']).enumerate() {
        let bare = word.trim_end_matches(['_', '.', '-', '*']);
        let end = &word[bare.len()..];
        if stands(bare) || word == "*" || k > 0 && bare.is_empty() && end == "*" {
            pieces.push(String::new());
        } else if let Some(last) = pieces.last_mut() {
            last.push_str(bare);
        }
        if let Some(last) = pieces.last_mut() {
            last.push_str(end.trim_end_matches('*'));
        }
        if end.ends_with('*') && word != "*" {
            pieces.push(String::new());
        }
    }
    pieces
}

/// Whether `name` begins and ends as the pattern does, and has the other pieces in between.
fn matches(name: &str, pattern: &[String]) -> bool {
    let [first, between @ .., last] = pattern else {
        return pattern.first().is_some_and(|only| only == name);
    };
    let Some(mut rest) = name.strip_prefix(first.as_str()) else {
        return false;
    };
    for piece in between {
        match rest.find(piece.as_str()) {
            Some(at) => rest = &rest[at + piece.len()..],
            None => return false,
        }
    }
    rest.ends_with(last.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_layouts() {
        for (layout, expected) in [
            (
                "`groundtruth_rect.txt` and frames in `img/`",
                &["groundtruth_rect.txt", "img"][..],
            ),
            ("frames in a folder `SEQ` and `SEQ.txt` beside it", &[]),
            (
                "`SEQ_flag.txt` in `annos` or `data_seq/UAV123/VIDEO`",
                &["SEQ_flag.txt", "annos", "data_seq", "UAV123"],
            ),
            (
                "frames and `OBJECT.corners.json`, `*_gt.txt`",
                &["OBJECT.corners.json", "*_gt.txt"],
            ),
        ] {
            assert_eq!(parts(layout), expected, "{layout}");
        }
        for (name, part, expected) in [
            ("A_1_flag.txt", "SEQ_flag.txt", true),
            ("A_1_flags.txt", "SEQ_flag.txt", false),
            ("David_gt.txt", "*_gt.txt", true),
            ("GOT-10k_Val_000001", "GOT-10k_*", true),
            ("img", "img", true),
            ("img1", "img", false),
            ("left.corners.json", "OBJECT.corners.json", true),
        ] {
            assert_eq!(matches(name, &pattern(part)), expected, "{name} {part}");
        }
    }
}
