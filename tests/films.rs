//! Films: files whose pictures are the frames of a sequence.

use crate::runs::{program, write_data};
use mtf_eval::dataset::{self, DatasetErrorKind, LoadOptions};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::borrow::Cow;
use std::fs;
use std::io::Cursor;
use std::path::Path;
use tiff::encoder::{TiffEncoder, colortype};

crate::tests! {
    a_film_is_tracked_as_its_pictures;
    films_are_found_by_name_folder_and_text;
    films_and_truth_that_do_not_belong_together;
    damaged_films_are_told;
    sixteen_bits_of_pages_become_eight_by_the_rule;
    a_film_that_changes_is_noticed;
}

const FRAMES: usize = 40;

/// The frames of `data/seq0` and its rows without names.
fn material(dir: &Path, frames: usize) -> (Vec<image::GrayImage>, String) {
    write_data(&dir.join("data"), &[frames]);
    let frame = |k| {
        image::open(dir.join(format!("data/seq0/frame{k:05}.png")))
            .unwrap()
            .into_luma8()
    };
    let text = fs::read_to_string(dir.join("data/seq0.txt")).unwrap();
    let row = |line: &str| line.split_once(' ').unwrap().1.to_owned() + "\n";
    (
        (1..=frames).map(frame).collect(),
        text.lines().skip(1).map(row).collect(),
    )
}

fn tiff(frames: &[image::GrayImage]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    for frame in frames {
        let (width, height) = frame.dimensions();
        encoder
            .write_image::<colortype::Gray8>(width, height, frame)
            .unwrap();
    }
    bytes.into_inner()
}

fn gif(frames: &[image::GrayImage]) -> Vec<u8> {
    let palette: Vec<u8> = (0..=255).flat_map(|v| [v; 3]).collect();
    let mut bytes = Vec::new();
    let (width, height) = (frames[0].width() as u16, frames[0].height() as u16);
    let mut encoder = gif::Encoder::new(&mut bytes, width, height, &palette).unwrap();
    for frame in frames {
        let frame = gif::Frame {
            width,
            height,
            buffer: Cow::Borrowed(frame.as_raw()),
            ..gif::Frame::default()
        };
        encoder.write_frame(&frame).unwrap();
    }
    drop(encoder);
    bytes
}

fn apng(frames: &[image::GrayImage]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, frames[0].width(), frames[0].height());
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_animated(frames.len() as u32, 0).unwrap();
    let mut writer = encoder.write_header().unwrap();
    for frame in frames {
        writer.write_image_data(frame.as_raw()).unwrap();
    }
    writer.finish().unwrap();
    bytes
}

/// Writes a folder with a film and its ground truth.
fn write_film(folder: &Path, name: &str, bytes: &[u8], truth: &str) {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join(name), bytes).unwrap();
    fs::write(folder.join("groundtruth.txt"), truth).unwrap();
}

/// The success curves of a run, without names.
fn curves(dir: &Path, data: &str, more: &[&str]) -> Vec<String> {
    let out = format!("out-{}{}", data.replace('/', "-"), more.concat());
    let args = [
        "run",
        data,
        "--ssm",
        "translation",
        "--sm",
        "esm,iclk",
        "--progress",
        "none",
        "-o",
        &out,
    ];
    program(dir).args(args).args(more).assert().success();
    let text = fs::read_to_string(dir.join(&out).join("curves.csv")).unwrap();
    let of_sequence = text.lines().skip(1).filter(|line| !line.contains("pooled"));
    let figures = |line: &str| {
        let names = data.split('/').chain(["seq0", "clip", "data"]);
        names.fold(line.to_owned(), |line, name| line.replace(name, ""))
    };
    of_sequence.map(figures).collect()
}

