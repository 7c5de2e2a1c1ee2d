//! A folder of frames with `groundtruth.txt`: the frames keep their names.

use super::super::{Origin, Sequence};
use super::{Parts, Target, lost, quads, text};
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
        let rows = quads(
            sequence,
            "\t",
            Origin::CENTRE,
            &["nan"; 8].join("\t"),
            "not_annotated",
        );
        let named = names
            .iter()
            .zip(rows)
            .map(|(name, row)| match name.contains(char::is_whitespace) {
                true => format!("\"{name}\"\t{row}"),
                false => format!("{name}\t{row}"),
            });
        let header = "frame\tulx\tuly\turx\tury\tlrx\tlry\tllx\tlly".to_owned();
        Ok(Parts {
            frames: names.iter().map(|name| folder.join(name)).collect(),
            texts: vec![(
                folder.join("groundtruth.txt"),
                text([header].into_iter().chain(named)),
            )],
            folder: folder.to_path_buf(),
            lost: lost(sequence, false, None, None),
        })
    }
}
