//! `mtf-eval compare`: what changed between runs, and whether it is more than chance.

mod pairs;

use super::console::{Console, print, print_data_line};
use super::exit::{Failure, Outcome};
use super::program::Program;
use super::values::rate;
use crate::judge::compare::{
    Comparison, Doubt, FigureChange, FinishedRun, Options, TrackerChange, Verdict, compare_all, parse_figure,
    rank_all,
};
use crate::metric::aggregate::Average;
use crate::report::{Format, render};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::ExitCode;

/// Compare runs: what changed, and whether it is more than chance
///
/// First what is equal to the last digit, tracker by tracker and sequence by sequence. For each tracker that changed: the
/// figures (numbers such as the AUC) in both runs, the 95 % interval of their difference over sequences (a paired
/// bootstrap) and `q`, the p value adjusted for the number of changed trackers and figures. `~` stands where the interval
/// spans 0, `~ (q)` where the interval, which is of one change alone, leaves out 0 but q exceeds --fdr: other sequences
/// might show the opposite. Trackers that differ by settings alone (--set max_iters=2) are compared with each other. Exit
/// code 11: the runs have another protocol, other data or other thresholds.
///
/// --all-pairs ranks trackers instead. On each sequence the best has rank 1. Two trackers that share a letter do not differ:
/// the p value of their difference over sequences, corrected for the number of pairs after Holm, exceeds --fdr.
#[derive(clap::Args, Debug)]
pub struct CompareArgs {
    /// Run directories; each is compared with the first, or with --reference
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// Compare every tracker of all runs with this one, of the first run that has it, rather than with itself; several
    /// times for several references
    #[arg(long = "reference", value_name = "TRACKER")]
    pub references: Vec<String>,
    /// All trackers of all runs beside each other: mean ranks over sequences, and letters of the groups that do not differ
    #[arg(long, conflicts_with = "references")]
    pub all_pairs: bool,
    /// Figures (columns of the table) to compare: auc, sr_1 to sr_20, sr_area, al_mean, mcd_mean, cl_mean, jaccard_mean
    ///
    /// --all-pairs takes the first.
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "auc,sr_5,al_mean"
    )]
    pub figures: Vec<String>,
    /// Over all frames, or over sequences alike
    #[arg(long, value_enum, value_name = "HOW", default_value = "pooled")]
    pub average: AverageArg,
    /// False discovery rate: the share of false ones among the changes called better or worse, 0 to 1
    ///
    /// With --all-pairs: the chance of even one false difference.
    #[arg(long, value_name = "RATE", default_value = "0.05", value_parser = rate)]
    pub fdr: f64,
    /// Bootstrap samples
    #[arg(long, hide_short_help = true, value_name = "N", default_value = "10000", value_parser = clap::value_parser!(u32).range(100..))]
    pub resamples: u32,
    /// Seed of the bootstrap
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Form of the result: a row per tracker and figure; json: everything, unchanged trackers left out
    ///
    /// With --all-pairs a row per tracker; json then has the tests of all pairs. JSON is on one line; --pretty indents it.
    #[arg(long, value_name = "FORMAT", default_value = "table")]
    pub format: Format,
    /// How many changes tables show, each tracker and protocol being one (0: all)
    ///
    /// With --all-pairs: how many trackers are compared, those with the best figure.
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub top: usize,
}

/// What figures are averaged over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum AverageArg {
    /// All frames together
    Pooled,
    /// Mean over sequences
    SeqMean,
}