fn a_film_is_tracked_as_its_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (frames, rows) = material(dir, FRAMES);
    let reference = curves(dir, "data", &[]);
    assert!(!reference.is_empty());
    let restarts = ["--protocol", "every:7"];
    let restarted = curves(dir, "data", &restarts);
    for (name, bytes) in [
        ("clip.tif", tiff(&frames)),
        ("clip.gif", gif(&frames)),
        ("clip.png", apng(&frames)),
    ] {
        let data = format!("{}/clip", &name[5..]);
        write_film(&dir.join(&data), name, &bytes, &rows);
        assert_eq!(curves(dir, &data, &[]), reference, "{name}");
        // Trackers that start at several frames, and few frames at a time.
        assert_eq!(curves(dir, &data, &restarts), restarted, "{name}");
        program(dir)
            .args(["data", "check", &data])
            .assert()
            .success()
            .stderr(contains(format!(
                "1 sequence, {FRAMES} frames: 0 errors, 0 warnings"
            )));
    }
}

fn info(dir: &Path, data: &str) -> Vec<(String, String, u64)> {
    let output = program(dir)
        .args(["data", "info", data, "--format", "json"])
        .output()
        .unwrap();
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let text = |v: &serde_json::Value| v.as_str().unwrap_or_default().to_owned();
    let rows = told["datasets"][0]["sequences"]
        .as_array()
        .cloned()
        .unwrap_or_default();
    rows.iter()
        .map(|row| {
            (
                text(&row["dataset"]),
                text(&row["sequence"]),
                row["frames"].as_u64().unwrap(),
            )
        })
        .collect()
}

fn films_are_found_by_name_folder_and_text() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (frames, rows) = material(dir, 4);
    let named = |dataset: &str, sequence: &str, n| (dataset.to_owned(), sequence.to_owned(), n);
    // Alone in its folder, and named where there are other pictures.
    write_film(&dir.join("films/one"), "clip.gif", &gif(&frames), &rows);
    assert_eq!(info(dir, "films"), [named("films", "one", 4)]);
    assert_eq!(info(dir, "films/one/clip.gif"), [named("films", "one", 4)]);
    frames[0].save(dir.join("films/one/preview.png")).unwrap();
    assert_eq!(info(dir, "films/one/clip.gif"), [named("films", "one", 4)]);
    assert_eq!(
        info(&dir.join("films/one"), "clip.gif"),
        [named("films", "one", 4)]
    );
    program(dir)
        .args(["data", "info", "films/one/preview.png"])
        .assert()
        .code(2)
        .stderr(contains(
            "preview.png: not a folder, nor a file with several pictures",
        ));
    // Ground truth of its name beside each.
    let many = dir.join("many");
    fs::create_dir_all(&many).unwrap();
    fs::write(many.join("b2.png"), apng(&frames)).unwrap();
    fs::write(many.join("b10.tif"), tiff(&frames[..3])).unwrap();
    fs::write(many.join("b2.txt"), &rows).unwrap();
    let three: String = rows.split_inclusive('\n').take(3).collect();
    fs::write(many.join("b10.txt"), three).unwrap();
    assert_eq!(
        info(dir, "many"),
        [named("many", "b2", 4), named("many", "b10", 3)]
    );
    assert_eq!(info(dir, "many/b10.tif"), [named("many", "b10", 3)]);
    // Texts beside still pictures are something else.
    let stills = dir.join("stills");
    fs::create_dir_all(&stills).unwrap();
    for k in 0..3 {
        frames[k].save(stills.join(format!("{k}.png"))).unwrap();
        fs::write(stills.join(format!("{k}.txt")), "0 0.5 0.5 0.1 0.1").unwrap();
    }
    program(dir)
        .args(["data", "info", "stills"])
        .assert()
        .code(2)
        .stderr(contains("frames without ground truth"));
}

