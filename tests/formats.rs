//! Data sets of the field as they lie on disk after unpacking: each is found and read as the page `docs/datasets.md` says, and
//! refused with one line where it is malformed.

use crate::runs::program;
use mtf::geom::Corners;
use mtf_eval::dataset::{self, Dataset, LoadOptions, Reading, Region, Sequence};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

crate::tests! {
    each_is_read_as_the_page_says;
    each_malformed_one_is_told_in_one_line;
    each_is_tracked;
    the_page_has_a_row_for_each;
    masks_are_refused_with_a_hint;
    a_polygon_of_many_points_is_fitted_on_request;
    videos_and_archives_are_named_with_the_way_to_unpack_them;
    test_sets_have_the_first_row_alone;
    lists_of_frames_hold_where_rows_are_as_many;
    labels_of_every_second_frame_in_either_form;
    a_frame_more_than_rows_is_said;
    attributes_and_splits_are_tags;
    frames_have_words;
    names_decide_between_formats;
    an_unknown_layout_is_told_with_the_nearest;
}

/// Frames of a sample.
const FRAMES: usize = 5;
/// Four corners, and a box, as rows have them.
const QUAD: &str = "5 6 25 6 25 21 5 21";
const BOX: &str = "5,6,20,15";

/// The corners that they mean: pixel centres at integers, and the origin at the corner of the first pixel.
const AT_CENTRE: [f64; 8] = [5.0, 6.0, 25.0, 6.0, 25.0, 21.0, 5.0, 21.0];
const AT_CORNER: [f64; 8] = [4.5, 5.5, 24.5, 5.5, 24.5, 20.5, 4.5, 20.5];

/// A data set of the page.
struct Layout {
    /// Its name there.
    data: &'static str,
    /// Writes a tiny one.
    make: fn(&Path),
    /// What is found in it.
    expected: &'static [Expected],
    /// Three ways to spoil it, and what is said of each.
    bad: [(fn(&Path), &'static str); 3],
}

/// A sequence.
struct Expected {
    /// Its dataset and name.
    id: &'static str,
    format: &'static str,
    /// For each frame: `c` corners, `a` absent, `-` not annotated.
    frames: &'static str,
    /// Corners of the first frame that has any.
    first: [f64; 8],
    tags: &'static [&'static str],
}

const fn expected(
    id: &'static str,
    format: &'static str,
    frames: &'static str,
    first: [f64; 8],
    tags: &'static [&'static str],
) -> Expected {
    Expected {
        id,
        format,
        frames,
        first,
        tags,
    }
}

fn write(path: impl AsRef<Path>, content: impl AsRef<[u8]>) {
    let path = path.as_ref();
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, content).unwrap();
}

/// An image with texture, the same in every frame.
fn image(path: impl AsRef<Path>) {
    static IMAGE: OnceLock<Vec<u8>> = OnceLock::new();
    let bytes = IMAGE.get_or_init(|| {
        let wave =
            |x: u32, y: u32| (f64::from(x) / 3.0).sin() + (f64::from(y) / 4.0 + f64::from(x) / 9.0).cos();
        let image =
            image::GrayImage::from_fn(48, 36, |x, y| image::Luma([(128.0 + 50.0 * wave(x, y)) as u8]));
        let mut bytes = std::io::Cursor::new(vec![]);
        image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    });
    write(path, bytes);
}

/// Frames `1` to `FRAMES` in the folder, each called by `name`.
fn images(folder: impl AsRef<Path>, name: fn(usize) -> String) {
    (1..=FRAMES).for_each(|i| image(folder.as_ref().join(name(i))));
}

fn frame5(i: usize) -> String {
    format!("frame{i:05}.jpg")
}
fn four(i: usize) -> String {
    format!("{i:04}.jpg")
}
fn five(i: usize) -> String {
    format!("{i:05}.jpg")
}
fn six(i: usize) -> String {
    format!("{i:06}.jpg")
}
fn eight(i: usize) -> String {
    format!("{i:08}.jpg")
}

fn lines(rows: &[&str]) -> String {
    rows.join("\n") + "\n"
}

/// The row in every frame.
fn all(row: &str) -> String {
    lines(&[row; FRAMES])
}

/// The row after the name of each frame.
fn named(name: fn(usize) -> String, row: &str) -> String {
    let row = |i| format!("{} {row}\n", name(i));
    (1..=FRAMES).map(row).collect()
}

/// Replaces a text in a file.
fn edit(path: impl AsRef<Path>, from: &str, to: &str) {
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "no {from} in {text}");
    fs::write(path, text.replacen(from, to, 1)).unwrap();
}

/// Appends a line to a file.
fn append(path: impl AsRef<Path>, line: &str) {
    let text = fs::read_to_string(&path).unwrap();
    fs::write(path, format!("{text}{line}\n")).unwrap();
}

/// Leaves the first line of a file out.
fn cut(path: impl AsRef<Path>) {
    let text = fs::read_to_string(&path).unwrap();
    fs::write(path, text.split_once('\n').unwrap().1).unwrap();
}

