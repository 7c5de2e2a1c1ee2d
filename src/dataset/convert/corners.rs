//! A folder of frames with `groundtruth.txt`: the frames keep their names.

use super::super::Sequence;
use super::{Parts, Target, lost, named_quads};
use std::path::Path;

#[derive(Debug)]
pub(super) struct Corners;

impl Target for Corners {
    fn name(&self) -> &'static str {
        "corners"
    }

    fn summary(&self) -> &'static str {
        "a folder of frames, which keep their names, with corners in groundtruth.txt"
    }

    fn parts(&self, sequence: &Sequence) -> Result<Parts, String> {
        let folder = Path::new(sequence.name());
        let name = |i: usize| match sequence.is_film() {
            true => format!("frame{:05}.png", i + 1),
            false => sequence.frame_name(i).to_owned(),
        };
        let names: Vec<String> = (0..sequence.len()).map(name).collect();
        Ok(Parts {
            texts: vec![(folder.join("groundtruth.txt"), named_quads(sequence, &names))],
            frames: names.iter().map(|name| folder.join(name)).collect(),
            folder: folder.to_path_buf(),
            lost: lost(sequence, None),
        })
    }
}
