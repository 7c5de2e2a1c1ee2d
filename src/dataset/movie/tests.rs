//! Pictures of files that are made here, with content that is known.

use super::super::storage::File;
use super::*;
use ::tiff::encoder::{TiffEncoder, colortype};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use std::borrow::Cow;

const WIDTH: usize = 20;
const HEIGHT: usize = 14;

/// Picture `k` in shades of gray.
fn shades(k: usize) -> Vec<u8> {
    let at = |i: usize| ((i % WIDTH) * 5 + (i / WIDTH) * 7 + 11 * k) as u8;
    (0..WIDTH * HEIGHT).map(at).collect()
}

/// A GIF file of frames with a palette of 256 shades of gray.
fn gif_of(frames: Vec<::gif::Frame<'_>>) -> Vec<u8> {
    let palette: Vec<u8> = (0..=255).flat_map(|v| [v; 3]).collect();
    let mut bytes = Vec::new();
    let mut encoder = ::gif::Encoder::new(&mut bytes, WIDTH as u16, HEIGHT as u16, &palette).unwrap();
    frames
        .iter()
        .for_each(|frame| encoder.write_frame(frame).unwrap());
    drop(encoder);
    bytes
}

fn gif_frame(k: usize) -> ::gif::Frame<'static> {
    ::gif::Frame {
        width: WIDTH as u16,
        height: HEIGHT as u16,
        buffer: Cow::Owned(shades(k)),
        ..::gif::Frame::default()
    }
}

/// A part of a picture: `value` from column 2, row 3 on, 4x5 pixels.
fn gif_patch(value: u8, dispose: ::gif::DisposalMethod, transparent: Option<u8>) -> ::gif::Frame<'static> {
    ::gif::Frame {
        left: 2,
        top: 3,
        width: 4,
        height: 5,
        dispose,
        transparent,
        buffer: Cow::Owned(vec![value; 20]),
        ..::gif::Frame::default()
    }
}

fn tiff_of(n: usize) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    for k in 0..n {
        let (w, h) = (WIDTH as u32, HEIGHT as u32);
        encoder.write_image::<colortype::Gray8>(w, h, &shades(k)).unwrap();
    }
    bytes.into_inner()
}

fn apng_of(n: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, WIDTH as u32, HEIGHT as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_animated(n as u32, 0).unwrap();
    let mut writer = encoder.write_header().unwrap();
    (0..n).for_each(|k| writer.write_image_data(&shades(k)).unwrap());
    writer.finish().unwrap();
    bytes
}