const LAYOUTS: &[Layout] = &[
    Layout {
        data: "TMT, UCSB, LinTrack, PAMI, CMT",
        make: |root| {
            images(root.join("TMT/nl_bookI_s3"), frame5);
            let header = "frame ulx uly urx ury lrx lry llx lly\n";
            write(
                root.join("TMT/nl_bookI_s3.txt"),
                header.to_owned() + &named(frame5, QUAD),
            );
        },
        expected: &[expected("TMT/nl_bookI_s3", "mtf", "ccccc", AT_CENTRE, &[])],
        bad: [
            (
                |root| edit(root.join("TMT/nl_bookI_s3.txt"), " 5 21", " 5"),
                "nl_bookI_s3.txt:2: 7 numbers instead of 8; ",
            ),
            (
                |root| edit(root.join("TMT/nl_bookI_s3.txt"), " 25", " x"),
                "nl_bookI_s3.txt:2: `x` is not a number; ",
            ),
            (
                |root| {
                    append(
                        root.join("TMT/nl_bookI_s3.txt"),
                        &format!("frame00009.jpg {QUAD}"),
                    )
                },
                "nl_bookI_s3.txt:7: there is no frame `frame00009.jpg`; ",
            ),
        ],
    },
    Layout {
        data: "POT-210, POT-280",
        make: |root| {
            images(root.join("V01/V01_5"), four);
            let nan = ["nan"; 8].join(" ");
            write(
                root.join("annotation/V01_5_gt_points.txt"),
                lines(&[QUAD, QUAD, &nan, QUAD, &nan]),
            );
            write(root.join("annotation/V01_5_flag.txt"), "0\n0\n0\n1\n0\n");
            write(
                root.join("annotation/V01_5_gt_homography.txt"),
                all("1 0 0 0 1 0 0 0 1"),
            );
        },
        expected: &[expected("V01/V01_5", "pot", "cc-a-", AT_CENTRE, &["occlusion"])],
        bad: [
            (
                |root| write(root.join("annotation/V01_5_flag.txt"), "0\n0\n"),
                "V01_5_flag.txt: 2 flags for 5 frames; ",
            ),
            (
                |root| cut(root.join("annotation/V01_5_gt_points.txt")),
                "4 rows of ground truth for 5 frames; ",
            ),
            (
                |root| {
                    edit(
                        root.join("annotation/V01_5_gt_points.txt"),
                        QUAD,
                        "5 6 25 21 25 6 5 21",
                    )
                },
                "V01_5_gt_points.txt:1: the quadrilateral is not convex; ",
            ),
        ],
    },
    Layout {
        data: "PlanarTrack",
        make: |root| {
            images(root.join("sequences/Seq_00001"), eight);
            let zeros = ["0.000000"; 8].join(" ");
            write(
                root.join("annos/Seq_00001.txt"),
                lines(&[QUAD, QUAD, &zeros, &zeros, QUAD]),
            );
            write(root.join("annos/Seq_00001_flag.txt"), "0\n0\n0\n2\n0\n");
            write(
                root.join("annos/Seq_00001_homography.txt"),
                all("1 0 0 0 1 0 0 0 1"),
            );
            write(
                root.join("challenging_factor/Seq_00001_challenging_factor.txt"),
                "0,1,0,0,0,1,0,0\n",
            );
            write(
                root.join("training-test-splits/test_seq.txt"),
                "Seq_00001\nSeq_00002\n",
            );
            write(root.join("training-test-splits/training_set.txt"), "Seq_00003\n");
        },
        expected: &[expected(
            "sequences/Seq_00001",
            "planartrack",
            "cc-ac",
            AT_CENTRE,
            &["motion-blur", "out-of-view", "test"],
        )],
        bad: [
            (
                |root| append(root.join("annos/Seq_00001_flag.txt"), "0"),
                "Seq_00001_flag.txt: 6 flags for 5 frames; ",
            ),
            (
                |root| {
                    write(
                        root.join("challenging_factor/Seq_00001_challenging_factor.txt"),
                        "0,1",
                    )
                },
                "Seq_00001_challenging_factor.txt: warning: 2 numbers instead of 8; ",
            ),
            (
                |root| append(root.join("annos/Seq_00001.txt"), QUAD),
                "Seq_00001.txt:6: 6 rows of ground truth for 5 frames; ",
            ),
        ],
    },
    Layout {
        data: "POIC",
        make: |root| {
            images(root.join("sequences/bear"), frame5);
            let header = "frame ulx uly urx ury lrx lry llx lly\n";
            write(root.join("gt/bear.txt"), header.to_owned() + &named(frame5, QUAD));
            image(root.join("Templates/bear.png"));
        },
        expected: &[expected("sequences/bear", "poic", "ccccc", AT_CENTRE, &[])],
        bad: [
            (
                |root| edit(root.join("gt/bear.txt"), "frame00002", "frame00001"),
                "bear.txt:3: a second row for frame `frame00001.jpg`; ",
            ),
            (
                |root| edit(root.join("gt/bear.txt"), &format!("frame00003.jpg {QUAD}\n"), ""),
                "bear.txt: no row for frame `frame00003.jpg`; ",
            ),
            (
                |root| write(root.join("gt/bear.txt"), named(frame5, "1 2 3 4 5 6")),
                "bear.txt:1: rows of 6 numbers; expected ",
            ),
        ],
    },
    Layout {
        data: "MPOT-3K",
        make: |root| {
            let video = root.join("val/gallery2-4");
            images(video.join("seq1"), six);
            let quad = "5,6,25,6,25,21,5,21";
            let rows = [
                format!("1,1,{quad},6,1"),
                format!("2,1,{quad},6,1"),
                format!("4,1,{quad},6,1"),
                format!("3,2,{quad},6,2"),
                format!("4,2,{quad},6,2"),
            ];
            write(video.join("gt/gt_obj.txt"), rows.join("\n"));
            write(
                video.join("gt/gt_obj_init.txt"),
                format!("{}\n{}\n", rows[0], rows[3]),
            );
            write(video.join("seqinfo.ini"), "[Sequence]\nname=gallery2-4\n");
            write(root.join("list/val.txt"), "gallery2-4\n");
        },
        expected: &[
            expected(
                "val/gallery2-4-1",
                "mpot",
                "cc-c",
                AT_CENTRE,
                &["val", "in-plane-movement"],
            ),
            expected(
                "val/gallery2-4-2",
                "mpot",
                "cc",
                AT_CENTRE,
                &["val", "in-plane-movement"],
            ),
        ],
        bad: [
            (
                |root| {
                    append(
                        root.join("val/gallery2-4/gt/gt_obj.txt"),
                        "\n99,1,5,6,25,6,25,21,5,21,6,1",
                    )
                },
                "gt_obj.txt:6: there is no frame `99`; ",
            ),
            (
                |root| {
                    append(
                        root.join("val/gallery2-4/gt/gt_obj.txt"),
                        "\n2,1,5,6,25,6,25,21,5,21,6,1",
                    )
                },
                "gt_obj.txt:6: a second row for frame `2`; ",
            ),
            (
                |root| {
                    write(
                        root.join("val/gallery2-4/gt/gt_obj.txt"),
                        "1,1,5,6,25,6,25,21,5,21,6\n",
                    )
                },
                "gt_obj.txt:1: 11 numbers instead of 12; ",
            ),
        ],
    },
    Layout {
        data: "HPatches",
        make: |root| {
            (1..=3).for_each(|i| image(root.join(format!("v_wall/{i}.ppm"))));
            write(root.join("v_wall/H_1_2"), "1 0 2\n0 1 1\n0 0 1\n");
            write(root.join("v_wall/H_1_3"), "1 0 4\n0 1 2\n0 0 1\n");
        },
        expected: &[expected(
            "DATA/v_wall",
            "homographies",
            "ccc",
            [0.0, 0.0, 47.0, 0.0, 47.0, 35.0, 0.0, 35.0],
            &[],
        )],
        bad: [
            (
                |root| write(root.join("v_wall/H_1_2"), "1 0 2\n0 1 1\n0 0"),
                "H_1_2: 8 numbers instead of 9; ",
            ),
            (
                |root| write(root.join("v_wall/H_1_2"), "1 0 x 0 1 1 0 0 1"),
                "H_1_2: `x` is not a number; ",
            ),
            (
                |root| fs::remove_file(root.join("v_wall/H_1_3")).unwrap(),
                "3.ppm: no homography leads to this image; ",
            ),
        ],
    },
    Layout {
        data: "Oxford affine",
        make: |root| {
            (1..=3).for_each(|i| image(root.join(format!("graf/img{i}.ppm"))));
            write(root.join("graf/H1to2p"), "1 0 2\n0 1 1\n0 0 1\n");
            write(root.join("graf/H1to3p"), "1 0 4\n0 1 2\n0 0 1\n");
        },
        expected: &[expected(
            "DATA/graf",
            "homographies",
            "ccc",
            [0.0, 0.0, 47.0, 0.0, 47.0, 35.0, 0.0, 35.0],
            &[],
        )],
        bad: [
            (
                |root| append(root.join("graf/H1to2p"), "1"),
                "H1to2p: 10 numbers instead of 9; ",
            ),
            (
                |root| write(root.join("graf/H1to2p"), "0 0 0 0 0 0 0 0 0"),
                "H1to2p: a coordinate is not finite; ",
            ),
            (
                |root| image(root.join("graf/img4.ppm")),
                "img4.ppm: no homography leads to this image; ",
            ),
        ],
    },
    Layout {
        data: "VOT 2013 to 2022",
        make: |root| {
            images(root.join("bag/color"), eight);
            write(
                root.join("bag/groundtruth.txt"),
                lines(&[
                    "5,6,25,6,25,21,5,21",
                    "0",
                    BOX_AS_QUAD,
                    "nan,nan,nan,nan",
                    BOX_AS_QUAD,
                ]),
            );
            write(root.join("bag/occlusion.tag"), "0\n1\n0\n0\n0\n");
            write(root.join("bag/practical.value"), "0.4\n");
            write(root.join("list.txt"), "bag\n");
        },
        expected: &[expected("DATA/bag", "vot", "c-cac", AT_CORNER, &[])],
        bad: [
            (
                |root| edit(root.join("bag/groundtruth.txt"), ",5,21", ",5"),
                "groundtruth.txt:1: 7 numbers instead of 8; ",
            ),
            (
                |root| edit(root.join("bag/groundtruth.txt"), "0\n", "m0,0,4,4,0,16\n"),
                "groundtruth.txt:2: the object is a mask, where four corners are tracked; `--fit-masks` ",
            ),
            (
                |root| {
                    edit(
                        root.join("bag/groundtruth.txt"),
                        "0\n",
                        "5,6,25,6,30,12,25,21,5,21\n",
                    )
                },
                "groundtruth.txt:2: the object is a polygon of more than four points, where ",
            ),
        ],
    },
    Layout {
        data: "VOT-LT",
        make: |root| {
            images(root.join("ballet/color"), eight);
            write(
                root.join("ballet/groundtruth.txt"),
                lines(&[BOX, BOX, "nan,nan,nan,nan", BOX, BOX]),
            );
            write(
                root.join("ballet/sequence"),
                "channels.color=color/%08d.jpg\nfps=30\n",
            );
            write(root.join("list.txt"), "ballet\n");
        },
        expected: &[expected("DATA/ballet", "vot", "ccacc", AT_CORNER, &[])],
        bad: [
            (
                |root| cut(root.join("ballet/groundtruth.txt")),
                "4 rows of ground truth for 5 frames; ",
            ),
            (
                |root| edit(root.join("ballet/groundtruth.txt"), "20", "x"),
                "groundtruth.txt:1: `x` is not a number; ",
            ),
            (
                |root| write(root.join("ballet/absent.tag"), "0\n1\n"),
                "absent.tag: 2 flags for 5 frames; ",
            ),
        ],
    },
    Layout {
        data: "VOTS",
        make: |root| {
            images(root.join("animal/color"), eight);
            write(root.join("animal/sequence"), "channels.color=color/%08d.jpg\n");
            // Twenty by fifteen pixels, all of them.
            write(
                root.join("animal/groundtruth_1.txt"),
                lines(&["m5,6,20,15,0,300", "m6,6,20,15,0,300", "m0,0,0,0,0"]),
            );
            write(root.join("animal/groundtruth_dog.txt"), "m5,6,20,15,0,300\n");
            write(root.join("list.txt"), "animal\n");
        },
        expected: &[
            expected(
                "DATA/animal-1",
                "vot",
                "cca--",
                [4.5, 5.5, 24.5, 5.5, 24.5, 20.5, 4.5, 20.5],
                &[],
            ),
            expected(
                "DATA/animal-dog",
                "vot",
                "c----",
                [4.5, 5.5, 24.5, 5.5, 24.5, 20.5, 4.5, 20.5],
                &[],
            ),
        ],
        bad: [
            (
                |root| edit(root.join("animal/groundtruth_1.txt"), "300", "301"),
                "groundtruth_1.txt:1: the runs of a mask do not fit its box of 20 x 15 pixels; ",
            ),
            (
                |root| {
                    edit(
                        root.join("animal/groundtruth_1.txt"),
                        "m5,6,20,15,0,300",
                        "m5,6,20",
                    )
                },
                "groundtruth_1.txt:1: a mask of 3 numbers; ",
            ),
            (
                |root| edit(root.join("animal/groundtruth_dog.txt"), "20", "x"),
                "groundtruth_dog.txt:1: `x` is not a number; ",
            ),
        ],
    },
    Layout {
        data: "OTB",
        make: |root| {
            images(root.join("Jogging/img"), four);
            write(root.join("Jogging/groundtruth_rect.1.txt"), all("5\t6\t20\t15"));
            write(root.join("Jogging/groundtruth_rect.2.txt"), all("6\t6\t20\t15"));
            (298..=302).for_each(|i| image(root.join("David/img").join(four(i))));
            write(root.join("David/groundtruth_rect.txt"), lines(&[BOX; 3]));
        },
        expected: &[
            expected("DATA/David", "otb", "ccc", AT_CORNER, DAVID),
            expected("DATA/Jogging-1", "otb", "ccccc", AT_CORNER, JOGGING),
            expected(
                "DATA/Jogging-2",
                "otb",
                "ccccc",
                [5.5, 5.5, 25.5, 5.5, 25.5, 20.5, 5.5, 20.5],
                JOGGING,
            ),
        ],
        bad: [
            (
                |root| cut(root.join("David/groundtruth_rect.txt")),
                "2 rows of ground truth for 5 frames; ",
            ),
            (
                |root| edit(root.join("Jogging/groundtruth_rect.2.txt"), "20\t15", "0\t0"),
                "groundtruth_rect.2.txt:1: the quadrilateral has zero area; ",
            ),
            (
                |root| edit(root.join("Jogging/groundtruth_rect.1.txt"), "20", "x"),
                "groundtruth_rect.1.txt:1: `x` is not a number; ",
            ),
        ],
    },
    Layout {
        data: "LaSOT",
        make: |root| {
            let dir = root.join("airplane/airplane-1");
            images(dir.join("img"), eight);
            write(dir.join("groundtruth.txt"), all(BOX));
            write(dir.join("full_occlusion.txt"), "0,0,1,0,0");
            write(dir.join("out_of_view.txt"), "0,0,0,1,0");
            write(dir.join("nlp.txt"), "white airplane landing on ground\n");
            write(root.join("testing_set.txt"), "airplane-1\nbasketball-6\n");
        },
        expected: &[expected(
            "airplane/airplane-1",
            "lasot",
            "ccaac",
            AT_CORNER,
            &["test"],
        )],
        bad: [
            (
                |root| write(root.join("airplane/airplane-1/out_of_view.txt"), "0,0"),
                "out_of_view.txt: 2 flags for 5 frames; ",
            ),
            (
                |root| append(root.join("airplane/airplane-1/groundtruth.txt"), BOX),
                "groundtruth.txt:6: 6 rows of ground truth for 5 frames; ",
            ),
            (
                |root| fs::remove_dir_all(root.join("airplane/airplane-1/img")).unwrap(),
                "groundtruth.txt: no frames ",
            ),
        ],
    },
    Layout {
        data: "GOT-10k",
        make: |root| {
            let dir = root.join("val/GOT-10k_Val_000001");
            images(&dir, eight);
            write(dir.join("groundtruth.txt"), all(BOX));
            write(dir.join("absence.label"), "0\n0\n1\n0\n0\n");
            write(dir.join("cover.label"), "8\n8\n0\n8\n8\n");
            write(dir.join("cut_by_image.label"), "0\n1\n0\n0\n0\n");
            write(
                dir.join("meta_info.ini"),
                "[METAINFO]\nanno_fps: 10Hz\nobject_class: sea turtle\nmotion_class: swimming\n",
            );
            write(root.join("val/list.txt"), "GOT-10k_Val_000001\n");
            let test = root.join("test/GOT-10k_Test_000001");
            images(&test, eight);
            write(test.join("groundtruth.txt"), BOX);
            write(root.join("test/list.txt"), "GOT-10k_Test_000001\n");
        },
        expected: &[
            expected(
                "test/GOT-10k_Test_000001",
                "got10k",
                "c----",
                AT_CORNER,
                &["test"],
            ),
            expected(
                "val/GOT-10k_Val_000001",
                "got10k",
                "ccacc",
                AT_CORNER,
                &["val", "sea-turtle", "swimming"],
            ),
        ],
        bad: [
            (
                |root| write(root.join("val/GOT-10k_Val_000001/absence.label"), "0\n1\n"),
                "absence.label: 2 flags for 5 frames; ",
            ),
            (
                |root| write(root.join("val/GOT-10k_Val_000001/cut_by_image.label"), "0\n1\n"),
                "cut_by_image.label: warning: 2 values for 5 frames, which are not used; ",
            ),
            (
                |root| {
                    write(
                        root.join("test/GOT-10k_Test_000001/groundtruth.txt"),
                        format!("{BOX}\n{BOX}\n"),
                    )
                },
                "groundtruth.txt:2: 2 rows of ground truth for 5 frames; ",
            ),
        ],
    },
    Layout {
        data: "TrackingNet",
        make: |root| {
            images(root.join("TRAIN_0/frames/a_b_0"), |i| format!("{}.jpg", i - 1));
            write(root.join("TRAIN_0/anno/a_b_0.txt"), all(BOX));
            images(root.join("TEST/frames/c_d_1"), |i| format!("{}.jpg", i - 1));
            write(root.join("TEST/anno/c_d_1.txt"), BOX);
        },
        expected: &[
            expected("TEST/c_d_1", "trackingnet", "c----", AT_CORNER, &[]),
            expected("TRAIN_0/a_b_0", "trackingnet", "ccccc", AT_CORNER, &[]),
        ],
        bad: [
            (
                |root| {
                    fs::remove_dir_all(root.join("TRAIN_0/frames")).unwrap();
                    write(root.join("TRAIN_0/zips/a_b_0.zip"), "PK");
                },
                "a_b_0.zip`, which is not read; unpack it: `unzip -d ",
            ),
            (
                |root| cut(root.join("TRAIN_0/anno/a_b_0.txt")),
                "4 rows of ground truth for 5 frames; ",
            ),
            (
                |root| edit(root.join("TRAIN_0/anno/a_b_0.txt"), "20", "x"),
                "a_b_0.txt:1: `x` is not a number; ",
            ),
        ],
    },
    Layout {
        data: "UAV123",
        make: |root| {
            (749..=752).for_each(|i| image(root.join("data_seq/UAV123/car1").join(six(i))));
            write(
                root.join("anno/UAV123/car1_1.txt"),
                lines(&[BOX, "NaN,NaN,NaN,NaN", BOX]),
            );
            write(root.join("anno/UAV123/car1_2.txt"), lines(&["6,6,20,15"; 2]));
            write(
                root.join("anno/UAV123/att/car1_1.txt"),
                "1,0,0,0,0,0,0,0,0,0,1,0\n",
            );
            write(root.join("anno/UAV20L/car1.txt"), lines(&[BOX; 4]));
        },
        expected: &[
            expected(
                "UAV123/car1_1",
                "uav123",
                "cac",
                AT_CORNER,
                &["scale-variation", "camera-motion"],
            ),
            expected(
                "UAV123/car1_2",
                "uav123",
                "cc",
                [5.5, 5.5, 25.5, 5.5, 25.5, 20.5, 5.5, 20.5],
                &[],
            ),
            expected("UAV20L/car1", "uav123", "cccc", AT_CORNER, &[]),
        ],
        bad: [
            (
                |root| append(root.join("anno/UAV123/car1_2.txt"), BOX),
                "car1_2.txt:3: 3 rows of ground truth for 2 frames; ",
            ),
            (
                |root| write(root.join("anno/UAV123/att/car1_1.txt"), "1,0"),
                "car1_1.txt: warning: 2 numbers instead of 12; ",
            ),
            (
                |root| edit(root.join("anno/UAV20L/car1.txt"), "20", "x"),
                "car1.txt:1: `x` is not a number; ",
            ),
        ],
    },
    Layout {
        data: "NfS",
        make: |root| {
            images(root.join("biker/240/biker"), five);
            images(root.join("biker/30/biker"), five);
            let row =
                |i: usize, lost: u8, hidden: u8| format!("0 5 6 25 21 {i} {lost} {hidden} 0 \"person\"\n");
            let fast: String = (0..FRAMES)
                .map(|i| row(i, u8::from(i == 2), u8::from(i == 3)))
                .collect();
            write(root.join("biker/240/biker.txt"), fast);
            let slow: String = (0..8 * FRAMES).map(|i| row(i, u8::from(i == 8), 0)).collect();
            write(root.join("biker/30/biker.txt"), slow);
        },
        expected: &[
            expected("NfS-30/biker", "nfs", "caccc", AT_CORNER, &[]),
            expected("NfS-240/biker", "nfs", "ccacc", AT_CORNER, &[]),
        ],
        bad: [
            (
                |root| write(root.join("biker/240/biker.txt"), "0 5 6 25 21 0 0 0 0 \"a\"\n"),
                "biker.txt: 1 rows of ground truth for 5 frames; ",
            ),
            (
                |root| {
                    edit(
                        root.join("biker/240/biker.txt"),
                        "0 5 6 25 21 1 0 0 0 \"person\"",
                        "0 5 6 25",
                    )
                },
                "biker.txt:2: 4 numbers instead of 5; ",
            ),
            (
                |root| edit(root.join("biker/240/biker.txt"), "25", "x"),
                "biker.txt:1: `x` is not a number; ",
            ),
        ],
    },
    Layout {
        data: "TLP",
        make: |root| {
            images(root.join("Boxing1/img"), five);
            let rows = (1..=FRAMES).map(|i| format!("{i},{BOX},{}\n", u8::from(i == 4)));
            write(
                root.join("Boxing1/groundtruth_rect.txt"),
                rows.collect::<String>(),
            );
        },
        expected: &[expected("DATA/Boxing1", "otb", "cccac", AT_CORNER, &[])],
        bad: [
            (
                |root| cut(root.join("Boxing1/groundtruth_rect.txt")),
                "4 rows of ground truth for 5 frames; ",
            ),
            (
                |root| edit(root.join("Boxing1/groundtruth_rect.txt"), "20", "x"),
                "groundtruth_rect.txt:1: `x` is not a number; ",
            ),
            (
                |root| {
                    edit(
                        root.join("Boxing1/groundtruth_rect.txt"),
                        "2,5,6,20,15,0",
                        "2,5,6,20,15",
                    )
                },
                "groundtruth_rect.txt:2: 5 numbers instead of 4; ",
            ),
        ],
    },
    Layout {
        data: "TColor-128",
        make: |root| {
            (5..=9).for_each(|i| image(root.join("Hurdle_ce2/img").join(four(i))));
            write(root.join("Hurdle_ce2/Hurdle_ce2_gt.txt"), lines(&[BOX; 3]));
            write(root.join("Hurdle_ce2/Hurdle_ce2_frames.txt"), "6,8\n");
        },
        expected: &[expected("DATA/Hurdle_ce2", "tcolor128", "ccc", AT_CORNER, &[])],
        bad: [
            (
                |root| write(root.join("Hurdle_ce2/Hurdle_ce2_frames.txt"), "all"),
                "Hurdle_ce2_frames.txt: not the numbers of two frames; ",
            ),
            (
                |root| write(root.join("Hurdle_ce2/Hurdle_ce2_frames.txt"), "6,9"),
                "Hurdle_ce2_gt.txt:3: 3 rows of ground truth for 4 frames; ",
            ),
            (
                |root| edit(root.join("Hurdle_ce2/Hurdle_ce2_gt.txt"), "20", "x"),
                "Hurdle_ce2_gt.txt:1: `x` is not a number; ",
            ),
        ],
    },
    Layout {
        data: "DTB70",
        make: |root| {
            images(root.join("Gull1/img"), five);
            write(root.join("Gull1/groundtruth_rect.txt"), all(BOX));
        },
        expected: &[expected("DATA/Gull1", "otb", "ccccc", AT_CORNER, &[])],
        bad: [
            (
                |root| append(root.join("Gull1/groundtruth_rect.txt"), BOX),
                "groundtruth_rect.txt:6: 6 rows of ground truth for 5 frames; ",
            ),
            (
                |root| edit(root.join("Gull1/groundtruth_rect.txt"), "20", "1e9"),
                "groundtruth_rect.txt:1: a coordinate is beyond ",
            ),
            (
                |root| edit(root.join("Gull1/groundtruth_rect.txt"), ",15", ""),
                "groundtruth_rect.txt:1: 3 numbers instead of 4; ",
            ),
        ],
    },
    Layout {
        data: "ALOV300++",
        make: |root| {
            images(root.join("imagedata++/01-Light/01-Light_video00001"), eight);
            // Four points in an order of their own.
            let row = "25 21 25 6 5 6 5 21";
            write(
                root.join("alov300++_rectangleAnnotation_full/01-Light/01-Light_video00001.ann"),
                format!("1 {row}\n5 {row}\n"),
            );
        },
        expected: &[expected(
            "01-Light/01-Light_video00001",
            "alov",
            "c---c",
            AT_CORNER,
            &[],
        )],
        bad: [
            (
                |root| append(root.join(ALOV), "9 25 21 25 6 5 6 5 21"),
                "01-Light_video00001.ann:3: there is no frame `9`; ",
            ),
            (
                |root| append(root.join(ALOV), "5 25 21 25 6 5 6 5 21"),
                "01-Light_video00001.ann:3: a second row for frame `5`; ",
            ),
            (
                |root| edit(root.join(ALOV), "1 25 ", "1 "),
                "01-Light_video00001.ann:1: 8 numbers instead of 9; ",
            ),
        ],
    },
    Layout {
        data: "MOT Challenge",
        make: |root| {
            let dir = root.join("train/MOT17-02-FRCNN");
            images(dir.join("img1"), six);
            let rows = [
                "1,3,5,6,20,15,1,1,0.9",
                "2,3,5,6,20,15,1,1,0.9",
                "5,3,5,6,20,15,1,1,0.9",
                "2,7,6,6,20,15,1,1,1",
                "3,7,6,6,20,15,1,1,1",
                "3,8,6,6,20,15,0,7,1",
            ];
            write(dir.join("gt/gt.txt"), lines(&rows));
            write(dir.join("seqinfo.ini"), "[Sequence]\nname=MOT17-02-FRCNN\n");
            write(dir.join("det/det.txt"), "1,-1,5,6,20,15,0.5\n");
        },
        expected: &[
            expected("train/MOT17-02-FRCNN-3", "mot", "cc--c", AT_CORNER, &[]),
            expected(
                "train/MOT17-02-FRCNN-7",
                "mot",
                "cc",
                [5.5, 5.5, 25.5, 5.5, 25.5, 20.5, 5.5, 20.5],
                &[],
            ),
        ],
        bad: [
            (
                |root| append(root.join(MOT), "9,3,5,6,20,15,1,1,1"),
                "gt.txt:7: there is no frame `9`; ",
            ),
            (
                |root| edit(root.join(MOT), "20", "x"),
                "gt.txt:1: `x` is not a number; ",
            ),
            (
                |root| edit(root.join(MOT), "1,3,5,6,20,15,1,1,0.9", "1,3,5,6,20"),
                "gt.txt:1: 5 numbers instead of 6; ",
            ),
        ],
    },
    Layout {
        data: "your own",
        make: |root| {
            images(root.join("cup"), five);
            write(root.join("cup/groundtruth.txt"), all(QUAD));
            write(root.join("cup/tags.txt"), "mine\n");
        },
        expected: &[expected("DATA/cup", "folder", "ccccc", AT_CENTRE, &["mine"])],
        bad: [
            (
                |root| cut(root.join("cup/groundtruth.txt")),
                "4 rows of ground truth for 5 frames; ",
            ),
            (
                |root| write(root.join("cup/groundtruth.txt"), all("1 2 3")),
                "rows of 3 numbers; expected ",
            ),
            (
                |root| edit(root.join("cup/groundtruth.txt"), "5 6", "x 6"),
                "groundtruth.txt:1: `x` is not a number; ",
            ),
        ],
    },
];

