//! The form of MTF: `<sequence>/frame00001.jpg` and `<sequence>.txt`.

use super::super::{Origin, Sequence};
use super::{Parts, Target, frames, lost, quads, text};
use std::path::Path;

#[derive(Debug)]
pub(super) struct Tmt;

impl Target for Tmt {
    fn name(&self) -> &'static str {
        "tmt"
    }

    fn summary(&self) -> &'static str {
        "MTF's form (TMT, UCSB, LinTrack, PAMI): corners by the frame's name"
    }

    fn parts(&self, sequence: &Sequence) -> Result<Parts, String> {
        let folder = Path::new(sequence.name());
        let name = |i: usize, extension: &str| format!("frame{:05}.{extension}", i + 1);
        let rows = quads(
            sequence,
            "\t",
            Origin::CENTRE,
            &["nan"; 8].join("\t"),
            "not_annotated",
        );
        let named = rows.iter().enumerate().map(|(i, row)| {
            let extension = super::extension(sequence, i);
            format!("{}\t{row}", name(i, &extension))
        });
        let header = "frame\tulx\tuly\turx\tury\tlrx\tlry\tllx\tlly".to_owned();
        Ok(Parts {
            frames: frames(sequence, folder, name),
            texts: vec![(
                format!("{}.txt", sequence.name()).into(),
                text([header].into_iter().chain(named)),
            )],
            folder: folder.to_path_buf(),
            lost: lost(sequence, false, None, None),
        })
    }
}
