//! The form of OTB: `<sequence>/img/0001.jpg` and boxes in `groundtruth_rect.txt`.

use super::super::annotation::Region;
use super::super::{Origin, Sequence};
use super::{Parts, Target, frames, lost, text};
use mtf::geom::Corners;
use std::path::Path;

#[derive(Debug)]
pub(super) struct Otb;

/// How far two coordinates of a box may differ that should be one, px: below what anyone measures.
const UPRIGHT: f64 = 1e-6;

/// The upright box around `corners`: x, y, width, height; and whether they are one.
fn upright(corners: &Corners) -> ([f64; 4], bool) {
    let sides = [0, 1].map(|k| {
        let values = corners.0.map(|c| c[k]);
        let least = values.into_iter().fold(f64::INFINITY, f64::min);
        let most = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
        (least, most - least)
    });
    let [(x, width), (y, height)] = sides;
    let (own, there) = (Corners::rect(x, y, width, height).to_array(), corners.to_array());
    let same = own.iter().zip(there).all(|(a, b)| (a - b).abs() <= UPRIGHT);
    ([x, y, width, height], same)
}

impl Target for Otb {
    fn name(&self) -> &'static str {
        "otb"
    }

    fn summary(&self) -> &'static str {
        "OTB's form: upright boxes, the first pixel's corner at 0"
    }

    fn parts(&self, sequence: &Sequence) -> Result<Parts, String> {
        let folder = Path::new(sequence.name());
        let mut tilted = 0;
        let row = |i: usize| match &sequence.annotation(i).region {
            Region::Corners(corners) => {
                let ([x, y, width, height], same) = upright(corners);
                tilted += usize::from(!same);
                let origin = Origin::CORNER.value();
                [x + origin, y + origin, width, height]
                    .map(|v| v.to_string())
                    .join(",")
            }
            Region::Absent | Region::Unknown => "NaN,NaN,NaN,NaN".to_owned(),
        };
        let rows = text((0..sequence.len()).map(row).collect::<Vec<_>>());
        let mut lost = lost(sequence, Some("frames without the object"));
        if tilted > 0 {
            lost.insert(
                0,
                format!("{tilted} frames have corners that become the upright boxes around them"),
            );
        }
        Ok(Parts {
            frames: frames(sequence, &folder.join("img"), |i, extension| {
                format!("{:04}.{extension}", i + 1)
            }),
            texts: vec![(folder.join("groundtruth_rect.txt"), rows)],
            folder: folder.to_path_buf(),
            lost,
        })
    }
}
