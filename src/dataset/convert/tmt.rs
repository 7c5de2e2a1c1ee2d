//! The form of MTF: `<sequence>/frame00001.jpg` and `<sequence>.txt`.

use super::super::Sequence;
use super::{Parts, Target, extension, lost, named_quads};
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
        let name = |i: usize| format!("frame{:05}.{}", i + 1, extension(sequence, i));
        let names: Vec<String> = (0..sequence.len()).map(name).collect();
        let truth = format!("{}.txt", sequence.name());
        Ok(Parts {
            texts: vec![(truth.into(), named_quads(sequence, &names))],
            frames: names.iter().map(|name| folder.join(name)).collect(),
            folder: folder.to_path_buf(),
            lost: lost(sequence, None),
        })
    }
}
