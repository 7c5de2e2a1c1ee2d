//! VOT's polygon: `x1,y1,...,x4,y4`, the origin at the corner of the first pixel.

use super::{CORNER_TO_CENTRE, Form, corners8};

pub(super) const FORM: Form = Form {
    name: "vot-polygon",
    named: false,
    numbers: 8,
    corners: |v| (corners8::FORM.corners)(v).translated(CORNER_TO_CENTRE, CORNER_TO_CENTRE),
};
