//! `success.svg`: success rate against the alignment error threshold, the best trackers named at the ends of their lines and
//! the others faint.

use super::table::short;
use super::{About, Exporter, ReportError};
use crate::metric::Results;
use crate::metric::aggregate::{CurveRow, SummaryRow};
use crate::metric::al::LOST_PX;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::collections::BTreeSet;
use std::io::{self, Write};

/// Curves with a colour and a name, at most: as many as there are colours.
const NAMED: usize = COLOURS.len();
/// Faint curves, at most; of more, so many are drawn that are evenly spread over the ranking.
const FAINT: usize = 40;
/// Drawn at this multiple of the size in CSS pixels, since the backend rounds coordinates to whole units.
pub(super) const SCALE: u32 = 4;
/// Size in CSS pixels: a plot and the names on its right.
const PLOT_WIDTH: u32 = 620;
const NAMES_WIDTH: u32 = 400;
const HEIGHT: u32 = 480;
/// Space around the axes, in CSS pixels.
const ABOVE: u32 = 84;
const BELOW: u32 = 52;
const LEFT: u32 = 60;
const MARGIN: u32 = 14;
/// Least distance of two names, in CSS pixels.
const LINE: i32 = 22;
/// Characters of a name that fit beside the plot.
const LABEL: usize = 40;
/// Share of its last success rate at which a curve has risen.
const RISEN: f64 = 0.95;
/// Where all curves have risen within so many px, the axis ends there; where half of them have, it is logarithmic.
const SHORT_PX: f64 = 2.0;

/// Colours that stay apart with every common kind of colour blindness (Okabe and Ito 2008), without the yellow that
/// vanishes on white.
pub(super) const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(0, 0, 0),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
];
pub(super) const INK: RGBColor = RGBColor(51, 51, 51);
pub(super) const GRID: RGBColor = RGBColor(225, 225, 225);
/// Of curves without a name.
const PALE: RGBColor = RGBColor(200, 200, 200);

/// Line of the curve at `rank`. Better trackers are drawn first and wider, so that curves that coincide show as nested
/// lines.
fn line(rank: usize) -> ShapeStyle {
    let width = 18 - 2 * rank as u32;
    COLOURS[rank].stroke_width(width)
}

fn text(size: u32) -> TextStyle<'static> {
    ("sans-serif", size * SCALE).into_font().color(&INK)
}

pub(super) fn anchored(size: u32, h: HPos, v: VPos) -> TextStyle<'static> {
    text(size).pos(Pos::new(h, v))
}

/// `id` shortened in its middle to `length` characters.
pub(super) fn shorten(id: &str, length: usize) -> String {
    let chars: Vec<char> = id.chars().collect();
    if chars.len() <= length {
        return id.to_owned();
    }
    let (head, tail) = (length / 2, length - length / 2 - 1);
    chars[..head]
        .iter()
        .chain(&['…'])
        .chain(&chars[chars.len() - tail..])
        .collect()
}

/// A picture of a size in CSS pixels. `draw` works in units of `1 / SCALE` of them.
///
/// # Errors
/// [`ReportError::Plot`] when the drawing backend refuses.
pub(super) fn picture(
    width: u32,
    height: u32,
    draw: impl FnOnce(&Area) -> Result<(), Box<dyn std::error::Error>>,
) -> Result<String, ReportError> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (width * SCALE, height * SCALE)).into_drawing_area();
        draw(&root).map_err(|e| ReportError::Plot(e.to_string()))?;
        root.present().map_err(|e| ReportError::Plot(e.to_string()))?;
    }
    // The view box keeps the fine units; the picture itself has the size in CSS pixels.
    let fine = format!("width=\"{}\" height=\"{}\"", width * SCALE, height * SCALE);
    Ok(svg.replacen(&fine, &format!("width=\"{width}\" height=\"{height}\""), 1))
}

/// `success.svg`: the success plot.
pub(super) struct SuccessSvg;

impl Exporter for SuccessSvg {
    fn file(&self) -> &str {
        "success.svg"
    }

    fn summary(&self) -> &str {
        "success plot: the best trackers named, the others faint"
    }

    fn write(&self, results: &Results, about: &About, out: &mut dyn Write) -> io::Result<()> {
        let svg = success_svg(results, &about.title).map_err(io::Error::other)?;
        out.write_all(svg.as_bytes())
    }
}

/// A success curve with its name.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCurve {
    /// What stands at its end.
    pub name: String,
    /// Its area, which stands before the name.
    pub auc: f64,
    /// Thresholds (px) and success rates.
    pub points: Vec<(f64, f64)>,
}

