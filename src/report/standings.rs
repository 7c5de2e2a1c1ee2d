//! The best trackers of one or several runs, and figures by tag, sequence or part of the tracker: for people, with the 95 %
//! interval of each figure, and for machines.

use super::table::{Format, TableOptions, json_text, render, short, shown};
use super::text::{BAR, PLAIN};
use crate::judge::ranking::{Entrant, Group, apart_from_first, are_of_the_same, figure, grouped};
use crate::metric::figure::Kind;
use crate::metric::{Direction, Figure};
use serde_json::{Map, Value, json};

/// Cells of a bar.
const BAR_WIDTH: f64 = 24.0;
/// Cells of a bar up to the lower end of the interval, up to the figure, and up to the upper end.
const SHADES: [char; 3] = ['█', '▓', '░'];

/// Decimals that a figure is shown with.
fn decimals(figure: &Figure) -> usize {
    match (figure.kind, figure.unit) {
        (Kind::Count, _) => 0,
        (Kind::Number, "") => 3,
        (Kind::Number, _) => 2,
    }
}

/// `low high`, or `-`.
fn interval_cell([low, high]: [f64; 2], figure: &Figure) -> String {
    match low.is_nan() {
        true => "-".to_owned(),
        false => format!(
            "{} {}",
            short(low, decimals(figure)),
            short(high, decimals(figure))
        ),
    }
}

/// What a whole bar stands for: 1 for rates, else the largest of the values.
fn whole_bar(figure: &Figure, values: impl Iterator<Item = f64>) -> f64 {
    match (figure.unit, figure.better, figure.kind) {
        ("", Direction::LargerIsBetter, Kind::Number) => 1.0,
        _ => values.filter(|v| v.is_finite()).fold(0.0, f64::max),
    }
}

fn bar(value: f64, [low, high]: [f64; 2], whole: f64) -> String {
    if !value.is_finite() || whole <= 0.0 {
        return String::new();
    }
    let cells = |v: f64| (BAR_WIDTH * (v / whole).clamp(0.0, 1.0)).round() as usize;
    let [low, high] = if low.is_nan() { [value; 2] } else { [low, high] };
    let ends = [cells(low), cells(value), cells(high)];
    let mut from = 0;
    let mut text = String::new();
    for (shade, end) in SHADES.into_iter().zip(ends) {
        text.extend(std::iter::repeat_n(shade, end.saturating_sub(from)));
        from = from.max(end);
    }
    text
}

/// The table with its bars, which end lines, coloured.
fn with_colour(text: &str) -> String {
    let line = |line: &str| {
        let end = line.trim_end_matches('\n');
        let body = end.trim_end_matches(SHADES);
        let bar = &end[body.len()..];
        match bar.is_empty() {
            true => line.to_owned(),
            false => format!("{body}{BAR}{bar}{PLAIN}\n"),
        }
    };
    text.split_inclusive('\n').map(line).collect()
}

/// A number for machines: empty when undefined.
fn number(v: f64) -> String {
    if v.is_nan() {
        String::new()
    } else {
        format!("{v:.6}")
    }
}

/// Columns that tell rows apart where needed: the run, the protocol.
struct Apart {
    runs: bool,
    protocols: bool,
}

