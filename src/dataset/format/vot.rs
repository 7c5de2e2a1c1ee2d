//! VOT's sequences: polygons, boxes or masks, frames in `color/`, in the channel that `sequence` names, or beside VOT's own
//! files. VOTS has a file `groundtruth_ID.txt` for each object.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::annotation::Annotations;
use crate::dataset::mask;
use crate::dataset::reading::Origin;
use crate::dataset::rows::{self, BOX, CORNERS, NAMED_BOX, NAMED_CORNERS, RowKind};
use crate::dataset::storage::File;
use crate::dataset::{DatasetError, DatasetErrorKind, text};
use mtf::geom::Corners;
use std::path::Path;

/// See the module.
pub(super) struct Vot;

/// `x1,y1,...,x4,y4`, the origin at the corner of the first pixel.
const POLYGON: RowKind = RowKind {
    origin: Origin::CORNER,
    ..CORNERS
};

const KINDS: &[RowKind] = &[POLYGON, BOX, NAMED_CORNERS, NAMED_BOX];

/// Labels of frames as of 2013; later they are called `*.tag`.
const LABELS: [&str; 5] = [
    "camera_motion.label",
    "illum_change.label",
    "motion_change.label",
    "occlusion.label",
    "size_change.label",
];

/// Whether files lie in `place` that no other data set has.
fn has_own_files(place: &Place) -> bool {
    let own = |name: &str| name == "sequence" || name.ends_with(".tag") || LABELS.contains(&name);
    place.files().iter().any(|file| own(file.name()))
}

/// The object that a file of ground truth is of: `ID` of `groundtruth_ID.txt`.
fn object(file: &File) -> Option<&str> {
    let id = file.name().strip_prefix("groundtruth_")?.strip_suffix(".txt")?;
    (!id.is_empty() && id != "rect").then_some(id)
}

/// Images of the channel that the file `sequence` names: `channels.color=color/%08d.jpg`, else the first.
fn channel(place: &Place) -> Result<Vec<File>, DatasetError> {
    let Some(file) = place.file("sequence") else {
        return Ok(vec![]);
    };
    let file = TruthFile::read(file)?;
    let text = file.text()?;
    let channels = table::lines(&text).filter_map(|(_, line)| line.trim().strip_prefix("channels."));
    let mut channels: Vec<(&str, &str)> = channels.filter_map(|line| line.split_once('=')).collect();
    channels.sort_by_key(|(name, _)| name.trim() != "color");
    let path = channels.first().map(|(_, path)| path.trim().replace('\\', "/"));
    let name = path.as_deref().map(Path::new).and_then(|path| path.iter().next());
    let folder = place
        .folders()
        .iter()
        .find(|folder| name == Some(folder.name().as_ref()));
    folder.map_or(Ok(vec![]), |folder| Ok(Place::new(folder)?.images()))
}

/// The rows of `file` as rows of corners and boxes: one number (the code of a frame without region) and an empty mask leave the
/// frame without annotation; masks, and polygons of more than four points, become the smallest rectangle around them where
/// that is asked for.
fn plain(file: &TruthFile, fit: bool) -> Result<TruthFile, DatasetError> {
    let mut before: Option<Corners> = None;
    file.with_lines(|_, row| {
        let points = if mask::is_mask(row) {
            if !fit {
                return Err(DatasetErrorKind::Masks { what: "a mask" });
            }
            mask::outline(row)?
        } else {
            let words: Vec<&str> = text::words(row).collect();
            let numbers: Vec<f64> = words.iter().filter_map(|word| word.parse().ok()).collect();
            match numbers.len() {
                n if n != words.len() => return Ok(None),
                1.. if numbers.iter().all(|v| v.is_nan()) => return Ok(Some("absent".into())),
                1 => return Ok(Some("unannotated".into())),
                n if n > 9 && n % 2 == 0 && numbers.iter().all(|v| v.is_finite()) => {
                    if !fit {
                        return Err(DatasetErrorKind::Masks {
                            what: "a polygon of more than four points",
                        });
                    }
                    // Where pixel centres are at integers.
                    let corner = Origin::CORNER.value();
                    numbers
                        .chunks(2)
                        .map(|p| [p[0] - corner, p[1] - corner])
                        .collect()
                }
                _ => return Ok(None),
            }
        };
        let Some(corners) = mask::rectangle(&points, before.as_ref()) else {
            return Ok(Some("absent".into()));
        };
        before = Some(corners);
        // As the rows of the file count.
        let corner = Origin::CORNER.value();
        let numbers = corners.translated(corner, corner).to_array();
        Ok(Some(numbers.map(|v| v.to_string()).join(",")))
    })
}

impl Format for Vot {
    fn describe(&self) -> Description {
        Description {
            name: "vot",
            summary: "sequences of the Visual Object Tracking challenge (also VOT-LT, VOTS), axis-aligned or rotated",
            layout: "`groundtruth.txt` (`groundtruth_ID.txt` for several objects) and frames in `color/`, or beside `sequence`, \
                     `*.tag` or `occlusion.label`",
            conventions: "origin 0.5 (at the corner of the first pixel); polygons as UL UR LR LL or boxes as x y w h, \
                          a row per frame in order; NaN: absent; one number: not annotated; masks and polygons of more points \
                          with `--fit-masks` as the smallest rectangle around them",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let objects = || place.files().iter().filter(|file| object(file).is_some());
        let truth: Vec<&File> = match place.first_file(&["groundtruth.txt", "groundtruth_rect.txt"]) {
            Some(truth) => vec![truth],
            None => objects().collect(),
        };
        if truth.is_empty() {
            return Ok(vec![]);
        }
        let has_own_files = has_own_files(place);
        let (mut frames, inner) = place.images_here_or_in(&["color", "img"])?;
        if !has_own_files && inner != Some("color") {
            return Ok(vec![]);
        }
        if frames.is_empty() {
            frames = channel(place)?;
        }
        let found = truth.into_iter().map(|truth| {
            let mut found = place.sequence(frames.clone(), vec![truth.clone()]);
            if let Some(object) = object(truth) {
                found.name = format!("{}-{object}", place.name());
                found.object = Some(object.to_owned());
            }
            found
        });
        Ok(found.collect())
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let file = plain(&truth[0], annotations.asked.fit_masks)?;
        let rows = table::lines(&file.text()?).count();
        // The rows of an object end with the frames that are annotated.
        if sequence.object.is_some() && (2..sequence.frames.len()).contains(&rows) {
            let frames = sequence.frames.iter().enumerate().take(rows);
            return rows::read(&file, KINDS, frames, annotations);
        }
        table::read_all_or_first(&file, KINDS, sequence, annotations)
    }

    fn doubt(&self, place: &Place, sequence: &Found, annotations: &Annotations) -> Option<DatasetError> {
        let polygons = annotations.boxes.is_none() && annotations.origin != Origin::CENTRE;
        if !polygons || annotations.asked.origin.is_some() || has_own_files(place) {
            return None;
        }
        let kind = DatasetErrorKind::Doubtful {
            fault: "corners are read with the origin at the corner of the first pixel, as VOT's are, for nothing but the \
                    folder `color`"
                .into(),
            remedy: "give `--origin 0.5` if that is right, `--origin 0` if pixel centres are at integers (or `\"origin\"` \
                     in meta.json)"
                .into(),
        };
        Some(DatasetError::new(sequence.truth.first()?.path(), kind))
    }
}
