//! Grids of points and of trackers, straight lines and key points, on scenes made of the textures the crate draws.

use mtf::compose::{FlowGrid, Grid, GridReset, LineParams, LineTracker, NodeParams, PatchParams};
use mtf::consensus::{EstimateMethod, EstimatorParams};
use mtf::features::{FeatureParams, FeatureTracker, MatchParams};
use mtf::flow::KltParams;
use mtf::geom::{Corners, Mat3, homography};
use mtf::image::{Frame, Image};
use mtf::params::Resolution;
use mtf::registry::{Registry, SpecError};
use mtf_eval::prelude::*;
use mtf_eval::synth::texture;

crate::tests! {
    every_composite_follows_a_plane;
    pyramids_that_widen_take_small_patches_far;
    guards_find_again_and_put_back;
    leaders_are_asked_where_the_template_does_not_suffice;
    a_template_leaves_out_what_its_leader_finds_covered;
    members_that_share_their_models_are_checked;
    little_effort_is_for_little_motion;
    patches_that_fail_the_way_back_stay_out;
    points_under_an_occluder_are_rejected;
    composites_say_when_they_are_lost_and_go_on;
    low_warps_fit_what_they_can;
    features_find_an_object_that_jumped_turned_grew_and_is_half_covered;
}

/// A texture as gray values, sampled bilinearly, mirrored at its borders.
struct Sheet(image::RgbImage);

impl Sheet {
    fn new(name: &str) -> Self {
        Sheet(texture::find(name).unwrap().draw(7))
    }
    fn at(&self, x: f64, y: f64) -> f64 {
        let gray = |x: i64, y: i64| {
            let mirrored = |v: i64, n: u32| {
                let v = v.rem_euclid(2 * i64::from(n));
                v.min(2 * i64::from(n) - 1 - v) as u32
            };
            let p = self
                .0
                .get_pixel(mirrored(x, self.0.width()), mirrored(y, self.0.height()))
                .0;
            0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2])
        };
        let (lx, ly) = (x.floor(), y.floor());
        let (dx, dy, i, j) = (x - lx, y - ly, lx as i64, ly as i64);
        (1.0 - dy) * ((1.0 - dx) * gray(i, j) + dx * gray(i + 1, j))
            + dy * ((1.0 - dx) * gray(i, j + 1) + dx * gray(i + 1, j + 1))
    }
}

/// A board of 200 x 150 px before a background, and something that may cover part of both.
struct Scene {
    board: Sheet,
    background: Sheet,
    cover: Sheet,
    /// The board goes on beyond its edges, and there is no background.
    endless: bool,
}

const BOARD: [f64; 2] = [200.0, 150.0];
const SIZE: [usize; 2] = [480, 360];

impl Scene {
    fn new(endless: bool) -> Self {
        Scene {
            endless,
            board: Sheet::new("painting"),
            background: Sheet::new("rock"),
            cover: Sheet::new("foliage"),
        }
    }

    /// The board under `m` (board to image); `covered` says which places of the board, or of the image, are hidden.
    fn frame(&self, m: &Mat3, covered: impl Fn([f64; 2], [f64; 2]) -> bool) -> Frame {
        let back = m.try_inverse().unwrap();
        Frame::from_gray(Image::from_fn(SIZE[0], SIZE[1], |x, y| {
            let mut sum = 0.0;
            for (i, j) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                let p = [x as f64 + i, y as f64 + j];
                let o = homography::apply(&back, p);
                let inside = self.endless || (0..2).all(|c| o[c] >= 0.0 && o[c] <= BOARD[c]);
                sum += if covered(o, p) {
                    self.cover.at(p[0] + 37.0, p[1])
                } else if inside {
                    self.board.at(1.6 * o[0] + 60.0, 1.6 * o[1] + 80.0)
                } else {
                    self.background.at(p[0], p[1])
                };
            }
            (sum / 4.0) as f32
        }))
    }

    fn plain(&self, m: &Mat3) -> Frame {
        self.frame(m, |_, _| false)
    }
}

fn corners(m: &Mat3) -> Corners {
    homography::apply_corners(m, &Corners::rect(0.0, 0.0, BOARD[0], BOARD[1]))
}

/// Rotation by `angle`, scale `scale` about the board's middle, which comes to `to`.
fn pose(angle: f64, scale: f64, to: [f64; 2]) -> Mat3 {
    let (s, c) = (scale * libm::sin(angle), scale * libm::cos(angle));
    let (x, y) = (BOARD[0] / 2.0, BOARD[1] / 2.0);
    Mat3::new(
        c,
        -s,
        to[0] - c * x + s * y,
        s,
        c,
        to[1] - s * x - c * y,
        0.0,
        0.0,
        1.0,
    )
}

