//! Files beside the ground truth with a number per frame: where the object cannot be seen, and what else is said of frames.
//!
//! Depends on where files come from and on the annotations.

use super::DatasetErrorKind;
use super::annotation::{Annotations, Location, Region};
use super::format::TruthFile;
use super::storage::File;
use super::text;

/// What the numbers of a file mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meaning {
    /// 0: can be seen. LaSOT's `full_occlusion.txt` and `out_of_view.txt`, GOT-10k's `absence.label`.
    Absent,
    /// 0: can be seen; else why not, one of [`REASONS`]. POT's and PlanarTrack's.
    Flag,
    /// 0: cannot be seen.
    Visible,
    /// Other than 0: the file's name is a word about the frame. VOT's tags.
    Word,
}

/// Words about frames whose flag is 1, 2 or 3.
const REASONS: [&str; 3] = ["occluded", "out-of-view", "blurred"];

/// Names of files that are also words about the frames where the object cannot be seen.
const WORDS: [(&str, &str); 2] = [
    ("full_occlusion", "full-occlusion"),
    ("out_of_view", "out-of-view"),
];

/// Names, without what is in front of or behind them, of files where 0 means that the object can be seen.
const ABSENT: [&str; 20] = [
    "absence",
    "absences",
    "absent",
    "target_absent",
    "full_occlusion",
    "full_occlusions",
    "fullocclusion",
    "full_occ",
    "fully_occluded",
    "invisible",
    "not_visible",
    "out_of_view",
    "outofview",
    "oov",
    "out_of_frame",
    "outofframe",
    "disappear",
    "disappeared",
    "missing",
    "lost",
];

/// Names of files where 0 means that it cannot be seen.
const VISIBLE: [&str; 8] = [
    "visible",
    "visibility",
    "present",
    "presence",
    "exist",
    "exists",
    "existence",
    "in_view",
];

/// What the file called `name` says about the sequence `sequence`; `None` when it is no such file.
fn meaning(name: &str, sequence: &str) -> Option<Meaning> {
    let (stem, extension) = name.rsplit_once('.')?;
    let extension = extension.to_ascii_lowercase();
    if !["txt", "label", "tag", "csv", "flag"].contains(&extension.as_str()) {
        return None;
    }
    let plain = |text: &str| text.to_lowercase().replace(['-', ' ', '.'], "_");
    let (stem, sequence) = (plain(stem), plain(sequence));
    let own = stem.strip_prefix(&sequence).map(|s| s.trim_start_matches('_'));
    let is = |names: &[&str]| names.contains(&stem.as_str()) || own.is_some_and(|own| names.contains(&own));
    if is(&["flag", "flags"]) || stem.ends_with("_flag") || stem.ends_with("_flags") {
        Some(Meaning::Flag)
    } else if is(&ABSENT) {
        Some(Meaning::Absent)
    } else if is(&VISIBLE) {
        Some(Meaning::Visible)
    } else {
        (extension == "tag").then_some(Meaning::Word)
    }
}

/// Adds what those of `files` say that are about the frames of `sequence`. Where the object cannot be seen, the frame is
/// *absent*, whatever the ground truth says. A file with another number of values than frames, and
/// than rows of ground truth, is a fault.
pub(super) fn read<'a>(
    files: impl IntoIterator<Item = &'a File>,
    sequence: &str,
    annotations: &mut Annotations,
) {
    for file in files {
        let Some(meaning) = meaning(file.name(), sequence) else {
            continue;
        };
        match TruthFile::read(file) {
            Ok(truth) => parse(&truth, meaning, annotations),
            Err(e) => annotations.fault(e),
        }
    }
}

