//! Rows and columns of a grid on a plane stay straight lines: nodes are replaced by the intersections of the lines
//! through them.
//!
//! Lines are homogeneous, `l = argmin Σ w (l·x)²` with a normal of unit length (total least squares), weighted by how
//! near each point is to the node its two lines make. Lines held parallel share the normal of least `Σ w (l·x)²` over all
//! lines of the family, each line its own offset.

use crate::params::Resolution;

crate::params! {
    /// Parameters of lines through the points of a grid.
    pub struct LineParams {
        /// Rounds in which lines are fitted and points weighted by them.
        line_rounds: usize = 6, in 1..=100;
        /// Points farther than this from the node that their lines make are moved there, px.
        line_outlier: f64 = 5.0, in 0.1..=1e4;
        /// All rows have one slope, and all columns have one, as under an affine warp: lines that are parallel on the object stay
        /// so.
        line_constant_slope: bool = false;
    }
}

/// Smallest spread that weights are scaled by, px.
const MIN_SPREAD: f64 = 0.1;

/// `l·x = 0`, `l[0]² + l[1]² = 1`.
type Line = [f64; 3];

/// Straightens grids; owns its scratch.
#[derive(Clone, Debug)]
pub(super) struct Lines {
    params: LineParams,
    size: Resolution,
    weights: Vec<f64>,
    distances: Vec<f64>,
    sorted: Vec<f64>,
    rows: Vec<Option<Line>>,
    cols: Vec<Option<Line>>,
    moments: Vec<Option<Moments>>,
    nodes: Vec<Option<[f64; 2]>>,
}

impl Lines {
    pub fn new(params: LineParams, size: Resolution) -> Self {
        Lines {
            params,
            size,
            weights: Vec::new(),
            distances: Vec::new(),
            sorted: Vec::new(),
            rows: Vec::new(),
            cols: Vec::new(),
            moments: Vec::new(),
            nodes: Vec::new(),
        }
    }

    /// Replaces the points `found` by the intersections of their lines, also those that were not found, and says in `lost`
    /// which ones were not found or strayed. `before`: the nodes in the last frame.
    pub fn straighten(&mut self, before: &[[f64; 2]], found: &mut [Option<[f64; 2]>], lost: &mut [bool]) {
        // At first, points count by how much their motion resembles that of most.
        let motion = |c: usize, sorted: &mut Vec<f64>| {
            sorted.clear();
            sorted.extend(
                found
                    .iter()
                    .zip(before)
                    .filter_map(|(f, b)| Some((*f)?[c] - b[c])),
            );
            median(sorted)
        };
        let usual = [motion(0, &mut self.sorted), motion(1, &mut self.sorted)];
        self.distances.clear();
        self.distances.extend(found.iter().zip(before).map(|(f, b)| {
            f.map_or(f64::INFINITY, |f| {
                libm::hypot(f[0] - b[0] - usual[0], f[1] - b[1] - usual[1])
            })
        }));
        self.nodes.clear();
        self.nodes.resize(found.len(), None);
        for _ in 0..self.params.line_rounds {
            self.weigh();
            self.fit(found);
            for (i, f) in found.iter().enumerate() {
                let (row, col) = (i / self.size.cols, i % self.size.cols);
                self.nodes[i] = self.rows[row].zip(self.cols[col]).and_then(|(r, c)| meet(r, c));
                self.distances[i] = f
                    .zip(self.nodes[i])
                    .map_or(f64::INFINITY, |(f, n)| libm::hypot(f[0] - n[0], f[1] - n[1]));
            }
        }
        for (i, f) in found.iter_mut().enumerate() {
            lost[i] = f.is_none() || self.distances[i] > self.params.line_outlier;
            *f = self.nodes[i];
        }
    }

    /// Weights `1 / (1 + (d/s)²)²` from the distances, `s` from their median.
    fn weigh(&mut self) {
        self.sorted.clear();
        self.sorted
            .extend(self.distances.iter().filter(|d| d.is_finite()));
        let spread = (2.0 * 1.4826 * median(&mut self.sorted)).max(MIN_SPREAD);
        self.weights.clear();
        self.weights.extend(self.distances.iter().map(|d| {
            let k = 1.0 / (1.0 + (d / spread) * (d / spread));
            k * k
        }));
    }

