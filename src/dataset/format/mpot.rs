//! MPOT-3K: several planar objects in a video, frames in `seq1/`, all corners in `gt/gt_obj.txt`.

use super::table::Objects;
use super::{Description, Format, Found, Place, TruthFile};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::rows::CORNERS;

/// See the module.
pub(super) struct Mpot;

/// Frame, instance, four points, class, object.
const ROWS: Objects = Objects {
    object: 11,
    region: 2..10,
    all: 12,
    kind: CORNERS,
    counts: |_| true,
};

/// How things move in the videos `SCENE-1` to `SCENE-9`.
const PATTERNS: [&str; 9] = [
    "far-near",
    "in-plane-rotation",
    "out-plane-rotation",
    "in-plane-movement",
    "motion-blur",
    "camera-occlusion",
    "unconstrained",
    "moving-objects",
    "moving-occlusions",
];

fn pattern(name: &str) -> Option<&'static str> {
    let (_, number) = name.rsplit_once('-')?;
    PATTERNS
        .get(number.parse::<usize>().ok()?.checked_sub(1)?)
        .copied()
}

impl Format for Mpot {
    fn describe(&self) -> Description {
        Description {
            name: "mpot",
            summary: "MPOT-3K, a sequence for each planar object of a video",
            layout: "`gt/gt_obj.txt` and frames in `seq1/`",
            conventions: "corners as UL UR LR LL, origin 0 (pixel centres at integers), after the number of the frame, from \
                          1; a frame without a row for the object: not annotated",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        if !place.has_folders(&["gt"]) {
            return Ok(vec![]);
        }
        let Some(truth) = place.folder().file("gt/gt_obj.txt") else {
            return Ok(vec![]);
        };
        let (frames, _) = place.images_here_or_in(&["seq1", "img1"])?;
        let mut found = ROWS.find(place, &frames, &truth);
        let [split, _] = place.names_around();
        let split = Some(split).filter(|split| ["train", "val", "test"].contains(&split.as_str()));
        let tags = pattern(place.name()).map(String::from);
        let tags: Vec<String> = split.into_iter().chain(tags).collect();
        found.iter_mut().for_each(|found| found.tags = tags.clone());
        Ok(found)
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        ROWS.read(sequence, &truth[0], annotations)
    }
}
