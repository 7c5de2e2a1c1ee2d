//! Whether a difference between two trackers says more than chance: figures of the same sequences are paired, and
//! sequences are the unit of chance, because errors within one hang together.
//!
//! With `a_s` the mean of a figure over `v_s` frames of sequence `s` in the first run and `b_s` that over `w_s` frames in the
//! second, the difference of the pooled figures is `D = Σ w_s b_s / Σ w_s - Σ v_s a_s / Σ v_s`. (How many frames there are
//! depends on the tracker where it is started anew after failures.) Its 95 % interval is a bootstrap over sequences (Efron 1979), its percentiles moved
//! out as far as the t distribution and the variance of a small sample ask for (Hesterberg 2015, "expanded percentile
//! interval"). Its p value is exact at any number of sequences: if nothing distinguishes the two, each sequence's pair
//! may as well be the other way round (Fisher's sign flips). Over many trackers the false discovery rate is controlled
//! by Benjamini and Hochberg (1995), over all pairs of few the chance of one false difference after Holm (1979).

use crate::metric::quantile;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A figure that is a mean over frames: of a tracker on a sequence, or over sequences.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Side {
    /// Frames that it is a mean over, or 1 to weigh all sequences alike; 0 where it is undefined.
    pub weight: f64,
    /// The weight times the figure.
    pub sum: f64,
}

impl Side {
    /// A figure over `weight` frames.
    pub fn new(weight: f64, figure: f64) -> Side {
        Side {
            weight,
            sum: weight * figure,
        }
    }

    /// The figure; NaN where it is undefined.
    pub fn mean(&self) -> f64 {
        self.sum / self.weight
    }
}

impl std::ops::AddAssign for Side {
    fn add_assign(&mut self, more: Side) {
        self.weight += more.weight;
        self.sum += more.sum;
    }
}

/// Figures of two trackers on one sequence.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pair {
    /// Of the first.
    pub a: Side,
    /// Of the second.
    pub b: Side,
}

