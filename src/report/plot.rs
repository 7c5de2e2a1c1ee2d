//! `success.svg`: success rate against the alignment error threshold, for the best trackers.

use super::table::short;
use super::{About, Exporter, ReportError};
use crate::metric::Results;
use crate::metric::aggregate::CurveRow;
use crate::metric::al::LOST_PX;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::io::{self, Write};

/// Trackers drawn, at most.
const SHOWN: usize = 10;
/// Drawn at this multiple of the size in CSS pixels, since the backend rounds coordinates to whole units.
pub(super) const SCALE: u32 = 4;
/// Size in CSS pixels: a plot and a legend on its right.
const PLOT_WIDTH: u32 = 620;
const LEGEND_WIDTH: u32 = 400;
const HEIGHT: u32 = 480;
/// Characters of a tracker's id that fit into the legend.
const LABEL: usize = 40;

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
/// Dash patterns in CSS pixels, as SVG wants them; the first is a solid line.
const DASHES: [&[u32]; 4] = [&[], &[9, 4], &[3, 3], &[14, 4, 3, 4]];
pub(super) const INK: RGBColor = RGBColor(51, 51, 51);
pub(super) const GRID: RGBColor = RGBColor(225, 225, 225);

/// Line of the tracker at `rank`. Better trackers are drawn first and wider, so that curves that coincide show as
/// nested lines.
fn line(rank: usize) -> ShapeStyle {
    let width = (16 - rank as u32).max(6);
    COLOURS[rank % COLOURS.len()].stroke_width(width)
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
        "success plot of the ten best trackers"
    }

    fn write(&self, results: &Results, about: &About, out: &mut dyn Write) -> io::Result<()> {
        let svg = success_svg(results, &about.title).map_err(io::Error::other)?;
        out.write_all(svg.as_bytes())
    }
}

