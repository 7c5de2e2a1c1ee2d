//! All trackers of one or more runs beside each other: mean ranks over sequences, and groups that do not differ.
//!
//! On each sequence the `k` trackers are ranked by a figure, 1 the best, those that are equal by the mean of their places.
//! Mean ranks are compared as Friedman (1937) does: if nothing distinguishes the trackers, the ranks within a sequence may
//! be in any order, so that the p value of `Σ_j (r_j - (k + 1) / 2)²` over mean ranks `r_j` is a share of drawn orders. Pairs
//! are compared by the sign flips of [`crate::judge::stats`], their p values corrected for the number of pairs after Holm
//! (1979). Trackers share a letter when they do not differ (compact letter display, Piepho 2004).

use super::{CompareError, FinishedRun, Options, obstacles, side};
use crate::judge::stats::{Pair, Side, difference, holm};
use crate::metric::Figure;
use crate::metric::aggregate::SequenceRow;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Orders drawn for the p value of all ranks together.
const ORDERS: u32 = 10_000;

/// A tracker among the others.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranked {
    /// Its id.
    pub tracker: String,
    /// The run that has it.
    pub run: String,
    /// Mean over sequences of its place among the trackers, 1 the best.
    pub mean_rank: f64,
    /// The figure over all sequences.
    pub value: f64,
    /// Letters of the groups that it is in: trackers that share one do not differ.
    pub groups: String,
}

/// Two trackers of a ranking.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PairTest {
    /// Place of the first in the ranking, from 0.
    pub a: usize,
    /// Place of the second.
    pub b: usize,
    /// How much larger the figure of the second is.
    pub difference: f64,
    /// Probability of a difference at least as large by chance.
    pub p: f64,
    /// `p` corrected for the number of pairs (Holm).
    pub p_holm: f64,
}

/// Trackers under one protocol, the best mean rank first.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranking {
    /// The protocol.
    pub protocol: String,
    /// What they are ranked by.
    pub figure: String,
    /// Sequences that all of them tracked.
    pub sequences: usize,
    /// Probability of mean ranks that lie at least as far apart by chance.
    pub p: f64,
    /// The trackers.
    pub trackers: Vec<Ranked>,
    /// Trackers with a worse figure that were not looked at.
    pub left_out: usize,
    /// All pairs of trackers.
    pub pairs: Vec<PairTest>,
    /// What to keep in mind.
    pub warnings: Vec<String>,
}

/// Ranks the trackers of all runs by the first figure of `options`, under each protocol the `top` with the best figure (0:
/// all), and tests all pairs. Two differ where the corrected p value is at most `options.fdr`.
///
/// # Errors
/// [`CompareError`]: runs of other data or thresholds; no two trackers, or no sequence that all have.
pub fn rank_all(runs: &[FinishedRun], top: usize, options: &Options) -> Result<Vec<Ranking>, CompareError> {
    let not_comparable = |why: String| CompareError::NotComparable(vec![why]);
    let Some((first, others)) = runs.split_first() else {
        return Ok(Vec::new());
    };
    let found: BTreeSet<String> = others.iter().flat_map(|run| obstacles(first, run)).collect();
    if !found.is_empty() {
        return Err(CompareError::NotComparable(found.into_iter().collect()));
    }
    let name = options.figures.first().map_or("auc", String::as_str);
    let figure = first
        .results
        .metrics
        .figure(name)
        .filter(|f| runs.iter().all(|run| run.has(f)));
    let figure = figure.ok_or_else(|| not_comparable(format!("not all runs have the figure {name}")))?;
    let mut by_protocol: BTreeMap<&str, Vec<Candidate<'_>>> = BTreeMap::new();
    for run in runs {
        for ((tracker, protocol), rows) in run.trackers() {
            let sequences = sides(&rows, figure, options);
            by_protocol.entry(protocol).or_default().push(Candidate {
                tracker,
                run: &run.name,
                sequences,
            });
        }
    }
    let rankings: Vec<Ranking> = by_protocol
        .into_iter()
        .filter(|(_, candidates)| candidates.len() > 1)
        .map(|(protocol, candidates)| rank(protocol, candidates, figure, top, options))
        .collect::<Result<_, _>>()?;
    if rankings.is_empty() {
        return Err(not_comparable("no two trackers under one protocol".to_owned()));
    }
    Ok(rankings)
}

