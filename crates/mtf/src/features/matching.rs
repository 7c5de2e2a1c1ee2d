//! Matches of descriptors, and votes for the rotation and scale that most of them share.

use super::extract::{KeyPoint, SCALES};
use super::pattern::TURNS;
use crate::interrupt;
use crate::kernels::{self, Bits};

crate::params! {
    /// Parameters of matching.
    pub struct MatchParams {
        /// Largest ratio of the distance of the best match to that of the best one elsewhere; 1: no such test.
        feat_ratio: f64 = 0.85, in 0.1..=1.0;
        /// Largest distance of a match, bits of 256.
        feat_distance: u32 = 80, in 1..=256;
    }
}

/// Two key points that look alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Match {
    /// Index among the first points.
    pub first: usize,
    /// Index among the second points.
    pub second: usize,
    /// Bits that differ.
    pub distance: u32,
}

/// Rotation bins of the vote: each four turns.
const ROTATIONS: usize = 16;
const TURNS_PER_BIN: usize = TURNS / ROTATIONS;
/// Scale bins of the vote: every difference of scales.
const RATIOS: usize = 2 * SCALES - 1;
/// Matches within this many bins of the winner are kept.
const REACH: [usize; 2] = [2, 2];

/// Matches descriptors; owns its scratch and its results.
#[derive(Clone, Debug, Default)]
pub struct Matcher {
    distances: Vec<u32>,
    matches: Vec<Match>,
    votes: Vec<u32>,
}

impl Matcher {
    /// Matches of the last call.
    pub fn matches(&self) -> &[Match] {
        &self.matches
    }

    /// For each first descriptor the nearest second one, if it is near enough and much nearer than the nearest one
    /// at another place: more than `apart` pixels of its own scale away.
    pub fn find(
        &mut self,
        params: &MatchParams,
        first: &[Bits],
        (points, second): (&[KeyPoint], &[Bits]),
        apart: f32,
    ) {
        self.matches.clear();
        self.distances.resize(second.len(), 0);
        for (i, query) in first.iter().enumerate() {
            if interrupt::requested() {
                return;
            }
            kernels::hamming_distances(query, second, &mut self.distances);
            let Some((best, &distance)) = self.distances.iter().enumerate().min_by_key(|d| d.1) else {
                return;
            };
            if distance > params.feat_distance {
                continue;
            }
            let limit = f64::from(distance) / params.feat_ratio;
            let reach = apart * scale_factor(points[best].scale);
            let [x, y] = points[best].at;
            let rival = |(d, p): (&u32, &KeyPoint)| {
                f64::from(*d) < limit && (p.at[0] - x).powi(2) + (p.at[1] - y).powi(2) > reach * reach
            };
            if params.feat_ratio >= 1.0 || !self.distances.iter().zip(points).any(rival) {
                self.matches.push(Match {
                    first: i,
                    second: best,
                    distance,
                });
            }
        }
    }

    /// Keeps the matches whose change of rotation and scale is near the most frequent one.
    pub fn vote(&mut self, first: &[KeyPoint], second: &[KeyPoint]) {
        let bins = |m: &Match| change(&first[m.first], &second[m.second]);
        self.votes.clear();
        self.votes.resize(ROTATIONS * RATIOS, 0);
        for m in &self.matches {
            let (rotation, ratio) = bins(m);
            // Each votes for its bin twice and for the neighbours once, so that a peak between bins is one.
            for (turned, weight) in [(ROTATIONS - 1, 1), (0, 2), (1, 1)] {
                for scaled in ratio.saturating_sub(1)..=(ratio + 1).min(RATIOS - 1) {
                    let weight = if scaled == ratio { 2 * weight } else { weight };
                    self.votes[(rotation + turned) % ROTATIONS * RATIOS + scaled] += weight;
                }
            }
        }
        let best = (0..self.votes.len()).max_by_key(|&i| (self.votes[i], self.votes.len() - i));
        let Some(best) = best else { return };
        let (rotation, ratio) = (best / RATIOS, best % RATIOS);
        self.matches.retain(|m| {
            let (r, s) = bins(m);
            let turned = (r + ROTATIONS - rotation) % ROTATIONS;
            turned.min(ROTATIONS - turned) <= REACH[0] && s.abs_diff(ratio) <= REACH[1]
        });
    }
}

