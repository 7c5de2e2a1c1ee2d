//! Feature maps of networks read from files in ONNX format, and how bad files are refused. Without the cargo feature
//! `onnx` every file is, with the way to read it.

use mtf::Jacobian;
use mtf::am::{AppearanceModel, Dfm, DfmParams, Network, NetworkError, PatchShape, Side};
use mtf::diagnose::Waves;
use mtf::entry::Part;
use mtf::geom::{Corners, Mat3, homography};
use mtf::image::{Frame, Image};
use mtf::params::Resolution;
use mtf::registry::{Registry, SpecError};
use mtf::tracker::TrackError;

crate::tests! {
    a_network_is_read_or_refused_with_its_name;
    missing_and_truncated_files_are_refused needs Onnx;
    patches_of_the_wrong_shape_are_refused needs Onnx;
    features_are_those_of_the_network needs Onnx;
    gradients_along_parameters_agree_with_those_of_pixels_and_with_differences needs Onnx;
    every_gradient_method_tracks_with_a_network needs Onnx;
}

const NETWORK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/edges.onnx");

/// Why the registry refuses a tracker with a network.
fn refusal(path: &str) -> String {
    let registry = Registry::builtin();
    match registry.parse(&format!("fclk/dfm/homography{{model={path}}}")) {
        Err(e @ SpecError::Param(_)) => {
            let text = e.to_string();
            assert!(
                text.starts_with(&format!("model={path}: ")) && !text.contains('\n'),
                "{text}"
            );
            text
        }
        other => panic!("{path}: {other:?}"),
    }
}

fn a_network_is_read_or_refused_with_its_name() {
    if cfg!(feature = "onnx") {
        assert!(Network::load(NETWORK).is_ok());
        return;
    }
    let text = refusal(NETWORK);
    assert!(
        text.ends_with("built without networks; build it with `--features onnx`"),
        "{text}"
    );
}

const SIZE: (usize, usize) = (200, 180);

fn shape(cols: usize, rows: usize) -> PatchShape {
    let res = Resolution { cols, rows };
    PatchShape { res, channels: 1 }
}

fn dfm() -> Dfm {
    Dfm::new(DfmParams {
        model: Network::load(NETWORK).unwrap(),
        n_maps: 8,
        ..DfmParams::default()
    })
}

fn patch(shape: PatchShape, seed: u64, dx: f64) -> Vec<f32> {
    let waves = Waves::new(seed);
    let at = |i: usize| {
        [
            (i % shape.res.cols) as f64 * 4.0 + dx,
            (i / shape.res.cols) as f64 * 4.0,
        ]
    };
    (0..shape.len()).map(|i| waves.at(at(i)) as f32).collect()
}

fn missing_and_truncated_files_are_refused() {
    let text = refusal("/nowhere/None.onnx");
    assert!(text.contains("cannot read the file: "), "{text}");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("Cut.onnx");
    let path = path.to_str().unwrap();
    let bytes = std::fs::read(NETWORK).unwrap();
    let write = |bytes: &[u8]| std::fs::write(path, bytes).unwrap();
    for cut in 0..bytes.len() {
        write(&bytes[..cut]);
        assert!(matches!(
            Network::load(path),
            Err(NetworkError::Format(_) | NetworkError::Ends { .. })
        ));
    }
    assert!(refusal(path).contains("not a usable network"));
    write(b"frame ulx uly\n");
    assert!(refusal(path).contains("not a usable network"));
}

fn patches_of_the_wrong_shape_are_refused() {
    let color = PatchShape {
        channels: 3,
        ..shape(20, 20)
    };
    for (shape, what) in [
        (color, "number of channels"),
        (shape(6, 20), "so small a patch"),
        // Refused by the runtime itself, or because nothing is left.
        (shape(4, 20), "patch"),
    ] {
        match dfm().set_template(shape, &vec![100.0; shape.len()]) {
            Err(TrackError::Template(why)) => assert!(why.contains(what), "{why}"),
            other => panic!("{shape:?}: {other:?}"),
        }
    }
    let flat = dfm().set_template(shape(20, 20), &[100.0; 400]);
    assert!(
        matches!(flat, Err(TrackError::Template("flat patch"))),
        "{flat:?}"
    );
}

