use super::seek::Candidate;
use super::view::{Base, View};
use super::*;
use crate::image::Image;
use proptest::prelude::*;

const SIZE: (usize, usize) = (480, 360);

/// Waves and a few hundred soft dots: texture at every scale, key points included.
fn object(x: f64, y: f64) -> f64 {
    let cell = |v: f64| (v / 14.0).floor();
    let hash = |i: f64, j: f64, k: f64| libm::sin(i * 127.1 + j * 311.7 + k * 74.7) * 43758.5453;
    let unit = |v: f64| v - v.floor();
    let (i, j) = (cell(x), cell(y));
    let (cx, cy) = (
        14.0 * (i + 0.3 + 0.4 * unit(hash(i, j, 1.0))),
        14.0 * (j + 0.3 + 0.4 * unit(hash(i, j, 2.0))),
    );
    let r = ((x - cx).powi(2) + (y - cy).powi(2)).sqrt() / (2.0 + 3.0 * unit(hash(i, j, 3.0)));
    let dot = 130.0 * (unit(hash(i, j, 4.0)) - 0.5) / (1.0 + (r * r).powi(3));
    120.0 + 20.0 * libm::sin(0.05 * x + 0.02 * y) + 20.0 * libm::sin(0.06 * y - 0.03 * x + 1.0) + dot
}

fn quad() -> Corners {
    Corners::rect(150.0, 100.0, 160.0, 130.0)
}

/// The object moved by `m` before a plain background; `covered`: the left part of it is behind a striped sheet.
fn scene(m: &Mat3, covered: f64) -> Frame {
    let back = m.try_inverse().unwrap();
    Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, |x, y| {
        let [u, v] = homography::apply(&back, [x as f64, y as f64]);
        let (s, t) = ((u - 142.0) / 176.0, (v - 92.0) / 146.0);
        let stripes = 110.0 + 60.0 * libm::sin(0.31 * x as f64 + 0.9 * libm::sin(0.05 * y as f64));
        let value = if !(0.0..=1.0).contains(&s) || !(0.0..=1.0).contains(&t) {
            100.0 + 0.1 * x as f64
        } else if s < covered {
            stripes
        } else {
            object(u, v)
        };
        value as f32
    }))
}

fn motion(degrees: f64, zoom: f64, [dx, dy]: [f64; 2]) -> Mat3 {
    let (s, c) = libm::sincos(degrees.to_radians());
    let (cx, cy) = (230.0, 165.0);
    let turn = Mat3::new(
        zoom * c,
        -zoom * s,
        cx + dx,
        zoom * s,
        zoom * c,
        cy + dy,
        0.0,
        0.0,
        1.0,
    );
    turn * Mat3::new(1.0, 0.0, -cx, 0.0, 1.0, -cy, 0.0, 0.0, 1.0)
}

fn error(tracker: &Best, m: &Mat3) -> f64 {
    let truth = homography::apply_corners(m, &quad());
    (tracker.corners().distance_squared(&truth) / 4.0).sqrt()
}

fn started() -> Best {
    let mut tracker = Best::new(BestParams::default());
    tracker.init(&scene(&Mat3::identity(), 0.0), &quad()).unwrap();
    tracker
}

#[test]
fn the_score_is_one_at_alignment_and_falls_off() {
    let mut tracker = started();
    let frame = scene(&Mat3::identity(), 0.0);
    let mut last = 2.0;
    for (k, shift) in [0.0, 1.0, 2.0, 4.0, 8.0].into_iter().enumerate() {
        let pose = motion(0.0, 1.0, [shift, 0.0]) * tracker.pose;
        let score = tracker.aligner.assess(&frame, &pose, 1200);
        assert!(score.total < last, "{shift} {score:?}");
        assert!(k > 0 || score.total > 0.999, "{score:?}");
        last = score.total;
    }
    assert!(last < 0.2, "{last}");
    // Half of it covered: half the score, but what is seen agrees.
    let score = tracker
        .aligner
        .assess(&scene(&Mat3::identity(), 0.5), &tracker.pose.clone(), 1200);
    assert!(
        (0.35..0.65).contains(&score.total) && score.best > 0.95,
        "{score:?}"
    );
}

#[test]
fn it_follows_smooth_motion_to_hundredths_of_a_pixel() {
    let mut tracker = started();
    for t in 1..12 {
        let t = f64::from(t);
        let m = motion(4.0 * t, 1.0 + 0.02 * t, [9.0 * t, -3.0 * t]);
        let update = tracker.update(&scene(&m, 0.0)).unwrap();
        assert!(error(&tracker, &m) < 0.1, "{t} {}", error(&tracker, &m));
        assert!(update.similarity > 0.8, "{t} {update:?}");
    }
}

