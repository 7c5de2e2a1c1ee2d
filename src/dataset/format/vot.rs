//! VOT's sequences: polygons or boxes, frames in `color/` or beside VOT's own files.

use super::{Description, Format, Found, Place, TruthFile};
use crate::dataset::annotation::Annotations;
use crate::dataset::reading::Origin;
use crate::dataset::rows::{self, BOX, CORNERS, NAMED_BOX, NAMED_CORNERS, RowKind};
use crate::dataset::{DatasetError, DatasetErrorKind};

/// See the module.
pub(super) struct Vot;

/// `x1,y1,...,x4,y4`, the origin at the corner of the first pixel.
const POLYGON: RowKind = RowKind {
    origin: Origin::CORNER,
    ..CORNERS
};

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

impl Format for Vot {
    fn describe(&self) -> Description {
        Description {
            name: "vot",
            summary: "sequences of the Visual Object Tracking challenge, axis-aligned or rotated",
            layout: "`groundtruth.txt` and frames in `color/`, or beside `sequence`, `*.tag` or `occlusion.label`",
            conventions: "origin 0.5 (at the corner of the first pixel); polygons as UL UR LR LL or boxes as x y w h, \
                          a row per frame in order",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let Some(truth) = place.first_file(&["groundtruth.txt", "groundtruth_rect.txt"]) else {
            return Ok(vec![]);
        };
        let has_own_files = has_own_files(place);
        let (frames, inner) = place.images_here_or_in(&["color", "img"])?;
        if !has_own_files && inner != Some("color") {
            return Ok(vec![]);
        }
        Ok(vec![place.sequence(frames, vec![truth.clone()])])
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        rows::read(
            &truth[0],
            &[POLYGON, BOX, NAMED_CORNERS, NAMED_BOX],
            sequence.frames.iter().enumerate(),
            annotations,
        )
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
