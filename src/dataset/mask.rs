//! Masks, and the smallest rectangle around one: a four-sided region for what is given as pixels or as many points.
//!
//! Depends on `geom` and the errors.

use super::DatasetErrorKind;
use mtf::geom::Corners;

/// Largest side of a mask, px: that of the widest image that can be read.
const MOST: usize = 65_536;

/// Whether a row is a mask in VOT's form: `m x,y,width,height,zeros,ones,zeros,...`.
pub(super) fn is_mask(row: &str) -> bool {
    let rest = row.trim_start().strip_prefix('m');
    rest.is_some_and(|rest| {
        rest.trim_start()
            .starts_with(|c: char| c.is_ascii_digit() || c == '-')
    })
}

/// The four-sided outline of a mask's pixels: for each row of pixels with any, the corners of the first and of the last, px,
/// pixel centres at integers. Empty when the mask is.
///
/// # Errors
/// Not whole numbers, or more pixels than the mask's box has.
pub(super) fn outline(row: &str) -> Result<Vec<[f64; 2]>, DatasetErrorKind> {
    let wrong = |fault: String| DatasetErrorKind::Format {
        fault,
        remedy: "write `m x,y,width,height` and the lengths of runs, that of zeros first".into(),
    };
    let words: Vec<&str> = super::text::words(row.trim_start().trim_start_matches('m')).collect();
    let parsed: Result<Vec<i64>, DatasetErrorKind> = words
        .iter()
        .map(|word| {
            word.parse().map_err(|_| DatasetErrorKind::NotANumber {
                word: (*word).to_owned(),
            })
        })
        .collect();
    let numbers = parsed?;
    let [x, y, width, height, runs @ ..] = &numbers[..] else {
        return Err(wrong(format!("a mask of {} numbers", numbers.len())));
    };
    let side = |n: i64| usize::try_from(n).ok().filter(|n| *n <= MOST);
    let (Some(width), Some(height)) = (side(*width), side(*height)) else {
        return Err(wrong(format!("a mask of {width} x {height} pixels")));
    };
    // Of each row of pixels, the first and the last.
    let mut ends: Vec<Option<(usize, usize)>> = vec![None; height];
    let mut at = 0;
    for (k, run) in runs.iter().enumerate() {
        let run = usize::try_from(*run)
            .ok()
            .filter(|run| at + run <= width * height);
        let Some(run) = run else {
            return Err(wrong(format!(
                "the runs of a mask do not fit its box of {width} x {height} pixels"
            )));
        };
        let end = at + run;
        if k % 2 == 1 && run > 0 {
            for (row, ends) in ends
                .iter_mut()
                .enumerate()
                .take((end - 1) / width + 1)
                .skip(at / width)
            {
                let first = at.max(row * width) - row * width;
                let last = (end - 1).min(row * width + width - 1) - row * width;
                let (a, b) = ends.unwrap_or((first, last));
                *ends = Some((a.min(first), b.max(last)));
            }
        }
        at = end;
    }
    let corners = ends.iter().enumerate().filter_map(|(row, ends)| {
        let (first, last) = (*ends)?;
        let (left, right) = (*x as f64 + first as f64 - 0.5, *x as f64 + last as f64 + 0.5);
        let top = *y as f64 + row as f64 - 0.5;
        Some([[left, top], [right, top], [left, top + 1.0], [right, top + 1.0]])
    });
    Ok(corners.flatten().collect())
}

