//! Where trackers start on a sequence. From each start a tracker goes to the end in one pass.

use std::fmt;
use std::str::FromStr;

/// Sub-sequences without a number.
const USUAL_SUBSEQUENCES: u32 = 10;

/// An evaluation protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Protocol {
    /// One pass from the first annotated frame.
    #[default]
    Ope,
    /// One pass from each of `n` frames `k * max((len - 1) / n, 1)`, `k < n`: the sub-sequences of Singh & Jagersand.
    Subseq(u32),
}

impl Protocol {
    /// The frames that trackers start on in a sequence of `len` frames of which those with `annotated` have ground
    /// truth: a start without moves on to the next that has.
    pub fn starts(&self, len: usize, annotated: impl Fn(usize) -> bool) -> Vec<u32> {
        let from = |first: usize| (first..len).find(|&i| annotated(i)).map(|i| i as u32);
        match *self {
            Protocol::Ope => from(0).into_iter().collect(),
            Protocol::Subseq(n) => {
                let gap = (len.saturating_sub(1) / n as usize).max(1);
                let wanted = (0..n as usize).map(|k| k * gap);
                // A start on the last frame has nothing to track, unless it is the only one.
                let mut starts: Vec<u32> = wanted
                    .take_while(|&start| start == 0 || start + 1 < len)
                    .filter_map(from)
                    .collect();
                starts.dedup();
                starts
            }
        }
    }
}

impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Protocol::Ope => f.write_str("ope"),
            Protocol::Subseq(n) => write!(f, "subseq:{n}"),
        }
    }
}

impl FromStr for Protocol {
    type Err = String;

    fn from_str(text: &str) -> Result<Protocol, String> {
        let text = text.trim().to_ascii_lowercase();
        let count = |n: &str| n.parse().ok().filter(|n| (1..=100_000).contains(n));
        let protocol = match text.split_once(':') {
            None if text == "ope" => Some(Protocol::Ope),
            None if text == "subseq" => Some(Protocol::Subseq(USUAL_SUBSEQUENCES)),
            Some(("subseq", n)) => count(n).map(Protocol::Subseq),
            _ => None,
        };
        protocol.ok_or_else(|| {
            format!("unknown protocol '{text}'; expected ope or subseq[:n], n from 1 to 100000")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_are_where_the_papers_put_them() {
        let all = |_: usize| true;
        assert_eq!(Protocol::Ope.starts(100, all), [0]);
        assert_eq!(Protocol::Ope.starts(100, |i| i >= 3), [3]);
        assert_eq!(
            Protocol::Subseq(10).starts(100, all),
            [0, 9, 18, 27, 36, 45, 54, 63, 72, 81]
        );
        assert_eq!(Protocol::Subseq(10).starts(4, all), [0, 1, 2]);
        assert_eq!(Protocol::Subseq(2).starts(9, |i| i % 3 == 0), [0, 6]);
        assert_eq!(Protocol::Subseq(10).starts(1, all), [0]);
        assert!(Protocol::Subseq(10).starts(5, |_| false).is_empty());
    }

    #[test]
    fn names_come_back() {
        for text in ["ope", "subseq:10", "subseq:3"] {
            assert_eq!(text.parse::<Protocol>().unwrap().to_string(), text);
        }
        assert_eq!("SUBSEQ".parse(), Ok(Protocol::Subseq(10)));
        for bad in ["", "subseq:0", "subseq:x", "reinit", "ope:3"] {
            assert!(bad.parse::<Protocol>().is_err(), "{bad}");
        }
    }
}
