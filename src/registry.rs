//! stand-in
#![allow(missing_docs)]
use crate::geom::Corners;
use crate::image::Frame;
use crate::tracker::{Stop, TrackError, Tracker, Update};
use std::fmt;

#[derive(Clone, Debug, Default)]
pub struct Selection {
    pub sm: Vec<String>,
    pub am: Vec<String>,
    pub ssm: Vec<String>,
    pub ilm: Vec<String>,
    pub trackers: Vec<String>,
    pub sets: Vec<(String, String)>,
    pub res: Option<(usize, usize)>,
    pub max_iters: Option<u32>,
    pub epsilon: Option<f64>,
    pub channels: Option<usize>,
}
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct SpecError(pub String);
#[derive(Clone, Debug)]
pub struct Refusal {
    pub triple: String,
    pub reason: String,
}
#[derive(Clone, Debug)]
pub struct Expansion {
    pub specs: Vec<TrackerSpec>,
    pub refused: Vec<Refusal>,
}
#[derive(Clone, Debug)]
pub struct TrackerSpec {
    parts: [String; 3],
}
impl fmt::Display for TrackerSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.parts.join("/"))
    }
}
impl TrackerSpec {
    pub fn slug(&self) -> String {
        self.parts.join("_")
    }
    pub fn parts(&self) -> (String, String, String, String) {
        let [a, b, c] = self.parts.clone();
        (a, b, c, String::new())
    }
    pub fn resolved(&self) -> serde_json::Value {
        serde_json::json!({"sm": self.parts[0]})
    }
}
pub struct Registry;
const NAMES: [&[&str]; 3] = [
    &["esm", "fclk", "iclk", "nn"],
    &["ssd", "ncc", "sad"],
    &["homography", "translation"],
];
impl Registry {
    pub fn builtin() -> Registry {
        Registry
    }
    pub fn expand(&self, s: &Selection) -> Result<Expansion, SpecError> {
        let mut lists = Vec::new();
        for (given, names) in [&s.sm, &s.am, &s.ssm].into_iter().zip(NAMES) {
            let mut list: Vec<String> = Vec::new();
            for name in given {
                match name.to_lowercase().as_str() {
                    "all" => list.extend(names.iter().map(|s| s.to_string())),
                    n if names.contains(&n) => list.push(n.to_string()),
                    n => {
                        return Err(SpecError(format!(
                            "unknown name '{n}', did you mean '{}'?",
                            names[0]
                        )));
                    }
                }
            }
            lists.push(list);
        }
        let mut e = Expansion {
            specs: Vec::new(),
            refused: Vec::new(),
        };
        for a in &lists[0] {
            for b in &lists[1] {
                for c in &lists[2] {
                    if b == "sad" && a != "nn" {
                        e.refused.push(Refusal {
                            triple: format!("{a}/{b}/{c}"),
                            reason: "sad has no derivatives".into(),
                        });
                    } else {
                        e.specs.push(TrackerSpec {
                            parts: [a.clone(), b.clone(), c.clone()],
                        });
                    }
                }
            }
        }
        Ok(e)
    }
    pub fn build(&self, spec: &TrackerSpec) -> Result<Box<dyn Tracker>, SpecError> {
        Ok(Box::new(Fake {
            at: Corners::rect(0.0, 0.0, 1.0, 1.0),
            step: spec.parts[0].len() as f64 * 0.1,
        }))
    }
}
struct Fake {
    at: Corners,
    step: f64,
}
impl Tracker for Fake {
    fn init(&mut self, _frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.at = *corners;
        Ok(())
    }
    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        // Work enough to be interrupted.
        let mut sum = 0.0;
        for _ in 0..20 {
            for y in 0..frame.height() {
                sum += frame.gray().row(0, y).iter().sum::<f32>();
            }
        }
        self.at = self.at.translated(self.step, 0.0);
        Ok(Update {
            corners: self.at,
            stop: Stop::Done,
            iterations: 1,
            similarity: f64::from(sum),
        })
    }
    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.at = *corners;
        Ok(())
    }
    fn corners(&self) -> Corners {
        self.at
    }
}
