//! The alignment error.

use crate::metric::{Definition, Direction, Metric};
use mtf::geom::Corners;

/// A frame whose alignment error exceeds this many pixels is a failure.
pub const LOST_PX: f64 = 20.0;

/// The row of the table of metrics.
pub const METRIC: Metric = Metric {
    name: "al",
    unit: "px",
    summary: "alignment error: RMS of the four corner distances, px (primary)",
    better: Direction::SmallerIsBetter,
    cap: LOST_PX,
    lost: f64::INFINITY,
    steps_per_unit: 5.0,
    tolerance: Some(0.05),
    of_boxes: false,
    definition: Definition::Corners(alignment_error),
};

/// Alignment error, px: `sqrt(1/4 Σ |c_i - g_i|²)` over the four corners `c_i` (UL UR LR LL) and their truth `g_i`.
/// Infinite when a corner is not finite.
pub fn alignment_error(tracked: &Corners, truth: &Corners) -> f64 {
    if tracked.is_finite() && truth.is_finite() {
        (tracked.distance_squared(truth) / 4.0).sqrt()
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let square = Corners::rect(10.0, 10.0, 10.0, 10.0);
        assert_eq!(alignment_error(&square, &square), 0.0);
        assert_eq!(alignment_error(&square.translated(3.0, 4.0), &square), 5.0);
        let mut one = square;
        one.0[0][0] -= 8.0;
        assert_eq!(alignment_error(&one, &square), 4.0);
        one.0[2][1] = f64::NAN;
        assert_eq!(alignment_error(&one, &square), f64::INFINITY);
        assert_eq!(alignment_error(&square, &one), f64::INFINITY);
        assert!(alignment_error(&Corners::rect(0.0, 0.0, 1e300, 1e300), &square) > 1e9);
    }
}