/// The network by hand: see scripts/make_onnx.py.
fn features_are_those_of_the_network() {
    let shape = shape(17, 13);
    let p = patch(shape, 3, 0.0);
    let mut am = Dfm::new(DfmParams {
        model: Network::load(NETWORK).unwrap(),
        n_maps: 8,
        zncc: false,
        ..DfmParams::default()
    });
    am.set_template(shape, &p).unwrap();
    assert_eq!(am.distances().unwrap().feature_len(), 8 * 11 * 7);
    let mut out = vec![0.0; am.distances().unwrap().feature_len()];
    am.distances().unwrap().feature_into(&p, &mut out);
    let pixel = |x: usize, y: usize| f64::from(p[y * 17 + x]);
    for k in 0..8 {
        let angle = std::f64::consts::TAU * k as f64 / 8.0;
        let tap =
            |dx: f64, dy: f64| (dx * angle.cos() + dy * angle.sin()) * (-(dx * dx + dy * dy) / 2.88).exp();
        let window = || (0..25).map(|i| (i % 5, i / 5));
        let norm: f64 = window()
            .map(|(i, j)| tap(i as f64 - 2.0, j as f64 - 2.0).abs())
            .sum();
        let lit = |x: usize, y: usize| -> f64 {
            let edge = window().map(|(i, j)| tap(i as f64 - 2.0, j as f64 - 2.0) * pixel(x + i, y + j));
            (edge.sum::<f64>() / norm + 2.0).max(0.0)
        };
        for (x, y) in [(0, 0), (10, 0), (4, 3), (10, 6)] {
            let smooth = [0.25, 0.5, 0.25];
            let expected: f64 = (0..9)
                .map(|i| smooth[i % 3] * smooth[i / 3] * lit(x + i % 3, y + i / 3))
                .sum();
            let got = f64::from(out[(k * 7 + y) * 11 + x]);
            assert!(
                (got - expected).abs() < 1e-3,
                "map {k} at {x}, {y}: {got}, {expected}"
            );
        }
    }
}

fn gradients_along_parameters_agree_with_those_of_pixels_and_with_differences() {
    let shape = shape(13, 12);
    let (t, c) = (patch(shape, 3, 0.0), patch(shape, 3, 2.0));
    let mut am = dfm();
    am.set_template(shape, &t).unwrap();
    am.set_current(&c);
    let mut j = Jacobian::new(shape.len(), 3);
    for k in 0..3 {
        let moved = patch(shape, 8 + k as u64, 0.0);
        j.col_mut(k)
            .iter_mut()
            .zip(&moved)
            .for_each(|(j, m)| *j = (m - 128.0) / 10.0);
    }
    let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    for side in [Side::Template, Side::Current] {
        let (mut scratch, mut along, mut pixels) = (vec![0.0; shape.len()], [0.0; 3], [0.0; 3]);
        // Twice: the second time from what was kept.
        for _ in 0..2 {
            am.derivatives()
                .unwrap()
                .project_gradient(side, &j, &mut scratch, &mut along);
            am.derivatives().unwrap().gradient_into(side, &mut scratch);
            for (k, pixel) in pixels.iter_mut().enumerate() {
                let products = j.col(k).iter().zip(&scratch);
                *pixel = products.map(|(&a, &b)| f64::from(a) * f64::from(b)).sum();
            }
            let off: Vec<f64> = along.iter().zip(&pixels).map(|(a, b)| a - b).collect();
            assert!(
                norm(&off) < 0.02 * norm(&pixels),
                "{side:?}: {along:?} {pixels:?}"
            );
        }
        let h = 0.05;
        let wide = |x: &[f32], k: usize, h: f64| -> Vec<f64> {
            x.iter()
                .zip(j.col(k))
                .map(|(&x, &d)| f64::from(x) + h * f64::from(d))
                .collect()
        };
        let f = |k: usize, h: f64| match side {
            Side::Template => am
                .reference()
                .unwrap()
                .similarity_of(&wide(&t, k, h), &wide(&c, k, 0.0)),
            Side::Current => am
                .reference()
                .unwrap()
                .similarity_of(&wide(&t, k, 0.0), &wide(&c, k, h)),
        };
        let numeric: Vec<f64> = (0..3).map(|k| (f(k, h) - f(k, -h)) / (2.0 * h)).collect();
        let off: Vec<f64> = along.iter().zip(&numeric).map(|(a, b)| a - b).collect();
        assert!(
            norm(&off) < 0.02 * norm(&numeric),
            "{side:?}: {along:?} {numeric:?}"
        );
    }
}

fn every_gradient_method_tracks_with_a_network() {
    let waves = Waves::new(11);
    let quad = Corners([[61.3, 50.2], [134.7, 45.9], [140.1, 120.4], [56.6, 125.0]]);
    let frame = |m: &Mat3| {
        let back = m.try_inverse().unwrap();
        let value = |x: usize, y: usize| waves.at(homography::apply(&back, [x as f64, y as f64])) as f32;
        Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, value))
    };
    let truth = Corners([[62.8, 49.0], [136.0, 45.1], [140.9, 121.6], [57.9, 124.6]]);
    let motion = homography::from_corners(&quad, &truth).unwrap();
    let (first, next) = (frame(&Mat3::identity()), frame(&motion));
    let registry = Registry::builtin();
    for sm in ["falk", "ialk", "fclk", "iclk", "esm"] {
        let id = format!("{sm}/dfm/homography{{model={NETWORK},n_maps=8,res=30x30}}");
        let mut tracker = registry.build(&registry.parse(&id).unwrap()).unwrap();
        tracker.init(&first, &quad).unwrap();
        let update = tracker.update(&next).unwrap();
        let error = (update.corners.distance_squared(&truth) / 4.0).sqrt();
        assert!(error < 0.05, "{sm}: {error} px after {}", update.iterations);
    }
}
