//! Recorded results as a tracker: it gives what another program has said of each frame. So they are scored, ranked, compared
//! and reported by what does that for every tracker.

use super::tracker::{Answers, Job, TrackerEntry};
use crate::dataset::Sequence;
use crate::dataset::recorded::{Answer, Recorded, Track};
use crate::metric::aggregate::TrackerName;
use mtf::geom::Corners;
use mtf::image::Frame;
use mtf::registry::slug;
use mtf::tracker::{Stop, TrackError, Tracker, Update};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::Arc;

impl TrackerEntry {
    /// A tracker that repeats `recorded`, the results on `sequences`.
    pub fn from_recorded(recorded: Recorded, sequences: &[Sequence]) -> TrackerEntry {
        let answers = match recorded.boxes() {
            true => Answers::Boxes,
            false => Answers::Corners,
        };
        let name = TrackerName {
            id: recorded.tracker.clone(),
            ..TrackerName::default()
        };
        let key = |s: &Sequence| (s.dataset().to_owned(), s.name().to_owned());
        let mut files = Map::new();
        for (sequence, track) in sequences.iter().zip(&recorded.tracks) {
            files.insert(super::sequence_id(sequence), digest(track));
        }
        let tracks = sequences
            .iter()
            .zip(recorded.tracks)
            .map(|(s, track)| (key(s), Arc::new(track)));
        let tracks: BTreeMap<(String, String), Arc<Track>> = tracks.collect();
        let make = move |job: Job<'_>| -> Result<Box<dyn Tracker>, String> {
            let track = job.sequence.and_then(|sequence| tracks.get(&key(sequence)));
            let track = track.ok_or("no results of this sequence")?;
            Ok(Box::new(Replay {
                track: track.clone(),
                at: job.start,
            }))
        };
        TrackerEntry {
            slug: slug(&name.id),
            name,
            parameters: json!({ "recorded": files }),
            answers,
            make: Arc::new(make),
        }
    }
}

/// Identity of what a track says, in hex digits.
fn digest(track: &Track) -> Value {
    if track.path.is_none() {
        return Value::Null;
    }
    let mut hasher = Sha256::new();
    let mut number = |v: f64| hasher.update(v.to_le_bytes());
    for answer in &track.answers {
        match answer {
            Answer::Corners(corners) => corners.to_array().into_iter().for_each(&mut number),
            Answer::Absent(corners) => {
                number(f64::NAN);
                let corners = corners.map(Corners::to_array);
                corners.into_iter().flatten().for_each(&mut number);
            }
            Answer::Missing => number(f64::INFINITY),
        }
    }
    track.confidence.iter().copied().for_each(&mut number);
    hex::encode(&hasher.finalize()[..8]).into()
}

/// A tracker that repeats what is recorded.
struct Replay {
    track: Arc<Track>,
    /// The frame it is at.
    at: usize,
}

impl Tracker for Replay {
    fn init(&mut self, _: &Frame, _: &Corners) -> Result<(), TrackError> {
        Ok(())
    }

    fn update(&mut self, _: &Frame) -> Result<Update, TrackError> {
        self.at += 1;
        let found = |corners: Corners, stop: Stop| Update {
            corners,
            stop,
            iterations: 0,
            similarity: self.track.confidence.get(self.at).copied().unwrap_or(f64::NAN),
        };
        match self.track.answers.get(self.at) {
            Some(Answer::Corners(corners)) => Ok(found(*corners, Stop::Done)),
            Some(Answer::Absent(Some(corners))) => Ok(found(*corners, Stop::Absent)),
            Some(Answer::Absent(None)) => Err(TrackError::Absent),
            _ => Err(TrackError::Missing),
        }
    }

    fn set_region(&mut self, _: &Corners) -> Result<(), TrackError> {
        Ok(())
    }

    /// NaN where nothing is said.
    fn corners(&self) -> Corners {
        match self.track.answers.get(self.at) {
            Some(Answer::Corners(corners) | Answer::Absent(Some(corners))) => *corners,
            _ => Corners([[f64::NAN; 2]; 4]),
        }
    }

    fn channels(&self) -> usize {
        0
    }

    fn seconds(&self, _: f64) -> f64 {
        self.track.seconds.get(self.at).copied().unwrap_or(f64::NAN)
    }
}
