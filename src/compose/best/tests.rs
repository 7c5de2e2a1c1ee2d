use super::*;
use crate::image::Image;

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
