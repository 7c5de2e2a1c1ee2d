//! The mean corner distance.

use crate::metric::{Definition, Direction, Metric, al, cl};
use mtf::geom::Corners;

/// The row of the table of metrics.
pub const METRIC: Metric = Metric {
    name: "mcd",
    unit: "px",
    summary: "mean corner distance, px",
    better: Direction::SmallerIsBetter,
    cap: al::LOST_PX,
    lost: f64::INFINITY,
    steps_per_unit: 5.0,
    tolerance: None,
    of_boxes: false,
    definition: Definition::Corners(mean_corner_distance),
};

/// Mean corner distance, px: `1/4 Σ |c_i - g_i|`.
pub fn mean_corner_distance(tracked: &Corners, truth: &Corners) -> f64 {
    let corners = tracked.0.iter().zip(&truth.0);
    corners.map(|(c, g)| cl::distance(*c, *g)).sum::<f64>() / 4.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let square = Corners::rect(10.0, 10.0, 10.0, 10.0);
        assert_eq!(mean_corner_distance(&square.translated(3.0, 4.0), &square), 5.0);
        let mut one = square;
        one.0[0][0] -= 8.0;
        assert_eq!(mean_corner_distance(&one, &square), 2.0);
    }
}
