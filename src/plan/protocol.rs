//! Where trackers start on a sequence, and what happens to them until its end.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// Largest number of starts, and of frames between two of them.
const LARGEST: u32 = 100_000;

/// An evaluation protocol.
///
/// In all of them the ground truth of a start is all that a tracker is told. Started anew means a new tracker with the
/// seed of a start on that frame: what comes after does not depend on what came before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Protocol {
    /// One pass from the first annotated frame.
    #[default]
    Ope,
    /// One pass from each of `n` frames `k * max((len - 1) / n, 1)`, `k < n`: the sub-sequences of Singh & Jagersand.
    Subseq(u32),
    /// As [`Ope`](Self::Ope), but a tracker that fails is started anew `skip` frames later, or on the next frame with
    /// ground truth from there; the sequence ends where fewer than `skip` frames are left.
    ///
    /// A failure is an alignment error above `threshold`, no finite output, an error or a panic of the tracker, or a start
    /// that it refuses (but for the first: that fails the unit). The frame of a failure counts as one of the evaluated
    /// frames, without success, and has no part in mean and median errors; frames that are started on or skipped are not
    /// evaluated. So a tracker that fails often cannot have a high success rate, while errors are those of a tracker on its
    /// object.
    Reinit {
        /// Alignment error above which a frame is a failure, px.
        threshold: f64,
        /// Frames from a failure to the next start.
        skip: u32,
    },
    /// As [`Ope`](Self::Ope), but every `k` frames, once it has tracked the frame, the tracker is started anew on it (or on
    /// the next with ground truth): every frame but the first is evaluated, none of them further than `k` from a start. One
    /// that panics or refuses a start has no output until the next.
    Every(u32),
}

impl Protocol {
    /// Sub-sequences without a number.
    pub const SUBSEQUENCES: u32 = 10;
    /// Re-initialisation without a threshold, px.
    pub const THRESHOLD: f64 = 20.0;
    /// Re-initialisation without a number of frames.
    pub const SKIP: u32 = 5;
    /// Frames between starts, when not told.
    pub const EVERY: u32 = 10;

    /// The frames that trackers start on in a sequence of `len` frames of which those with `annotated` have ground
    /// truth: a start without moves on to the next that has.
    pub fn starts(&self, len: usize, annotated: impl Fn(usize) -> bool) -> Vec<u32> {
        let from = |first: usize| (first..len).find(|&i| annotated(i)).map(|i| i as u32);
        match *self {
            Protocol::Ope | Protocol::Reinit { .. } | Protocol::Every(_) => from(0).into_iter().collect(),
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

    /// The protocol whose name stands for what happens to a tracker after its start: one pass to the end is
    /// [`Ope`](Self::Ope), so that its units are those of sub-sequences, too.
    pub fn course(&self) -> Protocol {
        match *self {
            Protocol::Subseq(_) => Protocol::Ope,
            other => other,
        }
    }

    /// Whether failures end a stretch of tracking: then they are what counts as failures, errors are averaged without
    /// them, and the number of evaluated frames depends on the tracker.
    pub fn restarts_on_failure(&self) -> bool {
        matches!(self, Protocol::Reinit { .. })
    }
}

impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Protocol::Ope => f.write_str("ope"),
            Protocol::Subseq(n) => write!(f, "subseq:{n}"),
            Protocol::Reinit { threshold, skip } => write!(f, "reinit:{threshold}:{skip}"),
            Protocol::Every(k) => write!(f, "every:{k}"),
        }
    }
}

/// A text that names no protocol.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "unknown protocol '{0}'; expected ope, subseq[:n], reinit[:thresh[:skip]] or every[:k], with thresh in px above 0, \
     the others from 1 to {LARGEST}"
)]
pub struct ProtocolError(String);

impl FromStr for Protocol {
    type Err = ProtocolError;

