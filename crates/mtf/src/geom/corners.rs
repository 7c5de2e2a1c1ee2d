//! The four corners of a tracked region: what ground truth gives and what every tracker returns.

use serde::{Deserialize, Serialize};

/// Largest area of a region that is still tracked, in areas of the image. A region that is larger has been lost: the
/// image hardly says anything about it.
pub const LARGEST_REGION: f64 = 4.0;

/// Corners of a quadrilateral in image pixels, order UL, UR, LR, LL (clockwise on screen).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Corners(pub [[f64; 2]; 4]);

impl Corners {
    /// Axis-aligned rectangle with top-left corner `(x, y)`, `width` and `height` in pixels.
    pub fn rect(x: f64, y: f64, width: f64, height: f64) -> Self {
        Corners([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
    }

    /// From `[ulx, uly, urx, ury, lrx, lry, llx, lly]`.
    pub fn from_array(v: [f64; 8]) -> Self {
        Corners([[v[0], v[1]], [v[2], v[3]], [v[4], v[5]], [v[6], v[7]]])
    }

    /// `[ulx, uly, urx, ury, lrx, lry, llx, lly]`.
    pub fn to_array(self) -> [f64; 8] {
        let [[a, b], [c, d], [e, f], [g, h]] = self.0;
        [a, b, c, d, e, f, g, h]
    }

    /// Mean of the four corners.
    pub fn centroid(&self) -> [f64; 2] {
        let s = self.0.iter().fold([0.0, 0.0], |s, c| [s[0] + c[0], s[1] + c[1]]);
        [s[0] / 4.0, s[1] / 4.0]
    }

    /// Signed area by the shoelace formula, px²; positive for UL, UR, LR, LL clockwise on screen.
    pub fn signed_area(&self) -> f64 {
        let c = &self.0;
        (0..4)
            .map(|i| c[i][0] * c[(i + 1) % 4][1] - c[(i + 1) % 4][0] * c[i][1])
            .sum::<f64>()
            / 2.0
    }

    /// True when the area is more than [`LARGEST_REGION`] times that of an image of `width` x `height` px.
    pub fn outgrow(&self, width: usize, height: usize) -> bool {
        self.signed_area().abs() > LARGEST_REGION * (width * height) as f64
    }

    /// True when all eight numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.0.iter().flatten().all(|v| v.is_finite())
    }

    /// True when the quadrilateral is strictly convex (either orientation).
    pub fn is_convex(&self) -> bool {
        let c = &self.0;
        let turn = |i: usize| {
            let (a, b, d) = (c[i], c[(i + 1) % 4], c[(i + 2) % 4]);
            (b[0] - a[0]) * (d[1] - b[1]) - (b[1] - a[1]) * (d[0] - b[0])
        };
        let turns = [turn(0), turn(1), turn(2), turn(3)];
        turns.iter().all(|&t| t > 0.0) || turns.iter().all(|&t| t < 0.0)
    }

    /// Sum of squared corner distances to `other`, px².
    pub fn distance_squared(&self, other: &Corners) -> f64 {
        self.0
            .iter()
            .flatten()
            .zip(other.0.iter().flatten())
            .map(|(a, b)| (a - b) * (a - b))
            .sum()
    }

    /// Mean of the four corner distances to `other`, px.
    pub fn mean_distance(&self, other: &Corners) -> f64 {
        let distance = |(a, b): (&[f64; 2], &[f64; 2])| {
            ((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])).sqrt()
        };
        self.0.iter().zip(&other.0).map(distance).sum::<f64>() / 4.0
    }

    /// Each corner moved by `(dx, dy)` pixels.
    pub fn translated(&self, dx: f64, dy: f64) -> Corners {
        Corners(self.0.map(|[x, y]| [x + dx, y + dy]))
    }
}
