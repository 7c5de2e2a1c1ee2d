//! Formats, selections and fingerprints. Faults are tested in `tests/bad_input.rs`.

use super::*;
use mtf::geom::Corners;

const QUAD: [f64; 8] = [2.0, 2.0, 12.0, 2.0, 12.0, 9.0, 2.0, 9.0];

fn quad(i: usize) -> Corners {
    Corners::from_array(QUAD).translated(i as f64 * 0.25, 0.0)
}

fn row(i: usize, separator: &str) -> String {
    quad(i).to_array().map(|v| v.to_string()).join(separator)
}

/// Writes `names` as tiny images of different content.
fn write_frames(dir: &Path, names: &[String]) {
    std::fs::create_dir_all(dir).unwrap();
    for (i, name) in names.iter().enumerate() {
        let image = image::GrayImage::from_fn(20, 14, |x, y| image::Luma([(x * 3 + y * 5) as u8 + i as u8]));
        image.save(dir.join(name)).unwrap();
    }
}

fn names(n: usize) -> Vec<String> {
    (1..=n).map(|i| format!("frame{i:05}.png")).collect()
}

fn mtf_text(names: &[String]) -> String {
    let mut text = String::from("frame\tulx\tuly\turx\tury\tlrx\tlry\tllx\tlly\n");
    for (i, name) in names.iter().enumerate() {
        text += &format!("{name}\t{}\n", row(i, "\t"));
    }
    text
}

/// `root/seq` in the plainest layout.
fn write_sequence(dir: &Path, n: usize) {
    write_frames(dir, &names(n));
    std::fs::write(dir.join("groundtruth.txt"), mtf_text(&names(n))).unwrap();
}

fn load_all(path: &Path) -> Dataset {
    load(path, &LoadOptions::default()).unwrap()
}

fn ids(dataset: &Dataset) -> Vec<String> {
    dataset
        .sequences
        .iter()
        .map(|s| format!("{}/{}", s.dataset(), s.name()))
        .collect()
}

#[test]
fn a_folder_of_sequences_and_one_of_them() {
    let root = tempfile::tempdir().unwrap();
    let data = root.path().join("data");
    for name in ["s10", "s2"] {
        write_sequence(&data.join(name), 3);
    }
    let all = load_all(&data);
    assert_eq!(
        (all.name.as_str(), ids(&all)),
        ("data", vec!["data/s2".into(), "data/s10".into()])
    );
    let one = load_all(&data.join("s10"));
    assert_eq!(
        (one.name.as_str(), ids(&one)),
        ("data", vec!["data/s10".to_string()])
    );
    let sequence = &one.sequences[0];
    assert_eq!((sequence.len(), sequence.width(), sequence.height()), (3, 20, 14));
    assert_eq!(
        (sequence.frame_name(2), sequence.truth(2)),
        ("frame00003.png", Some(quad(2)))
    );
}

#[test]
fn ground_truth_beside_the_folder_with_and_without_actors() {
    let root = tempfile::tempdir().unwrap();
    for actor in ["TMT", "UCSB"] {
        let actor = root.path().join("db").join(actor);
        write_frames(&actor.join("seqA"), &names(2));
        std::fs::write(actor.join("seqA.txt"), mtf_text(&names(2))).unwrap();
        std::fs::write(actor.join("README.txt"), "words").unwrap();
    }
    let db = root.path().join("db");
    assert_eq!(ids(&load_all(&db)), ["TMT/seqA", "UCSB/seqA"]);
    assert_eq!(ids(&load_all(&db.join("TMT"))), ["TMT/seqA"]);
    let one = load_all(&db.join("TMT/seqA"));
    assert_eq!(
        (ids(&one), one.sequences[0].truth(1)),
        (vec!["TMT/seqA".to_string()], Some(quad(1)))
    );
}

