//! Synthetic sequences: the committed dataset is what its commands make, its ground truth is right in numbers and in
//! pixels, and its tags are deserved. `MTF_EVAL_SLOW=1` renders all of the dataset again instead of two sequences.

mod esm;

use clap::Parser;
use esm::Gray;
use mtf::geom::Corners;
use mtf_eval::synth::{
    FileType, Mode, Recipe, Selection, SynthSpec, builtin_recipes, builtin_spec, dense_ground_truth, encode,
    frames, ground_truth, metadata, out_of_view, render_sequence, write_sequence,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

crate::tests! {
    committed_sequences_are_rendered_again_byte_for_byte;
    texts_and_a_frame_of_every_sequence_are_rendered_again;
    sequences_of_others_frames_are_written_again;
    the_command_takes_frames_of_another;
    the_dataset_is_small_complete_and_tagged;
    ground_truth_agrees_with_an_independent_computation;
    each_sequence_moves_within_its_model;
    the_truth_is_right_in_the_pixels_and_plain_sequences_can_be_tracked;
    hard_sequences_are_hard_in_the_way_their_tags_say;
    bytes_do_not_depend_on_the_number_of_threads;
    random_walks_keep_their_model_and_stay_inside;
    the_command_writes_what_it_records;
    unusable_arguments_are_refused_with_the_reason;
}

fn builtin_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/builtin")
}

/// Name and specification of every sequence with frames of its own.
fn specs() -> Vec<(String, SynthSpec)> {
    let rendered = |(name, recipe)| match recipe {
        Recipe::Rendered(spec) => Some((name, *spec)),
        Recipe::Selected(_) => None,
    };
    builtin_recipes()
        .unwrap()
        .into_iter()
        .filter_map(rendered)
        .collect()
}

/// Name and making of every sequence with the frames of another.
fn selections() -> Vec<(String, Selection)> {
    let selected = |(name, recipe)| match recipe {
        Recipe::Selected(selection) => Some((name, selection)),
        Recipe::Rendered(_) => None,
    };
    builtin_recipes()
        .unwrap()
        .into_iter()
        .filter_map(selected)
        .collect()
}

fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(dir).unwrap().map(|e| e.unwrap());
    entries
        .map(|e| {
            (
                e.file_name().into_string().unwrap(),
                std::fs::read(e.path()).unwrap(),
            )
        })
        .collect()
}

/// Corners by frame as the committed ground truth gives them.
fn truth(name: &str) -> Vec<Corners> {
    let text = std::fs::read_to_string(builtin_dir().join(name).join("groundtruth.txt")).unwrap();
    let mut lines = text.lines();
    assert_eq!(
        lines.next(),
        Some("frame\tulx\tuly\turx\tury\tlrx\tlry\tllx\tlly")
    );
    lines
        .enumerate()
        .map(|(i, line)| {
            let (file, numbers) = line.split_once('\t').unwrap();
            assert_eq!(file, format!("frame{:05}.jpg", i + 1));
            let v: Vec<f64> = numbers.split('\t').map(|t| t.parse().unwrap()).collect();
            Corners::from_array(v.try_into().unwrap())
        })
        .collect()
}

fn gray_frames(name: &str) -> Vec<Gray> {
    let load = |i: usize| {
        let path = builtin_dir().join(name).join(format!("frame{i:05}.jpg"));
        Gray::new(&image::open(path).unwrap().to_rgb8())
    };
    (1..=truth(name).len()).map(load).collect()
}

/// Root mean square of the four corner distances, per frame after the first.
fn errors(tracked: &[Corners], truth: &[Corners]) -> Vec<f64> {
    tracked
        .iter()
        .zip(truth)
        .skip(1)
        .map(|(a, b)| (a.distance_squared(b) / 4.0).sqrt())
        .collect()
}