/// A file of each kind with `n` pictures.
fn every_kind(n: usize) -> [(&'static str, Vec<u8>); 3] {
    let gif = gif_of((0..n).map(gif_frame).collect());
    [("f.tif", tiff_of(n)), ("f.gif", gif), ("f.png", apng_of(n))]
}

fn movie(name: &str, bytes: &[u8]) -> Result<Option<Movie>, DatasetError> {
    Movie::of(&File::of(name, bytes.to_vec()))
}

fn gray(movie: &Movie, picture: usize) -> Vec<u8> {
    let pixels = movie.read(picture, false, Depth16::default(), true).unwrap();
    assert_eq!((pixels.width(), pixels.height()), (WIDTH, HEIGHT));
    pixels.gray().to_vec()
}

#[test]
fn pictures_are_frames_in_any_order() {
    for (name, bytes) in every_kind(5) {
        assert!(has_several(&bytes), "{name}");
        let movie = movie(name, &bytes).unwrap().unwrap();
        assert_eq!(movie.size(), (WIDTH, HEIGHT));
        assert_eq!(movie.remarks(), []);
        let names: Vec<String> = movie.frames().iter().map(|f| f.name().to_owned()).collect();
        assert_eq!(names, [1, 2, 3, 4, 5].map(|k| format!("{name}#{k}")));
        for k in [0, 1, 2, 3, 4, 3, 0, 4, 1, 1, 2] {
            assert_eq!(gray(&movie, k), shades(k), "{name} {k}");
        }
        assert!(movie.read(5, false, Depth16::default(), true).is_err(), "{name}");
        let checksum = XxHash64::oneshot(0, &bytes);
        assert_eq!(movie.checksum().unwrap(), checksum, "{name}");
    }
}

#[test]
fn one_picture_is_no_film() {
    for (name, bytes) in every_kind(1) {
        assert!(!has_several(&bytes), "{name}");
        assert!(movie(name, &bytes).unwrap().is_none(), "{name}");
    }
    assert!(movie("f.pgm", b"P5 1 1 255\n0").unwrap().is_none());
    assert!(movie("f.gif", b"").unwrap().is_none());
}

#[test]
fn readers_take_up_where_the_last_picture_was_and_are_few() {
    for (name, bytes) in every_kind(30) {
        let movie = movie(name, &bytes).unwrap().unwrap();
        let idle = || {
            movie
                .idle
                .lock()
                .unwrap()
                .iter()
                .map(|r| r.next)
                .collect::<Vec<_>>()
        };
        (0..10).for_each(|k| drop(gray(&movie, k)));
        assert_eq!(idle(), [10], "{name}");
        // Another tracker that starts later, and one that starts anew.
        gray(&movie, 20);
        assert_eq!(idle(), [21], "{name}");
        gray(&movie, 0);
        assert_eq!(idle(), [21, 1], "{name}");
        gray(&movie, 21);
        assert_eq!(idle(), [1, 22], "{name}");
        // The last one that is wanted.
        movie.read(22, false, Depth16::default(), false).unwrap();
        gray(&movie, 29);
        assert_eq!(idle(), [] as [usize; 0], "{name}");
        for k in (0..29).rev() {
            gray(&movie, k);
        }
        assert_eq!(idle().len(), IDLE, "{name}");
    }
}

#[test]
fn parts_of_a_gif_lie_over_what_was_left() {
    use ::gif::DisposalMethod::{Background, Keep, Previous};
    let bytes = gif_of(vec![
        gif_frame(0),
        gif_patch(200, Keep, None),
        gif_patch(100, Previous, None),
        gif_patch(7, Keep, Some(7)),
        gif_patch(50, Background, None),
        gif_patch(7, Keep, Some(7)),
    ]);
    let movie = movie("f.gif", &bytes).unwrap().unwrap();
    let with = |value: u8| {
        let mut expected = shades(0);
        for y in 3..8 {
            expected[y * WIDTH + 2..y * WIDTH + 6].fill(value);
        }
        expected
    };
    // Over it; until the next; what was there before; over it; nothing is left there, which is black.
    for (k, value) in [(1, 200), (2, 100), (3, 200), (4, 50), (5, 0)] {
        assert_eq!(gray(&movie, k), with(value), "{k}");
    }
}

#[test]
fn parts_of_an_apng_are_blended() {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 4, 2);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_animated(3, 0).unwrap();
    let mut writer = encoder.write_header().unwrap();
    let plain = |value: u8, alpha: u8, n: usize| [value, value, value, alpha].repeat(n);
    writer.write_image_data(&plain(100, 255, 8)).unwrap();
    writer.set_frame_dimension(2, 1).unwrap();
    writer.set_frame_position(1, 1).unwrap();
    writer.set_blend_op(png::BlendOp::Over).unwrap();
    writer.set_dispose_op(png::DisposeOp::Previous).unwrap();
    writer
        .write_image_data(&[plain(200, 255, 1), plain(200, 0, 1)].concat())
        .unwrap();
    writer.set_blend_op(png::BlendOp::Source).unwrap();
    writer.write_image_data(&plain(30, 255, 2)).unwrap();
    writer.finish().unwrap();
    let movie = movie("f.png", &bytes).unwrap().unwrap();
    for (k, row) in [(0, [100; 4]), (1, [100, 200, 100, 100]), (2, [100, 30, 30, 100])] {
        let pixels = movie.read(k, false, Depth16::default(), true).unwrap();
        assert_eq!(pixels.gray(), [[100; 4], row].concat(), "{k}");
    }
}

#[test]
fn the_still_picture_of_an_apng_may_be_no_frame() {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, WIDTH as u32, HEIGHT as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_animated(2, 0).unwrap();
    encoder.set_sep_def_img(true).unwrap();
    let mut writer = encoder.write_header().unwrap();
    for k in [9, 0, 1] {
        writer.write_image_data(&shades(k)).unwrap();
    }
    writer.finish().unwrap();
    let movie = movie("f.png", &bytes).unwrap().unwrap();
    assert_eq!(movie.frames().len(), 2);
    assert_eq!([0, 1].map(|k| gray(&movie, k)), [0, 1].map(shades));
}