const DAVID: &[&str] = &[
    "illumination-variation",
    "scale-variation",
    "occlusion",
    "deformation",
    "motion-blur",
    "in-plane-rotation",
    "out-of-plane-rotation",
];
const JOGGING: &[&str] = &["occlusion", "deformation", "out-of-plane-rotation"];
const BOX_AS_QUAD: &str = "5,6,25,6,25,21,5,21";
const ALOV: &str = "alov300++_rectangleAnnotation_full/01-Light/01-Light_video00001.ann";
const MOT: &str = "train/MOT17-02-FRCNN/gt/gt.txt";

/// Masks as rectangles, where a data set has any.
fn options() -> LoadOptions {
    LoadOptions {
        reading: Reading {
            fit_masks: true,
            ..Reading::default()
        },
        ..LoadOptions::default()
    }
}

fn layout(data: &str) -> &'static Layout {
    LAYOUTS.iter().find(|layout| layout.data == data).unwrap()
}

/// A folder `DATA` with the sample.
fn sample(layout: &Layout) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    (layout.make)(&dir.path().join("DATA"));
    dir
}

fn load(root: &Path, options: &LoadOptions) -> Dataset {
    dataset::load(root, options).unwrap_or_else(|e| panic!("{e}"))
}

fn regions(sequence: &Sequence) -> String {
    let letter = |i| match sequence.annotation(i).region {
        Region::Corners(_) => 'c',
        Region::Absent => 'a',
        _ => '-',
    };
    (0..sequence.len()).map(letter).collect()
}