#[test]
fn vot_and_otb_layouts() {
    let root = tempfile::tempdir().unwrap();
    let polygons = format!("{}\n{}\n", row(0, ","), row(1, ","));
    write_frames(&root.path().join("vot/color"), &names(2));
    std::fs::write(root.path().join("vot/groundtruth.txt"), &polygons).unwrap();
    write_frames(&root.path().join("plain"), &names(2));
    std::fs::write(root.path().join("plain/groundtruth.txt"), &polygons).unwrap();
    write_frames(&root.path().join("otb/img"), &names(2));
    std::fs::write(
        root.path().join("otb/groundtruth_rect.txt"),
        "3\t4\t5\t6\n3\t4\t5\t6\n",
    )
    .unwrap();
    let data = load_all(root.path());
    let truth: Vec<_> = data
        .sequences
        .iter()
        .map(|s| (s.name(), s.format(), s.truth(1).unwrap()))
        .collect();
    let expected = [
        ("otb", "otb", Corners::rect(2.5, 3.5, 5.0, 6.0)),
        ("plain", "folder", quad(1)),
        ("vot", "vot", quad(1).translated(-0.5, -0.5)),
    ];
    assert_eq!(truth, expected);
}

#[test]
fn homographies_carry_the_first_image_to_the_others() {
    let root = tempfile::tempdir().unwrap();
    for (set, matrices, images) in [
        ("hpatches", ["H_1_2", "H_1_10"], ["1.png", "2.png", "10.png"]),
        (
            "oxford",
            ["H1to2p", "H1to10p"],
            ["img1.png", "img2.png", "img10.png"],
        ),
    ] {
        let dir = root.path().join(set);
        write_frames(&dir, &images.map(String::from));
        std::fs::write(dir.join(matrices[0]), "1 0 3\n0 1 -2\n0 0 1\n").unwrap();
        std::fs::write(dir.join(matrices[1]), "2 0 0\n0 2 0\n0 0 4\n").unwrap();
    }
    let whole = Corners::rect(0.0, 0.0, 19.0, 13.0);
    let data = load_all(root.path());
    assert_eq!(data.sequences.len(), 2);
    for sequence in &data.sequences {
        let truth: Vec<_> = (0..3).map(|i| sequence.truth(i).unwrap()).collect();
        let expected = [
            whole,
            whole.translated(3.0, -2.0),
            Corners::rect(0.0, 0.0, 9.5, 6.5),
        ];
        assert_eq!((sequence.format(), &truth[..]), ("homographies", &expected[..]));
    }
    assert_ne!(data.sequences[0].fingerprint(), data.sequences[1].fingerprint());

    let dir = root.path().join("hpatches");
    std::fs::remove_file(dir.join("H_1_10")).unwrap();
    std::fs::write(dir.join("H_1_2"), "1 0 3 0 1 -2 0 0").unwrap();
    let faults = check(&dir, &LoadOptions::default()).faults;
    let messages: Vec<String> = faults.iter().map(ToString::to_string).collect();
    assert_eq!(messages.len(), 2, "{messages:?}");
    assert!(
        messages[0].contains("H_1_2: 8 numbers instead of 9"),
        "{messages:?}"
    );
    assert!(
        messages[1].contains("10.png: no homography leads to this image; "),
        "{messages:?}"
    );
}

#[test]
fn rows_are_matched_by_name_in_natural_order() {
    let root = tempfile::tempdir().unwrap();
    let names: Vec<String> = [3, 7, 20, 100].map(|i| format!("img{i}.png")).into();
    write_frames(root.path(), &names);
    std::fs::write(root.path().join("groundtruth.txt"), mtf_text(&names)).unwrap();
    let sequence = &load_all(root.path()).sequences[0];
    let found: Vec<&str> = (0..4).map(|i| sequence.frame_name(i)).collect();
    assert_eq!(found, names);
    assert_eq!(sequence.truth(3), Some(quad(3)));
}

