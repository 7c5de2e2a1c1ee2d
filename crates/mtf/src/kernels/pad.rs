//! Planes with a border around them, for filters whose windows reach beyond the edge: the border is reflected without
//! repeating the edge pixel (`… 2 1 | 0 1 2 …`).

use super::WIDTH;
use super::blur::reflect101;

/// Elements between the starts of two rows of a padded plane. Eight elements may be loaded from any place of a window.
pub fn padded_stride(width: usize, radius: usize) -> usize {
    (width + 2 * radius + WIDTH).next_multiple_of(WIDTH)
}

/// Elements of a padded plane.
pub fn padded_len(width: usize, height: usize, radius: usize) -> usize {
    padded_stride(width, radius) * (height + 2 * radius)
}

/// Copies the `width x height` image in `plane` (rows `stride` apart) to `out` ([`padded_len`] elements), pixel `(x, y)` to
/// `(x + radius, y + radius)`, and reflects it around. Spare elements at the ends of rows become zero.
pub fn pad(plane: &[f32], width: usize, height: usize, stride: usize, radius: usize, out: &mut [f32]) {
    if width == 0 || height == 0 {
        return;
    }
    let to = padded_stride(width, radius);
    for (j, line) in out[..padded_len(width, height, radius)]
        .chunks_exact_mut(to)
        .enumerate()
    {
        let y = reflect101(j as isize - radius as isize, height);
        let row = &plane[y * stride..y * stride + width];
        line[radius..radius + width].copy_from_slice(row);
        for i in 1..=radius {
            line[radius - i] = row[reflect101(-(i as isize), width)];
            line[radius + width - 1 + i] = row[reflect101((width - 1 + i) as isize, width)];
        }
        line[width + 2 * radius..].fill(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_is_the_reflected_one() {
        for (width, height, radius) in [(7, 5, 2), (3, 1, 4), (1, 2, 3), (16, 9, 1)] {
            let stride = width + 3;
            let plane: Vec<f32> = (0..stride * height).map(|i| i as f32).collect();
            let mut out = vec![f32::NAN; padded_len(width, height, radius)];
            pad(&plane, width, height, stride, radius, &mut out);
            for (j, line) in out.chunks_exact(padded_stride(width, radius)).enumerate() {
                for (i, v) in line.iter().enumerate() {
                    let at = |k: usize, n| reflect101(k as isize - radius as isize, n);
                    let inside = i < width + 2 * radius;
                    let want = if inside {
                        plane[at(j, height) * stride + at(i, width)]
                    } else {
                        0.0
                    };
                    assert_eq!(*v, want, "{width}x{height} {radius}: {i} {j}");
                }
            }
        }
    }
}