fn each_is_read_as_the_page_says() {
    for layout in LAYOUTS {
        let dir = sample(layout);
        let data = load(&dir.path().join("DATA"), &options());
        let ids: Vec<String> = data
            .sequences
            .iter()
            .map(|s| format!("{}/{}", s.dataset(), s.name()))
            .collect();
        let expected: Vec<&str> = layout.expected.iter().map(|e| e.id).collect();
        assert_eq!(ids, expected, "{}", layout.data);
        for (sequence, expected) in data.sequences.iter().zip(layout.expected) {
            let about = expected.id;
            assert_eq!(sequence.format(), expected.format, "{about}");
            assert_eq!(regions(sequence), expected.frames, "{about}");
            assert_eq!(sequence.tags(), expected.tags, "{about}");
            let first = sequence.truth(0).unwrap();
            let off = first.distance_squared(&Corners::from_array(expected.first));
            assert!(off < 1e-12, "{about}: {first:?}");
        }
    }
}

fn each_malformed_one_is_told_in_one_line() {
    for layout in LAYOUTS {
        // Masks are refused elsewhere.
        let options = match layout.data {
            "VOTS" => options(),
            _ => LoadOptions::default(),
        };
        for (spoil, message) in &layout.bad {
            let dir = sample(layout);
            let root = dir.path().join("DATA");
            spoil(&root);
            let faults: Vec<String> = dataset::check(&root, &options)
                .faults
                .iter()
                .map(ToString::to_string)
                .collect();
            let told: Vec<&String> = faults.iter().filter(|fault| fault.contains(message)).collect();
            assert_eq!(told.len(), 1, "{}: no `{message}` in {faults:#?}", layout.data);
            assert!(!told[0].contains('\n') && told[0].contains("; "), "{}", told[0]);
            // What is an error stops a run before it starts, with the same words.
            if !told[0].contains("warning: ") {
                let error = dataset::load(&root, &options).unwrap_err().to_string();
                assert!(error.contains(message), "{}: {error}", layout.data);
            }
        }
    }
}

