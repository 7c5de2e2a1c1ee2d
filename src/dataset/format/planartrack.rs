//! PlanarTrack: frames in `sequences/SEQ`, corners in `annos/SEQ.txt` (`annotation` in its toolkit), flags, homographies and
//! attributes beside them.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::rows;

/// See the module.
pub(super) struct PlanarTrack;

/// Folders with the ground truth.
const ANNOTATIONS: [&str; 3] = ["annos", "annotation", "annotations"];

/// What the columns of `challenging_factor/SEQ_challenging_factor.txt` say.
const FACTORS: [&str; 8] = [
    "occlusion",
    "motion-blur",
    "rotation",
    "scale-variation",
    "perspective-distortion",
    "out-of-view",
    "low-resolution",
    "background-clutter",
];

/// Lists of sequences, and the tag of those in it.
const SPLITS: [(&str, &str); 3] = [
    ("training_set.txt", "train"),
    ("train_seq.txt", "train"),
    ("test_seq.txt", "test"),
];

impl Format for PlanarTrack {
    fn describe(&self) -> Description {
        Description {
            name: "planartrack",
            summary: "PlanarTrack",
            layout: "frames in a folder `SEQ`, and `SEQ.txt` with `SEQ_flag.txt` or `SEQ_homography.txt` in a folder `annos` \
                     or `annotation` near it",
            conventions: "corners as UL UR LR LL, origin 0 (pixel centres at integers), a row per frame in order; zeros: no \
                          label; a flag of 1 (occluded), 2 (out of view) or 3 (blurred): absent",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let frames = place.images();
        let name = place.name();
        let truth = || place.file_around(3, &ANNOTATIONS, &[format!("{name}.txt")]);
        let Some(truth) = (!frames.is_empty()).then(truth).flatten() else {
            return Ok(vec![]);
        };
        let own = ["flag", "homography"].map(|end| format!("{name}_{end}.txt"));
        if own.iter().all(|own| truth.beside(own).is_none()) {
            return Ok(vec![]);
        }
        let mut found = place.sequence(frames, vec![truth]);
        let factors = [
            "challenging_factor",
            "annos/challenging_factor",
            "annotation/challenging_factor",
        ];
        let factor = place.file_around(3, &factors, &[format!("{name}_challenging_factor.txt")]);
        let splits = SPLITS.map(|(list, _)| {
            place.file_around(3, &["training-test-splits", "test_split"], &[list.to_owned()])
        });
        found.about = factor.into_iter().chain(splits.into_iter().flatten()).collect();
        Ok(vec![found])
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let frames = sequence.frames.iter().enumerate();
        rows::read(&truth[0], rows::ANY, frames, annotations)?;
        table::unlabelled(annotations);
        for file in &sequence.about {
            match SPLITS.iter().find(|(list, _)| file.name() == *list) {
                Some((_, tag)) => table::tag_if_listed(file, &sequence.name, tag, annotations),
                None => table::attributes(file, &FACTORS, annotations),
            }
        }
        Ok(())
    }
}
