//! OTB's and VOT's box: `x y width height`, the origin at the corner of the first pixel.

use super::{CORNER_TO_CENTRE, Form};
use mtf::geom::Corners;

pub(super) const FORM: Form = Form {
    name: "box",
    named: false,
    numbers: 4,
    // A negative extent is no extent: such a box has zero area. NaN stays NaN.
    corners: |v| {
        let extent = |e: f64| if e < 0.0 { 0.0 } else { e };
        Corners::rect(
            v[0] + CORNER_TO_CENTRE,
            v[1] + CORNER_TO_CENTRE,
            extent(v[2]),
            extent(v[3]),
        )
    },
};
