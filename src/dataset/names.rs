//! What the names of frames say: which frame a name means, and which numbers frames have.
//!
//! Depends on nothing but errors and what is called like an image.

use super::DatasetErrorKind;
use super::decode::is_image_name;
use std::collections::HashMap;

/// The name of an image without its folders and its extension. Other endings stay: `seq.0001` has none.
pub(super) fn stem(name: &str) -> &str {
    let name = base(name);
    match name.rsplit_once('.') {
        Some((stem, _)) if is_image_name(name) => stem,
        _ => name,
    }
}

fn base(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

/// Cuts `text` into runs of digits and what is between them, in turn; the first is of no digits and may be empty.
pub(super) fn runs(text: &str) -> Vec<&str> {
    let mut runs = vec![];
    let mut rest = text;
    while !rest.is_empty() || runs.is_empty() {
        let digits = runs.len() % 2 == 1;
        let end = rest.find(|c: char| c.is_ascii_digit() != digits);
        let (run, after) = rest.split_at(end.unwrap_or(rest.len()));
        runs.push(run);
        rest = after;
    }
    runs
}

/// What names have in common that differ in padding and capitals only.
fn key(name: &str) -> String {
    let unpadded = |run: &str| match run.trim_start_matches('0') {
        "" if run.starts_with('0') => "0".to_owned(),
        rest if run.starts_with('0') => rest.to_owned(),
        _ => run.to_lowercase(),
    };
    // A run of other characters never begins with a digit.
    runs(stem(name)).into_iter().map(unpadded).collect()
}

/// The names of frames, to be looked up.
pub(super) struct FrameNames<'a> {
    names: Vec<&'a str>,
    /// Whole names, without extensions, and without padding: the frames of each.
    tiers: [HashMap<String, Vec<usize>>; 3],
}

const TIERS: [fn(&str) -> String; 3] = [|name| base(name).to_owned(), |name| stem(name).to_owned(), key];

impl<'a> FrameNames<'a> {
    pub fn new(names: impl IntoIterator<Item = &'a str>) -> Self {
        let names: Vec<&str> = names.into_iter().collect();
        let tiers = TIERS.map(|tier| {
            let mut frames: HashMap<String, Vec<usize>> = HashMap::new();
            for (i, name) in names.iter().enumerate() {
                frames.entry(tier(name)).or_default().push(i);
            }
            frames
        });
        FrameNames { names, tiers }
    }

    /// Which frame `name` means. Folders before it do not count. Its extension may differ or be left out, as ground truth
    /// outlives a conversion of the frames; and so may the padding of its numbers and capitals.
    ///
    /// # Errors
    /// None, or more than one.
    pub fn find(&self, name: &str) -> Result<usize, DatasetErrorKind> {
        for (tier, frames) in TIERS.iter().zip(&self.tiers) {
            match frames.get(&tier(name)).map(Vec::as_slice) {
                None => {}
                Some([frame]) => return Ok(*frame),
                Some(several) => {
                    return Err(DatasetErrorKind::AmbiguousFrame {
                        frame: name.to_owned(),
                        first: self.names[several[0]].to_owned(),
                        second: self.names[several[1]].to_owned(),
                    });
                }
            }
        }
        Err(DatasetErrorKind::UnknownFrame {
            frame: name.to_owned(),
        })
    }

    /// The names, in order.
    pub fn names(&self) -> &[&'a str] {
        &self.names
    }

    /// The numbers of the frames: those in the one place where the names differ. `None` where they differ elsewhere, too.
    pub fn numbers(&self) -> Option<Vec<u64>> {
        let all: Vec<Vec<&str>> = self.names.iter().map(|name| runs(stem(name))).collect();
        let first = all.first()?;
        let alike = |runs: &Vec<&str>| {
            let text = |runs: &Vec<&str>| {
                runs.iter()
                    .step_by(2)
                    .map(|t| t.to_lowercase())
                    .collect::<Vec<_>>()
            };
            runs.len() == first.len() && text(runs) == text(first)
        };
        if !all.iter().all(alike) {
            return None;
        }
        let number = |run: &&str| run.parse::<u64>().ok();
        let varies = |&at: &usize| all.iter().any(|runs| number(&runs[at]) != number(&first[at]));
        let mut varying = (1..first.len()).step_by(2).filter(varies);
        let (at, None) = (varying.next()?, varying.next()) else {
            return None;
        };
        all.iter().map(|runs| number(&runs[at])).collect()
    }
}