fn worst(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

fn names_tagged(tag: &str) -> Vec<String> {
    let all = specs()
        .into_iter()
        .filter(|(_, s)| s.tags.iter().any(|t| t == tag));
    all.map(|(name, _)| name).collect()
}

fn committed_sequences_are_rendered_again_byte_for_byte() {
    let slow = std::env::var_os("MTF_EVAL_SLOW").is_some_and(|v| v == "1");
    let chosen = specs()
        .into_iter()
        .filter(|(name, _)| slow || ["plain-map", "lighting"].contains(&name.as_str()));
    let temporary = tempfile::tempdir().unwrap();
    for (name, spec) in chosen {
        let dir = temporary.path().join(&name);
        write_sequence(&spec, &dir, false).unwrap();
        let (made, kept) = (files(&dir), files(&builtin_dir().join(&name)));
        assert_eq!(
            made.keys().collect::<Vec<_>>(),
            kept.keys().collect::<Vec<_>>(),
            "{name}"
        );
        for (file, bytes) in &made {
            assert!(kept[file] == *bytes, "{name}/{file} differs");
        }
    }
}

fn texts_and_a_frame_of_every_sequence_are_rendered_again() {
    for (name, spec) in specs() {
        let sequence = render_sequence(&spec).unwrap();
        let kept = files(&builtin_dir().join(&name));
        assert_eq!(
            kept.len(),
            spec.frames + 2 + usize::from(spec.bend > 0.0) + usize::from(spec.allow_outside),
            "{name}"
        );
        let dense = dense_ground_truth(&sequence, spec.format).map(String::into_bytes);
        assert!(kept.get("groundtruth_grid.csv") == dense.as_ref(), "{name}");
        let away = out_of_view(&sequence).map(String::into_bytes);
        assert!(kept.get("out_of_view.txt") == away.as_ref(), "{name}");
        assert!(
            kept["groundtruth.txt"] == ground_truth(&sequence, spec.format).into_bytes(),
            "{name}"
        );
        assert!(
            kept["meta.json"] == metadata(&name, &spec, &sequence).into_bytes(),
            "{name}"
        );
        let i = spec.frames / 2;
        let frame = encode(&sequence.frame(i), &spec).unwrap();
        assert!(kept[&format!("frame{:05}.jpg", i + 1)] == frame, "{name}");
    }
}

fn sequences_of_others_frames_are_written_again() {
    let specs = specs();
    for (name, selection) in selections() {
        let kept = files(&builtin_dir().join(&name));
        assert_eq!(kept.len(), 1, "{name}");
        assert!(
            kept["meta.json"] == selection.metadata(&name).into_bytes(),
            "{name}"
        );
        let (_, spec) = specs.iter().find(|(of, _)| *of == selection.of).expect("frames");
        // A level is harder than the one before, but for the motion the same.
        let first = format!("level-{}", if selection.step == 2 { 2 } else { 3 });
        assert!(
            selection.tags.contains(&first) && [2, 4].contains(&selection.step),
            "{name}"
        );
        let kinds = |tags: &[String]| -> Vec<String> {
            let kinds = tags
                .iter()
                .filter(|t| !t.starts_with("level-") && !["quick", "base"].contains(&t.as_str()));
            kinds.cloned().collect()
        };
        assert_eq!(kinds(&selection.tags), kinds(&spec.tags), "{name}");
    }
}

fn the_command_takes_frames_of_another() {
    let dir = tempfile::tempdir().unwrap();
    let synth = |words: &str| {
        crate::runs::program(dir.path())
            .arg("synth")
            .args(words.split(" "))
            .assert()
    };
    synth("data/a --size 64x48 --box 20x16 --frames 7").success();
    synth("data/a-3 --frames-of a --step 3 --tags level-2").success();
    let data = mtf_eval::dataset::load(&dir.path().join("data"), &Default::default()).unwrap();
    let names = |k: usize| {
        (0..data.sequences[k].len())
            .map(|i| data.sequences[k].frame_name(i))
            .collect::<Vec<_>>()
    };
    assert_eq!(names(1), ["frame00001.jpg", "frame00004.jpg", "frame00007.jpg"]);
    for (words, why) in [
        ("data/b --frames-of ../a", "not a path"),
        ("data/b --frames-of a --step 0", "whole number"),
        ("data/b --frames-of a --noise 3", "only --tags"),
        ("data/a --frames-of a", "not empty"),
    ] {
        let out = synth(words).code(2).get_output().stderr.clone();
        let out = String::from_utf8(out).unwrap();
        assert!(out.contains(why), "{words}: {out}");
    }
}

fn the_dataset_is_small_complete_and_tagged() {
    let (specs, mut bytes) = (specs(), 0);
    let mut folders: Vec<String> = builtin_recipes()
        .unwrap()
        .into_iter()
        .map(|(name, _)| name)
        .collect();
    folders.sort();
    let mut found = vec![];
    for entry in std::fs::read_dir(builtin_dir()).unwrap().map(|e| e.unwrap()) {
        if entry.file_type().unwrap().is_dir() {
            found.push(entry.file_name().into_string().unwrap());
            bytes += files(&entry.path()).values().map(Vec::len).sum::<usize>();
        } else {
            bytes += entry.metadata().unwrap().len() as usize;
        }
    }
    found.sort();
    assert_eq!(found, folders);
    assert!(bytes < 12_000_000, "{bytes} bytes");
    for (name, spec) in &specs {
        assert!(
            (60..=100).contains(&spec.frames) && spec.size == [320, 240] && spec.format == FileType::Jpeg
        );
        let meta: serde_json::Value =
            serde_json::from_slice(&files(&builtin_dir().join(name))["meta.json"]).unwrap();
        let (out, again) = SynthSpec::parse_command(meta["command"].as_str().unwrap()).unwrap();
        assert_eq!((&out, &again), (name, spec));
        assert_eq!(builtin_spec(name).as_ref(), Some(spec));
    }
    assert!(names_tagged("plain").len() >= 6);
    let all = builtin_recipes().unwrap();
    let tagged = |tag: &str| {
        all.iter()
            .filter(|(_, r)| r.tags().iter().any(|t| t == tag))
            .count()
    };
    assert_eq!((tagged("level-1"), tagged("base")), (specs.len(), 16));
    let kinds = "lighting perspective fast scale blur noise weak repetition occlusion bending highlight exposure leaving \
                 twins dark small mixed";
    for tag in kinds.split_whitespace() {
        assert!(tagged(tag) >= 2, "{tag}");
    }
    assert!((3..=8).contains(&tagged("quick")));
}

fn ground_truth_agrees_with_an_independent_computation() {
    let mut dense = 0;
    for (name, spec) in specs() {
        let sequence = render_sequence(&spec).unwrap();
        let rows = truth(&name);
        assert_eq!(rows.len(), spec.frames);
        for (i, row) in rows.iter().enumerate() {
            let ([tx, ty, angle, scale, stretch, shear, vx, vy], [cx, cy]) = sequence.pose(i).unwrap();
            let [w, h] = spec.object;
            for ([sx, sy], given) in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
                .into_iter()
                .zip(row.0)
            {
                // Point by point instead of by matrices: tilt, then turn, of the sheet in the first frame.
                let (x, y) = (sx * w / 2.0, sy * h / 2.0);
                // Where the bent sheet has this corner: half-way steps until the wave there leads to it.
                let b = 0.5 * spec.bend * (1.0 - (3.0 * std::f64::consts::PI * i as f64 / 59.0).cos());
                let (mut u, mut v) = (x, y);
                for _ in 0..200 {
                    let d = b * ((3.4 * (u + 0.4 * v) / w).cos() - 0.5);
                    (u, v) = (u + 0.5 * (x - u - 0.5 * d), v + 0.5 * (y - v - d));
                }
                let (x, y) = (u, v);
                let d = 1.0 + spec.lean / w * x + 0.6 * spec.lean / h * y;
                let (x, y) = rotated(x / d, y / d, spec.turn / 180.0 * std::f64::consts::PI);
                // The warp to frame i: tilt, shear, scale and turn about the first frame's centre, shift.
                let d = 1.0 + vx * x + vy * y;
                let (x, y) = (x / d, y / d);
                let (x, y) = (stretch.exp() * x + shear * y, y / stretch.exp());
                let (x, y) = rotated(scale.exp() * x, scale.exp() * y, angle);
                let expected = [x + cx + tx, y + cy + ty];
                for k in 0..2 {
                    assert!(
                        (expected[k] - given[k]).abs() < 1e-6,
                        "{name} frame {i}: {expected:?} {given:?}"
                    );
                }
            }
            assert!(row.is_convex() && row.signed_area() > 250.0, "{name} frame {i}");
            assert!(
                spec.allow_outside
                    || row
                        .0
                        .iter()
                        .all(|[x, y]| (0.0..=319.0).contains(x) && (0.0..=239.0).contains(y))
            );
        }
        for (i, row) in rows.iter().enumerate() {
            let Some(grid) = sequence.dense_truth(i) else {
                continue;
            };
            let far = |k: usize, c: usize| (grid[k][0] - row.0[c][0]).hypot(grid[k][1] - row.0[c][1]);
            assert!(
                [(0, 0), (9, 1), (99, 2), (90, 3)]
                    .into_iter()
                    .all(|(k, c)| far(k, c) < 1e-6)
            );
            dense += 1;
        }
        // Off the pixel grid from the start.
        let off = |v: &&f64| (**v - v.round()).abs() > 0.01;
        assert!(
            rows[0].0.iter().flatten().filter(off).count() >= 4,
            "{name}: {:?}",
            rows[0]
        );
    }
    assert!(dense >= 60, "{dense}");
}

fn rotated(x: f64, y: f64, angle: f64) -> (f64, f64) {
    (
        x * angle.cos() - y * angle.sin(),
        x * angle.sin() + y * angle.cos(),
    )
}

/// Largest corner distance to the best warp of the first corners with `scale` and `turn` free or not.
fn similar_misfit(first: &Corners, now: &Corners, turns: bool, scales: bool) -> f64 {
    let (a, b) = (first.centroid(), now.centroid());
    let (mut dot, mut cross, mut norm) = (0.0, 0.0, 0.0);
    for (p, q) in first.0.iter().zip(&now.0) {
        let (px, py, qx, qy) = (p[0] - a[0], p[1] - a[1], q[0] - b[0], q[1] - b[1]);
        (dot, cross, norm) = (
            dot + px * qx + py * qy,
            cross + px * qy - py * qx,
            norm + px * px + py * py,
        );
    }
    let angle = if turns { cross.atan2(dot) } else { 0.0 };
    let scale = if scales { dot.hypot(cross) / norm } else { 1.0 };
    let misfit = first.0.iter().zip(&now.0).map(|(p, q)| {
        let (x, y) = rotated(scale * (p[0] - a[0]), scale * (p[1] - a[1]), angle);
        (x + b[0] - q[0]).hypot(y + b[1] - q[1])
    });
    misfit.fold(0.0, f64::max)
}

fn each_sequence_moves_within_its_model() {
    for (name, spec) in specs() {
        let rows = truth(&name);
        let over = |f: &dyn Fn(&Corners) -> f64| rows.iter().map(f).fold(0.0, f64::max);
        let affine = over(&|c| affine_misfit(&rows[0], c));
        match spec.model.name() {
            "translation" => assert!(
                over(&|c| similar_misfit(&rows[0], c, false, false)) < 1e-6,
                "{name}"
            ),
            "isometry" => assert!(
                over(&|c| similar_misfit(&rows[0], c, true, false)) < 1e-6,
                "{name}"
            ),
            "similitude" => assert!(
                over(&|c| similar_misfit(&rows[0], c, true, true)) < 1e-6,
                "{name}"
            ),
            "affine" => assert!(affine < 1e-6, "{name}"),
            _ => assert!(affine > 3.0, "{name} hardly needs a homography: {affine}"),
        }
        if spec.tags.iter().any(|t| t == "perspective") {
            assert!(affine > 10.0, "{affine}");
        }
        let size = |c: &Corners| (c.signed_area() / rows[0].signed_area()).sqrt();
        if spec.tags.iter().any(|t| t == "scale") {
            let least = rows.iter().map(size).fold(f64::MAX, f64::min);
            assert!(least < 0.65 && over(&size) > 1.65, "{least} {}", over(&size));
        }
    }
}

/// Largest corner distance to the least-squares affine image of the first corners.
fn affine_misfit(first: &Corners, now: &Corners) -> f64 {
    let mut a = nalgebra::Matrix4x3::<f64>::zeros();
    for (k, [x, y]) in first.0.iter().enumerate() {
        a.set_row(k, &nalgebra::RowVector3::new(*x, *y, 1.0));
    }
    let b = nalgebra::Matrix4x2::from_fn(|r, c| now.0[r][c]);
    let map = a.svd(true, true).solve(&b, 1e-12).unwrap();
    (a * map - b).row_iter().map(|r| r.norm()).fold(0.0, f64::max)
}

fn the_truth_is_right_in_the_pixels_and_plain_sequences_can_be_tracked() {
    for name in names_tagged("plain") {
        let (frames, rows) = (gray_frames(&name), truth(&name));
        let template = esm::patch(&frames[0], &rows[0]);
        for (i, (frame, row)) in frames.iter().zip(&rows).enumerate() {
            let similarity = esm::ncc(&template, &esm::patch(frame, row));
            assert!(similarity > 0.95, "{name} frame {i}: {similarity}");
        }
        // Any mistake in geometry beyond a tenth of a pixel would show here.
        for share in [0.0, 0.5, 1.0] {
            let e = errors(&esm::track(&frames, &rows[0], false, 8, share), &rows);
            assert!(worst(&e) < 0.3, "{name}, share {share}: {}", worst(&e));
        }
    }
}

fn hard_sequences_are_hard_in_the_way_their_tags_say() {
    let of = |tag: &str| {
        let name = names_tagged(tag).remove(0);
        (gray_frames(&name), truth(&name))
    };
    let tracked = |tag: &str, normalised, dof| {
        let (frames, rows) = of(tag);
        let e = errors(&esm::track(&frames, &rows[0], normalised, dof, 0.5), &rows);
        (
            worst(&e),
            e.iter().filter(|&&v| v <= 5.0).count() as f64 / e.len() as f64,
        )
    };
    let (_, ssd) = tracked("lighting", false, 8);
    let (zncc, _) = tracked("lighting", true, 8);
    assert!(ssd < 0.6 && zncc < 3.0, "lighting: ssd {ssd}, zncc {zncc}");
    assert!(tracked("fast", false, 8).1 < 0.3);
    assert!(tracked("occlusion", false, 8).1 < 0.7);
    assert!(tracked("perspective", false, 6).1 < 0.5 && tracked("perspective", false, 8).0 < 2.0);
    for tag in ["scale", "noise", "weak", "repetition", "blur"] {
        assert!(tracked(tag, false, 8).0 < 4.0, "{tag}");
    }
    let spec = builtin_spec(&names_tagged("occlusion")[0]).unwrap();
    let sequence = render_sequence(&spec).unwrap();
    let covered: Vec<f64> = (0..spec.frames).map(|i| sequence.covered(i)).collect();
    assert!(
        covered[0] == 0.0 && (0.3..=0.4).contains(&worst(&covered)),
        "{covered:?}"
    );
}

fn bytes_do_not_depend_on_the_number_of_threads() {
    let mut spec = SynthSpec {
        frames: 3,
        noise: 4.0,
        blur: 0.5,
        occlude: 0.2,
        ..SynthSpec::default()
    };
    spec.set("light", "gain=0.7..1.3,shadow=0.3").unwrap();
    let bytes_with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let all = pool.install(|| frames(&spec).unwrap());
        all.iter()
            .map(|(f, c)| (encode(f, &spec).unwrap(), c.to_array().map(f64::to_bits)))
            .collect::<Vec<_>>()
    };
    assert!(bytes_with(1) == bytes_with(2));
}

