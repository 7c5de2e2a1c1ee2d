//! What goes to standard output: aligned tables, Markdown, CSV and JSON.

use super::text::{BOLD, PLAIN};
use super::{csv, text};
use crate::metric::MetricSet;
use crate::metric::aggregate::{Results, SummaryRow};
use crate::store::summary;
use comfy_table::{CellAlignment, Table as Grid, presets};
use mtf::registry::{hint, suggest};
use std::collections::BTreeMap;

/// Form of what is printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Aligned columns for people.
    #[default]
    Table,
    /// The document of `summary.json`.
    Json,
    /// The rows of `summary.csv`.
    Csv,
    /// A Markdown table.
    Md,
}

/// How [`table`] prints results.
#[derive(Clone, Debug)]
pub struct TableOptions {
    /// Form.
    pub format: Format,
    /// One of [`sort_keys`]; best first. Anything else sorts as `auc` (see [`parse_sort`]).
    pub sort: String,
    /// Trackers in `Table` and `Md`, 0 for all; `Csv` and `Json` are for machines and always complete.
    pub top: usize,
    /// Bold header (ANSI) in `Table`.
    pub colour: bool,
}

impl Default for TableOptions {
    fn default() -> Self {
        TableOptions {
            format: Format::Table,
            sort: "auc".to_owned(),
            top: 20,
            colour: false,
        }
    }
}

/// The sort key of frames per second.
const FPS: &str = "fps";

/// What [`TableOptions::sort`] accepts: the tracker's id, its speed or any figure.
pub fn sort_keys(metrics: &MetricSet) -> impl Iterator<Item = &str> {
    ["tracker", FPS]
        .into_iter()
        .chain(metrics.figures().iter().map(|f| f.name.as_str()))
}

/// Checks a sort key.
///
/// # Errors
/// A message with the nearest valid key.
pub fn parse_sort(metrics: &MetricSet, key: &str) -> Result<String, String> {
    let key = key.to_ascii_lowercase();
    if sort_keys(metrics).any(|k| k == key) {
        return Ok(key);
    }
    let hint = hint(suggest(&key, sort_keys(metrics)).as_deref());
    Err(format!(
        "no column '{key}'{hint} (one of {})",
        sort_keys(metrics).collect::<Vec<_>>().join(", ")
    ))
}

/// Pooled rows, best first by `key`; ties by id. Trackers that are not in `speeds` are the slowest.
fn ranked<'a>(results: &'a Results, speeds: &BTreeMap<String, f64>, key: &str) -> Vec<&'a SummaryRow> {
    let mut rows = results.ranking();
    match results.metrics.figure(key) {
        _ if key == "tracker" => rows.sort_by(|a, b| a.tracker.cmp(&b.tracker)),
        _ if key == FPS => {
            let speed = |r: &SummaryRow| speeds.get(&r.tracker.id).copied().unwrap_or(0.0);
            rows.sort_by(|a, b| speed(b).total_cmp(&speed(a)));
        }
        Some(figure) => rows.sort_by(|a, b| figure.better.order(a.score[key], b.score[key])),
        None => {}
    }
    rows
}

/// What `run` prints on standard output, ending in a newline. `speeds` are frames per second by id of tracker: shown to people
/// only when they are sorted by them, because all else that is printed is the same in every run.
pub fn table(results: &Results, speeds: &BTreeMap<String, f64>, options: &TableOptions) -> String {
    let rows = ranked(results, speeds, &options.sort);
    match options.format {
        Format::Json => {
            let order: Vec<_> = rows.iter().map(|r| &r.tracker).collect();
            summary::document(results, &order) + "\n"
        }
        Format::Csv => {
            let both = rows.iter().flat_map(|p| {
                let same = |r: &&SummaryRow| r.tracker == p.tracker && r.protocol == p.protocol;
                results.summary.iter().filter(same)
            });
            let mut bytes = Vec::new();
            // Writing to memory cannot fail.
            let _ = csv::summary(&mut bytes, &results.metrics, both);
            String::from_utf8(bytes).unwrap_or_default()
        }
        Format::Table | Format::Md => people(results, speeds, &rows, options),
    }
}

