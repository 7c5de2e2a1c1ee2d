//! The form of PlanarTrack: frames in `sequences/<sequence>`, corners in `annos/<sequence>.txt`, flags beside them.

use super::super::annotation::Region;
use super::super::{Origin, Sequence};
use super::{Parts, Target, frames, lost, quads, text};
use std::path::Path;

#[derive(Debug)]
pub(super) struct PlanarTrack;

impl Target for PlanarTrack {
    fn name(&self) -> &'static str {
        "planartrack"
    }

    fn summary(&self) -> &'static str {
        "PlanarTrack's form: corners and flags in annos/, frames in sequences/"
    }

    fn parts(&self, sequence: &Sequence) -> Result<Parts, String> {
        let name = sequence.name();
        let folder = Path::new("sequences").join(name);
        let nothing = ["0"; 8].join(",");
        let rows = quads(sequence, ",", Origin::CENTRE, &nothing, &nothing);
        let flag = |i: usize| u8::from(sequence.annotation(i).region == Region::Absent) * 2;
        let flags = (0..sequence.len()).map(|i| flag(i).to_string());
        Ok(Parts {
            frames: frames(sequence, &folder, |i, extension| {
                format!("{:05}.{extension}", i + 1)
            }),
            texts: vec![
                (Path::new("annos").join(format!("{name}.txt")), text(rows)),
                (Path::new("annos").join(format!("{name}_flag.txt")), text(flags)),
            ],
            folder,
            lost: lost(sequence, None),
        })
    }
}