impl Apart {
    fn new(entrants: &[Entrant<'_>]) -> Apart {
        let differ = |of: fn(&Entrant<'_>) -> String| {
            let first = entrants.first().map(of);
            entrants.iter().any(|e| Some(of(e)) != first)
        };
        Apart {
            runs: differ(|e| e.run.to_owned()),
            protocols: differ(|e| e.row.protocol.clone()),
        }
    }

    fn header(&self) -> impl Iterator<Item = &str> {
        let columns = [("run", self.runs), ("protocol", self.protocols)];
        columns
            .into_iter()
            .filter(|(_, there)| *there)
            .map(|(name, _)| name)
    }

    fn cells(&self, entrant: &Entrant<'_>) -> impl Iterator<Item = String> {
        let cells = [
            (entrant.run.to_owned(), self.runs),
            (entrant.row.protocol.clone(), self.protocols),
        ];
        cells
            .into_iter()
            .filter(|(_, there)| *there)
            .map(|(text, _)| text)
    }
}

/// What `top` prints: `entrants`, ranked, as many as are asked for, with the figure that they are ranked by (`auc` where that
/// is none), and figures by group. `notes` say what is to be known about them.
pub fn top(entrants: &[Entrant<'_>], options: &TableOptions, notes: &[String]) -> String {
    let Some(figure) = entrants.first().and_then(|e| figure(e.metrics(), &options.sort)) else {
        return String::new();
    };
    let best = &entrants[..shown(entrants.len(), options.top)];
    let by = options.pick.by;
    match options.format {
        Format::Json => {
            let mut document = json!({
                "tool": env!("CARGO_PKG_NAME"),
                "version": env!("CARGO_PKG_VERSION"),
                "figure": figure.name,
                "notes": notes,
                "trackers": top_json(best, figure),
            });
            if let Some(by) = by {
                document["groups"] = groups_json(entrants, by, figure);
            }
            json_text(&document, options.pretty)
        }
        Format::Csv => match by {
            Some(by) => groups(entrants, by, figure, options),
            None => top_csv(best, figure),
        },
        Format::Table | Format::Md => {
            let mut text = top_table(best, figure, options);
            let more = entrants.len() - best.len();
            if more > 0 {
                let plural = if more == 1 { "" } else { "s" };
                text += &format!("\n{more} more tracker{plural} (-n 0 shows all)\n");
            }
            if let Some(by) = by {
                text += "\n";
                text += &groups(entrants, by, figure, options);
            }
            text
        }
    }
}

/// What stands for a tracker that is not told apart from the first.
fn level(apart: Option<bool>) -> &'static str {
    match apart {
        Some(false) => "=",
        Some(true) | None => "",
    }
}

fn top_table(best: &[Entrant<'_>], figure: &Figure, options: &TableOptions) -> String {
    let apart = Apart::new(best);
    let with_bars = options.colour && options.format == Format::Table;
    let with_failed = best.iter().any(|e| e.row.failed_runs > 0);
    let unequal = !are_of_the_same(best);
    let levels = apart_from_first(best, figure);
    let intervals: Vec<[f64; 2]> = best.iter().map(|e| e.interval(figure)).collect();
    let whole = whole_bar(
        figure,
        best.iter()
            .zip(&intervals)
            .map(|(e, i)| e.value(figure).max(i[1])),
    );
    let mut header = vec!["tracker"];
    header.extend(apart.header());
    header.extend([figure.name.as_str(), "95 % interval", "fps", "ms", "frames"]);
    if unequal {
        header.push("sequences");
    }
    if with_failed {
        header.push("failed runs");
    }
    header.push("=");
    if with_bars {
        header.push("");
    }
    let rows: Vec<Vec<String>> = best
        .iter()
        .zip(intervals.iter().zip(&levels))
        .map(|(e, (interval, level_))| {
            let mut cells = vec![e.row.tracker.id.clone()];
            cells.extend(apart.cells(e));
            cells.extend([
                short(e.value(figure), decimals(figure)),
                interval_cell(*interval, figure),
                short(e.fps, 0),
                short(1000.0 / e.fps, 2),
                e.row.score.frames().to_string(),
            ]);
            if unequal {
                cells.push(e.row.sequences.to_string());
            }
            if with_failed {
                cells.push(match e.row.failed_runs {
                    0 => String::new(),
                    n => format!("{n} of {}", e.row.runs),
                });
            }
            cells.push(level(*level_).to_owned());
            if with_bars {
                cells.push(bar(e.value(figure), *interval, whole));
            }
            cells
        })
        .collect();
    let mut text = render(&header, &rows, options.format, options.colour);
    if with_bars {
        text = with_colour(&text);
    }
    if levels.contains(&Some(false)) {
        text += "\n=: not told apart from the first (paired over sequences, false discovery rate 5 %)\n";
    }
    if unequal {
        text += "\nnot all rows are of the same sequences\n";
    }
    text
}

fn top_csv(best: &[Entrant<'_>], figure: &Figure) -> String {
    let header = [
        "run",
        "tracker",
        "sm",
        "am",
        "ssm",
        "ilm",
        "protocol",
        "figure",
        "value",
        "low95",
        "high95",
        "level_with_first",
        "fps",
        "ms",
        "frames",
        "sequences",
        "runs",
        "failed_runs",
    ];
    let levels = apart_from_first(best, figure);
    let row = |(e, apart): (&Entrant<'_>, &Option<bool>)| {
        let t = &e.row.tracker;
        let mut cells = vec![e.run.to_owned()];
        cells.extend([&t.id, &t.sm, &t.am, &t.ssm, &t.ilm, &e.row.protocol, &figure.name].map(String::clone));
        cells.push(number(e.value(figure)));
        cells.extend(e.interval(figure).map(number));
        cells.push(
            apart
                .map_or("", |apart| if apart { "no" } else { "yes" })
                .to_owned(),
        );
        cells.extend([number(e.fps), number(1000.0 / e.fps)]);
        let counts = [
            e.row.score.frames(),
            e.row.sequences,
            e.row.runs,
            e.row.failed_runs,
        ];
        cells.extend(counts.map(|n| n.to_string()));
        cells
    };
    let rows: Vec<Vec<String>> = best.iter().zip(&levels).map(row).collect();
    render(&header, &rows, Format::Csv, false)
}

fn top_json(best: &[Entrant<'_>], figure: &Figure) -> Vec<Value> {
    let levels = apart_from_first(best, figure);
    let row = |(e, apart): (&Entrant<'_>, &Option<bool>)| {
        let [low, high] = e.interval(figure);
        json!({
            "run": e.run,
            "tracker": e.row.tracker.id,
            "sm": e.row.tracker.sm,
            "am": e.row.tracker.am,
            "ssm": e.row.tracker.ssm,
            "ilm": e.row.tracker.ilm,
            "protocol": e.row.protocol,
            "value": e.value(figure),
            "low95": low,
            "high95": high,
            "level_with_first": apart.map(|apart| !apart),
            "fps": e.fps,
            "ms": 1000.0 / e.fps,
            "frames": e.row.score.frames(),
            "sequences": e.row.sequences,
            "runs": e.row.runs,
            "failed_runs": e.row.failed_runs,
        })
    };
    best.iter().zip(&levels).map(row).collect()
}

/// Figures by group. For people: where sequences are grouped, a table of the best trackers x groups, in which `*` marks the
/// best of each group; then what is said of each group. `Csv`: where sequences are grouped, a row per tracker and group, else
/// a row per group.
pub(super) fn groups(entrants: &[Entrant<'_>], by: Group, figure: &Figure, options: &TableOptions) -> String {
    let grouping = grouped(entrants, by, figure);
    if options.format == Format::Csv && by.part().is_none() {
        let header = ["run", "tracker", "protocol", by.word(), "figure", "value"];
        let rows = entrants.iter().zip(&grouping.cells).flat_map(|(e, cells)| {
            let there = grouping.columns.iter().zip(cells).filter(|(_, v)| !v.is_nan());
            there.map(move |(name, v)| {
                let words = [e.run, &e.row.tracker.id, &e.row.protocol, name, &figure.name];
                let mut row: Vec<String> = words.map(str::to_owned).into();
                row.push(number(*v));
                row
            })
        });
        return render(&header, &rows.collect::<Vec<_>>(), Format::Csv, false);
    }
    let apart = Apart::new(entrants);
    let members = if by.part().is_some() {
        "trackers"
    } else {
        "sequences"
    };
    if options.format == Format::Csv {
        let header = [
            by.word(),
            "protocol",
            members,
            "figure",
            "median",
            "best",
            "low95",
            "high95",
            "fps",
            "tracker",
            "run",
        ];
        let rows = grouping.groups.iter().map(|g| {
            let mut row = vec![
                g.group.clone(),
                g.protocol.to_owned(),
                g.members.to_string(),
                figure.name.clone(),
            ];
            row.extend([g.median, g.value, g.interval[0], g.interval[1], g.best.fps].map(number));
            row.extend([g.best.row.tracker.id.clone(), g.best.run.to_owned()]);
            row
        });
        return render(&header, &rows.collect::<Vec<_>>(), Format::Csv, false);
    }
    let mut text = String::new();
    if by.part().is_none() {
        let best = &entrants[..shown(entrants.len(), options.top)];
        let mut header = vec!["tracker"];
        header.extend(apart.header());
        header.extend(grouping.columns.iter().map(String::as_str));
        let is_best = |e: &Entrant<'_>, name: &String| {
            let of_group = |g: &&crate::judge::ranking::GroupRow<'_>| {
                g.group == *name && std::ptr::eq(g.best.row, e.row)
            };
            grouping.groups.iter().any(|g| of_group(&g))
        };
        let rows = best.iter().zip(&grouping.cells).map(|(e, cells)| {
            let mut row = vec![e.row.tracker.id.clone()];
            row.extend(apart.cells(e));
            row.extend(grouping.columns.iter().zip(cells).map(|(name, v)| {
                let mark = if is_best(e, name) { "*" } else { "" };
                format!("{mark}{}", short(*v, decimals(figure)))
            }));
            row
        });
        text += &render(&header, &rows.collect::<Vec<_>>(), options.format, options.colour);
        text += &format!(
            "\n{} of each tracker by {}; *: the best of all trackers\n\n",
            figure.name,
            by.word()
        );
    }
    let with_bars = options.colour && options.format == Format::Table;
    let (median, best) = (format!("median {}", figure.name), format!("best {}", figure.name));
    let mut header = vec![by.word()];
    header.extend(apart.protocols.then_some("protocol"));
    header.extend([members, &median, &best, "95 % interval", "fps", "best tracker"]);
    header.extend(apart.runs.then_some("run"));
    header.extend(with_bars.then_some(""));
    let whole = whole_bar(figure, grouping.groups.iter().map(|g| g.value.max(g.interval[1])));
    let rows = grouping.groups.iter().map(|g| {
        let mut row = vec![g.group.clone()];
        row.extend(apart.protocols.then(|| g.protocol.to_owned()));
        row.extend([
            g.members.to_string(),
            short(g.median, decimals(figure)),
            short(g.value, decimals(figure)),
            interval_cell(g.interval, figure),
            short(g.best.fps, 0),
            g.best.row.tracker.id.clone(),
        ]);
        row.extend(apart.runs.then(|| g.best.run.to_owned()));
        row.extend(with_bars.then(|| bar(g.value, g.interval, whole)));
        row
    });
    let table = render(&header, &rows.collect::<Vec<_>>(), options.format, options.colour);
    text + &if with_bars { with_colour(&table) } else { table }
}

/// Figures by group as a document.
pub(super) fn groups_json(entrants: &[Entrant<'_>], by: Group, figure: &Figure) -> Value {
    let grouping = grouped(entrants, by, figure);
    let groups = grouping.groups.iter().map(|g| {
        let members = if by.part().is_some() {
            "trackers"
        } else {
            "sequences"
        };
        json!({
            "group": g.group,
            "protocol": g.protocol,
            members: g.members,
            "median": g.median,
            "best": g.value,
            "low95": g.interval[0],
            "high95": g.interval[1],
            "fps": g.best.fps,
            "tracker": g.best.row.tracker.id,
            "run": g.best.run,
        })
    });
    let mut document = json!({"by": by.word(), "figure": figure.name, "groups": groups.collect::<Vec<_>>()});
    if by.part().is_none() {
        let row = |(e, cells): (&Entrant<'_>, &Vec<f64>)| {
            let there = grouping.columns.iter().zip(cells).filter(|(_, v)| !v.is_nan());
            let values: Map<String, Value> = there.map(|(name, v)| (name.clone(), (*v).into())).collect();
            json!({
                "run": e.run,
                "tracker": e.row.tracker.id,
                "protocol": e.row.protocol,
                "values": values,
            })
        };
        document["trackers"] = entrants.iter().zip(&grouping.cells).map(row).collect();
    }
    document
}