/// A tracker of a run under a protocol, and its figure on each sequence.
struct Candidate<'a> {
    tracker: &'a str,
    run: &'a str,
    sequences: BTreeMap<(&'a str, &'a str), Side>,
}

/// The figure on each sequence where it is defined, over all start frames.
fn sides<'a>(
    rows: &[&'a SequenceRow],
    figure: &Figure,
    options: &Options,
) -> BTreeMap<(&'a str, &'a str), Side> {
    let mut by_sequence: BTreeMap<(&str, &str), Vec<&SequenceRow>> = BTreeMap::new();
    for row in rows {
        by_sequence
            .entry((&row.dataset, &row.sequence))
            .or_default()
            .push(row);
    }
    by_sequence
        .into_iter()
        .map(|(key, rows)| {
            (
                key,
                side(rows.iter().map(|row| &row.score), figure, options.average),
            )
        })
        .filter(|(_, side)| side.weight > 0.0)
        .collect()
}

fn rank(
    protocol: &str,
    mut candidates: Vec<Candidate<'_>>,
    figure: &Figure,
    top: usize,
    options: &Options,
) -> Result<Ranking, CompareError> {
    let all: BTreeSet<(&str, &str)> = candidates
        .iter()
        .flat_map(|c| c.sequences.keys().copied())
        .collect();
    let common: Vec<(&str, &str)> = all
        .iter()
        .filter(|key| candidates.iter().all(|c| c.sequences.contains_key(*key)))
        .copied()
        .collect();
    if common.is_empty() {
        let why = format!("no sequence that all trackers have under the protocol {protocol}");
        return Err(CompareError::NotComparable(vec![why]));
    }
    let over_all = |c: &Candidate<'_>| {
        let mut total = Side::default();
        common.iter().for_each(|key| total += c.sequences[key]);
        total.mean()
    };
    let better = |x: f64, y: f64| figure.better.order(x, y);
    candidates.sort_by(|x, y| {
        let by_name = (x.tracker, x.run).cmp(&(y.tracker, y.run));
        better(over_all(x), over_all(y)).then(by_name)
    });
    let kept = if top == 0 {
        candidates.len()
    } else {
        top.max(2).min(candidates.len())
    };
    let left_out = candidates.len() - kept;
    candidates.truncate(kept);

    let ranks: Vec<Vec<f64>> = common
        .iter()
        .map(|key| {
            let values: Vec<f64> = candidates.iter().map(|c| c.sequences[key].mean()).collect();
            places(&values, better)
        })
        .collect();
    let mean_rank =
        |j: usize| ranks.iter().map(|of_sequence| of_sequence[j]).sum::<f64>() / ranks.len() as f64;
    let mut order: Vec<usize> = (0..kept).collect();
    // Equal mean ranks stay in the order of the figure.
    order.sort_by(|&i, &j| mean_rank(i).total_cmp(&mean_rank(j)));

    let numbers: Vec<(usize, usize)> = (0..kept)
        .flat_map(|a| (a + 1..kept).map(move |b| (a, b)))
        .collect();
    let mut pairs: Vec<PairTest> = numbers
        .par_iter()
        .map(|&(a, b)| {
            let [x, y] = [a, b].map(|place| &candidates[order[place]].sequences);
            let pairs: Vec<Pair> = common.iter().map(|key| Pair { a: x[key], b: y[key] }).collect();
            // No interval is asked for.
            let (difference, p) =
                difference(&pairs, 0, options.seed).map_or((0.0, 1.0), |d| (d.b - d.a, d.p));
            PairTest {
                a,
                b,
                difference,
                p,
                p_holm: p,
            }
        })
        .collect();
    let corrected = holm(&pairs.iter().map(|pair| pair.p).collect::<Vec<_>>());
    pairs
        .iter_mut()
        .zip(corrected)
        .for_each(|(pair, p)| pair.p_holm = p);
    let differ: Vec<(usize, usize)> = pairs
        .iter()
        .filter(|pair| pair.p_holm <= options.fdr)
        .map(|pair| (pair.a, pair.b))
        .collect();
    let groups = letters(kept, &differ);
    let trackers = order.iter().zip(groups).map(|(&j, groups)| Ranked {
        tracker: candidates[j].tracker.to_owned(),
        run: candidates[j].run.to_owned(),
        mean_rank: mean_rank(j),
        value: over_all(&candidates[j]),
        groups,
    });
    Ok(Ranking {
        protocol: protocol.to_owned(),
        figure: figure.name.clone(),
        sequences: common.len(),
        p: chance_of_ranks(&ranks, options.seed),
        trackers: trackers.collect(),
        left_out,
        warnings: warnings(common.len(), all.len() - common.len(), pairs.len(), options),
        pairs,
    })
}