/// Runs the command.
///
/// # Errors
/// Directories that hold no finished run; runs that do not compare.
pub fn run(args: &CompareArgs, program: &Program) -> Outcome {
    let console = &program.console;
    if args.runs.len() < 2 && args.references.is_empty() && !args.all_pairs {
        return Err(Failure::usage(
            "give two runs, or one and --reference TRACKER to compare its trackers with one of them, or one and --all-pairs \
             to rank them",
        ));
    }
    let metrics = &program.catalogue.metrics;
    let figures = args.figures.iter().map(|name| parse_figure(metrics, name));
    let options = Options {
        figures: figures
            .collect::<Result<_, _>>()
            .map_err(|e| Failure::usage(format!("--figures: {e}")))?,
        average: match args.average {
            AverageArg::Pooled => Average::Pooled,
            AverageArg::SeqMean => Average::SeqMean,
        },
        fdr: args.fdr,
        resamples: args.resamples as usize,
        seed: args.seed,
        reference: None,
    };
    let runs: Vec<FinishedRun> = args
        .runs
        .iter()
        .map(|dir| Ok(FinishedRun::read(dir, metrics)?))
        .collect::<Result<_, Failure>>()?;
    let (text, warnings) = if args.all_pairs {
        let found = rank_all(&runs, args.top, &options)?;
        let text = match args.format {
            Format::Json => console.json(&pairs::json(&found, &options)),
            Format::Csv => pairs::csv(&found),
            format => pairs::people(&found, &options, format, console.table_colour),
        };
        (
            text,
            found.into_iter().flat_map(|r| r.warnings).collect::<Vec<_>>(),
        )
    } else {
        let found = compare_all(&runs, &args.references, &options)?;
        let text = match args.format {
            Format::Json => console.json(&json(&found, &options)),
            Format::Csv => csv(&found),
            Format::Table | Format::Md => {
                let each: Vec<String> = found.iter().map(|c| people(c, args, console)).collect();
                each.join("\n")
            }
        };
        (text, found.into_iter().flat_map(|c| c.warnings).collect())
    };
    print(&text)?;
    for run in &runs {
        let line = run.data.line().map(|line| format!("{}: {line}", run.name));
        print_data_line(line.as_deref(), args.format, console)?;
    }
    for warning in &warnings {
        console.warn(warning);
    }
    Ok(ExitCode::SUCCESS)
}

/// `1 tracker`, `2 trackers`
fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