/// The pooled success curves of `results`, the largest `auc` first.
pub fn success_curves(results: &Results) -> Vec<NamedCurve> {
    let primary = results.metrics.primary();
    let ranking = results.ranking();
    let several = ranking.iter().any(|row| row.protocol != ranking[0].protocol);
    let named = |row: &&SummaryRow| {
        let same = |c: &&CurveRow| {
            c.is_pooled() && c.metric == *primary && c.tracker == row.tracker && c.protocol == row.protocol
        };
        let curve = results
            .curves
            .iter()
            .find(same)
            .filter(|c| !c.success_rate.is_empty())?;
        let rates = curve.success_rate.iter().enumerate();
        Some(NamedCurve {
            name: match several {
                true => format!("{} {}", row.tracker.id, row.protocol),
                false => row.tracker.id.clone(),
            },
            auc: row.score["auc"],
            points: rates.map(|(k, &rate)| (primary.threshold(k), rate)).collect(),
        })
    };
    ranking.iter().filter_map(named).collect()
}

/// What the curves of `results` are of: data, sequences, frames and protocol.
pub fn success_subject(results: &Results) -> String {
    const SHOWN: usize = 3;
    let datasets: BTreeSet<&str> = results.sequences.iter().map(|r| r.dataset.as_str()).collect();
    let sequences: BTreeSet<(&str, &str)> = results
        .sequences
        .iter()
        .map(|r| (r.dataset.as_str(), r.sequence.as_str()))
        .collect();
    let ranking = results.ranking();
    let frames = ranking.iter().map(|row| row.score.frames());
    let frames = match (frames.clone().min(), frames.max()) {
        (Some(least), Some(most)) if least < most => format!("{least} to {most}"),
        (_, most) => most.unwrap_or(0).to_string(),
    };
    let protocols: BTreeSet<&str> = ranking.iter().map(|row| row.protocol.as_str()).collect();
    let list = |names: &BTreeSet<&str>| {
        let more = match names.len().saturating_sub(SHOWN) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        names.iter().take(SHOWN).copied().collect::<Vec<_>>().join(", ") + &more
    };
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    format!(
        "{}: {}, {frames} frames, protocol {}",
        list(&datasets),
        count(sequences.len(), "sequence"),
        list(&protocols)
    )
}

/// Draws the success plot of `results` under `title`: see [`curves_svg`].
///
/// # Errors
/// [`ReportError::Plot`] when the drawing backend refuses.
pub fn success_svg(results: &Results, title: &str) -> Result<String, ReportError> {
    curves_svg(&success_curves(results), title, &success_subject(results))
}

/// Draws success curves, the best first, under a title and a line that says what they are of. The first have colours and
/// names, the others are faint.
///
/// # Errors
/// [`ReportError::Plot`] when the drawing backend refuses.
pub fn curves_svg(curves: &[NamedCurve], title: &str, subject: &str) -> Result<String, ReportError> {
    let svg = picture(PLOT_WIDTH + NAMES_WIDTH, HEIGHT, |root| {
        draw(root, curves, title, subject)
    })?;
    // The backend has no joins.
    Ok(svg.replace("<polyline ", "<polyline stroke-linejoin=\"round\" "))
}

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The axis of thresholds.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Axis {
    /// From 0 to so many px.
    Linear(f64),
    /// From the first threshold above 0 to the largest.
    Logarithmic,
}

impl Axis {
    /// What shows where `curves` rise.
    fn of(curves: &[NamedCurve]) -> Axis {
        let risen = |curve: &NamedCurve| {
            let last = curve.points.last().map_or(0.0, |(_, rate)| *rate);
            let mut rising = curve.points.iter().filter(|(_, rate)| *rate >= RISEN * last);
            rising.next().map_or(LOST_PX, |(threshold, _)| *threshold)
        };
        let mut at: Vec<f64> = curves.iter().map(risen).collect();
        at.sort_by(f64::total_cmp);
        match (at.last(), at.get(at.len() / 2)) {
            (Some(last), _) if *last <= SHORT_PX => Axis::Linear(SHORT_PX),
            (_, Some(middle)) if *middle <= SHORT_PX => Axis::Logarithmic,
            _ => Axis::Linear(LOST_PX),
        }
    }

    /// Thresholds with a number below.
    fn ticks(self) -> Vec<f64> {
        match self {
            Axis::Linear(end) => (0..=10).map(|k| end * f64::from(k) / 10.0).collect(),
            Axis::Logarithmic => vec![0.2, 0.5, 1.0, 2.0, 5.0, 10.0, LOST_PX],
        }
    }

    /// How far along the axis a threshold is.
    fn along(self, threshold: f64) -> f64 {
        match self {
            Axis::Linear(_) => threshold,
            Axis::Logarithmic => threshold.log10(),
        }
    }

