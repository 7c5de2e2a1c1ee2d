//! The Jaccard distance.

use crate::metric::{Definition, Direction, Metric};
use mtf::geom::{Corners, polygon};

/// The row of the table of metrics.
pub const METRIC: Metric = Metric {
    name: "jaccard",
    unit: "",
    summary: "1 - intersection over union of the two polygons, in [0, 1]",
    better: Direction::SmallerIsBetter,
    cap: 1.0,
    lost: 1.0,
    steps_per_unit: 100.0,
    tolerance: None,
    of_boxes: true,
    definition: Definition::Corners(jaccard_distance),
};

/// Jaccard distance in `[0, 1]`: `1 - area(C ∩ G) / area(C ∪ G)` of the two polygons.
pub fn jaccard_distance(tracked: &Corners, truth: &Corners) -> f64 {
    polygon::jaccard_distance(tracked, truth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    #[test]
    fn by_hand() {
        let square = Corners::rect(10.0, 10.0, 10.0, 10.0);
        let distance = |tracked: &Corners| jaccard_distance(tracked, &square);
        assert_eq!(distance(&square), 0.0);
        // Overlap 7 x 6 = 42, union 158.
        let moved = distance(&square.translated(3.0, 4.0));
        assert_abs_diff_eq!(moved, 1.0 - 42.0 / 158.0, epsilon = 1e-9);
        // The trapezoid adds a triangle 8 x 10 / 2 = 40 to the 100 of the square.
        let mut one = square;
        one.0[0][0] -= 8.0;
        assert_abs_diff_eq!(distance(&one), 1.0 - 100.0 / 140.0, epsilon = 1e-9);
    }
}
