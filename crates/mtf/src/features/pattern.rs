//! The brightness comparisons of a descriptor: 256 pairs of points in a disc, drawn once from a fixed seed, and turned in
//! steps of a 64th of a circle.

use crate::kernels::{Bits, CENTROID_RADIUS};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::sync::OnceLock;

/// Orientations.
pub(super) const TURNS: usize = 64;
/// Least distance of the points of a pair, px.
const APART: f64 = 4.0;
const SEED: u64 = 0x0256_b175;

type Point = [i8; 2];
type Pattern = Vec<[(Point, Point); 256]>;

fn patterns() -> &'static Pattern {
    static PATTERNS: OnceLock<Pattern> = OnceLock::new();
    PATTERNS.get_or_init(|| {
        let mut rng = Pcg64::seed_from_u64(SEED);
        let radius = CENTROID_RADIUS as f64 - 0.75;
        // The mean of three uniform numbers: denser in the middle, like a Gaussian, of standard deviation R / 3 · 1.3.
        let mut coordinate = || {
            let sum: f64 = (0..3).map(|_| rng.random_range(-1.0..1.0)).sum();
            sum / 3.0 * 1.3 * radius
        };
        let mut pairs = Vec::with_capacity(256);
        while pairs.len() < 256 {
            let p: [f64; 4] = std::array::from_fn(|_| coordinate());
            let far = (p[0] - p[2]).powi(2) + (p[1] - p[3]).powi(2) >= APART * APART;
            let inside = |x: f64, y: f64| x * x + y * y <= radius * radius;
            if far && inside(p[0], p[1]) && inside(p[2], p[3]) {
                pairs.push(p);
            }
        }
        (0..TURNS)
            .map(|turn| {
                let angle = turn as f64 * std::f64::consts::TAU / TURNS as f64;
                let (s, c) = (libm::sin(angle), libm::cos(angle));
                let rotated = |x: f64, y: f64| [c * x - s * y, s * x + c * y].map(|v| v.round() as i8);
                std::array::from_fn(|k| {
                    let p = pairs[k];
                    (rotated(p[0], p[1]), rotated(p[2], p[3]))
                })
            })
            .collect()
    })
}

/// Descriptor of the pixel at index `at` of a plane, at an orientation; the disc of radius 15 around it lies inside.
pub(super) fn describe(plane: &[f32], stride: usize, at: usize, turn: usize) -> Bits {
    let pairs = &patterns()[turn % TURNS];
    let value =
        |[x, y]: Point| plane[(at as isize + isize::from(y) * stride as isize + isize::from(x)) as usize];
    let mut bits = [0; 4];
    for (word, pairs) in bits.iter_mut().zip(pairs.chunks_exact(64)) {
        for (k, (a, b)) in pairs.iter().enumerate() {
            *word |= u64::from(value(*a) < value(*b)) << k;
        }
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_turned_and_stay_in_the_disc() {
        let patterns = patterns();
        let limit = (CENTROID_RADIUS * CENTROID_RADIUS) as i32;
        for pattern in patterns {
            for (a, b) in pattern {
                for [x, y] in [*a, *b].map(|p| p.map(i32::from)) {
                    assert!(x * x + y * y <= limit);
                }
            }
        }
        // A quarter of a turn takes (x, y) to (-y, x).
        for (p, q) in patterns[0].iter().zip(&patterns[16]) {
            assert_eq!(q.0, [-p.0[1], p.0[0]]);
        }
    }

    #[test]
    fn descriptors_turn_with_the_image_and_ignore_gain_and_bias() {
        let value = |x: i32, y: i32| ((x * 37 + y * 91) % 97 + (x * y) % 29) as f32;
        let plane = |f: &dyn Fn(i32, i32) -> f32| -> Vec<f32> {
            (0..41 * 41).map(|i| f(i % 41 - 20, i / 41 - 20)).collect()
        };
        let upright = describe(&plane(&value), 41, 20 * 41 + 20, 0);
        let turned = describe(&plane(&|x, y| value(y, -x)), 41, 20 * 41 + 20, 16);
        assert_eq!(upright, turned);
        assert_eq!(
            upright,
            describe(&plane(&|x, y| 0.5 * value(x, y) + 20.0), 41, 20 * 41 + 20, 0)
        );
        let ones: u32 = upright.iter().map(|w| w.count_ones()).sum();
        assert!((64..192).contains(&ones));
    }
}