fn each_is_tracked() {
    let dir = tempfile::tempdir().unwrap();
    let mut words = vec!["run".to_owned()];
    for (k, layout) in LAYOUTS.iter().enumerate() {
        (layout.make)(&dir.path().join(format!("{k}/DATA")));
        words.push(format!("{k}/DATA"));
    }
    let rest = "--tracker fclk/ssd/translation --fit-masks -o out --progress none --frame-logs none";
    words.extend(rest.split(' ').map(String::from));
    let run = program(dir.path()).args(&words).output().unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{said}");
    let info = program(dir.path())
        .args(["data", "info", "--fit-masks", "2/DATA", "9/DATA"])
        .output()
        .unwrap();
    let table = String::from_utf8_lossy(&info.stdout).into_owned();
    for part in ["planartrack", "motion-blur out-of-view test", "animal-dog", "vot"] {
        assert!(table.contains(part), "{table}");
    }
    for k in 0..LAYOUTS.len() {
        let path = format!("{k}/DATA");
        let check = program(dir.path())
            .args(["data", "check", "--fit-masks", &path])
            .output()
            .unwrap();
        let found = String::from_utf8_lossy(&check.stdout).into_owned();
        assert!(check.status.success(), "{}: {found}", LAYOUTS[k].data);
    }
}