#[test]
fn selections_keep_names_and_share_the_counter() {
    let root = tempfile::tempdir().unwrap();
    write_sequence(root.path(), 11);
    let options = LoadOptions {
        start: 1,
        frame_gap: 3,
        max_frames: Some(3),
        ..LoadOptions::default()
    };
    let sequence = &load(root.path(), &options).unwrap().sequences[0];
    let kept: Vec<(usize, &str)> = (0..sequence.len())
        .map(|i| (sequence.index(i), sequence.frame_name(i)))
        .collect();
    assert_eq!(
        kept,
        [
            (1, "frame00002.png"),
            (4, "frame00005.png"),
            (7, "frame00008.png")
        ]
    );
    assert_eq!(sequence.truth(2), Some(quad(7)));

    let whole = &load_all(root.path()).sequences[0];
    assert_eq!(whole.with_gap(3).len(), 4);
    assert_eq!(whole.with_gap(3).with_gap(2).index(1), 6);
    assert_eq!(whole.with_gap(2).from_frame(2).truncated(2).index(1), 6);
    assert_eq!(whole.from_frame(11).len() + whole.from_frame(99).len(), 0);
    assert_eq!(whole.with_gap(0).len(), 11);

    let (gray, colour) = (
        whole.read(0, false).unwrap(),
        whole.with_gap(5).clone().read(0, true).unwrap(),
    );
    assert_eq!(gray.gray(), colour.gray());
    assert_eq!((whole.decoded_count(), sequence.decoded_count()), (2, 0));
}

#[test]
fn tags_come_from_both_files() {
    let root = tempfile::tempdir().unwrap();
    write_sequence(root.path(), 2);
    std::fs::write(root.path().join("tags.txt"), "fast, blur\nplain\n").unwrap();
    std::fs::write(
        root.path().join("meta.json"),
        r#"{"note": 1, "tags": ["plain", "quick"]}"#,
    )
    .unwrap();
    let sequence = &load_all(root.path()).sequences[0];
    assert_eq!(sequence.tags(), ["fast", "blur", "plain", "quick"]);
    assert_eq!(
        sequence.file("tags.txt").unwrap().as_deref(),
        Some(&b"fast, blur\nplain\n"[..])
    );
    assert_eq!(sequence.file("nothing.txt").unwrap(), None);
}