#[test]
fn it_recovers_after_a_jump_while_half_covered() {
    for (degrees, zoom, shift) in [
        (35.0, 1.25, [70.0, 40.0]),
        (-60.0, 0.8, [-60.0, 50.0]),
        (150.0, 1.0, [20.0, -30.0]),
    ] {
        let mut tracker = started();
        let m = motion(degrees, zoom, shift);
        tracker.update(&scene(&m, 0.45)).unwrap();
        assert!(error(&tracker, &m) < 0.5, "{degrees} {}", error(&tracker, &m));
    }
}

#[test]
fn a_scan_finds_the_object_wherever_it_is_though_half_covered() {
    for (degrees, zoom, shift, covered) in [
        (90.0, 1.0, [-70.0, 30.0], 0.0),
        (0.0, 1.6, [60.0, 40.0], 0.4),
        (180.0, 0.6, [120.0, 90.0], 0.4),
        // Part of it outside the image.
        (45.0, 1.0, [180.0, 60.0], 0.0),
    ] {
        let mut tracker = started();
        let m = motion(degrees, zoom, shift);
        let frame = scene(&m, covered);
        let looks = [(0.0, 0.0), (degrees + 5.0, zoom * 1.05), (degrees + 60.0, 1.0)];
        let mut found = Vec::new();
        for (turn, size) in looks {
            let pose = Best::turned(&tracker.aligner.upright(&frame), turn, size);
            tracker.scanner.scan(&frame, &pose, f64::INFINITY, &mut found);
        }
        let truth = homography::apply(&(m * tracker.pose), [0.0; 2]);
        let there = |f: &&Found| {
            let at = homography::apply(&f.pose, [0.0; 2]);
            (at[0] - truth[0]).hypot(at[1] - truth[1]) < 14.0
        };
        let best = found.iter().find(there);
        assert!(best.is_some_and(|f| f.contrast > 3.0), "{degrees} {found:?}");
    }
    let mut tracker = started();
    let pose = tracker.pose;
    let mut found = Vec::new();
    let flat = Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, |_, _| 80.0));
    tracker.scanner.scan(&flat, &pose, 50.0, &mut found);
    let nan = Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, |_, _| f32::NAN));
    tracker.scanner.scan(&nan, &pose, 50.0, &mut found);
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn it_stays_where_it_was_when_there_is_nothing_and_finds_the_object_again() {
    let mut tracker = started();
    let empty = Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, |x, y| {
        (x % 7 * y % 5) as f32 * 9.0
    }));
    for _ in 0..3 {
        let update = tracker.update(&empty).unwrap();
        assert!(update.similarity < 0.3, "{update:?}");
        assert!(error(&tracker, &Mat3::identity()) < 1e-9);
    }
    let m = motion(80.0, 1.1, [90.0, 20.0]);
    tracker.update(&scene(&m, 0.0)).unwrap();
    assert!(error(&tracker, &m) < 0.1, "{}", error(&tracker, &m));
}

#[test]
fn bad_starts_are_refused() {
    let mut tracker = Best::new(BestParams::default());
    let frame = scene(&Mat3::identity(), 0.0);
    assert_eq!(tracker.update(&frame).unwrap_err(), TrackError::NotInitialised);
    assert_eq!(tracker.set_region(&quad()), Err(TrackError::NotInitialised));
    let flat = Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, |_, _| 80.0));
    assert!(matches!(
        tracker.init(&flat, &quad()),
        Err(TrackError::Template(_))
    ));
    let crossed = Corners([[10.0, 10.0], [90.0, 90.0], [90.0, 10.0], [10.0, 90.0]]);
    assert!(matches!(
        tracker.init(&frame, &crossed),
        Err(TrackError::BadRegion(_))
    ));
    let nan = Corners::rect(f64::NAN, 0.0, 10.0, 10.0);
    assert!(matches!(
        tracker.init(&frame, &nan),
        Err(TrackError::NotFinite(_))
    ));
}

#[test]
fn blocks_partition_a_views_points_and_know_their_neighbours() {
    let corners = Corners([[140.0, 90.0], [300.0, 110.0], [310.0, 240.0], [130.0, 220.0]]);
    let base = Base::of(&corners);
    let frame = scene(&Mat3::identity(), 0.0);
    for level in 0..3 {
        let view = View::new(&frame, &corners, &base, level, 3600).unwrap();
        assert!((200..=3600).contains(&view.len()), "{}", view.len());
        assert_eq!(*view.ends.last().unwrap(), view.len());
        let counts = view.blocks.iter().map(|b| b.count as usize);
        assert_eq!(counts.sum::<usize>(), view.len());
        for (k, block) in view.blocks.iter().enumerate() {
            assert!(block.centre.iter().all(|v| v.abs() < 1.5), "{block:?}");
            let beside = view.beside(k);
            assert!((1..=4).contains(&beside.len()), "{beside:?}");
            assert!(beside.iter().all(|&b| view.beside(b).contains(&k)));
        }
    }
    assert!(View::new(&frame, &Corners::rect(50.0, 50.0, 6.0, 6.0), &base, 0, 3600).is_none());
}

