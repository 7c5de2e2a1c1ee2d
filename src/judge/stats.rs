//! Whether a difference between two trackers says more than chance: figures of the same sequences are paired, and
//! sequences are the unit of chance, because errors within one hang together.
//!
//! With `a_s`, `b_s` the means of a figure over the `w_s` frames of sequence `s`, the difference of the pooled figures is
//! `D = Σ w_s (b_s - a_s) / Σ w_s`. Its 95 % interval is a bootstrap over sequences (Efron 1979), its percentiles moved
//! out as far as the t distribution and the variance of a small sample ask for (Hesterberg 2015, "expanded percentile
//! interval"). Its p value is exact at any number of sequences: if nothing distinguishes the two, each sequence's pair
//! may as well be the other way round (Fisher's sign flips). Over many trackers the false discovery rate is controlled
//! by Benjamini and Hochberg (1995).

use crate::metric::quantile;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Figures of two trackers on one sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Frames that the figures are means over, or 1 to weigh all sequences alike.
    pub weight: f64,
    /// Figure of the first.
    pub a: f64,
    /// Figure of the second.
    pub b: f64,
}

impl Pair {
    /// `w (b - a)`
    fn moved(&self) -> f64 {
        self.weight * (self.b - self.a)
    }
}

/// What [`difference`] finds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// The first's figure over all sequences.
    pub a: f64,
    /// The second's.
    pub b: f64,
    /// Ends of the 95 % interval of `b - a`; NaN with fewer than two sequences.
    pub interval: [f64; 2],
    /// Probability of a difference at least as large if nothing distinguishes the two.
    pub p: f64,
}

impl Difference {
    /// Whether the interval leaves out 0.
    pub fn excludes_zero(&self) -> bool {
        self.interval[0] > 0.0 || self.interval[1] < 0.0
    }
}

/// Sequences that differ up to which all sign patterns are gone through.
const EXACT: usize = 13;
/// Sign patterns drawn at most otherwise, which bounds how small a p value gets.
const MOST_FLIPS: u32 = 100_000;
/// Drawing ends when this many patterns reached the difference (Besag and Clifford 1991).
const ENOUGH: u32 = 50;

/// Difference of two figures over `pairs`, with its interval from `resamples` bootstrap samples and its p value; `None`
/// without sequences. The same seed gives the same result.
pub fn difference(pairs: &[Pair], resamples: usize, seed: u64) -> Option<Difference> {
    let total: f64 = pairs.iter().map(|p| p.weight).sum();
    if total <= 0.0 {
        return None;
    }
    let mean = |f: fn(&Pair) -> f64| pairs.iter().map(|p| p.weight * f(p)).sum::<f64>() / total;
    Some(Difference {
        a: mean(|p| p.a),
        b: mean(|p| p.b),
        interval: interval(pairs, resamples, &mut Pcg64::seed_from_u64(seed)),
        p: sign_flips(pairs, &mut Pcg64::seed_from_u64(seed ^ 1)),
    })
}

fn interval(pairs: &[Pair], resamples: usize, rng: &mut Pcg64) -> [f64; 2] {
    let n = pairs.len();
    if n < 2 || resamples == 0 {
        return [f64::NAN; 2];
    }
    if pairs.iter().all(|p| p.a == p.b) {
        return [0.0; 2];
    }
    let terms: Vec<(f64, f64)> = pairs.iter().map(|p| (p.moved(), p.weight)).collect();
    let mut draws: Vec<f64> = (0..resamples)
        .map(|_| {
            let (mut moved, mut weight) = (0.0, 0.0);
            for _ in 0..n {
                let (m, w) = terms[rng.random_range(0..n)];
                moved += m;
                weight += w;
            }
            moved / weight
        })
        .collect();
    draws.sort_unstable_by(f64::total_cmp);
    let tail = tail(n);
    [tail, 1.0 - tail].map(|q| quantile::linear(&draws, q))
}