#[test]
fn a_sequence_may_take_frames_of_another() {
    let root = tempfile::tempdir().unwrap();
    let (whole, part) = (root.path().join("data/whole"), root.path().join("data/whole-2"));
    write_sequence(&whole, 6);
    std::fs::write(whole.join("tags.txt"), "slow").unwrap();
    std::fs::write(whole.join("out_of_view.txt"), "0 0 1 0 0 0").unwrap();
    let dense: String = (0..6).map(|i| format!("{i},{i},2\n")).collect();
    std::fs::write(whole.join(DENSE_FILE), &dense).unwrap();
    std::fs::create_dir(&part).unwrap();
    let say = |meta: &str| std::fs::write(part.join("meta.json"), meta).unwrap();
    say(r#"{"frames_of": "whole", "step": 2, "tags": ["level-2"]}"#);
    let data = load_all(&root.path().join("data"));
    assert_eq!(ids(&data), ["data/whole", "data/whole-2"]);
    let (a, b) = (&data.sequences[0], &data.sequences[1]);
    assert_eq!(
        (b.len(), b.tags(), b.absent(), b.path()),
        (3, &["level-2".to_string()][..], 1, &*part)
    );
    for i in [0, 2] {
        assert_eq!(b.frame_name(i), a.frame_name(2 * i));
        assert_eq!(
            (b.truth(i), b.dense_truth(i)),
            (a.truth(2 * i), a.dense_truth(2 * i))
        );
        assert_eq!(
            b.read(i, false).unwrap().gray(),
            a.read(2 * i, false).unwrap().gray()
        );
    }
    assert_eq!(b.truth(1), None);
    assert_eq!(b.fingerprint(), a.with_gap(2).fingerprint());
    // By itself, and thinned further.
    let options = LoadOptions {
        frame_gap: 2,
        ..LoadOptions::default()
    };
    let alone = load(&part, &options).unwrap();
    assert_eq!(ids(&alone), ["data/whole-2"]);
    assert_eq!(alone.sequences[0].frame_name(1), a.frame_name(4));

    for (meta, word) in [
        (r#"{"frames_of": "other"}"#, "other"),
        (r#"{"frames_of": "whole-2"}"#, "whole-2"),
        (r#"{"frames_of": 3}"#, "frames_of: 3"),
        (r#"{"frames_of": "whole", "step": 0}"#, "step: 0"),
        (r#"{"frames_of": "whole", "step": "2"}"#, "step"),
    ] {
        say(meta);
        let fault = load(&root.path().join("data"), &LoadOptions::default())
            .unwrap_err()
            .to_string();
        assert!(
            fault.contains("whole-2/meta.json") && fault.contains(word),
            "{fault}"
        );
        let skip = LoadOptions {
            on_bad_data: OnBadData::Skip,
            ..LoadOptions::default()
        };
        let rest = load(&root.path().join("data"), &skip).unwrap();
        assert_eq!(
            (ids(&rest), rest.left_out.len()),
            (vec!["data/whole".to_string()], 1)
        );
    }
}

#[test]
fn the_fingerprint_is_of_the_data_alone() {
    let root = tempfile::tempdir().unwrap();
    let (a, b) = (root.path().join("a"), root.path().join("elsewhere/b"));
    for dir in [&a, &b] {
        write_sequence(dir, 5);
    }
    let of = |dir: &Path| load_all(dir).sequences[0].fingerprint();
    let pixels = |dir: &Path| load_all(dir).sequences[0].fingerprint_of_pixels().unwrap();
    let first = of(&a);
    assert_eq!((first.len(), first.clone(), pixels(&a)), (64, of(&b), pixels(&b)));
    let sequence = &load_all(&a).sequences[0];
    let mut all = vec![
        first.clone(),
        pixels(&a),
        sequence.with_gap(2).fingerprint(),
        sequence.truncated(4).fingerprint(),
    ];

    std::fs::write(b.join(super::DENSE_FILE), "0,1,2\n").unwrap();
    all.push(of(&b));
    std::fs::remove_file(b.join(super::DENSE_FILE)).unwrap();
    std::fs::write(b.join("groundtruth.txt"), mtf_text(&names(5)) + "\n").unwrap();
    all.push(of(&b));
    write_sequence(&b, 5);
    // Other pixels in a file of the same size.
    let pixel = |v: u8| {
        let image = image::GrayImage::from_pixel(20, 14, image::Luma([v]));
        let path = b.join("frame00003.bmp");
        image.save(&path).unwrap();
        std::fs::rename(path, b.join("frame00003.png")).unwrap();
        (of(&b), pixels(&b))
    };
    let (dark, light) = (pixel(10), pixel(200));
    all.extend([dark.0, dark.1, light.0, light.1]);
    let different: std::collections::BTreeSet<_> = all.iter().collect();
    assert_eq!(different.len(), all.len());
}

#[test]
fn sequences_can_be_shared_between_threads() {
    fn shared<T: Send + Sync + Clone>() {}
    shared::<Sequence>();
}

#[test]
fn embedded_sequences_load_like_those_on_disk() {
    if EMBEDDED.dirs().next().is_none() {
        println!("skipped: no embedded sequences");
        assert!(
            builtin()
                .unwrap_err()
                .to_string()
                .contains("no embedded sequences")
        );
        return;
    }
    let embedded = builtin().unwrap();
    let disk = load_all(&Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/builtin"));
    assert_eq!(embedded.name, BUILTIN);
    assert_eq!(ids(&embedded), ids(&disk));
    for (a, b) in embedded.sequences.iter().zip(&disk.sequences) {
        assert_eq!(a.fingerprint(), b.fingerprint(), "{}", a.name());
        assert!(a.read(a.len() - 1, true).is_ok());
    }
}
