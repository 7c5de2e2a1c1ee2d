//! Figures: what is made of the errors of a set of frames.
//!
//! [`FIGURES`] is the one table of them. Its rows stand for one column of result files or for several: a row `sr_T` for
//! each of its thresholds, a row `M_mean` for each metric.

use crate::metric::{Direction, Metric, MetricSet, Sample, Score};

/// A figure: a column of result files.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Name of the column.
    pub name: String,
    /// Which values are better.
    pub better: Direction,
    /// What it is, and how those of sequences are joined.
    pub kind: Kind,
    /// The frames that it is a mean over, so that those of sequences can be pooled; `None`: it is no mean.
    pub frame_mean: Option<MeanOver>,
    /// By how much it may get worse before the regression gate fails, where nobody says otherwise; `None`: the gate does
    /// not look at it.
    pub tolerance: Option<f64>,
    /// Unit; empty for a ratio.
    pub unit: &'static str,
    /// What it is when there are frames but not one of them has a value; `null` in JSON.
    pub(crate) without_output: f64,
    metric: usize,
    at: f64,
    formula: Formula,
}

impl Figure {
    /// Its value for a set of frames. NaN where it is undefined.
    pub fn of(&self, sample: &Sample) -> f64 {
        (self.formula)(sample, self.metric, self.at)
    }

    /// Frames of `score` that it is a mean over: what it weighs where those of sequences are pooled.
    pub(crate) fn weight(&self, score: &Score) -> f64 {
        match self.frame_mean {
            None => 0.0,
            Some(MeanOver::Evaluated) => score.frames() as f64,
            Some(MeanOver::Tracked) if score.is_restarted() => (score.frames() - score.failures()) as f64,
            Some(MeanOver::Tracked) => score.frames() as f64,
        }
    }

    /// Number of its metric in the set.
    pub(crate) fn metric(&self) -> usize {
        self.metric
    }
}

/// The frames that a figure is a mean over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeanOver {
    /// All evaluated frames.
    Evaluated,
    /// The same, but for failures that a tracker was started anew after.
    Tracked,
}

/// What a figure is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A whole number; over sequences the sum.
    Count,
    /// A number; over sequences the mean of those in which it is defined.
    Number,
}

/// From the errors of a set of frames, the number of the metric and the threshold of the figure to its value.
pub type Formula = fn(&Sample, usize, f64) -> f64;

/// What a row of [`FIGURES`] stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// A figure of the primary metric, or of the frames as such.
    All,
    /// A figure of each metric: `M` in its name is the metric's.
    Metric,
    /// A figure of the primary metric that stands with those of its kind.
    Primary,
}

/// A row of [`FIGURES`].
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Name of its columns, where `M` stands for a metric and `T` for a threshold.
    pub name: &'static str,
    /// Unit; `None`: that of the metric.
    pub unit: Option<&'static str>,
    /// One line for `list metrics`.
    pub summary: &'static str,
    /// Which values are better; `None`: those that are for the metric.
    pub better: Option<Direction>,
    /// What it is.
    pub kind: Kind,
    /// Which columns it stands for.
    pub of: Of,
    /// The thresholds that `T` stands for, in the metric's unit.
    pub at: &'static [f64],
    /// The frames that it is a mean over; `None`: it is no mean.
    pub frame_mean: Option<MeanOver>,
    /// Default tolerance of the regression gate for a metric and a threshold.
    pub tolerance: fn(&Metric, f64) -> Option<f64>,
    /// Whether it is a value of the metric even when no frame has output: [`Metric::lost`].
    pub counts_lost: bool,
    /// How it is computed.
    pub formula: Formula,
}

/// A count or number of the primary metric, of which larger is better; rows say what is otherwise.
const ROW: Row = Row {
    name: "",
    unit: Some(""),
    summary: "",
    better: Some(Direction::LargerIsBetter),
    kind: Kind::Number,
    of: Of::All,
    at: &[],
    frame_mean: None,
    tolerance: |_, _| None,
    counts_lost: false,
    formula: |_, _, _| f64::NAN,
};

