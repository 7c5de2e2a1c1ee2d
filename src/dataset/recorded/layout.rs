//! Which tracker and which sequence a file of results is of, by its path. A new layout is a line in [`LAYOUTS`].

use super::super::Sequence;
use crate::files::{self, Kind};
use std::collections::BTreeMap;
use std::path::Path;

/// The layouts, in the order in which they are tried: the last folders of a path and the name of the file without extension.
/// `{seq}` is the name of a sequence, `{dataset}` that of its dataset, `{tracker}` any name, `{*}` anything. A placeholder
/// that occurs twice is the same each time.
const LAYOUTS: [&str; 10] = [
    // A run directory of this program.
    "frames/{tracker}/{dataset}/{seq}",
    // A workspace of the VOT toolkit; then GOT-10k.
    "results/{tracker}/{*}/{seq}/{seq}_001",
    "{tracker}/{seq}/{seq}_001",
    "{seq}/{seq}_{tracker}",
    "{tracker}/{seq}_{tracker}",
    "{seq}/{tracker}",
    "{tracker}/{seq}",
    "{seq}_{tracker}",
    "{tracker}_{seq}",
    // For a single sequence any name will do.
    "{tracker}",
];

/// How files of results may lie, for messages and pages.
pub fn layouts() -> impl Iterator<Item = &'static str> {
    LAYOUTS.into_iter()
}

/// Whose results a file is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Claim {
    pub tracker: String,
    /// Index of the sequence.
    pub sequence: usize,
}

/// The names of the sequences that there may be results of.
pub(super) struct Names {
    /// Lower-case name -> sequences of that name, with their datasets.
    by_name: BTreeMap<String, Vec<(String, usize)>>,
    /// There is one sequence.
    single: bool,
}

impl Names {
    pub fn new(sequences: &[Sequence]) -> Names {
        Names::of(sequences.iter().map(|s| (s.dataset(), s.name())))
    }

    fn of<'a>(sequences: impl Iterator<Item = (&'a str, &'a str)>) -> Names {
        let mut by_name: BTreeMap<String, Vec<(String, usize)>> = BTreeMap::new();
        let mut count = 0;
        for (k, (dataset, name)) in sequences.enumerate() {
            let own = by_name.entry(name.to_lowercase()).or_default();
            own.push((dataset.to_lowercase(), k));
            count += 1;
        }
        Names {
            by_name,
            single: count == 1,
        }
    }

    /// The sequence called `name`; of several, the one whose dataset is among the `folders` around the file.
    fn find(&self, name: &str, folders: &[String]) -> Option<usize> {
        match &self.by_name.get(&name.to_lowercase())?[..] {
            [(_, one)] => Some(*one),
            several => {
                let around =
                    |(dataset, _): &&(String, usize)| folders.iter().any(|f| f.to_lowercase() == *dataset);
                let mut fitting = several.iter().filter(around);
                let one = fitting.next()?.1;
                fitting.next().is_none().then_some(one)
            }
        }
    }
}

/// Folders between a frame log and the description of its tracker, at most: the dataset, one of many, and the tracker's own.
const OWN_DEPTH: usize = 3;
/// Endings of files that hold one number per frame beside the results, and of no results at all.
const BESIDE: [&str; 6] = [
    "_time",
    "_confidence",
    "_score",
    "groundtruth",
    "groundtruth_rect",
    "readme",
];
/// Extensions of files of results. The last one is of frame logs that are compressed.
const EXTENSIONS: [&str; 4] = ["txt", "csv", "bin", "zst"];

/// The name of a file without its extension, if that is one of results.
fn stem(name: &str) -> Option<&str> {
    let (stem, extension) = name.rsplit_once('.')?;
    let known = EXTENSIONS.iter().any(|e| e.eq_ignore_ascii_case(extension));
    known.then(|| stem.strip_suffix(".csv").unwrap_or(stem))
}

/// Whether a file of this name may hold results.
pub(super) fn may_be_results(name: &str) -> bool {
    let beside = |stem: &str| {
        let stem = stem.to_lowercase();
        BESIDE.iter().any(|ending| stem.ends_with(ending))
    };
    stem(name).is_some_and(|stem| !beside(stem))
}

/// The first layout that the path of a file has, and whose results it is then.
pub(super) fn claim(path: &Path, names: &Names) -> Option<(&'static str, Claim)> {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    let mut parts: Vec<String> = full
        .iter()
        .map(|part| part.to_string_lossy().into_owned())
        .collect();
    let last = parts.pop()?;
    parts.push(stem(&last)?.to_owned());
    if let Some(tracker) = own_tracker(&full) {
        let mut found = Found {
            tracker: Some(tracker),
            sequence: None,
        };
        let fits = found.fit("{seq}", parts.last()?, names);
        return fits
            .then(|| found.claim(&parts, names))
            .flatten()
            .map(|claim| (LAYOUTS[0], claim));
    }
    LAYOUTS.into_iter().find_map(|layout| {
        let pattern: Vec<&str> = layout.split('/').collect();
        if pattern == ["{tracker}"] && !names.single {
            return None;
        }
        let from = parts.len().checked_sub(pattern.len())?;
        let mut found = Found::default();
        let pairs = pattern.iter().zip(&parts[from..]);
        let fits = pairs.fold(true, |fits, (pattern, part)| {
            fits && found.fit(pattern, part, names)
        });
        let claim = fits.then(|| found.claim(&parts, names)).flatten()?;
        Some((layout, claim))
    })
}