fn random_walks_keep_their_model_and_stay_inside() {
    for mode in [Mode::Continuous, Mode::Independent] {
        let spec = SynthSpec {
            mode,
            sigma: 2.0,
            frames: 30,
            ..SynthSpec::default()
        };
        for name in ["translation", "similitude", "affine", "homography"] {
            let mut spec = spec.clone();
            spec.set("motion", name).unwrap();
            let s = render_sequence(&spec).unwrap();
            let rows: Vec<_> = (0..30).map(|i| s.corners(i)).collect();
            assert!(rows.iter().all(|c| c.is_convex()));
            assert!(
                rows.iter()
                    .flat_map(|c| c.0)
                    .all(|[x, y]| (0.0..319.0).contains(&x) && (0.0..239.0).contains(&y))
            );
            let misfit = rows
                .iter()
                .map(|c| affine_misfit(&rows[0], c))
                .fold(0.0, f64::max);
            assert_eq!(misfit < 1e-6, name != "homography", "{name}: {misfit}");
            assert!(s.pose(3).is_none() && s.speed()[0] > 0.5);
        }
    }
}

#[derive(Parser)]
struct Program {
    #[command(flatten)]
    args: mtf_eval::cli::synth::SynthArgs,
}

fn synth(words: &[&str]) -> anyhow::Result<std::process::ExitCode> {
    let program = Program::try_parse_from(std::iter::once(&"synth").chain(words))?;
    mtf_eval::cli::synth::run(&program.args, &|_| {})
}

