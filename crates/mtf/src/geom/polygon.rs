//! Areas and overlaps of quadrilaterals by exact clipping. Depends on [`Corners`] alone.

use super::Corners;

type Point = [f64; 2];

/// `(b - a) x (c - a)`: twice the signed area of the triangle `abc`.
fn cross(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Signed area of a polygon by the shoelace formula, px²; positive when its vertices run clockwise on screen.
/// Fewer than three vertices have area 0.
pub fn signed_area(polygon: &[Point]) -> f64 {
    // Fan from the first vertex: no cancellation between large coordinates.
    polygon
        .windows(2)
        .skip(1)
        .map(|w| cross(polygon[0], w[0], w[1]))
        .sum::<f64>()
        / 2.0
}

/// Intersection of two convex polygons of positive [`signed_area`] by Sutherland-Hodgman clipping. Empty when they
/// do not overlap.
pub fn clip_convex(subject: &[Point], clip: &[Point]) -> Vec<Point> {
    let mut out = subject.to_vec();
    for (i, &a) in clip.iter().enumerate() {
        let b = clip[(i + 1) % clip.len()];
        let input = std::mem::take(&mut out);
        for (j, &p) in input.iter().enumerate() {
            let q = input[(j + 1) % input.len()];
            let (side_p, side_q) = (cross(a, b, p), cross(a, b, q));
            if side_p >= 0.0 {
                out.push(p);
            }
            if (side_p > 0.0 && side_q < 0.0) || (side_p < 0.0 && side_q > 0.0) {
                let t = side_p / (side_p - side_q);
                out.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
            }
        }
    }
    out
}

/// Interior-disjoint convex pieces of any quadrilateral, each of positive area: itself when convex, two triangles
/// when concave, the two triangles on either side of the crossing when self-intersecting.
fn convex_pieces(quad: &[Point; 4]) -> Vec<Vec<Point>> {
    let [a, b, c, d] = *quad;
    let pieces = if Corners(*quad).is_convex() {
        vec![quad.to_vec()]
    } else if let Some(x) = crossing(a, b, c, d) {
        vec![vec![x, b, c], vec![x, d, a]]
    } else if let Some(x) = crossing(b, c, d, a) {
        vec![vec![x, c, d], vec![x, a, b]]
    } else if cross(a, b, c) * cross(a, c, d) >= 0.0 {
        vec![vec![a, b, c], vec![a, c, d]]
    } else {
        vec![vec![b, c, d], vec![b, d, a]]
    };
    let oriented = pieces.into_iter().map(|mut p| {
        if signed_area(&p) < 0.0 {
            p.reverse();
        }
        p
    });
    oriented.filter(|p| signed_area(p) > 0.0).collect()
}

/// Where the segments `ab` and `cd` properly cross, if they do.
fn crossing(a: Point, b: Point, c: Point, d: Point) -> Option<Point> {
    let (c_side, d_side) = (cross(a, b, c), cross(a, b, d));
    let (a_side, b_side) = (cross(c, d, a), cross(c, d, b));
    if c_side * d_side < 0.0 && a_side * b_side < 0.0 {
        let t = a_side / (a_side - b_side);
        Some([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])])
    } else {
        None
    }
}