fn films_and_truth_that_do_not_belong_together() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (frames, rows) = material(dir, 5);
    let few: String = rows.split_inclusive('\n').take(3).collect();
    write_film(&dir.join("few"), "clip.tif", &tiff(&frames), &few);
    let one_line = |data: &str, told: &str| {
        program(dir)
            .args(["data", "check", data])
            .assert()
            .code(2)
            .stdout(contains(told).and(predicates::function::function(|out: &str| {
                out.lines().count() == 1
            })));
        program(dir)
            .args(["run", data])
            .assert()
            .code(2)
            .stderr(contains(told));
    };
    one_line("few", "3 rows of ground truth for 5 frames");
    // Pictures are counted from 1.
    program(dir)
        .args(["data", "info", "few", "--truth-start", "3"])
        .assert()
        .success();
    let mut pages = frames.clone();
    pages[2] = image::GrayImage::new(96, 80);
    write_film(&dir.join("sizes"), "clip.tif", &tiff(&pages), &rows);
    program(dir)
        .args(["data", "check", "sizes"])
        .assert()
        .code(2)
        .stdout(contains(
            "clip.tif#3: the frame is 96x80 pixels but the first is 96x72",
        ));
    program(dir)
        .args(["run", "sizes", "--on-bad-data", "skip"])
        .assert()
        .code(2)
        .stderr(contains("clip.tif#3: the frame is 96x80"));
}

fn damaged_films_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (frames, rows) = material(dir, 5);
    for (name, bytes) in [
        ("clip.tif", tiff(&frames)),
        ("clip.gif", gif(&frames)),
        ("clip.png", apng(&frames)),
    ] {
        let data = format!("cut-{}", &name[5..]);
        write_film(&dir.join(&data), name, &bytes[..bytes.len() * 3 / 4], &rows);
        let told = || contains(name).and(contains("truncated; copy it again"));
        let once = predicates::function::function(|out: &str| out.lines().count() == 1);
        program(dir)
            .args(["data", "check", &data])
            .assert()
            .code(2)
            .stdout(told().and(once));
        program(dir).args(["run", &data]).assert().code(2).stderr(told());
    }
}

fn sixteen_bits_of_pages_become_eight_by_the_rule() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (frames, rows) = material(dir, 6);
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    for frame in &frames {
        let deep: Vec<u16> = frame.as_raw().iter().map(|&v| 16 * u16::from(v)).collect();
        encoder.write_image::<colortype::Gray16>(96, 72, &deep).unwrap();
    }
    write_film(&dir.join("deep/clip"), "clip.tif", &bytes.into_inner(), &rows);
    program(dir)
        .args(["data", "check", "deep"])
        .assert()
        .success()
        .stdout(contains("clip.tif#1: warning: its 16 bits per channel leave"));
    let reference = curves(dir, "data", &[]);
    assert_eq!(curves(dir, "deep/clip", &["--depth16", "shift:4"]), reference);
}

fn a_film_that_changes_is_noticed() {
    let dir = tempfile::tempdir().unwrap();
    let (frames, rows) = material(dir.path(), 4);
    let folder = dir.path().join("film");
    let mut bytes = tiff(&frames);
    write_film(&folder, "clip.tif", &bytes, &rows);
    let load = || {
        dataset::load(&folder, &LoadOptions::default())
            .unwrap()
            .sequences
            .swap_remove(0)
    };
    let sequence = load();
    let before = sequence.fingerprint();
    assert_eq!(sequence.fingerprint_of_pixels().unwrap().len(), 64);
    let read = |s: &dataset::Sequence| (0..s.len()).try_for_each(|i| s.read(i, false).map(drop));
    read(&sequence).unwrap();
    // A pixel of the second page, in place and at the same time.
    let path = folder.join("clip.tif");
    let time = fs::metadata(&path).unwrap().modified().unwrap();
    let second = frames[1].as_raw();
    let at = bytes.windows(96).position(|w| w == &second[..96]).unwrap();
    bytes[at] ^= 1;
    fs::write(&path, &bytes).unwrap();
    fs::File::options()
        .write(true)
        .open(&path)
        .unwrap()
        .set_modified(time)
        .unwrap();
    let error = read(&sequence).unwrap_err();
    assert!(matches!(error.kind, DatasetErrorKind::Changed), "{error}");
    assert!(error.path.ends_with("clip.tif#4"), "{error}");
    // A selection ends earlier.
    let error = read(&sequence.truncated(3)).unwrap_err();
    assert!(error.path.ends_with("clip.tif#3"), "{error}");
    assert_ne!(load().fingerprint(), before);
    read(&load()).unwrap();
}
