//! What goes to standard output: aligned tables, Markdown, CSV and JSON.

use super::text::{BOLD, PLAIN};
use super::{csv, standings, text};
use crate::judge::ranking::{Entrant, FPS, Field, Pick, Speeds, are_of_the_same, figure, ranked};
use crate::metric::aggregate::{Results, SummaryRow};
use crate::store::summary;
use comfy_table::{CellAlignment, Table as Grid, presets};

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
    /// One of the [`sort_keys`](crate::judge::ranking::sort_keys); best first. Anything else sorts as `auc`.
    pub sort: String,
    /// Trackers in `Table` and `Md`, 0 for all; `Csv` and `Json` are for machines and always complete.
    pub top: usize,
    /// Bold header and coloured bars (ANSI) in `Table`.
    pub colour: bool,
    /// Indented `Json` instead of one line.
    pub pretty: bool,
    /// Which trackers, and figures by group.
    pub pick: Pick,
}

impl Default for TableOptions {
    fn default() -> Self {
        TableOptions {
            format: Format::Table,
            sort: "auc".to_owned(),
            top: 20,
            colour: false,
            pretty: false,
            pick: Pick::default(),
        }
    }
}

/// What `run` prints on standard output, ending in a newline. `speeds` are shown to people only when trackers are sorted or
/// picked by them, because all else that is printed is the same in every run. `Csv` is one table: with figures by group,
/// that of the groups.
pub fn table(results: &Results, speeds: &Speeds, options: &TableOptions) -> String {
    let field = Field {
        name: "",
        results,
        speeds,
    };
    let rows = ranked(&[field], &options.sort, &options.pick);
    let by = options.pick.by.zip(figure(&results.metrics, &options.sort));
    match options.format {
        Format::Json => {
            let order: Vec<_> = rows.iter().map(|e| &e.row.tracker).collect();
            let groups = by.map(|(by, figure)| standings::groups_json(&rows, by, figure));
            json_text(&summary::document(results, &order, groups), options.pretty)
        }
        Format::Csv => match by {
            Some((by, figure)) => standings::groups(&rows, by, figure, options),
            None => {
                let both = rows.iter().flat_map(|e| {
                    let same = |r: &&SummaryRow| r.tracker == e.row.tracker && r.protocol == e.row.protocol;
                    results.summary.iter().filter(same)
                });
                let mut bytes = Vec::new();
                // Writing to memory cannot fail.
                let _ = csv::summary(&mut bytes, &results.metrics, both);
                String::from_utf8(bytes).unwrap_or_default()
            }
        },
        Format::Table | Format::Md => {
            let mut text = people(results, &rows, options);
            if let Some((by, figure)) = by {
                text += "\n";
                text += &standings::groups(&rows, by, figure, options);
            }
            text
        }
    }
}

/// How many of `rows` rows are shown.
pub(super) fn shown(rows: usize, top: usize) -> usize {
    if top == 0 { rows } else { top.min(rows) }
}

fn people(results: &Results, entrants: &[Entrant<'_>], options: &TableOptions) -> String {
    let shown = shown(entrants.len(), options.top);
    let rows: Vec<&SummaryRow> = entrants.iter().map(|e| e.row).collect();
    let with_speed = options.sort == FPS || options.pick.is_by_speed();
    let unequal = !are_of_the_same(&entrants[..shown]);
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
        "AL median px",
        "failures",
        "frames",
    ];
    let restarted = rows[..shown]
        .iter()
        .any(|r| !r.score["frames_per_failure"].is_nan());
    if restarted {
        header.push("frames/failure");
    }
    let boxes = rows[..shown].iter().any(|r| gives_boxes(r));
    if boxes {
        header.extend(["CL median", "Jaccard mean"]);
    }
    if with_speed {
        header.push(FPS);
    }
    if unequal {
        header.push("sequences");
    }
    if protocols {
        header.push("protocol");
    }
    if failed {
        header.push("failed units");
    }
    let cells = entrants[..shown].iter().map(|e| {
        let (r, s) = (e.row, &e.row.score);
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
        if boxes {
            row.extend([short(s["cl_median"], 2), short(s["jaccard_mean"], 3)]);
        }
        if with_speed {
            row.push(short(e.fps, 0));
        }
        if unequal {
            row.push(r.sequences.to_string());
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
    if unequal {
        notes.push("not all rows are of the same sequences".to_owned());
    }
    if boxes {
        notes.push("trackers without success rates give boxes: only the distance of centres (CL) and the overlap (Jaccard) say something of them".to_owned());
    }
    let runs = results.failed_runs();
    if runs > 0 {
        notes.push(format!(
            "{runs} of {} units (one tracker on one sequence each) failed, see sequences.csv",
            results.sequences.len()
        ));
    }
    if !notes.is_empty() {
        text = format!("{text}\n{}\n", notes.join("; "));
    }
    text
}

/// Whether the tracker's answers are upright boxes, of which most metrics say nothing.
fn gives_boxes(row: &SummaryRow) -> bool {
    row.score["auc"].is_nan() && row.score.frames() > 0
}

/// JSON that ends in a newline: one line, or indented if `pretty`.
pub fn json_text(value: &impl serde::Serialize, pretty: bool) -> String {
    let text = match pretty {
        true => serde_json::to_string_pretty(value),
        false => serde_json::to_string(value),
    };
    // Strings and numbers always serialise; an empty text would only follow from a bug in serde.
    text.unwrap_or_default() + "\n"
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
        let c = c.strip_prefix('*').unwrap_or(c);
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
    use std::collections::BTreeMap;

    fn print(options: TableOptions) -> String {
        table(&example::results(), &BTreeMap::new(), &options)
    }

    #[test]
    fn for_people() {
        insta::assert_snapshot!(print(TableOptions::default()), @"
        tracker              SR@1   SR@2   SR@5  SR@10  SR@20    AUC  AL median px  failures  frames  sequences  failed units
        esm/ssd/homography  0.833  0.833  1.000  1.000  1.000  0.963          0.17         0       6          2
        iclk/ssd/affine     0.333  0.500  0.667  0.667  0.667  0.633          2.00         2       6          2
        nn/mi/affine        0.000  0.000  0.000  0.000  0.000  0.000           inf         2       2          1        1 of 1

        not all rows are of the same sequences; 1 of 5 units (one tracker on one sequence each) failed, see sequences.csv
        ");
        let two = TableOptions {
            format: Format::Md,
            top: 2,
            sort: "al_median".to_owned(),
            ..TableOptions::default()
        };
        insta::assert_snapshot!(print(two), @"
        | tracker            |  SR@1 |  SR@2 |  SR@5 | SR@10 | SR@20 |   AUC | AL median px | failures | frames |
        |--------------------|-------|-------|-------|-------|-------|-------|--------------|----------|--------|
        | esm/ssd/homography | 0.833 | 0.833 | 1.000 | 1.000 | 1.000 | 0.963 |         0.17 |        0 |      6 |
        | iclk/ssd/affine    | 0.333 | 0.500 | 0.667 | 0.667 | 0.667 | 0.633 |         2.00 |        2 |      6 |

        1 more tracker (--top 0 shows all); 1 of 5 units (one tracker on one sequence each) failed, see sequences.csv
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
