//! Photon noise: light is counted, and a count varies by its square root.
//!
//! `I' = I + sqrt(255 mean(I) / N) z` with `N` the electrons that intensity 255 frees in a pixel, `mean(I)` over the colours
//! and `z` standard normal, the same for all colours. Depends on nothing else in the crate.

use super::random::Random;

/// The noise of a pixel of colour `colour`; `electrons` > 0 are those of intensity 255.
pub(crate) fn noise(electrons: f64, colour: [f64; 3], random: &mut Random) -> f64 {
    let mean = (colour.iter().sum::<f64>() / 3.0).max(0.0);
    (255.0 * mean / electrons).sqrt() * random.normal()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variance_grows_with_the_light() {
        let mut random = Random::new(2, 9);
        for level in [20.0, 80.0, 255.0] {
            let n = 4000;
            let sum: f64 = (0..n)
                .map(|_| noise(100.0, [level; 3], &mut random).powi(2))
                .sum();
            let (variance, expected) = (sum / f64::from(n), 255.0 * level / 100.0);
            assert!((variance / expected - 1.0).abs() < 0.1, "{level}: {variance}");
        }
        assert_eq!(noise(100.0, [-3.0; 3], &mut random), 0.0);
    }
}