/// Share of the bootstrap distribution of `n` sequences that lies beyond each end of a 95 % interval:
/// `Φ(-t sqrt(n / (n - 1)))` with the 97.5 % point `t` of Student's distribution.
fn tail(n: usize) -> f64 {
    let freedom = (n - 1) as f64;
    let reach = student_975(freedom) * (n as f64 / freedom).sqrt();
    libm::erfc(reach / std::f64::consts::SQRT_2) / 2.0
}

/// 97.5 % point of Student's t distribution, from the normal one's by the expansion of Fisher and Cornish (1960); within
/// 1 % from two degrees of freedom on.
fn student_975(freedom: f64) -> f64 {
    let z = quantile::NORMAL_975;
    let z2 = z * z;
    let terms = [
        (z2 + 1.0) / 4.0,
        ((5.0 * z2 + 16.0) * z2 + 3.0) / 96.0,
        (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / 384.0,
        ((((79.0 * z2 + 776.0) * z2 + 1482.0) * z2 - 1920.0) * z2 - 945.0) / 92160.0,
    ];
    let series = terms.iter().rev().fold(0.0, |sum, term| (sum + term) / freedom);
    z * (1.0 + series)
}

/// Share of the sign patterns of the sequences' differences whose sum is at least as far from 0 as the true one.
fn sign_flips(pairs: &[Pair], rng: &mut Pcg64) -> f64 {
    let moved: Vec<f64> = pairs.iter().map(Pair::moved).filter(|m| *m != 0.0).collect();
    let n = moved.len();
    // Sums of the same numbers in another order differ in their last bits.
    let slack = 1e-12 * moved.iter().map(|m| m.abs()).sum::<f64>();
    let observed = moved.iter().sum::<f64>().abs() - slack;
    let reached = |mut signs: u64, from: usize| {
        let mut sum = 0.0;
        for m in &moved[from..n.min(from + 64)] {
            sum += if signs & 1 == 0 { *m } else { -*m };
            signs >>= 1;
        }
        sum
    };
    if n <= EXACT {
        let patterns = 1u64 << n;
        let count = (0..patterns).filter(|&s| reached(s, 0).abs() >= observed).count();
        return count as f64 / patterns as f64;
    }
    let mut hits = 0;
    for drawn in 1..=MOST_FLIPS {
        let sum: f64 = (0..n).step_by(64).map(|from| reached(rng.random(), from)).sum();
        hits += u32::from(sum.abs() >= observed);
        if hits == ENOUGH {
            return f64::from(hits) / f64::from(drawn);
        }
    }
    f64::from(hits + 1) / f64::from(MOST_FLIPS + 1)
}

/// Adjusted p values `q`: calling everything with `q <= rate` a discovery keeps the expected share of false ones among
/// them at `rate` or below. `q_(i) = min_{j >= i} m p_(j) / j` over the sorted p values.
pub fn benjamini_hochberg(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|&i, &j| p[j].total_cmp(&p[i]));
    let mut q = vec![1.0; p.len()];
    let mut least: f64 = 1.0;
    for (k, &i) in order.iter().enumerate() {
        let rank = (p.len() - k) as f64;
        least = least.min(p[i] * (p.len() as f64 / rank));
        q[i] = least;
    }
    q
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand_distr::{Distribution, Normal};

    fn pairs(differences: &[f64]) -> Vec<Pair> {
        let pair = |d: &f64| Pair {
            weight: 1.0,
            a: 0.5,
            b: 0.5 + d,
        };
        differences.iter().map(pair).collect()
    }

    #[test]
    fn students_points() {
        for (freedom, t) in [
            (2.0, 4.303),
            (3.0, 3.182),
            (5.0, 2.571),
            (10.0, 2.228),
            (30.0, 2.042),
        ] {
            assert!((student_975(freedom) / t - 1.0).abs() < 0.01, "{freedom}");
        }
        assert!((tail(100_000) - 0.025).abs() < 1e-5);
    }

    #[test]
    fn p_values_of_few_sequences_are_exact() {
        // Of the 8 patterns of three differences of one sign, two reach their sum.
        assert_eq!(difference(&pairs(&[0.1, 0.2, 0.3]), 100, 0).unwrap().p, 0.25);
        assert_eq!(difference(&pairs(&[0.1, 0.0, 0.0]), 100, 0).unwrap().p, 1.0);
        assert_eq!(difference(&pairs(&[0.125; 10]), 100, 0).unwrap().p, 2.0 / 1024.0);
        let many = difference(&pairs(&[0.125; 40]), 100, 0).unwrap();
        assert!(many.p < 2e-5 && many.excludes_zero() && many.interval == [0.125; 2]);
    }

    #[test]
    fn frames_weigh() {
        let two = [
            Pair {
                weight: 30.0,
                a: 0.5,
                b: 0.9,
            },
            Pair {
                weight: 10.0,
                a: 1.0,
                b: 1.0,
            },
        ];
        let d = difference(&two, 1000, 0).unwrap();
        assert!((d.a - 0.625).abs() < 1e-12 && (d.b - 0.925).abs() < 1e-12);
        assert!(!d.excludes_zero());
        assert_eq!(difference(&[], 10, 0), None);
        assert!(difference(&two[..1], 10, 0).unwrap().interval[0].is_nan());
    }

    #[test]
    fn discoveries() {
        let q = benjamini_hochberg(&[0.04, 0.001, 0.03, 0.5]);
        let expected = [0.16 / 3.0, 0.004, 0.16 / 3.0, 0.5];
        assert!(
            q.iter().zip(expected).all(|(q, e)| (q - e).abs() < 1e-12),
            "{q:?}"
        );
        assert!(benjamini_hochberg(&[]).is_empty());
    }

    /// The interval covers the true difference about as often as it says, and not less often for few sequences, where
    /// plain percentiles do (0.88 at seven).
    #[test]
    fn intervals_cover() {
        let mut rng = Pcg64::seed_from_u64(7);
        for n in [7, 13, 40] {
            let noise = Normal::new(0.02, 0.05).unwrap();
            let trials = 600;
            let covered = (0..trials)
                .filter(|&k| {
                    let d: Vec<f64> = (0..n).map(|_| noise.sample(&mut rng)).collect();
                    let [low, high] = difference(&pairs(&d), 500, k).unwrap().interval;
                    low <= 0.02 && 0.02 <= high
                })
                .count() as f64;
            println!(
                "{n} sequences: covered in {:.3} of {trials} trials",
                covered / trials as f64
            );
            assert!(covered / trials as f64 > 0.93, "{n}");
        }
    }

    proptest! {
        #[test]
        fn exchanging_the_two_turns_the_sign(d in prop::collection::vec(-0.5..0.5f64, 2..30)) {
            let forth = pairs(&d);
            let back: Vec<Pair> = forth.iter().map(|p| Pair { a: p.b, b: p.a, ..*p }).collect();
            let (x, y) = (difference(&forth, 200, 3).unwrap(), difference(&back, 200, 3).unwrap());
            prop_assert_eq!((x.a, x.b, x.p), (y.b, y.a, y.p));
            prop_assert!((x.interval[0] + y.interval[1]).abs() < 1e-12);
            prop_assert!(x.p > 0.0 && x.p <= 1.0);
        }

        #[test]
        fn adjusted_p_values_keep_their_order(p in prop::collection::vec(0.0..1.0f64, 1..50)) {
            let q = benjamini_hochberg(&p);
            for i in 0..p.len() {
                prop_assert!(q[i] >= p[i] && q[i] <= 1.0);
                for j in 0..p.len() {
                    prop_assert!(p[i] > p[j] || q[i] <= q[j]);
                }
            }
        }
    }
}
