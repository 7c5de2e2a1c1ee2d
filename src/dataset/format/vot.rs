//! VOT's sequences: polygons or boxes, frames in `color/` or beside VOT's own files.

use super::{Description, Format, Found, Place, TruthFile};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::rows::{self, BOX, NAMED_CORNERS, PIXEL_CORNER, RowKind};
use mtf::geom::Corners;

/// See the module.
pub(super) struct Vot;

/// `x1,y1,...,x4,y4`, the origin at the corner of the first pixel.
const POLYGON: RowKind = RowKind {
    about: "8 corner coordinates (UL UR LR LL)",
    named: false,
    numbers: 8,
    corners: |v| {
        Corners([[v[0], v[1]], [v[2], v[3]], [v[4], v[5]], [v[6], v[7]]])
            .translated(PIXEL_CORNER, PIXEL_CORNER)
    },
};

impl Format for Vot {
    fn describe(&self) -> Description {
        Description {
            name: "vot",
            summary: "sequences of the Visual Object Tracking challenge, axis-aligned or rotated",
            layout: "`groundtruth.txt` and frames in `color/`, or beside `sequence` or `*.tag`",
            conventions: "origin at the corner of the first pixel; polygons as UL UR LR LL or boxes as x y w h, a row \
                          per frame in order",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let Some(truth) = place.first_file(&["groundtruth.txt", "groundtruth_rect.txt"]) else {
            return Ok(vec![]);
        };
        let own = |name: &str| name == "sequence" || name.ends_with(".tag");
        let has_own_files = place.files().iter().any(|file| own(file.name()));
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
            &[POLYGON, BOX, NAMED_CORNERS],
            sequence.frames.iter().enumerate(),
            annotations,
        )
    }
}
