//! The form of POT: corners in `annotation/<sequence>_gt_points.txt` with flags and homographies, frames in folders as its
//! videos are unpacked.

use super::super::annotation::Region;
use super::super::{Origin, Sequence};
use super::{Parts, Target, frames, lost, quads, text};
use mtf::geom::{Corners, homography};
use std::path::Path;

#[derive(Debug)]
pub(super) struct Pot;

impl Target for Pot {
    fn name(&self) -> &'static str {
        "pot"
    }

    fn summary(&self) -> &'static str {
        "POT's form: corners, flags and homographies in annotation/, frames in a folder"
    }

    fn parts(&self, sequence: &Sequence) -> Result<Parts, String> {
        let name = sequence.name();
        let annotation = |what: &str| Path::new("annotation").join(format!("{name}_{what}.txt"));
        let nothing = ["NaN"; 8].join(" ");
        let rows = quads(sequence, " ", Origin::CENTRE, &nothing, &nothing);
        let first = (0..sequence.len()).find_map(|i| sequence.annotation(i).corners());
        let matrix = |i: usize| {
            let to = sequence.annotation(i).corners();
            let between = first
                .zip(to)
                .and_then(|(from, to): (Corners, Corners)| homography::from_corners(&from, &to));
            // Row by row.
            between.map_or(["NaN"; 9].join(" "), |m| {
                m.transpose()
                    .iter()
                    .map(f64::to_string)
                    .collect::<Vec<_>>()
                    .join(" ")
            })
        };
        let absent = |i: usize| u8::from(sequence.annotation(i).region == Region::Absent) * 2;
        let frames_of = 0..sequence.len();
        Ok(Parts {
            frames: frames(sequence, Path::new(name), |i, extension| {
                format!("{:05}.{extension}", i + 1)
            }),
            texts: vec![
                (annotation("gt_points"), text(rows)),
                (annotation("gt_homography"), text(frames_of.clone().map(matrix))),
                (annotation("flag"), text(frames_of.map(|i| absent(i).to_string()))),
            ],
            folder: name.into(),
            lost: lost(sequence, None),
        })
    }
}