fn the_command_writes_what_it_records() {
    let root = tempfile::tempdir().unwrap();
    let picture = root.path().join("my picture.png");
    image::RgbImage::from_fn(90, 70, |x, y| image::Rgb([(x * 2) as u8, (y * 3) as u8, 90]))
        .save(&picture)
        .unwrap();
    let (first, second) = (
        root.path().join("a").join("walk"),
        root.path().join("b").join("walk"),
    );
    let small = [
        "--size",
        "96x72",
        "--box",
        "40x30",
        "--frames",
        "4",
        "--amplitude",
        "6",
        "--format",
        "png",
    ];
    let mut words = vec![
        first.to_str().unwrap(),
        "--image",
        picture.to_str().unwrap(),
        "--tags",
        "plain",
    ];
    words.extend(small);
    synth(&words).unwrap();
    let meta: serde_json::Value = serde_json::from_slice(&files(&first)["meta.json"]).unwrap();
    let (_, spec) = SynthSpec::parse_command(meta["command"].as_str().unwrap()).unwrap();
    write_sequence(&spec, &second, false).unwrap();
    assert!(files(&first) == files(&second));
    assert_eq!(meta["tags"], serde_json::json!(["plain"]));

    // A folder in use is left alone, or with --force holds the new sequence and nothing of the old one.
    let again = synth(&words).unwrap_err().to_string();
    assert!(
        again.contains("not empty") && again.contains("--force"),
        "{again}"
    );
    words.extend(["--force"]);
    words.iter_mut().filter(|w| **w == "4").for_each(|w| *w = "2");
    synth(&words).unwrap();
    assert_eq!(files(&first).len(), 4);
}

