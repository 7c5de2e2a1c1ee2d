//! UAV123, UAV123 at 10 frames per second and UAV20L: frames in `data_seq/UAV123/VIDEO`, boxes in `anno/UAV123/SEQ.txt`.
//! Several sequences take parts of one video; UAV20L takes whole ones.

use super::{Description, Format, Found, Place, TruthFile, table};
use crate::dataset::DatasetError;
use crate::dataset::annotation::Annotations;
use crate::dataset::rows;
use crate::dataset::storage::{File, Folder};

/// See the module.
pub(super) struct Uav123;

/// Frames of the set at 30 per second for one of the set at 10.
const RATIO: u64 = 3;

/// The columns of `anno/UAV123/att/SEQ.txt`.
const ATTRIBUTES: [&str; 12] = [
    "scale-variation",
    "aspect-ratio-change",
    "low-resolution",
    "fast-motion",
    "full-occlusion",
    "partial-occlusion",
    "out-of-view",
    "background-clutter",
    "illumination-variation",
    "viewpoint-change",
    "camera-motion",
    "similar-object",
];

/// The first and the last frame of sequences that are parts of a video, as the authors list them for 30 frames per second.
#[rustfmt::skip]
const PARTS: [(&str, u64, u64); 51] = [
    ("bird1_1", 1, 253),
    ("bird1_2", 775, 1477),
    ("bird1_3", 1573, 2437),
    ("car1_1", 1, 751),
    ("car1_2", 751, 1627),
    ("car1_3", 1627, 2629),
    ("car6_1", 1, 487),
    ("car6_2", 487, 1807),
    ("car6_3", 1807, 2953),
    ("car6_4", 2953, 3925),
    ("car6_5", 3925, 4861),
    ("car8_1", 1, 1357),
    ("car8_2", 1357, 2575),
    ("car16_1", 1, 415),
    ("car16_2", 415, 1993),
    ("group1_1", 1, 1333),
    ("group1_2", 1333, 2515),
    ("group1_3", 2515, 3925),
    ("group1_4", 3925, 4873),
    ("group2_1", 1, 907),
    ("group2_2", 907, 1771),
    ("group2_3", 1771, 2683),
    ("group3_1", 1, 1567),
    ("group3_2", 1567, 2827),
    ("group3_3", 2827, 4369),
    ("group3_4", 4369, 5527),
    ("person2_1", 1, 1189),
    ("person2_2", 1189, 2623),
    ("person4_1", 1, 1501),
    ("person4_2", 1501, 2743),
    ("person5_1", 1, 877),
    ("person5_2", 877, 2101),
    ("person7_1", 1, 1249),
    ("person7_2", 1249, 2065),
    ("person8_1", 1, 1075),
    ("person8_2", 1075, 1525),
    ("person12_1", 1, 601),
    ("person12_2", 601, 1621),
    ("person14_1", 1, 847),
    ("person14_2", 847, 1813),
    ("person14_3", 1813, 2923),
    ("person17_1", 1, 1501),
    ("person17_2", 1501, 2347),
    ("person19_1", 1, 1243),
    ("person19_2", 1243, 2791),
    ("person19_3", 2791, 4357),
    ("truck4_1", 1, 577),
    ("truck4_2", 577, 1261),
    ("uav1_1", 1, 1555),
    ("uav1_2", 1555, 2377),
    ("uav1_3", 2473, 3469),
];

/// Frames of `video` that the sequence `name` of the set `set` is about.
fn part(name: &str, set: &str, video: &[File]) -> Vec<File> {
    let slow = |n: u64| (n - 1) / RATIO + 1;
    match PARTS.iter().find(|(part, ..)| *part == name) {
        Some(&(_, first, last)) if set.ends_with("10fps") => table::between(video, slow(first), slow(last)),
        Some(&(_, first, last)) => table::between(video, first, last),
        None => video.to_vec(),
    }
}

/// The sequence `name` of the set `set`, whose annotations lie below `root`.
fn sequence(root: &Folder, set: &str, name: &str, video: &[File]) -> Option<Found> {
    let truth = root.file(&format!("anno/{set}/{name}.txt"))?;
    let frames = match set {
        "UAV20L" => video.to_vec(),
        _ => part(name, set, video),
    };
    Some(Found {
        name: name.to_owned(),
        frames,
        truth: vec![truth],
        about: root
            .file(&format!("anno/{set}/att/{name}.txt"))
            .into_iter()
            .collect(),
        dataset: Some(set.to_owned()),
        ..Found::default()
    })
}

impl Format for Uav123 {
    fn describe(&self) -> Description {
        Description {
            name: "uav123",
            summary: "UAV123, also at 10 frames per second, and UAV20L",
            layout: "frames in `data_seq/UAV123/VIDEO` and `anno/UAV123/SEQ.txt`",
            conventions: "boxes as x y w h, origin 0.5 (at the corner of the first pixel; `--origin 1.5` for boxes that count \
                          pixels from 1), a row per frame in order; NaN: absent",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let [set, outer] = place.names_around();
        let root = (0..3).try_fold(place.folder().clone(), |folder, _| folder.parent());
        let (true, Some(root)) = (outer == "data_seq", root) else {
            return Ok(vec![]);
        };
        let video = place.images();
        if video.is_empty() {
            return Ok(vec![]);
        }
        let name = place.name();
        let parts = (1..).map_while(|k| sequence(&root, &set, &format!("{name}_{k}"), &video));
        let parts: Vec<Found> = parts.collect();
        let long = (set == "UAV123").then(|| sequence(&root, "UAV20L", name, &video));
        let whole = sequence(&root, &set, name, &video);
        Ok(whole.into_iter().chain(parts).chain(long.flatten()).collect())
    }

    fn levels_below(&self, place: &Place) -> usize {
        if place.has_folders(&["data_seq", "anno"]) {
            3
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
        let frames = sequence.frames.iter().enumerate();
        rows::read(&truth[0], rows::ANY, frames, annotations)?;
        for file in &sequence.about {
            table::attributes(file, &ATTRIBUTES, annotations);
        }
        Ok(())
    }
}