    fn from_str(text: &str) -> Result<Protocol, ProtocolError> {
        let text = text.trim().to_ascii_lowercase();
        let count = |n: &str| n.parse().ok().filter(|n| (1..=LARGEST).contains(n));
        let pixels = |x: &str| x.parse().ok().filter(|x: &f64| *x > 0.0 && *x < 1e6);
        let parts: Vec<&str> = text.split(':').collect();
        let protocol = match parts[..] {
            ["ope"] => Some(Protocol::Ope),
            ["subseq"] => Some(Protocol::Subseq(Protocol::SUBSEQUENCES)),
            ["subseq", n] => count(n).map(Protocol::Subseq),
            ["reinit"] => Some(reinit((Protocol::THRESHOLD, Protocol::SKIP))),
            ["reinit", threshold] => pixels(threshold).zip(Some(Protocol::SKIP)).map(reinit),
            ["reinit", threshold, skip] => pixels(threshold).zip(count(skip)).map(reinit),
            ["every"] => Some(Protocol::Every(Protocol::EVERY)),
            ["every", k] => count(k).map(Protocol::Every),
            _ => None,
        };
        protocol.ok_or(ProtocolError(text))
    }
}

fn reinit((threshold, skip): (f64, u32)) -> Protocol {
    Protocol::Reinit { threshold, skip }
}

/// The protocols of a run: at least one, each once, in the order of their names.
#[derive(Clone, Debug, PartialEq)]
pub struct Protocols(Vec<Protocol>);

impl Protocols {
    /// Those given, or [`Protocol::Ope`] when there are none.
    pub fn new(protocols: impl IntoIterator<Item = Protocol>) -> Protocols {
        let mut list: Vec<Protocol> = protocols.into_iter().collect();
        list.sort_by_cached_key(Protocol::to_string);
        list.dedup();
        if list.is_empty() {
            list.push(Protocol::Ope);
        }
        Protocols(list)
    }

    /// The first that has the [course](Protocol::course) of number `index`: units of the same course are shared.
    pub fn course(&self, index: usize) -> usize {
        let course = self.0[index].course();
        let first = self.0.iter().position(|p| p.course() == course);
        first.unwrap_or(index)
    }
}

impl std::ops::Deref for Protocols {
    type Target = [Protocol];

    fn deref(&self) -> &[Protocol] {
        &self.0
    }
}

impl Default for Protocols {
    fn default() -> Protocols {
        Protocols::new([])
    }
}

impl From<Protocol> for Protocols {
    fn from(protocol: Protocol) -> Protocols {
        Protocols(vec![protocol])
    }
}

impl fmt::Display for Protocols {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<String> = self.0.iter().map(Protocol::to_string).collect();
        f.write_str(&names.join(","))
    }
}

impl FromStr for Protocols {
    type Err = ProtocolError;

    fn from_str(text: &str) -> Result<Protocols, ProtocolError> {
        let list: Vec<Protocol> = text.split(',').map(str::parse).collect::<Result<_, _>>()?;
        Ok(Protocols::new(list))
    }
}

impl Serialize for Protocols {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Protocols {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Protocols, D::Error> {
        let text = std::borrow::Cow::<str>::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
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
        assert_eq!(Protocol::Every(3).starts(100, |i| i >= 3), [3]);
    }

    #[test]
    fn names_come_back() {
        for text in [
            "ope",
            "subseq:10",
            "subseq:3",
            "reinit:20:5",
            "reinit:7.5:1",
            "every:4",
        ] {
            assert_eq!(text.parse::<Protocol>().unwrap().to_string(), text);
        }
        for (short, long) in [
            ("SUBSEQ", "subseq:10"),
            ("reinit", "reinit:20:5"),
            ("reinit:5", "reinit:5:5"),
            ("every", "every:10"),
        ] {
            assert_eq!(short.parse::<Protocol>().unwrap().to_string(), long);
        }
        for bad in [
            "",
            "subseq:0",
            "subseq:x",
            "reinit:0",
            "reinit:nan:5",
            "reinit:20:0",
            "reinit:20:5:1",
            "every:0",
            "ope:3",
        ] {
            let said = bad.parse::<Protocol>().unwrap_err().to_string();
            assert!(
                said.starts_with(&format!("unknown protocol '{bad}'")) && said.ends_with("100000"),
                "{said}"
            );
        }
    }

    #[test]
    fn lists_have_an_order_and_share_courses() {
        let list: Protocols = "subseq:10, reinit,ope,subseq".parse().unwrap();
        assert_eq!(list.to_string(), "ope,reinit:20:5,subseq:10");
        assert_eq!([0, 1, 2].map(|k| list.course(k)), [0, 1, 0]);
        assert_eq!(Protocols::default().to_string(), "ope");
        let text = serde_json::to_string(&list).unwrap();
        assert_eq!(serde_json::from_str::<Protocols>(&text).unwrap(), list);
        assert!("ope,,every".parse::<Protocols>().is_err());
    }
}
