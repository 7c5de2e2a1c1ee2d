//! Eight numbers a row: `ulx uly urx ury lrx lry llx lly`, pixel centres at integers.

use super::Form;
use mtf::geom::Corners;

pub(super) const FORM: Form = Form {
    name: "corners",
    named: false,
    numbers: 8,
    corners,
};

fn corners(v: &[f64]) -> Corners {
    Corners([[v[0], v[1]], [v[2], v[3]], [v[4], v[5]], [v[6], v[7]]])
}
