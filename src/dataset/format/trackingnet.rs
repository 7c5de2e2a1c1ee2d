//! TrackingNet: `TRAIN_0/frames/SEQ` and `TRAIN_0/anno/SEQ.txt`, archives of frames in `TRAIN_0/zips`.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::rows;

/// See the module.
pub(super) struct TrackingNet;

impl Format for TrackingNet {
    fn describe(&self) -> Description {
        Description {
            name: "trackingnet",
            summary: "TrackingNet",
            layout: "frames in `frames/SEQ` and `anno/SEQ.txt`",
            conventions: "boxes as x y w h, origin 0.5 (at the corner of the first pixel), a row per frame in order; one row: the \
                          first frame's",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        if place.has_folders(&["anno", "zips"]) && !place.has_folders(&["frames"]) {
            return packed(place);
        }
        let [around, split] = place.names_around();
        if around != "frames" {
            return Ok(vec![]);
        }
        let frames = place.images();
        let outer = place.folder().parent().and_then(|around| around.parent());
        let truth = outer.and_then(|outer| outer.file(&format!("anno/{}.txt", place.name())));
        let Some(truth) = truth.filter(|_| !frames.is_empty()) else {
            return Ok(vec![]);
        };
        let mut found = place.sequence(frames, vec![truth]);
        found.dataset = Some(split);
        Ok(vec![found])
    }

    fn levels_below(&self, place: &Place) -> usize {
        if place.has_folders(&["anno", "frames"]) {
            2
        } else {
            0
        }
    }

    fn read(
        &self,
        sequence: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        table::read_all_or_first(&truth[0], rows::ANY, sequence, annotations)
    }
}

/// Sequences of which the frames are in archives still.
fn packed(place: &Place) -> Result<Vec<Found>, DatasetError> {
    let Some(zips) = place.folders().iter().find(|folder| folder.name() == "zips") else {
        return Ok(vec![]);
    };
    let zips = Place::new(zips)?;
    let found = zips.files().iter().filter_map(|zip| {
        let name = zip.name().strip_suffix(".zip")?;
        Some(Found {
            name: name.to_owned(),
            truth: vec![place.folder().file(&format!("anno/{name}.txt"))?],
            packed: Some(zip.clone()),
            dataset: Some(place.name().to_owned()),
            ..Found::default()
        })
    });
    Ok(found.collect())
}