/// Cells of the table's rows.
fn page_rows(page: &str) -> Vec<Vec<String>> {
    let rows = page.lines().filter(|line| line.starts_with("| "));
    let cells = |line: &str| {
        let inner = line.trim_start_matches("| ").trim_end_matches(" |");
        inner.split(" | ").map(|cell| cell.trim().to_owned()).collect()
    };
    rows.map(cells).collect()
}

fn the_page_has_a_row_for_each() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/datasets.md");
    let page = fs::read_to_string(path).unwrap();
    let rows = page_rows(&page);
    let header = [
        "data set",
        "format",
        "layout recognised by",
        "what is read",
        "what is ignored",
        "conventions (origin, order, absence)",
        "command",
    ];
    assert_eq!(rows[0], header);
    let told: Vec<&str> = rows[1..].iter().map(|row| row[0].as_str()).collect();
    let tested: Vec<&str> = LAYOUTS.iter().map(|layout| layout.data).collect();
    assert_eq!(told, tested);
    let mut formats = BTreeSet::new();
    for (row, layout) in rows[1..].iter().zip(LAYOUTS) {
        assert_eq!(row.len(), header.len(), "{row:?}");
        assert!(row[6].starts_with("`mtf-eval "), "{row:?}");
        for expected in layout.expected {
            assert_eq!(row[1], format!("`{}`", expected.format), "{row:?}");
            formats.insert(expected.format);
        }
    }
    // Every format has data; `apart` and `film` are for what is in no form of a known set.
    let all: BTreeSet<&str> = dataset::Formats::builtin()
        .iter()
        .map(|format| format.describe().name)
        .filter(|name| !["apart", "film"].contains(name))
        .collect();
    assert_eq!(formats, all);
}

