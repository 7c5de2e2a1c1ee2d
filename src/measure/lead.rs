//! How many times faster one tracker is than another, with an interval from the times of single frames in single passes.

use crate::metric::quantile;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Bootstrap samples behind an interval.
const DRAWS: usize = 1000;

/// The fastest tracker beside the next.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Lead {
    /// The fastest.
    pub fastest: String,
    /// The next.
    pub next: String,
    /// Time of the next by that of the fastest, over the frames that both have times of.
    pub times: f64,
    /// Ends of its 95 % interval.
    pub interval: [f64; 2],
}

/// Seconds of one tracker on one sequence: per timed pass, per frame, NaN for frames that it lost.
pub(super) type Passes = Vec<Vec<f32>>;

/// `(R, [a, b])`: how many times longer `slow` takes than `fast`, both over the same sequences, and its 95 % interval.
///
/// `R = Σ s_i / Σ f_i` with the least times `s_i`, `f_i` of frame `i` over the passes, over the frames that both have times
/// of. A bootstrap sample draws, with replacement, passes for each tracker and frames for both in common, and takes least
/// times over the passes that were drawn. Fewer different passes have longer least times; the samples are therefore scaled
/// so that their median is `R`, before their 2.5 % and 97.5 % quantiles are taken. `None` without a common frame.
pub(super) fn ratio(fast: &[Passes], slow: &[Passes]) -> Option<(f64, [f64; 2])> {
    let all = |passes: &Passes| (0..passes.len()).collect::<Vec<_>>();
    let mut common: Vec<[f64; 2]> = Vec::new();
    for (fast, slow) in fast.iter().zip(slow) {
        common.extend(pairs(fast, &all(fast), slow, &all(slow)));
    }
    let times = quotient(common.iter())?;
    let mut rng = Pcg64::seed_from_u64(0);
    let mut draws = Vec::with_capacity(DRAWS);
    for _ in 0..DRAWS {
        let mut drawn = Vec::with_capacity(common.len());
        for (fast, slow) in fast.iter().zip(slow) {
            let mut some = |of: &Passes| -> Vec<usize> {
                let n = of.len();
                (0..n).map(|_| rng.random_range(0..n)).collect()
            };
            let (a, b) = (some(fast), some(slow));
            drawn.extend(pairs(fast, &a, slow, &b));
        }
        if drawn.is_empty() {
            continue;
        }
        let frames = (0..drawn.len()).map(|_| &drawn[rng.random_range(0..drawn.len())]);
        draws.extend(quotient(frames));
    }
    draws.sort_unstable_by(f64::total_cmp);
    let scale = times / quantile::linear(&draws, 0.5);
    Some((times, [0.025, 0.975].map(|q| scale * quantile::linear(&draws, q))))
}

/// Least times of each frame over the chosen passes, of both trackers, where both have one.
fn pairs<'a>(
    fast: &'a Passes,
    chosen_fast: &'a [usize],
    slow: &'a Passes,
    chosen_slow: &'a [usize],
) -> impl Iterator<Item = [f64; 2]> + 'a {
    let least = |passes: &Passes, chosen: &[usize], frame: usize| {
        let times = chosen.iter().filter_map(|&pass| passes[pass].get(frame).copied());
        f64::from(times.fold(f32::NAN, f32::min))
    };
    let frames = fast.first().map_or(0, Vec::len);
    (0..frames)
        .map(move |i| [least(fast, chosen_fast, i), least(slow, chosen_slow, i)])
        .filter(|pair| pair.iter().all(|t| t.is_finite()))
}

/// Sum of the second times by that of the first.
fn quotient<'a>(pairs: impl Iterator<Item = &'a [f64; 2]>) -> Option<f64> {
    let sum = pairs.fold([0.0, 0.0], |[a, b], [x, y]| [a + x, b + y]);
    Some(sum[1] / sum[0]).filter(|r| r.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Passes over frames of `times`, each pass longer by a share of its own.
    fn passes(times: &[f32]) -> Vec<Passes> {
        let pass = |k: u8| times.iter().map(|t| t * (1.0 + 0.01 * f32::from(k))).collect();
        vec![(0..3).map(pass).collect()]
    }

    #[test]
    fn the_ratio_is_of_least_times_within_its_interval() {
        let fast = passes(&[1.0, 2.0, 3.0, 2.0]);
        let slow = passes(&[3.0, 4.0, 5.0, 4.0]);
        let (times, [low, high]) = ratio(&fast, &slow).unwrap();
        assert!((times - 2.0).abs() < 1e-6, "{times}");
        assert!(low < times && times < high, "{low} {high}");
        assert!(low > 1.6 && high < 3.0, "{low} {high}");
        assert_eq!(ratio(&fast, &slow), ratio(&fast, &slow));
    }

    #[test]
    fn frames_that_one_lost_do_not_count() {
        let fast = passes(&[1.0, f32::NAN, 1.0]);
        let slow = passes(&[2.0, 100.0, 2.0]);
        assert!((ratio(&fast, &slow).unwrap().0 - 2.0).abs() < 1e-6);
        assert_eq!(ratio(&passes(&[f32::NAN]), &passes(&[1.0])), None);
        assert_eq!(ratio(&[], &[]), None);
    }
}
