//! `data convert`: datasets in the forms of others, from outside.

use crate::runs::{program, write_data};
use mtf_eval::dataset::{LoadOptions, Region, Sequence, load};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::path::Path;

crate::tests! {
    every_form_comes_back;
    what_a_form_has_no_place_for_is_told;
    a_film_becomes_pictures;
    what_cannot_be_written_leaves_nothing_behind;
}

fn sequences(path: &Path) -> Vec<Sequence> {
    load(path, &LoadOptions::default()).unwrap().sequences
}

/// Two sequences, the first with a tag, a frame without the object and one without annotation.
fn with_gaps(root: &Path) {
    write_data(root, &[5, 3]);
    let truth = root.join("seq0.txt");
    let text = fs::read_to_string(&truth).unwrap();
    let mut lines: Vec<String> = text.lines().map(String::from).collect();
    lines[3] = "frame00003.png nan nan nan nan nan nan nan nan".into();
    lines[4] = "frame00004.png not_annotated".into();
    fs::write(&truth, lines.join("\n")).unwrap();
    fs::write(root.join("seq0/tags.txt"), "mine blur").unwrap();
}

fn every_form_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    with_gaps(&dir.path().join("data"));
    let before = sequences(&dir.path().join("data"));
    for form in ["tmt", "vot", "corners", "planartrack", "pot"] {
        program(dir.path())
            .args(["data", "convert", "data", "--to", form, form])
            .assert()
            .success()
            .stderr(contains(format!("2 sequences, 8 frames in {form} as {form}")));
        let after = sequences(&dir.path().join(form));
        assert_eq!(after.len(), 2, "{form}");
        for (a, b) in before.iter().zip(&after) {
            assert_eq!(
                (a.name(), a.len(), a.tags()),
                (b.name(), b.len(), b.tags()),
                "{form}"
            );
            for i in 0..a.len() {
                assert_eq!(a.read(i, true).unwrap(), b.read(i, true).unwrap(), "{form} {i}");
                match (a.truth(i), b.truth(i)) {
                    (Some(a), Some(b)) => assert!(a.distance_squared(&b) < 1e-20, "{form} {i}: {a:?} {b:?}"),
                    (a, b) => assert_eq!(a, b, "{form} {i}"),
                }
            }
        }
        let absent = after[0].annotation(2).region == Region::Absent;
        assert!(absent, "{form}");
    }
    // Boxes that are upright come back, too.
    program(dir.path())
        .args(["data", "convert", "data", "--to", "otb", "otb"])
        .assert()
        .success();
    let after = sequences(&dir.path().join("otb"));
    for (a, b) in before.iter().zip(&after) {
        let corners = (0..a.len()).filter_map(|i| a.truth(i).zip(b.truth(i)));
        assert!(
            corners.clone().count() >= 3 && corners.into_iter().all(|(a, b)| a.distance_squared(&b) < 1e-20)
        );
    }
}

fn what_a_form_has_no_place_for_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    with_gaps(&data);
    let truth = data.join("seq1.txt");
    let tilted = fs::read_to_string(&truth).unwrap().replacen("20 15", "18 13", 1);
    fs::write(&truth, tilted).unwrap();
    program(dir.path())
        .args(["data", "convert", "data", "--to", "otb", "otb"])
        .assert()
        .success()
        .stderr(
            contains("seq1: 1 frames have corners that become the upright boxes around them").and(contains(
                "seq0: 1 frames without annotation become frames without the object",
            )),
        );
}

fn a_film_becomes_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("data/film");
    fs::create_dir_all(&folder).unwrap();
    let mut bytes = Vec::new();
    {
        let mut encoder = image::codecs::gif::GifEncoder::new(&mut bytes);
        for f in 0..3u32 {
            let pixel = |x: u32, y: u32| image::Rgba([(x * 5 + 20 * f) as u8, (y * 7) as u8, 40, 255]);
            encoder
                .encode_frame(image::Frame::new(image::RgbaImage::from_fn(48, 36, pixel)))
                .unwrap();
        }
    }
    fs::write(folder.join("film.gif"), bytes).unwrap();
    fs::write(
        folder.join("groundtruth.txt"),
        "10 10 30 10 30 25 10 25\n".repeat(3),
    )
    .unwrap();
    let before = sequences(&dir.path().join("data"));
    assert_eq!((before.len(), before[0].len()), (1, 3));
    for form in ["tmt", "corners"] {
        program(dir.path())
            .args(["data", "convert", "data", "--to", form, form])
            .assert()
            .success();
        let after = sequences(&dir.path().join(form));
        for i in 0..3 {
            assert_eq!(before[0].read(i, true).unwrap(), after[0].read(i, true).unwrap());
            assert_eq!(before[0].truth(i), after[0].truth(i));
        }
    }
}

fn what_cannot_be_written_leaves_nothing_behind() {
    let dir = tempfile::tempdir().unwrap();
    write_data(&dir.path().join("data"), &[3]);
    let convert = |to: &str, out: &str| {
        let mut command = program(dir.path());
        command.args(["data", "convert", "data", "--to", to, out]);
        command.assert()
    };
    convert("tmt", "data")
        .code(2)
        .stderr(contains("data: there already"));
    convert("nothing", "out")
        .code(2)
        .stderr(contains("tmt, vot, otb, pot, planartrack, corners"));
    // A frame of another format, of which VOT has no name.
    let frame = dir.path().join("data/seq0/frame00002.png");
    image::open(&frame)
        .unwrap()
        .save(frame.with_extension("bmp"))
        .unwrap();
    fs::remove_file(&frame).unwrap();
    convert("vot", "out")
        .code(2)
        .stderr(contains("data/seq0: frames of several formats"));
    fs::write(frame.with_extension("bmp"), "no image").unwrap();
    convert("vot", "out").code(2);
    let left: Vec<_> = fs::read_dir(dir.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert_eq!(left, ["data"]);
}
