//! The error over a dense grid.

use crate::metric::{Definition, Direction, Metric, al};

/// The row of the table of metrics.
pub const METRIC: Metric = Metric {
    name: "grid",
    unit: "px",
    summary: "RMS over the points of a grid, px (sequences with dense ground truth)",
    better: Direction::SmallerIsBetter,
    cap: al::LOST_PX,
    lost: f64::INFINITY,
    steps_per_unit: 5.0,
    tolerance: None,
    of_boxes: false,
    definition: Definition::Dense(grid_error),
};

/// Error over a grid, px: `sqrt(1/n Σ |u_i - g_i|²)` over its points `u_i` as tracked and their truth `g_i`; not finite
/// when a place is not.
pub fn grid_error(tracked: &[[f64; 2]], truth: &[[f64; 2]]) -> f64 {
    let squares = tracked
        .iter()
        .zip(truth)
        .map(|(u, g)| (u[0] - g[0]) * (u[0] - g[0]) + (u[1] - g[1]) * (u[1] - g[1]));
    (squares.sum::<f64>() / truth.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let truth = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [10.0, 10.0]];
        let off = |d: f64| truth.map(|g| [g[0] + d, g[1]]);
        assert_eq!(grid_error(&off(0.0), &truth), 0.0);
        assert_eq!(grid_error(&off(-2.5), &truth), 2.5);
        let mut one = truth;
        one[2][1] += 4.0;
        assert_eq!(grid_error(&one, &truth), 2.0);
        assert!(!grid_error(&off(f64::NAN), &truth).is_finite());
    }
}
