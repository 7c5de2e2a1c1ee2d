//! Weights of particles, and drawing particles by them (Gordon, Salmond & Smith 1993; Kitagawa 1996; Liu & Chen 1998).

use crate::params::param_enum;
use rand::RngExt;
use rand_pcg::Pcg64;

param_enum! {
    /// How particles are drawn.
    pub enum Resampling {
        /// They are not: weights multiply up.
        None = "none",
        /// Independently, each by binary search.
        Binary = "binary",
        /// Independently, each by linear search.
        Linear = "linear",
        /// Each as often as its weight calls for, rounded down; the rest independently by the remainders.
        Residual = "residual",
        /// At even distances along the cumulated weights, from one random offset.
        Systematic = "systematic",
    }
}

/// Limits of the logarithm of the inverse temperature, in units of the scores' spread, and where its search begins.
const COLDNESS: [f64; 2] = [-10.0, 20.0];
const USUAL_COLDNESS: f64 = 0.5;
/// The search ends when the effective number is right to this, relatively, or after so many rounds.
const PRECISION: f64 = 1e-5;
const ROUNDS: usize = 40;

/// Effective number of particles, `(Σw)² / Σw²`.
pub(super) fn effective(weights: &[f64]) -> f64 {
    let (sum, squares) = weights.iter().fold((0.0, 0.0), |(s, q), w| (s + w, q + w * w));
    sum * sum / squares
}

/// Normalised weights `exp(carried + β score)`, with `β = 1`, or such that the effective number of particles is `share` of
/// all (where the scores allow it). One score at least is finite.
pub(super) fn temper(scores: &[f64], carried: &[f64], share: Option<f64>, weights: &mut [f64]) {
    let top = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut with = |beta: f64| {
        let log = |i: usize| carried[i] + beta * (scores[i] - top);
        let live = |i: &usize| scores[*i] > f64::NEG_INFINITY;
        let highest = (0..scores.len())
            .filter(live)
            .map(log)
            .fold(f64::NEG_INFINITY, f64::max);
        for i in 0..scores.len() {
            weights[i] = if live(&i) {
                libm::exp(log(i) - highest)
            } else {
                0.0
            };
        }
        effective(weights)
    };
    match share {
        None => {
            with(1.0);
        }
        Some(share) => {
            let wanted = (share * scores.len() as f64).max(1.0);
            // In units of the scores' own spread.
            let finite = scores.iter().filter(|s| s.is_finite());
            let (count, sum) = finite.fold((0.0, 0.0), |(n, s), v| (n + 1.0, s + (top - v)));
            let spread: f64 = sum / count;
            if spread > 0.0 && spread.is_finite() {
                find_root(|x| libm::log(with(libm::exp(x) / spread) / wanted));
            } else {
                with(0.0);
            }
        }
    }
    let total: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= total);
}

/// Evaluates `g`, which falls, last of all where it is nearly zero: brackets its root by steps that double, then regula falsi
/// with the Illinois rule (Dowell & Jarratt 1971). Ends at a limit that `g` does not cross zero before.
fn find_root(mut g: impl FnMut(f64) -> f64) {
    let [least, most] = COLDNESS;
    let mut a = (USUAL_COLDNESS, g(USUAL_COLDNESS));
    let mut step = a.1.signum();
    let mut b = a;
    while a.1 * b.1 > 0.0 {
        if b.0 == least || b.0 == most {
            return;
        }
        a = b;
        b.0 = (b.0 + step).clamp(least, most);
        b.1 = g(b.0);
        step *= 2.0;
    }
    for _ in 0..ROUNDS {
        if b.1.abs() < PRECISION {
            return;
        }
        let x = (a.0 * b.1 - b.0 * a.1) / (b.1 - a.1);
        let value = g(x);
        // The end that stays counts half.
        a = if value * b.1 < 0.0 { b } else { (a.0, 0.5 * a.1) };
        b = (x, value);
    }
}