/// All figures, in the order of columns. [`Sample`] has the formulas.
pub static FIGURES: [Row; 9] = [
    Row {
        name: "frames",
        unit: Some("frames"),
        summary: "evaluated frames: those with ground truth that the tracker was not started on",
        kind: Kind::Count,
        formula: |s, _, _| s.frames() as f64,
        ..ROW
    },
    Row {
        name: "sr_T",
        summary: "fraction of the evaluated frames with al <= T px; a frame without output is above every T",
        at: &[1.0, 2.0, 5.0, 10.0, 20.0],
        frame_mean: Some(MeanOver::Evaluated),
        tolerance: |_, t| (t == 5.0).then_some(0.01),
        formula: |s, m, t| s.success_rate(m, t),
        ..ROW
    },
    Row {
        name: "auc",
        summary: "mean of sr_T over T = 0.2, 0.4, ..., 20 px",
        frame_mean: Some(MeanOver::Evaluated),
        tolerance: |_, _| Some(0.005),
        formula: |s, m, _| s.auc(m),
        ..ROW
    },
    Row {
        name: "sr_area",
        unit: Some("px"),
        summary: "area under sr_T from T = 1 to 20 px, at most 19",
        frame_mean: Some(MeanOver::Evaluated),
        formula: |s, _, _| s.sr_area(),
        ..ROW
    },
    Row {
        name: "M_mean",
        unit: None,
        summary: "mean of metric M, each frame capped (see M); a frame without output counts as the cap",
        better: None,
        of: Of::Metric,
        frame_mean: Some(MeanOver::Tracked),
        formula: |s, m, _| s.mean(m),
        ..ROW
    },
    Row {
        name: "M_median",
        unit: None,
        summary: "median of metric M, not capped; a frame without output counts as infinite (as 1 for jaccard)",
        better: None,
        of: Of::Metric,
        tolerance: |m, _| m.tolerance,
        counts_lost: true,
        formula: |s, m, _| s.median(m),
        ..ROW
    },
    Row {
        name: "al_tracked",
        unit: None,
        summary: "mean al of the frames at or below 20 px",
        better: None,
        of: Of::Primary,
        formula: |s, _, _| s.al_tracked(),
        ..ROW
    },
    Row {
        name: "failures",
        unit: Some("frames"),
        summary: "evaluated frames with al > 20 px or no output; with reinit, failures after which a tracker is started \
                  anew: they count in sr_T and auc, not in mean and median errors",
        better: Some(Direction::SmallerIsBetter),
        kind: Kind::Count,
        formula: |s, _, _| s.failures() as f64,
        ..ROW
    },
    Row {
        name: "frames_per_failure",
        unit: Some("frames"),
        summary: "with reinit: evaluated frames / (failures + 1), the mean length of a stretch",
        formula: |s, _, _| s.frames_per_failure(),
        ..ROW
    },
];

/// Names that are columns of some file already.
pub(super) const RESERVED: [&str; 27] = [
    "average",
    "dataset",
    "failed",
    "failed_runs",
    "file",
    "frame",
    "iterations",
    "metric",
    "override",
    "protocol",
    "reason",
    "runs",
    "sequence",
    "sequences",
    "similarity",
    "start",
    "status",
    "tracker",
    "sm",
    "am",
    "ssm",
    "ilm",
    "threshold",
    "success_rate",
    "command",
    "fps",
    "tags",
];

