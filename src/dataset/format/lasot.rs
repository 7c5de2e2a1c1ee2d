//! LaSOT: `CATEGORY/SEQ/img`, boxes in `groundtruth.txt`, and where the object cannot be seen in `full_occlusion.txt` and
//! `out_of_view.txt`.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::rows;

/// See the module.
pub(super) struct Lasot;

/// The list of sequences for tests.
const TEST: &str = "testing_set.txt";

impl Format for Lasot {
    fn describe(&self) -> Description {
        Description {
            name: "lasot",
            summary: "LaSOT and its extension",
            layout: "`groundtruth.txt`, `full_occlusion.txt`, `out_of_view.txt` and frames in `img/`",
            conventions: "boxes as x y w h, origin 0.5 (at the corner of the first pixel; `--origin 1.5` for boxes that count \
                          pixels from 1), a row per frame in order; full occlusion and out of view: absent",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let own = ["full_occlusion.txt", "out_of_view.txt", "nlp.txt"];
        let (Some(truth), Some(_)) = (place.file("groundtruth.txt"), place.first_file(&own)) else {
            return Ok(vec![]);
        };
        let (frames, inner) = place.images_here_or_in(&["img"])?;
        if inner.is_none() {
            return Ok(vec![]);
        }
        let mut found = place.sequence(frames, vec![truth.clone()]);
        found.about = place
            .file_around(3, &[""], &[TEST.to_owned()])
            .into_iter()
            .collect();
        Ok(vec![found])
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        for list in &sequence.about {
            table::tag_if_listed(list, &sequence.name, "test", annotations);
        }
        rows::read(
            &truth[0],
            rows::ANY,
            sequence.frames.iter().enumerate(),
            annotations,
        )
    }
}
