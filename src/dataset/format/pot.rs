//! POT-210 and POT-280: videos `V01/V01_1.avi`, or their frames in folders `V01_1`, with `annotation/V01_1_gt_points.txt`,
//! flags and homographies.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::movie::{Movie, film_stem};
use crate::dataset::rows;
use crate::dataset::storage::File;

/// See the module.
pub(super) struct Pot;

/// Folders with the ground truth; archives repeat their names.
const ANNOTATIONS: [&str; 6] = [
    "annotation",
    "annotation/annotation",
    "annotations",
    "POT_annotation",
    "POT_annotation-280",
    "",
];

/// What is hard about the videos `V01_1` to `V01_7`.
const FACTORS: [&str; 7] = [
    "scale",
    "rotation",
    "perspective",
    "motion-blur",
    "occlusion",
    "out-of-view",
    "unconstrained",
];

/// Extensions of videos.
const VIDEOS: [&str; 6] = ["avi", "mp4", "mkv", "mov", "webm", "ogv"];

/// The name of a video without its extension.
fn video(file: &File) -> Option<&str> {
    let (stem, extension) = file.name().rsplit_once('.')?;
    VIDEOS
        .contains(&extension.to_ascii_lowercase().as_str())
        .then_some(stem)
}

/// The tag of a sequence called `V01_5`.
fn factor(name: &str) -> Option<&'static str> {
    let (object, number) = name.strip_prefix('V')?.split_once('_')?;
    object.parse::<u32>().ok()?;
    FACTORS
        .get(number.parse::<usize>().ok()?.checked_sub(1)?)
        .copied()
}

fn sequence(place: &Place, name: &str, frames: Vec<File>) -> Option<Found> {
    let truth = place.file_near(3, &ANNOTATIONS, &[format!("{name}_gt_points.txt")])?;
    Some(Found {
        name: name.to_owned(),
        frames,
        truth: vec![truth],
        tags: factor(name).map(String::from).into_iter().collect(),
        ..Found::default()
    })
}

impl Format for Pot {
    fn describe(&self) -> Description {
        Description {
            name: "pot",
            summary: "POT-210 and POT-280",
            layout: "frames in a folder `SEQ`, and `SEQ_gt_points.txt` in a folder `annotation` near it",
            conventions: "corners as UL UR LR LL, origin 0 (pixel centres at integers), a row per frame in order, or one for \
                          the frames 1, 2, 4, 6, ... that have labels; zeros or NaN: no label; a flag of 1 (occluded), 2 (out \
                          of view) or 3 (blurred): absent",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let videos = || place.files().iter().filter_map(|file| Some((file, video(file)?)));
        // Videos that are unpacked into folders beside them are found there.
        if videos().next().is_some() && place.folders().iter().all(|f| factor(f.name()).is_none()) {
            let packed = videos().filter_map(|(file, name)| {
                let found = sequence(place, name, vec![])?;
                // Motion-JPEG is read as it is.
                Some(match film_stem(file.name()) {
                    Some(_) if matches!(Movie::of(file), Ok(Some(_))) => Found {
                        frames: vec![file.clone()],
                        ..found
                    },
                    _ => Found {
                        packed: Some(file.clone()),
                        ..found
                    },
                })
            });
            let packed: Vec<Found> = packed.collect();
            if !packed.is_empty() {
                return Ok(packed);
            }
        }
        let (frames, _) = place.images_here_or_in(&["img"])?;
        if frames.is_empty() {
            return Ok(vec![]);
        }
        Ok(sequence(place, place.name(), frames).into_iter().collect())
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let file = &truth[0];
        let frames = || sequence.frames.iter().enumerate();
        let labelled = || frames().filter(|(i, _)| *i == 0 || i % 2 == 1);
        let rows = table::lines(&file.text()?).count();
        if rows < frames().count() && rows == labelled().count() {
            rows::read(file, rows::ANY, labelled(), annotations)?;
        } else {
            rows::read(file, rows::ANY, frames(), annotations)?;
        }
        table::unlabelled(annotations);
        Ok(())
    }
}