/// The place of each value, 1 the best; equal values share the mean of their places.
fn places(values: &[f64], better: impl Fn(f64, f64) -> std::cmp::Ordering) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&i, &j| better(values[i], values[j]));
    let mut places = vec![0.0; values.len()];
    let mut first = 0;
    for equal in order.chunk_by(|&i, &j| better(values[i], values[j]).is_eq()) {
        // Places first + 1 to first + n.
        let mean = first as f64 + (equal.len() + 1) as f64 / 2.0;
        equal.iter().for_each(|&i| places[i] = mean);
        first += equal.len();
    }
    places
}

/// Share of the orders within each sequence whose mean ranks lie at least as far apart.
fn chance_of_ranks(ranks: &[Vec<f64>], seed: u64) -> f64 {
    let k = ranks[0].len();
    let spread = |ranks: &[Vec<f64>]| -> f64 {
        let sum = |j: usize| ranks.iter().map(|of_sequence| of_sequence[j]).sum::<f64>();
        let mean = ranks.len() as f64 * (k + 1) as f64 / 2.0;
        (0..k).map(|j| (sum(j) - mean).powi(2)).sum()
    };
    // Sums of halves are exact.
    let observed = spread(ranks);
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut drawn = ranks.to_vec();
    let reached = (0..ORDERS).filter(|_| {
        drawn
            .iter_mut()
            .for_each(|of_sequence| of_sequence.shuffle(&mut rng));
        spread(&drawn) >= observed
    });
    (reached.count() + 1) as f64 / f64::from(ORDERS + 1)
}

/// Letters of each of `k` trackers: two share one if and only if they are no pair of `differ`. By insertion and absorption
/// (Piepho 2004): a group that holds both of a pair becomes one without the first and one without the second; groups
/// within others go.
fn letters(k: usize, differ: &[(usize, usize)]) -> Vec<String> {
    let mut groups: Vec<BTreeSet<usize>> = vec![(0..k).collect()];
    for &(a, b) in differ {
        let (both, mut kept): (Vec<_>, Vec<_>) =
            groups.into_iter().partition(|g| g.contains(&a) && g.contains(&b));
        let halves = both.into_iter().flat_map(|group| {
            [a, b].map(|gone| {
                let mut half = group.clone();
                half.remove(&gone);
                half
            })
        });
        for half in halves.collect::<Vec<_>>() {
            if !kept.iter().any(|group| group.is_superset(&half)) {
                kept.push(half);
            }
        }
        groups = kept;
    }
    groups.sort();
    let mut letters = vec![String::new(); k];
    for (number, group) in groups.iter().enumerate() {
        let name = match u8::try_from(number) {
            Ok(n @ 0..26) => char::from(b'a' + n).to_string(),
            Ok(n @ 26..52) => char::from(b'A' + n - 26).to_string(),
            _ => format!("({})", number + 1),
        };
        group.iter().for_each(|&member| letters[member] += &name);
    }
    letters
}

