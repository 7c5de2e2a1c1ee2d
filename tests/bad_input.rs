//! Every kind of bad data gives exactly one clear error: where it is, what is wrong, what to do.

use mtf::geom::Corners;
use mtf_eval::dataset::{self, Dataset, DatasetError, LoadOptions, OnBadData, Severity};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

crate::tests! {
    good_data_has_no_fault;
    missing_folder;
    a_file_instead_of_a_folder;
    empty_folder;
    no_ground_truth;
    no_frames;
    truncated_frame;
    frame_of_zero_bytes;
    frame_that_is_no_image;
    frame_of_another_size;
    frame_that_vanished;
    header_that_claims_60000x60000;
    missing_and_surplus_rows;
    bad_rows;
    every_row_bad;
    initial_corners_outside_the_image;
    first_frame_without_annotation;
    nothing_selected;
    check_lists_all_faults_and_skip_keeps_the_good_sequences;
}

const QUAD: &str = "10 10 30 10 30 25 10 25";

/// A sequence of three 48x32 frames with MTF ground truth, in a folder of its own.
struct Sequence {
    root: TempDir,
}

impl Sequence {
    fn new() -> Self {
        let sequence = Sequence {
            root: tempfile::tempdir().unwrap(),
        };
        for i in 1..=3 {
            sequence.write(&format!("frame{i:05}.png"), &png(48, 32, i));
        }
        sequence.truth(&["", "", ""])
    }

    fn path(&self) -> PathBuf {
        self.root.path().join("seq")
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::create_dir_all(self.path()).unwrap();
        std::fs::write(self.path().join(name), bytes).unwrap();
    }

    /// Rows in place of the good ones (empty: good).
    fn truth(self, rows: &[&str]) -> Self {
        let mut text = String::from("frame ulx uly urx ury lrx lry llx lly\n");
        for (i, row) in rows.iter().enumerate() {
            text += &format!(
                "frame{:05}.png {}\n",
                i + 1,
                if row.is_empty() { QUAD } else { row }
            );
        }
        self.write("groundtruth.txt", text.as_bytes());
        self
    }

    fn plain_truth(self, text: &str) -> Self {
        self.write("groundtruth.txt", text.as_bytes());
        self
    }

    fn frame(self, name: &str, bytes: &[u8]) -> Self {
        self.write(name, bytes);
        self
    }

    fn without(self, name: &str) -> Self {
        std::fs::remove_file(self.path().join(name)).unwrap();
        self
    }

    fn load(&self) -> Result<Dataset, DatasetError> {
        dataset::load(&self.path(), &LoadOptions::default())
    }

    /// The message of the one fault that `check` finds, without the path of the sequence.
    fn only_fault(&self) -> String {
        let faults = dataset::check(&self.path(), &LoadOptions::default()).faults;
        assert_eq!(faults.len(), 1, "{faults:#?}");
        assert_eq!(faults[0].severity, Severity::Error);
        faults[0]
            .to_string()
            .replace(&format!("{}/", self.path().display()), "")
    }

    /// `load` refuses with `message`, and `check` lists that and nothing else.
    fn refused(&self, message: &str) {
        let error = self.load().unwrap_err().to_string();
        assert_clear(&error, message);
        assert_clear(&self.only_fault(), message);
    }

    /// `load` accepts; reading frame `i` fails with `message`, and `check` lists that and nothing else.
    fn unreadable(&self, i: usize, message: &str) {
        let sequence = &self.load().unwrap().sequences[0];
        assert!(sequence.read(0, false).is_ok() || i == 0);
        for colour in [false, true] {
            assert_clear(&sequence.read(i, colour).unwrap_err().to_string(), message);
        }
        assert_clear(&self.only_fault(), message);
    }
}

fn assert_clear(text: &str, message: &str) {
    assert!(text.contains(message), "`{text}` does not say `{message}`");
    assert!(text.contains("; "), "`{text}` has no remedy");
    assert!(!text.contains('\n'), "`{text}` is more than a line");
}

fn png(width: u32, height: u32, seed: u32) -> Vec<u8> {
    let image = image::RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([(x * 5 + seed) as u8, (y * 7) as u8, (x * y) as u8])
    });
    let mut out = std::io::Cursor::new(Vec::new());
    image.write_to(&mut out, image::ImageFormat::Png).unwrap();
    out.into_inner()
}

fn skip() -> LoadOptions {
    LoadOptions {
        on_bad_data: OnBadData::Skip,
        ..LoadOptions::default()
    }
}

fn refused_path(path: &Path, message: &str) {
    assert_clear(
        &dataset::load(path, &LoadOptions::default())
            .unwrap_err()
            .to_string(),
        message,
    );
    let faults = dataset::check(path, &LoadOptions::default()).faults;
    assert_eq!(faults.len(), 1);
    assert_clear(&faults[0].to_string(), message);
    assert_clear(&dataset::load(path, &skip()).unwrap_err().to_string(), message);
}