#[test]
fn poses_that_cannot_be_are_not_sound() {
    let tracker = started();
    let frame = scene(&Mat3::identity(), 0.0);
    let sound = |m: Mat3| tracker.aligner.sound(&(m * tracker.pose), &frame);
    assert!(sound(Mat3::identity()) && sound(motion(170.0, 2.0, [40.0, 0.0])));
    // Mirrored, too small, outside, partly behind the camera, no number.
    assert!(!sound(Mat3::new(-1.0, 0.0, 460.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)));
    assert!(!sound(motion(0.0, 0.1, [0.0; 2])));
    assert!(!sound(motion(0.0, 1.0, [900.0, 0.0])));
    let behind = Mat3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.3, 0.0, 1.0);
    assert!(!tracker.aligner.sound(&(tracker.pose * behind), &frame));
    assert!(!sound(Mat3::identity() * f64::NAN));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn alignment_undoes_small_warps_whatever_the_light(d in prop::array::uniform8(-5.0f64..5.0), gain in 0.6f64..1.5, bias in -20.0f64..20.0) {
        let mut tracker = started();
        let scene = scene(&Mat3::identity(), 0.0);
        let lit = scene.level(0, 1).gray();
        let light = |x: usize, y: usize| (gain * f64::from(lit.get(0, x, y)) + bias) as f32;
        let frame = Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, light));
        let corners = std::array::from_fn(|k| [quad().0[k][0] + d[2 * k], quad().0[k][1] + d[2 * k + 1]]);
        let start = tracker.aligner.pose_at(&Corners(corners)).unwrap();
        let (pose, score, _) = tracker.aligner.align(&frame, &start, 1200).unwrap();
        let error = (tracker.aligner.corners(&pose).distance_squared(&quad()) / 4.0).sqrt();
        prop_assert!(error < 0.02 && score.total > 0.99, "{} {:?}", error, score);
    }
}

/// A score whose parts are all beyond doubt.
const CLEAR: Score = Score {
    total: 0.9,
    best: 0.96,
    agree: 0.9,
    agreeing: 40,
};

#[test]
fn each_limit_of_what_has_been_found_decides_alone() {
    let mut tracker = started();
    tracker.usual = (0.8, 0.95);
    let pose = tracker.pose;
    const A: f64 = 1e-6;
    // On both sides of each limit, with everything else beyond doubt.
    let check = |tracker: &Best, near: bool, below: Score, from: Score, what: &str| {
        let found = |score| tracker.found(&Candidate { pose, score, near });
        assert_eq!((found(below), found(from)), (false, true), "{what}");
    };
    let with_best = |best| Score { best, ..CLEAR };
    let with_total = |total, best| Score { total, best, ..CLEAR };
    for near in [true, false] {
        let agreeing = |agreeing| Score { agreeing, ..CLEAR };
        let (few, enough) = (agreeing(K.agreeing_blocks - 1), agreeing(K.agreeing_blocks));
        check(&tracker, near, few, enough, "number of blocks");
        let agree = |agree| Score { agree, ..CLEAR };
        let (few, enough) = (agree(K.agreeing_share - A), agree(K.agreeing_share));
        check(&tracker, near, few, enough, "share of blocks");
    }
    // Followed from frame to frame, the correlation alone.
    let part = |ratio: f64| (with_best(ratio * 0.95 - A), with_best(ratio * 0.95 + A));
    let (below, from) = part(K.found_part);
    check(&tracker, true, below, from, "correlation");
    let found = |score| {
        tracker.found(&Candidate {
            pose,
            score,
            near: true,
        })
    };
    assert!(found(with_total(0.0, 0.7)));
    // Elsewhere it must agree better, and all in all: a little less where what is seen is certain.
    let (below, from) = part(K.again_part);
    check(&tracker, false, below, from, "correlation elsewhere");
    let total = |total| with_total(total, K.covered_best - A);
    let (below, from) = (total(K.elsewhere_total - A), total(K.elsewhere_total));
    check(&tracker, false, below, from, "total elsewhere");
    let total = |total| with_total(total, K.covered_best);
    let (below, from) = (total(K.again_total - A), total(K.again_total));
    check(&tracker, false, below, from, "total elsewhere, mostly covered");
    // So after it was lost, and after several poor frames.
    for (lost, doubtful) in [(1, 0), (0, K.doubtful_frames)] {
        (tracker.lost, tracker.doubtful) = (lost, doubtful);
        let (below, from) = part(K.again_part);
        check(&tracker, true, below, from, "correlation again");
        let total = |total| with_total(total, 0.9);
        let (below, from) = (total(K.again_total - A), total(K.again_total));
        check(&tracker, true, below, from, "total again");
    }
    // Whatever is usual, the user's limit holds.
    tracker.usual = (0.8, 0.1);
    let limit = tracker.params.best_found;
    (tracker.lost, tracker.doubtful) = (0, 0);
    check(
        &tracker,
        true,
        with_best(limit - A),
        with_best(limit),
        "the user's limit",
    );
}

