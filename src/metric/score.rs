//! The values of all figures of a set of frames.

use crate::metric::MetricSet;
use crate::metric::figure::{Figure, Kind};
use crate::metric::set::round6;
use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::{Map, Value};
use std::ops::Index;

/// The values of all figures of a [`MetricSet`] for a set of frames, each rounded to 1e-6. NaN: undefined (no evaluated
/// frame; no tracked frame for `al_tracked`; no dense truth for `grid_*`; no starting anew after failures for
/// `frames_per_failure`), empty in CSV and `null` in JSON. Infinite medians are `inf` in CSV and, as JSON has no infinite
/// number, `null` in JSON, where the mean beside them is defined.
#[derive(Clone, PartialEq)]
pub struct Score {
    metrics: MetricSet,
    values: Box<[f64]>,
}

impl std::fmt::Debug for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let named = self.iter().map(|(figure, value)| (&figure.name, value));
        f.debug_map().entries(named).finish()
    }
}

impl Index<&str> for Score {
    type Output = f64;

    /// The figure called `name`.
    ///
    /// # Panics
    /// There is none; see [`Score::get`].
    fn index(&self, name: &str) -> &f64 {
        let index = self.metrics.figures().iter().position(|f| f.name == name);
        &self.values[index.unwrap_or_else(|| panic!("no figure '{name}'"))]
    }
}

impl Serialize for Score {
    /// A field per figure; counts are whole numbers.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.values.len()))?;
        for (figure, value) in self.iter() {
            match figure.kind {
                Kind::Count => map.serialize_entry(&figure.name, &(value as u64))?,
                Kind::Number => map.serialize_entry(&figure.name, &value)?,
            }
        }
        map.end()
    }
}

impl Score {
    /// Values in the order of the set's figures, which are rounded here.
    pub(crate) fn new(metrics: &MetricSet, mut values: Box<[f64]>) -> Score {
        values.iter_mut().for_each(|value| *value = round6(*value));
        Score {
            metrics: metrics.clone(),
            values,
        }
    }

    /// The figures with their values, in the order of columns.
    pub fn iter(&self) -> impl Iterator<Item = (&Figure, f64)> {
        self.metrics.figures().iter().zip(self.values.iter().copied())
    }

    /// The values, in the order of columns.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The figure called `name`, if there is one.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.iter()
            .find(|(figure, _)| figure.name == name)
            .map(|(_, value)| value)
    }

    /// Evaluated frames: annotated, not started on and not skipped; and all failures that a tracker was started anew after.
    pub fn frames(&self) -> usize {
        self["frames"] as usize
    }

    /// See [`Sample::failures`](crate::metric::Sample::failures).
    pub fn failures(&self) -> usize {
        self["failures"] as usize
    }

    /// Whether it is of trackers that are started anew after each failure; see
    /// [`Sample::restarted`](crate::metric::Sample::restarted).
    pub(crate) fn is_restarted(&self) -> bool {
        !self["frames_per_failure"].is_nan()
    }

    /// Mean of each figure over the sequences that have frames (and in which it is defined); counts are sums. `sequences`
    /// are what [`Sample::values`](crate::metric::Sample::values) says of each: the mean alone is rounded.
    pub(crate) fn mean(metrics: &MetricSet, sequences: &[Box<[f64]>]) -> Score {
        let frames = metrics.figures().iter().position(|f| f.name == "frames");
        let scored = |values: &&[f64]| frames.is_some_and(|index| values[index] > 0.0);
        let scored: Vec<&[f64]> = sequences.iter().map(|values| &**values).filter(scored).collect();
        let figure = |(index, figure): (usize, &Figure)| {
            let values = scored.iter().map(|values| values[index]);
            match figure.kind {
                // The sum of nothing would be -0.
                Kind::Count => values.fold(0.0, |sum, value| sum + value),
                Kind::Number => {
                    let defined: Vec<f64> = values.filter(|v| !v.is_nan()).collect();
                    defined.iter().sum::<f64>() / defined.len() as f64
                }
            }
        };
        let values = metrics.figures().iter().enumerate().map(figure).collect();
        Score::new(metrics, values)
    }

    /// From the fields that a score was written as. Fields that are missing (of a run without one of these metrics) are
    /// undefined; a `null` is undefined, too, unless it must be the value of a metric without output.
    pub(crate) fn from_json(metrics: &MetricSet, fields: &Map<String, Value>) -> Score {
        let number = |name: &str| fields.get(name).and_then(Value::as_f64);
        let value = |figure: &Figure| {
            let metric = &metrics.metrics()[figure.metric()];
            // Where not even the mean is defined, there is no frame to speak of.
            let measured = || number(&format!("{}_mean", metric.name)).is_some();
            match number(&figure.name) {
                Some(value) => value,
                None if !figure.without_output.is_nan() && measured() => figure.without_output,
                None if figure.kind == Kind::Count => 0.0,
                None => f64::NAN,
            }
        };
        Score::new(metrics, metrics.figures().iter().map(value).collect())
    }

    /// With another value of a figure.
    #[cfg(test)]
    pub(crate) fn with(mut self, name: &str, value: f64) -> Score {
        let index = self
            .metrics
            .figures()
            .iter()
            .position(|f| f.name == name)
            .unwrap();
        self.values[index] = value;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::{Errors, Sample};

    #[test]
    fn json_comes_back() {
        let metrics = MetricSet::builtin();
        let of = |frames: usize| Sample::new(&metrics, [&Errors::lost(&metrics, frames, 0)]).score();
        for score in [of(0), of(3), Score::mean(&metrics, &[])] {
            let text = serde_json::to_string(&score).unwrap();
            let fields: Map<String, Value> = serde_json::from_str(&text).unwrap();
            let read = Score::from_json(&metrics, &fields);
            // Compared as text, since NaN differs from itself.
            assert_eq!(format!("{read:?}"), format!("{score:?}"));
        }
        assert!(
            serde_json::to_string(&of(3))
                .unwrap()
                .starts_with(r#"{"frames":3,"sr_1":0.0,"#)
        );
    }

    #[test]
    fn counts_that_are_not_written_are_0_and_figures_undefined() {
        let metrics = MetricSet::builtin();
        let read = Score::from_json(&metrics, &Map::new());
        for (figure, value) in read.iter() {
            match figure.kind {
                Kind::Count => assert_eq!(value, 0.0, "{}", figure.name),
                Kind::Number => assert!(value.is_nan(), "{}", figure.name),
            }
        }
    }
}
