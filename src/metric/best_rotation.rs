//! The alignment error under the best of four rotations.

use crate::metric::al::{LOST_PX, alignment_error};
use crate::metric::{Definition, Direction, Metric};
use mtf::geom::Corners;

/// The row of the table of further metrics.
pub const METRIC: Metric = Metric {
    name: "best_rotation",
    unit: "px",
    summary: "least alignment error over the four cyclic orders of the tracked corners",
    better: Direction::SmallerIsBetter,
    cap: LOST_PX,
    lost: f64::INFINITY,
    steps_per_unit: 5.0,
    tolerance: None,
    of_boxes: false,
    definition: Definition::Corners(best_rotation_error),
};

/// The least alignment error over the four cyclic orders of the tracked corners, px: for objects that look the same after a
/// quarter turn, and for trackers that begin with another corner.
pub fn best_rotation_error(tracked: &Corners, truth: &Corners) -> f64 {
    let turned = |by: usize| Corners(std::array::from_fn(|i| tracked.0[(i + by) % 4]));
    let errors = (0..4).map(|by| alignment_error(&turned(by), truth));
    errors.fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_do_not_count_and_mirror_images_do() {
        let square = Corners::rect(10.0, 10.0, 10.0, 10.0);
        let c = square.0;
        for k in 0..4 {
            let turned = Corners(std::array::from_fn(|i| c[(i + k) % 4]));
            assert_eq!(best_rotation_error(&turned, &square), 0.0);
        }
        assert!(best_rotation_error(&Corners([c[1], c[0], c[3], c[2]]), &square) > 5.0);
        assert_eq!(best_rotation_error(&square.translated(3.0, 4.0), &square), 5.0);
    }
}
