//! Random numbers and lattice noise whose values are the same on every machine.
//!
//! Uniform numbers are taken from the raw 64-bit output of Pcg64, transcendental functions from `libm`: neither
//! depends on the platform or on the sampling algorithms of other crates. Depends on nothing else in the crate.

use rand::Rng;
use rand_pcg::Pcg64;

/// A reproducible stream of random numbers.
pub(crate) struct Random(Pcg64);

impl Random {
    /// Stream number `stream` of `seed`; different streams are independent.
    pub fn new(seed: u64, stream: u64) -> Self {
        let state = (u128::from(seed) << 64) ^ 0xcafe_f00d_d15e_a5e5_0123_4567_89ab_cdef;
        let mut pcg = Pcg64::new(
            state,
            0x0a02_bdbf_7bb3_c0a7_ac28_fa16_a64a_bf96 ^ (u128::from(stream) << 1),
        );
        // The first outputs of neighbouring seeds are alike.
        for _ in 0..4 {
            pcg.next_u64();
        }
        Random(pcg)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in 0..n (`n > 0`).
    pub fn below(&mut self, n: usize) -> usize {
        (self.unit() * n as f64) as usize
    }

    /// One element of a non-empty slice.
    pub fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }

    /// True with probability `p`.
    pub fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }

    /// Standard normal (Box–Muller).
    pub fn normal(&mut self) -> f64 {
        let r = (-2.0 * libm::log(1.0 - self.unit())).sqrt();
        r * libm::cos(std::f64::consts::TAU * self.unit())
    }

    /// 32 random bits, the seed of a [`Noise`].
    pub fn noise(&mut self) -> Noise {
        Noise((self.0.next_u64() >> 32) as u32)
    }
}

/// Noise over the plane with features of about unit size, drawn from a hash of the lattice.
#[derive(Clone, Copy)]
pub(crate) struct Noise(u32);

impl Noise {
    fn hash(self, x: i64, y: i64) -> u32 {
        let mut h = self.0 ^ (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77);
        h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
        h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
        h ^ (h >> 15)
    }

    /// Uniform in [0, 1), one value per lattice cell.
    pub fn cell(self, x: i64, y: i64) -> f64 {
        f64::from(self.hash(x, y)) / 4_294_967_296.0
    }

    /// Gradient noise, about -0.7..0.7, zero at lattice points.
    pub fn gradient(self, x: f64, y: f64) -> f64 {
        const D: f64 = std::f64::consts::FRAC_1_SQRT_2;
        const DIRECTIONS: [[f64; 2]; 8] = [
            [1.0, 0.0],
            [D, D],
            [0.0, 1.0],
            [-D, D],
            [-1.0, 0.0],
            [-D, -D],
            [0.0, -1.0],
            [D, -D],
        ];
        let (fx, fy) = (x.floor(), y.floor());
        let (ix, iy) = (fx as i64, fy as i64);
        let (dx, dy) = (x - fx, y - fy);
        let corner = |i: i64, j: i64| {
            let g = DIRECTIONS[(self.hash(ix + i, iy + j) >> 29) as usize];
            g[0] * (dx - i as f64) + g[1] * (dy - j as f64)
        };
        let (u, v) = (fade(dx), fade(dy));
        let top = corner(0, 0) + u * (corner(1, 0) - corner(0, 0));
        let bottom = corner(0, 1) + u * (corner(1, 1) - corner(0, 1));
        top + v * (bottom - top)
    }

    /// Sum of `octaves` gradient noises, each of half the size and `gain` times the amplitude; about -1..1.
    pub fn fractal(self, x: f64, y: f64, octaves: u32, gain: f64) -> f64 {
        let (mut sum, mut amplitude, mut scale) = (0.0, 1.0, 1.0);
        for k in 0..octaves {
            let layer = Noise(self.0.wrapping_add(k.wrapping_mul(0x6c07_8965)));
            sum +=
                amplitude * layer.gradient(x * scale + 0.37 * f64::from(k), y * scale - 0.71 * f64::from(k));
            amplitude *= gain;
            scale *= 2.0;
        }
        sum * 1.4
    }

    /// Cellular noise: distances to the nearest and second nearest random point, and the nearest one's cell.
    pub fn cells(self, x: f64, y: f64) -> (f64, f64, (i64, i64)) {
        let (ix, iy) = (x.floor() as i64, y.floor() as i64);
        let other = Noise(self.0 ^ 0x5bd1_e995);
        let (mut first, mut second, mut id) = (f64::MAX, f64::MAX, (0, 0));
        for j in iy - 1..=iy + 1 {
            for i in ix - 1..=ix + 1 {
                let (px, py) = (i as f64 + self.cell(i, j), j as f64 + other.cell(i, j));
                let d = (px - x) * (px - x) + (py - y) * (py - y);
                if d < first {
                    (second, first, id) = (first, d, (i, j));
                } else if d < second {
                    second = d;
                }
            }
        }
        (first.sqrt(), second.sqrt(), id)
    }
}

fn fade(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// Smooth step from 0 at `a` to 1 at `b` (either order).
pub(crate) fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_repeat_and_differ() {
        let take = |seed, stream| {
            let mut r = Random::new(seed, stream);
            (0..8).map(|_| r.unit()).collect::<Vec<_>>()
        };
        assert_eq!(take(1, 2), take(1, 2));
        assert_ne!(take(1, 2), take(1, 3));
        assert_ne!(take(1, 2), take(2, 2));
    }

    #[test]
    fn normal_has_unit_variance() {
        let mut r = Random::new(5, 0);
        let n = 20_000;
        let (s, q) = (0..n)
            .map(|_| r.normal())
            .fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
        let (mean, var) = (s / f64::from(n), q / f64::from(n));
        assert!(mean.abs() < 0.03 && (var - 1.0).abs() < 0.05, "{mean} {var}");
    }

    #[test]
    fn gradient_noise_is_continuous_and_vanishes_on_the_lattice() {
        let noise = Random::new(3, 0).noise();
        assert_eq!(noise.gradient(4.0, -7.0), 0.0);
        for k in 0..200 {
            let (x, y) = (f64::from(k) * 0.173, f64::from(k) * -0.091);
            assert!((noise.gradient(x, y) - noise.gradient(x + 1e-6, y)).abs() < 1e-4);
        }
    }
}