/// Jaccard distance `1 - area(A ∩ B) / area(A ∪ B)` in `[0, 1]`, exact up to rounding for every quadrilateral:
/// convex, concave or self-intersecting (whose area is that of both lobes). Equal corners give exactly 0; an
/// undefined ratio (no area, non-finite corners) gives 1.
pub fn jaccard_distance(a: &Corners, b: &Corners) -> f64 {
    if a == b {
        return 0.0;
    }
    // Relative to one corner, so that the result does not depend on where in the image the objects are.
    let [ox, oy] = b.0[0];
    let (a, b) = (a.translated(-ox, -oy), b.translated(-ox, -oy));
    let (a, b) = (convex_pieces(&a.0), convex_pieces(&b.0));
    let area = |pieces: &[Vec<Point>]| pieces.iter().map(|p| signed_area(p)).sum::<f64>();
    let overlap: f64 = a
        .iter()
        .flat_map(|p| b.iter().map(move |q| signed_area(&clip_convex(p, q)).max(0.0)))
        .sum();
    let ratio = overlap / (area(&a) + area(&b) - overlap);
    if ratio.is_finite() {
        (1.0 - ratio).clamp(0.0, 1.0)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use proptest::prelude::*;

    #[test]
    fn rectangles_by_hand() {
        let a = Corners::rect(0.0, 0.0, 10.0, 10.0);
        // Overlap 5 x 10 = 50, union 150.
        assert_abs_diff_eq!(
            jaccard_distance(&a, &a.translated(5.0, 0.0)),
            2.0 / 3.0,
            epsilon = 1e-12
        );
        // One inside the other: 25 / 100.
        assert_abs_diff_eq!(
            jaccard_distance(&a, &Corners::rect(2.0, 3.0, 5.0, 5.0)),
            0.75,
            epsilon = 1e-12
        );
        assert_eq!(jaccard_distance(&a, &a.translated(10.0, 0.0)), 1.0);
        assert_eq!(jaccard_distance(&a, &a.translated(50.0, 50.0)), 1.0);
    }

    #[test]
    fn orientation_and_order_do_not_matter() {
        let a = Corners::rect(0.0, 0.0, 10.0, 10.0);
        let mut reversed = a;
        reversed.0.reverse();
        assert_abs_diff_eq!(jaccard_distance(&reversed, &a), 0.0, epsilon = 1e-15);
    }

    #[test]
    fn concave_and_crossed() {
        let square = Corners::rect(0.0, 0.0, 4.0, 4.0);
        // Arrow head: the square's upper-left half (8 px²) with its long side pushed in; area 4.
        let arrow = Corners([[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]]);
        assert_abs_diff_eq!(
            jaccard_distance(&arrow, &square),
            1.0 - 4.0 / 16.0,
            epsilon = 1e-12
        );
        // Bow tie of two triangles of area 4 each.
        let tie = Corners([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.0, 4.0]]);
        assert_abs_diff_eq!(jaccard_distance(&tie, &square), 0.5, epsilon = 1e-12);
        assert_abs_diff_eq!(jaccard_distance(&square, &tie), 0.5, epsilon = 1e-12);
    }

    #[test]
    fn undefined_is_one() {
        let a = Corners::rect(0.0, 0.0, 10.0, 10.0);
        let point = Corners([[1.0, 1.0]; 4]);
        assert_eq!(jaccard_distance(&point, &a), 1.0);
        assert_eq!(jaccard_distance(&point, &Corners([[2.0, 2.0]; 4])), 1.0);
        assert_eq!(jaccard_distance(&Corners([[f64::NAN, 0.0]; 4]), &a), 1.0);
        assert_eq!(jaccard_distance(&Corners::rect(0.0, 0.0, 1e200, 1e200), &a), 1.0);
    }

    fn quad() -> impl Strategy<Value = Corners> {
        prop::array::uniform4(prop::array::uniform2(-100.0..100.0f64)).prop_map(Corners)
    }

    proptest! {
        #[test]
        fn jaccard_laws(a in quad(), b in quad(), dx in -500.0..500.0f64, dy in -500.0..500.0f64) {
            let d = jaccard_distance(&a, &b);
            prop_assert!((0.0..=1.0).contains(&d));
            prop_assert!((d - jaccard_distance(&b, &a)).abs() < 1e-9);
            prop_assert_eq!(jaccard_distance(&a, &a), 0.0);
            let moved = jaccard_distance(&a.translated(dx, dy), &b.translated(dx, dy));
            prop_assert!((d - moved).abs() < 1e-6, "{} {}", d, moved);
        }

        #[test]
        fn rectangles_follow_the_formula(w in 1.0..50.0f64, h in 1.0..50.0f64, dx in 0.0..60.0f64, dy in 0.0..60.0f64) {
            let a = Corners::rect(3.0, 4.0, w, h);
            let both = (w - dx).max(0.0) * (h - dy).max(0.0);
            let d = jaccard_distance(&a, &a.translated(dx, dy));
            prop_assert!((d - (1.0 - both / (2.0 * w * h - both))).abs() < 1e-9);
        }
    }
}
