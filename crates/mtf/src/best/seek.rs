//! Where the object may be in a frame: candidates from motion, flow, searches and key points, each aligned and judged.

use super::Best;
use super::align::Score;
use super::constants::K;
use crate::consensus::Homographies;
use crate::geom::{Mat3, homography};
use crate::image::Frame;
use crate::interrupt;
use crate::tracker::Tracker;

/// A pose with its score.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub pose: Mat3,
    pub score: Score,
    /// Whether it is near where the object was expected, or stands out so much that it might as well be.
    pub near: bool,
}

impl Best {
    /// Aligns from a start, with the motion blur that is expected and, until it is known which is right, without, and keeps
    /// the result when it is the best.
    fn attempt(&mut self, frame: &Frame, start: &Mat3, best: &mut Option<Candidate>) {
        let exposure = self.aligner.smear.exposure;
        if self.blurred == Some(false) {
            self.aligner.smear.exposure = 0.0;
        }
        let expected = self.aligned(frame, start);
        let mut sharp = None;
        if exposure > 0.0 && self.blurred.is_none() && expected.is_none_or(|b| b.1.total < K.clear_total) {
            self.aligner.smear.exposure = 0.0;
            sharp = self.aligned(frame, start);
        }
        self.aligner.smear.exposure = exposure;
        let clearer = |b: &(Mat3, Score)| sharp.is_none_or(|s| b.1.total > s.1.total + K.blurred_margin);
        let blurred = expected.filter(clearer);
        let Some((pose, score)) = blurred.or(sharp) else {
            return;
        };
        let new = self.candidate(pose, score);
        if sharp.is_some() && self.found(&new) {
            self.blurred = Some(blurred.is_some());
        }
        self.offer(new, best);
    }

    fn aligned(&mut self, frame: &Frame, start: &Mat3) -> Option<(Mat3, Score)> {
        let (pose, score, iterations) = self.aligner.align(frame, start, self.params.best_judge)?;
        self.iterations += iterations;
        Some((pose, score))
    }

    /// A pose with its score, which may be near where the object was expected.
    fn candidate(&self, pose: Mat3, score: Score) -> Candidate {
        let (to, from) = (self.aligner.corners(&pose), self.aligner.corners(&self.expected));
        let far = (to.distance_squared(&from) / 4.0).sqrt();
        let near = far <= K.near_distance * from.signed_area().abs().sqrt();
        Candidate { pose, score, near }
    }

    /// Keeps a candidate when it is the best.
    pub(super) fn offer(&self, new: Candidate, best: &mut Option<Candidate>) {
        let better = |b: &Candidate| {
            let found = (self.found(&new), self.found(b));
            if found.0 == found.1 {
                let margin = if new.near { K.near_margin } else { K.far_margin };
                new.score.total > b.score.total + margin
            } else {
                found.0
            }
        };
        if best.as_ref().is_none_or(better) {
            *best = Some(new);
        }
    }

    /// The pose that flow from the last frame leads to, searched from `guess`; whether it is to be believed on its own.
    fn flow(&mut self, frame: &Frame, guess: &Mat3) -> Option<(Mat3, bool)> {
        let previous = self.previous.take()?;
        self.from.clear();
        self.to.clear();
        for x in &self.nodes {
            let (a, b) = (homography::apply(&self.pose, *x), homography::apply(guess, *x));
            let found = self.klt.track_point(&previous, frame, a, b);
            if found.ok() {
                self.from.push(*x);
                self.to.push(found.at);
            }
        }
        self.previous = Some(previous);
        if self.from.len() < K.flow_points {
            return None;
        }
        let pose = self
            .estimator
            .estimate(&Homographies, &self.from, &self.to)
            .ok()?;
        let agreed = self.estimator.inliers().iter().filter(|i| **i).count();
        let sure = agreed >= K.flow_points && agreed as f64 >= K.flow_share * self.nodes.len() as f64;
        Some((pose / pose[(2, 2)], sure && self.aligner.sound(&pose, frame)))
    }

    /// Turns and scales a pose about the object's centre.
    pub(super) fn turned(pose: &Mat3, degrees: f64, zoom: f64) -> Mat3 {
        let (s, c) = libm::sincos(degrees.to_radians());
        pose * Mat3::new(zoom * c, -zoom * s, 0.0, zoom * s, zoom * c, 0.0, 0.0, 0.0, 1.0)
    }

    /// Scans for each of some poses, and aligns from the best places. Interrupted, it leaves out the rest.
    fn sweep(
        &mut self,
        frame: &Frame,
        poses: impl IntoIterator<Item = Mat3>,
        reach: f64,
        kept: (usize, usize, usize),
        best: &mut Option<Candidate>,
    ) {
        let mut found = std::mem::take(&mut self.places);
        found.clear();
        for pose in poses {
            if self.aligner.sound(&pose, frame) && !interrupt::requested() {
                self.scanner.scan(frame, &pose, reach, &mut found);
            }
        }
        found.sort_unstable_by(|a, b| b.contrast.total_cmp(&a.contrast));
        found.truncate(kept.0);
        let judge = self.params.best_judge;
        let mut coarse = std::mem::take(&mut self.coarse);
        coarse.clear();
        coarse.extend(
            found
                .iter()
                .map(|place| (place.pose, Score::default(), place.contrast)),
        );
        for (points, most, most_steps) in [
            (K.glance_points, kept.1, K.glance_steps),
            (judge, kept.2, K.place_steps),
        ] {
            for (pose, score, _) in &mut coarse {
                if interrupt::requested() {
                    break;
                }
                let aligned = self.aligner.coarse(frame, pose, points, most_steps);
                let (next, reached, n) = aligned.unwrap_or((*pose, Score::default(), 0));
                (*pose, *score) = (next, reached);
                self.iterations += n;
            }
            coarse.sort_unstable_by(|a, b| b.1.total.total_cmp(&a.1.total));
            coarse.truncate(most);
        }
        for (start, _, contrast) in &coarse {
            if !interrupt::requested()
                && let Some((pose, score)) = self.aligned(frame, start)
                && self.aligner.ordinary(&pose)
            {
                let mut new = self.candidate(pose, score);
                new.near |= *contrast >= K.stands_out;
                self.offer(new, best);
            }
        }
        self.places = found;
        self.coarse = coarse;
    }