    fn description(self) -> String {
        let what = "alignment error threshold (px";
        match self {
            Axis::Linear(LOST_PX) => format!("{what})"),
            Axis::Linear(end) => format!("{what}; named lines change little from {end} to {LOST_PX})"),
            Axis::Logarithmic => format!("{what}, logarithmic)"),
        }
    }
}

/// An axis with lines at places of its own.
struct Ticks {
    low: f64,
    high: f64,
    at: Vec<f64>,
}

impl Ranged for Ticks {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value - self.low) / (self.high - self.low);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.at.clone()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.low..self.high
    }
}

fn draw(
    root: &Area,
    curves: &[NamedCurve],
    title: &str,
    subject: &str,
) -> Result<(), Box<dyn std::error::Error>> {
    root.fill(&WHITE)?;
    let s = SCALE as i32;
    let (left, top) = (HPos::Left, VPos::Top);
    root.draw_text(&shorten(title, 100), &anchored(18, left, top), (20 * s, 14 * s))?;
    root.draw_text(&shorten(subject, 140), &anchored(13, left, top), (20 * s, 40 * s))?;
    let (named, others) = curves.split_at(curves.len().min(NAMED));
    let axis = Axis::of(named);
    let ticks = axis.ticks();
    let (low, high) = (axis.along(ticks[0]), axis.along(ticks[ticks.len() - 1]));
    let across = Ticks {
        low,
        high,
        at: ticks.iter().map(|t| axis.along(*t)).collect(),
    };
    let (plot, _) = root.split_horizontally(PLOT_WIDTH * SCALE);
    let mut chart = ChartBuilder::on(&plot)
        .margin_top(ABOVE * SCALE)
        .margin_left(MARGIN * SCALE)
        .x_label_area_size(BELOW * SCALE)
        .y_label_area_size(LEFT * SCALE)
        .build_cartesian_2d(across, 0.0..1.0)?;
    let threshold = |at: &f64| match axis {
        Axis::Linear(_) => format!("{}", (at * 10.0).round() / 10.0),
        Axis::Logarithmic => format!("{}", (10f64.powf(*at) * 10.0).round() / 10.0),
    };
    chart
        .configure_mesh()
        .y_labels(11)
        .x_label_formatter(&threshold)
        .y_label_formatter(&|r| format!("{r:.1}"))
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID.stroke_width(SCALE))
        .set_all_tick_mark_size(5 * SCALE)
        .axis_style(INK.stroke_width(SCALE))
        .label_style(text(12))
        .axis_desc_style(text(14))
        .x_desc(axis.description())
        .y_desc("success rate (share of frames)")
        .draw()?;
    let shown = |curve: &NamedCurve| -> Vec<(f64, f64)> {
        let points = curve.points.iter().map(|(t, rate)| (axis.along(*t), *rate));
        points
            .filter(|(at, _)| (low - 1e-9..=high + 1e-9).contains(at))
            .collect()
    };
    let faint = others.len().min(FAINT);
    for k in 0..faint {
        let curve = &others[k * others.len() / faint];
        chart.draw_series(LineSeries::new(shown(curve), PALE.stroke_width(SCALE * 3 / 4)))?;
    }
    for (rank, curve) in named.iter().enumerate() {
        chart.draw_series(LineSeries::new(shown(curve), line(rank)))?;
    }
    drop(chart);

    let (x, note) = (PLOT_WIDTH as i32 * s, anchored(12, left, VPos::Center));
    if named.is_empty() {
        root.draw_text("no frames were scored", &note, (x + 20 * s, ABOVE as i32 * s))?;
        return Ok(());
    }
    let bottom = (HEIGHT - BELOW) as i32;
    let room = f64::from(bottom - ABOVE as i32);
    let ends = named.iter().map(|curve| {
        let rate = shown(curve).last().map_or(0.0, |(_, rate)| *rate);
        bottom - (rate * room).round() as i32
    });
    let ends: Vec<i32> = ends.collect();
    let places = spread(&ends, ABOVE as i32, bottom);
    root.draw_text(
        "AUC   tracker",
        &note,
        (x + 42 * s, (places.iter().min().unwrap_or(&0) - LINE) * s),
    )?;
    for (rank, curve) in named.iter().enumerate() {
        let (end, place) = (ends[rank] * s, places[rank] * s);
        let colour = COLOURS[rank];
        // From the end of the line to its name.
        let way = [
            (x + s, end),
            (x + 8 * s, end),
            (x + 30 * s, place),
            (x + 38 * s, place),
        ];
        root.draw(&PathElement::new(way, colour.stroke_width(SCALE * 2)))?;
        let style = anchored(13, left, VPos::Center);
        root.draw_text(&short(curve.auc, 3), &style, (x + 42 * s, place))?;
        root.draw_text(&shorten(&curve.name, LABEL), &style, (x + 84 * s, place))?;
    }
    if !others.is_empty() {
        let which = match faint < others.len() {
            true => format!(", {faint} of them drawn"),
            false => String::new(),
        };
        let more = format!("faint: {} more in summary.csv{which}", others.len());
        let below = (places.iter().max().unwrap_or(&0) + LINE + 6).min(HEIGHT as i32 - 16);
        root.draw_text(&more, &note, (x + 42 * s, below * s))?;
    }
    Ok(())
}