fn warnings(sequences: usize, left_out: usize, pairs: usize, options: &Options) -> Vec<String> {
    let mut warnings = Vec::new();
    let least = (2.0 / libm::exp2(sequences as f64) * pairs as f64).min(1.0);
    if least > options.fdr {
        warnings.push(format!(
            "over {sequences} sequences no corrected p value of {pairs} pairs is below {least:.3}, so no two trackers can \
             differ: take more sequences, or fewer trackers (--top)"
        ));
    }
    if left_out > 0 {
        warnings.push(format!(
            "{left_out} sequences that not all trackers have do not count"
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::super::tests::{TRACKERS, run};
    use super::*;

    #[test]
    fn equal_values_share_places() {
        let larger = |x: f64, y: f64| y.total_cmp(&x);
        assert_eq!(places(&[0.5, 0.9, 0.5, 0.1], larger), [2.5, 1.0, 2.5, 4.0]);
        assert_eq!(places(&[1.0, 1.0, 1.0], larger), [2.0; 3]);
    }

    #[test]
    fn trackers_share_a_letter_if_they_do_not_differ() {
        assert_eq!(letters(3, &[]), ["a", "a", "a"]);
        assert_eq!(letters(3, &[(0, 2)]), ["a", "ab", "b"]);
        assert_eq!(letters(3, &[(0, 1), (0, 2), (1, 2)]), ["a", "b", "c"]);
        let differ = [(0, 2), (0, 3), (0, 4), (1, 4), (2, 4), (1, 3)];
        let of = letters(5, &differ);
        for i in 0..5 {
            for j in i + 1..5 {
                let share = of[i].chars().any(|c| of[j].contains(c));
                assert_eq!(share, !differ.contains(&(i, j)), "{of:?} {i} {j}");
            }
        }
    }

    #[test]
    fn ranks_and_groups_over_twelve_sequences() {
        // The second is the best everywhere; the others take turns.
        let one = run("one", |t, s| match t {
            1 => 1.0,
            _ => 3.0 + ((t / 2 + s) % 2) as f64,
        });
        let options = Options::default();
        let found = rank_all(std::slice::from_ref(&one), 0, &options).unwrap();
        let [ranking] = found.as_slice() else {
            panic!("{found:?}")
        };
        assert_eq!(
            (ranking.sequences, ranking.trackers.len(), ranking.pairs.len()),
            (12, 3, 3)
        );
        let best = &ranking.trackers[0];
        assert_eq!(
            (best.tracker.as_str(), best.mean_rank, best.groups.as_str()),
            (TRACKERS[1], 1.0, "a")
        );
        assert!(
            ranking.trackers[1..]
                .iter()
                .all(|t| t.mean_rank == 2.5 && t.groups == "b"),
            "{ranking:?}"
        );
        // Exact p values of twelve sequences, thrice and twice.
        assert_eq!(ranking.pairs[0].p, 2.0 / 4096.0);
        assert_eq!(ranking.pairs[0].p_holm, 6.0 / 4096.0);
        assert_eq!(ranking.pairs[2].p_holm, 1.0);
        assert!(ranking.p < 0.001 && ranking.warnings.is_empty(), "{ranking:?}");
        // Of two runs, the two best.
        let two = run("two", |t, _| 1.5 + t as f64);
        let ranking = &rank_all(&[one, two], 2, &options).unwrap()[0];
        let of: Vec<(&str, &str)> = ranking
            .trackers
            .iter()
            .map(|t| (t.tracker.as_str(), t.run.as_str()))
            .collect();
        assert_eq!(of, [(TRACKERS[1], "one"), (TRACKERS[0], "two")]);
        assert_eq!(ranking.left_out, 4);
    }

    #[test]
    fn too_few_sequences_for_so_many_pairs_are_said() {
        let [warning] = &warnings(5, 0, 3, &Options::default())[..] else {
            panic!()
        };
        assert!(
            warning.contains("below 0.188") && warning.contains("more sequences"),
            "{warning}"
        );
        assert!(warnings(12, 0, 3, &Options::default()).is_empty());
    }
}