fn people(found: &Comparison, args: &CompareArgs, console: &Console) -> String {
    const NAMED: usize = 5;
    let md = args.format == Format::Md;
    // Markdown joins lines that stand together.
    let end = if md { "  \n" } else { "\n" };
    let mut text = match &found.reference {
        Some(tracker) => format!("A: {tracker} in {}{end}B: trackers of {}{end}", found.a, found.b),
        None => format!("A: {}{end}B: {}{end}", found.a, found.b),
    };
    for setting in &found.settings {
        text += &format!("{setting}{end}");
    }
    for (letter, ids) in [("A", &found.only_a), ("B", &found.only_b)] {
        if !ids.is_empty() {
            let more = match ids.len().saturating_sub(NAMED) {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            let named: Vec<&str> = ids.iter().take(NAMED).map(String::as_str).collect();
            text += &format!("only in {letter}: {}{more}{end}", named.join(", "));
        }
    }
    let shown = match args.top {
        0 => found.changed.len(),
        top => top.min(found.changed.len()),
    };
    if shown > 0 {
        text += "\n";
        text += &table(&found.changed[..shown], args.format, console);
    }
    if shown < found.changed.len() {
        let more = count(found.changed.len() - shown, "more change");
        text += &format!("\n{more} (--top 0 shows all)\n");
    }
    let with = |verdict| {
        let judged = |c: &&TrackerChange| c.figures.first().is_some_and(|f| f.verdict == verdict);
        found.changed.iter().filter(judged).count()
    };
    let units = format!(
        "{} (one tracker on one sequence each)",
        count(found.units, "unit")
    );
    let summary = match found.changed.len() {
        0 => format!(
            "no difference: {units} of {} equal",
            count(found.trackers, "tracker")
        ),
        n => format!(
            "{} of {} changed{}, in {} of {units}; {} better, {} worse, {} unclear",
            found.trackers_changed,
            count(found.trackers, "tracker"),
            match found.cases == found.trackers {
                true => String::new(),
                false => format!(" ({n} of {} with each protocol apart)", found.cases),
            },
            found.units - found.identical,
            with(Verdict::Better),
            with(Verdict::Worse),
            with(Verdict::Unclear),
        ),
    };
    let by = match args.figures.first() {
        Some(figure) if !found.changed.is_empty() => format!(" (by {figure})"),
        _ => String::new(),
    };
    let many = shown_figures(&found.changed[..shown]).any(|f| f.doubt == Some(Doubt::Many));
    let why = match many {
        true => format!(
            "~ (q): the interval of this change alone leaves out 0, but q exceeds {}: chance gives as much over so few \
             sequences or among so many changes{end}",
            args.fdr
        ),
        false => String::new(),
    };
    text + &format!("\n{why}{summary}{by}\n")
}

fn shown_figures(changed: &[TrackerChange]) -> impl Iterator<Item = &FigureChange> {
    changed.iter().flat_map(|c| &c.figures)
}

/// A row per figure; the tracker's name stands in its first.
fn table(changed: &[TrackerChange], format: Format, console: &Console) -> String {
    let header = [
        "tracker",
        "changed",
        "figure",
        "A",
        "B",
        "change",
        "95 % interval",
        "q",
        "",
    ];
    let signed = |v: f64| format!("{v:+.4}");
    let several = changed.iter().any(|c| c.protocol != changed[0].protocol);
    let rows: Vec<Vec<String>> = changed
        .iter()
        .flat_map(|c| {
            c.figures.iter().enumerate().map(move |(i, f)| {
                let (tracker, sequences) = match i {
                    0 => (
                        match several {
                            true => format!("{} ({})", c.tracker, c.protocol),
                            false => c.tracker.clone(),
                        },
                        format!("{}/{} sequences", c.sequences_changed, c.sequences),
                    ),
                    _ => (String::new(), String::new()),
                };
                let interval = match f.interval {
                    [low, _] if low.is_nan() => "-".to_owned(),
                    [low, high] => format!("{} {}", signed(low), signed(high)),
                };
                vec![
                    tracker,
                    sequences,
                    f.figure.clone(),
                    format!("{:.4}", f.a),
                    format!("{:.4}", f.b),
                    signed(f.b - f.a),
                    interval,
                    format!("{:.3}", f.q),
                    match f.doubt.and_then(Doubt::word) {
                        Some(why) => format!("{} ({why})", f.verdict.word()),
                        None => f.verdict.word().to_owned(),
                    },
                ]
            })
        })
        .collect();
    render(&header, &rows, format, console.table_colour)
}

fn csv(found: &[Comparison]) -> String {
    let header = [
        "a",
        "b",
        "reference",
        "tracker",
        "figure",
        "value_a",
        "value_b",
        "change",
        "low95",
        "high95",
        "p",
        "q",
        "verdict",
        "sequences",
        "sequences_changed",
        "runs",
        "runs_changed",
        "protocol",
        "tracker_a",
    ];
    let number = |v: f64| {
        if v.is_nan() {
            String::new()
        } else {
            format!("{v:.6}")
        }
    };
    let row = |c: &Comparison, t: &TrackerChange| -> Vec<Vec<String>> {
        let each = t.figures.iter().map(|f| {
            let mut cells = vec![
                c.a.clone(),
                c.b.clone(),
                c.reference.clone().unwrap_or_default(),
                t.tracker.clone(),
                f.figure.clone(),
            ];
            cells.extend([f.a, f.b, f.b - f.a, f.interval[0], f.interval[1], f.p, f.q].map(number));
            cells.push(f.verdict.word().to_owned());
            let counts = [t.sequences, t.sequences_changed, t.units, t.units_changed];
            cells.extend(counts.map(|n| n.to_string()));
            cells.extend([t.protocol.clone(), t.tracker_a.clone()]);
            cells
        });
        each.collect()
    };
    let rows: Vec<Vec<String>> = found
        .iter()
        .flat_map(|c| c.changed.iter().flat_map(move |t| row(c, t)))
        .collect();
    render(&header, &rows, Format::Csv, false)
}

fn json(found: &[Comparison], options: &Options) -> Value {
    json!({
        "tool": env!("CARGO_PKG_NAME"),
        "version": env!("CARGO_PKG_VERSION"),
        "average": options.average,
        "fdr": options.fdr,
        "resamples": options.resamples,
        "seed": options.seed,
        "comparisons": found,
    })
}