/// The corners UL UR LR LL of the smallest rectangle around `points`, of any direction. Which corner is the first follows
/// `before`, the corners of an earlier frame; without these, the rectangle is turned as little as can be. `None` without
/// points that span an area.
pub(super) fn rectangle(points: &[[f64; 2]], before: Option<&Corners>) -> Option<Corners> {
    let hull = hull(points);
    let edges = hull.iter().zip(hull.iter().cycle().skip(1));
    let around = edges.filter_map(|(a, b)| {
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let length = dx.hypot(dy);
        (length > 0.0).then(|| along(&hull, [dx / length, dy / length]))
    });
    let (area, best) = around.min_by(|a, b| a.0.total_cmp(&b.0))?;
    if area <= 0.0 {
        return None;
    }
    let upright = || {
        let side = |k: usize| {
            let values = || points.iter().map(|p| p[k]);
            (
                values().fold(f64::INFINITY, f64::min),
                values().fold(f64::NEG_INFINITY, f64::max),
            )
        };
        let ((left, right), (top, bottom)) = (side(0), side(1));
        Corners::rect(left, top, right - left, bottom - top)
    };
    let like = before.copied().unwrap_or_else(upright);
    let turned = (0..4).map(|k| Corners(std::array::from_fn(|i| best.0[(i + k) % 4])));
    turned.min_by(|a, b| a.distance_squared(&like).total_cmp(&b.distance_squared(&like)))
}

/// Area and corners of the rectangle around `points` with sides along the unit vector `u`.
fn along(points: &[[f64; 2]], u: [f64; 2]) -> (f64, Corners) {
    let n = [-u[1], u[0]];
    let extent = |d: [f64; 2]| {
        let values = || points.iter().map(|p| p[0] * d[0] + p[1] * d[1]);
        (
            values().fold(f64::INFINITY, f64::min),
            values().fold(f64::NEG_INFINITY, f64::max),
        )
    };
    let ((a, b), (c, d)) = (extent(u), extent(n));
    let at = |s: f64, t: f64| [s * u[0] + t * n[0], s * u[1] + t * n[1]];
    (
        (b - a) * (d - c),
        Corners([at(a, c), at(b, c), at(b, d), at(a, d)]),
    )
}

/// The convex hull, each corner once, in order around it.
fn hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let half = |points: &mut dyn Iterator<Item = &[f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for &p in points {
            while let [.., a, b] = chain[..]
                && (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut sorted.iter());
    hull.extend(half(&mut sorted.iter().rev()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_become_the_pixels_that_they_cover() {
        // Two rows of three pixels at (10, 20): .11 / 1..
        let points = outline("m10,20,3,2,1,3,2").unwrap();
        assert_eq!(
            points,
            [
                [10.5, 19.5],
                [12.5, 19.5],
                [10.5, 20.5],
                [12.5, 20.5],
                [9.5, 20.5],
                [10.5, 20.5],
                [9.5, 21.5],
                [10.5, 21.5]
            ]
        );
        assert_eq!(outline("m0,0,0,0,0").unwrap(), Vec::<[f64; 2]>::new());
        assert!(is_mask("m10,20,3,2") && is_mask(" m 1,2") && !is_mask("mask") && !is_mask("1,2,3,4"));
        for bad in [
            "m1,2",
            "m1,2,3,x",
            "m0,0,2,2,0,5",
            "m0,0,-1,2,1",
            "m0,0,2,2,-1,3",
            "m0,0,99999,1,0,1",
        ] {
            assert!(outline(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_smallest_rectangle_around_points() {
        let square = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0], [1.0, 1.0]];
        assert_eq!(rectangle(&square, None), Some(Corners::rect(0.0, 0.0, 4.0, 2.0)));
        // A diamond has the half of its bounding box.
        let diamond = [[2.0, 0.0], [4.0, 2.0], [2.0, 4.0], [0.0, 2.0]];
        let found = rectangle(&diamond, None).unwrap();
        assert!((found.signed_area() - 8.0).abs() < 1e-9, "{found:?}");
        // The order follows the frame before.
        let turned = Corners::from_array([4.0, 0.0, 4.0, 2.0, 0.0, 2.0, 0.0, 0.0]);
        assert_eq!(rectangle(&square, Some(&turned)), Some(turned));
        assert_eq!(rectangle(&[[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]], None), None);
        assert_eq!(rectangle(&[], None), None);
    }
}