/// Heights for names whose lines end at `ends`: in the order of the ends, at least [`LINE`] apart, between `top` and `bottom`,
/// and near their ends. All in CSS pixels, downwards.
fn spread(ends: &[i32], top: i32, bottom: i32) -> Vec<i32> {
    let mut order: Vec<usize> = (0..ends.len()).collect();
    order.sort_by_key(|&i| (ends[i], i));
    let mut places = vec![0; ends.len()];
    let mut least = top;
    for &i in &order {
        places[i] = ends[i].max(least);
        least = places[i] + LINE;
    }
    // Those that were pushed beyond the bottom push the others back up.
    let mut most = bottom;
    for &i in order.iter().rev() {
        places[i] = places[i].min(most);
        most = places[i] - LINE;
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::example;

    fn curve(name: &str, points: &[(f64, f64)]) -> NamedCurve {
        NamedCurve {
            name: name.to_owned(),
            auc: 0.5,
            points: points.to_vec(),
        }
    }

    #[test]
    fn names_trackers_axes_data_frames_and_protocol() {
        let svg = success_svg(&example::of(&example::units()), "Success & failure").unwrap();
        for text in [
            "esm/ssd/homography",
            "nn/mi/affine",
            "Success &amp; failure",
            "builtin: 2 sequences, 2 to 6 frames, protocol ope",
            "success rate",
            "(px",
        ] {
            assert!(svg.contains(text), "{text}: {svg}");
        }
        assert!(
            svg.starts_with("<svg width=\"1020\" height=\"480\""),
            "{}",
            &svg[..80]
        );
    }

    #[test]
    fn the_best_have_names_and_the_others_are_faint() {
        let units: Vec<_> = (0..60)
            .map(|i| {
                example::unit(
                    &format!("esm/ssd/homography{{seed={i:02}}}"),
                    "wall",
                    &[Some(f64::from(i) / 4.0)],
                )
            })
            .collect();
        let svg = success_svg(&example::of(&units), "").unwrap();
        assert!(svg.contains("seed=06") && !svg.contains("seed=07"));
        assert!(svg.contains("53 more in summary.csv, 40 of them drawn"));
        assert_eq!(svg.matches("#C8C8C8").count(), 40);
    }

    #[test]
    fn the_axis_shows_where_curves_rise() {
        let rises = |at: f64| curve("x", &[(0.0, 0.0), (at, 0.99), (20.0, 1.0)]);
        assert_eq!(Axis::of(&[rises(0.4), rises(1.8)]), Axis::Linear(2.0));
        assert_eq!(Axis::of(&[rises(0.4), rises(0.6), rises(9.0)]), Axis::Logarithmic);
        assert_eq!(
            Axis::of(&[rises(0.4), rises(9.0), rises(12.0)]),
            Axis::Linear(20.0)
        );
        assert_eq!(Axis::of(&[]), Axis::Linear(20.0));
        let svg = curves_svg(&[rises(0.4)], "", "").unwrap();
        assert!(svg.contains("named lines change little from 2 to 20"), "{svg}");
        let svg = curves_svg(&[rises(0.4), rises(0.6), rises(9.0)], "", "").unwrap();
        assert!(svg.contains("logarithmic"), "{svg}");
    }

    #[test]
    fn names_do_not_overlap() {
        for ends in [
            vec![84; 7],
            vec![428; 7],
            vec![84, 90, 300, 84, 310, 428, 427],
            vec![200],
        ] {
            let mut places = spread(&ends, 84, 428);
            let (before, after) = (places.clone(), &mut places);
            after.sort_unstable();
            assert!(
                after.windows(2).all(|w| w[1] - w[0] >= LINE),
                "{ends:?} {before:?}"
            );
            assert!(
                after[0] >= 84 && after[after.len() - 1] <= 428,
                "{ends:?} {before:?}"
            );
        }
        assert_eq!(spread(&[100, 300], 84, 428), [100, 300]);
    }

    #[test]
    fn nothing_scored() {
        assert!(
            success_svg(&Results::default(), "x")
                .unwrap()
                .contains("no frames were scored")
        );
    }

    #[test]
    fn shortened_in_the_middle() {
        assert_eq!(shorten("abcdefghij", 5), "ab…ij");
        assert_eq!(shorten("abc", 5), "abc");
    }
}