/// Draws the pooled success curves of the ten trackers with the largest `auc`, which the legend gives.
///
/// # Errors
/// [`ReportError::Plot`] when the drawing backend refuses.
pub fn success_svg(results: &Results, title: &str) -> Result<String, ReportError> {
    let (width, height) = (PLOT_WIDTH + LEGEND_WIDTH, HEIGHT);
    let mut svg = picture(width, height, |root| draw(root, results, title))?;
    // The backend has no dashes or joins: give them to the strokes of each rank.
    for rank in 0..SHOWN {
        let RGBColor(r, g, b) = COLOURS[rank % COLOURS.len()];
        let stroke = format!(
            "stroke=\"#{r:02X}{g:02X}{b:02X}\" stroke-width=\"{}\"",
            line(rank).stroke_width
        );
        let dashes = DASHES[rank % DASHES.len()]
            .iter()
            .map(|d| (d * SCALE).to_string())
            .collect::<Vec<_>>();
        let dashes = if dashes.is_empty() {
            "none".to_owned()
        } else {
            dashes.join(" ")
        };
        svg = svg.replace(
            &stroke,
            &format!("{stroke} stroke-dasharray=\"{dashes}\" stroke-linejoin=\"round\""),
        );
    }
    Ok(svg)
}

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn draw(root: &Area, results: &Results, title: &str) -> Result<(), Box<dyn std::error::Error>> {
    root.fill(&WHITE)?;
    let s = SCALE as i32;
    let chars = (PLOT_WIDTH + LEGEND_WIDTH) as usize / 9;
    root.draw_text(
        &shorten(title, chars),
        &anchored(17, HPos::Left, VPos::Top),
        (24 * s, 16 * s),
    )?;
    let (left, right) = root.split_horizontally(PLOT_WIDTH * SCALE);

    let mut chart = ChartBuilder::on(&left)
        .margin_top(52 * SCALE)
        .margin_right(16 * SCALE)
        .margin_bottom(8 * SCALE)
        .margin_left(10 * SCALE)
        .x_label_area_size(44 * SCALE)
        .y_label_area_size(58 * SCALE)
        .build_cartesian_2d(0.0..LOST_PX, 0.0..1.0)?;
    chart
        .configure_mesh()
        .x_labels(11)
        .y_labels(11)
        .x_label_formatter(&|t| format!("{t:.0}"))
        .y_label_formatter(&|r| format!("{r:.1}"))
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID.stroke_width(SCALE))
        .set_all_tick_mark_size(5 * SCALE)
        .axis_style(INK.stroke_width(SCALE))
        .label_style(text(12))
        .axis_desc_style(text(14))
        .x_desc("alignment error threshold (px)")
        .y_desc("success rate (fraction of frames)")
        .draw()?;

    let primary = results.metrics.primary();
    let ranking = results.ranking();
    let drawn = ranking.iter().filter_map(|row| {
        let same = |c: &&CurveRow| {
            c.is_pooled() && c.metric == *primary && c.tracker == row.tracker && c.protocol == row.protocol
        };
        results
            .curves
            .iter()
            .find(same)
            .filter(|c| !c.success_rate.is_empty())
            .map(|c| (row, c))
    });
    let drawn: Vec<_> = drawn.take(SHOWN).collect();
    for (rank, (_, curve)) in drawn.iter().enumerate() {
        let points = curve
            .success_rate
            .iter()
            .enumerate()
            .map(|(k, &rate)| (primary.threshold(k), rate));
        chart.draw_series(LineSeries::new(points, line(rank)))?;
    }

    let heading = anchored(13, HPos::Left, VPos::Center);
    let label = anchored(13, HPos::Left, VPos::Center);
    let number = anchored(13, HPos::Right, VPos::Center);
    let (auc_right, label_left, mut y) = (LEGEND_WIDTH as i32 * s - 20 * s, 52 * s, 64 * s);
    if drawn.is_empty() {
        right.draw_text("no frames were scored", &heading, (8 * s, y))?;
        return Ok(());
    }
    right.draw_text("tracker", &heading, (label_left, y))?;
    right.draw_text("AUC", &number, (auc_right, y))?;
    let several = ranking.iter().any(|row| row.protocol != ranking[0].protocol);
    for (rank, (row, _)) in drawn.iter().enumerate() {
        let name = match several {
            true => format!("{} {}", row.tracker.id, row.protocol),
            false => row.tracker.id.clone(),
        };
        y += 30 * s;
        right.draw(&PathElement::new([(4 * s, y), (42 * s, y)], line(rank)))?;
        right.draw_text(&shorten(&name, LABEL), &label, (label_left, y))?;
        right.draw_text(&short(row.score["auc"], 3), &number, (auc_right, y))?;
    }
    if ranking.len() > drawn.len() {
        let more = format!("{} more in summary.csv", ranking.len() - drawn.len());
        right.draw_text(
            &more,
            &anchored(12, HPos::Left, VPos::Center),
            (label_left, y + 34 * s),
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::example;

    #[test]
    fn names_trackers_axes_and_title() {
        let svg = success_svg(&example::of(&example::units()), "builtin, ope & more").unwrap();
        for text in [
            "esm/ssd/homography",
            "nn/mi/affine",
            "builtin, ope &amp; more",
            "success rate",
            "(px)",
        ] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(
            svg.starts_with("<svg width=\"1020\" height=\"480\""),
            "{}",
            &svg[..80]
        );
    }

    #[test]
    fn draws_the_ten_best() {
        let units: Vec<_> = (0..14)
            .map(|i| {
                example::unit(
                    &format!("esm/ssd/homography{{seed={i:02}}}"),
                    "wall",
                    &[Some(f64::from(i))],
                )
            })
            .collect();
        let svg = success_svg(&example::of(&units), "").unwrap();
        assert!(svg.contains("seed=09") && !svg.contains("seed=10") && svg.contains("4 more"));
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
