//! The homography discrepancy.

use crate::metric::{Definition, Direction, Metric};
use mtf::geom::{Corners, homography};

/// The row of the table of further metrics.
pub const METRIC: Metric = Metric {
    name: "hd",
    unit: "px",
    summary: "homography discrepancy: mean movement of the points (±1, ±1) px by the true homography after the inverse of the \
              tracked one",
    better: Direction::SmallerIsBetter,
    cap: 100.0,
    lost: f64::INFINITY,
    steps_per_unit: 1.0,
    tolerance: None,
    of_boxes: false,
    definition: Definition::Corners(homography_discrepancy),
};

/// `1/4 Σ |c_i - (H* H^-1)(c_i)|` px over the corners `(±1, ±1)` px of a square at the image's origin, with `H` the homography
/// from the first frame to this one that the tracker found and `H*` the true one. `H* H^-1` takes the tracked corners to the
/// true ones, whatever the first frame. Infinite where there is no such homography. Source: Liang, Wu, Lu, Wang, Liao, Ling,
/// *Planar object tracking in the wild: a benchmark*, ICRA 2018.
pub fn homography_discrepancy(tracked: &Corners, truth: &Corners) -> f64 {
    let Some(between) = homography::from_corners(tracked, truth) else {
        return f64::INFINITY;
    };
    let square = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
    let moved = square.map(|c| {
        let to = homography::apply(&between, c);
        (to[0] - c[0]).hypot(to[1] - c[1])
    });
    moved.iter().sum::<f64>() / 4.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    #[test]
    fn by_hand() {
        let square = Corners::rect(10.0, 10.0, 10.0, 10.0);
        // A translation moves all points alike.
        assert_abs_diff_eq!(
            homography_discrepancy(&square.translated(3.0, 4.0), &square),
            5.0,
            epsilon = 1e-9
        );
        // Twice as large about the origin: (±1, ±1) moves by half its length.
        let twice = Corners(square.0.map(|c| c.map(|v| 2.0 * v)));
        assert_abs_diff_eq!(
            homography_discrepancy(&twice, &square),
            0.5f64.sqrt(),
            epsilon = 1e-9
        );
        let line = Corners([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]);
        assert_eq!(homography_discrepancy(&line, &square), f64::INFINITY);
    }

    #[test]
    fn it_is_that_of_the_warps_from_the_first_frame() {
        let start = Corners::rect(100.0, 50.0, 80.0, 60.0);
        let truth = Corners([[98.0, 52.0], [185.0, 45.0], [180.0, 118.0], [101.0, 109.0]]);
        let tracked = Corners([[98.5, 52.0], [184.0, 45.5], [181.0, 117.0], [101.0, 110.0]]);
        let to = |c: &Corners| homography::from_corners(&start, c).unwrap();
        let m = to(&truth) * to(&tracked).try_inverse().unwrap();
        let moved = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]].map(|c: [f64; 2]| {
            let at = |row: usize| m[(row, 0)] * c[0] + m[(row, 1)] * c[1] + m[(row, 2)];
            ((at(0) / at(2) - c[0]).powi(2) + (at(1) / at(2) - c[1]).powi(2)).sqrt()
        });
        let expected = moved.iter().sum::<f64>() / 4.0;
        assert_abs_diff_eq!(homography_discrepancy(&tracked, &truth), expected, epsilon = 1e-9);
    }
}