fn masks_are_refused_with_a_hint() {
    let dir = sample(layout("VOTS"));
    let root = dir.path().join("DATA");
    let error = dataset::load(&root, &LoadOptions::default())
        .unwrap_err()
        .to_string();
    let expected = "groundtruth_1.txt:1: the object is a mask, where four corners are tracked; `--fit-masks` takes the \
                    smallest rectangle around it";
    assert!(error.ends_with(expected), "{error}");
}

fn a_polygon_of_many_points_is_fitted_on_request() {
    let dir = sample(layout("VOT 2013 to 2022"));
    let root = dir.path().join("DATA");
    edit(
        root.join("bag/groundtruth.txt"),
        "0\n",
        "5,6,15,6,25,6,25,21,5,21\n",
    );
    let data = load(&root, &options());
    assert_eq!(regions(&data.sequences[0]), "cccac");
    let fitted = data.sequences[0].truth(1).unwrap();
    assert!(
        fitted.distance_squared(&Corners::from_array(AT_CORNER)) < 1e-12,
        "{fitted:?}"
    );
}

fn videos_and_archives_are_named_with_the_way_to_unpack_them() {
    let dir = sample(layout("POT-210, POT-280"));
    let root = dir.path().join("DATA");
    fs::remove_dir_all(root.join("V01/V01_5")).unwrap();
    write(root.join("V01/V01_5.avi"), "RIFF");
    let error = dataset::load(&root, &LoadOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("V01_5_gt_points.txt: the frames are in `")
            && error.contains("V01_5.avi`, which is not read; "),
        "{error}"
    );
    assert!(
        error.contains("mkdir ") && error.contains("ffmpeg -i "),
        "{error}"
    );
    // Unpacked beside the video.
    images(root.join("V01/V01_5"), four);
    assert_eq!(
        regions(&load(&root, &LoadOptions::default()).sequences[0]),
        "cc-a-"
    );
}