fn unusable_arguments_are_refused_with_the_reason() {
    let root = tempfile::tempdir().unwrap();
    let text = root.path().join("text.png");
    std::fs::write(&text, "no image").unwrap();
    let out = root.path().join("out");
    let (out, text) = (out.to_str().unwrap(), text.to_str().unwrap());
    let below_a_file = format!("{text}/out");
    for (words, reason) in [
        (vec![out, "--size", "320"], "320x240"),
        (vec![out, "--size", "100000x2"], "must lie in"),
        (vec![out, "--texture", "foilage"], "did you mean 'foliage'"),
        (
            vec![out, "--image", "/nowhere/x.png"],
            "cannot read image /nowhere/x.png",
        ),
        (vec![out, "--image", text], "cannot read image"),
        (vec![out, "--background", "/nowhere/x.png"], "cannot read image"),
        (vec![out, "--box", "500x80"], "does not lie in"),
        (vec![out, "--speed", "300"], "--amplitude"),
        (vec![&below_a_file, "--frames", "1"], "cannot write"),
    ] {
        let message = synth(&words).unwrap_err().to_string();
        assert!(message.contains(reason), "{words:?}: {message}");
    }
    assert!(!Path::new(out).exists());
    assert!(synth(&[]).is_err() && synth(&[out, "--texture", "map", "--image", text]).is_err());
    let spec = SynthSpec {
        frames: 0,
        ..SynthSpec::default()
    };
    assert!(frames(&spec).is_err());
}