fn good_data_has_no_fault() {
    let sequence = Sequence::new();
    assert_eq!(
        dataset::check(&sequence.path(), &LoadOptions::default()).faults,
        []
    );
    assert_eq!(sequence.load().unwrap().sequences[0].len(), 3);
}

fn missing_folder() {
    refused_path(
        Path::new("/no/such/folder"),
        "/no/such/folder: no such file or folder",
    );
}

fn a_file_instead_of_a_folder() {
    let sequence = Sequence::new();
    refused_path(
        &sequence.path().join("frame00001.png"),
        "frame00001.png: not a folder",
    );
}

fn empty_folder() {
    let dir = tempfile::tempdir().unwrap();
    refused_path(dir.path(), "the folder is empty");
    std::fs::write(dir.path().join("notes.md"), "nothing here").unwrap();
    refused_path(dir.path(), "no sequence found");
}

fn no_ground_truth() {
    Sequence::new()
        .without("groundtruth.txt")
        .refused("frames without ground truth");
}

fn no_frames() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("groundtruth.txt"), QUAD).unwrap();
    refused_path(dir.path(), "groundtruth.txt: no frames");
}

fn truncated_frame() {
    let whole = png(48, 32, 2);
    Sequence::new()
        .frame("frame00002.png", &whole[..whole.len() / 2])
        .unreadable(1, "frame00002.png: the PNG image is truncated");
    Sequence::new()
        .frame("frame00001.png", &whole[..whole.len() / 2])
        .unreadable(0, "frame00001.png: the PNG image is truncated");
}

fn frame_of_zero_bytes() {
    Sequence::new()
        .frame("frame00003.png", b"")
        .unreadable(2, "frame00003.png: the image file is empty (0 bytes)");
    Sequence::new()
        .frame("frame00001.png", b"")
        .refused("frame00001.png: the image file is empty (0 bytes)");
}

fn frame_that_is_no_image() {
    Sequence::new()
        .frame("frame00003.png", b"not an image")
        .unreadable(2, "frame00003.png: not an image");
}

fn frame_of_another_size() {
    Sequence::new()
        .frame("frame00002.png", &png(32, 48, 0))
        .unreadable(
            1,
            "frame00002.png: the frame is 32x48 pixels but the first is 48x32",
        );
}

fn frame_that_vanished() {
    let sequence = Sequence::new();
    let loaded = sequence.load().unwrap();
    let sequence = sequence.without("frame00002.png");
    let error = loaded.sequences[0].read(1, false).unwrap_err().to_string();
    assert_clear(&error, "frame00002.png: no such file");
    sequence.refused("groundtruth.txt:3: there is no frame `frame00002.png`");
}

fn header_that_claims_60000x60000() {
    let huge = b"P5 60000 60000 255\n0000";
    let message = "the image header claims 60000x60000 pixels, more than the limit";
    let begun = std::time::Instant::now();
    Sequence::new()
        .frame("frame00002.png", huge)
        .unreadable(1, message);
    Sequence::new().frame("frame00001.png", huge).refused(message);
    assert!(
        begun.elapsed().as_secs() < 20,
        "refused before anything is allocated or filled"
    );
}

fn missing_and_surplus_rows() {
    Sequence::new()
        .truth(&["", ""])
        .refused("groundtruth.txt: no row for frame `frame00003.png`");
    Sequence::new()
        .truth(&["", "", "", ""])
        .refused("groundtruth.txt:5: there is no frame `frame00004.png`");
    let row = format!("{QUAD}\n");
    Sequence::new().plain_truth(&row.repeat(2)).refused(
        "groundtruth.txt:2: 2 rows of ground truth for 3 frames; add the missing rows, or say in the command or in `meta.json` \
         which frames they are for: --truth-start 1 if they are for the first frames, --truth-start 2 if for the last",
    );
    Sequence::new()
        .plain_truth(&row.repeat(5))
        .refused("groundtruth.txt:4: 5 rows of ground truth for 3 frames; add the missing frames");
}

fn bad_rows() {
    for (row, message) in [
        ("10 10 30 ten 30 25 10 25", "`ten` is not a number"),
        ("10 10 30 10 NaN 25 10 25", "a coordinate is not finite"),
        ("10 10 30 10 30 25 10", "7 numbers instead of 8"),
        ("10 10 10 10 10 10 10 10", "the quadrilateral has zero area"),
        ("10 10 30 25 30 10 10 25", "the quadrilateral is not convex"),
    ] {
        Sequence::new()
            .truth(&[row, "", ""])
            .refused(&format!("groundtruth.txt:2: {message}"));
        Sequence::new()
            .truth(&["", row, ""])
            .refused(&format!("groundtruth.txt:3: {message}"));
        let text = format!("{QUAD}\n{QUAD}\n{row}\n");
        Sequence::new()
            .plain_truth(&text)
            .refused(&format!("groundtruth.txt:3: {message}"));

        // Skipping makes the frame one without annotation.
        let sequence = Sequence::new().truth(&["", row, ""]);
        let loaded = dataset::load(&sequence.path(), &skip()).unwrap();
        let truth: Vec<bool> = (0..3).map(|i| loaded.sequences[0].truth(i).is_some()).collect();
        assert_eq!(truth, [true, false, true]);
        assert_eq!(loaded.sequences[0].notes().len(), 1);
        let sequence = Sequence::new().truth(&[row, "", ""]);
        assert!(dataset::load(&sequence.path(), &skip()).is_err());
    }
}

