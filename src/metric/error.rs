//! Errors of one frame: tracked corners, or points of a dense grid, against ground truth. Depends on [`mtf::geom`]
//! alone.

use mtf::geom::{Corners, polygon};
use serde::{Deserialize, Serialize};

/// Errors of one frame, each rounded to 1e-6, so that what is written is what is counted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameError {
    /// Alignment error, px: `sqrt(1/4 Σ |c_i - g_i|²)`, the RMS of the four corner distances.
    pub al: f64,
    /// Mean corner distance, px: `1/4 Σ |c_i - g_i|`.
    pub mcd: f64,
    /// Centre location error, px: `|mean(c) - mean(g)|`.
    pub cl: f64,
    /// Jaccard distance in `[0, 1]`: `1 - area(C ∩ G) / area(C ∪ G)`.
    pub jaccard: f64,
}

impl FrameError {
    /// The errors in the order of [`Metric::CORNERS`].
    pub fn values(&self) -> [f64; 4] {
        [self.al, self.mcd, self.cl, self.jaccard]
    }
}

/// One of the errors of [`FrameError`], or the error over a dense grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Metric {
    /// Alignment error (RMS), px: the primary metric.
    Al,
    /// Mean corner distance, px.
    Mcd,
    /// Centre location error, px.
    Cl,
    /// `1 - IoU` of the two polygons.
    Jaccard,
    /// RMS over the points of a dense grid, px; only where a sequence has dense ground truth.
    Grid,
}

impl Metric {
    /// All metrics, in the order in which files list them.
    pub const ALL: [Metric; 5] = [Metric::Al, Metric::Mcd, Metric::Cl, Metric::Jaccard, Metric::Grid];

    /// Those of the four corners, which every annotated frame has.
    pub const CORNERS: [Metric; 4] = [Metric::Al, Metric::Mcd, Metric::Cl, Metric::Jaccard];

    /// Name used in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Metric::Al => "al",
            Metric::Mcd => "mcd",
            Metric::Cl => "cl",
            Metric::Jaccard => "jaccard",
            Metric::Grid => "grid",
        }
    }

    /// One line for `list metrics`.
    pub fn description(self) -> &'static str {
        match self {
            Metric::Al => "alignment error: RMS of the four corner distances, px (primary)",
            Metric::Mcd => "mean corner distance, px",
            Metric::Cl => "centre location error: distance between the means of the corners, px",
            Metric::Jaccard => "1 - intersection over union of the two polygons, in [0, 1]",
            Metric::Grid => "RMS over the points of a grid, px (sequences with dense ground truth)",
        }
    }

    /// Unit for axis labels; empty for a ratio.
    pub fn unit(self) -> &'static str {
        if self == Metric::Jaccard { "" } else { "px" }
    }
}

impl std::fmt::Display for Metric {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

impl std::str::FromStr for Metric {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let found = Metric::ALL.into_iter().find(|m| m.name().eq_ignore_ascii_case(s));
        found.ok_or_else(|| format!("unknown metric '{s}' (al, mcd, cl, jaccard, grid)"))
    }
}

/// Rounds to six decimals such that printing with six decimals and parsing gives the same number back.
pub(crate) fn round6(v: f64) -> f64 {
    if v.abs() < 1e9 {
        (v * 1e6).round() / 1e6
    } else {
        v.round()
    }
}

/// Errors of `tracked` against `truth` (both UL UR LR LL, px). The truth against itself gives exactly 0 in every
/// metric. Non-finite corners give infinite distances and a Jaccard distance of 1; such a frame is never within a
/// threshold.
pub fn frame_error(tracked: &Corners, truth: &Corners) -> FrameError {
    if !tracked.is_finite() || !truth.is_finite() {
        return FrameError {
            al: f64::INFINITY,
            mcd: f64::INFINITY,
            cl: f64::INFINITY,
            jaccard: 1.0,
        };
    }
    let distance =
        |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| ((ax - bx) * (ax - bx) + (ay - by) * (ay - by)).sqrt();
    let corners = tracked.0.iter().zip(&truth.0);
    FrameError {
        al: round6((tracked.distance_squared(truth) / 4.0).sqrt()),
        mcd: round6(corners.map(|(c, g)| distance(*c, *g)).sum::<f64>() / 4.0),
        cl: round6(distance(tracked.centroid(), truth.centroid())),
        jaccard: round6(polygon::jaccard_distance(tracked, truth)),
    }
}