fn parse(file: &TruthFile, meaning: Meaning, annotations: &mut Annotations) {
    let text = match file.text() {
        Ok(text) => text,
        Err(e) => return annotations.fault(e),
    };
    let lines = text::lines(&text).zip(1..);
    let lines = lines.filter(|(line, _)| !line.trim_start().starts_with(['#', '%']));
    let words: Vec<(&str, usize)> = lines
        .flat_map(|(line, number)| text::words(line).map(move |word| (word, number)))
        .collect();
    let mut values = Vec::with_capacity(words.len());
    for &(word, line) in &words {
        match word.parse::<f64>() {
            Ok(value) => values.push((value, line)),
            // The first line may say what the column is.
            Err(_) if values.is_empty() && line == 1 => {}
            Err(_) => {
                let word = word.to_string();
                return annotations.fault(file.at_line(line).fault(DatasetErrorKind::NotANumber { word }));
            }
        }
    }
    let frames = annotations.frames.len();
    // A value per frame, or per row of the ground truth.
    let places: Vec<Option<usize>> = match values.len() {
        n if n == frames => (0..frames).map(Some).collect(),
        n if n == annotations.rows.len() => annotations.rows.clone(),
        _ => vec![],
    };
    if places.is_empty() {
        // Words about frames change no result.
        if meaning != Meaning::Word {
            annotations.fault(file.fault(DatasetErrorKind::Format {
                fault: format!("{} flags for {frames} frames", values.len()),
                remedy:
                    "give one number per frame, or remove the file to go by the ground truth alone".into(),
            }));
        }
        return;
    }
    let word = file.name().trim_end_matches(".tag").to_string();
    let reason = WORDS.iter().find(|(name, _)| file.name().contains(name));
    for (place, &(value, line)) in places.into_iter().zip(&values) {
        let Some(i) = place else { continue };
        match meaning {
            Meaning::Word if value != 0.0 => annotations.flag(i, &word),
            Meaning::Absent | Meaning::Flag if value != 0.0 => {
                hide(annotations, i, file.at_line(line));
                let flagged = REASONS.iter().zip(1..).find(|(_, k)| f64::from(*k) == value);
                let word = match meaning {
                    Meaning::Flag => flagged.map(|(word, _)| *word),
                    _ => reason.map(|(_, word)| *word),
                };
                word.into_iter().for_each(|word| annotations.flag(i, word));
            }
            Meaning::Visible if value == 0.0 => hide(annotations, i, file.at_line(line)),
            Meaning::Word | Meaning::Absent | Meaning::Flag | Meaning::Visible => {}
        }
    }
}

fn hide(annotations: &mut Annotations, frame: usize, location: Location) {
    let annotation = &mut annotations.frames[frame];
    annotation.region = Region::Absent;
    annotation.location = Some(location);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files() {
        for (name, expected) in [
            ("full_occlusion.txt", Some(Meaning::Absent)),
            ("Full-Occlusion.tag", Some(Meaning::Absent)),
            ("out_of_view.txt", Some(Meaning::Absent)),
            ("out-of-view.tag", Some(Meaning::Absent)),
            ("absence.label", Some(Meaning::Absent)),
            ("absent.tag", Some(Meaning::Absent)),
            ("V01_5_flag.txt", Some(Meaning::Flag)),
            ("V01_5_full_occlusion.txt", Some(Meaning::Absent)),
            ("flag.txt", Some(Meaning::Flag)),
            ("visible.txt", Some(Meaning::Visible)),
            ("V01_5.visibility.csv", Some(Meaning::Visible)),
            ("occlusion.tag", Some(Meaning::Word)),
            ("cover.label", None),
            ("groundtruth.txt", None),
            ("README.txt", None),
            ("flag.png", None),
            ("flag", None),
        ] {
            assert_eq!(meaning(name, "V01_5"), expected, "{name}");
        }
    }

    fn read_all(name: &str, text: &str) -> (Vec<bool>, Vec<String>) {
        let mut annotations = Annotations::new(4);
        read([&File::of(name, text.as_bytes().to_vec())], "s", &mut annotations);
        let absent = annotations.frames().iter().map(|a| a.region == Region::Absent);
        let faults = annotations.faults().iter().map(ToString::to_string);
        (absent.collect(), faults.collect())
    }

    #[test]
    fn values_in_a_line_or_one_per_line() {
        for text in [
            "0,0,1,0",
            "0\n0\n1\n0\n",
            "0 0 3 0\n",
            "# flags\n0\r0\r2\r0",
            "absent\n0\n0\n1\n0\n",
        ] {
            assert_eq!(
                read_all("absence.label", text),
                (vec![false, false, true, false], vec![]),
                "{text}"
            );
        }
        let mut annotations = Annotations::new(4);
        let flags = File::of("s_flag.txt", b"0 1 2 3".to_vec());
        read([&flags], "s", &mut annotations);
        let words: Vec<String> = annotations.frames().iter().map(|a| a.flags.join(" ")).collect();
        assert_eq!(words, ["", "occluded", "out-of-view", "blurred"]);
        let (absent, _) = read_all("visible.txt", "1 1 0 1");
        assert_eq!(absent, [false, false, true, false]);
    }

    #[test]
    fn other_numbers_of_values_and_words_are_faults() {
        for (text, message) in [
            ("0 1 0", "absence.label: 3 flags for 4 frames; "),
            ("0 1\n0 x", "absence.label:2: `x` is not a number; "),
        ] {
            let (absent, faults) = read_all("absence.label", text);
            assert_eq!((absent, faults.len()), (vec![false; 4], 1));
            assert!(faults[0].starts_with(message), "{faults:?}");
        }
        assert_eq!(read_all("occlusion.tag", "1 1").1.len(), 0);
    }
}