/// Frame `k` of a motion with perspective, up to three pixels a frame.
fn motion(k: usize) -> Mat3 {
    let t = k as f64;
    let mut m = pose(0.01 * t, 1.0 + 0.006 * t, [220.0 + 1.6 * t, 170.0 + 0.8 * t]);
    let lean = Mat3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 2e-5 * t, -1.5e-5 * t, 1.0);
    m *= lean;
    m
}

fn distance(a: &Corners, b: &Corners) -> f64 {
    (a.distance_squared(b) / 4.0).sqrt()
}

fn lmeds() -> EstimatorParams {
    EstimatorParams {
        estimator: EstimateMethod::Lmeds,
        ..EstimatorParams::default()
    }
}

fn klt_grid(nodes: NodeParams) -> FlowGrid<Homography> {
    FlowGrid::new(nodes, KltParams::default(), lmeds(), Homography::default())
}

fn nodes(n: usize) -> NodeParams {
    NodeParams {
        size: Resolution { cols: n, rows: n },
        ..NodeParams::default()
    }
}

/// Builds a patch tracker.
fn member() -> Result<Box<dyn Tracker>, SpecError> {
    let registry = Registry::builtin();
    registry.build(&registry.parse("esm/ssd/translation{res=20x20}")?)
}

fn grid(nodes: NodeParams, grid_reset: GridReset) -> Grid<Homography> {
    let patch = PatchParams {
        grid_reset,
        ..PatchParams::default()
    };
    Grid::new(nodes, patch, lmeds(), Homography::default(), member).unwrap()
}

fn line() -> LineTracker<Homography> {
    let patch = PatchParams {
        grid_reset: GridReset::Fixed,
        ..PatchParams::default()
    };
    let lines = LineParams::default();
    LineTracker::new(nodes(6), patch, lines, lmeds(), Homography::default(), member).unwrap()
}

fn features() -> FeatureTracker<Homography> {
    FeatureTracker::new(
        FeatureParams::default(),
        MatchParams::default(),
        EstimatorParams::default(),
        Homography::default(),
    )
}

/// Mean error over the frames of [`motion`].
fn mean_error(tracker: &mut dyn Tracker, frames: &[Frame]) -> f64 {
    tracker.reseed(5);
    tracker.init(&frames[0], &corners(&motion(0))).unwrap();
    let mut sum = 0.0;
    for (k, frame) in frames.iter().enumerate().skip(1) {
        let update = tracker.update(frame).unwrap();
        assert_eq!(update.corners, tracker.corners());
        assert!(update.similarity > 0.2, "{k} {}", update.similarity);
        sum += distance(&update.corners, &corners(&motion(k)));
    }
    sum / (frames.len() - 1) as f64
}

fn every_composite_follows_a_plane() {
    let scene = Scene::new(true);
    let frames: Vec<Frame> = (0..12).map(|k| scene.plain(&motion(k))).collect();
    let checked = NodeParams {
        grid_fb: 2.0,
        ..nodes(7)
    };
    let cells = NodeParams {
        grid_cells: true,
        ..nodes(7)
    };
    let trackers: Vec<(&str, Box<dyn Tracker>, f64)> = vec![
        ("flow", Box::new(klt_grid(nodes(10))), 0.3),
        ("flow, checked", Box::new(klt_grid(checked.clone())), 0.3),
        ("flow, cells", Box::new(klt_grid(cells.clone())), 0.5),
        ("reinit", Box::new(grid(nodes(7), GridReset::Reinit)), 0.4),
        ("reinit, checked", Box::new(grid(checked, GridReset::Reinit)), 0.4),
        ("never", Box::new(grid(nodes(7), GridReset::Never)), 0.6),
        ("move", Box::new(grid(nodes(7), GridReset::Move)), 0.6),
        ("fixed", Box::new(grid(nodes(7), GridReset::Fixed)), 0.12),
        ("fixed, cells", Box::new(grid(cells, GridReset::Fixed)), 0.15),
        ("lines", Box::new(line()), 0.25),
        ("features", Box::new(features()), 0.6),
    ];
    let mut report = String::new();
    for (name, mut tracker, limit) in trackers {
        let error = mean_error(tracker.as_mut(), &frames);
        assert_eq!(
            error,
            mean_error(tracker.as_mut(), &frames),
            "{name} does not repeat"
        );
        if error > limit {
            report += &format!("{name}: {error}\n");
        }
    }
    assert!(report.is_empty(), "{report}");
}

