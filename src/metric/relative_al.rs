//! The alignment error relative to the object's size.

use crate::metric::al::alignment_error;
use crate::metric::{Definition, Direction, Metric};
use mtf::geom::Corners;

/// The row of the table of further metrics.
pub const METRIC: Metric = Metric {
    name: "relative_al",
    unit: "",
    summary: "alignment error by the square root of the object's area in this frame",
    better: Direction::SmallerIsBetter,
    cap: 1.0,
    lost: f64::INFINITY,
    steps_per_unit: 100.0,
    tolerance: None,
    of_boxes: false,
    definition: Definition::Corners(relative_alignment_error),
};

/// Alignment error by the square root of the area of the true quadrilateral.
pub fn relative_alignment_error(tracked: &Corners, truth: &Corners) -> f64 {
    alignment_error(tracked, truth) / truth.signed_area().abs().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let object = Corners::rect(10.0, 10.0, 20.0, 5.0);
        assert_eq!(
            relative_alignment_error(&object.translated(3.0, 4.0), &object),
            0.5
        );
        let larger = Corners(object.0.map(|c| c.map(|v| 7.0 * v)));
        let moved = Corners(object.translated(3.0, 4.0).0.map(|c| c.map(|v| 7.0 * v)));
        assert!((relative_alignment_error(&moved, &larger) - 0.5).abs() < 1e-12);
    }
}
