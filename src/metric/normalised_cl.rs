//! The centre location error relative to the object's size.

use crate::metric::{Definition, Direction, Metric};
use mtf::geom::Corners;

/// The row of the table of further metrics.
pub const METRIC: Metric = Metric {
    name: "normalised_cl",
    unit: "",
    summary: "distance of the centres in widths and heights of the upright box around the object",
    better: Direction::SmallerIsBetter,
    cap: 1.0,
    lost: f64::INFINITY,
    steps_per_unit: 200.0,
    tolerance: None,
    of_boxes: true,
    definition: Definition::Corners(normalised_centre_error),
};

/// Distance of the centres with x divided by the width and y by the height of the upright box around the true corners.
/// Source: Müller, Bibi, Giancola, Alsubaihi, Ghanem, *TrackingNet*, ECCV 2018.
pub fn normalised_centre_error(tracked: &Corners, truth: &Corners) -> f64 {
    let (a, b) = (tracked.centroid(), truth.centroid());
    let apart = |k: usize| {
        let values = truth.0.map(|c| c[k]);
        let extent = values.into_iter().fold(f64::NEG_INFINITY, f64::max)
            - values.into_iter().fold(f64::INFINITY, f64::min);
        (a[k] - b[k]) / extent
    };
    apart(0).hypot(apart(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let object = Corners::rect(10.0, 10.0, 30.0, 40.0);
        assert_eq!(
            normalised_centre_error(&object.translated(9.0, 16.0), &object),
            0.5
        );
    }
}