fn pyramids_that_widen_take_small_patches_far() {
    let scene = Scene::new(true);
    let (start, moved) = (pose(0.0, 1.0, [200.0, 160.0]), pose(0.0, 1.0, [228.0, 178.0]));
    let frames = [scene.plain(&start), scene.plain(&moved)];
    let registry = Registry::builtin();
    let error = |widen: bool| {
        let text = format!(
            "grid(pyramid(iclk/ncc/translation{{res=15x15}}; levels=4, widen={widen}); size=7x7, patch_size=21)"
        );
        let mut tracker = registry.build(&registry.parse(&text).unwrap()).unwrap();
        tracker.init(&frames[0], &corners(&start)).unwrap();
        let update = tracker.update(&frames[1]);
        update.map_or(f64::INFINITY, |u| distance(&u.corners, &corners(&moved)))
    };
    assert!(error(true) < 0.3, "{}", error(true));
    assert!(error(false) > 5.0, "{}", error(false));
}

/// Tracks with `text`; returns the errors, px.
fn errors(text: &str, frames: &[Frame], truth: &[Mat3]) -> Vec<f64> {
    let registry = Registry::builtin();
    let mut tracker = registry.build(&registry.parse(text).unwrap()).unwrap();
    tracker.init(&frames[0], &corners(&truth[0])).unwrap();
    let pairs = frames.iter().zip(truth).skip(1);
    pairs
        .map(|(frame, m)| {
            let update = tracker.update(frame);
            let error = distance(&tracker.corners(), &corners(m));
            assert!(update.is_ok_and(|u| u.corners == tracker.corners()), "{text}");
            error
        })
        .collect()
}

/// Also what [`errors`] checks: that the answer is where the tracker is.
fn guards_find_again_and_put_back() {
    let scene = Scene::new(true);
    let jump = [[200.0, 160.0], [201.0, 160.0], [290.0, 230.0], [291.0, 231.0]];
    let truth = jump.map(|to| pose(0.0, 1.0, to));
    let frames = truth.map(|m| scene.plain(&m));
    let alone = errors("esm/zncc/homography", &frames, &truth);
    assert!(alone[2] > 20.0, "{alone:?}");
    let found = errors("guard(esm/zncc/homography, feature)", &frames, &truth);
    assert!(found.iter().all(|e| *e < 0.5), "{found:?}");
    // Three frames of something else, and the object where it was.
    let still = [pose(0.0, 1.0, [220.0, 170.0]); 6];
    let other = scene.plain(&pose(2.0, 1.6, [330.0, 120.0]));
    let mut frames = still.map(|m| scene.plain(&m));
    (1..4).for_each(|k| frames[k] = other.clone());
    let kept = errors("guard(esm/ssd/homography)", &frames, &still);
    assert!(kept[3] < 0.5 && kept[4] < 0.5, "{kept:?}");
    let hidden = errors("guard(esm/ssd/homography; guard_reset=false)", &frames, &still);
    assert!(hidden[4] > 5.0, "{hidden:?}");
}

/// Errors of a template grid that asks its leader, a grid from frame to frame, below an agreement of `enough`; iterations.
fn led(enough: &str, frames: &[Frame], truth: &[Mat3]) -> Vec<(f64, u32)> {
    let text = format!(
        "rklt(grid(pyramid(iclk/ssd/translation{{res=15x15}}; levels=4, widen=true); size=7x7, patch_size=21), \
         grid(iclk/ssd/translation{{res=15x15}}; size=7x7, grid_reset=fixed); rkl_enough={enough})"
    );
    let registry = Registry::builtin();
    let mut tracker = registry.build(&registry.parse(&text).unwrap()).unwrap();
    tracker.init(&frames[0], &corners(&truth[0])).unwrap();
    let mut follow = |(frame, m): (&Frame, &Mat3)| {
        let update = tracker.update(frame).unwrap();
        assert_eq!(update.corners, tracker.corners());
        (distance(&update.corners, &corners(m)), update.iterations)
    };
    frames.iter().zip(truth).skip(1).map(&mut follow).collect()
}

