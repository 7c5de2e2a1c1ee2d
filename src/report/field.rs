//! The figures of benchmarks of the field, for people and machines.

use super::table::{Format, TableOptions, json_text, render, short};
use crate::judge::field::{Benchmark, Quantity, Row};

/// What `--report-as` prints: the figures of a benchmark, and its published ones if `with_published`.
pub fn field_table(
    rows: &[Row],
    benchmark: &Benchmark,
    with_published: bool,
    options: &TableOptions,
) -> String {
    let machine = matches!(options.format, Format::Json | Format::Csv);
    let shown = if options.top == 0 || machine {
        rows.len()
    } else {
        options.top.min(rows.len())
    };
    let names = benchmark.quantities.iter().map(|q| q.name);
    let header: Vec<&str> = ["tracker"]
        .into_iter()
        .chain(names)
        .chain(["frames", "protocol"])
        .collect();
    if options.format == Format::Json {
        let figure = |(q, v): (&Quantity, &f64)| (q.name.to_owned(), serde_json::json!(v));
        let object = |row: &Row| {
            let figures: serde_json::Map<_, _> = benchmark
                .quantities
                .iter()
                .zip(&row.figures)
                .map(figure)
                .collect();
            serde_json::json!({
                "tracker": row.tracker, "protocol": row.protocol, "frames": row.frames, "figures": figures, "roc": row.roc,
            })
        };
        let published = benchmark.published.iter().filter(|_| with_published).map(|p| {
            let figures: serde_json::Map<_, _> =
                benchmark.quantities.iter().zip(p.figures).map(figure).collect();
            serde_json::json!({ "tracker": p.tracker, "figures": figures })
        });
        let document = serde_json::json!({
            "benchmark": benchmark.name, "about": benchmark.caption(), "trackers": rows.iter().map(object).collect::<Vec<_>>(),
            "published": published.collect::<Vec<_>>(),
        });
        return json_text(&document, options.pretty);
    }
    let decimals = if machine { 6 } else { 3 };
    let cells = |name: String, figures: &[f64], rest: [String; 2]| {
        let figures = figures.iter().map(|v| short(*v, decimals));
        [name]
            .into_iter()
            .chain(figures)
            .chain(rest)
            .collect::<Vec<String>>()
    };
    let own = rows[..shown].iter().map(|r| {
        cells(
            r.tracker.clone(),
            &r.figures,
            [r.frames.to_string(), r.protocol.clone()],
        )
    });
    let published = benchmark.published.iter().filter(|_| with_published);
    let published = published.map(|p| {
        cells(
            format!("{} (published)", p.tracker),
            p.figures,
            Default::default(),
        )
    });
    let text = render(
        &header,
        &own.chain(published).collect::<Vec<_>>(),
        options.format,
        options.colour,
    );
    match options.format {
        Format::Csv => text,
        _ => format!("{text}\n{}\n", benchmark.caption()),
    }
}
