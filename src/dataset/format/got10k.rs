//! GOT-10k: frames beside `groundtruth.txt`, `absence.label`, `cut_by_image.label`, `cover.label` and `meta_info.ini`; of
//! test sequences the box of the first frame alone.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::annotation::Annotations;
use crate::dataset::storage::File;
use crate::dataset::{DatasetError, DatasetErrorKind, rows, text};

/// See the module.
pub(super) struct Got10k;

const META: &str = "meta_info.ini";
const CUT: &str = "cut_by_image.label";

/// Entries of `meta_info.ini` whose values are tags.
const ENTRIES: [&str; 2] = ["object_class", "motion_class"];

impl Format for Got10k {
    fn describe(&self) -> Description {
        Description {
            name: "got10k",
            summary: "GOT-10k",
            layout: "frames, `groundtruth.txt`, `absence.label`, `cut_by_image.label` and `meta_info.ini` in a folder, or \
                     frames and `groundtruth.txt` in a folder `GOT-10k_*`",
            conventions: "boxes as x y w h, origin 0.5 (at the corner of the first pixel; `--origin 1.5` for boxes that count \
                          pixels from 1), a row per frame in order; `absence.label` 1: absent; one row: the first frame's",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let own = [META, "absence.label", "cover.label", CUT];
        let is_own = place.first_file(&own).is_some() || place.name().starts_with("GOT-10k_");
        let Some(truth) = place.file("groundtruth.txt").filter(|_| is_own) else {
            return Ok(vec![]);
        };
        let (frames, _) = place.images_here_or_in(&["img"])?;
        let mut found = place.sequence(frames, vec![truth.clone()]);
        found.about = [META, CUT]
            .iter()
            .filter_map(|name| place.file(name).cloned())
            .collect();
        let [split, _] = place.names_around();
        if ["train", "val", "test"].contains(&split.as_str()) {
            found.tags.push(split);
        }
        Ok(vec![found])
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        for file in &sequence.about {
            let read = match file.name() {
                META => read_meta(file, annotations),
                _ => read_cut(file, annotations),
            };
            if let Err(e) = read {
                annotations.warn(e);
            }
        }
        table::read_all_or_first(&truth[0], rows::ANY, sequence, annotations)
    }
}

/// Tags of what the object is and how it moves.
fn read_meta(file: &File, annotations: &mut Annotations) -> Result<(), DatasetError> {
    let file = TruthFile::read(file)?;
    for (_, line) in table::lines(&file.text()?) {
        let Some((entry, value)) = line.split_once([':', '=']) else {
            continue;
        };
        if ENTRIES.contains(&entry.trim()) && !value.trim().is_empty() {
            annotations.tag(&value.trim().replace(char::is_whitespace, "-"));
        }
    }
    Ok(())
}

/// A word on frames whose edge cuts the object.
fn read_cut(file: &File, annotations: &mut Annotations) -> Result<(), DatasetError> {
    let file = TruthFile::read(file)?;
    let text = file.text()?;
    let words: Vec<&str> = text::words(&text).collect();
    let frames = annotations.frames().len();
    if words.len() != frames {
        return Err(file.fault(DatasetErrorKind::Doubtful {
            fault: format!("{} values for {frames} frames, which are not used", words.len()),
            remedy: "give one per frame".into(),
        }));
    }
    let cut = words.iter().enumerate().filter(|(_, word)| **word != "0");
    cut.for_each(|(i, _)| annotations.flag(i, "cut-by-image"));
    Ok(())
}
