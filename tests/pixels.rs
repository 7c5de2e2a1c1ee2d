//! Pictures that are not plain: turned by their tags, 16 bits deep, several in a file, JPEG as cameras leave it.

use crate::runs::{program, write_data};
use image::metadata::Orientation;
use image::{DynamicImage, ImageBuffer, ImageFormat, Luma};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use std::fs;
use std::io::Cursor;
use std::path::Path;

crate::tests! {
    pictures_are_turned_upright;
    sixteen_bits_become_eight_by_the_rule;
    files_of_several_pictures_are_told;
    jpeg_as_cameras_leave_it_is_read;
}

fn encode(picture: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// A copy of the dataset `from` as `to`, its frames made anew by `make`: their number and picture to bytes.
fn rewrite(from: &Path, to: &Path, make: &dyn Fn(usize, DynamicImage) -> Vec<u8>) {
    fs::create_dir_all(to.join("seq0")).unwrap();
    fs::copy(from.join("seq0.txt"), to.join("seq0.txt")).unwrap();
    for k in 1.. {
        let frame = format!("seq0/frame{k:05}.png");
        let Ok(picture) = image::open(from.join(&frame)) else {
            break;
        };
        // Formats are recognised by content.
        fs::write(to.join(&frame), make(k, picture)).unwrap();
    }
}

/// The figures of the run and what it said.
fn run(dir: &Path, data: &str, more: &[&str]) -> (String, String) {
    let out = format!("out-{data}{}", more.concat().replace(':', "-"));
    let args = [
        "run",
        data,
        "--ssm",
        "translation",
        "--progress",
        "none",
        "-o",
        &out,
    ];
    let assert = program(dir).args(args).args(more).assert().success();
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    let figures = fs::read_to_string(dir.join(&out).join("curves.csv")).unwrap();
    (figures.replace(data, "data"), said)
}

fn recorded(dir: &Path, out: &str) -> serde_json::Value {
    serde_json::from_slice(&fs::read(dir.join(out).join("run.json")).unwrap()).unwrap()
}

/// The mark of the Exif segment or chunk with an orientation.
fn exif(tag: u8) -> Vec<u8> {
    [
        b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".as_slice(),
        &[tag, 0, 0, 0, 0, 0, 0],
    ]
    .concat()
}

fn pictures_are_turned_upright() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8]);
    let reference = run(dir, "data", &[]).0;
    for tag in 2..=8 {
        let data = format!("tag{tag}");
        // The picture that the tag turns upright.
        let back = match Orientation::from_exif(tag).unwrap() {
            Orientation::Rotate90 => Orientation::Rotate270,
            Orientation::Rotate270 => Orientation::Rotate90,
            own => own,
        };
        rewrite(&dir.join("data"), &dir.join(&data), &|_, mut picture| {
            picture.apply_orientation(back);
            let mut bytes = Vec::new();
            let mut encoder = image::codecs::png::PngEncoder::new(&mut bytes);
            image::ImageEncoder::set_exif_metadata(&mut encoder, exif(tag)).unwrap();
            picture.write_with_encoder(encoder).unwrap();
            bytes
        });
        assert_eq!(run(dir, &data, &[]).0, reference, "{tag}");
        let noted = recorded(dir, &format!("out-{data}"))["noted"][0]["reasons"][0].to_string();
        assert!(noted.contains(&format!("orientation tag ({tag})")), "{noted}");
        program(dir)
            .args(["data", "check", &data])
            .assert()
            .success()
            .stderr(contains("0 warnings"));
    }
    // JPEG, some frames with a tag that leaves them as they are and some with one that turns them over.
    let jpeg = |tag: u8, picture: &DynamicImage| {
        let (bytes, exif) = (encode(picture, ImageFormat::Jpeg), exif(tag));
        let length = (exif.len() as u16 + 8).to_be_bytes();
        [
            &bytes[..2],
            &[0xff, 0xe1],
            &length,
            b"Exif\0\0",
            &exif,
            &bytes[2..],
        ]
        .concat()
    };
    rewrite(&dir.join("data"), &dir.join("jpeg"), &|k, picture| match k % 2 {
        0 => jpeg(1, &picture),
        _ => jpeg(3, &picture.rotate180()),
    });
    rewrite(&dir.join("data"), &dir.join("plain"), &|_, picture| {
        encode(&picture, ImageFormat::Jpeg)
    });
    let curve = |data: &str| run(dir, data, &[]).0.lines().last().unwrap().to_owned();
    assert_eq!(curve("jpeg"), curve("plain"));
    // Turned by some tags and not by others, frames have two sizes.
    rewrite(&dir.join("data"), &dir.join("mixed"), &|k, picture| {
        jpeg(if k == 4 { 6 } else { 1 }, &picture)
    });
    program(dir)
        .args(["data", "check", "mixed"])
        .assert()
        .code(2)
        .stdout(contains("72x96"));
}