fn people(
    results: &Results,
    speeds: &BTreeMap<String, f64>,
    rows: &[&SummaryRow],
    options: &TableOptions,
) -> String {
    let shown = if options.top == 0 {
        rows.len()
    } else {
        options.top.min(rows.len())
    };
    let failed = rows[..shown].iter().any(|r| r.failed_runs > 0);
    let protocols = rows.iter().any(|r| r.protocol != rows[0].protocol);
    let mut header = vec![
        "tracker",
        "SR@1",
        "SR@2",
        "SR@5",
        "SR@10",
        "SR@20",
        "AUC",
        "AL median",
        "failures",
        "frames",
    ];
    let restarted = rows[..shown]
        .iter()
        .any(|r| !r.score["frames_per_failure"].is_nan());
    if restarted {
        header.push("frames/failure");
    }
    if options.sort == FPS {
        header.push(FPS);
    }
    if protocols {
        header.push("protocol");
    }
    if failed {
        header.push("failed runs");
    }
    let cells = rows[..shown].iter().map(|r| {
        let s = &r.score;
        let mut row = vec![r.tracker.id.clone()];
        let rates = ["sr_1", "sr_2", "sr_5", "sr_10", "sr_20", "auc"];
        row.extend(rates.map(|name| short(s[name], 3)));
        row.extend([
            short(s["al_median"], 2),
            s.failures().to_string(),
            s.frames().to_string(),
        ]);
        if restarted {
            row.push(short(s["frames_per_failure"], 1));
        }
        if options.sort == FPS {
            row.push(short(speeds.get(&r.tracker.id).copied().unwrap_or(f64::NAN), 0));
        }
        if protocols {
            row.push(r.protocol.clone());
        }
        if failed {
            row.push(if r.failed_runs > 0 {
                format!("{} of {}", r.failed_runs, r.runs)
            } else {
                String::new()
            });
        }
        row
    });
    let mut text = render(
        &header,
        &cells.collect::<Vec<_>>(),
        options.format,
        options.colour,
    );
    let mut notes = Vec::new();
    if shown < rows.len() {
        let more = rows.len() - shown;
        notes.push(format!(
            "{more} more tracker{} (--top 0 shows all)",
            if more == 1 { "" } else { "s" }
        ));
    }
    let runs = results.failed_runs();
    if runs > 0 {
        notes.push(format!(
            "{runs} of {} runs failed (see sequences.csv)",
            results.sequences.len()
        ));
    }
    if !notes.is_empty() {
        text = format!("{text}\n{}\n", notes.join("; "));
    }
    text
}

/// A number for people: fixed decimals, `inf`, or `-` when undefined.
pub(crate) fn short(v: f64, decimals: usize) -> String {
    if v.is_nan() {
        "-".to_owned()
    } else {
        format!("{v:.decimals$}")
    }
}