#[test]
fn pages_have_colour_16_bits_and_turns_of_their_own() {
    let colour: Vec<u8> = (0..WIDTH * HEIGHT * 3).map(|i| (i * 7) as u8).collect();
    let deep: Vec<u16> = shades(1).iter().map(|&v| 16 * u16::from(v)).collect();
    let mut big = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new_big(&mut big).unwrap();
    let (w, h) = (WIDTH as u32, HEIGHT as u32);
    encoder.write_image::<colortype::RGB8>(w, h, &colour).unwrap();
    let mut page = encoder.new_image::<colortype::Gray16>(w, h).unwrap();
    page.encoder()
        .write_tag(::tiff::tags::Tag::Orientation, 3u16)
        .unwrap();
    page.write_data(&deep).unwrap();
    let movie = movie("f.tif", &big.into_inner()).unwrap().unwrap();
    assert_eq!(movie.remarks(), [Remark::Turned(3), Remark::SixteenBits]);
    let rule: Depth16 = "shift:4".parse().unwrap();
    let second = movie.read(1, true, rule, true).unwrap();
    let mut turned = shades(1);
    turned.reverse();
    assert_eq!((second.gray(), second.rgb()), (&turned[..], None));
    let first = movie.read(0, true, rule, true).unwrap();
    assert_eq!(first.rgb(), Some(&colour[..]));
}

#[test]
fn pages_that_lead_back_are_refused() {
    let mut bytes = tiff_of(2);
    let offsets = {
        let mut decoder = ::tiff::decoder::Decoder::new(Cursor::new(&bytes)).unwrap();
        let first = decoder.ifd_pointer().unwrap();
        let next = decoder.read_directory(first).unwrap().next().unwrap();
        [first.0, next.0]
    };
    let last = offsets[1] as usize;
    let entries = usize::from(u16::from_le_bytes([bytes[last], bytes[last + 1]]));
    let link = last + 2 + 12 * entries;
    bytes[link..link + 4].copy_from_slice(&(offsets[0] as u32).to_le_bytes());
    let error = movie("f.tif", &bytes).unwrap_err().to_string();
    assert!(error.contains("lead back"), "{error}");
}

#[test]
fn what_an_apng_announces_must_be_there() {
    let bytes = apng_of(3);
    // Without the last two chunks before the end: `fcTL` and `fdAT`.
    let at = |name: &[u8], n: usize| {
        let mut found = bytes.windows(4).enumerate().filter(|(_, w)| *w == name);
        found.nth(n).unwrap().0 - 4
    };
    let (control, end) = (at(b"fcTL", 2), at(b"IEND", 0));
    let short = [&bytes[..control], &bytes[end..]].concat();
    let error = movie("f.png", &short).unwrap_err().to_string();
    assert!(error.contains("announces 3 pictures and holds 2"), "{error}");
}

/// Reads what can be read of a file.
fn read_all(name: &str, bytes: &[u8]) -> Result<usize, DatasetError> {
    let Some(movie) = movie(name, bytes)? else {
        return Ok(0);
    };
    let frames = movie.frames().len();
    for k in 0..frames {
        let pixels = movie.read(k, true, Depth16::default(), true)?;
        assert_eq!(pixels.gray().len(), pixels.width() * pixels.height());
    }
    Ok(frames)
}

#[test]
fn what_is_cut_off_is_never_read_as_whole() {
    for (name, bytes) in every_kind(3) {
        assert_eq!(read_all(name, &bytes).unwrap(), 3);
        for length in 0..bytes.len() {
            // A first picture alone is read as a still one.
            let read = read_all(name, &bytes[..length]);
            assert!(!matches!(read, Ok(1..)), "{name} {length}: {read:?}");
        }
        let cut = read_all(name, &bytes[..bytes.len() - bytes.len() / 4]).unwrap_err();
        assert!(cut.to_string().contains("truncated; copy it again"), "{cut}");
    }
}

