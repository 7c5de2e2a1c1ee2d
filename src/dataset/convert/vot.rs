//! The form of the VOT toolkit: `<sequence>/color/00000001.jpg`, polygons in `groundtruth.txt`, the file `sequence`, a list.

use super::super::{Origin, Sequence};
use super::{Parts, Target, extension, frames, lost, quads, text};
use std::path::Path;

#[derive(Debug)]
pub(super) struct Vot;

impl Target for Vot {
    fn name(&self) -> &'static str {
        "vot"
    }

    fn summary(&self) -> &'static str {
        "VOT's form: polygons, the first pixel's corner at 0"
    }

    fn parts(&self, sequence: &Sequence) -> Result<Parts, String> {
        let folder = Path::new(sequence.name());
        let kind = extension(sequence, 0);
        if let Some(other) = (1..sequence.len()).find(|&i| extension(sequence, i) != kind) {
            return Err(format!(
                "frames of several formats ({}, {}), while VOT names one; convert them first",
                sequence.frame_name(0),
                sequence.frame_name(other)
            ));
        }
        let rows = quads(sequence, ",", Origin::CORNER, &["nan"; 8].join(","), "0");
        let about = format!(
            "channels.color=color/%08d.{kind}\nformat=default\nfps=30\nname={}\n",
            sequence.name()
        );
        Ok(Parts {
            frames: frames(sequence, &folder.join("color"), |i, extension| {
                format!("{:08}.{extension}", i + 1)
            }),
            texts: vec![
                (folder.join("groundtruth.txt"), text(rows)),
                (folder.join("sequence"), about),
            ],
            folder: folder.to_path_buf(),
            lost: lost(sequence, None),
        })
    }
}
