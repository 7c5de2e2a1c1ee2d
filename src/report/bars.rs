//! A bar chart of speeds: frames per second of each tracker, with other programs' bars below the tracker of ours that does
//! the same.

use super::ReportError;
use super::plot::{COLOURS, GRID, INK, SCALE, anchored, picture, shorten};
use crate::measure::bench::BenchRow;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

/// Sizes in CSS pixels.
const WIDTH: u32 = 860;
const LABELS: u32 = 330;
const NUMBERS: u32 = 90;
const TOP: u32 = 64;
const BAR: u32 = 16;
const STEP: u32 = 22;
const GAP: u32 = 12;
const BOTTOM: u32 = 20;
/// Characters that fit beside a bar.
const LABEL: usize = 46;

/// Draws groups of rows, each led by a row of ours. The scale is linear from 0, so lengths compare.
///
/// # Errors
/// [`ReportError::Plot`] when the drawing backend refuses.
pub fn bars_svg(groups: &[Vec<&BenchRow>], title: &str, note: &str) -> Result<String, ReportError> {
    let rows: usize = groups.iter().map(Vec::len).sum();
    let height = TOP + rows as u32 * STEP + groups.len() as u32 * GAP + BOTTOM;
    picture(WIDTH, height, |root| {
        let s = SCALE as i32;
        root.fill(&WHITE)?;
        root.draw_text(title, &anchored(17, HPos::Left, VPos::Top), (20 * s, 12 * s))?;
        root.draw_text(note, &anchored(12, HPos::Left, VPos::Top), (20 * s, 38 * s))?;
        let most = groups.iter().flatten().map(|r| r.fps).fold(0.0, f64::max);
        let room = f64::from((WIDTH - LABELS - NUMBERS) * SCALE);
        let left = LABELS as i32 * s;
        let bottom = (height - BOTTOM) as i32 * s;
        root.draw(&PathElement::new(
            [(left, TOP as i32 * s), (left, bottom)],
            GRID.stroke_width(SCALE),
        ))?;
        let mut y = TOP as i32 * s;
        for group in groups {
            for (i, row) in group.iter().enumerate() {
                let (name, colour) = match i {
                    0 => (row.tracker.as_str(), COLOURS[0]),
                    _ => (row.program.as_str(), COLOURS[1]),
                };
                let length = if most > 0.0 {
                    (room * row.fps / most).round() as i32
                } else {
                    0
                };
                let (top, middle) = (y, y + (BAR / 2) as i32 * s);
                let area = [(left, top), (left + length.max(s), top + BAR as i32 * s)];
                root.draw(&Rectangle::new(area, colour.filled()))?;
                let label = anchored(if i == 0 { 13 } else { 12 }, HPos::Right, VPos::Center);
                root.draw_text(&shorten(name, LABEL), &label, (left - 8 * s, middle))?;
                let number = anchored(12, HPos::Left, VPos::Center).color(&INK);
                root.draw_text(
                    &thousands(row.fps),
                    &number,
                    (left + length.max(s) + 6 * s, middle),
                )?;
                y += STEP as i32 * s;
            }
            y += GAP as i32 * s;
        }
        Ok(())
    })
}

/// Whole number with thin spaces between thousands.
fn thousands(v: f64) -> String {
    let digits = format!("{v:.0}");
    let mut text = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i) % 3 == 0 && c.is_ascii_digit() {
            text.push('\u{2009}');
        }
        text.push(c);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_as_long_as_speeds() {
        let row = |tracker: &str, program: &str, fps: f64| BenchRow {
            tracker: tracker.to_owned(),
            program: program.to_owned(),
            fps,
            ..BenchRow::default()
        };
        let (ours, theirs) = (
            row("esm/ssd/homography", "mtf-eval", 10_000.0),
            row("esm", "Other 1.0", 5_000.0),
        );
        let svg = bars_svg(&[vec![&ours, &theirs]], "Speed <1 core>", "frames per second").unwrap();
        for text in [
            "esm/ssd/homography",
            "Other 1.0",
            "10\u{2009}000",
            "5\u{2009}000",
            "&lt;1 core&gt;",
        ] {
            assert!(svg.contains(text), "{text}");
        }
        let widths: Vec<u32> = svg
            .lines()
            .filter(|l| l.starts_with("<rect") && !l.contains("x=\"0\""))
            .filter_map(|l| l.split_once("width=\"")?.1.split('"').next()?.parse().ok())
            .collect();
        assert_eq!(widths.len(), 2, "{svg}");
        assert!(widths[0].abs_diff(2 * widths[1]) <= 2, "{widths:?}");
        assert!(bars_svg(&[], "t", "").is_ok());
    }

    #[test]
    fn digits_in_threes() {
        assert_eq!(thousands(999.4), "999");
        assert_eq!(thousands(1234567.0), "1\u{2009}234\u{2009}567");
    }
}