fn sixteen_bits_become_eight_by_the_rule() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8]);
    let deep = |value: &dyn Fn(u8) -> u16, picture: &DynamicImage| -> DynamicImage {
        let gray = picture.to_luma8();
        ImageBuffer::from_fn(gray.width(), gray.height(), |x, y| {
            Luma([value(gray.get_pixel(x, y)[0])])
        })
        .into()
    };
    let reference = run(dir, "data", &[]).0;
    // 12 bits; counts of a thermal camera, with a dead pixel; all of 16 bits.
    rewrite(&dir.join("data"), &dir.join("twelve"), &|_, p| {
        encode(&deep(&|v| 16 * u16::from(v), &p), ImageFormat::Png)
    });
    rewrite(&dir.join("data"), &dir.join("counts"), &|_, p| {
        let mut deep = deep(&|v| 51_241 + 4 * u16::from(v), &p).into_luma16();
        deep.put_pixel(3, 3, Luma([65_535]));
        encode(&deep.into(), ImageFormat::Tiff)
    });
    rewrite(&dir.join("data"), &dir.join("whole"), &|_, p| {
        encode(&deep(&|v| 257 * u16::from(v), &p), ImageFormat::Pnm)
    });
    let sliver = "levels; stretch them with --depth16";
    for data in ["twelve", "counts"] {
        program(dir)
            .args(["data", "check", data])
            .assert()
            .success()
            .stdout(contains(sliver));
        let (_, said) = run(dir, data, &[]);
        assert!(said.contains(sliver), "{data}: {said}");
        assert!(
            recorded(dir, &format!("out-{data}"))["doubtful"]
                .to_string()
                .contains(sliver)
        );
    }
    let (figures, said) = run(dir, "twelve", &["--depth16", "shift:4"]);
    assert!(!said.contains(sliver), "{said}");
    assert_eq!(figures, reference);
    assert_eq!(recorded(dir, "out-twelve--depth16shift-4")["depth16"], "shift:4");
    let (figures, said) = run(dir, "whole", &[]);
    assert!(!said.contains("levels"), "{said}");
    assert_eq!(figures, reference);
    let (_, said) = run(dir, "twelve", &["--depth16", "minmax"]);
    assert!(!said.contains("levels"), "{said}");
    // Another rule gives other pixels: another experiment.
    program(dir)
        .args([
            "run",
            "twelve",
            "--ssm",
            "translation",
            "-o",
            "out-twelve",
            "--depth16",
            "minmax",
        ])
        .assert()
        .code(11)
        .stderr(contains("depth16 \"scale\" against \"minmax\""));
    program(dir)
        .args(["run", "twelve", "--depth16", "shift:12"])
        .assert()
        .code(2)
        .stderr(contains("from 0 to 8"));
}

fn files_of_several_pictures_are_told() {
    use tiff::encoder::{TiffEncoder, colortype::Gray8};
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[5]);
    rewrite(&dir.join("data"), &dir.join("pages"), &|_, picture| {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
        for _ in 0..2 {
            let gray = picture.to_luma8();
            encoder
                .write_image::<Gray8>(gray.width(), gray.height(), &gray)
                .unwrap();
        }
        bytes.into_inner()
    });
    rewrite(&dir.join("data"), &dir.join("moving"), &|k, picture| {
        let mut bytes = Vec::new();
        let frame = image::Frame::new(picture.to_rgba8());
        let frames = vec![frame; if k == 3 { 3 } else { 1 }];
        image::codecs::gif::GifEncoder::new(&mut bytes)
            .encode_frames(frames)
            .unwrap();
        bytes
    });
    let several = contains("frame00001.png: warning: the file holds several images")
        .and(contains("4 more frames likewise"));
    program(dir)
        .args(["data", "check", "pages"])
        .assert()
        .success()
        .stdout(several);
    let one =
        contains("frame00003.png: warning: the file holds several images").and(contains("likewise").not());
    program(dir)
        .args(["data", "check", "moving"])
        .assert()
        .success()
        .stdout(one);
    let (_, said) = run(dir, "pages", &[]);
    assert!(said.contains("the file holds several images"), "{said}");
}

fn jpeg_as_cameras_leave_it_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[8]);
    let jpeg = |picture: &DynamicImage| encode(picture, ImageFormat::Jpeg);
    rewrite(&dir.join("data"), &dir.join("plain"), &|_, picture| {
        jpeg(&picture)
    });
    let reference = run(dir, "plain", &[]).0.replace("plain", "data");
    // No end mark, half of one, zeros in its place; no Huffman tables.
    rewrite(&dir.join("data"), &dir.join("open"), &|k, picture| {
        let bytes = jpeg(&picture);
        match k {
            2 => bytes[..bytes.len() - 2].to_vec(),
            3 => bytes[..bytes.len() - 1].to_vec(),
            4 => [&bytes[..bytes.len() - 2], &[0; 100]].concat(),
            _ => bytes,
        }
    });
    rewrite(&dir.join("data"), &dir.join("motion"), &|_, picture| {
        let bytes = jpeg(&picture);
        let (mut bare, mut at) = (bytes[..2].to_vec(), 2);
        while bytes[at + 1] != 0xda {
            let end = at + 2 + usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
            if bytes[at + 1] != 0xc4 {
                bare.extend_from_slice(&bytes[at..end]);
            }
            at = end;
        }
        [&bare, &bytes[at..]].concat()
    });
    for (data, told) in [
        (
            "open",
            "frame00002.png: the JPEG image has no end mark; all of its data is there and was read (2 more frames",
        ),
        ("motion", "frame00001.png: the JPEG image has no Huffman tables"),
    ] {
        let (figures, said) = run(dir, data, &[]);
        assert_eq!(figures, reference, "{data}");
        assert!(said.contains(told), "{data}: {said}");
        program(dir)
            .args(["data", "check", data])
            .assert()
            .success()
            .stdout(contains(&told[16..40]));
    }
    // Half of the codes are gone: with an end mark or without, that is damage.
    for (data, end) in [("half", [0xff, 0xd9].as_slice()), ("cut", &[])] {
        rewrite(&dir.join("data"), &dir.join(data), &|k, picture| {
            let bytes = jpeg(&picture);
            match k {
                5 => [&bytes[..(bytes.len() + 623) / 2], end].concat(),
                _ => bytes,
            }
        });
        program(dir)
            .args(["data", "check", data])
            .assert()
            .code(2)
            .stdout(contains("frame00005.png: the JPEG image is truncated"));
    }
}
