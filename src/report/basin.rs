//! A chart of basins of convergence: the share of starts that converged against how far they were from the truth.

use super::ReportError;
use super::plot::{COLOURS, GRID, INK, SCALE, anchored, picture, shorten};
use super::table::short;
use crate::measure::basin::{BasinRow, half_rate_sigma};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

/// Trackers drawn, at most.
const SHOWN: usize = 10;
/// Sizes in CSS pixels: a plot and a legend on its right.
const PLOT: u32 = 620;
const LEGEND: u32 = 420;
const HEIGHT: u32 = 480;
/// Characters that fit into the legend.
const LABEL: usize = 38;

/// Draws the curves of `groups`, the rows of a tracker each by growing sigma, with their 95 % intervals: those of the ten
/// trackers that converge from half of the starts farthest out.
///
/// # Errors
/// [`ReportError::Plot`] when the drawing backend refuses.
pub fn basin_svg(groups: &[Vec<&BasinRow>], title: &str, note: &str) -> Result<String, ReportError> {
    let mut ranked: Vec<(Option<f64>, &Vec<&BasinRow>)> =
        groups.iter().map(|rows| (half_rate_sigma(rows), rows)).collect();
    let far = |half: Option<f64>| half.unwrap_or(f64::NEG_INFINITY);
    ranked.sort_by(|a, b| far(b.0).total_cmp(&far(a.0)));
    let farthest = groups.iter().flatten().map(|row| row.sigma).fold(0.0, f64::max);
    picture(PLOT + LEGEND, HEIGHT, |root| {
        let s = SCALE as i32;
        root.fill(&WHITE)?;
        root.draw_text(title, &anchored(17, HPos::Left, VPos::Top), (24 * s, 12 * s))?;
        root.draw_text(note, &anchored(12, HPos::Left, VPos::Top), (24 * s, 36 * s))?;
        let (left, right) = root.split_horizontally(PLOT * SCALE);
        let mut chart = ChartBuilder::on(&left)
            .margin_top(64 * SCALE)
            .margin_right(16 * SCALE)
            .margin_bottom(8 * SCALE)
            .margin_left(10 * SCALE)
            .x_label_area_size(44 * SCALE)
            .y_label_area_size(58 * SCALE)
            .build_cartesian_2d(0.0..farthest.max(f64::MIN_POSITIVE), 0.0..1.0)?;
        let text = |size: u32| ("sans-serif", size * SCALE).into_font().color(&INK);
        chart
            .configure_mesh()
            .y_labels(11)
            .x_label_formatter(&|v| format!("{v:.0}"))
            .y_label_formatter(&|r| format!("{r:.1}"))
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID.stroke_width(SCALE))
            .set_all_tick_mark_size(5 * SCALE)
            .axis_style(INK.stroke_width(SCALE))
            .label_style(text(12))
            .axis_desc_style(text(14))
            .x_desc("standard deviation of the corners at the start (px)")
            .y_desc("converged (fraction of starts)")
            .draw()?;
        let colour = |rank: usize| COLOURS[rank % COLOURS.len()];
        let shown = || ranked.iter().take(SHOWN).enumerate();
        for (rank, (_, rows)) in shown() {
            let low = rows.iter().map(|row| (row.sigma, row.interval()[0]));
            let high = rows.iter().rev().map(|row| (row.sigma, row.interval()[1]));
            let band: Vec<(f64, f64)> = low.chain(high).collect();
            chart.draw_series([Polygon::new(band, colour(rank).mix(0.1))])?;
        }
        for (rank, (_, rows)) in shown() {
            let points = rows.iter().map(|row| (row.sigma, row.rate()));
            chart.draw_series(LineSeries::new(points, colour(rank).stroke_width(2 * SCALE)))?;
        }
        let (number_right, label_left, mut y) = (LEGEND as i32 * s - 16 * s, 46 * s, 72 * s);
        let label = anchored(13, HPos::Left, VPos::Center);
        let number = anchored(13, HPos::Right, VPos::Center);
        right.draw_text("tracker", &label, (label_left, y))?;
        right.draw_text("half at (px)", &number, (number_right, y))?;
        for (rank, (half, rows)) in shown() {
            y += 30 * s;
            let line = [(4 * s, y), (38 * s, y)];
            right.draw(&PathElement::new(line, colour(rank).stroke_width(2 * SCALE)))?;
            let name = rows.first().map_or("", |row| row.tracker.as_str());
            right.draw_text(&shorten(name, LABEL), &label, (label_left, y))?;
            let half = match half {
                None => "-".to_owned(),
                Some(px) if px.is_infinite() => format!("> {farthest}"),
                Some(px) => short(*px, 1),
            };
            right.draw_text(&half, &number, (number_right, y))?;
        }
        if ranked.len() > SHOWN {
            let more = format!("{} more in the table", ranked.len() - SHOWN);
            right.draw_text(&more, &label, (label_left, y + 34 * s))?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trackers_stand_by_how_far_they_reach() {
        let row = |tracker: &str, sigma: f64, converged: usize| BasinRow {
            tracker: tracker.to_owned(),
            texture: "pooled".to_owned(),
            warp: "homography".to_owned(),
            sigma,
            trials: 100,
            converged,
            distance: Vec::new(),
            rates: Vec::new(),
        };
        let rows: Vec<Vec<BasinRow>> = (0..12)
            .map(|k| {
                let name = format!("nn{k:02}/ssd/affine");
                vec![row(&name, 2.0, 100), row(&name, 10.0, 4 * k)]
            })
            .collect();
        let groups: Vec<Vec<&BasinRow>> = rows.iter().map(|rows| rows.iter().collect()).collect();
        let svg = basin_svg(&groups, "Basins", "12 trackers <each>").unwrap();
        for text in [
            "Basins",
            "&lt;each&gt;",
            "nn11/ssd/affine",
            "2 more in the table",
            "half at (px)",
        ] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(!svg.contains("nn01/ssd/affine") && svg.find("nn11") < svg.find("nn10"));
        assert!(basin_svg(&[], "t", "").is_ok());
    }
}