    fn fit(&mut self, found: &[Option<[f64; 2]>]) {
        let Resolution { cols, rows } = self.size;
        let weights = &self.weights;
        let moments = |indices: &mut dyn Iterator<Item = usize>| {
            Moments::of(indices.filter_map(|i| Some((found[i]?, weights[i]))))
        };
        let parallel = self.params.line_constant_slope;
        let of_rows = (0..rows).map(|r| moments(&mut (r * cols..(r + 1) * cols)));
        family(of_rows, parallel, &mut self.moments, &mut self.rows);
        let of_cols = (0..cols).map(|c| moments(&mut (0..rows).map(|r| r * cols + c)));
        family(of_cols, parallel, &mut self.moments, &mut self.cols);
        fill(&mut self.rows);
        fill(&mut self.cols);
    }
}

/// The lines through the points of each row, or of each column; `None` for those with too few points.
fn family(
    moments: impl Iterator<Item = Option<Moments>>,
    parallel: bool,
    kept: &mut Vec<Option<Moments>>,
    lines: &mut Vec<Option<Line>>,
) {
    kept.clear();
    kept.extend(moments);
    lines.clear();
    if !parallel {
        lines.extend(kept.iter().map(|m| {
            let m = m.as_ref().filter(|m| m.count >= 2)?;
            Some(m.line(normal(m.spread)?))
        }));
        return;
    }
    let total: f64 = kept.iter().flatten().map(|m| m.weight).sum();
    let sum = |k: usize| {
        let of_lines = kept.iter().flatten().map(|m| m.weight * m.spread[k]);
        of_lines.sum::<f64>() / total
    };
    let shared = normal([sum(0), sum(1), sum(2)]);
    // A point is enough for a line whose direction is known.
    lines.extend(kept.iter().map(|m| {
        let m = m.as_ref().filter(|m| m.count >= 1)?;
        Some(m.line(shared?))
    }));
}

/// Weighted moments of points.
#[derive(Clone, Copy, Debug)]
struct Moments {
    /// Sum of the weights, and the number of points that count.
    weight: f64,
    count: usize,
    mean: [f64; 2],
    /// `xx, xy, yy` about the mean, per weight.
    spread: [f64; 3],
}