/// Bins of the rotation and of the ratio of scales from one point to another.
fn change(a: &KeyPoint, b: &KeyPoint) -> (usize, usize) {
    let turned = (usize::from(b.turn) + TURNS - usize::from(a.turn) + TURNS_PER_BIN / 2) % TURNS;
    (
        turned / TURNS_PER_BIN,
        usize::from(b.scale) + SCALES - 1 - usize::from(a.scale),
    )
}

/// Pixels of the frame per pixel at a scale.
pub fn scale_factor(scale: u8) -> f32 {
    const THIRDS: [f32; 3] = [1.0, 1.259_921, 1.587_401];
    f32::from(1u8 << (scale / 3)) * THIRDS[usize::from(scale % 3)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn point(x: f32, scale: u8, turn: u8) -> KeyPoint {
        KeyPoint {
            at: [x, 0.0],
            scale,
            turn,
        }
    }

    fn flipped(bits: &Bits, n: usize) -> Bits {
        let mut out = *bits;
        for k in 0..n {
            out[k % 4] ^= 1 << (k / 4 * 3);
        }
        out
    }

    #[test]
    fn distinct_nearest_neighbours_match() {
        let mut rng = Pcg64::seed_from_u64(3);
        let first: Vec<Bits> = (0..50).map(|_| std::array::from_fn(|_| rng.random())).collect();
        let mut second: Vec<Bits> = first.iter().rev().map(|b| flipped(b, 20)).collect();
        let mut points: Vec<KeyPoint> = (0..50).map(|i| point(20.0 * i as f32, 0, 0)).collect();
        let mut m = Matcher::default();
        m.find(&MatchParams::default(), &first, (&points, &second), 5.0);
        assert_eq!(m.matches().len(), 50);
        assert!(
            m.matches()
                .iter()
                .all(|m| m.second == 49 - m.first && m.distance == 20)
        );
        // A rival at another place, and one at the same place.
        second.push(flipped(&first[0], 22));
        second.push(flipped(&first[1], 22));
        points.push(point(5000.0, 0, 0));
        points.push(point(20.0 * 48.0 + 3.0, 0, 0));
        m.find(&MatchParams::default(), &first, (&points, &second), 5.0);
        assert_eq!(m.matches().len(), 49);
        assert!(m.matches().iter().all(|m| m.first != 0));
        m.find(&MatchParams::default(), &first, (&[], &[]), 5.0);
        assert!(m.matches().is_empty());
    }

    #[test]
    fn the_common_rotation_and_scale_wins() {
        let mut rng = Pcg64::seed_from_u64(5);
        let mut any = |n| rng.random_range(0..n) as u8;
        let first: Vec<KeyPoint> = (0..200).map(|i| point(i as f32, any(5), any(64))).collect();
        let second: Vec<KeyPoint> = (0..200)
            .map(|i| {
                if i % 4 == 0 {
                    point(0.0, first[i].scale + 2, (first[i].turn + 16 + any(3)) % 64)
                } else {
                    point(0.0, any(8), any(64))
                }
            })
            .collect();
        let matches = (0..200).map(|i| Match {
            first: i,
            second: i,
            distance: 0,
        });
        let mut m = Matcher {
            matches: matches.collect(),
            ..Matcher::default()
        };
        m.vote(&first, &second);
        let good = m.matches().iter().filter(|m| m.first % 4 == 0).count();
        assert_eq!(good, 50);
        assert!(m.matches().len() < 110, "{}", m.matches().len());
        m.matches.clear();
        m.vote(&first, &second);
    }

    /// Prints the time of 500 x 800: `cargo test --release -- --ignored --nocapture matching`.
    #[test]
    #[ignore = "prints a time"]
    fn time_of_500_by_800() {
        let mut rng = Pcg64::seed_from_u64(3);
        let mut bits =
            |n: usize| -> Vec<Bits> { (0..n).map(|_| std::array::from_fn(|_| rng.random())).collect() };
        let (first, second) = (bits(500), bits(800));
        let points: Vec<KeyPoint> = (0..800).map(|i| point(20.0 * i as f32, 0, 0)).collect();
        let mut m = Matcher::default();
        let params = MatchParams {
            feat_distance: 256,
            ..MatchParams::default()
        };
        let times = (0..50).map(|_| {
            let start = std::time::Instant::now();
            m.find(&params, &first, (&points, &second), 5.0);
            start.elapsed()
        });
        println!("{:?}", times.min());
    }
}