#[test]
fn huge_claims_are_refused() {
    let mut bytes = gif_of(vec![gif_frame(0), gif_frame(1)]);
    bytes[6..10].copy_from_slice(&[0x60, 0xea, 0x60, 0xea]);
    let error = movie("f.gif", &bytes).unwrap_err().to_string();
    assert!(error.contains("60000x60000"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn damaged_films_never_panic(which in 0usize..3, hits in 1usize..10, seed: u64) {
        let (name, mut bytes) = every_kind(3)[which].clone();
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        for _ in 0..hits {
            let at = rng.random_range(0..bytes.len());
            bytes[at] = rng.random_range(0..=255);
        }
        let _ = read_all(name, &bytes);
    }
}

/// A chunk of an AVI file.
fn chunk(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let padding: &[u8] = if content.len() % 2 == 1 { &[0] } else { &[] };
    [name, &(content.len() as u32).to_le_bytes()[..], content, padding].concat()
}

fn list(outer: &[u8; 4], name: &[u8; 4], chunks: &[Vec<u8>]) -> Vec<u8> {
    chunk(outer, &[&name[..], &chunks.concat()].concat())
}

/// Picture `k` as JPEG.
fn jpeg(k: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut bytes, 95);
    encoder
        .encode(
            &shades(k),
            WIDTH as u16,
            HEIGHT as u16,
            jpeg_encoder::ColorType::Luma,
        )
        .unwrap();
    bytes
}

/// A film of sound and pictures in the coding `coding`, the pictures in two lists as in long films.
fn avi_of(pictures: &[Vec<u8>], coding: &[u8; 4], height: usize) -> Vec<u8> {
    let strh = |kind: &[u8; 4]| chunk(b"strh", &[&kind[..], coding, &[0; 48]].concat());
    let bitmap = [40u32, WIDTH as u32, height as u32, 1 | 24 << 16];
    let mut strf: Vec<u8> = bitmap.iter().flat_map(|v| v.to_le_bytes()).collect();
    strf.extend(coding);
    strf.extend([0; 20]);
    let stream = |kind: &[u8; 4], strf: &[u8]| list(b"LIST", b"strl", &[strh(kind), chunk(b"strf", strf)]);
    let header = list(
        b"LIST",
        b"hdrl",
        &[
            chunk(b"avih", &[0; 56]),
            stream(b"auds", &[0; 18]),
            stream(b"vids", &strf),
        ],
    );
    let (first, second) = pictures.split_at(pictures.len() / 2);
    let movi = |pictures: &[Vec<u8>]| {
        let sound = chunk(b"00wb", &[1, 2, 3]);
        let chunks = pictures
            .iter()
            .map(|p| [sound.clone(), chunk(b"01dc", p)].concat());
        list(b"LIST", b"movi", &chunks.collect::<Vec<_>>())
    };
    [
        list(b"RIFF", b"AVI ", &[header, movi(first)]),
        list(b"RIFF", b"AVIX", &[movi(second)]),
    ]
    .concat()
}

#[test]
fn pictures_of_an_avi_are_its_jpegs() {
    let pictures: Vec<Vec<u8>> = (0..5).map(jpeg).collect();
    let film = |bytes: &[u8]| movie("f.avi", bytes);
    let found = film(&avi_of(&pictures, b"MJPG", HEIGHT)).unwrap().unwrap();
    assert_eq!((found.size(), found.frames().len()), ((WIDTH, HEIGHT), 5));
    for k in [0, 1, 4, 2, 2] {
        let expected = decode_by(&pictures[k], false, Depth16::default()).unwrap();
        assert_eq!(gray(&found, k), expected.gray(), "{k}");
    }
    // A picture without bytes is the one before it once more.
    let mut twice = pictures.clone();
    twice[3].clear();
    let found = film(&avi_of(&twice, b"mjpg", HEIGHT)).unwrap().unwrap();
    assert_eq!(gray(&found, 3), gray(&found, 2));
    // What cannot be read is told by what it is.
    let refused = |bytes: &[u8]| film(bytes).unwrap_err().to_string();
    let other = refused(&avi_of(&pictures, b"H264", HEIGHT));
    assert!(other.contains("coded as H264, not as Motion-JPEG"), "{other}");
    let interlaced = refused(&avi_of(&pictures, b"MJPG", 2 * HEIGHT));
    assert!(interlaced.contains("interlaced"), "{interlaced}");
}

proptest! {
    #[test]
    fn damaged_films_are_faults_or_films(cut in 0usize..4000, at in 0usize..400, value: u8) {
        let mut bytes = avi_of(&(0..4).map(jpeg).collect::<Vec<_>>(), b"MJPG", HEIGHT);
        bytes.truncate(bytes.len().saturating_sub(cut));
        if let Some(byte) = bytes.get_mut(at) {
            *byte = value;
        }
        if let Ok(Some(movie)) = movie("f.avi", &bytes) {
            for k in 0..movie.frames().len() {
                let _ = movie.read(k, true, Depth16::default(), true);
            }
        }
    }
}