impl Moments {
    /// `None` of no points.
    fn of(points: impl Iterator<Item = ([f64; 2], f64)>) -> Option<Self> {
        // Sums about the first point, which loses no digits.
        let (mut origin, mut count) = (None, 0);
        let (mut sw, mut sx, mut sy, mut sxx, mut sxy, mut syy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for (p, w) in points {
            let o = *origin.get_or_insert(p);
            let (x, y) = (p[0] - o[0], p[1] - o[1]);
            count += usize::from(w > 1e-6);
            sw += w;
            sx += w * x;
            sy += w * y;
            sxx += w * x * x;
            sxy += w * x * y;
            syy += w * y * y;
        }
        let o = origin.filter(|_| count > 0)?;
        let (mx, my) = (sx / sw, sy / sw);
        Some(Moments {
            weight: sw,
            count,
            mean: [o[0] + mx, o[1] + my],
            spread: [sxx / sw - mx * mx, sxy / sw - mx * my, syy / sw - my * my],
        })
    }

    /// The line with a unit normal through the mean.
    fn line(&self, n: [f64; 2]) -> Line {
        [n[0], n[1], -(n[0] * self.mean[0] + n[1] * self.mean[1])]
    }
}

/// Normal of the line of least weighted squared distance from points of that spread; `None` for points that coincide.
fn normal([a, b, c]: [f64; 3]) -> Option<[f64; 2]> {
    // Eigenvector of the smaller eigenvalue of [a b; b c], perpendicular to that of the larger one.
    let (half, mean) = ((a - c) / 2.0, (a + c) / 2.0);
    let root = (half * half + b * b).sqrt();
    let along = if half >= 0.0 {
        [half + root, b]
    } else {
        [b, root - half]
    };
    let length = libm::hypot(along[0], along[1]);
    if mean.is_nan() || mean + root < 1e-6 || length < 1e-12 {
        return None;
    }
    Some([-along[1] / length, along[0] / length])
}

/// Gives lines that have too few points the mean of their nearest neighbours on both sides.
fn fill(lines: &mut [Option<Line>]) {
    for i in 0..lines.len() {
        if lines[i].is_some() {
            continue;
        }
        let before = (0..i).rev().find_map(|k| Some((i - k, lines[k]?)));
        let after = (i + 1..lines.len()).find_map(|k| Some((k - i, lines[k]?)));
        // At the edge of the grid there is nothing to go by.
        if let Some(((d, a), (e, b))) = before.zip(after) {
            let sign = (a[0] * b[0] + a[1] * b[1]).signum();
            let (u, v) = (e as f64, sign * d as f64);
            let sum = [0, 1, 2].map(|k| u * a[k] + v * b[k]);
            let length = libm::hypot(sum[0], sum[1]);
            lines[i] = (length > 0.0).then(|| sum.map(|v| v / length));
        }
    }
}

/// Intersection of two lines; `None` when they are nearly parallel.
fn meet(a: Line, b: Line) -> Option<[f64; 2]> {
    let w = a[0] * b[1] - a[1] * b[0];
    let point = [(a[1] * b[2] - a[2] * b[1]) / w, (a[2] * b[0] - a[0] * b[2]) / w];
    (w.abs() > 1e-3).then_some(point)
}

/// Median of the values; 0 of none.
fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = values.len() / 2;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Mat3, homography};

    const SIZE: Resolution = Resolution { cols: 6, rows: 5 };

    fn grids() -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
        let m = Mat3::new(0.9, -0.3, 40.0, 0.35, 1.05, -12.0, 4e-4, -3e-4, 1.0);
        let before: Vec<[f64; 2]> = (0..30)
            .map(|i| [100.0 + 20.0 * f64::from(i % 6), 80.0 + 18.0 * f64::from(i / 6)])
            .collect();
        let after = before.iter().map(|p| homography::apply(&m, *p)).collect();
        (before, after)
    }

    fn straightened(found: &mut [Option<[f64; 2]>]) -> Vec<bool> {
        let mut lost = vec![false; 30];
        Lines::new(LineParams::default(), SIZE).straighten(&grids().0, found, &mut lost);
        lost
    }

    fn worst(found: &[Option<[f64; 2]>]) -> f64 {
        let miss =
            |(f, t): (&Option<[f64; 2]>, &[f64; 2])| f.map_or(f64::MAX, |f| (f[0] - t[0]).hypot(f[1] - t[1]));
        found.iter().zip(&grids().1).map(miss).fold(0.0, f64::max)
    }

    #[test]
    fn grids_seen_in_perspective_stay_as_they_are() {
        let mut found: Vec<_> = grids().1.into_iter().map(Some).collect();
        assert!(!straightened(&mut found).contains(&true));
        assert!(worst(&found) < 1e-9, "{}", worst(&found));
    }

    #[test]
    fn strays_are_put_back_and_gaps_filled() {
        let mut found: Vec<_> = grids().1.into_iter().map(Some).collect();
        found[8].as_mut().unwrap()[0] += 12.0;
        found[21].as_mut().unwrap()[1] -= 30.0;
        found[3] = None;
        for i in 12..18 {
            // A whole row.
            found[i] = None;
        }
        let lost = straightened(&mut found);
        for (i, lost) in lost.iter().enumerate() {
            assert_eq!(*lost, i == 8 || i == 21 || i == 3 || (12..18).contains(&i), "{i}");
        }
        let known: Vec<_> = (0..30).filter(|i| !(12..18).contains(i)).collect();
        for i in known {
            let (f, t) = (found[i].unwrap(), grids().1[i]);
            assert!((f[0] - t[0]).hypot(f[1] - t[1]) < 0.05, "{i} {f:?} {t:?}");
        }
        // Between its neighbours; perspective moves it a little.
        assert!(worst(&found) < 2.0, "{}", worst(&found));
    }

    /// Largest sine of an angle between two rows, or two columns, of nodes.
    fn skew(nodes: &[Option<[f64; 2]>]) -> f64 {
        let at = |r: usize, c: usize| nodes[r * SIZE.cols + c].unwrap();
        let along = |from: [f64; 2], to: [f64; 2]| {
            let d = [to[0] - from[0], to[1] - from[1]];
            d.map(|v| v / d[0].hypot(d[1]))
        };
        let rows: Vec<_> = (0..SIZE.rows)
            .map(|r| along(at(r, 0), at(r, SIZE.cols - 1)))
            .collect();
        let cols: Vec<_> = (0..SIZE.cols)
            .map(|c| along(at(0, c), at(SIZE.rows - 1, c)))
            .collect();
        let worst = |lines: &[[f64; 2]]| {
            let sine = |d: &[f64; 2]| (d[0] * lines[0][1] - d[1] * lines[0][0]).abs();
            lines.iter().map(sine).fold(0.0, f64::max)
        };
        worst(&rows).max(worst(&cols))
    }

    #[test]
    fn lines_of_one_slope_are_parallel() {
        let straighten = |line_constant_slope: bool, found: &mut [Option<[f64; 2]>]| {
            let params = LineParams {
                line_constant_slope,
                ..LineParams::default()
            };
            let mut lost = vec![false; 30];
            Lines::new(params, SIZE).straighten(&grids().0, found, &mut lost);
        };
        // Perspective is seen, or held back.
        let seen: Vec<_> = grids().1.into_iter().map(Some).collect();
        let (mut free, mut held) = (seen.clone(), seen);
        straighten(false, &mut free);
        straighten(true, &mut held);
        assert!(skew(&free) > 0.02, "{}", skew(&free));
        assert!(skew(&held) < 1e-9, "{}", skew(&held));
        // An affine view with noise: nearer to the truth than without.
        let m = Mat3::new(0.9, -0.3, 40.0, 0.35, 1.05, -12.0, 0.0, 0.0, 1.0);
        let truth: Vec<_> = grids().0.iter().map(|p| homography::apply(&m, *p)).collect();
        let noisy = truth.iter().enumerate().map(|(i, p)| {
            let noise = |k: usize| ((i * 7919 + k * 104_729) % 13) as f64 / 6.5 - 1.0;
            Some([p[0] + noise(1), p[1] + noise(2)])
        });
        let (mut free, mut held): (Vec<_>, Vec<_>) = (noisy.clone().collect(), noisy.collect());
        straighten(false, &mut free);
        straighten(true, &mut held);
        let error = |nodes: &[Option<[f64; 2]>]| {
            let squared = |(n, t): (&Option<[f64; 2]>, &[f64; 2])| {
                n.map_or(f64::MAX, |n| (n[0] - t[0]).powi(2) + (n[1] - t[1]).powi(2))
            };
            nodes.iter().zip(&truth).map(squared).sum::<f64>()
        };
        assert!(error(&held) < error(&free), "{} {}", error(&held), error(&free));
        // One point of a row is enough, for a row at the edge as well.
        let mut few: Vec<_> = truth.iter().map(|p| Some(*p)).collect();
        few[1..SIZE.cols].fill(None);
        let mut free = few.clone();
        straighten(true, &mut few);
        straighten(false, &mut free);
        assert!(error(&few) < 1e-9, "{}", error(&few));
        assert!(free[1].is_none());
    }

    #[test]
    fn too_few_points_give_no_nodes() {
        let mut found = vec![None; 30];
        found[4] = Some([3.0, 4.0]);
        assert!(straightened(&mut found).iter().all(|lost| *lost));
        assert!(found.iter().all(Option::is_none));
    }
}