fn test_sets_have_the_first_row_alone() {
    for data in ["GOT-10k", "TrackingNet", "VOTS"] {
        let dir = sample(layout(data));
        let set = load(&dir.path().join("DATA"), &options());
        let first: Vec<&Sequence> = set.sequences.iter().filter(|s| regions(s) == "c----").collect();
        let notes: Vec<String> = first[0].notes().iter().map(ToString::to_string).collect();
        assert_eq!((first.len(), notes.len()), (1, 1), "{data}: {notes:?}");
        assert!(
            notes[0].contains("ground truth of the first frame alone"),
            "{notes:?}"
        );
    }
}

fn lists_of_frames_hold_where_rows_are_as_many() {
    let dir = sample(layout("OTB"));
    let root = dir.path().join("DATA/David");
    let names = |data: &Dataset| -> Vec<String> {
        let s = &data.sequences[0];
        (0..s.len()).map(|i| s.frame_name(i).to_owned()).collect()
    };
    let listed = load(&root, &LoadOptions::default());
    assert_eq!(names(&listed), ["0300.jpg", "0301.jpg", "0302.jpg"]);
    // Annotated as a whole.
    write(root.join("groundtruth_rect.txt"), all(BOX));
    assert_eq!(names(&load(&root, &LoadOptions::default())).len(), 5);
}

fn labels_of_every_second_frame_in_either_form() {
    let dir = sample(layout("POT-210, POT-280"));
    let root = dir.path().join("DATA");
    write(root.join("annotation/V01_5_gt_points.txt"), lines(&[QUAD; 3]));
    write(root.join("annotation/V01_5_flag.txt"), "0\n1\n0\n");
    assert_eq!(
        regions(&load(&root, &LoadOptions::default()).sequences[0]),
        "ca-c-"
    );
}

fn a_frame_more_than_rows_is_said() {
    let dir = sample(layout("NfS"));
    let root = dir.path().join("DATA");
    // One frame more than rows: taken from the first on, and said.
    image(root.join("biker/240/biker/00006.jpg"));
    let data = load(&root, &LoadOptions::default());
    assert_eq!(regions(&data.sequences[1]), "ccacc-");
    assert!(
        data.sequences[1].notes()[0]
            .message
            .contains("5 rows of ground truth for 6 frames")
    );
}

fn attributes_and_splits_are_tags() {
    let dir = sample(layout("PlanarTrack"));
    let root = dir.path().join("DATA");
    write(root.join("training-test-splits/training_set.txt"), "Seq_00001\n");
    write(root.join("training-test-splits/test_seq.txt"), "Seq_00011\n");
    let data = load(&root, &LoadOptions::default());
    assert_eq!(data.sequences[0].tags(), ["motion-blur", "out-of-view", "train"]);
}

fn frames_have_words() {
    for (data, sequence, frame, word) in [
        ("POT-210, POT-280", 0, 3, "occluded"),
        ("PlanarTrack", 0, 3, "out-of-view"),
        ("LaSOT", 0, 2, "full-occlusion"),
        ("LaSOT", 0, 3, "out-of-view"),
        ("GOT-10k", 1, 1, "cut-by-image"),
        ("NfS", 1, 3, "occluded"),
        ("VOT 2013 to 2022", 0, 1, "occlusion"),
    ] {
        let dir = sample(layout(data));
        let set = load(&dir.path().join("DATA"), &options());
        assert_eq!(set.sequences[sequence].annotation(frame).flags, [word], "{data}");
    }
}

fn names_decide_between_formats() {
    // Ground truth beside the frames goes before that in a folder of its own.
    let dir = sample(layout("TrackingNet"));
    let root = dir.path().join("DATA/TRAIN_0");
    write(root.join("frames/a_b_0/groundtruth.txt"), all(QUAD));
    let data = load(&root, &LoadOptions::default());
    assert_eq!(data.sequences[0].format(), "folder");
    // The files of VOT go before those of others.
    let dir = sample(layout("LaSOT"));
    let root = dir.path().join("DATA/airplane/airplane-1");
    write(root.join("camera_motion.tag"), "0\n0\n0\n0\n0\n");
    assert_eq!(load(&root, &LoadOptions::default()).sequences[0].format(), "vot");
}

fn an_unknown_layout_is_told_with_the_nearest() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |root: &Path| {
        dataset::load(root, &LoadOptions::default())
            .unwrap_err()
            .to_string()
    };
    // Nothing of any format.
    write(dir.path().join("a/notes.md"), "nothing");
    let error = refused(&dir.path().join("a"));
    for part in [
        "no sequence found",
        "looked for the formats vot, lasot, ",
        "found 1 `.md`; ",
        "nothing is there of any of them: `mtf-eval list formats` shows",
    ] {
        assert!(error.contains(part), "{error}");
    }
    // Ground truth of one, without frames that are called so.
    write(dir.path().join("b/Seq_1/x_gt.txt"), BOX);
    write(dir.path().join("b/Seq_1/x_frames.txt"), "1,2");
    fs::create_dir_all(dir.path().join("b/Seq_1/images")).unwrap();
    fs::remove_file(dir.path().join("b/Seq_1/x_frames.txt")).unwrap();
    let error = refused(&dir.path().join("b"));
    assert!(
        error.contains("found folders `Seq_1`, `images`, 1 `.txt`; nearest is the format tcolor128 for `*_gt.txt`, which has "),
        "{error}"
    );
    // Frames without ground truth that is known.
    images(dir.path().join("c/video"), five);
    write(dir.path().join("c/video/annotations.xml"), "<a/>");
    let error = refused(&dir.path().join("c"));
    assert!(
        error.contains("frames without ground truth (there are 5 images, 1 `.xml`); add ")
            && !error.contains('\n'),
        "{error}"
    );
    write(dir.path().join("c/annos/other.txt"), QUAD);
    let error = refused(&dir.path().join("c"));
    assert!(
        error.contains("(nearest is the format planartrack for `annos`, which has "),
        "{error}"
    );
}