fn leaders_are_asked_where_the_template_does_not_suffice() {
    let scene = Scene::new(true);
    // A slow motion, a leap that only the leader can follow from the frame before, and on.
    let x = [200.0, 201.0, 202.0, 203.0, 231.0, 232.0];
    let truth = x.map(|x| pose(0.0, 1.0, [x, 160.0 + 0.5 * (x - 200.0)]));
    let frames = truth.map(|m| scene.plain(&m));
    let (seldom, always) = (led("0.7", &frames, &truth), led("1e30", &frames, &truth));
    for (k, (a, b)) in seldom.iter().zip(&always).enumerate() {
        assert!(a.0 < 0.2 && b.0 < 0.2, "{k}: {a:?} {b:?}");
        let leap = k == 3;
        assert_eq!(a.1 == b.1, leap, "{k}: {a:?} {b:?}");
    }
}

fn a_template_leaves_out_what_its_leader_finds_covered() {
    let scene = Scene::new(true);
    let truth: Vec<Mat3> = (0..5).map(motion).collect();
    let hidden = |x: f64, y: f64| (20.0..110.0).contains(&x) && (20.0..100.0).contains(&y);
    let frame = |(k, m): (usize, &Mat3)| scene.frame(m, |o, _| k > 0 && hidden(o[0], o[1]));
    let frames: Vec<Frame> = truth.iter().enumerate().map(frame).collect();
    let mut report = String::new();
    for (leader, template) in [
        ("flow", "iclk/ssd"),
        ("flow{size=7x9,grid_cells=1}", "esm/ncc"),
        (
            "grid(esm/ssd/translation{res=15x15}; size=12x12, grid_reset=fixed)",
            "fclk/zncc",
        ),
        (
            "line(esm/ssd/translation{res=15x15}; size=12x12, grid_reset=fixed)",
            "falk/ssd",
        ),
    ] {
        let mean = |spi: u8| {
            let text = format!("rklt({leader}, {template}/homography{{res=40x40}}; rkl_spi={spi})");
            let errors = errors(&text, &frames, &truth);
            errors.iter().sum::<f64>() / errors.len() as f64
        };
        let (all, selected) = (mean(0), mean(1));
        if selected > 0.9 * all {
            report += &format!("{leader} {template}: {all} {selected}\n");
        }
    }
    assert!(report.is_empty(), "{report}");
    let registry = Registry::builtin();
    let refused = |text: &str| {
        let built = registry.build(&registry.parse(text).unwrap());
        built.err().map_or(String::new(), |e| e.to_string())
    };
    for (text, why) in [
        (
            "rklt(flow, esm/mi/homography; rkl_spi=1)",
            "mi has no weights of single pixels",
        ),
        (
            "rklt(flow, nn/ssd/homography; rkl_spi=1)",
            "a gradient search is needed",
        ),
        (
            "rklt(feature, esm/ssd/homography; rkl_spi=1)",
            "a leader with a grid",
        ),
        (
            "rklt(esm/ssd/affine, esm/ssd/homography; rkl_spi=1)",
            "a leader with a grid",
        ),
    ] {
        assert!(refused(text).contains(why), "{text}: {}", refused(text));
        assert_eq!(refused(&text.replace("=1)", "=0)")), "", "{text}");
    }
}

fn members_that_share_their_models_are_checked() {
    let registry = Registry::builtin();
    let build = |text: &str| registry.parse(text).and_then(|spec| registry.build(&spec));
    for name in ["casm", "prsm"] {
        build(&format!("{name}(nn/ncc/affine, esm/ncc/affine{{max_iters=5}})")).unwrap();
        build(&format!("{name}(lmes/ncc/affine, esm/ncc/affine)")).unwrap();
        for other in [
            "esm/ssd/affine",
            "esm/ncc/homography",
            "flow",
            "cascade(esm/ncc/affine)",
        ] {
            let error = build(&format!("{name}(nn/ncc/affine, {other})"))
                .err()
                .unwrap()
                .to_string();
            assert!(
                error.contains("the same appearance and state space model"),
                "{error}"
            );
        }
    }
    // The same trackers as those that take any members.
    let scene = Scene::new(true);
    let truth: Vec<Mat3> = (0..4).map(motion).collect();
    let frames: Vec<Frame> = truth.iter().map(|m| scene.plain(m)).collect();
    let members = "fclk/ssd/affine, esm/ssd/affine";
    for (same, any) in [
        (format!("casm({members})"), format!("cascade({members})")),
        (format!("prsm({members})"), format!("parallel({members})")),
        (
            format!("prls({members}; estimate=mean_states)"),
            format!("parallel({members}; estimate=mean_states, state_ssm=affine)"),
        ),
    ] {
        assert_eq!(errors(&same, &frames, &truth), errors(&any, &frames, &truth));
    }
    assert_eq!(registry.parse("pysm(esm)"), registry.parse("pyramid(esm)"));
    let error = build(&format!("prsm({members}; state_ssm=affine)"))
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("of no use to prsm"), "{error}");
}