fn every_row_bad() {
    Sequence::new()
        .plain_truth(&"1 2 3 4 5 6 7\n".repeat(3))
        .refused("groundtruth.txt:1: rows of 7 numbers");
    Sequence::new()
        .plain_truth("")
        .refused("groundtruth.txt: no rows of ground truth");
    Sequence::new()
        .plain_truth("\u{0}\u{1}")
        .refused("groundtruth.txt: no rows of ground truth");
}

fn initial_corners_outside_the_image() {
    Sequence::new()
        .truth(&["60 10 80 10 80 25 60 25", "", ""])
        .refused("groundtruth.txt:2: the initial quadrilateral lies outside the 48x32 image");
    // Later frames may leave the image.
    let sequence = Sequence::new().truth(&["", "40 10 60 10 60 25 40 25", ""]);
    assert_eq!(
        dataset::check(&sequence.path(), &LoadOptions::default()).faults,
        []
    );
}

fn first_frame_without_annotation() {
    let sequence = Sequence::new().truth(&["tracker_failed", "", ""]);
    let loaded = sequence.load().unwrap();
    let found = &loaded.sequences[0];
    assert_eq!((found.len(), found.frame_name(0)), (2, "frame00002.png"));
    let notes: Vec<String> = found.notes().iter().map(ToString::to_string).collect();
    assert_eq!(notes.len(), 1, "{notes:?}");
    assert_clear(
        &notes[0],
        "warning: no ground truth before frame `frame00002.png`: tracking starts there",
    );
    let faults = dataset::check(&sequence.path(), &LoadOptions::default()).faults;
    assert_eq!(faults, found.notes());
}

fn nothing_selected() {
    let sequence = Sequence::new();
    let error = dataset::load(
        &sequence.path(),
        &LoadOptions {
            start: 3,
            ..LoadOptions::default()
        },
    )
    .unwrap_err();
    assert_clear(
        &error.to_string(),
        "no frame left: the selection starts at frame 3 and the sequence has 3",
    );
}

fn check_lists_all_faults_and_skip_keeps_the_good_sequences() {
    let root = tempfile::tempdir().unwrap();
    let copy =
        |name: &str, sequence: Sequence| std::fs::rename(sequence.path(), root.path().join(name)).unwrap();
    copy("good", Sequence::new());
    copy(
        "gap",
        Sequence::new()
            .truth(&["", "1 2 3", "x 1 2 3 4 5 6 7"])
            .frame("frame00003.png", b""),
    );
    copy(
        "bare",
        Sequence::new()
            .without("groundtruth.txt")
            .frame("meta.json", b"{"),
    );
    let checked = dataset::check(root.path(), &LoadOptions::default());
    assert_eq!((checked.sequences, checked.frames), (3, 9));
    let faults: Vec<String> = checked.faults.iter().map(|f| f.to_string()).collect();
    let expected = [
        "bare: frames without ground truth",
        "bare/meta.json: warning: bad metadata",
        "gap/groundtruth.txt:3: 3 numbers instead of 8",
        "gap/groundtruth.txt:4: `x` is not a number",
        "gap/frame00003.png: the image file is empty",
    ];
    assert_eq!(faults.len(), expected.len(), "{faults:#?}");
    for (fault, expected) in faults.iter().zip(expected) {
        assert!(fault.contains(expected), "{fault}");
    }
    assert!(dataset::load(root.path(), &LoadOptions::default()).is_err());
    let loaded = dataset::load(root.path(), &skip()).unwrap();
    let names: Vec<&str> = loaded.sequences.iter().map(|s| s.name()).collect();
    assert_eq!(names, ["good"]);
    let left_out: Vec<(&str, String)> = loaded
        .left_out
        .iter()
        .map(|l| (l.sequence.as_str(), l.reasons.last().unwrap().to_string()))
        .collect();
    assert_eq!((left_out[0].0, left_out[1].0), ("bare", "gap"));
    assert!(
        left_out[1]
            .1
            .contains("gap/frame00003.png: the image file is empty")
    );
    assert_eq!(
        loaded.sequences[0].truth(0),
        Some(Corners::rect(10.0, 10.0, 20.0, 15.0))
    );
}