/// The tracker of a frame log in a run directory of this program, whose `tracker.json` says what it is called. Large runs have
/// folders between.
fn own_tracker(path: &Path) -> Option<String> {
    let description = path
        .ancestors()
        .skip(1)
        .take(OWN_DEPTH)
        .map(|folder| folder.join("tracker.json"));
    let bytes = description
        .filter(|file| file.is_file())
        .find_map(|file| files::read(&file, Kind::SETTINGS).ok())?;
    let value: serde_json::Value = serde_json::from_slice(&bytes).ok()?;
    Some(value.get("id")?.as_str()?.to_owned())
}

/// What the placeholders stand for, as far as it is known.
#[derive(Default)]
struct Found {
    tracker: Option<String>,
    sequence: Option<String>,
}

impl Found {
    /// Whether `part` has the form of `pattern`; notes what the placeholders are.
    fn fit(&mut self, pattern: &str, part: &str, names: &Names) -> bool {
        // A start frame behind the name of a sequence.
        let known = |name: &str| names.by_name.contains_key(&name.to_lowercase());
        match pattern {
            "{*}" | "{dataset}" => true,
            "{tracker}" => same(&mut self.tracker, part),
            "{seq}" => {
                let name = if known(part) {
                    part
                } else {
                    part.split_once('@').map_or(part, |(name, _)| name)
                };
                known(name) && same(&mut self.sequence, name)
            }
            "{seq}_001" => part
                .strip_suffix("_001")
                .is_some_and(|name| same(&mut self.sequence, name)),
            "{seq}_{tracker}" => {
                let mut cuts = part
                    .match_indices('_')
                    .map(|(at, _)| (&part[..at], &part[at + 1..]));
                let longest = cuts.rfind(|(name, tracker)| known(name) && !tracker.is_empty());
                longest.is_some_and(|(name, tracker)| {
                    same(&mut self.sequence, name) && same(&mut self.tracker, tracker)
                })
            }
            "{tracker}_{seq}" => {
                let mut cuts = part
                    .match_indices('_')
                    .map(|(at, _)| (&part[..at], &part[at + 1..]));
                let longest = cuts.find(|(tracker, name)| known(name) && !tracker.is_empty());
                longest.is_some_and(|(tracker, name)| {
                    same(&mut self.sequence, name) && same(&mut self.tracker, tracker)
                })
            }
            literal => part == literal,
        }
    }

    fn claim(self, folders: &[String], names: &Names) -> Option<Claim> {
        let sequence = match self.sequence {
            Some(name) => names.find(&name, folders)?,
            None => 0,
        };
        Some(Claim {
            tracker: self.tracker?,
            sequence,
        })
    }
}

/// Notes `value`; false where another one is noted.
fn same(noted: &mut Option<String>, value: &str) -> bool {
    noted
        .get_or_insert_with(|| value.to_owned())
        .eq_ignore_ascii_case(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_say_whose_results_they_are() {
        let two = Names::of([("set", "car_1"), ("set", "car")].into_iter());
        let claims =
            |path: &str| claim(Path::new(path), &two).map(|(layout, c)| (layout, c.tracker, c.sequence));
        for (path, layout, tracker, sequence) in [
            ("/r/KCF/car.txt", 6, "KCF", 1),
            ("/r/KCF/car_KCF.txt", 4, "KCF", 1),
            ("/r/car_1/car_1_KCF.txt", 3, "KCF", 0),
            ("/r/car/KCF.txt", 5, "KCF", 1),
            ("/w/results/KCF/baseline/car/car_001.bin", 1, "KCF", 1),
            ("/g/KCF/car/car_001.txt", 2, "KCF", 1),
            ("/flat/car_1_KCF.txt", 7, "KCF", 0),
            ("/flat/esm_ssd_car.txt", 8, "esm_ssd", 1),
            ("/run/frames/esm-ssd/set/car@12.csv.zst", 0, "esm-ssd", 1),
        ] {
            assert_eq!(
                claims(path),
                Some((LAYOUTS[layout], tracker.to_owned(), sequence)),
                "{path}"
            );
        }
        assert_eq!(claims("/flat/other.txt"), None);
        let one = Names::of([("set", "car")].into_iter());
        assert_eq!(
            claim(Path::new("/a/anything.txt"), &one).map(|c| c.1.tracker),
            Some("anything".into())
        );
        let twins = Names::of([("a", "car"), ("b", "car")].into_iter());
        assert_eq!(claim(Path::new("/KCF/car.txt"), &twins), None);
        assert_eq!(
            claim(Path::new("/b/KCF/car.txt"), &twins).map(|c| c.1.sequence),
            Some(1)
        );
    }

    #[test]
    fn files_beside_results_are_none() {
        for name in [
            "car_time.txt",
            "car_001_time.value",
            "groundtruth.txt",
            "README.txt",
            "notes",
            "a.png",
        ] {
            assert!(!may_be_results(name), "{name}");
        }
        assert!(may_be_results("car.TXT") && may_be_results("car.csv.zst"));
    }
}
