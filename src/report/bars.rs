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
const NUMBERS: u32 = 140;
const TOP: u32 = 80;
const BAR: u32 = 16;
const STEP: u32 = 22;
const GAP: u32 = 12;
const BOTTOM: u32 = 20;
/// Characters that fit beside a bar.
const LABEL: usize = 46;

/// Draws groups of rows, each led by a row of ours, with the median error beside the speed. The scale is logarithmic: equal
/// steps are equal ratios, and the fast do not crush the slow. Lines stand at powers of ten.
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
        let (low, high) = decades(groups.iter().flatten().map(|r| r.fps));
        let room = f64::from((WIDTH - LABELS - NUMBERS) * SCALE);
        let along = |fps: f64| match fps.log10() {
            power if power > f64::from(low) => {
                (room * (power - f64::from(low)) / f64::from(high - low)).round() as i32
            }
            _ => 0,
        };
        let left = LABELS as i32 * s;
        let bottom = (height - BOTTOM) as i32 * s;
        for power in low..=high {
            let x = left + along(10f64.powi(power));
            root.draw(&PathElement::new(
                [(x, TOP as i32 * s), (x, bottom)],
                GRID.stroke_width(SCALE),
            ))?;
            let label = anchored(11, HPos::Center, VPos::Bottom).color(&INK);
            root.draw_text(&decade(power), &label, (x, (TOP as i32 - 3) * s))?;
        }
        let mut y = TOP as i32 * s;
        for group in groups {
            for (i, row) in group.iter().enumerate() {
                let (name, colour) = match i {
                    0 => (row.tracker.as_str(), COLOURS[0]),
                    _ => (row.program.as_str(), COLOURS[1]),
                };
                let length = along(row.fps);
                let (top, middle) = (y, y + (BAR / 2) as i32 * s);
                let area = [(left, top), (left + length.max(s), top + BAR as i32 * s)];
                root.draw(&Rectangle::new(area, colour.filled()))?;
                let label = anchored(if i == 0 { 13 } else { 12 }, HPos::Right, VPos::Center);
                root.draw_text(&shorten(name, LABEL), &label, (left - 8 * s, middle))?;
                let number = anchored(12, HPos::Left, VPos::Center).color(&INK);
                root.draw_text(&speed(row), &number, (left + length.max(s) + 6 * s, middle))?;
                y += STEP as i32 * s;
            }
            y += GAP as i32 * s;
        }
        Ok(())
    })
}

/// Powers of ten below the least and not below the largest of `speeds`; the least bar is visible.
fn decades(speeds: impl Iterator<Item = f64>) -> (i32, i32) {
    // A bar shorter than a tenth of a decade can hardly be seen.
    const SEEN: f64 = 0.1;
    let powers = speeds.map(f64::log10).filter(|p| p.is_finite());
    let (least, most) = powers.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| {
        (a.min(p), b.max(p))
    });
    if least > most {
        return (0, 1);
    }
    let low = (least - SEEN).floor() as i32;
    (low, (most.ceil() as i32).max(low + 1))
}

/// A power of ten in digits.
fn decade(power: i32) -> String {
    match power {
        0.. => thousands(10f64.powi(power)),
        _ => format!("{}", 10f64.powi(power)),
    }
}

/// What stands at the end of a bar.
fn speed(row: &BenchRow) -> String {
    let error = row
        .al_median
        .map_or(String::new(), |px| format!("  ({px:.3} px)"));
    thousands(row.fps) + &error
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
    fn bars_are_as_long_as_logarithms_of_speeds() {
        let row = |tracker: &str, program: &str, fps: f64| BenchRow {
            tracker: tracker.to_owned(),
            program: program.to_owned(),
            fps,
            ..BenchRow::default()
        };
        let (ours, theirs) = (
            row("esm/ssd/homography", "mtf-eval", 10_000.0),
            BenchRow {
                al_median: Some(0.0625),
                ..row("esm", "Other 1.0", 100.0)
            },
        );
        let svg = bars_svg(&[vec![&ours, &theirs]], "Speed <1 core>", "frames per second").unwrap();
        for text in [
            "esm/ssd/homography",
            "Other 1.0",
            "10\u{2009}000",
            "100  (0.062 px)",
            "1\u{2009}000",
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
        // From 10 to 10 000: three decades and one.
        assert!(widths[0].abs_diff(3 * widths[1]) <= 3, "{widths:?}");
        assert!(bars_svg(&[], "t", "").is_ok());
    }

    #[test]
    fn the_axis_goes_from_power_to_power() {
        assert_eq!(decades([150.0, 9000.0].into_iter()), (2, 4));
        assert_eq!(decades([100.0].into_iter()), (1, 2));
        assert_eq!(decades([0.0, f64::NAN].into_iter()), (0, 1));
        assert_eq!(
            (decade(3), decade(-1)),
            ("1\u{2009}000".to_owned(), "0.1".to_owned())
        );
    }

    #[test]
    fn digits_in_threes() {
        assert_eq!(thousands(999.4), "999");
        assert_eq!(thousands(1234567.0), "1\u{2009}234\u{2009}567");
    }
}