fn little_effort_is_for_little_motion() {
    let scene = Scene::new(true);
    let follow = |klt_enough: f64, to: [f64; 2]| {
        let (start, moved) = (pose(0.0, 1.0, [200.0, 160.0]), pose(0.05, 1.02, to));
        let klt = KltParams {
            klt_enough,
            ..KltParams::default()
        };
        let mut tracker = FlowGrid::new(nodes(8), klt, lmeds(), Homography::default());
        tracker.init(&scene.plain(&start), &corners(&start)).unwrap();
        let update = tracker.update(&scene.plain(&moved)).unwrap();
        (distance(&update.corners, &corners(&moved)), update.corners)
    };
    let apart = |to| distance(&follow(0.85, to).1, &follow(0.0, to).1);
    // All the effort there is, where it is needed.
    let far = [262.0, 196.0];
    assert!(follow(0.0, far).0 < 0.5, "{:?}", follow(0.0, far));
    assert!(apart(far) < 0.05, "{}", apart(far));
    let near = [204.0, 158.0];
    assert!(follow(0.85, near).0 < 0.3, "{:?}", follow(0.85, near));
    assert!(apart(near) > 0.0);
}

fn patches_that_fail_the_way_back_stay_out() {
    let scene = Scene::new(true);
    let (start, moved) = (pose(0.0, 1.0, [220.0, 170.0]), pose(0.0, 1.0, [222.0, 171.0]));
    let frames = [start, moved].map(|m| scene.plain(&m));
    // Hardly any can return so exactly: as many as determine the warp are kept, in both passes.
    let strict = NodeParams {
        grid_fb: 1e-14,
        ..nodes(7)
    };
    let patch = PatchParams {
        grid_passes: 3,
        grid_enough: 0.0,
        ..PatchParams::default()
    };
    let mut tracker = Grid::new(strict, patch, lmeds(), Homography::default(), member).unwrap();
    tracker.init(&frames[0], &corners(&start)).unwrap();
    let update = tracker.update(&frames[1]).unwrap();
    assert!(distance(&update.corners, &corners(&moved)) < 3.0);
    assert_eq!(tracker.inliers().iter().filter(|i| **i).count(), 4);
}

fn points_under_an_occluder_are_rejected() {
    let scene = Scene::new(true);
    let (start, moved) = (pose(0.0, 1.0, [220.0, 170.0]), pose(0.0, 1.0, [223.0, 172.0]));
    let hidden = |x: f64, y: f64| (40.0..130.0).contains(&x) && (30.0..110.0).contains(&y);
    let first = scene.plain(&start);
    let second = scene.frame(&moved, |o, _| hidden(o[0], o[1]));
    let checked = NodeParams {
        grid_fb: 2.0,
        ..nodes(10)
    };
    let mut tracker = klt_grid(checked);
    tracker.init(&first, &corners(&start)).unwrap();
    let update = tracker.update(&second).unwrap();
    assert!(distance(&update.corners, &corners(&moved)) < 0.3);
    let mut kept = 0;
    for (i, inlier) in tracker.inliers().iter().enumerate() {
        let (x, y) = ((i % 10) as f64 * BOARD[0] / 9.0, (i / 10) as f64 * BOARD[1] / 9.0);
        // Windows reach 10 px to each side.
        if hidden(x - 8.0, y - 8.0) && hidden(x + 8.0, y + 8.0) {
            assert!(!inlier, "({x}, {y}) is hidden");
        } else if !hidden(x - 14.0, y) && !hidden(x + 14.0, y) && !hidden(x, y - 14.0) && !hidden(x, y + 14.0)
        {
            kept += usize::from(*inlier);
        }
    }
    assert!(kept >= 24, "{kept}");
}