    /// The pose at which the key points say the object is: near the last one, or anywhere.
    fn key_points(&mut self, frame: &Frame, near: &Mat3) -> Option<Mat3> {
        if !self.has_features {
            return None;
        }
        let corners = if self.lost == 0 {
            self.features.set_region(&self.aligner.corners(near)).ok()?;
            self.features.update(frame).ok()?.corners
        } else {
            self.features.detect(frame).ok()?.corners
        };
        self.aligner.pose_at(&corners)
    }

    /// The best pose in a frame, and that of flow where it may be believed.
    pub(super) fn locate(&mut self, frame: &Frame) -> (Option<Candidate>, Option<Mat3>) {
        let enough = self.params.best_enough * self.usual.0;
        let certain = K.certain_part * self.usual.1;
        let judge = self.params.best_judge;
        let hold = self.pose;
        let ahead = self.motion * hold;
        let moving = self.lost == 0
            && self.aligner.assess(frame, &ahead, judge).total
                > self.aligner.assess(frame, &hold, judge).total;
        let first = if moving { ahead } else { hold };
        self.expected = first;
        self.blurred = None;
        let mut best = None;
        let mut coast = None;
        let good = |this: &Self, best: &Option<Candidate>, total: f64, part: f64| {
            best.as_ref().is_some_and(|b| {
                this.found(b) && b.score.total >= total.max(K.sure_total) && b.score.best >= part
            })
        };
        self.attempt(frame, &first, &mut best);
        if good(self, &best, enough, 0.0) {
            return (best, None);
        }
        if let Some((pose, sure)) = self.flow(frame, &first) {
            coast = sure.then_some(pose);
            self.attempt(frame, &pose, &mut best);
        }
        if good(self, &best, enough, 0.0) {
            return (best, None);
        }
        let reach = self.params.best_reach;
        let kept = (K.kept_glanced, K.kept_judged, K.kept_aligned);
        let nearest = (K.near_places, K.near_places, K.near_places);
        self.sweep(frame, [first], reach, nearest, &mut best);
        // What covers the object does so little by little; when much of it disagrees at once, the pose is wrong.
        let sudden = self.params.best_enough * self.usual.0.min(self.last);
        if good(self, &best, sudden, certain) {
            return (best, coast);
        }
        // All of this in the first frame, then by turns, more often while there is nothing to go by.
        let held = best.as_ref().is_some_and(|b| self.found(b));
        let turn = self.unsure % if held { K.held_cycle } else { K.lost_cycle };
        let (around, keys, all) = if self.unsure == 0 {
            (true, true, true)
        } else if held {
            (turn == 0, turn == 2, turn == 4)
        } else {
            (turn == 0 || self.unsure < K.fresh, turn == 2, turn % 2 == 1)
        };
        if around {
            let (a, b, c) = (K.turn_small, K.turn_middle, K.turn_large);
            let turns = [0.0, -a, a, -b, b, -c, c];
            let zooms = [1.0, K.zoom_out, K.zoom_in];
            let poses = (0..turns.len() * zooms.len())
                .map(|i| Self::turned(&first, turns[i / zooms.len()], zooms[i % zooms.len()]));
            self.sweep(frame, poses, K.farther * reach, kept, &mut best);
            if good(self, &best, 0.0, certain) {
                return (best, coast);
            }
        }
        // How it has moved to wherever it may be is not known.
        self.aligner.smear.back = None;
        if keys
            && let Some(pose) = self.key_points(frame, &first)
            && self.aligner.ordinary(&pose)
        {
            self.attempt(frame, &pose, &mut best);
        }
        if all && !good(self, &best, 0.0, 0.0) {
            // It may be anywhere, and look like anything: a part of all this at a time.
            let upright = self.aligner.upright(frame);
            let shift = self.scans * K.whole_share;
            let sizes = [
                1.0,
                K.size_smaller,
                K.size_larger,
                K.size_smallest,
                K.size_largest,
            ];
            self.scans += 1;
            let every = |i: usize| {
                let i = (shift + i) * K.whole_stride % (K.whole_turns * sizes.len());
                Self::turned(
                    &upright,
                    360.0 / K.whole_turns as f64 * (i % K.whole_turns) as f64,
                    sizes[i / K.whole_turns],
                )
            };
            self.sweep(
                frame,
                (0..K.whole_share).map(every),
                f64::INFINITY,
                kept,
                &mut best,
            );
        }
        (best, coast)
    }
}
