//! MTF's text: a header `frame ulx uly urx ury lrx lry llx lly`, then a frame's name and its corners in each row.
//! A word in place of the numbers (`tracker_failed`) leaves the frame without annotation.

use super::{Form, corners8};

pub(super) const FORM: Form = Form {
    name: "mtf-text",
    named: true,
    numbers: 8,
    corners: corners8::FORM.corners,
};