/// Draws as many particles as there are weights (normalised) into `chosen`; `cumulative` is scratch of the same length.
pub(super) fn resample(
    how: Resampling,
    weights: &[f64],
    rng: &mut Pcg64,
    cumulative: &mut [f64],
    chosen: &mut [usize],
) {
    let n = weights.len();
    let share = |w: f64| n as f64 * w;
    let mut sure = 0;
    if how == Resampling::Residual {
        for (i, w) in weights.iter().enumerate() {
            let copies = (share(*w).floor() as usize).min(n - sure);
            chosen[sure..sure + copies].fill(i);
            sure += copies;
        }
    }
    let mut total = 0.0;
    for (sum, &w) in cumulative.iter_mut().zip(weights) {
        total += match how {
            Resampling::Residual => share(w) - share(w).floor(),
            _ => w,
        };
        *sum = total;
    }
    let last = n - 1;
    let offset = rng.random_range(0.0..1.0);
    let mut at = 0;
    for (k, c) in chosen.iter_mut().enumerate().skip(sure) {
        *c = match how {
            Resampling::None => k,
            Resampling::Systematic => {
                let u = total * (k as f64 + offset) / n as f64;
                while cumulative[at] <= u && at < last {
                    at += 1;
                }
                at
            }
            Resampling::Linear => {
                let u = total * rng.random_range(0.0..1.0);
                cumulative.iter().position(|&sum| sum > u).unwrap_or(last)
            }
            Resampling::Binary | Resampling::Residual => {
                let u = total * rng.random_range(0.0..1.0);
                cumulative.partition_point(|&sum| sum <= u).min(last)
            }
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    const HOW: [Resampling; 4] = [
        Resampling::Binary,
        Resampling::Linear,
        Resampling::Residual,
        Resampling::Systematic,
    ];

    #[test]
    fn particles_are_drawn_as_often_as_they_weigh() {
        let weights: Vec<f64> = [1.0, 0.0, 5.0, 2.5, 1.5].map(|w| w / 10.0).to_vec();
        for how in HOW {
            let mut rng = Pcg64::seed_from_u64(3);
            let mut counts = [0.0; 5];
            let rounds = 20_000;
            for _ in 0..rounds {
                let (mut chosen, mut scratch) = ([9; 5], [0.0; 5]);
                resample(how, &weights, &mut rng, &mut scratch, &mut chosen);
                chosen.iter().for_each(|&c| counts[c] += 1.0);
            }
            for (count, w) in counts.iter().zip(&weights) {
                let mean = count / (5.0 * rounds as f64);
                assert!((mean - w).abs() < 0.006, "{how:?}: {mean} for {w}");
            }
        }
    }

    #[test]
    fn whole_copies_are_sure() {
        let weights = [0.5, 0.25, 0.25, 0.0];
        for how in [Resampling::Residual, Resampling::Systematic] {
            let mut rng = Pcg64::seed_from_u64(1);
            let (mut chosen, mut scratch) = ([9; 4], [0.0; 4]);
            resample(how, &weights, &mut rng, &mut scratch, &mut chosen);
            assert_eq!(chosen, [0, 0, 1, 2]);
        }
        let (mut chosen, mut scratch) = ([9; 4], [0.0; 4]);
        let mut rng = Pcg64::seed_from_u64(1);
        resample(Resampling::None, &weights, &mut rng, &mut scratch, &mut chosen);
        assert_eq!(chosen, [0, 1, 2, 3]);
    }

    #[test]
    fn temperature_gives_the_wanted_number_of_effective_particles() {
        let carried = [0.0; 200];
        for scale in [1e-6, 1.0, 1e8] {
            let scores: Vec<f64> = (0..200).map(|i| -scale * f64::from(i * i)).collect();
            let mut weights = [0.0; 200];
            temper(&scores, &carried, Some(0.05), &mut weights);
            assert!((effective(&weights) - 10.0).abs() < 0.01);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        // Equal scores, and particles without one.
        let mut scores = vec![2.0; 200];
        scores[7] = f64::NEG_INFINITY;
        let mut weights = [0.0; 200];
        temper(&scores, &carried, Some(0.05), &mut weights);
        assert_eq!((weights[7], weights[8]), (0.0, 1.0 / 199.0));
        // Weights multiply up.
        let carried: Vec<f64> = (0..200).map(|i| -f64::from(i)).collect();
        temper(&vec![0.0; 200], &carried, None, &mut weights);
        assert!((weights[1] / weights[0] - (-1f64).exp()).abs() < 1e-12);
    }
}