/// Error over a grid, px: `sqrt(1/n Σ |u_i - g_i|²)`, rounded to 1e-6; infinite when a place is not finite.
pub fn grid_error(tracked: impl Iterator<Item = [f64; 2]>, truth: &[[f64; 2]]) -> f64 {
    let squares = tracked
        .zip(truth)
        .map(|(u, g)| (u[0] - g[0]) * (u[0] - g[0]) + (u[1] - g[1]) * (u[1] - g[1]));
    let rms = (squares.sum::<f64>() / truth.len() as f64).sqrt();
    if rms.is_finite() {
        round6(rms)
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SQUARE: Corners = Corners([[10.0, 10.0], [20.0, 10.0], [20.0, 20.0], [10.0, 20.0]]);

    #[test]
    fn constant_shift() {
        let e = frame_error(&SQUARE.translated(3.0, 4.0), &SQUARE);
        // Overlap 7 x 6 = 42, union 158.
        assert_eq!(
            e,
            FrameError {
                al: 5.0,
                mcd: 5.0,
                cl: 5.0,
                jaccard: round6(1.0 - 42.0 / 158.0)
            }
        );
    }

    #[test]
    fn one_corner_off_by_eight() {
        let mut c = SQUARE;
        c.0[0][0] -= 8.0;
        let e = frame_error(&c, &SQUARE);
        // The trapezoid adds a triangle 8 x 10 / 2 = 40 to the 100 of the square.
        assert_eq!(
            e,
            FrameError {
                al: 4.0,
                mcd: 2.0,
                cl: 2.0,
                jaccard: round6(1.0 - 100.0 / 140.0)
            }
        );
    }

    #[test]
    fn non_finite_is_never_within_a_threshold() {
        let mut c = SQUARE;
        c.0[2][1] = f64::NAN;
        let e = frame_error(&c, &SQUARE);
        assert_eq!(
            (e.al, e.mcd, e.cl, e.jaccard),
            (f64::INFINITY, f64::INFINITY, f64::INFINITY, 1.0)
        );
        assert!(frame_error(&Corners::rect(0.0, 0.0, 1e300, 1e300), &SQUARE).al > 1e9);
    }

    #[test]
    fn grids() {
        let truth = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [10.0, 10.0]];
        let off = |d: f64| truth.iter().map(move |g| [g[0] + d, g[1]]);
        assert_eq!(grid_error(off(0.0), &truth), 0.0);
        assert_eq!(grid_error(off(-2.5), &truth), 2.5);
        let one = truth
            .iter()
            .enumerate()
            .map(|(i, g)| [g[0], g[1] + if i == 2 { 4.0 } else { 0.0 }]);
        assert_eq!(grid_error(one, &truth), 2.0);
        assert_eq!(grid_error(off(f64::NAN), &truth), f64::INFINITY);
    }

    #[test]
    fn names() {
        for m in Metric::ALL {
            assert_eq!(m.name().parse(), Ok(m));
        }
        assert!("iou".parse::<Metric>().is_err());
    }

    proptest! {
        #[test]
        fn laws(v in prop::array::uniform8(-300.0..300.0f64), w in prop::array::uniform8(-300.0..300.0f64)) {
            let (a, b) = (Corners::from_array(v), Corners::from_array(w));
            prop_assert_eq!(frame_error(&a, &a), FrameError { al: 0.0, mcd: 0.0, cl: 0.0, jaccard: 0.0 });
            let e = frame_error(&a, &b);
            // RMS >= mean >= distance of the means.
            prop_assert!(e.al >= e.mcd - 2e-6 && e.mcd >= e.cl - 2e-6);
            prop_assert!((0.0..=1.0).contains(&e.jaccard));
        }

        #[test]
        fn written_is_counted(v in 0.0..1e12f64) {
            let r = round6(v);
            prop_assert_eq!(format!("{r:.6}").parse::<f64>().unwrap(), r);
        }
    }
}