impl Pair {
    /// The figures over several sequences.
    fn over<'a>(pairs: impl Iterator<Item = &'a Pair>) -> Pair {
        pairs.fold(Pair::default(), |mut total, pair| {
            total.a += pair.a;
            total.b += pair.b;
            total
        })
    }

    /// How much larger the second figure is.
    fn moved(&self) -> f64 {
        self.b.mean() - self.a.mean()
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

/// 95 % interval of a figure over `sides`, a sequence each, as [`difference`] has it of differences; NaN with fewer than two
/// sequences.
pub fn interval_of(sides: &[Side], resamples: usize, seed: u64) -> [f64; 2] {
    // Its difference from 0 over the same frames.
    let pair = |side: &Side| Pair {
        a: Side::new(side.weight, 0.0),
        b: *side,
    };
    let pairs: Vec<Pair> = sides.iter().map(pair).collect();
    interval(&pairs, resamples, &mut Pcg64::seed_from_u64(seed))
}

/// Sequences that differ up to which all sign patterns are gone through.
const EXACT: usize = 13;
/// Sign patterns drawn at most otherwise, which bounds how small a p value gets.
const MOST_FLIPS: u32 = 100_000;
/// Drawing ends when this many patterns reached the difference (Besag and Clifford 1991).
const ENOUGH: u32 = 50;

/// Difference of two figures over `pairs`, with its interval from `resamples` bootstrap samples and its p value; `None`
/// when one of them is undefined in all sequences. The same seed gives the same result.
pub fn difference(pairs: &[Pair], resamples: usize, seed: u64) -> Option<Difference> {
    let total = Pair::over(pairs.iter());
    if total.a.weight <= 0.0 || total.b.weight <= 0.0 {
        return None;
    }
    Some(Difference {
        a: total.a.mean(),
        b: total.b.mean(),
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
    let mut draws: Vec<f64> = (0..resamples)
        .map(|_| Pair::over((0..n).map(|_| &pairs[rng.random_range(0..n)])).moved())
        // Sequences in which one of the two is undefined may be all that are drawn.
        .filter(|moved| moved.is_finite())
        .collect();
    draws.sort_unstable_by(f64::total_cmp);
    let tail = tail(n);
    [tail, 1.0 - tail].map(|q| quantile::linear(&draws, q))
}

/// Share of the bootstrap distribution of `n` sequences that lies beyond each end of a 95 % interval:
/// `Φ(-t sqrt(n / (n - 1)))` with the 97.5 % point `t` of Student's distribution.
fn tail(n: usize) -> f64 {
    let freedom = (n - 1) as f64;
    let reach = quantile::student_975(freedom) * (n as f64 / freedom).sqrt();
    libm::erfc(reach / std::f64::consts::SQRT_2) / 2.0
}

/// Share of the patterns of exchanged pairs whose difference is at least as far from 0 as the true one. A pattern that
/// leaves one of the two undefined counts, which can only make the share larger.
fn sign_flips(pairs: &[Pair], rng: &mut Pcg64) -> f64 {
    // An exchanged pair changes the sign of what its second side has more than the first.
    let more = |p: &Pair| Side {
        weight: p.b.weight - p.a.weight,
        sum: p.b.sum - p.a.sum,
    };
    let moved: Vec<Side> = pairs.iter().map(more).filter(|m| *m != Side::default()).collect();
    let n = moved.len();
    let total = Pair::over(pairs.iter());
    let (weight, sum) = (total.a.weight + total.b.weight, total.a.sum + total.b.sum);
    let difference =
        |more: Side| (sum + more.sum) / (weight + more.weight) - (sum - more.sum) / (weight - more.weight);
    // Sums of the same numbers in another order differ in their last bits.
    let size: f64 = pairs.iter().map(|p| p.a.sum.abs() + p.b.sum.abs()).sum();
    let observed = total.moved().abs() - 1e-12 * size / total.a.weight.min(total.b.weight);
    let flipped = |mut signs: u64, from: usize| {
        let mut all = Side::default();
        for m in &moved[from..n.min(from + 64)] {
            let sign = if signs & 1 == 0 { 1.0 } else { -1.0 };
            all += Side {
                weight: sign * m.weight,
                sum: sign * m.sum,
            };
            signs >>= 1;
        }
        all
    };
    let reached = |more: Side| {
        let found = difference(more).abs();
        found >= observed || found.is_nan()
    };
    if n <= EXACT {
        let patterns = 1u64 << n;
        let count = (0..patterns).filter(|&s| reached(flipped(s, 0))).count();
        return count as f64 / patterns as f64;
    }
    let mut hits = 0;
    for drawn in 1..=MOST_FLIPS {
        let mut more = Side::default();
        (0..n)
            .step_by(64)
            .for_each(|from| more += flipped(rng.random(), from));
        hits += u32::from(reached(more));
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

/// Adjusted p values after Holm (1979): calling everything at or below a rate a discovery keeps the chance of even one false
/// one at that rate. `max_{j <= i} min(1, (m - j + 1) p_(j))` over the sorted p values.
pub fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|&i, &j| p[i].total_cmp(&p[j]));
    let mut adjusted = vec![1.0; p.len()];
    let mut most: f64 = 0.0;
    for (k, &i) in order.iter().enumerate() {
        most = most.max((p.len() - k) as f64 * p[i]).min(1.0);
        adjusted[i] = most;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand_distr::{Distribution, Normal};

    fn pairs(differences: &[f64]) -> Vec<Pair> {
        let pair = |d: &f64| Pair {
            a: Side::new(1.0, 0.5),
            b: Side::new(1.0, 0.5 + d),
        };
        differences.iter().map(pair).collect()
    }

    #[test]
    fn tails_approach_those_of_the_normal_distribution() {
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
    fn a_figure_has_an_interval_of_its_own() {
        let sides = [0.2, 0.4, 0.9].map(|figure| Side::new(10.0, figure));
        let [low, high] = interval_of(&sides, 1000, 0);
        assert!((0.2..0.5).contains(&low) && high > 0.5 && high <= 0.9);
        assert_eq!(interval_of(&[Side::new(3.0, 0.5); 4], 1000, 0), [0.5; 2]);
        assert!(interval_of(&sides[..1], 1000, 0)[0].is_nan());
    }

    #[test]
    fn frames_weigh() {
        let two = [
            Pair {
                a: Side::new(30.0, 0.5),
                b: Side::new(30.0, 0.9),
            },
            Pair {
                a: Side::new(10.0, 1.0),
                b: Side::new(10.0, 1.0),
            },
        ];
        let d = difference(&two, 1000, 0).unwrap();
        assert!((d.a - 0.625).abs() < 1e-12 && (d.b - 0.925).abs() < 1e-12);
        assert!(!d.excludes_zero());
        assert_eq!(difference(&[], 10, 0), None);
        assert!(difference(&two[..1], 10, 0).unwrap().interval[0].is_nan());
    }

    #[test]
    fn each_side_has_frames_of_its_own() {
        let pair = |v: f64, a: f64, w: f64, b: f64| Pair {
            a: Side::new(v, a),
            b: Side::new(w, b),
        };
        let two = [pair(10.0, 1.0, 30.0, 1.0), pair(30.0, 0.5, 10.0, 0.5)];
        let d = difference(&two, 1000, 0).unwrap();
        assert_eq!((d.a, d.b), (0.625, 0.875));
        // Exchanged in both sequences it is as large, in one of them smaller.
        assert_eq!(d.p, 0.5);
        // A sequence in which the second has no frames.
        let d = difference(&[pair(10.0, 1.0, 0.0, 0.0), two[1]], 1000, 0).unwrap();
        assert_eq!((d.a, d.b), (0.625, 0.5));
        assert!(d.interval.iter().all(|v| v.is_finite()) && d.p > 0.0);
        assert_eq!(difference(&[pair(10.0, 1.0, 0.0, 0.0)], 1000, 0), None);
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

    #[test]
    fn corrected_for_the_number_of_pairs() {
        assert_eq!(holm(&[0.01, 0.04, 0.03]), [0.03, 0.06, 0.06]);
        assert_eq!(holm(&[0.5, 0.6]), [1.0, 1.0]);
        assert!(holm(&[]).is_empty());
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
            let back: Vec<Pair> = forth.iter().map(|p| Pair { a: p.b, b: p.a }).collect();
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
