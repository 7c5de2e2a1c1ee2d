//! The centre location error.

use crate::metric::{Definition, Direction, Metric, al};
use mtf::geom::Corners;

/// The row of the table of metrics.
pub const METRIC: Metric = Metric {
    name: "cl",
    unit: "px",
    summary: "centre location error: distance between the means of the corners, px",
    better: Direction::SmallerIsBetter,
    cap: al::LOST_PX,
    lost: f64::INFINITY,
    steps_per_unit: 5.0,
    tolerance: None,
    of_boxes: true,
    definition: Definition::Corners(centre_location_error),
};

/// Centre location error, px: `|mean(c) - mean(g)|`.
pub fn centre_location_error(tracked: &Corners, truth: &Corners) -> f64 {
    distance(tracked.centroid(), truth.centroid())
}

/// Distance of two points, px.
pub(super) fn distance([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> f64 {
    ((ax - bx) * (ax - bx) + (ay - by) * (ay - by)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let square = Corners::rect(10.0, 10.0, 10.0, 10.0);
        assert_eq!(centre_location_error(&square.translated(3.0, 4.0), &square), 5.0);
        let mut one = square;
        one.0[0][0] -= 8.0;
        assert_eq!(centre_location_error(&one, &square), 2.0);
    }
}