/// Numbers in ascending order and what lies between them.
pub(super) struct Numbering {
    pub numbers: Vec<u64>,
    /// From one number to the next where none is left out: the greatest common divisor of all distances.
    pub step: u64,
    /// The first of two frames with the same number.
    pub shared: Option<usize>,
    /// Frames that are followed by more than one step, where most are followed by one.
    pub gaps: Vec<usize>,
}

impl Numbering {
    pub fn new(numbers: Vec<u64>) -> Option<Self> {
        let distances: Vec<u64> = numbers
            .windows(2)
            .map(|pair| pair[1].checked_sub(pair[0]))
            .collect::<Option<_>>()?;
        let step = distances.iter().copied().fold(0, gcd);
        let regular = 2 * distances.iter().filter(|d| **d == step).count() >= distances.len();
        let after = |wide: &dyn Fn(u64) -> bool| -> Vec<usize> {
            let distances = distances.iter().enumerate();
            distances.filter(|(_, d)| wide(**d)).map(|(i, _)| i).collect()
        };
        Some(Numbering {
            shared: after(&|d| d == 0).first().copied(),
            gaps: if regular { after(&|d| d > step) } else { vec![] },
            numbers,
            step,
        })
    }

    /// How many numbers there would be without gaps.
    pub fn span(&self) -> Option<u64> {
        let (first, last) = (self.numbers.first()?, self.numbers.last()?);
        (self.step > 0).then(|| (last - first) / self.step + 1)
    }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_mean_frames() {
        let found = |frames: &[&str], name: &str| FrameNames::new(frames.iter().copied()).find(name).ok();
        for (frames, name, expected) in [
            (["seq.0001.png", "seq.0002.png"], "seq.0002", Some(1)),
            (["seq.0001.png", "seq.0002.png"], "seq.0002.jpg", Some(1)),
            (["seq.0001.png", "seq.0002.png"], "seq.2", Some(1)),
            (["v1.2.png", "v1.10.png"], "v1.10", Some(1)),
            (["frame00001.png", "frame00002.png"], "frame2.png", Some(1)),
            (["frame1.png", "frame2.png"], "frame00002", Some(1)),
            (["frame1.png", "frame2.png"], "data/img/frame2.png", Some(1)),
            (["frame1.png", "frame2.png"], r"C:\data\frame2.bmp", Some(1)),
            (["IMG_0.JPG", "IMG_1.JPG"], "img_0.jpg", Some(0)),
            (["a.jpg", "a.png"], "a.png", Some(1)),
            (["a.jpg", "a.png"], "a", None),
            (["f1.png", "f01.png"], "f001.png", None),
            (["f1.png", "f01.png"], "f01.jpg", Some(1)),
            (["f1.png", "f2.png"], "f3.png", None),
            (["f1.png", "f2.png"], "1", None),
        ] {
            assert_eq!(found(&frames, name), expected, "{frames:?} {name}");
        }
    }

    #[test]
    fn numbers_are_where_names_differ() {
        let numbers = |names: &[&str]| FrameNames::new(names.iter().copied()).numbers();
        assert_eq!(numbers(&["00001.png", "00010.jpg"]), Some(vec![1, 10]));
        assert_eq!(numbers(&["cam2_f08_x1.png", "cam2_f9_x1.png"]), Some(vec![8, 9]));
        assert_eq!(numbers(&["IMG_1.PNG", "img_2.png"]), Some(vec![1, 2]));
        for names in [
            &["0.9.png", "1.png"][..],
            &["12_30.png", "13_31.png"],
            &["a.png", "b.png"],
            &["x.png", "x (1).png"],
            &["1.png"],
            &[],
        ] {
            assert_eq!(numbers(names), None, "{names:?}");
        }
    }

    #[test]
    fn gaps_are_where_most_numbers_have_none() {
        let look = |numbers: &[u64]| {
            let n = Numbering::new(numbers.to_vec()).unwrap();
            (n.step, n.shared, n.gaps.clone(), n.span())
        };
        assert_eq!(look(&[1, 2, 3, 6]), (1, None, vec![2], Some(6)));
        assert_eq!(look(&[5, 10, 20, 25]), (5, None, vec![1], Some(5)));
        assert_eq!(look(&[1, 3, 5]), (2, None, vec![], Some(3)));
        assert_eq!(look(&[1, 1, 2]), (1, Some(0), vec![], Some(2)));
        // Times.
        assert!(look(&[0, 33, 67, 99, 134]).2.is_empty());
        assert_eq!(look(&[7]).3, None);
        assert!(Numbering::new(vec![2, 1]).is_none());
    }
}