/// Lays out rows of text as `Csv`, `Md` or (anything else) `Table`: cells that begin like numbers are right-aligned;
/// ends in a newline.
pub fn render(header: &[&str], rows: &[Vec<String>], format: Format, colour: bool) -> String {
    if format == Format::Csv {
        let mut writer = ::csv::Writer::from_writer(Vec::new());
        // Writing rows of one length to memory cannot fail.
        let _ = writer.write_record(header);
        for row in rows {
            let _ = writer.write_record(row.iter().map(|c| text::cell(c).into_owned()));
        }
        return writer
            .into_inner()
            .ok()
            .and_then(|b| String::from_utf8(b).ok())
            .unwrap_or_default();
    }
    let mut grid = Grid::new();
    grid.load_preset(if format == Format::Md {
        presets::ASCII_MARKDOWN
    } else {
        presets::NOTHING
    });
    grid.set_header(header.iter().copied());
    for row in rows {
        // The end of a line would tear the row.
        grid.add_row(row.iter().map(|c| match format {
            Format::Md => text::markdown(c),
            _ => text::one_line(c).into_owned(),
        }));
    }
    let number = |c: &str| {
        c.is_empty() || c == "inf" || c.starts_with(|d: char| d.is_ascii_digit() || "+-".contains(d))
    };
    for (i, column) in grid.column_iter_mut().enumerate().skip(1) {
        if rows.iter().all(|row| row.get(i).is_none_or(|c| number(c))) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    let (bold, mut text) = (colour && format == Format::Table, String::new());
    for (i, line) in grid.lines().enumerate() {
        let line = line.trim_end();
        let line = if format == Format::Md {
            line
        } else {
            line.strip_prefix(' ').unwrap_or(line)
        };
        text += &if i == 0 && bold {
            format!("{BOLD}{line}{PLAIN}")
        } else {
            line.to_owned()
        };
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::aggregate::example;

    fn print(options: TableOptions) -> String {
        table(&example::results(), &BTreeMap::new(), &options)
    }

    #[test]
    fn for_people() {
        insta::assert_snapshot!(print(TableOptions::default()), @"
        tracker              SR@1   SR@2   SR@5  SR@10  SR@20    AUC  AL median  failures  frames  failed runs
        esm/ssd/homography  0.833  0.833  1.000  1.000  1.000  0.963       0.17         0       6
        iclk/ssd/affine     0.333  0.500  0.667  0.667  0.667  0.633       2.00         2       6
        nn/mi/affine        0.000  0.000  0.000  0.000  0.000  0.000        inf         2       2       1 of 1

        1 of 5 runs failed (see sequences.csv)
        ");
        let two = TableOptions {
            format: Format::Md,
            top: 2,
            sort: "al_median".to_owned(),
            colour: false,
        };
        insta::assert_snapshot!(print(two), @"
        | tracker            |  SR@1 |  SR@2 |  SR@5 | SR@10 | SR@20 |   AUC | AL median | failures | frames |
        |--------------------|-------|-------|-------|-------|-------|-------|-----------|----------|--------|
        | esm/ssd/homography | 0.833 | 0.833 | 1.000 | 1.000 | 1.000 | 0.963 |      0.17 |        0 |      6 |
        | iclk/ssd/affine    | 0.333 | 0.500 | 0.667 | 0.667 | 0.667 | 0.633 |      2.00 |        2 |      6 |

        1 more tracker (--top 0 shows all); 1 of 5 runs failed (see sequences.csv)
        ");
        assert!(
            print(TableOptions {
                colour: true,
                ..TableOptions::default()
            })
            .starts_with("\x1b[1mtracker")
        );
    }

    #[test]
    fn for_machines_is_complete() {
        let csv = print(TableOptions {
            format: Format::Csv,
            top: 1,
            ..TableOptions::default()
        });
        assert_eq!(csv.lines().count(), 1 + 3 * 2);
        assert!(csv.lines().nth(1).unwrap().starts_with("esm/ssd/homography,"));
        let json = print(TableOptions {
            format: Format::Json,
            top: 1,
            ..TableOptions::default()
        });
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(json["trackers"].as_array().unwrap().len(), 3);
        assert_eq!(json["trackers"][0]["aggregates"][0]["average"], "pooled");
    }

    #[test]
    fn sort_keys() {
        let parse = |key: &str| parse_sort(&MetricSet::builtin(), key);
        assert_eq!(parse("SR_5").unwrap(), "sr_5");
        assert!(parse("sr5").unwrap_err().contains("did you mean 'sr_5'"));
        let results = example::results();
        let first = |key: &str| ranked(&results, &BTreeMap::new(), key)[0].tracker.sm.clone();
        assert_eq!(
            (first("failures"), first("frames"), first("tracker")),
            ("esm".into(), "esm".into(), "esm".into())
        );
        let last = |key: &str| ranked(&results, &BTreeMap::new(), key)[2].tracker.sm.clone();
        assert_eq!(
            (last("auc"), last("al_median"), last("al_tracked")),
            ("nn".into(), "nn".into(), "nn".into())
        );
        assert_eq!(last("tracker"), "nn");
    }

    #[test]
    fn speeds_are_shown_when_they_are_sorted_by() {
        let results = example::results();
        let speeds = [("iclk/ssd/affine", 900.4), ("esm/ssd/homography", 450.0)];
        let speeds: BTreeMap<String, f64> = speeds.iter().map(|(id, v)| ((*id).to_owned(), *v)).collect();
        let by = |sort: &str| {
            let options = TableOptions {
                sort: sort.to_owned(),
                ..TableOptions::default()
            };
            table(&results, &speeds, &options)
        };
        let text = by("fps");
        let lines: Vec<&str> = text.lines().collect();
        assert!(
            lines[0].contains("fps") && lines[1].contains("iclk/ssd/affine"),
            "{text}"
        );
        assert!(lines[1].contains(" 900") && lines[2].contains(" 450"), "{text}");
        assert!(
            lines[3].starts_with("nn/mi/affine") && lines[3].contains(" - "),
            "{text}"
        );
        assert!(!by("auc").contains("fps"));
    }

    #[test]
    fn nothing_to_show() {
        let text = table(&Results::default(), &BTreeMap::new(), &TableOptions::default());
        assert_eq!(text.lines().count(), 1);
    }
}