#[test]
fn a_candidate_replaces_another_when_it_is_better_by_a_margin() {
    let mut tracker = started();
    tracker.usual = (0.8, 0.95);
    let pose = tracker.pose;
    let candidate = |total: f64, best: f64, near: bool| Candidate {
        pose,
        score: Score { total, best, ..CLEAR },
        near,
    };
    let replaces = |new: Candidate, old: Candidate| {
        let mut best = Some(old);
        tracker.offer(new, &mut best);
        best.unwrap().score == new.score
    };
    let old = candidate(0.6, 0.96, true);
    assert!(!replaces(candidate(0.6 + K.near_margin - 1e-6, 0.95, true), old));
    assert!(replaces(candidate(0.6 + K.near_margin + 1e-6, 0.95, true), old));
    assert!(!replaces(candidate(0.6 + K.far_margin - 1e-6, 0.95, false), old));
    assert!(replaces(candidate(0.6 + K.far_margin + 1e-6, 0.95, false), old));
    // One that has been found replaces one that has not, and never the other way round.
    let none = candidate(0.9, 0.2, true);
    assert!(replaces(old, none) && !replaces(none, old));
    let mut best = None;
    tracker.offer(none, &mut best);
    assert!(best.is_some());
}

#[test]
fn coarse_alignment_never_ends_with_a_lower_score_than_it_began() {
    let mut tracker = started();
    let mut tried = 0;
    for covered in [0.0, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9] {
        let frame = scene(&Mat3::identity(), covered);
        for k in 0..24 {
            // From the very place, where there is nothing to gain, to far from it.
            let far = (f64::from(k) / 8.0).floor();
            let (c, s) = (libm::cos(f64::from(k)), libm::sin(f64::from(k)));
            let m = motion(
                4.0 * far * s,
                1.0 + 0.02 * far * c,
                [3.0 * far * c, 3.0 * far * s],
            );
            let start = m * tracker.pose;
            let before = tracker.aligner.assess(&frame, &start, 1200);
            let Some((pose, score, _)) = tracker.aligner.coarse(&frame, &start, 1200, K.coarse_steps) else {
                continue;
            };
            assert!(score.total >= before.total, "{covered} {k}: {before:?} {score:?}");
            assert_eq!(score, tracker.aligner.assess(&frame, &pose, 1200));
            tried += 1;
        }
    }
    assert!(tried > 150, "{tried}");
}

#[test]
fn fine_alignment_keeps_only_what_costs_little_of_the_score() {
    let mut tracker = started();
    let scene = scene(&Mat3::identity(), 0.0);
    let still = scene.gray();
    let mut stopped = 0;
    for noise in [0.0, 60.0, 120.0] {
        // Noise of single pixels, which coarse levels do not see.
        let value = |x: usize, y: usize| {
            let hash = libm::sin(x as f64 * 127.1 + y as f64 * 311.7) * 43758.5453;
            still.get(0, x, y) + (noise * (hash - hash.floor() - 0.5)) as f32
        };
        let frame = Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, value));
        for k in 0..6 {
            let shift = 0.4 * f64::from(k);
            let mut pose = motion(0.0, 1.0, [shift, -shift]) * tracker.pose;
            let mut score = tracker.aligner.assess(&frame, &pose, 1200);
            let (before, start) = (score, pose);
            let mut iterations = 0;
            // No step: where fine alignment begins from.
            tracker.aligner.coarse(&frame, &start, 1200, 0).unwrap();
            tracker
                .aligner
                .fine(&frame, (&mut pose, &mut score, &mut iterations), 1200);
            assert!(
                score.total >= before.total - 2.0 * K.finer_loss,
                "{noise} {k}: {before:?} {score:?}"
            );
            assert_eq!(score, tracker.aligner.assess(&frame, &pose, 1200));
            stopped += usize::from(iterations > 0 && pose == start);
        }
    }
    assert!(stopped > 0);
}