impl Row {
    /// The row's figures of metric number `index`.
    fn figures(&self, index: usize, metric: &Metric) -> impl Iterator<Item = Figure> {
        let thresholds = if self.at.is_empty() { &[f64::NAN] } else { self.at };
        thresholds.iter().map(move |&at| {
            let name = match self.of {
                Of::Metric => self.name.replacen('M', metric.name, 1),
                _ => self.name.replacen('T', &at.to_string(), 1),
            };
            Figure {
                name,
                better: self.better.unwrap_or(metric.better),
                kind: self.kind,
                // Frames with dense truth are others than those that figures are weighed by.
                frame_mean: self.frame_mean.filter(|_| !metric.is_dense()),
                tolerance: (self.tolerance)(metric, at),
                unit: self.unit.unwrap_or(metric.unit),
                without_output: if self.counts_lost { metric.lost } else { f64::NAN },
                metric: index,
                at,
                formula: self.formula,
            }
        })
    }
}

/// The figures of `metrics`, of which the first is the primary one: the rows of single metrics metric by metric.
pub(super) fn expand(metrics: &[Metric]) -> Vec<Figure> {
    let mut figures = Vec::new();
    for rows in FIGURES.chunk_by(|a, b| (a.of == Of::All) == (b.of == Of::All)) {
        let of = if rows[0].of == Of::All {
            &metrics[..1]
        } else {
            metrics
        };
        for (index, metric) in of.iter().enumerate() {
            let rows = rows.iter().filter(|row| row.of != Of::Primary || index == 0);
            figures.extend(rows.flat_map(|row| row.figures(index, metric)));
        }
    }
    figures
}

/// Name, unit and description of all metrics and figures, for `list metrics`.
pub fn listing(set: &MetricSet) -> Vec<[String; 3]> {
    let metric = |m: &Metric| {
        let cap = format!("{} {}", m.cap, m.unit);
        let summary = format!("{}; capped at {} in means", m.summary, cap.trim_end());
        [m.name.to_owned(), m.unit.to_owned(), summary]
    };
    let figure = |row: &Row| {
        let unit = match row.of {
            Of::Metric => "as M",
            _ => row.unit.unwrap_or(set.primary().unit),
        };
        [row.name, unit, row.summary].map(str::to_owned)
    };
    set.metrics()
        .iter()
        .map(metric)
        .chain(FIGURES.iter().map(figure))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns() {
        let set = MetricSet::builtin();
        let names: Vec<&str> = set.figures().iter().map(|f| f.name.as_str()).collect();
        let expected = "frames sr_1 sr_2 sr_5 sr_10 sr_20 auc sr_area al_mean al_median al_tracked mcd_mean mcd_median \
                        cl_mean cl_median jaccard_mean jaccard_median grid_mean grid_median failures \
                        frames_per_failure";
        assert_eq!(names.join(" "), expected);
        let gated = |f: &&Figure| f.tolerance.is_some();
        let gated: Vec<&str> = set
            .figures()
            .iter()
            .filter(gated)
            .map(|f| f.name.as_str())
            .collect();
        assert_eq!(gated, ["sr_5", "auc", "al_median"]);
        assert!(set.figures().iter().all(|f| f.frame_mean.is_some()
            == (f.name.starts_with("sr_")
                || f.name == "auc"
                || f.name.ends_with("_mean") && f.name != "grid_mean")));
    }

    #[test]
    fn figures_weigh_the_frames_that_they_are_a_mean_over() {
        use crate::metric::{Errors, Sample};
        let metrics = MetricSet::builtin();
        let mut errors = Errors::new(&metrics);
        (0..5).for_each(|_| errors.push_values(&[1.0, 1.0, 1.0, 0.5]));
        (0..2).for_each(|_| errors.push_lost());
        let sample = Sample::new(&metrics, [&errors]);
        let weight = |name: &str, score: &crate::metric::Score| metrics.figure(name).unwrap().weight(score);
        // Failures of trackers that go on are frames like others; of those that start anew they have no error.
        let (on, anew) = (sample.score(), sample.clone().restarted().score());
        for (name, weights) in [
            ("sr_5", [7.0, 7.0]),
            ("al_mean", [7.0, 5.0]),
            ("al_median", [0.0, 0.0]),
        ] {
            assert_eq!([weight(name, &on), weight(name, &anew)], weights, "{name}");
        }
    }
}