fn composites_say_when_they_are_lost_and_go_on() {
    let scene = Scene::new(true);
    let start = pose(0.0, 1.0, [220.0, 170.0]);
    let frame = scene.plain(&start);
    let flat = Frame::from_gray(Image::from_fn(SIZE[0], SIZE[1], |_, _| 90.0));
    let trackers: Vec<(bool, Box<dyn Tracker>)> = vec![
        (true, Box::new(klt_grid(nodes(10)))),
        (false, Box::new(grid(nodes(5), GridReset::Fixed))),
        (false, Box::new(line())),
        (true, Box::new(features())),
    ];
    for (notices, mut tracker) in trackers {
        assert_eq!(tracker.update(&frame).err(), Some(TrackError::NotInitialised));
        assert!(tracker.set_region(&corners(&start)).is_err());
        assert!(tracker.init(&frame, &Corners([[3.0, 3.0]; 4])).is_err());
        tracker.init(&frame, &corners(&start)).unwrap();
        let moved = corners(&start).translated(2.0, -1.0);
        tracker.set_region(&moved).unwrap();
        assert!(distance(&tracker.corners(), &moved) < 1e-6);
        assert!(tracker.set_region(&Corners([[f64::NAN; 2]; 4])).is_err());
        tracker.set_region(&corners(&start)).unwrap();
        let update = tracker.update(&frame).unwrap();
        assert!(distance(&update.corners, &corners(&start)) < 0.3);
        if notices {
            let before = tracker.corners();
            assert!(tracker.update(&flat).is_err());
            assert_eq!(tracker.corners(), before);
            // The flow has nothing to go by in the frame after an empty one.
            let _ = tracker.update(&frame);
            let update = tracker.update(&frame).unwrap();
            assert!(distance(&update.corners, &corners(&start)) < 0.5);
        }
    }
    let flat_start = |mut t: Box<dyn Tracker>| t.init(&flat, &corners(&start)).is_err();
    assert!(flat_start(Box::new(features())) && flat_start(Box::new(klt_grid(nodes(10)))));
    assert!(flat_start(Box::new(grid(nodes(5), GridReset::Fixed))));
}

fn low_warps_fit_what_they_can() {
    let scene = Scene::new(true);
    let (start, moved) = (pose(0.0, 1.0, [220.0, 170.0]), pose(0.05, 1.02, [225.0, 168.0]));
    let (first, second) = (scene.plain(&start), scene.plain(&moved));
    let mut shift = FlowGrid::new(nodes(10), KltParams::default(), lmeds(), Translation::default());
    let mut similar = FlowGrid::new(nodes(10), KltParams::default(), lmeds(), Similitude::default());
    shift.init(&first, &corners(&start)).unwrap();
    similar.init(&first, &corners(&start)).unwrap();
    let [dx, dy] = shift.update(&second).unwrap().corners.0[0];
    assert!((dx - 125.0).abs() < 2.0 && (dy - 93.0).abs() < 2.0, "{dx} {dy}");
    let update = similar.update(&second).unwrap();
    assert!(distance(&update.corners, &corners(&moved)) < 0.3);
    // A region beyond the warp's family becomes its base.
    let tilted = corners(&motion(9));
    shift.set_region(&tilted).unwrap();
    assert!(distance(&shift.corners(), &tilted) < 1e-6);
}

fn features_find_an_object_that_jumped_turned_grew_and_is_half_covered() {
    let scene = Scene::new(false);
    let start = pose(0.0, 1.0, [160.0, 130.0]);
    let quarter = std::f64::consts::FRAC_PI_2;
    let jumped = pose(quarter, 1.8, [240.0, 190.0]);
    let first = scene.plain(&start);
    let second = scene.frame(&jumped, |o, _| o[0] < BOARD[0] / 2.0);
    let mut tracker = features();
    tracker.reseed(3);
    tracker.init(&first, &corners(&start)).unwrap();
    let found = tracker.detect(&second).unwrap();
    // Half of it has to be extrapolated.
    let error = distance(&found.corners, &corners(&jumped));
    assert!(error < 6.0, "{error} {found:?}");
    assert!(found.inliers >= 20 && found.support > 0.1, "{found:?}");
    assert_eq!(tracker.corners(), corners(&start), "detection moves nothing");
    let update = tracker.update(&second).unwrap();
    let error = distance(&update.corners, &corners(&jumped));
    assert!(error < 6.0, "{error} {update:?}");
    // Back, and away at half the size.
    let update = tracker.update(&first).unwrap();
    assert!(distance(&update.corners, &corners(&start)) < 1.0);
    let small = pose(-0.7, 0.5, [330.0, 250.0]);
    let update = tracker.update(&scene.plain(&small)).unwrap();
    assert!(distance(&update.corners, &corners(&small)) < 2.0);
    // Where it is not, nothing is found.
    let gone = scene.frame(&start, |_, _| true);
    assert!(tracker.detect(&gone).is_err() && tracker.update(&gone).is_err());
    assert_eq!(tracker.corners(), update.corners);
}
